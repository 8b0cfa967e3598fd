//! Directions about an axis.

use glam::DVec3;
use std::f64::consts::TAU;

/// Returns the solid angle of a cone, `2π (1 - cos θ)`, from the sine of half its opening angle θ.
pub(super) fn solid_angle(half_sine: f64) -> f64 {
    2.0 * TAU * half_sine * half_sine
}

/// Returns the unit vector to a point, and the world length; `None` if both points are one.
pub(super) fn towards(from: DVec3, to: DVec3) -> Option<(DVec3, f64)> {
    let offset = to - from;
    let distance = offset.length();
    (distance > 0.0).then(|| (offset / distance, distance))
}

/// Returns a direction in a cone around an axis, uniform in solid angle.
pub(super) fn in_cone(axis: DVec3, half_sine: f64, [u, v]: [f64; 2]) -> DVec3 {
    // 1 - cos θ, uniform from 0 to that of the rim.
    let drop = 2.0 * half_sine * half_sine * u;
    around(axis, 1.0 - drop, (drop * (2.0 - drop)).max(0.0).sqrt(), v)
}

/// Returns the unit vector at an angle to an axis that is given by its cosine and sine, turned about the axis by a
/// share of a full turn.
#[inline]
pub(crate) fn around(axis: DVec3, cosine: f64, sine: f64, turn: f64) -> DVec3 {
    let (x, y) = axis.any_orthonormal_pair();
    let (sin, cos) = (TAU * turn).sin_cos();
    (sine * (cos * x + sin * y) + cosine * axis).normalize()
}
