//! Light of near lights: equiangular sampling (Kulla & Fajardo 2012).
//!
//! Near a light within a medium, light falls off by the squared distance, which collisions do not know of: light that is
//! looked for where rays collide varies without bound. On each segment of a path a further point is therefore drawn by
//! the angle that it turns about the light, with the density `D / (Δθ (D² + (t - t₀)²))`, and light is looked for there,
//! too.
//!
//! Both ways to the same light share it by a partition of unity: what is found at a point of the segment counts `w =
//! ρ² / (1 + ρ²)` where the point was drawn by its angle, and `1 - w` where the ray collided; ρ is the ratio of the
//! density of points drawn by angle to the extinction, which bounds that of collisions. Whatever ρ is, the mean stays,
//! since it is a function of the segment, the point on it and the light alone: no density of collisions is needed.
//! Points are drawn more seldom where collisions find light as well.

use super::direct::Lighting;
use super::tracking::Media;
use super::Scratch;
use crate::math::{Aabb, Ray};
use crate::render::sampler::Sampler;
use crate::scene::light::{Arrival, Light};
use glam::{DVec3, Vec3};

/// Lights within the bounds of the media, or as near to them as this share of their diagonal, are near.
const REACH: f64 = 0.25;
/// Least distance of a light from a ray, as a share of the diagonal of the bounds.
const LEAST: f64 = 1e-6;

/// The lights that points of segments are drawn for.
#[derive(Debug, Default)]
pub(super) struct NearLights {
    /// Probability of each light of the scene: 0 for those that are far.
    shares: Vec<f64>,
    /// Least distance of a light from a ray.
    least: f64,
}

/// Density of points of a segment by the angle that they turn about a place.
#[derive(Debug, Clone, Copy)]
struct Equiangular {
    /// Ends of the segment.
    from: f64,
    to: f64,
    /// World length along the ray to where it is nearest to the place, and its distance there.
    nearest: f64,
    distance: f64,
    /// Angle between both ends.
    angle: f64,
}

impl Equiangular {
    /// Returns the density on a part of a ray of unit direction; `None` if all of it is seen in one direction.
    #[inline(always)]
    fn new(ray: &Ray, (from, to): (f64, f64), place: DVec3, least: f64) -> Option<Self> {
        let offset = place - ray.origin;
        let nearest = offset.dot(ray.direction);
        let distance = (offset - nearest * ray.direction).length().max(least);
        let [a, b] = [from - nearest, to - nearest];
        // The difference of two arctangents, of which little would be left from far away.
        let angle = (distance * (b - a)).atan2(distance * distance + a * b);
        (angle > 0.0).then_some(Self { from, to, nearest, distance, angle })
    }

    /// Returns the density per world length.
    #[inline(always)]
    fn density(&self, at: f64) -> f64 {
        let along = at - self.nearest;
        self.distance / (self.angle * (self.distance * self.distance + along * along))
    }

    /// Draws a point by a number in [0, 1), and returns its world length along the ray.
    #[inline(always)]
    fn draw(&self, u: f64) -> f64 {
        let first = ((self.from - self.nearest) / self.distance).atan();
        (self.nearest + self.distance * (first + u * self.angle).tan()).clamp(self.from, self.to)
    }
}

/// Returns the place by whose direction points are drawn, and the distance from it in which there are none.
#[inline(always)]
fn anchor(light: &Light, of_light: [f64; 2]) -> Option<(DVec3, f64)> {
    match *light {
        Light::Sun { .. } => None,
        Light::Point { position, .. } => Some((position, 0.0)),
        Light::Sphere { centre, radius, .. } => Some((centre, radius)),
        Light::Rectangle { corner, edges: [u, v], .. } => Some((corner + of_light[0] * u + of_light[1] * v, 0.0)),
    }
}

/// Returns the anchor of a light whose light arrives at a point.
#[inline(always)]
fn anchor_of(light: &Light, from: DVec3, arrival: &Arrival) -> Option<(DVec3, f64)> {
    match light {
        Light::Rectangle { .. } => Some((from + arrival.distance * arrival.direction, 0.0)),
        light => anchor(light, [0.0; 2]),
    }
}

/// Returns the radiant intensity of a light as seen from far away in front of it, the mean of the channels; 0 of a light
/// that is infinitely far.
fn intensity(light: &Light) -> f64 {
    let mean = |light: Vec3| f64::from(light.element_sum()) / 3.0;
    match *light {
        Light::Sun { .. } => 0.0,
        Light::Point { intensity, .. } => mean(intensity),
        Light::Sphere { radius, radiance, .. } => mean(radiance) * std::f64::consts::PI * radius * radius,
        Light::Rectangle { edges: [u, v], radiance, .. } => mean(radiance) * u.cross(v).length(),
    }
}

