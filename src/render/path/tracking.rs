//! Delta tracking (Woodcock et al. 1965): collisions with a medium at the density `σ e^{-∫σ}` along a ray.
//!
//! Tentative collisions are drawn with the brick's majorant in place of the extinction; of these, the share σ over the
//! majorant is real. Bricks in which nothing absorbs are skipped.

use super::Scratch;
use super::optics::{Any, Optics, PhaseFunction};
use crate::error::{Error, Result};
use crate::math::Ray;
use crate::render::dvr::{self, Dvr};
use crate::render::march::{IndexRay, Span, spans};
use crate::render::sampler::Sampler;
use crate::scene::bricks::{BRICK, Bricks};
use crate::scene::medium::{Medium, Scattering};
use crate::scene::phase::Phase;
use glam::{DMat3, DVec3, Vec3};

/// A real collision of a path with a medium.
#[derive(Debug, Clone, Copy)]
pub(super) struct Collision {
    /// World length from the ray's origin.
    pub distance: f64,
    /// Density of the medium.
    pub density: f32,
    /// Number of the volume.
    pub volume: usize,
}

/// A camera's ray: what it lets through, and a collision with the weight of all of them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Primary {
    /// Transmittance, or an estimate of it, by channel.
    pub transmittance: Vec3,
    /// Collision and its weight, of the same mean as 1 - transmittance.
    pub collision: Option<(Collision, Vec3)>,
    /// A number in [0, 1) that is even over the samples of a pixel, for those whose weight is not 1.
    pub spare: f64,
}

/// The volumes of a scene as paths meet them.
pub(super) trait Media: Sync + Send {
    /// Phase function of the media.
    type Phase: PhaseFunction;
    /// False if no medium emits by its source.
    const EMITS: bool;
    /// True if a grid emits beside the media.
    const GLOWS: bool = false;
    /// Draws the next real collision along a world ray of unit direction that carries `weight`, and returns with it what the
    /// weight is to be multiplied by; `None` if the ray escapes.
    fn collide(
        &self,
        ray: &Ray,
        weight: Vec3,
        sampler: &mut Sampler,
        scratch: &mut Scratch,
    ) -> Option<(Collision, Vec3)>;
    /// Returns what the weight of a ray is to be multiplied by that [`Media::collide`] let go on beyond a distance.
    fn survival(&self, ray: &Ray, distance: f64, weight: Vec3, scratch: &mut Scratch) -> Vec3;
    /// Walks along a camera's ray, before collisions are drawn on it.
    fn look(&self, ray: &Ray, scratch: &mut Scratch);
    /// Returns the radiance of the grid beside the media along a world ray of unit direction.
    fn emitted(&self, _: &Ray, _: &mut Scratch) -> Vec3 {
        Vec3::ZERO
    }
    /// Draws the first collision along the camera's ray that was walked last.
    fn first(&self, ray: &Ray, sampler: &mut Sampler, scratch: &mut Scratch) -> Primary;
    /// Returns an estimate of the transmittance of the first `length` of a world ray of unit direction: the exact one, or
    /// where that is small sometimes more and else 0.
    fn transmittance(&self, ray: &Ray, length: f64, sampler: &mut Sampler, scratch: &mut Scratch) -> Vec3;
    /// Returns the share of the extinction that is scattered.
    fn albedo(&self, collision: &Collision) -> Vec3;
    /// Returns the radiance of the source, of which the share that is not scattered is emitted.
    fn source(&self, collision: &Collision) -> Vec3;
    /// Returns the phase function.
    fn phase(&self, collision: &Collision) -> Self::Phase;
    /// Returns the unit vector in which the density of a volume falls at a world position; 0 where it is constant.
    fn normal(&self, volume: usize, position: DVec3) -> DVec3;
}

/// One volume with its medium.
pub(super) struct One<'a, O, P> {
    /// Computes transmittances; its medium does not scatter.
    pub dvr: Dvr<'a, f32>,
    pub optics: O,
    pub albedo: Vec3,
    pub phase: P,
}

