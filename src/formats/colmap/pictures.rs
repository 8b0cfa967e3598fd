//! The pictures of a model, whose folder no file states.

use std::path::{Path, PathBuf};

/// Returns the folder that the names of a model's pictures are relative to: the first in which `name` is found of the
/// model's own folder, `images` in it, and the same of up to three folders above. Without any, it is where COLMAP's
/// tutorial has it: `images` beside the folder `sparse` of the model, or in the model's own.
pub(super) fn folder(model: &Path, name: &str) -> PathBuf {
    let above = |levels: usize| (0..levels).fold(model.to_path_buf(), |folder, _| up(&folder));
    let places = (0..=3).flat_map(|levels| {
        let folder = above(levels);
        [folder.join("images"), folder]
    });
    let usual = if above(1).file_name().is_some_and(|folder| folder == "sparse") { above(2) } else { above(0) };
    places.into_iter().find(|folder| stored(folder, name).is_some()).unwrap_or_else(|| usual.join("images"))
}

/// Returns the path of a picture: by its name, or else as the EXR of the same name.
pub(super) fn find(folder: &Path, name: &str) -> PathBuf {
    stored(folder, name).unwrap_or_else(|| folder.join(name))
}

fn stored(folder: &Path, name: &str) -> Option<PathBuf> {
    let path = folder.join(name);
    let exr = path.with_extension("exr");
    [path, exr].into_iter().find(|path| path.is_file())
}

/// The folder above another, which a relative path need not name.
fn up(folder: &Path) -> PathBuf {
    match folder.parent() {
        Some(parent) if folder.file_name().is_some() => parent.to_path_buf(),
        _ => folder.join(".."),
    }
}
