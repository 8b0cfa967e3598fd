//! What is asked of a gradient, and where it goes.

use super::Radiance;
use crate::scene::table::TableGradient;
use glam::DVec3;

/// How the backward pass gets at the samples of the forward pass again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Adjoint {
    /// A tape of one ray: fast, memory of one ray's samples per thread.
    Tape,
    /// Walk the ray twice, but for what is kept of it: its last batch of bricks, or with pre-integration its first few
    /// hundred nodes. Memory of so many samples per thread, any loss.
    Replay,
    /// The paper's inversion of the blend, for comparison: breaks down where a sample is opaque.
    Inversion,
}

/// Derivatives of the loss with respect to the parameters that all rays share, or a step of these.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ParameterGradient {
    /// With respect to the medium's extinction.
    pub extinction: f64,
    /// With respect to the source's color; zero with a transfer function, which has its own.
    pub color: [f64; 3],
    /// With respect to the background.
    pub background: [f64; 3],
}

impl ParameterGradient {
    /// Sum of two.
    #[must_use]
    pub fn plus(self, o: &Self) -> Self {
        Self {
            extinction: self.extinction + o.extinction,
            color: std::array::from_fn(|c| self.color[c] + o.color[c]),
            background: std::array::from_fn(|c| self.background[c] + o.background[c]),
        }
    }
}

/// Derivatives of the loss with respect to one ray's origin and direction (of unit length: only changes
/// across it mean anything), in world space, and to the quadrature's step; or a change of these.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct RayGradient {
    /// With respect to the origin.
    pub origin: DVec3,
    /// With respect to the direction.
    pub direction: DVec3,
    /// With respect to the step of a quadrature that has one, in voxels.
    pub step: f64,
}

/// Derivative of a loss with respect to R, G, B and alpha at a radiance.
pub type Loss<'l, R> = &'l mut dyn FnMut(&Radiance<R>) -> [R; 4];

/// Where a gradient is added to; what is `None` is not computed.
#[derive(Debug)]
pub struct Sinks<'g, V> {
    /// By stored value, as in [`Bricks::values`](crate::scene::bricks::Bricks::values).
    pub voxels: Option<&'g mut [V]>,
    /// By piece of the transfer function; for media that have one.
    pub table: Option<&'g mut TableGradient>,
    /// Of this ray.
    pub ray: Option<&'g mut RayGradient>,
    /// Of all that rays share.
    pub shared: &'g mut ParameterGradient,
}
