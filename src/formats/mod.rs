//! Files in and out. Nothing here knows a renderer.

pub mod atomic;
pub mod exr;
pub mod png;
pub mod problem;
pub mod transforms;
pub mod vdb;
