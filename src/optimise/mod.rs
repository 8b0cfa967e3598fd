//! Volumes from pictures.

pub mod projector;
