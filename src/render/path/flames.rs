//! Emission by grids of several volumes, or beside chromatic media: rays through it are sampled.
//!
//! A point of the ray is drawn by the strength of the emission there, and its light dimmed by all media before it.

use super::Scratch;
use super::tracking::{Collision, Media, Primary};
use crate::error::Result;
use crate::math::Ray;
use crate::render::dvr::Dvr;
use crate::render::sampler::Sampler;
use crate::scene::bricks::Bricks;
use crate::scene::emission::Emitted;
use crate::scene::medium::Medium;
use glam::{DVec3, Vec3, Vec4};

/// A grid that emits.
struct Flame<'a> {
    /// Radiance emitted per world length, in red, green and blue.
    emission: &'a Bricks<Vec4>,
    /// Computes the integral of the mean of the channels, and finds points by it.
    strength: Dvr<'a, f32>,
}

/// Media beside which grids emit.
pub(super) struct Flames<'a, M> {
    media: M,
    flames: Vec<Flame<'a>>,
}

impl<'a, M> Flames<'a, M> {
    /// Creates the kernel of media from the emission of their volumes.
    ///
    /// # Errors
    /// If an emission cannot be rendered.
    pub fn new(media: M, emitted: impl Iterator<Item = &'a Emitted>) -> Result<Self> {
        let flame = |emitted: &'a Emitted| {
            let strength = Dvr::new(emitted.strength(), Medium::absorbing(1.0))?.early_stop(0.0);
            Ok(Flame { emission: emitted.grid(), strength })
        };
        Ok(Self { media, flames: emitted.map(flame).collect::<Result<_>>()? })
    }
}

impl<M: Media> Media for Flames<'_, M> {
    type Phase = M::Phase;
    const EMITS: bool = M::EMITS;
    const GLOWS: bool = true;

    fn collide(
        &self,
        ray: &Ray,
        weight: Vec3,
        sampler: &mut Sampler,
        scratch: &mut Scratch,
    ) -> Option<(Collision, Vec3)> {
        self.media.collide(ray, weight, sampler, scratch)
    }

    fn survival(&self, ray: &Ray, distance: f64, weight: Vec3, scratch: &mut Scratch) -> Vec3 {
        self.media.survival(ray, distance, weight, scratch)
    }

    fn look(&self, ray: &Ray, scratch: &mut Scratch) {
        self.media.look(ray, scratch);
    }

    fn emitted(&self, ray: &Ray, _: bool, sampler: &mut Sampler, scratch: &mut Scratch) -> Vec3 {
        let mut sum = Vec3::ZERO;
        for Flame { emission, strength } in &self.flames {
            let walked = strength.walk(ray, &mut scratch.tape);
            let Some((distance, _)) = strength.locate(&walked, sampler.uniform() * walked.depth, &mut scratch.tape)
            else {
                continue;
            };
            let radiance = at(emission, ray.at(distance));
            let mean = radiance.element_sum() / 3.0;
            if mean > 0.0 {
                let transmittance = self.media.transmittance(ray, distance, sampler, scratch);
                sum += radiance * (walked.depth as f32 / mean) * transmittance;
            }
        }
        sum
    }

    fn first(&self, ray: &Ray, sampler: &mut Sampler, scratch: &mut Scratch) -> Primary {
        self.media.first(ray, sampler, scratch)
    }

    fn transmittance(&self, ray: &Ray, length: f64, sampler: &mut Sampler, scratch: &mut Scratch) -> Vec3 {
        self.media.transmittance(ray, length, sampler, scratch)
    }

    fn albedo(&self, collision: &Collision) -> Vec3 {
        self.media.albedo(collision)
    }

    fn source(&self, collision: &Collision) -> Vec3 {
        self.media.source(collision)
    }

    fn phase(&self, collision: &Collision, at: DVec3) -> M::Phase {
        self.media.phase(collision, at)
    }

    fn normal(&self, volume: usize, position: DVec3) -> DVec3 {
        self.media.normal(volume, position)
    }
}

/// Returns the radiance emitted per world length at a world position.
fn at(emission: &Bricks<Vec4>, position: DVec3) -> Vec3 {
    let corners = emission.corners(emission.transform.to_index(position)).into_iter().flatten();
    corners.map(|(voxel, weight)| emission.values[voxel].truncate() * weight as f32).sum()
}
