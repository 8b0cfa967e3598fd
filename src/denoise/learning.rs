//! Sums of what is to be learned of a frame, by block.

use super::blocks::{BLOCK, COEFFICIENTS, Planes, TERMS};
use super::detail::Noise;
use super::lanes::{LANES, Lanes};
use super::vectors::{Colors, Features};
use crate::arch::Arch;

/// Numbers of the innovations: `(a - b)²`, `(I - b)(a - b)`, `(I - b)²` and the count, of the color I and the predictions a
/// of the quick model and b of the steady one.
pub const INNOVATIONS: usize = 4;

/// Sums of a block: those of a model, the innovations, and zeros up to whole vectors.
pub type Fresh = [f32; FRESH];

const FRESH: usize = (TERMS + INNOVATIONS).next_multiple_of(LANES);

/// Rows of pixels to be learned.
#[derive(Debug, Clone, Copy)]
pub struct Lines<'l> {
    pub features: &'l [Features],
    pub colors: &'l [Colors],
    /// Vectors in a row.
    pub groups: usize,
}

/// State before the frame is learned.
#[derive(Debug, Clone, Copy)]
pub struct Before<'b> {
    /// Coefficients of both models; `None` before the first frame.
    pub coefficients: Option<&'b Planes>,
    /// Root mean square of the features.
    pub level: f32,
}

/// Sums the pixels of the row of blocks `row`.
#[inline(always)]
pub fn sum(row: usize, lines: Lines<'_>, before: Before<'_>, arch: Arch, fresh: &mut [Fresh]) {
    let Lines { features, colors, groups } = lines;
    let floor = Lanes([Noise::floor(before.level); LANES]);
    let rows = features.len() / groups;
    for (at, fresh) in fresh.chunks_mut(LANES / BLOCK).enumerate() {
        let mut sums = [Lanes::ZERO; FRESH];
        for row in 0..rows {
            add_products(&mut sums, features[row * groups + at], colors[row * groups + at][3]);
        }
        for row in 0..rows {
            add_moments(&mut sums, features[row * groups + at], &colors[row * groups + at]);
        }
        if let Some(coefficients) = before.coefficients {
            let mut beta = [Lanes::ZERO; 2 * COEFFICIENTS];
            for (plane, beta) in beta.iter_mut().enumerate() {
                // Those of the blocks, without interpolation.
                let [a, b] = coefficients.row(row, plane).as_chunks().0[at];
                *beta = Lanes::halves(a, b);
            }
            for row in 0..rows {
                add_innovations(&mut sums, &beta, features[row * groups + at], &colors[row * groups + at], floor);
            }
        }
        for vector in 0..FRESH / LANES {
            let mut rows = [[0.0; LANES]; LANES];
            for (row, sum) in rows.iter_mut().zip(&sums[vector * LANES..]) {
                *row = sum.0;
            }
            let pixels = arch.transposed(&rows);
            for (block, fresh) in pixels.chunks(BLOCK).zip(&mut *fresh) {
                let sum = (Lanes(block[0]) + Lanes(block[1])) + (Lanes(block[2]) + Lanes(block[3]));
                sum.store(fresh, vector * LANES);
            }
        }
    }
}

/// Adds the count, the features and their products of eight pixels to sums.
#[inline(always)]
fn add_products(sums: &mut [Lanes; FRESH], z: Features, weight: Lanes) {
    let [a, b, c] = [z[0] * weight, z[1] * weight, z[2] * weight];
    let terms = [weight, a, b, c, a * z[0], a * z[1], a * z[2], b * z[1], b * z[2], c * z[2]];
    for (sum, term) in sums.iter_mut().zip(terms) {
        *sum += term;
    }
}

/// Adds the colors of eight pixels and their products with the features to sums.
#[inline(always)]
fn add_moments(sums: &mut [Lanes; FRESH], z: Features, color: &Colors) {
    for c in 0..3 {
        sums[10 + c] += color[c];
        for i in 0..3 {
            sums[13 + 3 * i + c] += z[i] * color[c];
        }
    }
}

/// Adds the innovations of eight pixels to sums, each as a share of its feature's square.
#[inline(always)]
fn add_innovations(
    sums: &mut [Lanes; FRESH],
    beta: &[Lanes; 2 * COEFFICIENTS],
    z: Features,
    color: &Colors,
    floor: Lanes,
) {
    let [p, q, r] = z;
    let [mut apart, mut along, mut error] = [Lanes::ZERO; 3];
    for c in 0..3 {
        let a = (beta[c] + beta[3 + c] * p) + (beta[6 + c] * q + beta[9 + c] * r);
        let b = (beta[12 + c] + beta[15 + c] * p) + (beta[18 + c] * q + beta[21 + c] * r);
        let (d, e) = (a - b, color[c] - b);
        apart += d * d;
        along += d * e;
        error += e * e;
    }
    let share = color[3] / (p * p + q * q + r * r + floor);
    for (sum, term) in sums[TERMS..].iter_mut().zip([apart * share, along * share, error * share, color[3]]) {
        *sum += term;
    }
}
