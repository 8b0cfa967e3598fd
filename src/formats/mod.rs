//! Files in and out. Nothing here knows a renderer.

pub mod atomic;
pub mod vdb;
