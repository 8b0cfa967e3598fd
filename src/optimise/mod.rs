//! Volumes from pictures, and cameras for volumes.
//!
//! ```text
//! pictures ──▶ observation ──▶ hull ──▶ solver (projector, smooth) ──▶ density
//!     └───────────────────────────────▶ adam (pictures) ────────────▶ paper
//! volume ────▶ rows ──▶ entropy ──▶ ascent ──▶ viewpoint
//!               └─────▶ normal ──────────────▶ pose
//! ```

pub mod adam;
pub mod ascent;
pub mod density;
pub mod entropy;
pub mod hull;
pub mod lattice;
pub mod normal;
pub mod observation;
pub mod paper;
pub mod pictures;
pub mod pose;
pub mod projector;
pub mod rows;
pub mod smooth;
pub mod solver;
pub mod transfer;
pub mod viewpoint;