/// Tentative collisions to be expected in a brick above which a ray goes on by exact quadrature: a bound that one voxel
/// sets tells nothing of the others.
const DENSE: f32 = 256.0;
/// Transmittance below which cameras' rays end.
pub(super) const LEAST_TRANSMITTANCE: f64 = 1e-9;
/// Optical depth from which transmittances are drawn: that of 5 %.
pub(super) const EXACT_DEPTH: f64 = 3.0;

/// Returns the volume for kernels that serve any medium, in its channel of most extinction.
pub(super) fn any<'a>(field: &'a Bricks<f32>, medium: &Medium) -> Result<One<'a, Any, Phase>> {
    let medium = medium.clone().checked()?;
    let Scattering { albedo, phase } =
        medium.scattering.unwrap_or(Scattering { albedo: [0.0; 3], phase: Phase::Isotropic });
    let optics = Any::new(&medium);
    let dvr = Dvr::new(field, medium.densest_channel())?.early_stop(LEAST_TRANSMITTANCE);
    let largest = dvr.majorants().largest();
    if !largest.is_finite() {
        return Err(Error::invalid("the extinction is too large for single precision")
            .hint("give a smaller density scale, or correct the densities"));
    }
    Ok(One { dvr, optics, albedo: Vec3::from_array(albedo), phase })
}

impl<O: Optics, P> One<'_, O, P> {
    /// Draws the collision with this volume before `limit`.
    #[inline(always)]
    fn collision(&self, ray: &Ray, limit: f64, sampler: &mut Sampler, scratch: &mut Scratch) -> Option<(f64, f32)> {
        let (field, world) = (self.dvr.field(), ray);
        let mut ray = IndexRay::new(&field.domain, &field.transform, world)?;
        ray.leave = ray.leave.min(limit);
        let (bounds, values) = (self.dvr.majorants().bricks(), &field.values[..]);
        let (mut depth, mut found, mut dense) = (sampler.exponential(), None, None);
        let counts = &mut scratch.counts;
        spans(
            self.dvr.visible(),
            &ray,
            false,
            #[inline(always)]
            |span: Span<f32>| {
                let majorant = bounds[span.base / BRICK];
                if majorant * span.length > DENSE {
                    dense = Some(span.start);
                    return false;
                }
                // Less than this is lost in the sum.
                let least = span.length * f32::EPSILON;
                let mut at = 0.0_f32;
                loop {
                    let step = (depth / majorant).max(least);
                    if at + step >= span.length {
                        depth = (depth - (span.length - at) * majorant).max(0.0);
                        return true;
                    }
                    at += step;
                    let density = dvr::density(values, &span, at);
                    let extinction = self.optics.extinction(density);
                    counts.lookups += 1;
                    counts.violations += u64::from(extinction > majorant * (1.0 + 4.0 * f32::EPSILON));
                    if (sampler.uniform() as f32) * majorant < extinction {
                        found = Some((span.start + f64::from(at), density));
                        return false;
                    }
                    depth = sampler.exponential();
                }
            },
        );
        if let Some(start) = dense {
            let rest = Ray { origin: world.at(start), direction: world.direction };
            let found = self.dvr.collision_at(&rest, depth.into(), limit - start, &mut scratch.tape);
            return found.map(|(distance, density)| (start + distance, density));
        }
        found
    }
}

