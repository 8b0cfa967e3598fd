//! Light along a ray.

use crate::math::Ray;
use crate::real::Real;

/// Light that reaches the origin of a ray from the medium along it, and the optical depth of the medium.
///
/// What lies behind the medium is not part of it: [`Composited`](crate::render::composited::Composited) adds the
/// background.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Radiance {
    /// Radiance in red, green and blue that the medium emits towards the origin.
    pub rgb: [f64; 3],
    /// Optical depth of the whole ray.
    pub depth: f64,
}

impl Radiance {
    /// Share of the light behind the medium that arrives.
    #[inline(always)]
    pub fn transmittance(&self) -> f64 {
        (-self.depth).exp()
    }
}

/// Computes the light along rays.
pub trait Integrator: Sync {
    /// Floating-point type of its inner loops.
    type Real: Real;
    /// Scratch memory of one thread, reused from ray to ray.
    type Scratch: Default + Send;

    /// Radiance along a world ray of unit direction.
    fn li(&self, ray: &Ray, scratch: &mut Self::Scratch) -> Radiance;
}
