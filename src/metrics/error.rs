//! Error measures of pictures, accumulated in `f64`.

use crate::scene::film::Film;

/// Added to the denominator of the relative error, so that black pixels do not dominate.
const RELATIVE_FLOOR: f64 = 0.01;

/// Errors of the colors of two films.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Errors {
    /// Mean squared difference over pixels and color channels.
    pub mse: f64,
    /// Relative mean squared error: the mean of (a - b)² / (b² + 0.01) over pixels and color channels.
    pub rel_mse: f64,
    /// Largest absolute difference of a color channel.
    pub max_abs: f64,
    /// Largest absolute difference of alpha.
    pub alpha_max_abs: f64,
}

/// Errors of `a` against the reference `b` of equal size.
/// Means are over `pixels` pixels, which may be fewer than all if both films are equal in the others.
pub(crate) fn colors(a: &Film, b: &Film, pixels: usize) -> Errors {
    let (mut square, mut relative, mut max_abs, mut alpha_max_abs) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
    for (p, q) in a.rgba.iter().zip(&b.rgba) {
        for c in 0..3 {
            let (x, y) = (f64::from(p[c]), f64::from(q[c]));
            let d2 = (x - y) * (x - y);
            square += d2;
            relative += d2 / (y * y + RELATIVE_FLOOR);
            max_abs = max_abs.max((x - y).abs());
        }
        alpha_max_abs = alpha_max_abs.max((f64::from(p[3]) - f64::from(q[3])).abs());
    }
    let n = 3.0 * pixels.max(1) as f64;
    Errors { mse: square / n, rel_mse: relative / n, max_abs, alpha_max_abs }
}

/// Peak signal-to-noise ratio in dB of a mean squared error; infinite where the error is 0.
pub fn psnr_db(mse: f64, peak: f64) -> f64 {
    if mse == 0.0 { f64::INFINITY } else { 10.0 * (peak * peak / mse).log10() }
}

/// Peak signal-to-noise ratio in dB of a mean squared error, peak 1; at most 200 dB, beyond which differences are those
/// of rounding.
pub fn unit_psnr_db(mse: f64) -> f64 {
    -10.0 * mse.max(1e-20).log10()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_forms() {
        // A constant difference d: mse = d², psnr = -20 log10(d); d = 1/16 is exact in f32.
        let b = Film::of(4, 2, vec![[0.5, 0.5, 0.5, 1.0]; 8]);
        let a = Film::of(4, 2, vec![[0.5625, 0.5625, 0.5625, 0.75]; 8]);
        let e = colors(&a, &b, 8);
        assert_eq!((e.mse, e.max_abs, e.alpha_max_abs), (1.0 / 256.0, 0.0625, 0.25));
        // 1/256 / 0.26: two roundings of 2^-53 each.
        assert!((e.rel_mse - 1.0 / 256.0 / 0.26).abs() < 4.0 * f64::EPSILON);
        assert!((psnr_db(e.mse, 1.0) - 24.082_399_653_118_497).abs() < 1e-12);
        assert_eq!(psnr_db(0.0, 1.0), f64::INFINITY);
    }
}
