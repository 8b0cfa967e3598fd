//! Solvers: conjugate gradients, Adam, and ascent on a sphere.

pub mod adam;
pub mod anderson;
pub mod ascent;
pub mod conjugate;
pub mod smoother;
pub mod tikhonov;
