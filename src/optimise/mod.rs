//! Volumes from pictures, and cameras for volumes.
//!
//! ```text
//! projection ──▶ region ──▶ solver ──▶ density, color        (optical depths, emissions: linear)
//! gradient, loss ─────────▶ solver ──▶ density, transfer     (through a transfer function, by descent)
//! gradient ───────────────▶ solver ──▶ pose, viewpoint       (cameras)
//! density, pose ────────────────────▶ refinement            (cameras and densities together)
//! plausibility: contradictions of the model, before and after   study: any derivative, and its check
//! ```

pub mod color;
pub mod density;
pub mod gradient;
pub mod loss;
pub mod plausibility;
pub mod pose;
pub mod projection;
pub mod refinement;
pub mod region;
pub mod solver;
pub mod study;
pub mod transfer;
pub mod viewpoint;
