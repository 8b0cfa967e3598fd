//! Solvers: conjugate gradients, Adam, and ascent on a sphere; the function that keeps unknowns positive.

pub(crate) mod adam;
pub(crate) mod anderson;
pub(crate) mod ascent;
pub mod conjugate;
pub mod smoother;
pub(crate) mod softplus;
pub(crate) mod tikhonov;
