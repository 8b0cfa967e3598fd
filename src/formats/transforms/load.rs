//! Reading of captures from JSON. Every fault names its frame and key.

use super::{folder, json_path};
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::reading::Reading;
use crate::formats::{exr, input};
use crate::scene::camera::{Camera, Projection};
use crate::scene::capture::{Capture, EmissionModel, Frame, Model, PixelFilter};
use crate::scene::transfer::Transfer;
use glam::{DMat4, DVec2, DVec4};
use serde_json::{Map, Value};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Largest size of a file in bytes; a hundred thousand frames take less.
const MAX_BYTES: u64 = 1 << 26;

/// Advice on where to take a transfer function from.
const TRANSFER: &str =
    "copy the value of 'transfer' from a .tf.json that `cumulo transfer` reads, or leave the key out";
/// Advice on how views are listed.
const FRAMES: &str = "a capture lists its views: {\"frames\": [{\"file_path\": …, \"transform_matrix\": …}]}";

/// Reads a capture from its JSON file or from the folder that holds `transforms.json`. Pictures are not read, except
/// for their headers where the size is not stated.
///
/// # Errors
/// If the file cannot be read, a key is missing or cannot be used, or the values take more than half of the machine's
/// memory. The error names the file, the frame and the key.
pub fn load(path: &Path) -> Result<Capture> {
    load_within(path, Limits::default())
}

/// Reads a capture as [`load`] does; the values of its JSON must fit into `limits`.
///
/// # Errors
/// The conditions are those of [`load`], with these limits.
pub fn load_within(path: &Path, limits: Limits) -> Result<Capture> {
    let json = json_path(path);
    let _reading = Reading::begin(&json);
    parse(&json, limits).map_err(|e| e.at(&json))
}

fn parse(json: &Path, limits: Limits) -> Result<Capture> {
    let root = read_object(json, limits)?;
    let top = Keys { own: &root, shared: None };
    let frames = match root.get("frames") {
        Some(Value::Array(frames)) if !frames.is_empty() => frames,
        Some(Value::Array(_)) => {
            return Err(Error::invalid("'frames' is empty; at least one view is needed").hint(FRAMES));
        }
        Some(other) => {
            return Err(Error::invalid(format!("'frames' is {}; a list is expected", short(other))).hint(FRAMES));
        }
        None if root.contains_key("volumes") => {
            return Err(Error::invalid("no key 'frames': this is a scene file").hint("`cumulo render` renders it"));
        }
        None => return Err(Error::invalid("no key 'frames'").hint(FRAMES)),
    };
    let folder = folder(json);
    let frames = frames
        .iter()
        .enumerate()
        .map(|(i, value)| frame(value, &root, &folder).map_err(|e| e.part(format!("frame {i}"))))
        .collect::<Result<Vec<_>>>()?;
    let positive = |key: &str| match top.number(key)? {
        Some(v) if v <= 0.0 => Err(Error::invalid(format!("'{key}' is {v}; a positive number is expected"))
            .hint(format!("correct '{key}', or leave it out: it is 1 then"))),
        v => Ok(v),
    };
    Ok(Capture {
        frames,
        model: top
            .named("model", &["absorption", "emission-absorption", "pre-shaded", "scattering"])?
            .unwrap_or(Model::Absorption),
        background: top.color("background", "white")?.unwrap_or([1.0; 3]),
        pixel_filter: top.named("pixel_filter", &["point", "box"])?.unwrap_or(PixelFilter::Point),
        density_scale: positive("density_scale")?.unwrap_or(1.0),
        emission: top.color("emission", "white")?.unwrap_or([1.0; 3]),
        emission_model: top.named("emission_model", &["grey", "linear"])?.unwrap_or(EmissionModel::Grey),
        transfer: top.transfer()?,
        lattice: top.matrix("lattice")?,
        color_space: None,
        remarks: Vec::new(),
    })
}

/// Reads a file as a JSON object with any keys.
///
/// # Errors
/// If the file cannot be read, is too large, or holds something else.
pub fn read_object(json: &Path, limits: Limits) -> Result<Map<String, Value>> {
    let text = input::bytes(json, MAX_BYTES, "a list of cameras").map_err(|e| match e.io_kind() {
        Some(ErrorKind::NotFound) => e.hint("a capture is a transforms.json or the folder that holds one"),
        _ => e,
    })?;
    // Windows editors put a byte order mark before the text.
    let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&text);
    input::check_json_memory(text, limits)?;
    match serde_json::from_slice(text) {
        Ok(Value::Object(root)) => Ok(root),
        Ok(other) => Err(Error::invalid(format!("{} is not a JSON object", short(&other))).hint(FRAMES)),
        Err(e) => Err(Error::invalid(format!("no valid JSON: {e}")).hint(input::JSON_REMEDY)),
    }
}

