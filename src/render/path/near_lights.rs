//! The lights near which points are drawn.

use crate::math::{Aabb, Ray};
use crate::render::sampler::Sampler;
use crate::scene::directions::around;
use crate::scene::light::{Arrival, Light};
use crate::scene::medium::Scattering;
use crate::scene::phase::Phase;
use glam::{DVec3, Vec3};
use std::f64::consts::PI;

/// Distance from a light up to which points are drawn for it, and the least at which they pay, as shares of the
/// diagonal of the bounds of the media.
const REACH: [f64; 2] = [0.15, 0.1];
/// Largest radius of a sphere for which they pay, as a share of the diagonal.
const RADIUS: f64 = 0.05;
/// Largest mean cosine of phase functions with which they pay.
const WIDE: f64 = 0.6;
/// Optical depth around a light up to which points are drawn for it, and the number of places by which it is known.
const DEPTH: f64 = 1.1;
const POINTS: u32 = 64;
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
    pub(super) least: f64,
}

/// A near light.
#[derive(Debug, Clone, Copy)]
pub(super) struct Near {
    /// Probability that points are drawn for it.
    pub share: f64,
    /// Distance up to which they are.
    pub reach: f64,
}

/// Returns the place by whose direction points are drawn, and the distance from it in which there are none.
#[inline(always)]
pub(super) fn anchor(light: &Light, of_light: [f64; 2]) -> Option<(DVec3, f64)> {
    match *light {
        Light::Sun { .. } => None,
        Light::Point { position, .. } => Some((position, 0.0)),
        Light::Sphere { centre, radius, .. } => Some((centre, radius)),
        // A disc lights what is within its radius, too.
        Light::Disc { centre, .. } => Some((centre, 0.0)),
        Light::Spot { position, radius, soft, .. } => Some((position, if soft { 0.0 } else { radius })),
        Light::Rectangle { corner, edges: [u, v], .. } => Some((corner + of_light[0] * u + of_light[1] * v, 0.0)),
    }
}

/// Returns the anchor of a light whose light arrives at a point.
#[inline(always)]
pub(super) fn anchor_of(light: &Light, from: DVec3, arrival: &Arrival) -> Option<(DVec3, f64)> {
    match light {
        Light::Rectangle { .. } => Some((from + arrival.distance * arrival.direction, 0.0)),
        light => anchor(light, [0.0; 2]),
    }
}

/// Returns the radiant intensity of a light as seen from far away in front of it, the mean of the channels; 0 of a
/// light that is infinitely far.
fn intensity(light: &Light) -> f64 {
    let mean = |light: Vec3| f64::from(light.element_sum()) / 3.0;
    match *light {
        Light::Sun { .. } => 0.0,
        Light::Point { intensity, .. } | Light::Spot { intensity, .. } => mean(intensity),
        Light::Sphere { radius, radiance, .. } | Light::Disc { radius, radiance, .. } => {
            mean(radiance) * PI * radius * radius
        }
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
            let ball = match *light {
                Light::Disc { radius, .. } | Light::Spot { radius, .. } => radius,
                Light::Sphere { .. } => radius,
                _ => 0.0,
            };
            let small = ball <= RADIUS * diagonal;
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
    pub(super) fn get(&self, light: usize) -> Option<Near> {
        self.lights.get(light).copied().flatten()
    }

    /// True if a ray comes so near to a light that points may be drawn on it.
    #[inline(always)]
    pub(super) fn reach(&self, ray: &Ray) -> bool {
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
    pub(super) fn draw(&self, u: f64) -> usize {
        let mut sum = 0.0;
        let found = self.lights.iter().position(|near| {
            sum += near.map_or(0.0, |near| near.share);
            u < sum
        });
        // Rounding leaves no light that is far the rest.
        found.or_else(|| self.lights.iter().rposition(Option::is_some)).unwrap_or(0)
    }
}

/// Returns the distance from a light up to which points are drawn for it, of `[most, least]`; `None` where the medium
/// is so dense that rays collide often enough.
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
