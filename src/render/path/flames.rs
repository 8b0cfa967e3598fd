//! Emission by grids of several volumes, or beside chromatic media: rays through it are sampled.
//!
//! A point of the ray is drawn by the strength of the emission there, and its light dimmed by all media before it.

use super::emissive::Glow;
use super::tracking::Media;
use super::{Primary, Scratch};
use crate::error::Result;
use crate::math::Ray;
use crate::render::deep::Event;
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

/// Grids of several volumes that emit.
pub(super) struct Flames<'a>(Vec<Flame<'a>>);

impl<'a> Flames<'a> {
    /// Prepares the emission of volumes.
    ///
    /// # Errors
    /// If an emission cannot be rendered.
    pub(crate) fn new(emitted: impl Iterator<Item = &'a Emitted>) -> Result<Self> {
        let flame = |emitted: &'a Emitted| {
            let strength = Dvr::new(emitted.strength(), Medium::absorbing(1.0))?.early_stop(0.0);
            Ok(Flame { emission: emitted.grid(), strength })
        };
        Ok(Self(emitted.map(flame).collect::<Result<_>>()?))
    }
}

impl Glow for Flames<'_> {
    fn emitted(
        &self,
        media: &impl Media,
        ray: &Ray,
        primary: Option<&Primary>,
        sampler: &mut Sampler,
        scratch: &mut Scratch,
    ) -> Vec3 {
        let mut sum = Vec3::ZERO;
        // What is beyond the end is drawn and counts for nothing, so that all else is that of the whole ray.
        let (far, ray) = (ray.far, &Ray::new(ray.origin, ray.direction));
        for Flame { emission, strength } in &self.0 {
            let walked = strength.walk(ray, &mut scratch.tape);
            let depth = sampler.uniform() * walked.depth;
            let Some((distance, _)) = strength.locate(&walked, depth, &mut scratch.tape) else { continue };
            let radiance = at(emission, ray.at(distance));
            let mean = radiance.element_sum() / 3.0;
            if mean > 0.0 {
                let transmittance = media.transmittance(ray, distance, sampler, scratch);
                let light = radiance * (walked.depth as f32 / mean) * transmittance;
                match &mut scratch.apart {
                    _ if distance > far => {}
                    Some(apart) if primary.is_some() => {
                        apart.push(Event { distance, unscattered: light, ..Event::default() });
                    }
                    _ => sum += light,
                }
            }
        }
        sum
    }
}

/// Returns the radiance emitted per world length at a world position.
fn at(emission: &Bricks<Vec4>, position: DVec3) -> Vec3 {
    let corners = emission.corners(emission.transform.to_index(position)).into_iter().flatten();
    corners.map(|(voxel, weight)| emission.values[voxel].truncate() * weight as f32).sum()
}
