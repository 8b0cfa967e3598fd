//! Cumulo: volumetric assets between OpenVDB, Blender, USD and EXR, with differentiable volume rendering.
//!
//! ```text
//! formats ──▶ scene ──▶ render ──▶ plan, differentiate ──▶ inverse ──▶ app ──▶ cli
//! ```
//! Data flows along the arrows: `scene` knows no file format, `differentiate` and `inverse` know renderers through
//! [`Differentiable`](render::differentiable::Differentiable), and `differentiate` does not know what `inverse` asks
//! its gradients for; `denoise`, `formats`, `metrics` and `report` know no renderer. Only `render::tiles` distributes
//! rays and pixels over threads. [`app`] holds the use cases, which know no command line. [`prelude`] has what most
//! programs need.
//!
//! # Conventions
//! - World space is right-handed, in the VDB's world units. Extinction is per world unit of length.
//! - Voxel (i, j, k) has its **centre** at index position (i, j, k). Affine maps are `f64` and act on column vectors.
//! - A camera looks down -Z, +Y up, +X right. Pixel (0, 0) is top left, its centre at (0.5, 0.5).
//! - Images are scene-linear and row-major; alpha is 1 - transmittance. Color holds the medium's radiance and the
//!   attenuated background: over black it is premultiplied in the usual sense.
//! - A name `by_x` is a derivative of the loss with respect to x.

#![warn(unreachable_pub)]

pub mod app;
pub mod cli;
pub mod formats;
pub mod guide;
pub mod prelude;
pub mod process;
pub mod report;
mod scratch;

pub(crate) use cumulo_kernels::ordered;
#[doc(inline)]
pub use cumulo_kernels::{
    arch, cancel, denoise, differentiate, error, hard_cases, inverse, math, metrics, plan, ranks, real, render, scene,
    text, wording,
};

pub use error::{Error, Result};
