//! Light on its way through the scene.

pub mod film;
