//! Where a reconstruction has voxels: lattice and visual hull.

pub mod hull;
pub mod lattice;
