//! Gradients of losses on pictures, and the partition of their pixels among threads.

pub mod camera_jacobian;
pub mod footprint;
pub mod objective;
pub mod partition;
pub mod pictures;
pub mod views;
