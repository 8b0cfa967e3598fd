//! Phase functions: how scattered light is distributed over directions.

use crate::error::{Error, Result};
use std::f64::consts::PI;

/// A phase function, normalised to an integral of 1 over all directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Phase {
    /// All directions alike.
    Isotropic,
    /// Henyey & Greenstein (1941) with the anisotropy g, the mean cosine of the angle by which light turns: above 0
    /// most goes on forward, below 0 most turns back.
    HenyeyGreenstein(f64),
}

/// Greatest magnitude of the anisotropy: beyond it the peak is narrower than single precision can turn by.
const MOST_ANISOTROPY: f64 = 0.999;

impl Phase {
    /// Returns the phase function of an anisotropy.
    pub fn of_anisotropy(g: f64) -> Self {
        if g == 0.0 { Self::Isotropic } else { Self::HenyeyGreenstein(g) }
    }

    /// Checks the anisotropy.
    ///
    /// # Errors
    /// If its magnitude is above 0.999 or not a number.
    pub fn check(self) -> Result<()> {
        match self {
            Self::HenyeyGreenstein(g) if g.is_nan() || g.abs() > MOST_ANISOTROPY => {
                Err(Error::invalid(format!("anisotropy {g} must lie between -{MOST_ANISOTROPY} and {MOST_ANISOTROPY}"))
                    .hint("at ±1 nothing is scattered at all: lower the density instead"))
            }
            _ => Ok(()),
        }
    }

    /// Returns the density per steradian, given the cosine of the angle between the directions of propagation before
    /// and after.
    pub fn value(self, cosine: f64) -> f64 {
        match self {
            Self::Isotropic => 0.25 / PI,
            Self::HenyeyGreenstein(g) => {
                let denominator = 1.0 + g * g - 2.0 * g * cosine;
                0.25 / PI * (1.0 - g * g) / (denominator * denominator.sqrt())
            }
        }
    }

    /// Returns the cosine of the angle between the directions of propagation before and after, drawn by a number in
    /// [0, 1).
    #[inline]
    pub fn sample(self, u: f64) -> f64 {
        let s = 2.0 * u - 1.0;
        match self {
            Self::Isotropic => s,
            // The usual form divides by g; multiplied out, g cancels.
            Self::HenyeyGreenstein(g) => {
                let a = 1.0 + g * s;
                let cosine = s + g * (0.5 * (s * s + 3.0) + g * (s + 0.5 * g * (s * s - 1.0)));
                (cosine / (a * a)).clamp(-1.0, 1.0)
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    /// The integral over all directions is 1, and the mean cosine g; both by Gauss-Legendre over parts of [-1, 1] that
    /// narrow towards the peak.
    #[test]
    fn phase_functions_are_normalised() {
        let all = [0.0, 1e-9, 0.3, -0.3, 0.9, -0.9, 0.999].map(Phase::HenyeyGreenstein);
        for phase in all.into_iter().chain([Phase::Isotropic]) {
            phase.check().unwrap();
            let g = if let Phase::HenyeyGreenstein(g) = phase { g } else { 0.0 };
            let (mut whole, mut mean) = (0.0, 0.0);
            let mut edge = 2.0_f64;
            for _ in 0..60 {
                let (half, middle) = (0.25 * edge, 1.0 - 0.75 * edge);
                for (node, weight) in
                    [(-0.774_596_669_241_483_4, 5.0 / 9.0), (0.0, 8.0 / 9.0), (0.774_596_669_241_483_4, 5.0 / 9.0)]
                {
                    for part in 0..64 {
                        let cosine = middle + half * ((2.0 * f64::from(part) + 1.0 + node) / 64.0 - 1.0);
                        let share =
                            2.0 * PI * half / 64.0 * weight * phase.value(if g < 0.0 { -cosine } else { cosine });
                        whole += share;
                        mean += share * if g < 0.0 { -cosine } else { cosine };
                    }
                }
                edge *= 0.5;
            }
            assert!((whole - 1.0).abs() < 1e-9 && (mean - g).abs() < 1e-9, "{phase:?}: {whole} {mean}");
        }
    }

    /// The share of cosines below one that is drawn for u is u itself.
    #[test]
    fn drawn_cosines_follow_the_phase_function() {
        for g in [0.0_f64, 1e-9, 0.3, -0.3, 0.9, -0.9, 0.999] {
            let phase = Phase::HenyeyGreenstein(g);
            // ∫ from -1 to c of the phase function, in closed form.
            let below = |c: f64| {
                let term = |c: f64| (1.0 + g * g - 2.0 * g * c).sqrt().recip();
                if g.abs() < 1e-6 { 0.5 * (c + 1.0) } else { (1.0 - g * g) / (2.0 * g) * (term(c) - term(-1.0)) }
            };
            for i in 0..=100 {
                let u = f64::from(i) / 100.0;
                assert!((below(phase.sample(u)) - u).abs() < 1e-8, "{g}: {u} {}", below(phase.sample(u)));
            }
        }
        assert_eq!(Phase::Isotropic.sample(0.25), -0.5);
    }

    #[test]
    fn what_scatters_nothing_is_refused() {
        for g in [1.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(Phase::HenyeyGreenstein(g).check().unwrap_err().to_string().contains("anisotropy"));
        }
    }
}
