//! Estimate of the noise that comes in with a frame and of the error that is left, from what the frame shows alone.
//!
//! The residual's square is the sum of the noise's and of the denoiser's error, and the product of a pixel's
//! differences from the frames before and after is the square of its noise ([`difference`](super::difference)). Their
//! difference is on average the error's square, and most of the chance in both is the same and cancels. Where a share s
//! of the residual comes back, (1 - s)² of the error is left and s² of the noise.
//!
//! Denoised colors hold a little of their own noise, since models are learned from it: as large a share as a model's
//! degrees of freedom are of the samples that it rests on. Twice that is added (Mallows 1973).
//!
//! Noise is told from signal where the frames around show the same signal, and noise is independent from pixel to pixel
//! and from frame to frame. The square of a difference is then the noise's, and that of the other frame's, less what
//! resampling averages away. More of it shows that something moves which the motion does not tell, and less that
//! resampling loses texture, which counts as noise. Sums of differences over blocks have as much power as their pixels
//! together, and more where something moves, or a filter has spread the noise. Nothing is estimated in all these cases
//! ([`Estimate::fits`]). Changes of light have been taken out of the differences.

use super::lanes::{LANES, Lanes, each};
use super::reprojection;
use glam::Vec2;

/// Planes of a map: noise and error.
pub(crate) const MAPPED: usize = 2;

/// Standard deviations of the estimate that [`Estimate::error_high`] adds to it.
const DEVIATIONS: f64 = 2.0;
/// Variance of the sum over frames as a multiple of the sum of their variances: two frames in turn have two of five
/// products of noise in common.
const CORRELATION: f64 = 5.0 / 3.0;
/// Squares of differences, as a multiple of what noise explains, between which the frames around show the same signal.
const FITTING: [f64; 2] = [0.975, 1.02];
/// Squares of the sums of differences over blocks, as a multiple of the noise, between which pixels are independent:
/// resampling spreads some of it to other blocks.
const INDEPENDENT: [f64; 2] = [0.9, 1.03];
/// Deviations of both by chance, as multiples of that of the mean over as many numbers as there are blocks.
const BY_CHANCE: [f64; 2] = [0.5, 2.0];

/// Noise and error of a frame or of several, in units of the colors, over the channels of the pixels of which it can be
/// told: those that the frames before and after show.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Estimate {
    /// Number of pixels.
    pub pixels: f64,
    /// Sums of the squares over pixels and channels: of the noise that came in, and of the error that is left, which
    /// chance makes negative where there is little.
    noise: f64,
    error: f64,
    /// Sum of the squares of what blocks add to the error.
    chance: f64,
    /// Sum of the squares of the colors.
    power: f64,
    /// Mean of the sums of the squares of the differences from both sides, and what noise explains of it.
    apart: f64,
    explained: f64,
    /// Mean of the squares of the sums of the differences from both sides over blocks.
    pooled: f64,
    /// Numbers of blocks that are not empty, and of those of which most of the residual comes back.
    blocks: f64,
    as_it_was: f64,
}

/// Sums over a row of blocks: the squares of the denoised colors, those of the differences from both sides, and those
/// of the differences' sums over blocks.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Row {
    pub power: f64,
    pub apart: f64,
    pub pooled: f64,
}

/// Planes of a row of blocks.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Blocks<'b> {
    /// Count of the pixels that are known on both sides of time.
    pub pixels: &'b [f32],
    /// Sums of the squares of the noise and of the residual of those pixels.
    pub noise: &'b [f32],
    pub residual: &'b [f32],
    /// Shares of the residual that come back.
    pub shares: &'b [f32],
    /// Shares of their own noise that denoised colors hold.
    pub own: &'b [f32],
    /// Mean motions; empty if there are none.
    pub motions: &'b [Vec2],
}

/// Channels of a pixel.
const CHANNELS: f64 = 3.0;

impl Estimate {
    /// Returns the estimate of both together.
    pub fn plus(self, other: Self) -> Self {
        self.plus_share(1.0, other)
    }

    /// Returns the estimate of a share of this one and another together.
    pub(crate) fn plus_share(self, share: f64, other: Self) -> Self {
        Self {
            pixels: share * self.pixels + other.pixels,
            noise: share * self.noise + other.noise,
            error: share * self.error + other.error,
            chance: share * self.chance + other.chance,
            power: share * self.power + other.power,
            apart: share * self.apart + other.apart,
            explained: share * self.explained + other.explained,
            pooled: share * self.pooled + other.pooled,
            blocks: share * self.blocks + other.blocks,
            as_it_was: share * self.as_it_was + other.as_it_was,
        }
    }

    /// True if the frames around show the same signal, with noise that is independent, and the error's square does not
    /// come out negative, which shows that it is too small to be told from chance.
    pub fn fits(&self) -> bool {
        let chance = self.blocks.max(1.0).sqrt().recip();
        let is_within = |found: f64, all: f64, [least, most]: [f64; 2], chance: f64| {
            ((least - chance) * all..=(most + chance) * all).contains(&found)
        };
        let is_same = is_within(self.apart, self.explained, FITTING, BY_CHANCE[0] * chance);
        let is_independent = is_within(self.pooled, 2.0 * self.noise, INDEPENDENT, BY_CHANCE[1] * chance);
        self.explained > 0.0 && self.error > 0.0 && is_same && is_independent
    }

    fn root(&self, sum: f64) -> f64 {
        (sum.max(0.0) / (CHANNELS * self.pixels).max(1.0)).sqrt()
    }

    /// Returns the root mean square of the noise that came in.
    pub fn noise(&self) -> f64 {
        self.root(self.noise)
    }

