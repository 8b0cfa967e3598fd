//! Volumes and pictures as arrays in memory: read from files, rendered, and differentiated.

mod lattice;
mod pictures;
mod read;

pub use lattice::{Lattice, Value};
pub use pictures::{ArrayScene, Derivatives, Differentiate, Wanted, usual_quadrature};
pub use read::{Volume, volume};
