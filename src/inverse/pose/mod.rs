//! Where cameras stood, from their pictures and the volume in them: least squares by Levenberg and Marquardt.
//!
//! The derivatives of every pixel's colors by the camera are those of the renderer's adjoint.

pub mod colors;
pub mod normal;
pub mod pyramid;
pub mod search;
