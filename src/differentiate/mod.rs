//! Derivatives of what pictures show: losses on them, and their gradients with respect to voxels, transfer function and
//! cameras.
//!
//! ```text
//! loss ──▶ gradient ──▶ study
//! ```
//! Pictures of scattered light have derivatives by the albedo, estimated along their paths (`albedo`).
//!
//! A loss has its value beside its derivative. A gradient takes it through the renderer to all parameters at once; a
//! study takes it one parameter at a time and checks it by difference quotients. Nothing here knows what the
//! derivatives are for.

pub mod albedo;
pub mod gradient;
pub mod loss;
pub mod study;
