//! Chromatic media: extinctions that differ between color channels.
//!
//! All channels of a medium have one density, so that one optical depth tells the transmittance of each. A collision is
//! drawn by the extinction of one channel, picked by the share of the weight that the path carries in it, and stands
//! for all channels by the balance heuristic (spectral multiple importance sampling; Wilkie et al. 2014). The weights
//! of the channels then keep their sum (Kutz et al. 2017).

use super::optics::DensityMedium;
use super::phase::Phases;
use super::tracking::{Collision, EXACT_DEPTH, LEAST_TRANSMITTANCE, Media, One, Visible, joined};
use super::{Primary, Scratch};
use crate::error::Result;
use crate::math::Ray;
use crate::render::sampler::Sampler;
use crate::scene::bricks::Bricks;
use crate::scene::medium::Medium;
use glam::{DVec3, Vec3};

/// Volumes of which at least one is chromatic; their extinctions add.
pub(super) struct Chromatic<'a, O, P>(Vec<Colored<'a, O, P>>);

/// A volume with its extinction by channel, as a share of the largest.
struct Colored<'a, O, P> {
    volume: One<'a, O, P>,
    color: DVec3,
}

impl<'a, O: DensityMedium, P: Phases> Chromatic<'a, O, P> {
    /// Creates the kernel of these volumes, each as `prepared`.
    ///
    /// # Errors
    /// If a medium cannot be used.
    pub(crate) fn new(
        volumes: &[(&'a Bricks<f32>, &Medium)],
        prepared: impl Fn(&'a Bricks<f32>, &Medium) -> Result<One<'a, O, P>>,
    ) -> Result<Self> {
        let colored = |(field, medium): &(&'a Bricks<f32>, &Medium)| {
            let color = Vec3::from_array(medium.color).as_dvec3();
            let mut volume = prepared(field, medium)?;
            // Where the densest channel is dark, the others may not be.
            volume.dvr = volume.dvr.early_stop(LEAST_TRANSMITTANCE.powf(1.0 / color.min_element()));
            Ok(Colored { volume, color })
        };
        Ok(Self(volumes.iter().map(colored).collect::<Result<_>>()?))
    }

    /// Returns the optical depth of the first `length` of a ray by channel.
    fn depths(&self, ray: &Ray, length: f64, scratch: &mut Scratch) -> DVec3 {
        let depth = |one: &Colored<'_, O, P>| {
            one.color * one.volume.dvr.optical_depth_within(ray, length, f64::INFINITY, &mut scratch.tape)
        };
        self.0.iter().map(depth).sum()
    }
}

/// Returns the weight's shares by channel; alike for a weight of 0.
fn shares(weight: Vec3) -> DVec3 {
    let weight = weight.as_dvec3();
    let sum = weight.element_sum();
    if sum > 0.0 { weight / sum } else { DVec3::splat(1.0 / 3.0) }
}

/// Picks a channel with the probability of its share by a number in [0, 1).
fn pick(shares: DVec3, u: f64) -> usize {
    let sums = [shares.x, shares.x + shares.y];
    match sums.iter().position(|sum| u < *sum) {
        Some(channel) => channel,
        // Rounding leaves no share of 0 the rest.
        None => (0..3).rev().find(|channel| shares[*channel] > 0.0).unwrap_or(2),
    }
}

/// Returns, by channel, `factor · e^{-depth}` over its mean by shares: what one channel's draw is worth in each.
fn draw_weight(factor: DVec3, depths: DVec3, shares: DVec3) -> Vec3 {
    let drawn = shares.cmpgt(DVec3::ZERO);
    // Only ratios matter, and they do not underflow from the least depth on.
    let least = DVec3::select(drawn, depths, DVec3::INFINITY).min_element();
    let values = DVec3::select(drawn, factor * (-(depths - least)).map(f64::exp), DVec3::ZERO);
    let mean = values.dot(shares);
    if mean > 0.0 { (values / mean).as_vec3() } else { Vec3::ZERO }
}

impl<O: DensityMedium, P: Phases> Media for Chromatic<'_, O, P> {
    type Phase = P::At;
    const EMITS: bool = true;

    fn collide(
        &self,
        ray: &Ray,
        weight: Vec3,
        sampler: &mut Sampler,
        scratch: &mut Scratch,
    ) -> Option<(Collision, Vec3)> {
        let shares = shares(weight);
        let channel = pick(shares, sampler.uniform());
        let mut nearest: Option<Collision> = None;
        for (volume, one) in self.0.iter().enumerate() {
            let depth = f64::from(sampler.exponential()) / one.color[channel];
            let limit = nearest.map_or(ray.far, |c| c.distance);
            let found = one.volume.dvr.collision_at(ray, depth, limit, &mut scratch.tape);
            nearest = found.map(|(distance, density)| Collision { distance, density, volume }).or(nearest);
        }
        let collision = nearest?;
        let depths = self.depths(ray, collision.distance, scratch);
        Some((collision, draw_weight(self.0[collision.volume].color, depths, shares)))
    }

    fn survival(&self, ray: &Ray, distance: f64, weight: Vec3, scratch: &mut Scratch) -> Vec3 {
        draw_weight(DVec3::ONE, self.depths(ray, distance, scratch), shares(weight))
    }

    fn primary(&self, ray: &Ray, scratch: &mut Scratch) -> Primary {
        let [one] = &self.0[..] else {
            return Primary { depths: self.depths(ray, f64::INFINITY, scratch), ..Primary::default() };
        };
        let walked = one.volume.dvr.walk(ray, &mut scratch.camera);
        Primary { depths: one.color * walked.depth, walked: Some(walked), ..Primary::default() }
    }

    fn optical_depth(&self, ray: &Ray, scratch: &mut Scratch) -> DVec3 {
        self.depths(ray, f64::INFINITY, scratch)
    }

    /// The transmittance is exact. With one volume every ray that meets it collides with it.
    fn first(&self, ray: &Ray, primary: &Primary, sampler: &mut Sampler, scratch: &mut Scratch) -> Visible {
        let depths = primary.depths;
        let transmittance = (-depths).map(f64::exp).as_vec3();
        let ([one], Some(walked)) = (&self.0[..], primary.walked) else {
            return Visible { transmittance, collision: self.collide(ray, Vec3::ONE, sampler, scratch), spare: 0.0 };
        };
        let opacities = (-depths).map(|depth| -depth.exp_m1());
        let sum = opacities.element_sum();
        if sum <= 0.0 {
            return Visible { transmittance, collision: None, spare: 0.0 };
        }
        let [u, channel, spare, _] = sampler.stratified();
        let channel = pick(opacities / sum, channel);
        let depth = -(u * -opacities[channel]).ln_1p() / one.color[channel];
        let found = one.volume.dvr.locate(&walked, depth, &mut scratch.camera);
        let values = one.color * (-(depth * one.color)).map(f64::exp);
        let weight = (values * (sum / values.element_sum())).as_vec3();
        let collision = found.map(|(distance, density)| (Collision { distance, density, volume: 0 }, weight));
        Visible { transmittance, collision, spare }
    }

    fn transmittance(&self, ray: &Ray, length: f64, sampler: &mut Sampler, scratch: &mut Scratch) -> Vec3 {
        let mut product = DVec3::ONE;
        for one in &self.0 {
            // The clearest channel decides whether the walk ends; where it is clear, none does.
            let clearest = one.color.min_element();
            let limit = (EXACT_DEPTH + f64::from(sampler.exponential())) / clearest;
            let depth = one.volume.dvr.optical_depth_within(ray, length, limit, &mut scratch.tape);
            if depth >= limit {
                return Vec3::ZERO;
            }
            let raised = (clearest * depth - EXACT_DEPTH).max(0.0);
            product *= (DVec3::splat(raised) - one.color * depth).map(f64::exp);
        }
        product.as_vec3()
    }

    fn passed(
        &self,
        (ray, primary): (&Ray, Option<&Primary>),
        length: f64,
        sampler: &mut Sampler,
        scratch: &mut Scratch,
    ) -> Vec3 {
        if let ([one], Some(walked)) = (&self.0[..], primary.and_then(|primary| primary.walked))
            && let Some(depth) = one.volume.dvr.depth_before(&walked, length, &scratch.camera)
        {
            return (-depth * one.color).map(f64::exp).as_vec3();
        }
        self.transmittance(ray, length, sampler, scratch)
    }

    fn range(&self, ray: &Ray) -> Option<(f64, f64)> {
        self.0.iter().filter_map(|one| one.volume.range(ray)).reduce(joined)
    }

    fn extinction(&self, at: DVec3) -> f64 {
        self.0.iter().map(|one| one.volume.extinction(at) * (one.color.element_sum() / 3.0)).sum()
    }

    fn scattered(&self, at: DVec3, from: DVec3, to: DVec3) -> Vec3 {
        self.0.iter().map(|one| one.volume.scattered(at, from, to) * one.color.as_vec3()).sum()
    }

    fn albedo(&self, collision: &Collision) -> Vec3 {
        self.0[collision.volume].volume.albedo(collision)
    }

    fn source(&self, collision: &Collision) -> Vec3 {
        self.0[collision.volume].volume.source(collision)
    }

    fn phase(&self, collision: &Collision, at: DVec3) -> P::At {
        self.0[collision.volume].volume.phase(collision, at)
    }

    fn normal(&self, volume: usize, position: DVec3) -> DVec3 {
        self.0[volume].volume.normal(0, position)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Weights keep their sum where channels are drawn by their shares, however deep the medium is.
    #[test]
    fn draws_stand_for_all_channels() {
        let (factor, depths) = (DVec3::new(1.0, 0.5, 0.0), DVec3::new(800.0, 400.0, 0.0));
        let weight = Vec3::new(0.2, 0.3, 0.0);
        let worth = draw_weight(factor, depths, shares(weight));
        assert!(worth.is_finite() && (worth.dot(weight) - weight.element_sum()).abs() < 1e-6, "{worth}");
        assert_eq!(worth.z, 0.0);
        assert_eq!(shares(Vec3::ZERO).element_sum(), 1.0);
        let of = DVec3::new(0.5, 0.5, 0.0);
        assert_eq!([0.0, 0.6, 1.0].map(|u| pick(of, u)), [0, 1, 1]);
    }
}
