//! Pixels as linear equations: of the optical depths in the densities, and of the colors in the emissions.

pub mod depths;
pub(crate) mod emission;
pub mod projector;
