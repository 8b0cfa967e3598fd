//! Stages as text: volumes with their fields, media and materials, lights and cameras.

pub(crate) mod camera;
pub(crate) mod light;
mod literal;
pub(crate) mod material;
pub(crate) mod medium;
pub(crate) mod mesh;
pub(crate) mod names;
pub(crate) mod places;
pub(crate) mod stage;
pub(crate) mod text;
pub(crate) mod volume;
