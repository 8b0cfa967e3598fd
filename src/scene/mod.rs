//! Description of the scene: volumes, media, transfer functions, cameras and pictures. No module here knows a file
//! format or a renderer.

pub mod active;
pub mod aim;
pub mod albedo;
mod ball;
pub mod blur;
pub mod bricks;
pub mod camera;
pub mod capture;
pub mod color_space;
pub mod cone;
pub mod deep;
pub mod dense;
pub(crate) mod directions;
pub mod display;
pub mod emission;
pub mod environment;
pub mod film;
pub mod grid;
pub mod holdout;
pub mod lens;
pub mod light;
pub mod medium;
pub mod meshes;
mod moments;
pub mod motion;
pub mod neighbours;
pub mod orbit;
mod outline;
pub mod phase;
pub mod primaries;
#[allow(clippy::module_inception, reason = "the module is named after the one type in it, like all others")]
pub mod scene;
pub mod shading;
mod sources;
pub mod sphere;
pub mod statistics;
pub mod surfaces;
pub mod table;
pub mod topology;
pub mod transfer;
pub mod undistort;
pub mod up;
pub mod velocity;
pub mod volume;
