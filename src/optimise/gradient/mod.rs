//! Gradients of losses on pictures, and how their pixels are divided among threads.

pub mod camera_jacobian;
pub mod footprint;
pub mod objective;
pub mod partition;
pub mod pictures;
