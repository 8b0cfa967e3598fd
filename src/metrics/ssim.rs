//! Structural similarity: Wang, Bovik, Sheikh, Simoncelli, "Image quality assessment: from error
//! visibility to structural similarity", IEEE TIP 13(4), 2004, eq. 13: Gaussian window 11x11, σ = 1.5,
//! K1 = 0.01, K2 = 0.03, population covariances.
//!
//! The window reaches over the border by mirroring (the edge pixel twice), and the mean is over the pixels whose
//! window lies inside, as in scikit-image's `structural_similarity(gaussian_weights=True, sigma=1.5,
//! use_sample_covariance=False)`. Pictures of fewer than 11 pixels in a direction have no such
//! pixel: there the mean is over all of them in that direction.

use crate::render::film::Film;
use rayon::prelude::*;

const RADIUS: usize = 5;
const SIGMA: f64 = 1.5;
const K1: f64 = 0.01;
const K2: f64 = 0.03;

/// Mean over the three colour channels; `peak` is the range of the signal.
pub fn films(a: &Film, b: &Film, peak: f64) -> f64 {
    let plane = |f: &Film, c: usize| f.rgba.iter().map(|p| p[c]).collect::<Vec<f32>>();
    (0..3).map(|c| planes(&plane(a, c), &plane(b, c), a.width, peak)).sum::<f64>() / 3.0
}

/// Similarity of two planes of rows of `width` pixels; 1 for identical and for empty ones.
pub fn planes(a: &[f32], b: &[f32], width: usize, peak: f64) -> f64 {
    let height = a.len().checked_div(width).unwrap_or(0);
    if height == 0 || a == b {
        return 1.0;
    }
    let moment = |f: &(dyn Fn(f64, f64) -> f64 + Sync)| {
        let values: Vec<f64> = a.iter().zip(b).map(|(x, y)| f(f64::from(*x), f64::from(*y))).collect();
        blurred(&values, width)
    };
    let (mean_a, mean_b) = (moment(&|x, _| x), moment(&|_, y| y));
    let (square_a, square_b, product) = (moment(&|x, _| x * x), moment(&|_, y| y * y), moment(&|x, y| x * y));
    let (c1, c2) = ((K1 * peak).powi(2), (K2 * peak).powi(2));
    let similarity = |i: usize| {
        let (ma, mb) = (mean_a[i], mean_b[i]);
        let (va, vb, cov) = (square_a[i] - ma * ma, square_b[i] - mb * mb, product[i] - ma * mb);
        ((2.0 * ma * mb + c1) * (2.0 * cov + c2)) / ((ma * ma + mb * mb + c1) * (va + vb + c2))
    };
    let inside = |n: usize| if n > 2 * RADIUS { RADIUS..n - RADIUS } else { 0..n };
    let (rows, columns) = (inside(height), inside(width));
    let count = rows.len() * columns.len();
    // Row sums are added in order, so that threads do not change the result.
    let sums: Vec<f64> =
        rows.into_par_iter().map(|y| columns.clone().map(|x| similarity(y * width + x)).sum()).collect();
    sums.iter().sum::<f64>() / count as f64
}

/// Convolution with the window, along rows and then along columns.
fn blurred(values: &[f64], width: usize) -> Vec<f64> {
    let weights = weights();
    let height = values.len() / width;
    let mut rows = vec![0.0; values.len()];
    rows.par_chunks_mut(width).zip(values.par_chunks(width)).for_each(|(out, row)| {
        for (x, o) in out.iter_mut().enumerate() {
            *o = weights.iter().enumerate().map(|(k, w)| w * row[mirrored(x + k, width)]).sum();
        }
    });
    let mut out = vec![0.0; values.len()];
    out.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        for (k, w) in weights.iter().enumerate() {
            let from = mirrored(y + k, height) * width;
            for (o, v) in out.iter_mut().zip(&rows[from..from + width]) {
                *o += w * v;
            }
        }
    });
    out
}

fn weights() -> [f64; 2 * RADIUS + 1] {
    let raw: [f64; 2 * RADIUS + 1] =
        std::array::from_fn(|k| (-0.5 * ((k as f64 - RADIUS as f64) / SIGMA).powi(2)).exp());
    let sum: f64 = raw.iter().sum();
    raw.map(|w| w / sum)
}

/// Index of pixel `shifted - RADIUS`, mirrored at the borders as often as it takes: 1 0 | 0 1 2 | 2 1.
fn mirrored(shifted: usize, n: usize) -> usize {
    let period = 2 * n;
    // A multiple of the period that is at least RADIUS keeps the difference from becoming negative.
    let i = (shifted + period * RADIUS - RADIUS) % period;
    if i < n { i } else { period - 1 - i }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sixteenths and 128ths, exact in `f32`: a pattern, and the pattern with hashed noise.
    fn pair(width: usize, height: usize) -> (Vec<f32>, Vec<f32>) {
        (0..width * height)
            .map(|i| {
                let a = ((i % width * 7 + i / width * 13) % 32) as f32 / 32.0;
                let noise = (i as u32).wrapping_mul(2_654_435_761) >> 27;
                (a, a + noise as f32 / 128.0 - 0.125)
            })
            .unzip()
    }

    /// Constants from scikit-image 0.26.0, `structural_similarity(a, b, gaussian_weights=True, sigma=1.5,
    /// use_sample_covariance=False, data_range=peak)` in float64; those of pictures smaller than the
    /// window from its formula on `scipy.ndimage.gaussian_filter`, averaged as documented above.
    #[test]
    fn agrees_with_scikit_image() {
        for (width, height, peak, expected) in [
            (32, 24, 1.0, 0.969_727_236_725_081_7),
            (11, 11, 1.0, 0.970_571_336_289_943_1),
            (40, 12, 2.5, 0.969_204_380_181_255_7),
            (7, 5, 1.0, 0.969_536_459_963_438),
            (3, 20, 1.0, 0.967_973_362_708_334_7),
            (1, 1, 1.0, 0.006_359_300_476_947_536),
        ] {
            let (a, b) = pair(width, height);
            let found = planes(&a, &b, width, peak);
            // Sums of 22 products in f64 on numbers of order 1; variances are differences of these,
            // divided by at least C2 = 9e-4.
            assert!((found - expected).abs() < 1e-11, "{width}x{height}: {found} {expected}");
        }
    }

    #[test]
    fn identical_and_empty_planes_are_alike() {
        let (a, _) = pair(16, 16);
        assert_eq!(planes(&a, &a, 16, 1.0), 1.0);
        assert_eq!(planes(&[], &[], 0, 1.0), 1.0);
    }
}
