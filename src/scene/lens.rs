//! Lens distortion: from the image plane of a pinhole camera to that of a real one.
//!
//! Plane coordinates are x / z and y / z in a camera that looks along +z with x to the right and y **down**, as OpenCV
//! and COLMAP have them. The radial and tangential model is that of D. C. Brown, "Decentering Distortion of Lenses"
//! (1966), with OpenCV's rational denominator; the fisheye model is that of J. Kannala and S. Brandt (2006) as OpenCV
//! has it.

use crate::error::{Error, Result};
use glam::DVec2;

/// Distortion of a lens.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum Lens {
    /// No distortion.
    #[default]
    Pinhole,
    /// Radial and tangential distortion.
    Brown {
        /// Radial coefficients: the radius r is multiplied by (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6
        /// r⁶).
        radial: [f64; 6],
        /// Tangential coefficients p1 and p2.
        tangential: [f64; 2],
    },
    /// Fisheye: a ray at the angle θ to the axis meets the plane at the radius θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸).
    Fisheye {
        /// Coefficients k1 to k4.
        radial: [f64; 4],
    },
}

/// Number of radii at which a lens is tested for folding over.
const RADII: u32 = 4096;

impl Lens {
    /// Returns the lens with radial and tangential distortion, or a pinhole if all coefficients are 0.
    pub fn brown(radial: [f64; 6], tangential: [f64; 2]) -> Self {
        if radial.iter().chain(&tangential).all(|c| *c == 0.0) {
            return Self::Pinhole;
        }
        Self::Brown { radial, tangential }
    }

    /// Checks that all coefficients are finite.
    ///
    /// # Errors
    /// If one is not.
    pub fn checked(self) -> Result<Self> {
        let finite = match self {
            Self::Pinhole => true,
            Self::Brown { radial, tangential } => radial.iter().chain(&tangential).all(|c| c.is_finite()),
            Self::Fisheye { radial } => radial.iter().all(|c| c.is_finite()),
        };
        if finite {
            return Ok(self);
        }
        Err(Error::invalid("a coefficient of the lens distortion is not finite")
            .hint("calibrate the camera again, or leave the coefficients out for a pinhole camera"))
    }

    /// Returns the plane coordinates at which the lens shows what a pinhole camera shows at `plane`.
    pub fn distort(&self, plane: DVec2) -> DVec2 {
        match self {
            Self::Pinhole => plane,
            Self::Brown { radial, tangential: [p1, p2] } => {
                let (x, y, square) = (plane.x, plane.y, plane.length_squared());
                let tangential = DVec2::new(
                    2.0 * p1 * x * y + p2 * (square + 2.0 * x * x),
                    p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y,
                );
                plane * ratio(radial, square) + tangential
            }
            Self::Fisheye { radial } => {
                let radius = plane.length();
                // The ratio of angle to radius is 1 - r²/3 + …, which is 1 to the last bit below this radius.
                if radius < 1e-8 { plane } else { plane * (angle(radial, radius.atan()) / radius) }
            }
        }
    }

    /// Returns the largest radius, at most `most`, up to which the lens maps greater radii to greater ones. Beyond it
    /// the model folds over, and describes no lens.
    pub(crate) fn valid_radius(&self, most: f64) -> f64 {
        let mapped = |radius: f64| match self {
            Self::Pinhole => radius,
            Self::Brown { radial, .. } => radius * ratio(radial, radius * radius),
            Self::Fisheye { radial } => angle(radial, radius.atan()),
        };
        let (mut valid, mut last) = (0.0, 0.0);
        for i in 1..=RADII {
            let radius = most * f64::from(i) / f64::from(RADII);
            let next = mapped(radius);
            if next.is_nan() || next <= last {
                return valid;
            }
            (valid, last) = (radius, next);
        }
        most
    }
}

/// Ratio of distorted to undistorted radius, at a squared radius.
fn ratio([k1, k2, k3, k4, k5, k6]: &[f64; 6], square: f64) -> f64 {
    (1.0 + square * (k1 + square * (k2 + square * k3))) / (1.0 + square * (k4 + square * (k5 + square * k6)))
}

/// Distorted radius at an angle to the axis.
fn angle([k1, k2, k3, k4]: &[f64; 4], theta: f64) -> f64 {
    let square = theta * theta;
    theta * (1.0 + square * (k1 + square * (k2 + square * (k3 + square * k4))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distortion_is_that_of_the_formulas() {
        let lens = Lens::brown([0.1, -0.02, 0.003, 0.0, 0.0, 0.0], [0.01, -0.02]);
        // By hand at (0.3, -0.4): r² = 0.25, radial = 1 + 0.025 - 0.00125 + 0.000046875 = 1.023796875;
        // x: 0.3 · 1.023796875 + 2 · 0.01 · (-0.12) - 0.02 · (0.25 + 0.18) = 0.2961390625,
        // y: -0.4 · 1.023796875 + 0.01 · (0.25 + 0.32) + 2 · (-0.02) · (-0.12) = -0.39901875.
        let found = lens.distort(DVec2::new(0.3, -0.4));
        assert!((found - DVec2::new(0.296_139_062_5, -0.399_018_75)).length() < 1e-15, "{found}");
        // A fisheye without coefficients is equidistant: 45 degrees from the axis meet the plane at π/4.
        let fisheye = Lens::Fisheye { radial: [0.0; 4] };
        assert!((fisheye.distort(DVec2::X).x - std::f64::consts::FRAC_PI_4).abs() < 1e-15);
        assert_eq!(fisheye.distort(DVec2::new(1e-9, 0.0)).x, 1e-9);
        // The rational model: 1 + 0.25 over 1 + 0.5 at r² = 0.5.
        let rational = Lens::brown([0.5, 0.0, 0.0, 1.0, 0.0, 0.0], [0.0; 2]);
        let at = DVec2::splat(0.5);
        assert!((rational.distort(at) - at * (1.25 / 1.5)).length() < 1e-15);
        assert_eq!(Lens::brown([0.0; 6], [0.0; 2]), Lens::Pinhole);
    }

    #[test]
    fn a_lens_is_valid_up_to_where_it_folds() {
        // r (1 - r²/3) grows up to r = 1; the radii tested are 2/4096 apart.
        let lens = Lens::brown([-1.0 / 3.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0; 2]);
        let valid = lens.valid_radius(2.0);
        assert!((valid - 1.0).abs() <= 2.0 * 2.0 / f64::from(RADII), "{valid}");
        assert_eq!(lens.valid_radius(0.5), 0.5);
        assert_eq!(Lens::brown([f64::NAN; 6], [0.0; 2]).valid_radius(1.0), 0.0);
        assert!(Lens::brown([f64::INFINITY; 6], [0.0; 2]).checked().is_err());
    }
}
