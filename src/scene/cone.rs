//! The cone of a spot: how much of a lamp's light leaves it in a direction.

use crate::error::{Error, Result};
use glam::DVec3;
use std::f64::consts::PI;

/// A cone of light that falls off towards its rim.
///
/// Of directions at the angle θ to the axis the share `s² (3 - 2 s)` of the light leaves, where s goes from 0 to 1 as
/// cos θ goes from the cosine of the rim, c, to `c + blend (1 - c)`: the falloff of spots in Blender's Cycles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cone {
    axis: DVec3,
    angle: f64,
    blend: f64,
    /// Cosine of the rim's angle.
    rim: f64,
    /// Reciprocal of the width of the falloff as cosines.
    steepness: f64,
}

impl Cone {
    /// Creates a cone around a vector of any length: `angle` is that from the axis to the rim in radians, from 0 to π,
    /// and `blend`, from 0 to 1, tells how much of the cone the falloff takes.
    ///
    /// # Errors
    /// If the axis has no direction, or another number cannot be used.
    pub fn new(axis: DVec3, angle: f64, blend: f64) -> Result<Self> {
        let bad = |what: String, hint: &str| Err(Error::invalid(what).hint(hint));
        if !(axis.is_finite() && axis.length() > 0.0) {
            return bad(format!("a spot along {axis} has no direction"), "give a vector along which it shines");
        }
        if !(angle > 0.0 && angle <= PI) {
            return bad(
                format!("a cone of {} degrees from axis to rim is not possible", angle.to_degrees()),
                "give an angle above 0, and at most 180 degrees",
            );
        }
        if !(0.0..=1.0).contains(&blend) {
            return bad(format!("a cone cannot fall off over {blend} of it"), "give a blend from 0 to 1");
        }
        let rim = angle.cos();
        let width = blend * (1.0 - rim);
        // A rim without a falloff is a step: any difference of cosines times this is 1 or more.
        let steepness = if width > 0.0 { (1.0 / width).min(f64::MAX) } else { f64::MAX };
        Ok(Self { axis: axis.normalize(), angle, blend, rim, steepness })
    }

    /// Returns the unit vector along which light leaves.
    pub fn axis(&self) -> DVec3 {
        self.axis
    }

    /// Returns the angle from the axis to the rim in radians.
    pub fn angle(&self) -> f64 {
        self.angle
    }

    /// Returns the part of the cone that the falloff takes, from 0 to 1.
    pub fn blend(&self) -> f64 {
        self.blend
    }

    /// Returns the share of the light that leaves along a unit vector, from 0 to 1.
    #[inline(always)]
    pub fn share(&self, leaving: DVec3) -> f32 {
        self.of_cosine(self.axis.dot(leaving))
    }

    #[inline(always)]
    fn of_cosine(&self, cosine: f64) -> f32 {
        let s = ((cosine - self.rim) * self.steepness).clamp(0.0, 1.0);
        (s * s * (3.0 - 2.0 * s)) as f32
    }

    /// Returns the largest share that leaves in directions which differ from a unit vector by an angle at most.
    pub(super) fn largest_share(&self, leaving: DVec3, spread: f64) -> f32 {
        // atan2 resolves small angles, which the arc cosine does not.
        let apart = self.axis.cross(leaving).length().atan2(self.axis.dot(leaving));
        // Rounding must not hide the light of the rim.
        self.of_cosine((apart - spread - 1e-9).max(0.0).cos())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn shares_are_those_of_the_formula() {
        let cone = Cone::new(2.0 * DVec3::Z, 60_f64.to_radians(), 0.5).unwrap();
        let at = |degrees: f64| {
            let (sine, cosine) = degrees.to_radians().sin_cos();
            cone.share(DVec3::new(sine, 0.0, cosine))
        };
        // The falloff goes from the cosine 0.5 to 0.75, which is that of 41.4 degrees.
        assert_eq!((at(0.0), at(41.0), at(61.0), at(180.0)), (1.0, 1.0, 0.0, 0.0));
        // At the cosine 0.5625, s = 0.25: 3/16 - 2/64.
        assert!((at(0.5625_f64.acos().to_degrees()) - 0.156_25).abs() < 1e-6);
        assert!((at(0.625_f64.acos().to_degrees()) - 0.5).abs() < 1e-6);
    }

    #[test]
    fn a_rim_without_a_blend_is_a_step() {
        for angle in [1e-3, 0.4, PI] {
            let cone = Cone::new(DVec3::X, angle, 0.0).unwrap();
            let along = |turn: f64| DVec3::new(turn.cos(), turn.sin(), 0.0);
            assert_eq!((cone.share(along(0.0)), cone.share(along(0.999 * angle))), (1.0, 1.0));
            assert!(cone.share(along(1.001 * angle)) == if angle == PI { 1.0 } else { 0.0 });
        }
    }

    #[test]
    fn the_largest_share_bounds_those_around() {
        let cone = Cone::new(DVec3::new(1.0, 0.5, -0.3), 0.6, 0.4).unwrap();
        let towards = |a: f64, b: f64| DVec3::new(a.cos() * b.cos(), a.sin() * b.cos(), b.sin());
        for i in 0..40 {
            for j in 0..40 {
                let [middle, other] =
                    [i, j].map(|k| towards(f64::from(k) * 0.157, f64::from((k * 7) % 40) * 0.07 - 1.4));
                let apart = middle.dot(other).clamp(-1.0, 1.0).acos();
                assert!(cone.largest_share(middle, apart) >= cone.share(other), "{i} {j}");
            }
        }
        // Far outside, there is none.
        assert_eq!(cone.largest_share(-cone.axis(), 0.5), 0.0);
    }

    #[test]
    fn cones_that_cannot_be_are_refused() {
        let of = |axis, angle, blend| Cone::new(axis, angle, blend).map(drop).map_err(|e| e.to_string());
        assert!(of(DVec3::ZERO, 0.5, 0.5).unwrap_err().contains("no direction"));
        for angle in [0.0, -1.0, 3.2, f64::NAN] {
            assert!(of(DVec3::X, angle, 0.5).unwrap_err().contains("not possible"), "{angle}");
        }
        for blend in [-0.1, 1.1, f64::NAN] {
            assert!(of(DVec3::X, 0.5, blend).unwrap_err().contains("fall off"), "{blend}");
        }
    }
}
