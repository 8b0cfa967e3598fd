//! From a capture to JSON.

use super::folder;
use crate::error::{Error, Result};
use crate::formats::atomic;
use crate::scene::camera::{Camera, Projection};
use crate::scene::capture::Capture;
use glam::DMat4;
use serde_json::{Map, Value, json};
use std::path::Path;

/// Writes a capture to the JSON file `path` (not its pictures). Numbers are written so that
/// [`load`](super::load) gives back the same bits. What all views share is written once. `extra` adds keys at the
/// top, such as provenance; none may be one that a capture uses.
///
/// # Errors
/// If a picture's path is not valid Unicode, a key of `extra` is taken, or the file cannot be written.
pub fn save(path: &Path, capture: &Capture, extra: &Map<String, Value>) -> Result<()> {
    let text = text(path, capture, extra).map_err(|e| e.at(path))?;
    atomic::write(path, |p| std::fs::write(p, text).map_err(|e| Error::io(path, e)))
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
            let relative = frame.picture.strip_prefix(&folder).unwrap_or(&frame.picture);
            let name = relative.to_str().ok_or_else(|| {
                Error::invalid(format!("picture path {} is not Unicode", relative.display())).part(format!("frame {i}"))
            })?;
            let mut own = Map::new();
            own.insert("file_path".into(), json!(name));
            own.insert("transform_matrix".into(), rows(frame.camera.camera_to_world));
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
    root.insert("frames".into(), Value::Array(frames));
    for (key, value) in extra {
        if root.insert(key.clone(), value.clone()).is_some() {
            return Err(Error::invalid(format!("key '{key}' is one of the capture's own")));
        }
    }
    let mut text = serde_json::to_string_pretty(&Value::Object(root)).map_err(|e| Error::invalid(e.to_string()))?;
    text.push('\n');
    Ok(text)
}

/// All that a camera is, but its place.
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
    entries.into_iter().map(|(k, v)| (k.to_owned(), v)).collect()
}

/// The `f64` whose shortest text is that of the `f32`: 0.1 is written as 0.1 and read back to the same `f32`.
fn shortest(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::from(value))
}

fn rows(m: DMat4) -> Value {
    let rows = [0, 1, 2, 3].map(|i| m.row(i).to_array());
    json!(rows)
}
