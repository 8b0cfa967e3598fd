//! A volume of labels as paths meet it: collisions are drawn from transmittances in closed form, voxel by voxel.

use super::optics::{Any, ByDensity, DensityMedium};
use super::phase::{PhaseFunction, Phases, Shaded};
use super::specular::{Glossed, Glossy};
use super::tracking::{Collision, LEAST_TRANSMITTANCE, Media, Visible};
use super::{Primary, Scratch};
use crate::error::Result;
use crate::math::Ray;
use crate::render::gradient::gradient;
use crate::render::labels::{Labels, gradient_scale};
use crate::render::sampler::Sampler;
use crate::scene::bricks::Bricks;
use crate::scene::medium::{Medium, Scattering};
use glam::{DVec3, Vec3};

/// One volume of labels.
pub(super) struct Labelled<'a> {
    labels: Labels<'a>,
    optics: ByDensity<Any>,
    albedo: Vec3,
    phases: Glossy,
    /// Opacities of the voxels, whose gradients are those of surfaces.
    opacity: Bricks<f32>,
}

impl<'a> Labelled<'a> {
    /// Prepares a volume and its medium, whose function is one of labels.
    ///
    /// # Errors
    /// If the medium cannot be used.
    pub(super) fn new(field: &'a Bricks<f32>, medium: &Medium) -> Result<Self> {
        let medium = medium.clone().checked()?;
        let smooth = |scattering: Scattering| Scattering {
            gradient_scale: gradient_scale(scattering.gradient_scale),
            ..scattering
        };
        let scattering = medium.scattering.map(smooth);
        let labels = Labels::new(field, &medium.densest_channel())?;
        Ok(Self {
            opacity: labels.opacity(),
            labels,
            optics: ByDensity::new(Any::new(&medium.clone().relative_to(field.reference)), &medium, field.reference),
            albedo: Vec3::from_array(scattering.map_or([0.0; 3], |scattering| scattering.albedo)),
            phases: Glossy::new(Shaded::new(scattering), scattering),
        })
    }

    /// Returns the optical depth of the first `length` of a ray, or one above `limit`.
    fn depth(&self, ray: &Ray, length: f64, limit: f64) -> f64 {
        let mut depth = 0.0;
        let ray = Ray { far: ray.far.min(length), ..*ray };
        self.labels.segments(&ray, |segment| {
            depth += segment.depth();
            depth <= limit
        });
        depth
    }

    /// Returns where the optical depth of a ray comes to `depth`.
    fn locate(&self, ray: &Ray, depth: f64) -> Option<Collision> {
        let (mut left, mut found) = (depth, None);
        self.labels.segments(ray, |segment| {
            if segment.depth() > left {
                let distance = (segment.start + left / segment.extinction).min(segment.end);
                found = Some(Collision { distance, density: segment.label, volume: 0 });
                return false;
            }
            left -= segment.depth();
            true
        });
        found
    }
}

impl Media for Labelled<'_> {
    type Phase = Glossed;
    const EMITS: bool = true;

    fn collide(&self, ray: &Ray, _: Vec3, sampler: &mut Sampler, scratch: &mut Scratch) -> Option<(Collision, Vec3)> {
        scratch.counts.lookups += 1;
        self.locate(ray, sampler.exponential().into()).map(|collision| (collision, Vec3::ONE))
    }

    fn survival(&self, _: &Ray, _: f64, _: Vec3, _: &mut Scratch) -> Vec3 {
        Vec3::ONE
    }

    fn primary(&self, ray: &Ray, scratch: &mut Scratch) -> Primary {
        Primary { depths: self.optical_depth(ray, scratch), ..Primary::default() }
    }

    fn optical_depth(&self, ray: &Ray, _: &mut Scratch) -> DVec3 {
        DVec3::splat(self.depth(ray, f64::INFINITY, f64::INFINITY))
    }

    /// The transmittance is exact, and every ray that meets the medium collides with it.
    fn first(&self, ray: &Ray, primary: &Primary, sampler: &mut Sampler, _: &mut Scratch) -> Visible {
        let [u, spare, ..] = sampler.stratified();
        let depth = primary.depths.x;
        let share = -(-depth).exp_m1();
        let found = if depth > 0.0 { self.locate(ray, -(-u * share).ln_1p()) } else { None };
        let collision = found.map(|collision| (collision, Vec3::splat(share as f32)));
        Visible { transmittance: Vec3::splat((-depth).exp() as f32), collision, spare }
    }

    fn transmittance(&self, ray: &Ray, length: f64, _: &mut Sampler, _: &mut Scratch) -> Vec3 {
        let limit = -LEAST_TRANSMITTANCE.ln();
        let depth = self.depth(ray, length, limit);
        Vec3::splat(if depth > limit { 0.0 } else { (-depth).exp() as f32 })
    }

    fn range(&self, ray: &Ray) -> Option<(f64, f64)> {
        self.labels.index_ray(&Ray::new(ray.origin, ray.direction)).map(|ray| (ray.enter, ray.leave))
    }

    fn extinction(&self, at: DVec3) -> f64 {
        self.labels.at(at).map_or(0.0, |(_, extinction)| extinction.into())
    }

    fn scattered(&self, at: DVec3, from: DVec3, to: DVec3) -> Vec3 {
        let Some((label, extinction)) = self.labels.at(at) else { return Vec3::ZERO };
        self.phases.at(&self.opacity, at).color(self.optics.albedo(label, self.albedo), from, to) * extinction
    }

    fn albedo(&self, collision: &Collision) -> Vec3 {
        self.optics.albedo(collision.density, self.albedo)
    }

    fn source(&self, collision: &Collision) -> Vec3 {
        self.optics.source(collision.density)
    }

    fn phase(&self, _: &Collision, at: DVec3) -> Glossed {
        self.phases.at(&self.opacity, at)
    }

    fn normal(&self, _: usize, position: DVec3) -> DVec3 {
        -gradient(&self.opacity, self.opacity.transform.to_index(position), gradient_scale(0.0)).normalize_or_zero()
    }
}
