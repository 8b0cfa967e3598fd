//! Emission and absorption: the radiance and the optical depth of a medium along a ray.

use crate::math::Ray;
use crate::real::Real;

/// Radiance that reaches the origin of a ray from the medium along it, and the optical depth of the medium.
///
/// Radiance from behind the medium is not part of it: [`Composited`](crate::render::composited::Composited) adds the
/// background.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Radiance {
    /// Radiance in red, green and blue that the medium emits towards the origin.
    pub rgb: [f64; 3],
    /// Optical depth of the whole ray.
    pub depth: f64,
}

impl Radiance {
    /// Returns the share of the light behind the medium that arrives, `exp(-depth)`.
    #[inline(always)]
    pub(crate) fn transmittance(&self) -> f64 {
        (-self.depth).exp()
    }
}

/// Computes the radiance that a medium emits along rays, and its optical depth: deterministic, the background apart.
pub trait EmissionAbsorption: Sync {
    /// Floating-point type of the integrator's inner loops.
    type Real: Real;
    /// Scratch memory of a task, reused from ray to ray.
    type Scratch: Default + Send;

    /// Returns the radiance along a world ray of unit direction.
    fn integrate(&self, ray: &Ray, scratch: &mut Self::Scratch) -> Radiance;

    /// Returns the radiance of the part of a world ray of unit direction between two lengths, and its optical depth:
    /// parts make up the whole ray, but for the errors of the quadrature.
    fn integrate_part(&self, ray: &Ray, [from, to]: [f64; 2], scratch: &mut Self::Scratch) -> Radiance {
        self.integrate(&Ray { origin: ray.at(from), far: to - from, ..*ray }, scratch)
    }
}
