//! Solvers: conjugate gradients, Adam, and ascent on a sphere.

pub(crate) mod adam;
pub(crate) mod anderson;
pub(crate) mod ascent;
pub mod conjugate;
pub mod smoother;
pub(crate) mod tikhonov;
