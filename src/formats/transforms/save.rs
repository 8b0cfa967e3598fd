//! Writing of captures as JSON.

use super::keys::rows;
use super::{blur, folder};
use crate::error::{Error, Result};
use crate::formats::atomic;
use crate::scene::camera::{Camera, Projection};
use crate::scene::capture::Capture;
use serde_json::{Map, Value, json};
use std::path::{Component, Path, PathBuf};

/// Writes a capture, without its pictures, to the JSON file `path`. Numbers are written so that [`load`](super::load)
/// returns the same bits.
/// Values that all views share are written once. `extra` adds keys at the top, such as provenance; none may be a key of
/// a capture.
///
/// # Errors
/// If a picture's path is not valid Unicode, a key of `extra` is taken, or the file cannot be written.
pub fn save(path: &Path, capture: &Capture, extra: &Map<String, Value>) -> Result<()> {
    save_for(path, path, capture, extra)
}

/// Writes a capture as [`save`] does to the file `now`, which will later be moved to `path`. Pictures' paths are
/// relative to the folder of `path`.
///
/// # Errors
/// The conditions are those of [`save`].
pub(crate) fn save_for(path: &Path, now: &Path, capture: &Capture, extra: &Map<String, Value>) -> Result<()> {
    let text = text(path, capture, extra).map_err(|e| e.at(path))?;
    atomic::write_bytes(now, text.as_bytes())
}

/// Checks that a capture's pictures can be named in the JSON file `path`, before the work whose result it is to hold:
/// JSON is Unicode, and paths need not be.
///
/// # Errors
/// If a picture's path from the folder of `path` is not valid Unicode; the error names the first such frame.
pub(crate) fn check_names(path: &Path, capture: &Capture) -> Result<()> {
    let folder = folder(path);
    let mut frames = capture.frames.iter().enumerate();
    frames.try_for_each(|(i, frame)| named(&frame.picture, &folder, i).map(drop)).map_err(|e| e.at(path))
}

/// Path of the picture of frame `i` relative to the capture's folder, as text.
fn named(picture: &Path, folder: &Path, i: usize) -> Result<String> {
    let relative = relative(picture, folder);
    relative.to_str().map(str::to_owned).ok_or_else(|| {
        Error::invalid(format!("picture path {} is not Unicode, which JSON cannot state", relative.display()))
            .part(format!("frame {i}"))
            .hint("rename the folders and files on this path, or write the JSON file beside the pictures")
    })
}

fn text(path: &Path, capture: &Capture, extra: &Map<String, Value>) -> Result<String> {
    let mut root = Map::new();
    let first = capture.frames.first().map(|f| intrinsics(&f.camera)).unwrap_or_default();
    let mut shared = first.clone();
    for frame in &capture.frames {
        let own = intrinsics(&frame.camera);
        shared.retain(|key, value| own.get(key) == Some(value));
    }
    let folder = folder(path);
    let frames = capture
        .frames
        .iter()
        .enumerate()
        .map(|(i, frame)| {
            let name = named(&frame.picture, &folder, i)?;
            let mut own = Map::new();
            own.insert("file_path".into(), json!(name));
            own.insert("transform_matrix".into(), rows(frame.camera.camera_to_world));
            own.extend(blur::own_keys(&frame.camera.blur));
            own.extend(intrinsics(&frame.camera).into_iter().filter(|(key, _)| !shared.contains_key(key)));
            Ok(Value::Object(own))
        })
        .collect::<Result<Vec<_>>>()?;
    root.append(&mut shared);
    root.insert("model".into(), json!(capture.model));
    root.insert("background".into(), json!(capture.background.map(shortest)));
    root.insert("pixel_filter".into(), json!(capture.pixel_filter));
    root.insert("density_scale".into(), json!(capture.density_scale));
    root.insert("emission".into(), json!(capture.emission.map(shortest)));
    root.insert("emission_model".into(), json!(capture.emission_model));
    if let Some(transfer) = &capture.transfer {
        root.insert("transfer".into(), json!(transfer));
    }
    if let Some(lattice) = capture.lattice {
        root.insert("lattice".into(), rows(lattice));
    }
    if let Some(space) = capture.color_space {
        root.insert("color_space".into(), json!(space));
    }
    if let Some(pictures) = capture.pictures {
        root.insert("pictures".into(), json!(pictures));
    }
    root.insert("frames".into(), Value::Array(frames));
    for (key, value) in extra {
        if root.insert(key.clone(), value.clone()).is_some() {
            return Err(Error::invalid(format!("key '{key}' is one of the capture's own"))
                .hint("give the extra entry another name"));
        }
    }
    let mut text = serde_json::to_string_pretty(&Value::Object(root)).map_err(|e| {
        Error::invalid(format!("the capture cannot be written as JSON: {e}")).hint("report this as a bug")
    })?;
    text.push('\n');
    Ok(text)
}

