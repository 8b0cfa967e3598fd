//! Tests whether two noisy pictures have the same expected values.
//!
//! Each side is an [`Estimate`]: the mean of a picture's samples, the estimated variance of that mean, and the degrees
//! of freedom of the variance. The null hypothesis is that no expected value differs by more than a tolerance. Four
//! tests look at each channel:
//!
//! - **pixels**: t = d / √v for each pixel, d being the difference of the means and v the sum of their variances, which
//!   is at least its mean over the pixel's 3 x 3 neighbourhood: a pixel whose few samples all missed a rare event would
//!   otherwise seem free of noise. The degrees of freedom are the smaller ones of the two sides, which bounds the
//!   tails of the Behrens-Fisher statistic (Mickey and Brown 1966). The smallest p-value is corrected for the number of
//!   pixels (Šidák 1967). Per-pixel z-tests of renderings against a reference with a stored variance, with this
//!   correction, are the idea of Mitsuba 3's `test_renders.py`.
//! - **tiles**: t = Σd / √Σv for each tile of N x N pixels, which finds structure of low frequency. The degrees of
//!   freedom are Satterthwaite's (1946), estimated without bias for one pixel:
//!   (Σv)² / Σ(a²/(f + 2) + b²/(g + 2)) - 2 for the variances a and b of the sides with f and g degrees of freedom.
//!   Noise that few pixels carry therefore counts as little evidence.
//! - **mean**: the same for the whole picture, with a confidence interval of the difference.
//! - **spread**: z = Σ w(d² - v) / √Σ w²(d² - v)², one-sided, which finds differences of high frequency that no pixel
//!   shows alone and that cancel in tiles, such as a shift by part of a pixel. The expected value of each term is 0
//!   under the null hypothesis, however the noise varies over the picture, since v is an unbiased estimate. The weight
//!   w is one over the mean variance of the pixel's neighbours, without its own, on which d and v do not depend. The
//!   sum is divided by its own magnitude, so that large terms make the test slow to speak, not quick.
//!
//! Where no sample of a region shows any noise, but the sides differ, t is infinite. The p-value is then the
//! probability that samples all alike are divided between the sides as they are, for each of the region's pixels that
//! differ: one third for two seeds on either side. Pictures whose values are discrete, such as the alpha of few paths,
//! need this.
//!
//! With k tests in all, the pictures differ if any p-value is below 1 - (1 - α)^(1/k): if they have the same expected
//! values, this happens with a probability of at most α, the rate of false alarms.
//!
//! The tests presume that the noise of different pixels is independent, that the two sides are independent, and, for
//! single pixels, that the means of their samples are nearly normal. Stratified samples have a smaller variance than
//! their spread tells: the tests then find less, and give no more false alarms.

pub(crate) mod probability;
mod regions;

use crate::error::{Error, Result};
use serde::Serialize;

/// Names of the channels, in the order in which pixels hold them.
pub(crate) const CHANNELS: [&str; 4] = ["R", "G", "B", "A"];

/// Upper bound in bytes per pixel of the memory that two estimates and their test take, while the second is read.
pub const PIXEL_BYTES: u64 = 240;

/// Degrees of freedom of estimated variances.
#[derive(Debug, Clone, PartialEq)]
pub enum Freedom {
    /// One number for all pixels; infinite for known variances.
    All(f64),
    /// A number for each pixel, row-major from the top left.
    ByPixel(Vec<f32>),
}

impl Freedom {
    fn at(&self, pixel: usize) -> f64 {
        match self {
            Self::All(freedom) => *freedom,
            Self::ByPixel(list) => f64::from(list[pixel]),
        }
    }

    /// Smallest degrees of freedom of a pixel.
    pub fn smallest(&self) -> f64 {
        match self {
            Self::All(freedom) => *freedom,
            Self::ByPixel(list) => list.iter().copied().map(f64::from).fold(f64::INFINITY, f64::min),
        }
    }
}

/// Estimated expected values of a picture, with their uncertainty.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Mean of each pixel's samples: R, G, B, A, row-major from the top left.
    pub mean: Vec<[f32; 4]>,
    /// Estimated variance of each mean; all 0 for a picture without noise.
    pub variance: Vec<[f32; 4]>,
    /// Degrees of freedom of the variances.
    pub freedom: Freedom,
    /// True if the variance of alpha is known.
    pub has_alpha: bool,
}

/// Question that the tests answer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Question {
    /// Probability with which pictures of the same expected values may be called different.
    pub false_alarm: f64,
    /// Largest absolute difference of expected values that counts as none.
    pub tolerance: f64,
    /// Edge of a tile in pixels.
    pub tile: usize,
}

/// Answer of the tests.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
pub struct Verdict {
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// True if a test found a difference, or pixels that are not finite are not identical.
    pub differ: bool,
    /// Probability of a result at least as extreme if the expected values are the same, corrected for all tests.
    pub p: f64,
    /// Rate of false alarms that was asked for.
    pub false_alarm: f64,
    /// Difference of expected values that counts as none.
    pub tolerance: f64,
    /// Number of pixels left out because one of the sides has a sample or variance there that is not finite.
    pub left_out: usize,
    /// Number of pixels left out whose samples are not finite and not identical.
    pub non_finite_differences: usize,
    /// Tests by channel.
    pub channels: Vec<ChannelTests>,
}

