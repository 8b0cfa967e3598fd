//! Kernels of Cumulo: scenes of volumes, and what light, gradients, reconstructions and denoising make of them.
//!
//! The crate `cumulo` shows these modules as its own, beside file formats, use cases and the command line. Its
//! documentation tells how they belong together, and which conventions they share.

#![warn(unreachable_pub)]

pub mod arch;
pub mod cancel;
pub mod denoise;
pub mod differentiate;
pub(crate) mod dual;
pub mod error;
pub mod hard_cases;
pub mod inverse;
pub mod math;
pub mod metrics;
pub mod ordered;
pub mod plan;
pub mod ranks;
pub mod real;
pub mod render;
pub mod scene;
pub mod text;
pub mod wording;
