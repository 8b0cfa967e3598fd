//! Volumes from pictures.
//!
//! ```text
//! pictures ──▶ observation ──▶ hull ──▶ solver (projector, smooth) ──▶ density
//!     └───────────────────────────────▶ adam (pictures) ────────────▶ paper
//! ```
//! Gradients of any loss by any parameter, for study: `loss` ──▶ `objective` ──▶ `study` (`parameter`, `plan`, `difference`).

pub mod adam;
pub mod density;
pub mod difference;
pub mod hull;
pub mod lattice;
pub mod loss;
pub mod objective;
pub mod observation;
pub mod paper;
pub mod parameter;
pub mod pictures;
pub mod plan;
pub mod projector;
pub mod smooth;
pub mod solver;
pub mod study;
