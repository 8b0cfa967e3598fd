//! The description of what light travels through. It knows no file format and no renderer.

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
