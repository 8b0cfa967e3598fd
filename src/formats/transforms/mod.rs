//! Captures in `transforms.json`, as NeRF tools and Blender add-ons write them.
//!
//! The following keys are read and written, at the top or in each entry of `frames` (which wins):
//! - `transform_matrix` (frames only): camera to world, row by row, camera looking down -Z, +Y up.
//! - `w`, `h`: picture size in pixels; without them it is taken from the picture's header.
//! - `fl_x`, `fl_y`: focal lengths in pixels, or `camera_angle_x`, `camera_angle_y`: full angles of view in radians.
//!   One for either axis suffices: without `fl_y`, pixels are square.
//! - `cx`, `cy`: principal point in pixels from the top left corner; the middle unless given.
//! - `camera_model`: `OPENCV`, `PINHOLE` and their like (the default), `OPENCV_FISHEYE` (or `is_fisheye`), or, as an
//!   extension, `ORTHOGRAPHIC`: then `fl_x` and `fl_y` are pixels per world unit.
//! - `k1`, `k2`, `k3`, `p1`, `p2`, and `k1` to `k4` of a fisheye: coefficients of the [lens](crate::scene::lens::Lens).
//!   Pictures with any are undistorted before they are used. `fisheye_crop_radius` bounds what such pictures hold.
//! - `near`, an extension: distance along the viewing axis to the near plane; 0 unless given.
//! - `aperture_radius`, `focus_distance`, extensions: radius of the aperture and distance along the viewing axis to
//!   what is sharp, in world units; `aperture_blades`, `aperture_rotation` and `aperture_ratio` are those of
//!   [`Aperture`](crate::scene::blur::Aperture).
//! - `transform_matrix_start`, `transform_matrix_end` (frames only): camera to world as the shutter opens and closes.
//! - `shutter_open`, `shutter_close` (frames only): times at which it does, in frames after that of the view, by which
//!   volumes with velocities move.
//! - `file_path`: picture, relative to the file's folder; a name without suffix is that of the EXR, PNG or JPEG there.
//! - `mask_path`: picture that is black where the view is not to be used.
//!
//! Extensions at the top are `background` [r, g, b], `model` (`absorption`, `emission-absorption`, `pre-shaded`),
//! `pixel_filter` (`point`, `box`), `density_scale`, `emission` [r, g, b], `emission_model` (`grey`, `linear`),
//! `transfer` (a [transfer function](crate::scene::transfer::Transfer)), `lattice` (index to world, four rows),
//! `color_space` (`sRGB`, `linear`, `gamma 2.2`) of integer pictures and `pictures` (`renders`, `photographs`). Other
//! keys are ignored, those of well-known programs with a remark.

mod blur;
mod files;
mod keys;
mod load;
mod optics;
mod problems;
mod remarks;
mod save;

pub(crate) use load::read_object;
pub use load::{load, stated_within};
pub(crate) use problems::frame_problems;
pub use save::save;
pub(crate) use save::{check_names, save_for};

use std::path::{Path, PathBuf};

/// Name of the file in a capture's folder.
pub(crate) const FILE_NAME: &str = "transforms.json";

/// Path of the JSON file that `path` names, either itself or as its folder.
pub fn json_path(path: &Path) -> PathBuf {
    if path.is_dir() { path.join(FILE_NAME) } else { path.to_path_buf() }
}

/// Folder that the pictures' paths are relative to.
fn folder(json: &Path) -> PathBuf {
    json.parent().map_or_else(PathBuf::new, Path::to_path_buf)
}
