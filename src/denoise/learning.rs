//! Sums of what is to be learned of a frame, by block.

use super::blocks::{BLOCK, TERMS};
use super::lanes::{LANES, Lanes};
use super::vectors::{Colors, Features};
use crate::arch::Arch;

/// Numbers of a block: the sums of its model, and zeros up to whole vectors.
pub(crate) type Sums = [f32; STATE];

/// Numbers of a block.
pub(crate) const STATE: usize = TERMS.next_multiple_of(LANES);

/// Returns the number that is added to the squares of features before errors are taken as shares of them. `level` is
/// the root mean square of the features.
#[inline(always)]
pub(crate) fn error_floor(level: f32) -> f32 {
    (0.2 * level).powi(2) + 1e-30
}

/// Rows of pixels to be learned.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lines<'l> {
    pub features: &'l [Features],
    pub colors: &'l [Colors],
    /// Vectors in a row.
    pub groups: usize,
}

/// Adds the sums of a row of blocks to a share of what they were.
#[inline(always)]
pub(crate) fn add(lines: Lines<'_>, kept: f32, arch: Arch, blocks: &mut [Sums]) {
    let Lines { features, colors, groups } = lines;
    let rows = features.len() / groups;
    for (at, blocks) in blocks.chunks_mut(LANES / BLOCK).enumerate() {
        let mut sums = [Lanes::ZERO; STATE];
        for row in 0..rows {
            add_products(&mut sums, features[row * groups + at], &colors[row * groups + at]);
        }
        for row in 0..rows {
            add_moments(&mut sums, features[row * groups + at], &colors[row * groups + at]);
        }
        for vector in 0..STATE / LANES {
            let mut rows = [[0.0; LANES]; LANES];
            for (row, sum) in rows.iter_mut().zip(&sums[vector * LANES..]) {
                *row = sum.0;
            }
            let pixels = arch.transposed(&rows);
            for (block, sums) in pixels.chunks(BLOCK).zip(&mut *blocks) {
                let sum = (Lanes(block[0]) + Lanes(block[1])) + (Lanes(block[2]) + Lanes(block[3]));
                (Lanes::load(sums, vector * LANES) * kept + sum).store(sums, vector * LANES);
            }
        }
    }
}

/// Adds the count, the features and their products of eight pixels to sums.
#[inline(always)]
fn add_products(sums: &mut [Lanes; STATE], z: Features, color: &Colors) {
    let weight = color[3];
    let [a, b, c] = [z[0] * weight, z[1] * weight, z[2] * weight];
    let [p, q, r] = [a * z[0], b * z[1], c * z[2]];
    let terms = [weight, a, b, c, p, a * z[1], a * z[2], q, b * z[2], r];
    for (sum, term) in sums.iter_mut().zip(terms) {
        *sum += term;
    }
}

/// Adds the colors of eight pixels and their products with the features to sums.
#[inline(always)]
fn add_moments(sums: &mut [Lanes; STATE], z: Features, color: &Colors) {
    for c in 0..3 {
        sums[10 + c] += color[c];
        for i in 0..3 {
            sums[13 + 3 * i + c] += z[i] * color[c];
        }
    }
}
