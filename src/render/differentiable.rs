//! Derivatives of the light along a ray, in reverse and in forward mode.

use super::emission_absorption::{EmissionAbsorption, Radiance};
use crate::dual::Dual;
use crate::math::Ray;
use crate::scene::bricks::{Bricks, Voxel};
use crate::scene::table::TableGradient;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Strategy by which the backward pass recovers the samples of the forward pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Adjoint {
    /// A tape of one ray: fast, memory of one ray's samples per thread.
    Tape,
    /// Walks the ray a second time, except for the part that is kept: the last batch of bricks, or with pre-integration
    /// the first few hundred nodes. Memory for that many samples per thread; works with any loss.
    Replay,
    /// Inversion of the blend (Weiss & Westermann 2021), for comparison: breaks down where a sample is opaque.
    /// Pre-integration has none and uses the tape.
    Inversion,
}

/// Derivatives of the loss with respect to the parameters that all rays share; or a change of these parameters.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ParameterGradient {
    /// Derivative with respect to the medium's extinction.
    pub extinction: f64,
    /// Derivative with respect to the source's color; zero with a transfer function, which has its own gradient.
    pub color: [f64; 3],
    /// Derivative with respect to the background.
    pub background: [f64; 3],
}

impl ParameterGradient {
    /// Returns the sum of two gradients.
    #[must_use]
    pub fn plus(self, o: &Self) -> Self {
        Self {
            extinction: self.extinction + o.extinction,
            color: std::array::from_fn(|c| self.color[c] + o.color[c]),
            background: std::array::from_fn(|c| self.background[c] + o.background[c]),
        }
    }
}

/// Derivatives of the loss with respect to one ray's origin and direction, in world space, and to the quadrature's
/// step; or a change of these. The direction has unit length, so only changes across it have a meaning.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct RayGradient {
    /// Derivative with respect to the origin.
    pub origin: DVec3,
    /// Derivative with respect to the direction.
    pub direction: DVec3,
    /// Derivative with respect to the step of a quadrature that has one, in voxels.
    pub step: f64,
}

/// Derivatives of a loss with respect to a `Radiance` (its cotangent).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cotangent<R> {
    /// Derivatives with respect to red, green and blue.
    pub rgb: [R; 3],
    /// Derivative with respect to the transmittance.
    pub transmittance: f64,
}

/// Maps a radiance to the derivatives of a loss with respect to it.
pub type Loss<'l, R> = &'l mut dyn FnMut(&Radiance) -> Cotangent<R>;

/// Gradient accumulators; a gradient that is `None` is not computed.
#[derive(Debug)]
pub struct Accumulators<'g, V> {
    /// Gradient with respect to the stored values, as in [`Bricks::values`](crate::scene::bricks::Bricks::values).
    pub voxels: Option<&'g mut [V]>,
    /// Gradient with respect to the transfer function, by piece; for media that have one.
    pub table: Option<&'g mut TableGradient>,
    /// Gradient with respect to this ray.
    pub ray: Option<&'g mut RayGradient>,
    /// Gradient with respect to the parameters that all rays share.
    pub shared: &'g mut ParameterGradient,
}

/// Directions in which parameters change (tangents): the derivatives of each parameter with respect to `P` numbers.
#[derive(Debug, Clone, Copy)]
pub struct Seeds<'s, V, const P: usize> {
    /// Changes of the ray's origin and direction (of unit length: changes across it), in world space, and of the
    /// quadrature's step, in voxels.
    pub ray: [RayGradient; P],
    /// Changes of the stored values, as in [`Bricks::values`](crate::scene::bricks::Bricks::values), 729 a brick;
    /// `None` for no change.
    pub voxels: [Option<&'s [V]>; P],
    /// Changes of the transfer function's pieces ([`Transfer::push`](crate::scene::transfer::Transfer::push)); `None`
    /// for no change.
    pub table: [Option<&'s TableGradient>; P],
    /// Changes of extinction, the source's color (for media without a transfer function) and background.
    pub shared: [ParameterGradient; P],
}

impl<V, const P: usize> Default for Seeds<'_, V, P> {
    /// Returns directions in which nothing changes.
    fn default() -> Self {
        Self {
            ray: [RayGradient::default(); P],
            voxels: [None; P],
            table: [None; P],
            shared: [ParameterGradient::default(); P],
        }
    }
}

/// A `Radiance` with its derivatives along `P` directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TangentRadiance<const P: usize> {
    /// Radiance in red, green and blue that the medium emits towards the ray's origin.
    pub rgb: [Dual<f64, P>; 3],
    /// Optical depth of the whole ray.
    pub depth: Dual<f64, P>,
}

/// An integrator with derivatives in reverse mode.
pub trait Differentiable: EmissionAbsorption {
    /// Voxel type of the field.
    type Voxel: Voxel;

    /// Returns the field that is rendered.
    fn field(&self) -> &Bricks<Self::Voxel>;

    /// Returns the estimated voxel lookups per ray and brick; 0 for bricks that rays skip, whose gradient is zero. With
    /// `by_table`, for rays whose gradient with respect to the transfer function is also requested, no brick is
    /// skipped.
    fn lookups(&self, by_table: bool) -> Vec<f32>;

    /// Returns the radiance along a world ray of unit direction; adds the gradient of a loss on it to the accumulators
    /// (vector-Jacobian product).
    fn vjp(
        &self,
        ray: &Ray,
        loss: Loss<'_, Self::Real>,
        adjoint: Adjoint,
        to: Accumulators<'_, Self::Voxel>,
        scratch: &mut Self::Scratch,
    ) -> Radiance;
}

/// An integrator with derivatives in forward mode, along `P` directions at once.
pub trait Forward<const P: usize>: Differentiable {
    /// Returns the radiance along a world ray of unit direction, bit for bit that of `EmissionAbsorption::integrate`,
    /// with its derivatives (Jacobian-vector products): the transpose of [`Differentiable::vjp`].
    fn jvp(&self, ray: &Ray, seeds: &Seeds<'_, Self::Voxel, P>, scratch: &mut Self::Scratch) -> TangentRadiance<P>;
}
