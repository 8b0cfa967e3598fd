//! Inverse problems: volumes from pictures, transfer functions and cameras for volumes.
//!
//! ```text
//! observation ──▶ region, projection ──▶ density ──▶ color ──▶ through_transfer    voxels
//! observation ──▶ transfer                                                         texels
//! observation ──▶ pose, viewpoint                                                  cameras
//! density, pose ──▶ refinement                                                     cameras and voxels together
//! ```
//! Arrows point one way, in this order: `progress`, [`checkpoint`], [`observation`] (what pictures measure), [`region`]
//! (where there are voxels), [`solver`] (of equations, whatever these are of), [`projection`] (pixels as equations of
//! voxels), [`density`], `color`, `through_transfer`, `transfer`, [`pose`], [`viewpoint`], [`refinement`], `cost`. Each
//! may use those before it and [`differentiate`](crate::differentiate), which knows none of them.

pub mod checkpoint;
pub mod color;
pub mod cost;
pub mod density;
pub mod observation;
pub mod pose;
pub mod progress;
pub mod projection;
pub mod refinement;
pub mod region;
pub mod solver;
pub mod through_transfer;
pub mod transfer;
pub mod viewpoint;