pub(super) fn frame(value: &Value, root: &Map<String, Value>, folder: &Path) -> Result<Frame> {
    let Value::Object(own) = value else {
        return Err(Error::invalid(format!("{} is not a JSON object", short(value)))
            .hint("a view is {\"file_path\": …, \"transform_matrix\": …}"));
    };
    let keys = Keys { own, shared: Some(root) };
    let picture = picture_path(own, folder)?;
    let camera_to_world = (Keys { own, shared: None })
        .matrix("transform_matrix")?
        .ok_or_else(|| missing("transform_matrix", "the camera-to-world matrix, four rows of four numbers"))?;
    let projection = projection(&keys)?;
    let (width, height) = match (keys.size("w")?, keys.size("h")?) {
        (Some(w), Some(h)) => (w, h),
        (w, h) => {
            let header = exr::header(&picture).map_err(|e| {
                let picture = picture.display();
                Error::invalid(format!("'w' and 'h' are not both given, and {picture} cannot say: {}", e.what()))
                    .hint("give both in pixels, or add the picture")
            })?;
            let [pw, ph] = header.display_window.size;
            (w.unwrap_or(pw as u32), h.unwrap_or(ph as u32))
        }
    };
    let camera = Camera {
        camera_to_world,
        projection,
        focal: focal(&keys, projection, f64::from(width), f64::from(height))?,
        centre: DVec2::new(
            keys.number("cx")?.unwrap_or(0.5 * f64::from(width)),
            keys.number("cy")?.unwrap_or(0.5 * f64::from(height)),
        ),
        width,
        height,
        near: keys.number("near")?.unwrap_or(0.0),
    };
    let camera = rigid(camera).map_err(|e| {
        e.hint("correct 'transform_matrix' (a rotation and a position), 'fl_x', 'fl_y', 'cx', 'cy' and 'near' of this view")
    })?;
    Ok(Frame { camera, picture })
}

/// Checks a camera. A matrix whose columns are of unit length already is kept to the last bit, so that reading returns
/// exactly what was written; others are normalised.
fn rigid(camera: Camera) -> Result<Camera> {
    let m = camera.camera_to_world;
    let checked = camera.checked()?;
    let unit = |c: DVec4| (c.truncate().length_squared() - 1.0).abs() < 8.0 * f64::EPSILON;
    let keep = [m.x_axis, m.y_axis, m.z_axis].into_iter().all(unit);
    Ok(if keep { Camera { camera_to_world: m, ..checked } } else { checked })
}

/// Path of a frame's picture, from its `file_path`.
pub(super) fn picture_path(own: &Map<String, Value>, folder: &Path) -> Result<PathBuf> {
    let name = match own.get("file_path") {
        Some(Value::String(name)) if !name.is_empty() => name,
        Some(other) => {
            return Err(Error::invalid(format!("'file_path' is {}; a text is expected", short(other)))
                .hint("'file_path' is the picture's path, relative to this file"));
        }
        None => return Err(missing("file_path", "the picture's path, relative to this file")),
    };
    let path = folder.join(name);
    // "view.0001" has no suffix of a picture, but Path would take ".0001" for one.
    let suffix = path.extension().is_some_and(|e| e.to_string_lossy().chars().any(|c| c.is_ascii_alphabetic()));
    Ok(if suffix { path } else { folder.join(format!("{name}.exr")) })
}

fn missing(key: &str, what: &str) -> Error {
    Error::invalid(format!("no key '{key}'")).hint(format!("'{key}' is {what}"))
}

fn projection(keys: &Keys) -> Result<Projection> {
    let projection = match keys.get("camera_model") {
        None => Projection::Perspective,
        Some(Value::String(s)) if matches!(s.as_str(), "OPENCV" | "PINHOLE" | "SIMPLE_PINHOLE" | "PERSPECTIVE") => {
            Projection::Perspective
        }
        Some(Value::String(s)) if s == "ORTHOGRAPHIC" => Projection::Orthographic,
        Some(other) => {
            return Err(Error::unsupported(format!(
                "'camera_model' is {other}; OPENCV, PINHOLE or ORTHOGRAPHIC is expected"
            ))
            .hint("undistort the pictures to a pinhole camera first, e.g. with `colmap image_undistorter`"));
        }
    };
    for key in ["k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"] {
        if let Some(v) = keys.number(key)?.filter(|v| *v != 0.0) {
            return Err(Error::unsupported(format!("lens distortion ('{key}' is {v})"))
                .hint("undistort the pictures first, e.g. with `colmap image_undistorter`, and set it to 0"));
        }
    }
    Ok(projection)
}

