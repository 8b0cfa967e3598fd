//! Light of near lights, from points that are drawn by their place about them.
//!
//! Near a light within a medium, light falls off by the squared distance, which collisions do not know of: light that
//! is looked for where rays collide varies without bound. Further points are therefore drawn near the light, and light
//! is looked for there, too: on the camera's ray with the density `D / (Δθ (D² + (t - t₀)²))`, even in the angle about
//! the light (equiangular sampling; Kulla & Fajardo 2012), and from each collision on a ray that is even in the angle
//! to the light, which makes the density `1 / (d² s²)` by the distances d from the light and s from the collision
//! (joint importance sampling; Georgiev et al. 2013).
//!
//! Both ways to the same light share it by a partition of unity: what is found at a point counts `w = ρ² / (1 + ρ²)`
//! where the point was drawn for the light, and `1 - w` where a ray collided; ρ is the ratio of the density of the
//! points that are drawn to that of rays times the extinction, which bounds that of collisions. Whatever ρ is, the mean
//! stays, since it is a function of the ray, the point on it and the light alone: no density of collisions is needed.
//!
//! Points take time that pays where the medium around the light is thin and its phase function wide: elsewhere, and of
//! lights outside the media, collisions find light as well, and scenes without near lights have kernels of their own.

mod equiangular;

use super::direct::Lighting;
use super::near_lights::{Near, anchor, anchor_of};
use super::phase::PhaseFunction;
use super::tracking::Media;
use super::{Primary, Scratch};
use crate::math::Ray;
use crate::render::sampler::Sampler;
use crate::scene::light::{Arrival, Light};
use equiangular::{Directions, Equiangular};
use glam::{DVec3, Vec3};

/// Chance of a point to be looked at, times the ratio of its light to that of the collision that it is drawn from.
const CHANCE: f64 = 0.3;

/// A collision at the end of a segment, whose light is shared with points that are drawn by angle.
pub(super) struct End<'m, M> {
    pub media: &'m M,
    pub lighting: &'m Lighting,
    /// Ray of the segment, and the world length along it to the collision.
    pub ray: Ray,
    pub distance: f64,
    /// Density with which the phase function drew the ray's direction; `None` of a camera's ray.
    pub drawn: Option<f64>,
}

impl<M: Media> End<'_, M> {
    /// Returns the ratio ρ for what arrives at the collision from one of the lights; 0 of those that are far.
    #[inline(always)]
    fn ratio(&self, light: usize, arrival: &Arrival) -> f64 {
        let Self { media, lighting, ray, distance, drawn } = self;
        let near = &lighting.near;
        let Some(Near { share, reach }) = near.get(light) else { return 0.0 };
        let at = ray.at(*distance);
        let Some((place, within)) = anchor_of(&lighting.lights[light], at, arrival) else { return 0.0 };
        if (place - at).length_squared() > (reach + within) * (reach + within) {
            return 0.0;
        }
        let Some(range) = media.range(ray) else { return 0.0 };
        let ends = [within.max(near.least), within + reach];
        let Some(points) = Equiangular::new(ray, range, place, ends) else { return 0.0 };
        let turned = match drawn {
            Some(phase) => {
                Directions::new(ray.origin, place, within + reach).map_or(0.0, |d| d.density(ray.direction)) / phase
            }
            None => 1.0,
        };
        lighting.ratio(share * turned * points.density(*distance), media.extinction(at))
    }

    /// Returns the share of a light that counts at the collision.
    #[inline(always)]
    pub(crate) fn left(&self, light: usize, arrival: &Arrival) -> f32 {
        let ratio = self.ratio(light, arrival);
        (1.0 / (1.0 + ratio * ratio)) as f32
    }

    /// Returns what the light that was drawn is to be multiplied by; 0 in place of most of what would count little.
    #[inline(always)]
    pub(crate) fn thinned(&self, light: usize, arrival: &Arrival, sampler: &mut Sampler) -> f32 {
        let left = self.left(light, arrival);
        let chance = left.sqrt();
        if chance >= 1.0 || (sampler.uniform() as f32) < chance { left / chance } else { 0.0 }
    }
}

impl Lighting {
    /// Returns the ratio of the densities with which light is looked for at a point, drawn for the light and where rays
    /// collide; 0 where the latter is greater, since points then pay little.
    #[inline(always)]
    fn ratio(&self, density: f64, extinction: f64) -> f64 {
        let ratio = density * self.count() / extinction;
        // Of more, the square overflows.
        if ratio > 1.0 { ratio.min(1e100) } else { 0.0 }
    }

