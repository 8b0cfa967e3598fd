//! Files that the paths of settings lead to. They are protected before a use case looks at its outputs.

use crate::app::scan::ScanSettings;
use crate::app::{sequence, volume};
use crate::formats::format::FileKind;
use crate::formats::imaging::zarr;
use crate::formats::limits::Limits;
use crate::formats::sequence::Pattern;
use crate::formats::{captures, protected, registry, scene_file};
use std::path::{Path, PathBuf};

/// Protects what the paths lead to, and all that is read, as long as the returned value is held. What cannot be read is
/// told of by the use case itself.
pub(crate) fn protect<'p>(paths: impl IntoIterator<Item = &'p Path>, limits: Limits) -> protected::Watch {
    let watch = protected::watch();
    paths.into_iter().flat_map(|path| files(path, limits)).for_each(|path| protected::add(&path));
    watch
}

/// Returns the files that a path leads to: those of a sequence, those in a folder, the cameras, pictures and masks of a
/// capture, what a scene file names, and the file itself.
pub(crate) fn files(path: &Path, limits: Limits) -> Vec<PathBuf> {
    if let Some(pattern) = sequence::pattern(path) {
        return frames(&pattern).iter().flat_map(|path| of_file(path, limits)).collect();
    }
    if path.is_dir() && !captures::file(path).exists() {
        if zarr::is_zarr(path) {
            return below(path);
        }
        let entries = std::fs::read_dir(path).into_iter().flatten();
        return entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|path| path.is_file()).collect();
    }
    of_file(path, limits)
}

fn frames(pattern: &Pattern) -> Vec<PathBuf> {
    pattern.numbers().into_iter().flatten().map(|number| pattern.path(number)).collect()
}

fn of_file(path: &Path, limits: Limits) -> Vec<PathBuf> {
    let mut all = volume::files(path, &ScanSettings::default(), limits);
    if registry::sniff(path).is_ok_and(|format| matches!(format.kind, FileKind::Capture)) {
        all.extend(captures::files(path));
        match captures::stated_within(path, limits) {
            Ok(stated) => {
                all.extend(stated.capture.frames.into_iter().map(|frame| frame.picture));
                all.extend(stated.optics.into_iter().filter_map(|optics| optics.mask));
            }
            Err(_) => all.extend(of_scene(path, limits)),
        }
    }
    all
}

/// Returns the files in a folder and below it.
fn below(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    let paths = entries.filter_map(|entry| Some(entry.ok()?.path()));
    paths.flat_map(|path| if path.is_dir() && !path.is_symlink() { below(&path) } else { vec![path] }).collect()
}

/// Returns the files that a scene file names.
fn of_scene(path: &Path, limits: Limits) -> Vec<PathBuf> {
    let scene = scene_file::read(path, limits);
    let folder = path.parent().unwrap_or(Path::new(""));
    let named = scene.iter().flat_map(|scene| scene.files()).map(|file| folder.join(file));
    named.flat_map(|file| Pattern::parse(&file).map_or_else(|| vec![file], |pattern| frames(&pattern))).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn paths_lead_to_all_files_behind_them() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        for name in ["s.1.vdb", "s.2.vdb", "fire.tf.json", "sky.exr", "a.exr", "mask.png", "one.vdb"] {
            std::fs::write(at(name), "x").unwrap();
        }
        let scene = r#"{"volumes": [{"file": "s.#.vdb", "medium": {"transfer": "fire.tf.json"}}, {"file": "one.vdb"}],
                        "lights": [{"type": "DomeLight", "texture": "sky.exr"}]}"#;
        std::fs::write(at("scene.json"), scene).unwrap();
        std::fs::create_dir(at("cap")).unwrap();
        let capture = r#"{"w": 4, "h": 4, "fl_x": 4, "frames": [{"file_path": "../a.exr", "mask_path": "../mask.png",
                          "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}"#;
        std::fs::write(at("cap/transforms.json"), capture).unwrap();
        let names = |path: &str| {
            let mut names: Vec<String> = files(&at(path), Limits::default())
                .iter()
                .map(|p| p.file_name().unwrap().to_str().unwrap().to_owned())
                .collect();
            names.sort_unstable();
            names.dedup();
            names
        };
        assert_eq!(names("s.#.vdb"), ["s.1.vdb", "s.2.vdb"]);
        assert_eq!(names("one.vdb"), ["one.vdb"]);
        assert_eq!(names("scene.json"), ["fire.tf.json", "one.vdb", "s.1.vdb", "s.2.vdb", "scene.json", "sky.exr"]);
        for capture in ["cap", "cap/transforms.json"] {
            assert_eq!(
                names(capture).join(" "),
                format!("a.exr {}mask.png transforms.json", if capture == "cap" { "cap " } else { "" })
            );
        }
        assert_eq!(names("").len(), 8);
        assert_eq!(names("none.vdb"), ["none.vdb"]);
    }
}
