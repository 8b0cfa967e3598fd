//! Light of near lights, from points that are drawn by their place about them.
//!
//! Near a light within a medium, light falls off by the squared distance, which collisions do not know of: light that is
//! looked for where rays collide varies without bound. Further points are therefore drawn near the light, and light is
//! looked for there, too: on the camera's ray with the density `D / (Δθ (D² + (t - t₀)²))`, even in the angle about the
//! light (equiangular sampling; Kulla & Fajardo 2012), and from each collision on a ray that is even in the angle to the
//! light, which makes the density `1 / (d² s²)` by the distances d from the light and s from the collision (joint
//! importance sampling; Georgiev et al. 2013).
//!
//! Both ways to the same light share it by a partition of unity: what is found at a point counts `w = ρ² / (1 + ρ²)`
//! where the point was drawn for the light, and `1 - w` where a ray collided; ρ is the ratio of the density of the
//! points that are drawn to that of rays times the extinction, which bounds that of collisions. Whatever ρ is, the mean
//! stays, since it is a function of the ray, the point on it and the light alone: no density of collisions is needed.
//!
//! Points take time that pays where the medium around the light is thin and its phase function wide: elsewhere, and of
//! lights outside the media, collisions find light as well, and scenes without near lights have kernels of their own.

use super::direct::Lighting;
use super::phase::PhaseFunction;
use super::tracking::Media;
use super::{Primary, Scratch};
use crate::math::{Aabb, Ray};
use crate::render::sampler::Sampler;
use crate::scene::light::{Arrival, Light, around};
use crate::scene::medium::Scattering;
use crate::scene::phase::Phase;
use glam::{DVec3, Vec3};
use std::f64::consts::{PI, TAU};

/// Distance from a light up to which points are drawn for it, and the least at which they pay, as shares of the diagonal
/// of the bounds of the media.
const REACH: [f64; 2] = [0.15, 0.1];
/// Largest radius of a sphere for which they pay, as a share of the diagonal.
const RADIUS: f64 = 0.05;
/// Largest mean cosine of phase functions with which they pay.
const WIDE: f64 = 0.6;
/// Optical depth around a light up to which points are drawn for it, and the number of places by which it is known.
const DEPTH: f64 = 1.1;
const POINTS: u32 = 64;
/// Chance of a point to be looked at, times the ratio of its light to that of the collision that it is drawn from.
const CHANCE: f64 = 0.3;
/// Least distance of a light from a ray, as a share of the diagonal of the bounds.
const LEAST: f64 = 1e-6;

/// The lights that points of segments are drawn for.
#[derive(Debug, Default)]
pub(super) struct NearLights {
    /// Each light of the scene; `None` for those that are far.
    lights: Vec<Option<Near>>,
    /// Centre and radius of a sphere beyond which none of them reaches.
    around: (DVec3, f64),
    /// Least distance of a light from a ray.
    least: f64,
}

/// A near light.
#[derive(Debug, Clone, Copy)]
struct Near {
    /// Probability that points are drawn for it.
    share: f64,
    /// Distance up to which they are.
    reach: f64,
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
    fn new(ray: &Ray, (from, to): (f64, f64), place: DVec3, [least, reach]: [f64; 2]) -> Option<Self> {
        let offset = place - ray.origin;
        let nearest = offset.dot(ray.direction);
        let distance = (offset - nearest * ray.direction).length();
        if distance >= reach {
            return None;
        }
        let half = (reach * reach - distance * distance).sqrt();
        let (from, to) = (from.max(nearest - half), to.min(nearest + half));
        let distance = distance.max(least);
        let [a, b] = [from - nearest, to - nearest];
        // The difference of two arctangents, of which little would be left from far away.
        let angle = (distance * (b - a)).atan2(distance * distance + a * b);
        (to > from && angle > 0.0).then_some(Self { from, to, nearest, distance, angle })
    }

