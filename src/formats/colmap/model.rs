//! COLMAP's camera models.

use crate::error::{Error, Result};
use crate::scene::blur::Blur;
use crate::scene::camera::{Camera, Projection};
use crate::scene::lens::Lens;
use glam::{DMat4, DVec2};

/// A camera model by its number in binary files, its name in text files and the number of its parameters. Models that
/// are not understood are listed for their names.
struct Entry {
    id: i32,
    name: &'static str,
    parameters: usize,
}

const MODELS: [Entry; 12] = [
    Entry { id: 0, name: "SIMPLE_PINHOLE", parameters: 3 },
    Entry { id: 1, name: "PINHOLE", parameters: 4 },
    Entry { id: 2, name: "SIMPLE_RADIAL", parameters: 4 },
    Entry { id: 3, name: "RADIAL", parameters: 5 },
    Entry { id: 4, name: "OPENCV", parameters: 8 },
    Entry { id: 5, name: "OPENCV_FISHEYE", parameters: 8 },
    Entry { id: 6, name: "FULL_OPENCV", parameters: 12 },
    Entry { id: 7, name: "FOV", parameters: 5 },
    Entry { id: 8, name: "SIMPLE_RADIAL_FISHEYE", parameters: 4 },
    Entry { id: 9, name: "RADIAL_FISHEYE", parameters: 5 },
    Entry { id: 10, name: "THIN_PRISM_FISHEYE", parameters: 12 },
    Entry { id: 11, name: "RAD_TAN_THIN_PRISM_FISHEYE", parameters: 16 },
];

/// Name of a model and the number of its parameters.
pub(super) type Named = (&'static str, usize);

/// Returns the model of a number.
///
/// # Errors
/// If there is none.
pub(super) fn by_id(id: i32) -> Result<Named> {
    let entry = MODELS.iter().find(|m| m.id == id);
    entry.map(|m| (m.name, m.parameters)).ok_or_else(|| unknown(&format!("number {id}")))
}

/// Returns the model of a name.
///
/// # Errors
/// If there is none.
pub(super) fn by_name(name: &str) -> Result<Named> {
    let entry = MODELS.iter().find(|m| m.name == name);
    entry.map(|m| (m.name, m.parameters)).ok_or_else(|| unknown(&format!("'{name}'")))
}

fn unknown(what: &str) -> Error {
    Error::unsupported(format!(
        "camera model {what}; SIMPLE_PINHOLE to FULL_OPENCV and the radial fisheyes are understood"
    ))
    .hint("undistort the pictures with `colmap image_undistorter`, and convert its model")
}

/// Intrinsic parameters of a camera.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Calibration {
    /// Width and height in pixels.
    size: [u32; 2],
    focal: DVec2,
    centre: DVec2,
    /// Lens distortion.
    pub lens: Lens,
}

impl Calibration {
    /// Interprets the parameters of a model.
    ///
    /// # Errors
    /// If the size or a parameter cannot be used, or the model is not understood.
    pub(crate) fn new(model: &str, size: [u64; 2], parameters: &[f64]) -> Result<Self> {
        if size.iter().any(|side| !(1..=65_536).contains(side)) {
            return Err(Error::invalid(format!(
                "a picture of {}x{}; 1 to 65536 pixels are expected",
                size[0], size[1]
            ))
            .hint("the file is damaged: export the model again"));
        }
        if parameters.iter().any(|p| !p.is_finite()) {
            return Err(Error::invalid("a parameter of the camera is not finite").hint(
                "the calibration has failed: run COLMAP again, with shared intrinsics or a simpler camera model",
            ));
        }
        let fisheye = |radial: [f64; 4]| Lens::Fisheye { radial };
        let (focal, centre, lens) = match (model, parameters) {
            ("SIMPLE_PINHOLE", &[f, cx, cy]) => ([f, f], [cx, cy], Lens::Pinhole),
            ("PINHOLE", &[fx, fy, cx, cy]) => ([fx, fy], [cx, cy], Lens::Pinhole),
            ("SIMPLE_RADIAL", &[f, cx, cy, k]) => {
                ([f, f], [cx, cy], Lens::brown([k, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0; 2]))
            }
            ("RADIAL", &[f, cx, cy, k1, k2]) => ([f, f], [cx, cy], Lens::brown([k1, k2, 0.0, 0.0, 0.0, 0.0], [0.0; 2])),
            ("OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2]) => {
                ([fx, fy], [cx, cy], Lens::brown([k1, k2, 0.0, 0.0, 0.0, 0.0], [p1, p2]))
            }
            ("FULL_OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6]) => {
                ([fx, fy], [cx, cy], Lens::brown([k1, k2, k3, k4, k5, k6], [p1, p2]))
            }
            ("OPENCV_FISHEYE", &[fx, fy, cx, cy, k1, k2, k3, k4]) => ([fx, fy], [cx, cy], fisheye([k1, k2, k3, k4])),
            ("SIMPLE_RADIAL_FISHEYE", &[f, cx, cy, k]) => ([f, f], [cx, cy], fisheye([k, 0.0, 0.0, 0.0])),
            ("RADIAL_FISHEYE", &[f, cx, cy, k1, k2]) => ([f, f], [cx, cy], fisheye([k1, k2, 0.0, 0.0])),
            (model, _) => return Err(unknown(&format!("'{model}' with {} parameters", parameters.len()))),
        };
        let [focal, centre] = [focal, centre].map(DVec2::from_array);
        Ok(Self { size: size.map(|side| side as u32), focal, centre, lens })
    }

    /// Returns the pinhole camera at a pose.
    ///
    /// # Errors
    /// If the focal lengths are not positive, or the pose is no rigid motion.
    pub(crate) fn camera(&self, camera_to_world: DMat4) -> Result<Camera> {
        let [width, height] = self.size;
        Camera {
            camera_to_world,
            projection: Projection::Perspective,
            focal: self.focal,
            centre: self.centre,
            width,
            height,
            near: 0.0,
            blur: Blur::default(),
        }
        .checked()
        .map_err(|e| e.hint("the calibration has failed: run COLMAP again"))
    }
}
