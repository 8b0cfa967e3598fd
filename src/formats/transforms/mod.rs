//! Captures in `transforms.json`, as NeRF tools and Blender add-ons write them.
//!
//! The following keys are read and written, at the top or in each entry of `frames` (which wins):
//! - `transform_matrix` (frames only): camera to world, row by row, camera looking down -Z, +Y up.
//! - `w`, `h`: picture size in pixels; without them it is taken from the picture's header.
//! - `fl_x`, `fl_y`: focal lengths in pixels, or `camera_angle_x`, `camera_angle_y`: full angles of view in radians.
//!   One for either axis suffices: without `fl_y`, pixels are square.
//! - `cx`, `cy`: principal point in pixels from the top left corner; the middle unless given.
//! - `camera_model`: `OPENCV` and `PINHOLE` (both without distortion; the default), or, as an extension,
//!   `ORTHOGRAPHIC`: then `fl_x` and `fl_y` are pixels per world unit.
//! - `near`, an extension: distance along the viewing axis to the near plane; 0 unless given.
//! - `file_path`: picture, relative to the file's folder; `.exr` is appended where there is no suffix.
//!
//! Extensions at the top are `background` [r, g, b], `model` (`absorption`, `emission-absorption`, `pre-shaded`),
//! `pixel_filter` (`point`, `box`), `density_scale`, `emission` [r, g, b], `emission_model` (`grey`, `linear`),
//! `transfer` (a [transfer function](crate::scene::transfer::Transfer)) and `lattice` (index to world, four rows).
//! Other keys are ignored.

mod load;
mod problems;
mod save;
mod summary;

pub use load::{load, load_within, read_object};
pub use problems::{problems, problems_within};
pub use save::{check_names, save, save_for};
pub use summary::{CaptureSummary, summary, summary_within};

use std::path::{Path, PathBuf};

/// Name of the file in a capture's folder.
pub const FILE_NAME: &str = "transforms.json";

/// Path of the JSON file that `path` names, either itself or as its folder.
pub fn json_path(path: &Path) -> PathBuf {
    if path.is_dir() { path.join(FILE_NAME) } else { path.to_path_buf() }
}

/// Folder that the pictures' paths are relative to.
fn folder(json: &Path) -> PathBuf {
    json.parent().map_or_else(PathBuf::new, Path::to_path_buf)
}