/// Tests of a channel.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
pub struct ChannelTests {
    /// Name of the channel.
    pub channel: &'static str,
    /// Test of the mean over the picture.
    pub mean: MeanTest,
    /// Tests of single pixels.
    pub pixels: RegionTests,
    /// Tests of tiles.
    pub tiles: RegionTests,
    /// Test of the spread of the differences.
    pub spread: SpreadTest,
}

impl ChannelTests {
    /// Probabilities of the tests, each within its own kind, with their names.
    pub fn probabilities(&self) -> [(&'static str, f64); 4] {
        [("mean", self.mean.p), ("pixels", self.pixels.p), ("tiles", self.tiles.p), ("spread", self.spread.p)]
    }
}

/// Test of the mean difference over all pixels.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
pub struct MeanTest {
    /// Mean of the first side minus that of the second.
    pub difference: f64,
    /// Interval that holds the difference of the expected means with 95 % confidence; `null` with fewer than one degree
    /// of freedom.
    pub interval: Option<[f64; 2]>,
    /// Difference beyond the tolerance by its standard error; `null` if that is 0 and the difference is not.
    pub t: Option<f64>,
    /// Degrees of freedom; `null` if infinite.
    pub freedom: Option<f64>,
    /// Two-sided probability of a larger magnitude of t.
    pub p: f64,
}

/// Tests of regions of one size.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
pub struct RegionTests {
    /// Number of regions.
    pub count: usize,
    /// Probability that the smallest p-value of all is as small as that found (Šidák).
    pub p: f64,
    /// Region of the smallest p-value.
    pub worst: Option<Region>,
}

/// A pixel or tile.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
pub struct Region {
    /// Column of the first pixel.
    pub x: usize,
    /// Row of the first pixel.
    pub y: usize,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Mean difference.
    pub difference: f64,
    /// Standard error of the mean difference.
    pub standard_error: f64,
    /// Difference beyond the tolerance by its standard error; `null` if that is 0 and the difference is not.
    pub t: Option<f64>,
    /// Degrees of freedom; `null` if infinite.
    pub freedom: Option<f64>,
}

/// Test of the mean square of the differences against the variances.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
pub struct SpreadTest {
    /// Mean square of the differences beyond the tolerance.
    pub mean_square: f64,
    /// Mean variance, which is what the mean square is expected to be.
    pub mean_variance: f64,
    /// Σ w(d² - v) / √Σ w²(d² - v)²; 0 without noise and differences.
    pub z: f64,
    /// Probability of a larger z.
    pub p: f64,
}

/// Tests whether two pictures have the same expected values.
///
/// # Errors
/// If the sizes differ, there is no pixel, the tile has no edge, or no pixel has finite values and variances.
pub fn test(a: &Estimate, b: &Estimate, question: Question) -> Result<Verdict> {
    if (a.width, a.height) != (b.width, b.height) {
        let sizes = format!("{}x{} and {}x{}", a.width, a.height, b.width, b.height);
        return Err(Error::invalid(format!("pictures of different sizes: {sizes}"))
            .hint("render or crop them to the same size"));
    }
    let channels = if a.has_alpha && b.has_alpha { 4 } else { 3 };
    let finite = |values: &[f32; 4]| values[..channels].iter().all(|v| v.is_finite());
    let usable = |i: usize| [&a.mean[i], &b.mean[i], &a.variance[i], &b.variance[i]].into_iter().all(finite);
    let used: Vec<bool> = (0..a.mean.len()).map(usable).collect();
    let left_out = used.iter().filter(|u| !**u).count();
    if left_out == used.len() {
        return Err(Error::invalid("no pixel has finite samples and variances on both sides")
            .hint("a variance needs two samples a pixel at least; cumulo validate finds NaN and infinite samples"));
    }
    let same = |(x, y): (&f32, &f32)| x == y || (x.is_nan() && y.is_nan());
    let unlike = |i: &usize| {
        let (p, q) = (&a.mean[*i][..channels], &b.mean[*i][..channels]);
        !p.iter().chain(q).all(|v| v.is_finite()) && !p.iter().zip(q).all(same)
    };
    let non_finite_differences = (0..used.len()).filter(unlike).count();
    let tests: Vec<ChannelTests> =
        (0..channels).map(|c| regions::channel([a, b], &used, c, question)).collect::<Result<_>>()?;
    let all = tests.iter().flat_map(|t| t.probabilities());
    let (count, smallest) = all.fold((0, 1.0_f64), |(n, least), (_, p)| (n + 1, least.min(p)));
    let p = probability::of_smallest(smallest, count);
    Ok(Verdict {
        size: [a.width, a.height],
        differ: p < question.false_alarm || non_finite_differences > 0,
        p,
        false_alarm: question.false_alarm,
        tolerance: question.tolerance,
        left_out,
        non_finite_differences,
        channels: tests,
    })
}
