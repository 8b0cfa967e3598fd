//! Upper bounds of the radiance that is scattered, by the number of scatterings.
//!
//! Let τ be the greatest optical depth along a ray, ϖ the greatest albedo and D the greatest radiance that one
//! scattering makes of light straight from its source. A ray collects at most `q = ϖ (1 - e^{-τ})` of what is scattered
//! towards it, so that light scattered n times is at most `qⁿ D`, and light scattered n times or more at most `qⁿ D /
//! (1 - q)` (the Neumann series of the radiative transfer equation in the maximum norm). A source whose radiance is
//! nowhere above R never makes more than R, however often it is scattered.

use crate::render::path::specular_peak;
use crate::scene::light::LightBounds;
use crate::scene::medium::{Medium, Source};
use crate::scene::phase::Phase;
use glam::{DVec3, Vec3};
use std::f64::consts::{FRAC_1_PI, PI};

/// Bounds of what the media of a scene make of light.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Media {
    /// Greatest share of what is scattered towards a ray that the ray collects, by channel.
    gain: DVec3,
    /// 1 minus the gain.
    loss: DVec3,
    /// Greatest albedo, by channel.
    albedo: DVec3,
    /// Greatest opacity along a ray.
    opacity: f64,
    /// Greatest value of a phase function per steradian.
    peak: f64,
}

/// Greatest radiance of a source of light, by channel.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bound {
    /// Radiance of the first order: unscattered emission, or what one scattering makes of a light.
    pub first: DVec3,
    /// Radiance of all orders together, infinite for lights without extent.
    pub all: DVec3,
}

impl Bound {
    /// Returns the bound with emission of this radiance along any ray, in any channel, beside it.
    #[must_use]
    pub(crate) fn and(self, emitted: f64) -> Self {
        if emitted == 0.0 {
            return self;
        }
        // However often it is scattered, no more than the series tells is known.
        Self { first: self.first + emitted, all: DVec3::INFINITY }
    }
}

impl Media {
    /// Creates the bounds of media through which no ray is deeper than `depth`.
    pub(crate) fn new<'m>(media: impl Iterator<Item = &'m Medium>, depth: f64) -> Self {
        let opacity = -(-depth).exp_m1();
        let (mut albedo, mut peak) = (DVec3::ZERO, 0.25 / PI);
        for medium in media {
            let Some(scattering) = medium.scattering else { continue };
            let [_, most] = medium.albedo_bounds();
            albedo = albedo.max(Vec3::from_array(most).as_dvec3());
            if let Phase::HenyeyGreenstein(g) = scattering.phase {
                peak = f64::max(peak, scattering.phase.value(g.signum()));
            }
            if scattering.gradient_shading.is_some() {
                // A Lambertian surface scatters most along its normal.
                peak = f64::max(peak, FRAC_1_PI);
            }
            if let Some(specular) = scattering.specular {
                peak = f64::max(peak, specular_peak(specular));
            }
        }
        // 1 - q without the difference of nearly equal numbers.
        let loss = (DVec3::ONE - albedo) + albedo * (-depth).exp();
        Self { gain: albedo * opacity, loss, albedo, opacity, peak }
    }

    /// Returns the bound of light from a source of which so much arrives at most.
    pub(crate) fn of(&self, most: LightBounds) -> Bound {
        let first = most.radiance.as_dvec3().min(self.peak * most.fluence.as_dvec3());
        Bound { first, all: most.radiance.as_dvec3() }
    }

    /// Returns the bound of the media's emission, where densities are at most `densest` in each medium.
    pub(crate) fn emission<'m>(&self, media: impl Iterator<Item = (&'m Medium, f64)>) -> Bound {
        let mut bound = Bound { first: DVec3::ZERO, all: DVec3::ZERO };
        for (medium, densest) in media {
            let source = match &medium.source {
                Source::Grey(color) => Vec3::from_array(*color).as_dvec3(),
                Source::Linear(color) => Vec3::from_array(*color).as_dvec3() * densest,
                Source::Transfer(table) => DVec3::from_slice(&table.peak()),
            };
            let [least, _] = medium.albedo_bounds();
            let emitted = (DVec3::ONE - Vec3::from_array(least).as_dvec3()) * source;
            let emitted = brightest(medium).map_or(emitted, |brightest| brightest.min(emitted));
            bound.first = bound.first.max(emitted * self.opacity);
            bound.all = bound.all.max(DVec3::select(emitted.cmpgt(DVec3::ZERO), source, DVec3::ZERO));
        }
        bound
    }

    /// Returns the bound of what was scattered `orders` times or more.
    pub(crate) fn orders_from(&self, bound: Bound, orders: u32) -> DVec3 {
        let share = self.gain.powf(orders.into());
        // Infinite light of which nothing is scattered, and 0 / 0, are nothing.
        let nothing = bound.first.cmpeq(DVec3::ZERO) | share.cmpeq(DVec3::ZERO);
        DVec3::select(nothing, DVec3::ZERO, (bound.first * share / self.loss).min(bound.all))
    }

    /// Returns the bound of what a collision is expected to send on of light that it scatters, and that is scattered
    /// `orders` times or more, at least once.
    pub(crate) fn sent_on(&self, bound: Bound, orders: u32) -> DVec3 {
        let before = self.orders_from(bound, orders.saturating_sub(1));
        DVec3::select(self.albedo.cmpeq(DVec3::ZERO), DVec3::ZERO, self.albedo * before)
    }

    /// Returns the bound of what a collision emits.
    pub(crate) fn emitted(&self, emission: Bound) -> DVec3 {
        let dark = emission.first.cmpeq(DVec3::ZERO);
        DVec3::select(dark, DVec3::ZERO, (emission.first / self.opacity).min(emission.all))
    }
}

