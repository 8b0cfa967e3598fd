//! Volumes from pictures.

pub mod density;
pub mod hull;
pub mod observation;
pub mod projector;
pub mod smooth;
pub mod solver;