impl NearLights {
    /// Finds the lights that are near to media within these bounds.
    pub(crate) fn new(lights: &[Light], bounds: Aabb) -> Self {
        let diagonal = bounds.size().length();
        if bounds.is_empty() || !diagonal.is_finite() {
            return Self::default();
        }
        let near = |light: &Light| {
            let (middle, radius) = match *light {
                Light::Rectangle { edges: [u, v], .. } => (anchor(light, [0.5; 2])?.0, 0.5 * (u + v).length()),
                _ => anchor(light, [0.0; 2])?,
            };
            let off = (middle.clamp(bounds.min, bounds.max) - middle).length() - radius;
            (off <= REACH * diagonal).then(|| intensity(light))
        };
        let intensities: Vec<f64> = lights.iter().map(|light| near(light).unwrap_or(0.0)).collect();
        let sum: f64 = intensities.iter().sum();
        if !(sum > 0.0 && sum.is_finite()) {
            return Self::default();
        }
        Self { shares: intensities.iter().map(|v| v / sum).collect(), least: LEAST * diagonal }
    }

    /// True if no light is near.
    pub(crate) fn is_empty(&self) -> bool {
        self.shares.is_empty()
    }

    /// Draws a light by a number in [0, 1).
    #[inline(always)]
    fn draw(&self, u: f64) -> usize {
        let mut sum = 0.0;
        let found = self.shares.iter().position(|share| {
            sum += share;
            u < sum
        });
        // Rounding leaves no light that is far the rest.
        found.or_else(|| self.shares.iter().rposition(|share| *share > 0.0)).unwrap_or(0)
    }
}

/// A collision at the end of a segment, whose light is shared with points that are drawn by angle.
pub(super) struct End<'m, M> {
    pub media: &'m M,
    pub lighting: &'m Lighting,
    /// Ray of the segment, and the world length along it to the collision.
    pub ray: Ray,
    pub distance: f64,
}

impl<M: Media> End<'_, M> {
    /// Returns the ratio ρ for what arrives at the collision from one of the lights; 0 of those that are far.
    #[inline(always)]
    fn ratio(&self, light: usize, arrival: &Arrival) -> f64 {
        let Self { media, lighting, ray, distance } = self;
        let near = &lighting.near;
        let share = near.shares.get(light).copied().unwrap_or(0.0);
        if share == 0.0 {
            return 0.0;
        }
        let at = ray.at(*distance);
        let Some((place, within)) = anchor_of(&lighting.lights[light], at, arrival) else { return 0.0 };
        let Some(range) = media.range(ray) else { return 0.0 };
        let Some(points) = Equiangular::new(ray, range, place, within.max(near.least)) else { return 0.0 };
        lighting.ratio(share * points.density(*distance), media.extinction(at))
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
    /// Returns the ratio of the densities with which light is looked for at a point, by angle and where rays collide.
    #[inline(always)]
    fn ratio(&self, density: f64, extinction: f64) -> f64 {
        // Of more, the square overflows.
        (density * self.count() / extinction).min(1e100)
    }

    /// Returns an estimate of the light of near lights that is scattered on a ray, as far as it counts at points drawn
    /// by angle.
    #[inline(always)]
    pub(crate) fn along<M: Media>(
        &self,
        media: &M,
        ray: &Ray,
        sampler: &mut Sampler,
        scratch: &mut Scratch,
    ) -> Vec3 {
        let numbers = sampler.stratified();
        self.drawn(media, ray, numbers, sampler, scratch).unwrap_or(Vec3::ZERO)
    }

    #[inline(always)]
    fn drawn<M: Media>(
        &self,
        media: &M,
        ray: &Ray,
        [choice, u, a, b]: [f64; 4],
        sampler: &mut Sampler,
        scratch: &mut Scratch,
    ) -> Option<Vec3> {
        let (number, of_light) = (self.near.draw(choice), [a, b]);
        let light = self.lights.get(number)?;
        let (place, within) = anchor(light, of_light)?;
        let points = Equiangular::new(ray, media.range(ray)?, place, within.max(self.near.least))?;
        let distance = points.draw(u);
        let at = ray.at(distance);
        scratch.counts.lookups += 1;
        let extinction = media.extinction(at);
        if extinction <= 0.0 {
            return None;
        }
        let density = self.near.shares[number] * points.density(distance);
        let ratio = self.ratio(density, extinction);
        let chance = ratio.min(1.0);
        if chance < 1.0 && sampler.uniform() >= chance {
            return None;
        }
        let arrival = light.sample(at, of_light)?;
        let scattered = media.scattered(at, ray.direction, arrival.direction);
        if scattered == Vec3::ZERO {
            return None;
        }
        let before = media.transmittance(ray, distance, sampler, scratch);
        if before == Vec3::ZERO {
            return None;
        }
        let toward = Ray { origin: at, direction: arrival.direction };
        scratch.counts.shadow_rays += 1;
        let transmittance = media.transmittance(&toward, arrival.distance, sampler, scratch);
        let solid = if arrival.density.is_infinite() { 1.0 } else { arrival.density };
        let counts = ratio * ratio / (1.0 + ratio * ratio);
        Some(arrival.radiance * scattered * before * transmittance * (counts / (chance * density * solid)) as f32)
    }
}
