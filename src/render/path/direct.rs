//! Light that arrives at a point straight from its source: drawn from the lights, or met by a ray that the phase
//! function chose, both weighted by their probabilities (multiple importance sampling; Veach & Guibas 1995).

use super::near_lights::NearLights;
use crate::error::Result;
use crate::math::{Aabb, Ray};
use crate::scene::environment::Environment;
use crate::scene::light::{Arrival, Light};
use glam::{DVec3, Vec3};

/// The lights of a scene.
pub(super) struct Lighting {
    pub lights: Vec<Light>,
    /// Lights inside the media, near which points are drawn.
    pub near: NearLights,
    environment: Environment,
    /// Radiance that the camera sees behind the media in place of the environment.
    pub background: Option<Vec3>,
    /// How many times as often as by chance first collisions of camera rays scatter light, at most always.
    pub often: f64,
}

/// [`Lighting::often`] where there are lights: it has most of the gain of always, for less time where little is met.
const OFTEN: f64 = 2.0;

/// Returns the power heuristic's weight of a direction drawn with density `own`, where another technique draws it with
/// density `other`.
#[inline(always)]
pub(super) fn heuristic(own: f64, other: f64) -> f64 {
    // The ratio, since densities of narrow lights overflow when squared.
    let ratio = other / own;
    1.0 / (1.0 + ratio * ratio)
}

impl Lighting {
    /// Checks the lights around media within these bounds, of this extinction by place.
    ///
    /// # Errors
    /// If a light cannot be used.
    pub(crate) fn new(
        lights: &[Light],
        environment: Environment,
        (bounds, extinction): (Aabb, &dyn Fn(DVec3) -> f64),
    ) -> Result<Self> {
        let lights = lights.iter().enumerate();
        let lights = lights.map(|(i, light)| light.checked().map_err(|e| e.part(format!("light {i}"))));
        let lights: Vec<Light> = lights.collect::<Result<_>>()?;
        // In light that is the same from all around, what is scattered makes up for what is dimmed, path by path, if
        // all scatter.
        let often = if lights.is_empty() && environment.map.is_none() { f64::INFINITY } else { OFTEN };
        let near = NearLights::new(&lights, bounds, extinction);
        Ok(Self { lights, near, environment, background: None, often })
    }

    /// Returns the number of lights that directions are drawn from, the picture of the environment among them.
    #[inline(always)]
    pub(crate) fn count(&self) -> f64 {
        (self.lights.len() + usize::from(self.environment.map.is_some())) as f64
    }

    /// Returns what the camera sees in a direction behind the media.
    #[inline(always)]
    pub(crate) fn background(&self, direction: DVec3) -> Vec3 {
        self.background.unwrap_or_else(|| self.environment.towards(direction))
    }

    /// Returns the number of one of the lights, drawn by two numbers in [0, 1), and light that arrives from it at a
    /// point, with the density among all lights. The constant environment is left to rays that meet it: no density
    /// suits it better than the phase function's.
    #[inline(always)]
    pub(crate) fn sample(&self, from: DVec3, [choice, u]: [f64; 2]) -> Option<(usize, Arrival)> {
        let count = self.count();
        let scaled = choice * count;
        let number = scaled as usize;
        let arrival = match self.lights.get(number) {
            Some(light) => light.sample(from, [scaled.fract(), u])?,
            None => self.environment.map.as_ref()?.sample([scaled.fract(), u]),
        };
        if arrival.density.is_infinite() {
            // A light without extent is drawn with the probability of its choice alone.
            return Some((number, Arrival { radiance: arrival.radiance * count as f32, ..arrival }));
        }
        Some((number, Arrival { density: arrival.density / count, ..arrival }))
    }

    /// Returns the radiance of what [`Lighting::sample`] drew, over its density, weighted against the phase function
    /// whose value for the direction is given.
    #[inline(always)]
    pub(crate) fn weighted(&self, arrival: &Arrival, phase: f64) -> Vec3 {
        if arrival.density.is_infinite() {
            return arrival.radiance * phase as f32;
        }
        arrival.radiance * (heuristic(arrival.density, phase) * phase / arrival.density) as f32
    }

    /// Returns the radiance that a ray meets before `reach`, weighted against drawing it from the lights; the ray's
    /// direction was drawn with the given density. `survival` tells what light from a distance is to be multiplied by,
    /// and `counts` what that of a light.
    #[inline(always)]
    pub(crate) fn hit_radiance(
        &self,
        ray: &Ray,
        reach: f64,
        density: f64,
        mut survival: impl FnMut(f64) -> Vec3,
        counts: impl Fn(usize, &Arrival) -> f32,
    ) -> Vec3 {
        let count = self.count();
        let mut radiance = Vec3::ZERO;
        if reach.is_infinite() {
            radiance += Vec3::from_array(self.environment.radiance);
            if let Some(map) = &self.environment.map {
                let share = heuristic(density, map.density(ray.direction) / count);
                radiance += map.towards(ray.direction) * share as f32;
            }
            if radiance != Vec3::ZERO {
                radiance *= survival(f64::INFINITY);
            }
        }
        for (number, light) in self.lights.iter().enumerate() {
            if let Some(arrival) = light.hit(ray)
                && (arrival.distance < reach || reach.is_infinite())
            {
                let share = heuristic(density, arrival.density / count) as f32 * counts(number, &arrival);
                radiance += arrival.radiance * share * survival(arrival.distance);
            }
        }
        radiance
    }
}
