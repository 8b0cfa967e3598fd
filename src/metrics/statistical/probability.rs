//! Tail probabilities, and the correction for many tests.

use statrs::distribution::{ContinuousCDF, Normal, StudentsT};
use statrs::function::beta::checked_beta_reg;
use statrs::function::erf::erfc;
use std::f64::consts::SQRT_2;

/// Degrees of freedom from which on Student's distribution is taken for the normal one. At t = 6 the tail is off by
/// t⁴/(4 ν) of itself there, less than 4 parts in a thousand.
const NORMAL: f64 = 1e5;

/// Returns the probability that the magnitude of Student's t with `freedom` degrees of freedom exceeds that of `t`.
/// An infinite `freedom` stands for the normal distribution; 0 degrees of freedom tell nothing, and give 1.
pub(crate) fn two_sided(t: f64, freedom: f64) -> f64 {
    let t = t.abs();
    if t.is_nan() || freedom <= 0.0 {
        return 1.0;
    }
    if t.is_infinite() {
        return 0.0;
    }
    if freedom >= NORMAL {
        return erfc(t / SQRT_2);
    }
    // P(|T| > t) = I(ν/2, 1/2; ν/(ν + t²)), Abramowitz and Stegun 26.7.1.
    checked_beta_reg(0.5 * freedom, 0.5, freedom / (freedom + t * t)).unwrap_or(1.0)
}

/// Returns the probability that a standard normal number exceeds `z`.
pub(crate) fn upper_normal(z: f64) -> f64 {
    if z.is_nan() { 1.0 } else { 0.5 * erfc(z / SQRT_2) }
}

/// Returns the number that the magnitude of Student's t stays below with probability `confidence`.
pub(crate) fn quantile(confidence: f64, freedom: f64) -> f64 {
    let at = 0.5 * (1.0 + confidence);
    if freedom >= NORMAL {
        return Normal::standard().inverse_cdf(at);
    }
    StudentsT::new(0.0, 1.0, freedom).map_or(f64::INFINITY, |student| student.inverse_cdf(at))
}

/// Returns the probability that the smallest of `count` independent p-values is `p` or less, `1 - (1 - p)^count`, which
/// bounds it for two-sided tests of normal numbers with any correlation (Šidák 1967).
pub(crate) fn of_smallest(p: f64, count: usize) -> f64 {
    // Written so that tiny probabilities keep their digits.
    -f64::exp_m1(count as f64 * f64::ln_1p(-p.clamp(0.0, 1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tails_are_those_of_closed_forms() {
        // ν = 1 is Cauchy's distribution, P = 1 - 2/π atan t; ν = 2 has P = 1 - t/√(2 + t²).
        for t in [0.5_f64, 2.0, 30.0] {
            let cauchy = 1.0 - 2.0 / std::f64::consts::PI * t.atan();
            assert!((two_sided(t, 1.0) / cauchy - 1.0).abs() < 1e-10, "{t}");
            assert!((two_sided(-t, 2.0) / (1.0 - t / (2.0 + t * t).sqrt()) - 1.0).abs() < 1e-9, "{t}");
        }
        // The normal tail at 5: 5.733031e-7 on both sides together (Abramowitz and Stegun, table 26.1).
        assert!((two_sided(5.0, f64::INFINITY) / 5.733_031_4e-7 - 1.0).abs() < 1e-6);
        assert!((two_sided(5.0, 0.99 * NORMAL) / two_sided(5.0, NORMAL) - 1.0).abs() < 3e-3);
        assert!((upper_normal(5.0) / 2.866_515_7e-7 - 1.0).abs() < 1e-6);
        assert_eq!((two_sided(f64::INFINITY, 3.0), two_sided(f64::NAN, 3.0), two_sided(9.0, 0.0)), (0.0, 1.0, 1.0));
    }

    #[test]
    fn quantiles_invert_the_tails() {
        for freedom in [1.0, 7.5, 300.0, f64::INFINITY] {
            assert!((two_sided(quantile(0.95, freedom), freedom) - 0.05).abs() < 1e-6, "{freedom}");
        }
    }

    #[test]
    fn many_tests_are_corrected() {
        assert!((of_smallest(0.05, 2) - 0.0975).abs() < 1e-15);
        assert!((of_smallest(1e-18, 1000) / 1e-15 - 1.0).abs() < 1e-12);
        assert_eq!((of_smallest(1.0, 5), of_smallest(0.0, 5), of_smallest(0.5, 0)), (1.0, 0.0, 0.0));
    }
}
