//! Description of the scene: volumes, media, transfer functions, cameras and pictures. No module here knows a file
//! format or a renderer.

pub mod bricks;
pub mod camera;
pub mod capture;
pub mod film;
pub mod grid;
pub mod medium;
pub mod orbit;
mod sources;
pub mod sphere;
pub mod statistics;
pub mod table;
pub mod topology;
pub mod transfer;
