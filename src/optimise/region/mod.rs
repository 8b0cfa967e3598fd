//! Where a reconstruction has voxels: lattice, visual hull and neighbours.

pub mod hull;
pub mod lattice;
pub mod neighbours;
