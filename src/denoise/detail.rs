//! Detail that smoothing takes from the histories, and the shares of it that the colors confirm.
//!
//! The feature is a mean over many pixels. What it lacks of the history itself is taken apart into two bands: that of a
//! mean over few pixels, and that of single pixels. A frame's colors are independent of its history's noise. So the
//! share of a band by which they follow it, its regression coefficient, is what is signal in it: 1 of texture at rest,
//! 0 of noise. Bands whose share may be chance are left out (James & Stein 1961).

use super::blocks::{BLOCK, Planes, Pool};
use super::lanes::{LANES, Lanes, each};
use super::vectors::{Colors, Features};
use crate::arch::Arch;

/// Histories of eight pixels by channel.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Histories {
    /// Means over few pixels.
    pub near: Features,
    /// Histories of the pixels alone.
    pub own: Features,
    /// 1 where there is a history, and 0 where the frame itself stands for it, whose noise is the color's.
    pub known: Lanes,
}

/// Sums of a block: products of residual and band, of band and band, the residual's square, and the count of pixels.
pub(crate) type Sums = [f32; LANES];

/// Sums without the count.
const TERMS: usize = 6;
/// Place of the count of pixels.
const COUNT: usize = TERMS;
/// Place of the sum of the squares of what is predicted, which the frame's weight is taken from.
const POWER: usize = TERMS + 1;

/// Coefficients of a block: the share of each band.
pub(crate) const SHARES: usize = 2;

/// Explained energy as a multiple of what chance explains on average, below which a band is left out.
const CHANCE: f32 = 2.0;
/// Least energy, where there is none.
const LEAST: f32 = 1e-30;

/// Rows of pixels whose detail is learned.
pub(crate) struct Lines<'l> {
    /// Colors that the models predict from the features.
    pub predicted: &'l [Features],
    pub histories: &'l [Histories],
    pub colors: &'l [Colors],
    /// Vectors in a row.
    pub groups: usize,
}

/// Returns the bands of detail of a channel of eight pixels: means over few pixels less what is predicted, and pixels
/// less means; none where there is no history.
#[inline(always)]
pub(crate) fn bands(predicted: Lanes, histories: &Histories, channel: usize) -> [Lanes; SHARES] {
    let Histories { near, own, known } = histories;
    [(near[channel] - predicted) * *known, (own[channel] - near[channel]) * *known]
}

/// Adds the sums of a row of blocks to a share of what they were. `floor` is added to the squares of what is predicted
/// before errors are taken as shares of them.
#[inline(always)]
pub(crate) fn add(lines: &Lines<'_>, floor: f32, kept: f32, arch: Arch, blocks: &mut [Sums]) {
    let groups = lines.groups;
    let rows = lines.predicted.len() / groups;
    for (at, blocks) in blocks.chunks_mut(LANES / BLOCK).enumerate() {
        let mut sums = [Lanes::ZERO; LANES];
        for row in 0..rows {
            let at = row * groups + at;
            let (z, histories, color) = (lines.predicted[at], &lines.histories[at], &lines.colors[at]);
            let seen = color[3] * histories.known;
            sums[POWER] += ((z[0] * z[0] + z[1] * z[1]) + z[2] * z[2]) * seen;
            let mut terms = [Lanes::ZERO; TERMS];
            for c in 0..3 {
                let residual = color[c] - z[c];
                let [coarse, fine] = bands(z[c], histories, c);
                let products = [
                    residual * coarse,
                    residual * fine,
                    coarse * coarse,
                    coarse * fine,
                    fine * fine,
                    residual * residual,
                ];
                for (term, product) in terms.iter_mut().zip(products) {
                    *term += product;
                }
            }
            for (sum, term) in sums.iter_mut().zip(terms) {
                *sum += term * seen;
            }
            sums[COUNT] += seen;
        }
        let pixels = arch.transposed(&sums.map(|sum| sum.0));
        for (block, sums) in pixels.chunks(BLOCK).zip(&mut *blocks) {
            let mut sum = (Lanes(block[0]) + Lanes(block[1])) + (Lanes(block[2]) + Lanes(block[3]));
            // Errors of bright blocks are larger: all count by their relative ones. Within a block they count as they
            // are, or bright points were lost among dark pixels.
            let weight = 1.0 / (sum.0[POWER] / sum.0[COUNT].max(1.0) + floor);
            sum.0[..TERMS].iter_mut().for_each(|sum| *sum *= weight);
            sum.0[POWER] = 0.0;
            *sums = (Lanes(*sums) * kept + sum).0;
        }
    }
}

/// Writes the shares of a row of blocks from their sums, pooled over the blocks within `radius`.
#[inline(always)]
pub(crate) fn solve_row(sums: &Planes, row: usize, radius: usize, pool: &mut Pool, shares: &mut [f32]) {
    let (vectors, pooled) = pool.sums(sums, row, (0..=COUNT).map(|plane| (plane, radius)));
    let stride = vectors * LANES;
    for vector in 0..vectors {
        let terms = each(|term| pooled[term * vectors + vector]);
        for (band, found) in of_sums(&terms, pooled[COUNT * vectors + vector]).into_iter().enumerate() {
            found.store(shares, band * stride + vector * LANES);
        }
    }
}

/// Returns the shares of the bands of eight blocks from their sums over so many pixels.
#[inline(always)]
fn of_sums(sums: &[Lanes; TERMS], pixels: Lanes) -> [Lanes; SHARES] {
    let [x1, x2, s11, s12, s22, xx] = *sums;
    let (one, least) = (Lanes([1.0; LANES]), Lanes([LEAST; LANES]));
    let by_chance = |energy: Lanes, left: Lanes| {
        let noise = left.max(Lanes::ZERO) / (pixels + Lanes([LEAST; LANES])) * CHANCE;
        (one - noise / energy.max(least)).max(Lanes::ZERO)
    };
    // The coarse band, and what the fine one adds to it.
    let coarse = (x1 / s11.max(least)).max(Lanes::ZERO);
    let explained = x1.max(Lanes::ZERO) * coarse;
    let along = s12 / s11.max(least);
    let (x, s) = (x2 - along * x1, (s22 - along * s12).max(least));
    let fine = (x / s).max(Lanes::ZERO).min(one);
    let more = x.max(Lanes::ZERO) * fine;
    let left = xx - explained - more;
    let coarse = coarse * by_chance(explained, left);
    let fine = fine * by_chance(more, left);
    [(coarse - along * fine).max(Lanes::ZERO).min(one), fine]
}