    /// Returns the root mean square of the error that is left.
    pub fn error(&self) -> f64 {
        self.root(self.error)
    }

    /// Returns the upper end of the interval that holds the root mean square error with a probability of 95 %, as far
    /// as the estimate errs by chance.
    pub fn error_high(&self) -> f64 {
        self.root(self.error.max(0.0) + DEVIATIONS * (CORRELATION * self.chance).sqrt())
    }

    /// Returns the share of the picture, as far as it is not empty, that is much as it was: it has no noise, or the
    /// frames around do not show it.
    pub fn as_it_was(&self) -> f64 {
        self.as_it_was / self.blocks.max(1.0)
    }

    /// Returns the root mean square of the denoised colors.
    pub fn level(&self) -> f64 {
        self.root(self.power)
    }

    /// Returns the estimate of a row of blocks.
    pub(crate) fn of_row(blocks: Blocks<'_>, row: Row) -> Self {
        let Row { power, apart, pooled } = row;
        let mut found = Self { power, apart, pooled, ..Self::default() };
        for at in 0..blocks.pixels.len() {
            let of = |plane: &[f32]| f64::from(plane[at]);
            let (noise, share) = (of(blocks.noise), of(blocks.shares));
            let own = noise * of(blocks.own).min(1.0);
            let left = of(blocks.residual) - noise + 2.0 * own;
            let error = (1.0 - share).powi(2) * left + share.powi(2) * noise;
            found.pixels += of(blocks.pixels);
            found.noise += noise;
            found.error += error;
            found.chance += error.powi(2);
            let gain = blocks.motions.get(at).map_or(1.0, |motion| reprojection::noise_gain(*motion));
            // Where nothing is there nothing can change.
            let is_there = if of(blocks.residual) > 0.0 { 1.0 } else { 0.0 };
            found.blocks += is_there;
            found.as_it_was += if share > 0.5 { is_there } else { 0.0 };
            found.explained += noise * f64::from(1.0 + gain);
        }
        found
    }
}

/// Standard deviation of the estimated square of the error, as a share of the noise's square, times the root of the
/// number of pixels: that of the product of two differences, of which only the square of the noise itself cancels.
const DEVIATION: f32 = 1.75;
/// Value of pixels of which nothing can be told.
const UNKNOWN: f32 = -1.0;

/// Writes the root mean squares of the noise and of the error of a row of blocks, plane after plane, from the count of
/// pixels and the sums of the squares of noise and residual, which are pooled, and the shares that come back. The error
/// is no less than one standard deviation of its estimate. Nothing is known where the frames do not fit.
pub(crate) fn map_row([pixels, noise, residual]: [&[Lanes]; 3], shares: &[f32], fits: bool, to: &mut [f32]) {
    let stride = to.len() / MAPPED;
    for vector in 0..pixels.len() {
        let share = Lanes::load(shares, vector * LANES);
        let of = |lane: usize| {
            let [pixels, noise, residual] = [pixels, noise, residual].map(|plane| plane[vector].0[lane].max(0.0));
            let least = DEVIATION * noise / pixels.sqrt();
            let left = (1.0 - share.0[lane]).powi(2) * (residual - noise).max(least) + share.0[lane].powi(2) * noise;
            let root =
                |sum: f32| if fits && pixels > 0.0 { (sum / (CHANNELS as f32 * pixels)).sqrt() } else { UNKNOWN };
            [root(noise), root(left)]
        };
        let found: [[f32; MAPPED]; LANES] = each(of);
        for plane in 0..MAPPED {
            Lanes(each(|lane| found[lane][plane])).store(to, plane * stride + vector * LANES);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(noise: f32, residual: f32, share: f32, [apart, pooled]: [f64; 2]) -> Estimate {
        let [pixels, noise, residual, shares, own] = [16.0, noise, residual, share, 0.0].map(|value| vec![value; 500]);
        let motions = &[];
        let blocks =
            Blocks { pixels: &pixels, noise: &noise, residual: &residual, shares: &shares, own: &own, motions };
        Estimate::of_row(blocks, Row { power: 48.0 * 500.0, apart, pooled })
    }

    /// The error is what the residual has over the noise. Where a share of the residual comes back, less of that is
    /// left, and as much of the noise is added.
    #[test]
    fn error_is_residual_less_noise() {
        let [noise, error] = [0.04, 0.01].map(|square: f32| square * 48.0);
        for (share, expected) in [(0.0, 0.1), (1.0, 0.2), (0.5, (0.25 * (0.01 + 0.04_f64)).sqrt())] {
            let found = row(noise, noise + error, share, [0.08 * 48.0 * 500.0; 2]);
            assert!(found.fits() && (found.noise() - 0.2).abs() < 1e-5, "{found:?}");
            assert!(
                (found.error() - expected).abs() < 1e-5 && found.error_high() > found.error(),
                "{share}: {found:?}"
            );
            assert!((found.level() - 1.0).abs() < 1e-6);
        }
    }

    /// Neither frames without noise nor frames that are alike tell any; nor do those that show another signal.
    #[test]
    fn frames_that_do_not_fit_tell_nothing() {
        assert!(!Estimate::default().fits() && !row(0.0, 0.1, 0.0, [0.0; 2]).fits());
        assert!(row(1.0, 1.1, 0.0, [1000.0; 2]).fits() && !row(1.0, 0.9, 0.0, [1000.0; 2]).fits());
        for factor in [0.5, 1.5] {
            // Differences of another size, and those that neighbours share or that cancel among them.
            assert!(!row(1.0, 1.1, 0.0, [factor * 1000.0, 1000.0]).fits());
            assert!(!row(1.0, 1.1, 0.0, [1000.0, factor * 1000.0]).fits());
        }
    }
}
