//! Derivatives of the light along a ray, in reverse and in forward mode.

use super::integrator::{Integrator, Radiance};
use crate::dual::Dual;
use crate::math::Ray;
use crate::scene::bricks::{Bricks, Voxel};
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
    /// Weiss & Westermann's inversion of the blend, for comparison: breaks down where a sample is opaque.
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

/// Derivatives of a loss with respect to a [`Radiance`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cotangent<R> {
    /// With respect to red, green and blue.
    pub rgb: [R; 3],
    /// With respect to the transmittance.
    pub transmittance: f64,
}

/// Maps a radiance to the derivatives of a loss with respect to it.
pub type Loss<'l, R> = &'l mut dyn FnMut(&Radiance) -> Cotangent<R>;

/// Gradient accumulators; what is `None` is not computed.
#[derive(Debug)]
pub struct Accumulators<'g, V> {
    /// By stored value, as in [`Bricks::values`](crate::scene::bricks::Bricks::values).
    pub voxels: Option<&'g mut [V]>,
    /// By piece of the transfer function; for media that have one.
    pub table: Option<&'g mut TableGradient>,
    /// Of this ray.
    pub ray: Option<&'g mut RayGradient>,
    /// Of all that rays share.
    pub shared: &'g mut ParameterGradient,
}

/// Directions in which parameters change: derivatives of each with respect to `P` numbers.
#[derive(Debug, Clone, Copy)]
pub struct Seeds<'s, V, const P: usize> {
    /// Of the ray's origin and direction (of unit length: changes across it), in world space, and of the
    /// quadrature's step, in voxels.
    pub ray: [RayGradient; P],
    /// Of the stored values, as in [`Bricks::values`](crate::scene::bricks::Bricks::values), 729 a brick.
    pub voxels: [Option<&'s [V]>; P],
    /// Of the transfer function's pieces ([`Transfer::push`](crate::scene::transfer::Transfer::push)).
    pub table: [Option<&'s TableGradient>; P],
    /// Of extinction, the source's color (of media without a transfer function) and background.
    pub shared: [ParameterGradient; P],
}

impl<V, const P: usize> Default for Seeds<'_, V, P> {
    /// Directions in which nothing changes.
    fn default() -> Self {
        Self {
            ray: [RayGradient::default(); P],
            voxels: [None; P],
            table: [None; P],
            shared: [ParameterGradient::default(); P],
        }
    }
}

/// A [`Radiance`] with its derivatives along `P` directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TangentRadiance<const P: usize> {
    /// Radiance in red, green and blue that the medium emits towards the ray's origin.
    pub rgb: [Dual<f64, P>; 3],
    /// Optical depth of the whole ray.
    pub depth: Dual<f64, P>,
}

/// An integrator with derivatives in reverse mode.
pub trait Differentiable: Integrator {
    /// Voxel of its field.
    type Voxel: Voxel;

    /// The field that is rendered.
    fn field(&self) -> &Bricks<Self::Voxel>;

    /// Estimated voxel lookups per ray and brick; 0 for bricks that rays skip, whose gradient is zero. Rays whose gradient
    /// with respect to the transfer function is asked for too (`by_table`) skip none.
    fn lookups(&self, by_table: bool) -> Vec<f32>;

    /// Radiance along a world ray of unit direction; the gradient of a loss on it is added to the accumulators
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
    /// Radiance along a world ray of unit direction, with the bits of [`Integrator::li`], and its derivatives
    /// (Jacobian-vector products): the transpose of [`Differentiable::vjp`].
    fn jvp(&self, ray: &Ray, seeds: &Seeds<'_, Self::Voxel, P>, scratch: &mut Self::Scratch) -> TangentRadiance<P>;
}