impl<O: Optics, P: PhaseFunction> Media for One<'_, O, P> {
    type Phase = P;
    const EMITS: bool = O::EMITS;

    #[inline(always)]
    fn collide(&self, ray: &Ray, _: Vec3, sampler: &mut Sampler, scratch: &mut Scratch) -> Option<(Collision, Vec3)> {
        let (distance, density) = self.collision(ray, f64::INFINITY, sampler, scratch)?;
        Some((Collision { distance, density, volume: 0 }, Vec3::ONE))
    }

    #[inline(always)]
    fn survival(&self, _: &Ray, _: f64, _: Vec3, _: &mut Scratch) -> Vec3 {
        Vec3::ONE
    }

    #[inline(always)]
    fn look(&self, ray: &Ray, scratch: &mut Scratch) {
        scratch.walked = Some(self.dvr.walk(ray, &mut scratch.camera));
    }

    /// The transmittance is exact, and every ray that meets the medium collides with it.
    #[inline(always)]
    fn first(&self, _: &Ray, sampler: &mut Sampler, scratch: &mut Scratch) -> Primary {
        let [u, spare, ..] = sampler.even();
        let Some(walked) = &scratch.walked else {
            return Primary { transmittance: Vec3::ONE, collision: None, spare };
        };
        let transmittance = (-walked.depth).exp();
        let share = -(-walked.depth).exp_m1();
        let found = walked.collision(u).and_then(|depth| self.dvr.locate(walked, depth, &mut scratch.camera));
        let weight = Vec3::splat(share as f32);
        let collision = found.map(|(distance, density)| (Collision { distance, density, volume: 0 }, weight));
        Primary { transmittance: Vec3::splat(transmittance as f32), collision, spare }
    }

    #[inline(always)]
    fn transmittance(&self, ray: &Ray, length: f64, sampler: &mut Sampler, scratch: &mut Scratch) -> Vec3 {
        // Beyond, the ray survives with the probability of what is left: the mean stays, and the walk ends soon.
        let limit = EXACT_DEPTH + f64::from(sampler.exponential());
        let depth = self.dvr.optical_depth_within(ray, length, limit, &mut scratch.tape);
        Vec3::splat(if depth < limit { (-depth.min(EXACT_DEPTH)).exp() as f32 } else { 0.0 })
    }

    #[inline(always)]
    fn albedo(&self, _: &Collision) -> Vec3 {
        self.albedo
    }

    #[inline(always)]
    fn source(&self, collision: &Collision) -> Vec3 {
        self.optics.source(collision.density)
    }

    #[inline(always)]
    fn phase(&self, _: &Collision) -> P {
        self.phase
    }

    fn normal(&self, _: usize, position: DVec3) -> DVec3 {
        let field = self.dvr.field();
        let slopes = field.slopes(field.transform.to_index(position));
        // Gradients are covectors: the transpose of the inverse map takes them to world space.
        -(DMat3::from_mat4(field.transform.inverse_matrix()).transpose() * slopes).normalize_or_zero()
    }
}

/// Several volumes, which may overlap: their extinctions add.
impl Media for Vec<One<'_, Any, Phase>> {
    type Phase = Phase;
    const EMITS: bool = true;

    /// Collisions with each volume are independent, and the nearest of them is the first.
    #[inline(always)]
    fn collide(&self, ray: &Ray, _: Vec3, sampler: &mut Sampler, scratch: &mut Scratch) -> Option<(Collision, Vec3)> {
        let mut nearest: Option<Collision> = None;
        for (volume, one) in self.iter().enumerate() {
            let limit = nearest.map_or(f64::INFINITY, |c| c.distance);
            if let Some((distance, density)) = one.collision(ray, limit, sampler, scratch) {
                nearest = Some(Collision { distance, density, volume });
            }
        }
        nearest.map(|collision| (collision, Vec3::ONE))
    }

    #[inline(always)]
    fn survival(&self, _: &Ray, _: f64, _: Vec3, _: &mut Scratch) -> Vec3 {
        Vec3::ONE
    }

    /// Collisions are drawn by tracking: there is nothing to be prepared.
    #[inline(always)]
    fn look(&self, _: &Ray, _: &mut Scratch) {}

    #[inline(always)]
    fn first(&self, ray: &Ray, sampler: &mut Sampler, scratch: &mut Scratch) -> Primary {
        let collision = self.collide(ray, Vec3::ONE, sampler, scratch);
        let transmittance = if collision.is_some() { Vec3::ZERO } else { Vec3::ONE };
        Primary { transmittance, collision, spare: 0.0 }
    }

    #[inline(always)]
    fn transmittance(&self, ray: &Ray, length: f64, sampler: &mut Sampler, scratch: &mut Scratch) -> Vec3 {
        self.iter().map(|one| one.transmittance(ray, length, sampler, scratch)).product()
    }

    #[inline(always)]
    fn albedo(&self, collision: &Collision) -> Vec3 {
        self[collision.volume].albedo
    }

    #[inline(always)]
    fn source(&self, collision: &Collision) -> Vec3 {
        self[collision.volume].source(collision)
    }

    #[inline(always)]
    fn phase(&self, collision: &Collision) -> Phase {
        self[collision.volume].phase
    }

    fn normal(&self, volume: usize, position: DVec3) -> DVec3 {
        self[volume].normal(0, position)
    }
}
