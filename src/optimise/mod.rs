//! Volumes from pictures, and cameras for volumes.
//!
//! ```text
//! pictures ──▶ observation ──▶ hull ──▶ solver (projector, smooth) ──▶ density
//!     └───────────────────────────────▶ adam (pictures) ────────────▶ paper
//! volume ────▶ rows ──▶ entropy ──▶ ascent ──▶ viewpoint
//!               └─────▶ normal ──────────────▶ pose
//! ```
//! Rays of `pictures` are shared out by `parts`, by what they meet (`footprint`).
//! Gradients of any loss by any parameter, for study: `loss` ──▶ `objective` ──▶ `study` (`parameter`, `plan`, `difference`).

pub mod adam;
pub mod ascent;
pub mod behind;
pub mod cancel;
pub mod color;
pub mod confidence;
pub mod cost;
pub mod density;
pub mod depths;
pub mod difference;
pub mod emission;
pub mod entropy;
pub mod fit;
pub mod footprint;
pub mod hull;
pub mod lattice;
pub mod loss;
pub mod matching;
pub mod neighbours;
pub mod normal;
pub mod objective;
pub mod observation;
pub mod paper;
pub mod parameter;
pub mod parts;
pub mod pictures;
pub mod plan;
pub mod plausibility;
pub mod pose;
pub mod prior;
pub mod projector;
pub mod residuals;
pub mod rows;
pub mod smooth;
pub mod solver;
pub mod study;
pub mod subject;
pub mod transfer;
pub mod viewpoint;