/// Returns an upper bound of what a medium with functions of the density for its source and its albedo emits per unit
/// of optical depth, density by density: where it is bright it may scatter most.
fn brightest(medium: &Medium) -> Option<DVec3> {
    let (Source::Transfer(source), Some(function)) = (&medium.source, &medium.albedo_function) else { return None };
    let albedo = Vec3::from_array(medium.scattering?.albedo).as_dvec3();
    let colors = function.table();
    let mut knots = [source.knots(), colors.knots()].concat();
    knots.sort_by(f64::total_cmp);
    // Each is linear between neighbouring knots, and constant beyond the outermost.
    let ends = [[knots[0]; 2], [knots[knots.len() - 1]; 2]];
    let pieces = knots.windows(2).map(|pair| [pair[0], pair[1]]).chain(ends);
    let emitted = pieces.map(|[low, high]| {
        let (bright, (dim, _)) = (source.bounds(low, high).1, colors.bounds(low, high));
        (DVec3::ONE - albedo * DVec3::from_slice(&dim)) * DVec3::from_slice(&bright)
    });
    emitted.reduce(DVec3::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::medium::Scattering;

    fn medium(albedo: f32, phase: Phase) -> Medium {
        Medium { scattering: Some(Scattering::new([albedo; 3], phase)), ..Medium::absorbing(1.0) }
    }

    /// A slab of optical depth 1: the series has known terms, and thick media without absorption keep a finite bound.
    #[test]
    fn orders_fall_by_the_gain() {
        let media = Media::new([&medium(0.5, Phase::Isotropic)].into_iter(), 1.0);
        let white = Bound { first: DVec3::ONE, all: DVec3::ONE };
        let gain = 0.5 * (1.0 - (-1.0_f64).exp());
        for order in [0, 1, 2, 7] {
            let expected = (gain.powi(order as i32) / (1.0 - gain)).min(1.0);
            assert!((media.orders_from(white, order) - expected).abs().max_element() < 1e-12);
        }
        let thick = Media::new([&medium(1.0, Phase::HenyeyGreenstein(0.9))].into_iter(), 1000.0);
        assert_eq!(thick.orders_from(white, 5), DVec3::ONE);
        let sun = thick.of(LightBounds { radiance: Vec3::INFINITY, fluence: Vec3::ONE });
        assert!((sun.first.x - 1.9 / (4.0 * PI * 0.01)).abs() < 1e-9);
        assert_eq!(thick.orders_from(sun, 5), DVec3::INFINITY);
        let dark = Bound { first: DVec3::ZERO, all: DVec3::ZERO };
        assert_eq!(thick.orders_from(dark, 0), DVec3::ZERO);
    }

    #[test]
    fn emission_is_what_is_not_scattered() {
        let glowing = Medium { source: Source::Grey([2.0, 0.0, 1.0]), ..medium(0.75, Phase::Isotropic) };
        let media = Media::new([&glowing].into_iter(), f64::INFINITY);
        let bound = media.emission([(&glowing, 1.0)].into_iter());
        assert_eq!((bound.first, bound.all), (DVec3::new(0.5, 0.0, 0.25), DVec3::new(2.0, 0.0, 1.0)));
        assert_eq!(media.orders_from(bound, 0), DVec3::new(2.0, 0.0, 1.0));
    }
}
