//! Files that a view names.

use super::keys::{missing, short};
use crate::error::{Error, Result};
use crate::formats::format::FileKind;
use crate::formats::registry;
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};

/// Returns the path of a frame's picture, from its `file_path`.
///
/// # Errors
/// If there is no such key, or it is no text.
pub(super) fn picture(own: &Map<String, Value>, folder: &Path) -> Result<PathBuf> {
    let name = match own.get("file_path") {
        Some(Value::String(name)) if !name.is_empty() => name,
        Some(other) => {
            return Err(Error::invalid(format!("'file_path' is {}; a text is expected", short(other)))
                .hint("'file_path' is the picture's path, relative to this file"));
        }
        None => return Err(missing("file_path", "the picture's path, relative to this file")),
    };
    Ok(resolved(name, folder))
}

/// Returns the path of the mask of a view, if it has one.
///
/// # Errors
/// If the key is no text.
pub(super) fn mask(own: &Map<String, Value>, folder: &Path) -> Result<Option<PathBuf>> {
    match own.get("mask_path") {
        None | Some(Value::Null) => Ok(None),
        Some(Value::String(name)) => Ok(Some(resolved(name, folder))),
        Some(other) => Err(Error::invalid(format!("'mask_path' is {}; a text is expected", short(other)))
            .hint("'mask_path' is the path of a picture that is black where the view is not to be used")),
    }
}

/// Path of a file as programs name it: with or without a suffix, in whichever case, with the separators of either
/// system. Where nothing is found, it is the name as it stands, with `.exr` if it has no suffix.
fn resolved(name: &str, folder: &Path) -> PathBuf {
    let plain = |name: &str| -> (PathBuf, Option<PathBuf>) {
        let path = folder.join(name);
        // "view.0001" has no suffix of a picture, but Path would take ".0001" for one.
        let suffix = path.extension().map(|e| e.to_string_lossy().into_owned());
        let suffix = suffix.filter(|e| e.chars().any(|c| c.is_ascii_alphabetic()));
        if path.is_file() {
            return (path.clone(), Some(path));
        }
        let candidates: Vec<PathBuf> = match &suffix {
            Some(suffix) => cases(suffix).map(|suffix| path.with_extension(suffix)).to_vec(),
            None => registry::endings(FileKind::is_picture)
                .into_iter()
                .flat_map(cases)
                .map(|s| folder.join(format!("{name}.{s}")))
                .collect(),
        };
        let expected = if suffix.is_some() { path } else { folder.join(format!("{name}.exr")) };
        (expected, candidates.into_iter().find(|path| path.is_file()))
    };
    let (expected, file) = plain(name);
    let file = file.or_else(|| name.contains('\\').then(|| plain(&name.replace('\\', "/")).1).flatten());
    file.unwrap_or(expected)
}

fn cases(suffix: &str) -> [String; 2] {
    [suffix.to_ascii_lowercase(), suffix.to_ascii_uppercase()]
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn names_lead_to_files_whatever_their_suffix() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir(dir.path().join("train")).unwrap();
        for name in ["train/r_0.png", "b.JPG", "c.0001.exr", "d.png", "d.exr"] {
            std::fs::write(dir.path().join(name), "").unwrap();
        }
        for (name, file) in [
            ("./train/r_0", "train/r_0.png"),
            (".\\train\\r_0", "train/r_0.png"),
            ("train/r_0.PNG", "train/r_0.png"),
            ("b.jpg", "b.JPG"),
            ("b", "b.JPG"),
            ("c.0001", "c.0001.exr"),
            ("d", "d.exr"),
            ("none", "none.exr"),
            ("none.png", "none.png"),
        ] {
            let expected: PathBuf = dir.path().join(file).components().collect();
            assert_eq!(resolved(name, dir.path()).components().collect::<PathBuf>(), expected, "{name}");
        }
    }
}
