//! USD stages.

pub mod fields;
pub mod write;
