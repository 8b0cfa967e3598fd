//! Emission by a grid of the only volume, such as fire, that needs no collisions: rays through it are integrated.

use super::Scratch;
use super::tracking::{Collision, LEAST_TRANSMITTANCE, Media, Primary};
use crate::math::Ray;
use crate::render::integrator::Integrator;
use crate::render::preshaded::Preshaded;
use crate::render::sampler::Sampler;
use crate::scene::emission::Emitted;
use glam::{DVec3, Vec3};

/// A medium beside which a grid emits.
pub(super) struct Emissive<'a, M> {
    media: M,
    emission: Preshaded<'a, f32>,
}

impl<'a, M> Emissive<'a, M> {
    /// Creates the kernel of a medium from its emission with its extinction.
    pub fn new(media: M, emission: &'a Emitted) -> Self {
        Self { media, emission: Preshaded::new(emission.grid()).early_stop(LEAST_TRANSMITTANCE) }
    }

    #[inline(always)]
    fn integrated(&self, ray: &Ray, scratch: &mut Scratch) -> Vec3 {
        DVec3::from_array(self.emission.li(ray, &mut scratch.emission).rgb).as_vec3()
    }
}

impl<M: Media> Media for Emissive<'_, M> {
    type Phase = M::Phase;
    const EMITS: bool = M::EMITS;
    const GLOWS: bool = true;

    #[inline(always)]
    fn collide(
        &self,
        ray: &Ray,
        weight: Vec3,
        sampler: &mut Sampler,
        scratch: &mut Scratch,
    ) -> Option<(Collision, Vec3)> {
        self.media.collide(ray, weight, sampler, scratch)
    }

    #[inline(always)]
    fn survival(&self, ray: &Ray, distance: f64, weight: Vec3, scratch: &mut Scratch) -> Vec3 {
        self.media.survival(ray, distance, weight, scratch)
    }

    #[inline(always)]
    fn look(&self, ray: &Ray, scratch: &mut Scratch) {
        scratch.emitted = self.integrated(ray, scratch);
        self.media.look(ray, scratch);
    }

    #[inline(always)]
    fn emitted(&self, ray: &Ray, of_camera: bool, _: &mut Sampler, scratch: &mut Scratch) -> Vec3 {
        if of_camera { scratch.emitted } else { self.integrated(ray, scratch) }
    }

    #[inline(always)]
    fn first(&self, ray: &Ray, sampler: &mut Sampler, scratch: &mut Scratch) -> Primary {
        self.media.first(ray, sampler, scratch)
    }

    #[inline(always)]
    fn transmittance(&self, ray: &Ray, length: f64, sampler: &mut Sampler, scratch: &mut Scratch) -> Vec3 {
        self.media.transmittance(ray, length, sampler, scratch)
    }

    #[inline(always)]
    fn albedo(&self, collision: &Collision) -> Vec3 {
        self.media.albedo(collision)
    }

    #[inline(always)]
    fn source(&self, collision: &Collision) -> Vec3 {
        self.media.source(collision)
    }

    #[inline(always)]
    fn phase(&self, collision: &Collision, at: DVec3) -> M::Phase {
        self.media.phase(collision, at)
    }

    fn normal(&self, volume: usize, position: DVec3) -> DVec3 {
        self.media.normal(volume, position)
    }
}
