//! Structural similarity: Wang, Bovik, Sheikh, Simoncelli, "Image quality assessment: from error
//! visibility to structural similarity", IEEE TIP 13(4), 2004, eq. 13: Gaussian window 11x11, σ = 1.5,
//! K1 = 0.01, K2 = 0.03, population covariances.
//!
//! The window reaches over the border by mirroring (the edge pixel twice), and the mean is over the pixels whose
//! window lies inside, as in scikit-image's `structural_similarity(gaussian_weights=True, sigma=1.5,
//! use_sample_covariance=False)`. Pictures of fewer than 11 pixels in a direction have no such
//! pixel: there the mean is over all of them in that direction.

use crate::scene::film::Film;
use rayon::prelude::*;
use std::ops::Range;

const RADIUS: usize = 5;
const SIGMA: f64 = 1.5;
const K1: f64 = 0.01;
const K2: f64 = 0.03;

/// Mean similarity of the three color channels; `peak` is the range of the signal.
pub(crate) fn films(a: &Film, b: &Film, peak: f64) -> f64 {
    let plane = |f: &Film, c: usize| f.rgba.iter().map(|p| p[c]).collect::<Vec<f32>>();
    (0..3).map(|c| planes(&plane(a, c), &plane(b, c), a.width, peak)).sum::<f64>() / 3.0
}

/// Number of rows whose window means are held at a time.
const BAND: usize = 32;

/// Upper bound in bytes of the memory that [`films`] needs beside one plane of each film, for rows of `width` pixels.
/// Each thread holds five means of the rows of a band, and one row-wise mean of the rows that the band's windows reach.
pub(crate) fn working_memory(width: usize) -> u64 {
    let rows = 5 * BAND + BAND + 2 * RADIUS + 2;
    (rayon::current_num_threads() * rows * size_of::<f64>()) as u64 * width as u64
}

/// Similarity of two planes with rows of `width` pixels; 1 for identical and for empty planes.
pub(crate) fn planes(a: &[f32], b: &[f32], width: usize, peak: f64) -> f64 {
    let height = a.len().checked_div(width).unwrap_or(0);
    if height == 0 || a == b {
        return 1.0;
    }
    let (c1, c2) = ((K1 * peak).powi(2), (K2 * peak).powi(2));
    let inside = |n: usize| if n > 2 * RADIUS { RADIUS..n - RADIUS } else { 0..n };
    let (rows, columns) = (inside(height), inside(width));
    let count = rows.len() * columns.len();
    let bands: Vec<Range<usize>> =
        rows.clone().step_by(BAND).map(|start| start..(start + BAND).min(rows.end)).collect();
    let row_sums = |band: Range<usize>| {
        let moment =
            |f: fn(f64, f64) -> f64| blurred_rows(|i| f(f64::from(a[i]), f64::from(b[i])), width, height, band.clone());
        let (mean_a, mean_b) = (moment(|x, _| x), moment(|_, y| y));
        let (square_a, square_b, product) = (moment(|x, _| x * x), moment(|_, y| y * y), moment(|x, y| x * y));
        let similarity = |i: usize| {
            let (ma, mb) = (mean_a[i], mean_b[i]);
            let (va, vb, cov) = (square_a[i] - ma * ma, square_b[i] - mb * mb, product[i] - ma * mb);
            ((2.0 * ma * mb + c1) * (2.0 * cov + c2)) / ((ma * ma + mb * mb + c1) * (va + vb + c2))
        };
        let sum = |y: usize| columns.clone().map(|x| similarity(y * width + x)).sum::<f64>();
        (0..band.len()).map(sum).collect::<Vec<f64>>()
    };
    // Row sums are added in order, so that threads do not change the result.
    let sums: Vec<Vec<f64>> = bands.into_par_iter().map(row_sums).collect();
    sums.iter().flatten().sum::<f64>() / count as f64
}

/// Rows `rows` of the convolution of a plane with the window, bit-identical to those of [`blurred`].
fn blurred_rows(value: impl Fn(usize) -> f64, width: usize, height: usize, rows: Range<usize>) -> Vec<f64> {
    let weights = weights();
    let mut line = vec![0.0; width];
    let mut reached = vec![0.0; (rows.len() + 2 * RADIUS) * width];
    for (k, along) in reached.chunks_mut(width).enumerate() {
        let from = mirrored(rows.start + k, height) * width;
        line.iter_mut().enumerate().for_each(|(x, v)| *v = value(from + x));
        for (x, o) in along.iter_mut().enumerate() {
            *o = weights.iter().enumerate().map(|(k, w)| w * line[mirrored(x + k, width)]).sum();
        }
    }
    let mut out = vec![0.0; rows.len() * width];
    for (y, out) in out.chunks_mut(width).enumerate() {
        for (w, along) in weights.iter().zip(reached[y * width..].chunks(width)) {
            for (o, v) in out.iter_mut().zip(along) {
                *o += w * v;
            }
        }
    }
    out
}

