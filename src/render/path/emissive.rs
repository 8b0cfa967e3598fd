//! Media beside which grids emit, such as fire.

use super::tracking::{Collision, LEAST_TRANSMITTANCE, Media, Visible};
use super::{Primary, Scratch};
use crate::math::Ray;
use crate::render::dvr::TracedRay;
use crate::render::emission_absorption::EmissionAbsorption;
use crate::render::preshaded::Preshaded;
use crate::render::sampler::Sampler;
use crate::scene::emission::Emitted;
use glam::{DVec3, Vec3};

/// Emission by grids beside media.
pub(super) trait Glow: Sync + Send {
    /// Returns the radiance along a camera's ray that all paths from it share.
    fn shared(&self, _: &Ray, _: &mut Scratch) -> Vec3 {
        Vec3::ZERO
    }
    /// Returns an estimate of the radiance along a world ray of unit direction through the media, which may be a
    /// camera's ray that was walked before.
    fn emitted(
        &self,
        media: &impl Media,
        ray: &Ray,
        primary: Option<&Primary>,
        sampler: &mut Sampler,
        scratch: &mut Scratch,
    ) -> Vec3;
}

/// Emission of the only volume, with the extinction of its medium: it needs no collisions, and rays through it are
/// integrated.
pub(super) struct Integrated<'a>(Preshaded<'a, f32>);

impl<'a> Integrated<'a> {
    /// Creates the integrator of an emission.
    pub(crate) fn new(emission: &'a Emitted) -> Self {
        Self(Preshaded::new(emission.grid()).early_stop(LEAST_TRANSMITTANCE))
    }

    #[inline(always)]
    fn radiance(&self, ray: &Ray, scratch: &mut Scratch) -> Vec3 {
        DVec3::from_array(self.0.integrate(ray, &mut scratch.emission).rgb).as_vec3()
    }
}

impl Glow for Integrated<'_> {
    #[inline(always)]
    fn shared(&self, ray: &Ray, scratch: &mut Scratch) -> Vec3 {
        self.radiance(ray, scratch)
    }

    #[inline(always)]
    fn emitted(
        &self,
        _: &impl Media,
        ray: &Ray,
        primary: Option<&Primary>,
        _: &mut Sampler,
        scratch: &mut Scratch,
    ) -> Vec3 {
        primary.map_or_else(|| self.radiance(ray, scratch), |primary| primary.emitted)
    }
}

/// Media with the emission beside them.
pub(super) struct Emissive<M, G> {
    /// Media.
    pub media: M,
    /// Emission.
    pub glow: G,
}

impl<M: Media, G: Glow> Media for Emissive<M, G> {
    type Phase = M::Phase;
    const EMITS: bool = M::EMITS;
    const GLOWS: bool = true;
    const DRAWS: bool = M::DRAWS;

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
    fn primary(&self, ray: &Ray, scratch: &mut Scratch) -> Primary {
        Primary { emitted: self.glow.shared(ray, scratch), ..self.media.primary(ray, scratch) }
    }

    fn optical_depth(&self, ray: &Ray, scratch: &mut Scratch) -> DVec3 {
        self.media.optical_depth(ray, scratch)
    }

    #[inline(always)]
    fn emitted(&self, ray: &Ray, primary: Option<&Primary>, sampler: &mut Sampler, scratch: &mut Scratch) -> Vec3 {
        self.glow.emitted(&self.media, ray, primary, sampler, scratch)
    }

    fn walk(&self, ray: &Ray, scratch: &mut Scratch) -> Option<TracedRay> {
        self.media.walk(ray, scratch)
    }

    fn depth_before(&self, walked: &TracedRay, length: f64, scratch: &Scratch) -> f64 {
        self.media.depth_before(walked, length, scratch)
    }

    fn glow(&self, part: &Ray, scratch: &mut Scratch) -> Vec3 {
        self.glow.shared(part, scratch)
    }

    #[inline(always)]
    fn first(&self, ray: &Ray, primary: &Primary, sampler: &mut Sampler, scratch: &mut Scratch) -> Visible {
        self.media.first(ray, primary, sampler, scratch)
    }

    #[inline(always)]
    fn transmittance(&self, ray: &Ray, length: f64, sampler: &mut Sampler, scratch: &mut Scratch) -> Vec3 {
        self.media.transmittance(ray, length, sampler, scratch)
    }

    #[inline(always)]
    fn passed(
        &self,
        from: (&Ray, Option<&Primary>),
        length: f64,
        sampler: &mut Sampler,
        scratch: &mut Scratch,
    ) -> Vec3 {
        self.media.passed(from, length, sampler, scratch)
    }

    #[inline(always)]
    fn range(&self, ray: &Ray) -> Option<(f64, f64)> {
        self.media.range(ray)
    }

    #[inline(always)]
    fn extinction(&self, at: DVec3) -> f64 {
        self.media.extinction(at)
    }

    #[inline(always)]
    fn scattered(&self, at: DVec3, from: DVec3, to: DVec3) -> Vec3 {
        self.media.scattered(at, from, to)
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
