//! Reading of captures from JSON. Every fault names its frame and key.

use super::blur::blur;
use super::keys::{Keys, missing, short};
use super::optics::{focal, projection_and_lens};
use super::remarks::remarks;
use super::{files, folder, json_path};
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::reading::Reading;
use crate::formats::views::{LensAndMask, StatedCapture};
use crate::formats::{input, picture};
use crate::scene::blur::{Blur, Shutter};
use crate::scene::camera::Camera;
use crate::scene::capture::{Capture, EmissionModel, Frame, Model, PixelFilter};
use crate::scene::lens::Lens;
use glam::{DMat4, DVec2, DVec4};
use serde_json::{Map, Value};
use std::io::ErrorKind;
use std::path::Path;

/// Largest size of a file in bytes; a hundred thousand frames take less.
const MAX_BYTES: u64 = 1 << 26;

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
/// The conditions are those of [`load`], with these limits; pictures that a lens distorts or a mask covers are refused.
pub(crate) fn load_within(path: &Path, limits: Limits) -> Result<Capture> {
    stated_within(path, limits)?.direct().map_err(|e| e.at(json_path(path)))
}

/// Reads a capture as `load_within` does, with the lenses and masks of its views.
///
/// # Errors
/// The conditions are those of [`load`], with these limits.
pub fn stated_within(path: &Path, limits: Limits) -> Result<StatedCapture> {
    let json = json_path(path);
    let _reading = Reading::begin(&json);
    parse(&json, limits).map_err(|e| e.at(&json))
}

fn parse(json: &Path, limits: Limits) -> Result<StatedCapture> {
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
    let view = |(i, value)| frame(value, &root, &folder).map_err(|e: Error| e.part(format!("frame {i}")));
    let views = frames.iter().enumerate().map(view).collect::<Result<Vec<_>>>()?;
    let (frames, optics) = views.into_iter().unzip();
    let positive = |key: &str| match top.number(key)? {
        Some(v) if v <= 0.0 => Err(Error::invalid(format!("'{key}' is {v}; a positive number is expected"))
            .hint(format!("correct '{key}', or leave it out: it is 1 then"))),
        v => Ok(v),
    };
    let capture = Capture {
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
        color_space: top.color_space()?,
        pictures: top.named("pictures", &["renders", "photographs"])?,
        remarks: remarks(&root),
    };
    Ok(StatedCapture { capture, optics })
}

/// Reads a file as a JSON object with any keys.
///
/// # Errors
/// If the file cannot be read, is too large, or holds something else.
pub(crate) fn read_object(json: &Path, limits: Limits) -> Result<Map<String, Value>> {
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

pub(super) fn frame(value: &Value, root: &Map<String, Value>, folder: &Path) -> Result<(Frame, LensAndMask)> {
    let Value::Object(own) = value else {
        return Err(Error::invalid(format!("{} is not a JSON object", short(value)))
            .hint("a view is {\"file_path\": …, \"transform_matrix\": …}"));
    };
    let keys = Keys { own, shared: Some(root) };
    let picture = files::picture(own, folder)?;
    let camera_to_world = (Keys { own, shared: None })
        .matrix("transform_matrix")?
        .ok_or_else(|| missing("transform_matrix", "the camera-to-world matrix, four rows of four numbers"))?;
    let (projection, lens) = projection_and_lens(&keys)?;
    let (width, height) = match (keys.size("w")?, keys.size("h")?) {
        (Some(w), Some(h)) => (w, h),
        (w, h) => {
            let header = picture::header(&picture).map_err(|e| {
                let picture = picture.display();
                Error::invalid(format!("'w' and 'h' are not both given, and {picture} cannot say: {}", e.what()))
                    .hint("give both in pixels, or add the picture")
            })?;
            let [pw, ph] = header.size;
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
        blur: blur(&keys)?,
    };
    let camera = rigid(camera).map_err(|e| {
        e.hint(
            "correct 'transform_matrix' (a rotation and a position), 'fl_x', 'fl_y', 'cx', 'cy' and 'near' of this \
                view, its 'aperture_radius' and 'focus_distance'",
        )
    })?;
    let crop_radius = keys.number("fisheye_crop_radius")?.filter(|_| lens != Lens::Pinhole);
    Ok((Frame { camera, picture }, LensAndMask { lens, crop_radius, mask: files::mask(own, folder)? }))
}

/// Checks a camera. A matrix whose columns are of unit length already is kept to the last bit, so that reading returns
/// exactly what was written; others are normalised.
fn rigid(camera: Camera) -> Result<Camera> {
    let checked = camera.checked()?;
    let unit = |c: DVec4| (c.truncate().length_squared() - 1.0).abs() < 8.0 * f64::EPSILON;
    let kept = |stated: DMat4, checked: DMat4| {
        let keep = [stated.x_axis, stated.y_axis, stated.z_axis].into_iter().all(unit);
        if keep { stated } else { checked }
    };
    let ends = camera.blur.shutter.zip(checked.blur.shutter);
    let shutter = ends.map(|(stated, checked)| Shutter {
        start: kept(stated.start, checked.start),
        end: kept(stated.end, checked.end),
        open: stated.open,
    });
    Ok(Camera {
        camera_to_world: kept(camera.camera_to_world, checked.camera_to_world),
        blur: Blur { shutter, ..checked.blur },
        ..checked
    })
}