/// Similarity of two planes, and its derivative with respect to each pixel of `a`.
pub(crate) fn gradient(a: &[f64], b: &[f64], width: usize, peak: f64) -> (f64, Vec<f64>) {
    let height = a.len().checked_div(width).unwrap_or(0);
    if height == 0 {
        return (1.0, Vec::new());
    }
    let moment =
        |f: &dyn Fn(f64, f64) -> f64| blurred(&a.iter().zip(b).map(|(x, y)| f(*x, *y)).collect::<Vec<_>>(), width);
    let (mean_a, mean_b) = (moment(&|x, _| x), moment(&|_, y| y));
    let (square_a, square_b, product) = (moment(&|x, _| x * x), moment(&|_, y| y * y), moment(&|x, y| x * y));
    let (c1, c2) = ((K1 * peak).powi(2), (K2 * peak).powi(2));
    let inside = |n: usize| if n > 2 * RADIUS { RADIUS..n - RADIUS } else { 0..n };
    let share = 1.0 / (inside(height).len() * inside(width).len()) as f64;
    // Derivatives with respect to the window's means of a, a² and a b.
    let mut by = [0; 3].map(|_| vec![0.0; a.len()]);
    let mut sum = 0.0;
    for i in inside(height).flat_map(|y| inside(width).map(move |x| y * width + x)) {
        let (ma, mb) = (mean_a[i], mean_b[i]);
        let (va, vb, cov) = (square_a[i] - ma * ma, square_b[i] - mb * mb, product[i] - ma * mb);
        let (light, both) = (2.0 * ma * mb + c1, 2.0 * cov + c2);
        let (lights, spread) = (ma * ma + mb * mb + c1, va + vb + c2);
        let similarity = light * both / (lights * spread);
        sum += similarity;
        let by_mean = 2.0 * mb * both / (lights * spread) - similarity * 2.0 * ma / lights;
        let (by_spread, by_both) = (-similarity / spread, 2.0 * light / (lights * spread));
        by[0][i] = share * (by_mean - 2.0 * ma * by_spread - mb * by_both);
        by[1][i] = share * by_spread;
        by[2][i] = share * by_both;
    }
    let [by_mean, by_square, by_product] = by.map(|by| blurred_transposed(&by, width));
    let slope = (0..a.len()).map(|i| by_mean[i] + 2.0 * a[i] * by_square[i] + b[i] * by_product[i]);
    (share * sum, slope.collect())
}

/// Transpose of the linear map [`blurred`].
fn blurred_transposed(values: &[f64], width: usize) -> Vec<f64> {
    let weights = weights();
    let height = values.len() / width;
    let mut rows = vec![0.0; values.len()];
    for (y, row) in values.chunks(width).enumerate() {
        for (k, w) in weights.iter().enumerate() {
            let to = mirrored(y + k, height) * width;
            for (o, v) in rows[to..to + width].iter_mut().zip(row) {
                *o += w * v;
            }
        }
    }
    let mut out = vec![0.0; values.len()];
    for (out, row) in out.chunks_mut(width).zip(rows.chunks(width)) {
        for (x, v) in row.iter().enumerate() {
            for (k, w) in weights.iter().enumerate() {
                out[mirrored(x + k, width)] += w * v;
            }
        }
    }
    out
}

/// Convolution of a plane with the window, along rows and then along columns.
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

    /// A pattern and the pattern with hashed noise, in multiples of 1/16 and 1/128, which are exact in `f32`.
    fn pair(width: usize, height: usize) -> (Vec<f32>, Vec<f32>) {
        (0..width * height)
            .map(|i| {
                let a = ((i % width * 7 + i / width * 13) % 32) as f32 / 32.0;
                let noise = (i as u32).wrapping_mul(2_654_435_761) >> 27;
                (a, a + noise as f32 / 128.0 - 0.125)
            })
            .unzip()
    }

    /// Expected values are from scikit-image 0.26.0, `structural_similarity(a, b, gaussian_weights=True, sigma=1.5,
    /// use_sample_covariance=False, data_range=peak)` in float64. For pictures smaller than the window they are from
    /// its formula on `scipy.ndimage.gaussian_filter`, averaged as the module header says.
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

    /// The gradient's value is that of [`planes`]; its derivative is tested with the loss that uses it.
    #[test]
    fn the_gradients_value_is_the_value() {
        for (width, height) in [(32, 24), (7, 5), (3, 20)] {
            let (a, b) = pair(width, height);
            let wide = |p: &[f32]| p.iter().map(|v| f64::from(*v)).collect::<Vec<_>>();
            let (value, _) = gradient(&wide(&a), &wide(&b), width, 1.0);
            assert!((value - planes(&a, &b, width, 1.0)).abs() < 1e-12);
        }
    }

    /// The rows of bands are those of the whole convolution, to the bit.
    #[test]
    fn bands_are_parts_of_the_whole() {
        for (width, height) in [(9, 100), (40, 33), (3, 4)] {
            let (a, b) = pair(width, height);
            let product = |i: usize| f64::from(a[i]) * f64::from(b[i]);
            let whole = blurred(&(0..a.len()).map(product).collect::<Vec<_>>(), width);
            for start in (0..height).step_by(BAND) {
                let rows = start..(start + BAND).min(height);
                let band = blurred_rows(product, width, height, rows.clone());
                assert!(band.iter().zip(&whole[rows.start * width..]).all(|(x, y)| x.to_bits() == y.to_bits()));
                assert_eq!(band.len(), rows.len() * width);
            }
        }
    }

    #[test]
    fn identical_and_empty_planes_are_alike() {
        let (a, _) = pair(16, 16);
        assert_eq!(planes(&a, &a, 16, 1.0), 1.0);
        assert_eq!(planes(&[], &[], 0, 1.0), 1.0);
    }
}
