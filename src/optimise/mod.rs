//! Volumes from pictures.
//!
//! ```text
//! pictures ──▶ observation ──▶ hull ──▶ solver (projector, smooth) ──▶ density
//!     └───────────────────────────────▶ adam (pictures) ────────────▶ paper
//! ```

pub mod adam;
pub mod density;
pub mod hull;
pub mod lattice;
pub mod observation;
pub mod paper;
pub mod pictures;
pub mod projector;
pub mod smooth;
pub mod solver;
pub mod transfer;
