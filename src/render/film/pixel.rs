//! Sums over the rays and paths of a pixel.

use super::halves::{self, Half};
use crate::render::integrator::{First, Interaction, Sample};
use crate::scene::camera::Camera;
use crate::scene::film::Moments;
use glam::{DVec2, DVec3, DVec4, Vec3};
use std::ops::{Add, Mul};

/// Sums over a pixel's paths.
#[derive(Debug, Clone, Default)]
pub(super) struct Pixel {
    /// Red, green, blue and alpha, the means over the paths of each ray.
    pub(super) rgba: [Moments; 4],
    pub(super) optical_depth: f64,
    pub(super) direct: DVec3,
    pub(super) indirect: DVec3,
    /// Rays of even and of odd number.
    pub(super) halves: [Half; 2],
    /// Over first collisions: their weight, and weighted by it the albedo, the normal, the position, the length along
    /// the viewing axis.
    pub(super) collided: f64,
    pub(super) albedo: DVec3,
    pub(super) normal: DVec3,
    pub(super) position: DVec3,
    pub(super) depth: f64,
    /// Motion in the picture of volumes and of surfaces.
    pub(super) motion: [Moving; 2],
}

/// Motion in the picture, or a sum of motions.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Motion {
    /// Place in the frame before minus that now, in pixels to the right and upwards.
    pub(super) before: DVec2,
    /// Place now minus that in the frame after.
    pub(super) after: DVec2,
    /// Length along the viewing axis in the frame before minus that now.
    pub(super) depth_before: f64,
}

impl Add for Motion {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self {
            before: self.before + other.before,
            after: self.after + other.after,
            depth_before: self.depth_before + other.depth_before,
        }
    }
}

impl Mul<f64> for Motion {
    type Output = Self;
    fn mul(self, by: f64) -> Self {
        Self { before: self.before * by, after: self.after * by, depth_before: self.depth_before * by }
    }
}

/// Sums of the motion in the picture over what is met first.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Moving {
    share: f64,
    sum: Motion,
}

impl Moving {
    fn add(&mut self, share: f64, sum: Motion) {
        self.share += share;
        self.sum = self.sum + sum;
    }
}

impl Pixel {
    /// Adds what an estimate tells beside the color.
    pub(super) fn add(&mut self, camera: &Camera, sample: &Sample) {
        self.direct += sample.direct.as_dvec3();
        self.indirect += sample.indirect.as_dvec3();
        for first in [sample.first, sample.surface].into_iter().flatten() {
            let share = f64::from(first.share);
            self.collided += share;
            self.albedo += share * first.albedo.as_dvec3();
            self.position += share * first.position;
            self.depth += share * (first.position - camera.position()).dot(camera.forward());
        }
    }

    /// Adds the motion of a first collision, as [`View::motion`](super::View) gives it.
    pub(super) fn add_motion(&mut self, first: &First, motion: Motion) {
        let share = f64::from(first.share);
        let kind = usize::from(matches!(first.interaction, Interaction::Surface(_)));
        self.motion[kind].add(share, motion * share);
    }

    /// Adds the mean color of a ray's estimates.
    #[inline(always)]
    pub(super) fn add_ray(&mut self, half: usize, rgba: [f64; 4]) {
        self.rgba.iter_mut().zip(rgba).for_each(|(moments, v)| moments.add(v));
        self.halves[half].add(rgba);
    }

    /// Adds what the rays of another replicate tell beside their colors, which count as one half's.
    pub(super) fn merge(&mut self, other: &Self, half: usize) {
        self.optical_depth += other.optical_depth;
        self.direct += other.direct;
        self.indirect += other.indirect;
        other.halves.iter().for_each(|rays| self.halves[half].merge(rays));
        self.collided += other.collided;
        self.albedo += other.albedo;
        self.normal += other.normal;
        self.position += other.position;
        self.depth += other.depth;
        self.motion.iter_mut().zip(other.motion).for_each(|(sum, of)| sum.add(of.share, of.sum));
    }

    /// Returns the mean color and alpha.
    #[inline(always)]
    pub(super) fn rgba(&self) -> [f32; 4] {
        self.rgba.map(|m| m.mean() as f32)
    }

    /// Returns the mean motion of volumes or of surfaces, whichever of both is seen more: what moves otherwise has no
    /// motion in common. 0 without any.
    pub(super) fn mean_motion(&self) -> Motion {
        let [volumes, surfaces] = self.motion;
        let Moving { share, sum } = if surfaces.share > volumes.share { surfaces } else { volumes };
        if share > 0.0 { sum * share.recip() } else { Motion::default() }
    }

    /// Returns the variances of the mean, as [`halves::both`] does.
    pub(super) fn variances(&self, in_halves: bool) -> [DVec4; 2] {
        halves::both(&self.rgba, &self.halves, in_halves)
    }

    /// Returns the mean over first collisions; 0 without any.
    pub(super) fn mean(&self, sum: DVec3) -> Vec3 {
        if self.collided > 0.0 { (sum / self.collided).as_vec3() } else { Vec3::ZERO }
    }
}
