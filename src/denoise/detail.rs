//! Detail within opaque parts of a picture, where alpha guides nothing.
//!
//! There the feature is a mean over many pixels, which blurs what is finer. A mean over few pixels is mixed in as far as both
//! differ by more than noise: of a difference d with the variance n of its noise, the share `1 - n / E[d²]` is signal (Wiener).

use super::blocks::BLOCK;
use super::lanes::{LANES, Lanes};
use super::learning::{DISTANCES, Sums, error_floor};
use super::vectors::Features;

/// Mean alpha from which on detail is mixed in; it is fully so where all around is opaque.
const LEAST_ALPHA: f32 = 0.9;
/// Variance of the noise in the mean over few pixels, as a share of that in a pixel's color.
const LEFT: f32 = 0.02;

/// Noise of the colors in a band of rows, as far as it is known.
#[derive(Debug, Clone, Copy)]
pub struct Noise<'n> {
    /// Sums of the blocks, row by row.
    pub blocks: &'n [Sums],
    /// Blocks in a row.
    pub columns: usize,
    /// Root mean square of the features.
    pub level: f32,
}

impl Noise<'_> {
    /// Returns the sum and the count of the errors in the blocks that eight pixels lie in.
    #[inline(always)]
    fn errors(&self, row: usize, at: usize) -> [f32; 2] {
        let from = at * LANES / BLOCK;
        let blocks = &self.blocks[row * self.columns..][from..(from + LANES / BLOCK).min(self.columns)];
        blocks.iter().fold([0.0; 2], |[error, count], sums| [error + sums[DISTANCES], count + sums[0]])
    }
}

/// Returns how far detail is mixed in by the mean alpha around.
#[inline(always)]
pub fn opaqueness(alpha: Lanes) -> Lanes {
    ((alpha - LEAST_ALPHA) * (1.0 / (1.0 - LEAST_ALPHA))).max(Lanes::ZERO).min(Lanes([1.0; LANES]))
}

/// Mixes means over few pixels (`near`) into the features of row `y` of the band, by `opaque`.
#[inline(always)]
pub fn mix(
    y: usize,
    features: &mut [Features],
    near: &[Features],
    opaque: &[Lanes],
    noise: Noise<'_>,
    sums: &mut Vec<[f32; 2]>,
) {
    let floor = error_floor(noise.level);
    sums.clear();
    for (at, (features, near)) in features.iter().zip(near).enumerate() {
        let (mut apart, mut square) = (Lanes::ZERO, Lanes([floor; LANES]));
        for c in 0..3 {
            apart += (near[c] - features[c]) * (near[c] - features[c]);
            square += features[c] * features[c];
        }
        let [error, count] = noise.errors(y / BLOCK, at);
        let expected = LEFT * error / (count + 1e-3);
        sums.push([apart.0.iter().sum::<f32>(), expected * square.0.iter().sum::<f32>()]);
    }
    for (at, ((features, near), opaque)) in features.iter_mut().zip(near).zip(opaque).enumerate() {
        let around = &sums[at.saturating_sub(1)..(at + 2).min(sums.len())];
        let [apart, expected] = around.iter().fold([0.0; 2], |[p, q], [r, s]| [p + r, q + s]);
        let share = *opaque * (1.0 - expected / (apart + 1e-30)).max(0.0);
        for c in 0..3 {
            features[c] += (near[c] - features[c]) * share;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::denoise::learning::STATE;

    /// Returns the mix of a far mean of 1 and a near mean of 1.2 under a mean alpha, where colors have errors of this variance.
    fn mixed(alpha: f32, error: f32) -> f32 {
        let mut block = [0.0; STATE];
        [block[DISTANCES], block[0]] = [error, 1.0];
        let noise = Noise { blocks: &[block; 4], columns: 4, level: 1.0 };
        let mut features = [[Lanes([1.0; LANES]); 3]; 2];
        let near = [[Lanes([1.2; LANES]); 3]; 2];
        let opaque = [opaqueness(Lanes([alpha; LANES])); 2];
        mix(0, &mut features, &near, &opaque, noise, &mut Vec::new());
        features[1][2].0[5]
    }

    #[test]
    fn what_differs_by_more_than_noise_is_mixed_in_where_all_is_opaque() {
        // Of d² = 0.04, a noise of 0.02 of the feature's square is half.
        let half = mixed(1.0, 0.02 / LEFT);
        assert!((half - 1.1).abs() < 1e-3, "{half}");
        assert!((mixed(1.0, 0.0) - 1.2).abs() < 1e-6 && (mixed(1.0, 9.0 / LEFT) - 1.0).abs() < 1e-6);
        assert!((mixed(0.95, 0.0) - 1.1).abs() < 1e-5 && (mixed(0.9, 0.0) - 1.0).abs() < 1e-5);
    }
}
