//! Projection, focal lengths and lens of a view.

use super::keys::{Keys, missing, short};
use crate::error::{Error, Result};
use crate::scene::camera::Projection;
use crate::scene::lens::Lens;
use glam::DVec2;
use serde_json::Value;

/// Returns the projection and the lens of a view. Coefficients are those of OpenCV.
///
/// # Errors
/// If the camera model is unknown, or a coefficient has no meaning, or more than one, in it.
pub(super) fn projection_and_lens(keys: &Keys) -> Result<(Projection, Lens)> {
    let named = match keys.get("camera_model") {
        None => None,
        Some(Value::String(name)) => Some(name.as_str()),
        Some(other) => return Err(unknown(&short(other))),
    };
    // instant-ngp has a switch instead of a model.
    let fisheye = keys.is_set("is_fisheye")?;
    let (projection, fisheye) = match named {
        None | Some("OPENCV" | "PERSPECTIVE") => (Projection::Perspective, fisheye),
        Some("PINHOLE" | "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL") => (Projection::Perspective, false),
        Some("OPENCV_FISHEYE") => (Projection::Perspective, true),
        Some("ORTHOGRAPHIC") => (Projection::Orthographic, false),
        Some(other) => return Err(unknown(other)),
    };
    refuse_others(keys)?;
    let number = |key: &str| Ok::<_, Error>(keys.number(key)?.unwrap_or(0.0));
    let [k1, k2, k3, k4] = [number("k1")?, number("k2")?, number("k3")?, number("k4")?];
    let [k5, k6, p1, p2] = [number("k5")?, number("k6")?, number("p1")?, number("p2")?];
    let (lens, unused) = if fisheye {
        (Lens::Fisheye { radial: [k1, k2, k3, k4] }, [("k5", k5), ("k6", k6), ("p1", p1), ("p2", p2)])
    } else {
        // OpenCV's k4 is the first of the denominator, nerfstudio's is the fourth of a polynomial.
        let lens = Lens::brown([k1, k2, k3, 0.0, 0.0, 0.0], [p1, p2]);
        (lens, [("k4", k4), ("k5", k5), ("k6", k6), ("k4", 0.0)])
    };
    if let Some((key, value)) = unused.into_iter().find(|(_, value)| *value != 0.0) {
        let model = if fisheye { "a fisheye" } else { "an OPENCV camera" };
        return Err(Error::unsupported(format!("'{key}' is {value}, which programs take differently for {model}"))
            .hint("calibrate with k1, k2, k3, p1, p2 (or k1 to k4 for OPENCV_FISHEYE), or read a COLMAP model"));
    }
    Ok((projection, lens.checked()?))
}

fn unknown(name: &str) -> Error {
    Error::unsupported(format!(
        "'camera_model' is {name}; OPENCV, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV_FISHEYE or ORTHOGRAPHIC is expected"
    ))
    .hint("undistort the pictures to a pinhole camera first, e.g. with `colmap image_undistorter`")
}

/// Refuses what moves or bends rays in a way that no camera here does.
fn refuse_others(keys: &Keys) -> Result<()> {
    let zero = |value: &Value| match value {
        Value::Array(list) => list.iter().all(|v| v.as_f64() == Some(0.0)),
        other => other.as_f64() == Some(0.0) || other.as_bool() == Some(false),
    };
    for (key, what) in [
        ("rolling_shutter", "a rolling shutter"),
        ("ftheta_p0", "an f-theta lens"),
        ("latlong", "an equirectangular camera"),
        ("from_na", "cameras in other axes ('from_na')"),
    ] {
        if keys.get(key).is_some_and(|value| !zero(value)) {
            return Err(Error::unsupported(format!("'{key}' states {what}, which is not understood"))
                .hint("convert the pictures or cameras where they were made, then leave the key out"));
        }
    }
    Ok(())
}

/// Returns the focal lengths along x and y, from lengths in pixels or angles.
///
/// # Errors
/// If there is none, or it cannot be used.
pub(super) fn focal(keys: &Keys, projection: Projection, width: f64, height: f64) -> Result<DVec2> {
    let axis = |length: &str, angles: [&str; 2], pixels: f64| -> Result<Option<f64>> {
        // A frame's own angle takes precedence over a length that was given for all frames.
        let own = |key: &str| keys.own.get(key).is_some_and(|v| !v.is_null());
        let own_angle = angles.into_iter().any(own) && !keys.own.contains_key(length);
        if let Some(v) = keys.number(length)?.filter(|_| !own_angle) {
            return Ok(Some(v));
        }
        let [radians, degrees] = angles;
        let (angle, value) = match (keys.number(radians)?, keys.number(degrees)?) {
            (Some(value), _) => (radians, value),
            (None, Some(value)) => (degrees, value.to_radians()),
            (None, None) => return Ok(None),
        };
        if projection == Projection::Orthographic {
            return Err(Error::invalid(format!("'{angle}' has no meaning for an orthographic camera"))
                .hint(format!("give '{length}' in pixels per world unit")));
        }
        if value > 0.0 && value < std::f64::consts::PI {
            return Ok(Some(0.5 * pixels / (0.5 * value).tan()));
        }
        Err(Error::invalid(format!("'{angle}' is {value} radians; an angle between 0 and pi is expected"))
            .hint("give the full angle of view: in radians as 'camera_angle_x', or in degrees as 'x_fov'"))
    };
    let x = axis("fl_x", ["camera_angle_x", "x_fov"], width)?;
    let y = axis("fl_y", ["camera_angle_y", "y_fov"], height)?;
    match (x, y) {
        (Some(x), Some(y)) => Ok(DVec2::new(x, y)),
        (Some(f), None) | (None, Some(f)) => Ok(DVec2::splat(f)),
        (None, None) => Err(missing("fl_x", "the focal length in pixels; 'camera_angle_x' in radians does as well")),
    }
}
