//! Phase functions at a place, one type for each kind: what a medium does not do costs nothing in the kernels that are
//! made of them.

use crate::render::gradient::gradient;
use crate::scene::bricks::Bricks;
use crate::scene::directions::around;
use crate::scene::medium::Scattering;
use crate::scene::phase::Phase;
use glam::{DVec3, Vec3};
use std::f64::consts::FRAC_1_PI;

/// A phase function at one place.
pub(super) trait PhaseFunction: Copy {
    /// True if channels are scattered to other directions than [`PhaseFunction::value`] tells, or more than the albedo.
    const COLORED: bool = false;
    /// Returns the density per steradian with which light is drawn from direction `to` for a path that arrives in
    /// direction `from`; both point along the path.
    fn value(self, from: DVec3, to: DVec3) -> f64;
    /// Draws a direction by two numbers in [0, 1), and returns its density with it.
    fn sample(self, from: DVec3, numbers: [f64; 2]) -> (DVec3, f64);
    /// Returns the share of the extinction that is scattered in all directions, in a medium of this albedo.
    #[inline(always)]
    fn total(self, albedo: Vec3, _: DVec3) -> Vec3 {
        albedo
    }
    /// Returns the share of the extinction that is scattered per steradian from `to`, in a medium of this albedo.
    #[inline(always)]
    fn color(self, albedo: Vec3, from: DVec3, to: DVec3) -> Vec3 {
        albedo * self.value(from, to) as f32
    }
    /// Returns [`PhaseFunction::color`] over [`PhaseFunction::total`] and [`PhaseFunction::value`].
    #[inline(always)]
    fn tint(self, _: Vec3, _: DVec3, _: DVec3) -> Vec3 {
        Vec3::ONE
    }
}

/// Phase functions of a medium by place.
pub(super) trait Phases: Copy + Sync + Send {
    /// Phase function at a place.
    type At: PhaseFunction;
    /// Returns the phase function at a world position in a field of densities.
    fn at(self, field: &Bricks<f32>, position: DVec3) -> Self::At;
}

/// A phase function of the angle alone, the same everywhere.
trait Axial: Copy + Sync + Send {
    fn phase(self) -> Phase;
}

/// The isotropic phase function.
#[derive(Clone, Copy)]
pub(super) struct Isotropic;

impl Axial for Isotropic {
    #[inline(always)]
    fn phase(self) -> Phase {
        Phase::Isotropic
    }
}

/// The Henyey-Greenstein phase function of this anisotropy.
#[derive(Clone, Copy)]
pub(super) struct HenyeyGreenstein(pub f64);

impl Axial for HenyeyGreenstein {
    #[inline(always)]
    fn phase(self) -> Phase {
        Phase::HenyeyGreenstein(self.0)
    }
}

impl<A: Axial> PhaseFunction for A {
    #[inline(always)]
    fn value(self, from: DVec3, to: DVec3) -> f64 {
        self.phase().value(from.dot(to))
    }

    #[inline(always)]
    fn sample(self, from: DVec3, [u, v]: [f64; 2]) -> (DVec3, f64) {
        let cosine = self.phase().sample(u);
        let sine = ((1.0 - cosine) * (1.0 + cosine)).max(0.0).sqrt();
        (around(from, cosine, sine, v), self.phase().value(cosine))
    }
}

impl<A: Axial> Phases for A {
    type At = A;

    #[inline(always)]
    fn at(self, _: &Bricks<f32>, _: DVec3) -> A {
        self
    }
}

/// Any phase function, with gradient shading or without.
#[derive(Clone, Copy)]
pub(super) struct Shaded {
    phase: Phase,
    /// Gradient of the density per world length at which half of the scattering is that of a surface; infinite without
    /// gradient shading.
    half: f64,
    /// Standard deviation in voxels of the filter that gradients are taken through.
    scale: f64,
}

impl Shaded {
    /// Returns the phase functions of a medium; isotropic ones of a medium that does not scatter.
    pub(crate) fn new(scattering: Option<Scattering>) -> Self {
        let phase = scattering.map_or(Phase::Isotropic, |scattering| scattering.phase);
        let half = scattering.and_then(|scattering| scattering.gradient_shading).unwrap_or(f64::INFINITY);
        Self { phase, half, scale: scattering.map_or(0.0, |scattering| scattering.gradient_scale) }
    }

    /// Returns the phase function if it is the same everywhere.
    pub(crate) fn unshaded(self) -> Option<Phase> {
        self.half.is_infinite().then_some(self.phase)
    }
}

