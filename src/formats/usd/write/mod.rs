//! Stages as text: volumes with their fields, media and materials, lights and cameras.

pub mod camera;
pub mod light;
mod literal;
pub mod material;
pub mod medium;
pub mod names;
pub mod places;
pub mod stage;
pub mod text;
pub mod volume;