fn focal(keys: &Keys, projection: Projection, width: f64, height: f64) -> Result<DVec2> {
    let axis = |length: &str, angle: &str, pixels: f64| -> Result<Option<f64>> {
        // A frame's own angle takes precedence over a length that was given for all frames.
        let own_angle = keys.own.get(angle).is_some_and(|v| !v.is_null()) && !keys.own.contains_key(length);
        if let Some(v) = keys.number(length)?.filter(|_| !own_angle) {
            return Ok(Some(v));
        }
        match keys.number(angle)? {
            None => Ok(None),
            Some(_) if projection == Projection::Orthographic => {
                Err(Error::invalid(format!("'{angle}' has no meaning for an orthographic camera"))
                    .hint(format!("give '{length}' in pixels per world unit")))
            }
            Some(v) if v > 0.0 && v < std::f64::consts::PI => Ok(Some(0.5 * pixels / (0.5 * v).tan())),
            Some(v) => Err(Error::invalid(format!("'{angle}' is {v}; an angle between 0 and pi is expected"))
                .hint("give the full angle of view in radians, not in degrees")),
        }
    };
    let (x, y) = (axis("fl_x", "camera_angle_x", width)?, axis("fl_y", "camera_angle_y", height)?);
    match (x, y) {
        (Some(x), Some(y)) => Ok(DVec2::new(x, y)),
        (Some(f), None) | (None, Some(f)) => Ok(DVec2::splat(f)),
        (None, None) => Err(missing("fl_x", "the focal length in pixels; 'camera_angle_x' in radians does as well")),
    }
}

/// Keys of a frame, which take precedence over those of the whole file.
struct Keys<'a> {
    own: &'a Map<String, Value>,
    shared: Option<&'a Map<String, Value>>,
}

impl Keys<'_> {
    /// Value of a key; `null` counts as absent.
    fn get(&self, key: &str) -> Option<&Value> {
        let set = |v: &&Value| !v.is_null();
        self.own.get(key).filter(set).or_else(|| self.shared?.get(key).filter(set))
    }

    fn number(&self, key: &str) -> Result<Option<f64>> {
        match self.get(key) {
            None => Ok(None),
            Some(v) => v.as_f64().filter(|n| n.is_finite()).map(Some).ok_or_else(|| {
                Error::invalid(format!("'{key}' is {}; a number is expected", short(v)))
                    .hint(format!("write '{key}' as a finite number without quotes, or leave it out"))
            }),
        }
    }

    /// A picture's size in pixels, which may be written as 800.0.
    fn size(&self, key: &str) -> Result<Option<u32>> {
        match self.number(key)? {
            None => Ok(None),
            Some(v) if (1.0..=65_536.0).contains(&v) && v.fract() == 0.0 => Ok(Some(v as u32)),
            Some(v) => Err(Error::invalid(format!("'{key}' is {v}; a whole number from 1 to 65536 is expected"))
                .hint("give the picture's size in pixels, or leave it out: the picture's header is asked then")),
        }
    }

    fn color(&self, key: &str, unless_given: &str) -> Result<Option<[f32; 3]>> {
        let Some(value) = self.get(key) else { return Ok(None) };
        let numbers: Option<Vec<f32>> = value.as_array().and_then(|list| {
            list.iter().map(|v| v.as_f64().map(|n| n as f32).filter(|n| n.is_finite() && *n >= 0.0)).collect()
        });
        numbers.and_then(|n| <[f32; 3]>::try_from(n).ok()).map(Some).ok_or_else(|| {
            Error::invalid(format!("'{key}' is {}; three numbers from 0 on are expected", short(value)))
                .hint(format!("write scene-linear red, green and blue, or leave it out: it is {unless_given} then"))
        })
    }

    fn matrix(&self, key: &str) -> Result<Option<DMat4>> {
        let Some(value) = self.get(key) else { return Ok(None) };
        let rows: Option<Vec<[f64; 4]>> = value.as_array().and_then(|rows| {
            rows.iter()
                .map(|row| {
                    let numbers: Option<Vec<f64>> = row.as_array()?.iter().map(Value::as_f64).collect();
                    <[f64; 4]>::try_from(numbers?).ok()
                })
                .collect()
        });
        let rows = rows.filter(|r| r.len() == 4 || r.len() == 3);
        let Some(rows) = rows else {
            return Err(Error::invalid(format!("'{key}' is {}; four rows of four numbers are expected", short(value)))
                .hint("write an affine map row by row; its last row is 0, 0, 0, 1"));
        };
        let last = rows.get(3).copied().unwrap_or([0.0, 0.0, 0.0, 1.0]);
        Ok(Some(DMat4::from_cols_array_2d(&[rows[0], rows[1], rows[2], last]).transpose()))
    }

    fn transfer(&self) -> Result<Option<Transfer>> {
        let Some(value) = self.get("transfer") else { return Ok(None) };
        let transfer: Transfer = serde_json::from_value(value.clone())
            .map_err(|e| Error::invalid(format!("'transfer' is no transfer function: {e}")).hint(TRANSFER))?;
        transfer.checked().map(Some).map_err(|e| e.part("'transfer'").hint(TRANSFER))
    }

    fn named<T: serde::de::DeserializeOwned>(&self, key: &str, names: &[&str]) -> Result<Option<T>> {
        let Some(value) = self.get(key) else { return Ok(None) };
        serde_json::from_value(value.clone()).map(Some).map_err(|_| {
            Error::invalid(format!("'{key}' is {}; {} is expected", short(value), names.join(" or ")))
                .hint(format!("correct '{key}', or leave it out: it is {} then", names[0]))
        })
    }
}

/// Text of a value, shortened for an error message.
fn short(value: &Value) -> String {
    let text = value.to_string();
    if text.chars().count() <= 60 { text } else { text.chars().take(57).chain("...".chars()).collect() }
}