impl Phases for Shaded {
    type At = Mixed;

    #[inline(always)]
    fn at(self, field: &Bricks<f32>, position: DVec3) -> Mixed {
        if self.half.is_infinite() {
            return Mixed { phase: self.phase, normal: DVec3::Z, share: 0.0 };
        }
        let gradient = gradient(field, field.transform.to_index(position), self.scale);
        // Of the ratio that does not overflow.
        let ratio = self.half / gradient.length();
        Mixed { phase: self.phase, normal: gradient.normalize_or(DVec3::Z), share: 1.0 / (1.0 + ratio * ratio) }
    }
}

/// A share of the scattering by a Lambertian surface, the rest by a phase function.
///
/// The surface faces the side that the path comes from, and reflects light of direction `l` with the density
/// `max(0, n·l) / π`.
#[derive(Clone, Copy)]
pub(super) struct Mixed {
    phase: Phase,
    /// Unit normal of the surface, to either side.
    normal: DVec3,
    share: f64,
}

impl Mixed {
    /// Creates the function of a share of a surface of this unit normal.
    #[cfg(test)]
    pub(super) fn new(phase: Phase, normal: DVec3, share: f64) -> Self {
        Self { phase, normal, share }
    }

    /// Returns the phase function beside the surface.
    #[inline(always)]
    pub(super) fn phase(&self) -> Phase {
        self.phase
    }

    /// Returns the share of the surface.
    #[inline(always)]
    pub(super) fn share(&self) -> f64 {
        self.share
    }

    /// Returns the normal towards the side that the path comes from.
    #[inline(always)]
    pub(super) fn facing(&self, from: DVec3) -> DVec3 {
        if self.normal.dot(from) > 0.0 { -self.normal } else { self.normal }
    }
}

impl PhaseFunction for Mixed {
    #[inline(always)]
    fn value(self, from: DVec3, to: DVec3) -> f64 {
        let surface = self.facing(from).dot(to).max(0.0) * FRAC_1_PI;
        self.share * surface + (1.0 - self.share) * self.phase.value(from.dot(to))
    }

    #[inline(always)]
    fn sample(self, from: DVec3, [u, v]: [f64; 2]) -> (DVec3, f64) {
        let to = if u < self.share {
            // Cosines of directions that Lambert's law draws are roots of even numbers.
            let square = u / self.share;
            around(self.facing(from), square.sqrt(), (1.0 - square).max(0.0).sqrt(), v)
        } else {
            let cosine = self.phase.sample((u - self.share) / (1.0 - self.share));
            let sine = ((1.0 - cosine) * (1.0 + cosine)).max(0.0).sqrt();
            around(from, cosine, sine, v)
        };
        (to, self.value(from, to))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mixed functions integrate to 1, and what is drawn has the mean of the density.
    #[test]
    fn mixed_functions_are_normalised_and_drawn_by_their_density() {
        let (from, normal) = (DVec3::new(0.3, -0.2, 0.9).normalize(), DVec3::new(0.5, 0.7, -0.1).normalize());
        for (share, phase) in [(0.0, Phase::Isotropic), (0.4, Phase::HenyeyGreenstein(-0.6)), (1.0, Phase::Isotropic)] {
            for normal in [normal, -normal] {
                let mixed = Mixed { phase, normal, share };
                let (count, turns) = (400, 400);
                let (mut whole, mut mean) = (0.0, DVec3::ZERO);
                let mut drawn = DVec3::ZERO;
                for i in 0..count {
                    for j in 0..turns {
                        let [u, v] = [(f64::from(i) + 0.5) / f64::from(count), (f64::from(j) + 0.5) / f64::from(turns)];
                        let cosine = 2.0 * u - 1.0;
                        let to = around(from, cosine, (1.0 - cosine * cosine).sqrt(), v);
                        let value = mixed.value(from, to) * 4.0 * std::f64::consts::PI;
                        whole += value;
                        mean += value * to;
                        let (to, density) = mixed.sample(from, [u, v]);
                        assert!((density - mixed.value(from, to)).abs() < 1e-12 && density > 0.0);
                        drawn += to;
                    }
                }
                let all = f64::from(count * turns);
                assert!((whole / all - 1.0).abs() < 1e-3, "{share}: {whole}");
                assert!((mean / all - drawn / all).length() < 2e-3, "{share}: {mean} {drawn}");
            }
        }
    }
}
