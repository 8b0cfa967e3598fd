//! COLMAP's sparse models, text and binary: `cameras`, `images` and `points3D`, of which the points are not used.
//!
//! Formats as on <https://colmap.github.io/format.html>. COLMAP's cameras look along +Z with +Y down, and its poses map
//! world to camera; the centre of the first pixel lies at (0.5, 0.5), as here.

mod binary;
mod model;
mod pictures;
mod save;
mod text;

pub use save::save;

use crate::error::{Error, Result};
use crate::formats::input;
use crate::formats::limits::Limits;
use crate::formats::reading::Reading;
use crate::formats::views::{LensAndMask, StatedCapture};
use crate::scene::camera::Camera;
use crate::scene::capture::{Capture, Frame};
use glam::{DMat3, DMat4, DQuat, DVec3};
use model::Calibration;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Folders of a dataset, in the order in which they are searched for a model.
const PLACES: [&str; 5] = ["", "sparse/0", "sparse", "colmap/sparse/0", "0"];

/// A registered image: its pose and its camera.
#[derive(Debug, Clone, PartialEq)]
struct Image {
    /// Rotation from world to camera.
    rotation: DQuat,
    /// Translation from world to camera.
    translation: DVec3,
    /// Identifier of the camera.
    camera: u32,
    /// Path of the picture, relative to the folder of all pictures.
    name: String,
}

/// Cameras by identifier, and images in file order.
type Parsed = (BTreeMap<u32, Calibration>, Vec<Image>);

/// Returns true if a file's name is one of a model.
pub(crate) fn is_model_file(path: &Path) -> bool {
    let stem = path.file_stem().and_then(|s| s.to_str());
    let suffix = path.extension().and_then(|s| s.to_str());
    matches!((stem, suffix), (Some("cameras" | "images" | "points3D"), Some("txt" | "bin")))
}

/// Returns the file of the images of the model that a path names: one of its files, its folder, or the folder of the
/// dataset. `None` if there is no model.
pub fn find(path: &Path) -> Option<PathBuf> {
    let folders: Vec<PathBuf> = if path.is_dir() {
        PLACES.iter().map(|place| if place.is_empty() { path.to_path_buf() } else { path.join(place) }).collect()
    } else if is_model_file(path) {
        vec![path.parent().unwrap_or(Path::new("")).to_path_buf()]
    } else {
        return None;
    };
    let asked = path.extension().and_then(|s| s.to_str()).filter(|_| !path.is_dir());
    let suffixes = if asked == Some("txt") { ["txt", "bin"] } else { ["bin", "txt"] };
    let candidates = folders.iter().flat_map(|folder| {
        let pair = move |suffix: &str| ["images", "cameras"].map(|stem| folder.join(format!("{stem}.{suffix}")));
        suffixes.into_iter().map(pair)
    });
    let mut whole = candidates.filter(|pair| pair.iter().all(|file| file.is_file()));
    whole.next().map(|[images, _]| images)
}

/// Reads the model whose images lie in the file `images`, which [`find`] returns. Pictures are searched for beside the
/// model and in a folder `images` there or up to three folders above it.
///
/// # Errors
/// If a file cannot be read, is damaged, has a camera of a model that is not known here, or its images do not fit into
/// `limits`.
pub(crate) fn load_within(images: &Path, limits: Limits) -> Result<StatedCapture> {
    let _reading = Reading::begin(images);
    let binary = images.extension().is_some_and(|suffix| suffix == "bin");
    let cameras = images.with_file_name(if binary { "cameras.bin" } else { "cameras.txt" });
    let (calibrations, images_found) = if binary {
        (
            binary::cameras(input::open(&cameras)?, limits).map_err(|e| e.at(&cameras))?,
            binary::images(input::open(images)?, limits).map_err(|e| e.at(images))?,
        )
    } else {
        (
            text::cameras(input::open(&cameras)?, limits).map_err(|e| e.at(&cameras))?,
            text::images(input::open(images)?, limits).map_err(|e| e.at(images))?,
        )
    };
    capture((calibrations, images_found), images).map_err(|e| e.at(images))
}

/// Converts a model to a capture, its images sorted by name.
fn capture((calibrations, mut images): Parsed, file: &Path) -> Result<StatedCapture> {
    if images.is_empty() {
        return Err(Error::invalid("the model has no registered image").hint("run COLMAP's mapper again"));
    }
    images.sort_by(|a, b| a.name.cmp(&b.name));
    let folder = pictures::folder(file.parent().unwrap_or(Path::new("")), &images[0].name);
    let view = |image: &Image| {
        let named = |e: Error| e.part(format!("image '{}'", image.name));
        let calibration = calibrations.get(&image.camera).ok_or_else(|| {
            Error::invalid(format!("camera {} is not among the cameras", image.camera))
                .hint("cameras and images are of different models: export both again")
        });
        let calibration = calibration.map_err(named)?;
        let camera = calibration.camera(camera_to_world(image).map_err(named)?).map_err(named)?;
        let picture = pictures::find(&folder, &image.name);
        Ok((Frame { camera, picture }, LensAndMask { lens: calibration.lens, ..LensAndMask::default() }))
    };
    let views = images.iter().map(view).collect::<Result<Vec<_>>>()?;
    let (frames, optics) = views.into_iter().unzip();
    let capture = Capture {
        remarks: vec![
            "'points3D' has no effect: cameras and colors tell the volume".into(),
            "COLMAP states neither light model nor background: those of an absorber before white are taken".into(),
        ],
        ..Capture::of_frames(frames)
    };
    Ok(StatedCapture { capture, optics })
}

/// Returns the motion from camera to world, with the camera's axes turned from COLMAP's (+Y down, looking along +Z).
fn camera_to_world(image: &Image) -> Result<DMat4> {
    let length = image.rotation.length();
    if !(image.translation.is_finite() && (1e-6..1e6).contains(&length)) {
        return Err(Error::invalid(format!(
            "pose {} {} cannot be used; a quaternion of length 1 and a finite translation are expected",
            image.rotation, image.translation
        ))
        .hint("export the model again"));
    }
    let to_camera = DMat3::from_quat(image.rotation.normalize());
    let axes = to_camera.transpose();
    let position = -(axes * image.translation);
    Ok(DMat4::from_mat3_translation(axes * DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)), position))
}

/// Returns the rotation and translation from world to COLMAP's camera.
fn world_to_camera(camera: &Camera) -> (DQuat, DVec3) {
    let axes = DMat3::from_mat4(camera.camera_to_world) * DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
    let to_camera = axes.transpose();
    (DQuat::from_mat3(&to_camera).normalize(), -(to_camera * camera.position()))
}
