//! Points drawn by angles: of a ray about a place, and of directions to it.

use crate::math::Ray;
use crate::scene::directions::around;
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// Density of points of a segment by the angle that they turn about a place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Equiangular {
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
    pub(super) fn new(ray: &Ray, (from, to): (f64, f64), place: DVec3, [least, reach]: [f64; 2]) -> Option<Self> {
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
    pub(super) fn density(&self, at: f64) -> f64 {
        if at < self.from || at > self.to {
            return 0.0;
        }
        let along = at - self.nearest;
        self.distance / (self.angle * (self.distance * self.distance + along * along))
    }

    /// Draws a point by a number in [0, 1), and returns its world length along the ray.
    #[inline(always)]
    pub(super) fn draw(&self, u: f64) -> f64 {
        let first = ((self.from - self.nearest) / self.distance).atan();
        (self.nearest + self.distance * (first + u * self.angle).tan()).clamp(self.from, self.to)
    }
}

/// Density of directions from a point that is uniform in the angle to a place: with [`Equiangular`] on the ray, points
/// have the density `1 / (d² s²)` by their distances from both ends (Georgiev et al. 2013).
#[derive(Debug, Clone, Copy)]
pub(super) struct Directions {
    /// Unit vector to the place.
    axis: DVec3,
    /// Greatest angle, beyond which no ray comes near.
    most: f64,
}

impl Directions {
    /// Returns the density of rays that come nearer than `reach`.
    #[inline(always)]
    pub(super) fn new(from: DVec3, place: DVec3, reach: f64) -> Option<Self> {
        let offset = place - from;
        let distance = offset.length();
        let most = if distance > reach { (reach / distance).asin() } else { PI };
        (distance > 0.0).then(|| Self { axis: offset / distance, most })
    }

    /// Draws a direction by two numbers in [0, 1).
    #[inline(always)]
    pub(super) fn draw(&self, [u, v]: [f64; 2]) -> DVec3 {
        let (sine, cosine) = (self.most * u).sin_cos();
        around(self.axis, cosine, sine, v)
    }

    /// Returns the density per steradian.
    #[inline(always)]
    pub(super) fn density(&self, direction: DVec3) -> f64 {
        let cosine = self.axis.dot(direction);
        let sine = (direction - cosine * self.axis).length();
        if self.most < PI && (cosine < 0.0 || sine > self.most.sin()) {
            return 0.0;
        }
        1.0 / (TAU * self.most * sine.max(f64::EPSILON))
    }
}