    /// Returns an estimate of the light of near lights that is scattered on a camera's ray, wherever the ray ends, as
    /// far as it counts at points drawn by angle, with the distance at which it is scattered.
    #[inline(always)]
    pub(crate) fn along<M: Media>(
        &self,
        media: &M,
        (ray, primary): (&Ray, &Primary),
        sampler: &mut Sampler,
        scratch: &mut Scratch,
    ) -> Option<(f64, Vec3)> {
        if !self.near.reach(ray) {
            return None;
        }
        let [choice, u, of_light @ ..] = sampler.stratified();
        let number = self.near.draw(choice);
        let ray = Ray::new(ray.origin, ray.direction);
        let draw = Draw { ray, primary: Some(primary), number, of_light, u, turned: 1.0, phase: 1.0 };
        self.drawn(media, &draw, sampler, scratch)
    }

    /// Returns an estimate of the light of near lights that is scattered at a point drawn by angle and, from there, at
    /// a collision of a path that arrives in direction `from`.
    #[inline(always)]
    pub(crate) fn around<M: Media>(
        &self,
        media: &M,
        (at, from, phase, albedo): (DVec3, DVec3, M::Phase, Vec3),
        sampler: &mut Sampler,
        scratch: &mut Scratch,
    ) -> Vec3 {
        let [choice, u, direction @ ..] = sampler.stratified();
        let number = self.near.draw(choice);
        let (Some(light), Some(near)) = (self.lights.get(number), self.near.get(number)) else { return Vec3::ZERO };
        let of_light = match light {
            Light::Point { .. } => [0.0; 2],
            _ => [sampler.uniform(), sampler.uniform()],
        };
        let Some((place, within)) = anchor(light, of_light) else { return Vec3::ZERO };
        let Some(directions) = Directions::new(at, place, within + near.reach) else { return Vec3::ZERO };
        let direction = directions.draw(direction);
        let tint = if M::Phase::COLORED { phase.tint(albedo, from, direction) } else { Vec3::ONE };
        let phase = phase.value(from, direction);
        if phase <= 0.0 {
            return Vec3::ZERO;
        }
        let turned = directions.density(direction);
        let draw = Draw { ray: Ray::new(at, direction), primary: None, number, of_light, u, turned, phase };
        let (_, found) = self.drawn(media, &draw, sampler, scratch).unwrap_or_default();
        if M::Phase::COLORED { found * tint } else { found }
    }

    #[inline(always)]
    fn drawn<M: Media>(
        &self,
        media: &M,
        draw: &Draw<'_>,
        sampler: &mut Sampler,
        scratch: &mut Scratch,
    ) -> Option<(f64, Vec3)> {
        let Draw { ray, primary, number, of_light, u, turned, phase } = draw;
        let (light, Near { share, reach }) = (self.lights.get(*number)?, self.near.get(*number)?);
        let (place, within) = anchor(light, *of_light)?;
        let points = Equiangular::new(ray, media.range(ray)?, place, [within.max(self.near.least), within + reach])?;
        let distance = points.draw(*u);
        let at = ray.at(distance);
        scratch.counts.lookups += 1;
        let extinction = media.extinction(at);
        if extinction <= 0.0 {
            return None;
        }
        let density = share * turned * points.density(distance);
        let ratio = self.ratio(density / phase, extinction);
        if ratio == 0.0 {
            return None;
        }
        let counts = ratio * ratio / (1.0 + ratio * ratio);
        let mut chance = 1.0;
        if primary.is_none() {
            let nearer = (place - ray.origin).length_squared() / (place - at).length_squared();
            chance = (CHANCE * extinction * nearer * counts / density).min(1.0);
            if chance < 1.0 && sampler.uniform() >= chance {
                return None;
            }
        }
        let arrival = light.sample(at, *of_light)?;
        let scattered = media.scattered(at, ray.direction, arrival.direction);
        if scattered == Vec3::ZERO {
            return None;
        }
        let toward = Ray::new(at, arrival.direction);
        scratch.counts.shadow_rays += 1;
        let transmittance = media.transmittance(&toward, arrival.distance, sampler, scratch);
        if transmittance == Vec3::ZERO {
            return None;
        }
        let before = media.passed((ray, *primary), distance, sampler, scratch);
        let solid = if arrival.density.is_infinite() { 1.0 } else { arrival.density };
        let factor = phase * counts / (chance * density * solid);
        Some((distance, arrival.radiance * scattered * before * transmittance * factor as f32))
    }
}

/// A ray on which a point is to be drawn.
struct Draw<'p> {
    ray: Ray,
    /// Way of a camera's ray that was walked.
    primary: Option<&'p Primary>,
    /// Number of the light.
    number: usize,
    /// Numbers in [0, 1) by which the light and the point are drawn.
    of_light: [f64; 2],
    u: f64,
    /// Density with which the ray's direction was drawn, and the phase function's value for it; 1 of a camera's ray.
    turned: f64,
    phase: f64,
}