/// Path of a picture relative to the capture's folder. A picture elsewhere is reached by `..` if both folders exist; an
/// absolute path is kept.
fn relative(picture: &Path, folder: &Path) -> PathBuf {
    if let Ok(inside) = picture.strip_prefix(folder) {
        return inside.to_path_buf();
    }
    let real = |p: &Path| std::fs::canonicalize(if p.as_os_str().is_empty() { Path::new(".") } else { p });
    let place = picture.parent().zip(picture.file_name());
    let Some((parent, name)) = place.filter(|_| picture.is_relative()) else { return picture.to_path_buf() };
    let (Ok(from), Ok(to)) = (real(folder), real(parent)) else { return picture.to_path_buf() };
    let shared = from.components().zip(to.components()).take_while(|(a, b)| a == b).count();
    // Folders on different drives have no relative path.
    if shared == 0 {
        return to.join(name);
    }
    let up = from.components().skip(shared).map(|_| Component::ParentDir);
    up.chain(to.components().skip(shared)).collect::<PathBuf>().join(name)
}

/// JSON entries of a camera except its position and orientation.
fn intrinsics(camera: &Camera) -> Map<String, Value> {
    let model = match camera.projection {
        Projection::Perspective => "PINHOLE",
        Projection::Orthographic => "ORTHOGRAPHIC",
    };
    let entries = [
        ("camera_model", json!(model)),
        ("fl_x", json!(camera.focal.x)),
        ("fl_y", json!(camera.focal.y)),
        ("cx", json!(camera.centre.x)),
        ("cy", json!(camera.centre.y)),
        ("w", json!(camera.width)),
        ("h", json!(camera.height)),
        ("near", json!(camera.near)),
    ];
    let entries = entries.into_iter().map(|(k, v)| (k.to_owned(), v));
    entries.chain(blur::shared_keys(&camera.blur)).collect()
}

/// The `f64` whose shortest text is that of the `f32`: 0.1 is written as 0.1 and read back to the same `f32`.
fn shortest(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::from(value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_found_from_the_files_folder() {
        let dir = tempfile::tempdir().unwrap();
        let [a, b] = ["a", "a/b"].map(|name| dir.path().join(name));
        std::fs::create_dir_all(&b).unwrap();
        let relative = |picture: &Path, folder: &Path| relative(picture, folder);
        assert_eq!(relative(&a.join("p.exr"), &a), Path::new("p.exr"));
        assert_eq!(relative(&a.join("p.exr"), &b), a.join("p.exr"), "absolute paths stay");
        assert_eq!(relative(Path::new("x/p.exr"), Path::new("")), Path::new("x/p.exr"));
        assert_eq!(relative(Path::new("src/../tests/p.exr"), Path::new("src")), Path::new("../tests/p.exr"));
        assert_eq!(relative(Path::new("p.exr"), Path::new("src/cli")), Path::new("../../p.exr"));
        assert_eq!(relative(Path::new("none/p.exr"), Path::new("src")), Path::new("none/p.exr"), "nowhere");
    }
}