    /// Returns the density per world length.
    #[inline(always)]
    fn density(&self, at: f64) -> f64 {
        if at < self.from || at > self.to {
            return 0.0;
        }
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

/// Density of directions from a point that is uniform in the angle to a place: with [`Equiangular`] on the ray, points
/// have the density `1 / (d² s²)` by their distances from both ends (Georgiev et al. 2013).
#[derive(Debug, Clone, Copy)]
struct Directions {
    /// Unit vector to the place.
    axis: DVec3,
    /// Greatest angle, beyond which no ray comes near.
    most: f64,
}

impl Directions {
    /// Returns the density of rays that come nearer than `reach`.
    #[inline(always)]
    fn new(from: DVec3, place: DVec3, reach: f64) -> Option<Self> {
        let offset = place - from;
        let distance = offset.length();
        let most = if distance > reach { (reach / distance).asin() } else { PI };
        (distance > 0.0).then(|| Self { axis: offset / distance, most })
    }

    /// Draws a direction by two numbers in [0, 1).
    #[inline(always)]
    fn draw(&self, [u, v]: [f64; 2]) -> DVec3 {
        let (sine, cosine) = (self.most * u).sin_cos();
        around(self.axis, cosine, sine, v)
    }

    /// Returns the density per steradian.
    #[inline(always)]
    fn density(&self, direction: DVec3) -> f64 {
        let cosine = self.axis.dot(direction);
        let sine = (direction - cosine * self.axis).length();
        if cosine < 0.0 && self.most < PI || sine > self.most.sin() && self.most < PI {
            return 0.0;
        }
        1.0 / (TAU * self.most * sine.max(f64::EPSILON))
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
        Light::Sphere { radius, radiance, .. } => mean(radiance) * PI * radius * radius,
        Light::Rectangle { edges: [u, v], radiance, .. } => mean(radiance) * u.cross(v).length(),
    }
}

/// Returns the middle of a light and the radius of a sphere around it; `None` of one that is infinitely far.
fn outline(light: &Light) -> Option<(DVec3, f64)> {
    match *light {
        Light::Rectangle { edges: [u, v], .. } => {
            Some((anchor(light, [0.5; 2])?.0, 0.5 * (u + v).length().max((u - v).length())))
        }
        _ => anchor(light, [0.0; 2]),
    }
}

impl NearLights {
    /// Finds the lights that are near to media within these bounds, of this extinction by place.
    pub(crate) fn new(lights: &[Light], bounds: Aabb, extinction: &dyn Fn(DVec3) -> f64) -> Self {
        let diagonal = bounds.size().length();
        if bounds.is_empty() || !diagonal.is_finite() {
            return Self::default();
        }
        let near = |light: &Light| {
            let (middle, radius) = outline(light)?;
            let inside = bounds.min.cmple(middle).all() && middle.cmple(bounds.max).all();
            let small = !matches!(light, Light::Sphere { .. }) || radius <= RADIUS * diagonal;
            if !(inside && small && intensity(light) > 0.0) {
                return None;
            }
            let reach = reach((middle, radius), REACH.map(|share| share * diagonal), extinction)?;
            Some(Near { share: intensity(light), reach })
        };
        let mut found: Vec<Option<Near>> = lights.iter().map(near).collect();
        let sum: f64 = found.iter().flatten().map(|near| near.share).sum();
        if !(sum > 0.0 && sum.is_finite()) {
            return Self::default();
        }
        found.iter_mut().flatten().for_each(|near| near.share /= sum);
        let spheres = || {
            let each = lights.iter().zip(&found).filter_map(|(light, near)| Some((outline(light)?, (*near)?.reach)));
            each.map(|((middle, radius), reach)| (middle, radius + reach))
        };
        let middle = spheres().map(|(middle, _)| middle).sum::<DVec3>() / spheres().count() as f64;
        // Rounding must not leave out what the sphere touches.
        let radius = spheres().map(|(at, radius)| (at - middle).length() + radius).fold(0.0, f64::max) * 1.001;
        Self { lights: found, around: (middle, radius), least: LEAST * diagonal }
    }

    /// Returns a light if it is near.
    #[inline(always)]
    fn get(&self, light: usize) -> Option<Near> {
        self.lights.get(light).copied().flatten()
    }

    /// True if a ray comes so near to a light that points may be drawn on it.
    #[inline(always)]
    fn reach(&self, ray: &Ray) -> bool {
        let (middle, radius) = self.around;
        let offset = middle - ray.origin;
        let along = offset.dot(ray.direction);
        let across = (offset - along * ray.direction).length_squared();
        across < radius * radius && (along > 0.0 || offset.length_squared() < radius * radius)
    }

    /// True if no light is near.
    pub(crate) fn is_empty(&self) -> bool {
        self.lights.is_empty()
    }

    /// Draws a light by a number in [0, 1).
    #[inline(always)]
    fn draw(&self, u: f64) -> usize {
        let mut sum = 0.0;
        let found = self.lights.iter().position(|near| {
            sum += near.map_or(0.0, |near| near.share);
            u < sum
        });
        // Rounding leaves no light that is far the rest.
        found.or_else(|| self.lights.iter().rposition(Option::is_some)).unwrap_or(0)
    }
}

/// Returns the distance from a light up to which points are drawn for it, of `[most, least]`; `None` where the medium is
/// so dense that rays collide often enough.
fn reach((middle, radius): (DVec3, f64), [most, least]: [f64; 2], extinction: &dyn Fn(DVec3) -> f64) -> Option<f64> {
    let mean = |reach: f64| {
        let sum = (0..POINTS).map(|i| {
            let [u, cosine, turn, _] = Sampler::new(0, [0; 2], i).stratified();
            let (cosine, distance) = (2.0 * cosine - 1.0, radius + reach * u.cbrt());
            extinction(middle + distance * around(DVec3::Z, cosine, (1.0 - cosine * cosine).sqrt(), turn))
        });
        sum.sum::<f64>() / f64::from(POINTS)
    };
    let reaches = (0..=8).map(|k| most + (least - most) * f64::from(k) / 8.0);
    reaches.into_iter().find(|reach| reach * mean(*reach) <= DEPTH)
}

/// True if points pay in a medium that scatters in this way.
pub(super) fn pay(scattering: &Scattering) -> bool {
    match scattering.phase {
        Phase::Isotropic => true,
        Phase::HenyeyGreenstein(g) => g.abs() <= WIDE,
    }
}

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

    /// Returns an estimate of the light of near lights that is scattered on a camera's ray, as far as it counts at
    /// points drawn by angle.
    #[inline(always)]
    pub(crate) fn along<M: Media>(
        &self,
        media: &M,
        (ray, primary): (&Ray, &Primary),
        sampler: &mut Sampler,
        scratch: &mut Scratch,
    ) -> Vec3 {
        if !self.near.reach(ray) {
            return Vec3::ZERO;
        }
        let [choice, u, of_light @ ..] = sampler.stratified();
        let number = self.near.draw(choice);
        let draw = Draw { ray: *ray, primary: Some(primary), number, of_light, u, turned: 1.0, phase: 1.0 };
        self.drawn(media, &draw, sampler, scratch).unwrap_or(Vec3::ZERO)
    }

    /// Returns an estimate of the light of near lights that is scattered at a point drawn by angle and, from there, at a
    /// collision of a path that arrives in direction `from`.
    #[inline(always)]
    pub(crate) fn around<M: Media>(
        &self,
        media: &M,
        (at, from, phase): (DVec3, DVec3, M::Phase),
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
        let phase = phase.value(from, direction);
        if phase <= 0.0 {
            return Vec3::ZERO;
        }
        let turned = directions.density(direction);
        let draw = Draw { ray: Ray { origin: at, direction }, primary: None, number, of_light, u, turned, phase };
        self.drawn(media, &draw, sampler, scratch).unwrap_or(Vec3::ZERO)
    }

    #[inline(always)]
    fn drawn<M: Media>(
        &self,
        media: &M,
        draw: &Draw<'_>,
        sampler: &mut Sampler,
        scratch: &mut Scratch,
    ) -> Option<Vec3> {
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
        let toward = Ray { origin: at, direction: arrival.direction };
        scratch.counts.shadow_rays += 1;
        let transmittance = media.transmittance(&toward, arrival.distance, sampler, scratch);
        if transmittance == Vec3::ZERO {
            return None;
        }
        let before = media.passed((ray, *primary), distance, sampler, scratch);
        let solid = if arrival.density.is_infinite() { 1.0 } else { arrival.density };
        let factor = phase * counts / (chance * density * solid);
        Some(arrival.radiance * scattered * before * transmittance * factor as f32)
    }
}

/// A ray on which a point is to be drawn.
struct Draw<'p> {
    ray: Ray,
    /// What was walked of a camera's ray.
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
