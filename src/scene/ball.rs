//! The ball of a lamp: where light comes from that leaves a sphere, or a disc that turns to whatever it lights.

use super::directions::{in_cone, solid_angle, towards};
use crate::math::Ray;
use glam::DVec3;

/// A ball, seen from any point as a cone of directions.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ball {
    pub centre: DVec3,
    pub radius: f64,
    /// True of a disc through the centre that faces the point, as Blender's Soft Falloff has it; false of a sphere.
    pub soft: bool,
}

/// A direction to a ball.
#[derive(Debug, Clone, Copy)]
pub(super) struct Towards {
    /// Unit vector.
    pub direction: DVec3,
    /// World length to the ball.
    pub distance: f64,
    /// Probability density per steradian.
    pub density: f64,
}

impl Ball {
    /// Returns the sine of half of the angular radius from a distance; `None` from inside a sphere.
    pub(super) fn half_sine(&self, distance: f64) -> Option<f64> {
        let Self { radius, soft, .. } = *self;
        if soft {
            // sin²(θ/2) = (1 - cos θ) / 2 = r² / (2 h (h + d)), where h² = r² + d².
            let rim = radius.hypot(distance);
            return Some(radius / (2.0 * rim * (rim + distance)).sqrt());
        }
        let sine = radius / distance;
        (sine < 1.0).then(|| {
            let cosine = ((1.0 - sine) * (1.0 + sine)).sqrt();
            // sin²(θ/2) = (1 - cos θ) / 2 = sin² θ / (2 (1 + cos θ)).
            sine / (2.0 * (1.0 + cosine)).sqrt()
        })
    }

    /// Returns a direction from a point to the ball, drawn by two numbers in [0, 1).
    #[inline(always)]
    pub(super) fn sample(&self, from: DVec3, u: [f64; 2]) -> Option<Towards> {
        let Self { centre, radius, soft } = *self;
        let (axis, distance) = towards(from, centre)?;
        let half_sine = self.half_sine(distance)?;
        let direction = in_cone(axis, half_sine, u);
        let cosine = axis.dot(direction);
        let near = if soft {
            distance / cosine
        } else {
            // A direction on the cone's rim may miss the sphere by rounding.
            let along = cosine * distance;
            let across = (distance * distance - along * along).max(0.0);
            along - (radius * radius - across).max(0.0).sqrt()
        };
        // Next to the centre of a disc, rounding may turn a direction away from it.
        (cosine > 0.0).then(|| Towards { direction, distance: near, density: 1.0 / solid_angle(half_sine) })
    }

    /// Returns where a ray of unit direction meets the ball; `None` if it does not.
    #[inline(always)]
    pub(super) fn hit(&self, ray: &Ray) -> Option<Towards> {
        let Self { centre, radius, soft } = *self;
        let to = centre - ray.origin;
        let distance = to.length();
        let half_sine = self.half_sine(distance)?;
        let along = to.dot(ray.direction);
        let across = (to - along * ray.direction).length_squared();
        if soft {
            // The ray meets the disc's plane at the distance d² / a, and its centre at a · tan θ = d · |across| / a.
            let inside = radius * radius * along * along - distance * distance * across;
            let density = 1.0 / solid_angle(half_sine);
            return (along > 0.0 && inside > 0.0).then(|| Towards {
                direction: ray.direction,
                distance: distance * distance / along,
                density,
            });
        }
        let inside = radius * radius - across;
        (along > 0.0 && inside > 0.0).then(|| Towards {
            direction: ray.direction,
            distance: along - inside.sqrt(),
            density: 1.0 / solid_angle(half_sine),
        })
    }
}
