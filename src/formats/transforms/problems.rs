//! What `info` and `validate` say of a capture.

use super::load::{self, load};
use super::{folder, json_path};
use crate::error::Result;
use crate::formats::exr;
use crate::formats::problem::Problem;
use crate::scene::camera::Projection;
use crate::scene::capture::{Capture, Frame, Model, PixelFilter};
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

/// A capture in figures.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CaptureSummary {
    /// Number of views.
    pub frames: usize,
    /// Number of views of each size, `WxH`.
    pub sizes: BTreeMap<String, usize>,
    /// Number of orthographic views; the others are perspective.
    pub orthographic: usize,
    /// Light model.
    pub model: Model,
    /// Radiance behind the volume.
    pub background: [f32; 3],
    /// What a pixel's value stands for.
    pub pixel_filter: PixelFilter,
    /// Extinction per unit of density and world length.
    pub density_scale: f64,
    /// Smallest corner of the box around the cameras, in world units.
    pub cameras_min: [f64; 3],
    /// Largest corner.
    pub cameras_max: [f64; 3],
}

/// Reads a capture and sums it up.
///
/// # Errors
/// As [`load`](super::load()).
pub fn summary(path: &Path) -> Result<CaptureSummary> {
    let capture = load(path)?;
    let mut sizes = BTreeMap::new();
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for Frame { camera, .. } in &capture.frames {
        *sizes.entry(format!("{}x{}", camera.width, camera.height)).or_default() += 1;
        for (axis, v) in camera.position().to_array().into_iter().enumerate() {
            low[axis] = v.min(low[axis]);
            high[axis] = v.max(high[axis]);
        }
    }
    Ok(CaptureSummary {
        frames: capture.frames.len(),
        sizes,
        orthographic: capture.frames.iter().filter(|f| f.camera.projection == Projection::Orthographic).count(),
        model: capture.model,
        background: capture.background,
        pixel_filter: capture.pixel_filter,
        density_scale: capture.density_scale,
        cameras_min: low,
        cameras_max: high,
    })
}

impl fmt::Display for CaptureSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sizes: Vec<String> = self.sizes.iter().map(|(size, n)| format!("{n} of {size}")).collect();
        writeln!(f, "capture of {} views: {}", self.frames, sizes.join(", "))?;
        writeln!(
            f,
            "cameras between {:?} and {:?}, {} orthographic",
            self.cameras_min, self.cameras_max, self.orthographic
        )?;
        writeln!(f, "model {:?}, background {:?}, pixels {:?}", self.model, self.background, self.pixel_filter)?;
        write!(f, "density scale {}", self.density_scale)
    }
}

/// What is wrong with a capture and its pictures (each is read); empty if nothing is.
pub fn problems(path: &Path) -> Vec<Problem> {
    let json = json_path(path);
    let mut found = frame_problems(&json);
    // Faults of single frames are listed one by one; what else keeps it from loading is one more.
    match load(path) {
        Err(error) if found.is_empty() => found.push(error.into()),
        Err(_) => {}
        Ok(capture) => found.extend(picture_problems(&json, &capture)),
    }
    found
}

/// Frames that cannot be used, all of them rather than the first.
fn frame_problems(json: &Path) -> Vec<Problem> {
    let Ok(root) = load::read_object(json) else { return Vec::new() };
    let Some(Value::Array(frames)) = root.get("frames") else { return Vec::new() };
    let folder = folder(json);
    let fault =
        |(i, frame)| load::frame(frame, &root, &folder).err().map(|e| e.part(format!("frame {i}")).at(json).into());
    frames.iter().enumerate().filter_map(fault).collect()
}

fn picture_problems(json: &Path, capture: &Capture) -> Vec<Problem> {
    let mut found = Vec::new();
    let mut users: BTreeMap<&PathBuf, usize> = BTreeMap::new();
    for (i, frame) in capture.frames.iter().enumerate() {
        let place = format!("{}: frame {i}", json.display());
        if let Some(earlier) = users.insert(&frame.picture, i) {
            found.push(Problem::new(
                format!("{place} has the same picture as frame {earlier}, {}", frame.picture.display()),
                "give each view a picture of its own",
            ));
        }
        let (w, h) = (frame.camera.width as usize, frame.camera.height as usize);
        match exr::picture(&frame.picture, None) {
            Err(error) => {
                let Problem { what, hint } = error.into();
                found.push(Problem::new(format!("{place}: {what}"), hint));
            }
            Ok(p) => {
                if (p.film.width, p.film.height) != (w, h) {
                    found.push(Problem::new(
                        format!(
                            "{place} says {w}x{h}, but {} has {}x{} pixels",
                            frame.picture.display(),
                            p.film.width,
                            p.film.height
                        ),
                        "correct 'w' and 'h' together with 'fl_x', 'fl_y', 'cx' and 'cy', or leave them out",
                    ));
                }
                if p.non_finite > 0 {
                    found.push(Problem::new(
                        format!("{place}: {} has {} NaN or infinite samples", frame.picture.display(), p.non_finite),
                        "render it again",
                    ));
                }
            }
        }
    }
    found
}
