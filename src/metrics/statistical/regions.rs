//! Tests of one channel: pixels, tiles, the mean and the spread of the differences.

use super::probability::{of_smallest, quantile, two_sided, upper_normal};
use super::{CHANNELS, ChannelTests, Estimate, MeanTest, Question, Region, RegionTests, SpreadTest};
use crate::error::{Error, Result};
use rayon::prelude::*;
use statrs::function::gamma::ln_gamma;
use std::f64::consts::LN_2;

/// Confidence of the interval of the mean difference.
const CONFIDENCE: f64 = 0.95;

/// Number of samples on both sides together from which on none of them can be alike by chance.
const MANY: f64 = 1e6;

/// Rounding of a value in single precision, relative to it. A picture is rounded once, and so is a mean of several.
const ROUNDING: f64 = f32::EPSILON as f64;

/// Differences of a channel with their variances, pixel by pixel.
struct Differences<'e> {
    sides: [&'e Estimate; 2],
    /// Sides that have noise somewhere.
    noisy: [bool; 2],
    channel: usize,
    used: &'e [bool],
    tolerance: f64,
}

/// Sums over the pixels of a region.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    count: usize,
    difference: f64,
    /// Magnitude of the sum that counts as no difference.
    allowed: f64,
    variance: f64,
    /// Σ(a²/(f + 2) + b²/(g + 2)).
    uncertainty: f64,
    /// Smallest degrees of freedom of a pixel on a side with noise; infinite if none has noise.
    least_freedom: f64,
    /// Logarithm of the probability that samples without any spread are divided between the sides as they are.
    silent: f64,
}

/// Student's statistic of a region, with its two-sided probability.
#[derive(Debug, Clone, Copy)]
struct Statistic {
    t: f64,
    freedom: f64,
    p: f64,
}

impl Statistic {
    /// Statistic of a difference beyond what is allowed. Where no sample shows any noise, `silent` is the logarithm of
    /// the probability.
    fn of(beyond: f64, variance: f64, freedom: f64, silent: f64) -> Self {
        let t = if beyond == 0.0 { 0.0 } else { beyond / variance.sqrt() };
        let p = if t.is_infinite() { silent.exp() } else { two_sided(t, freedom) };
        Self { t, freedom, p }
    }
}

/// Moves a difference towards 0 by the magnitude that counts as none.
fn excess(difference: f64, allowed: f64) -> f64 {
    difference.signum() * (difference.abs() - allowed).max(0.0)
}

fn finite(value: f64) -> Option<f64> {
    Some(value).filter(|v| v.is_finite())
}

impl Sums {
    fn statistic(&self) -> Statistic {
        let freedom = if self.uncertainty > 0.0 {
            (self.variance * self.variance / self.uncertainty - 2.0).max(self.least_freedom)
        } else {
            f64::INFINITY
        };
        Statistic::of(excess(self.difference, self.allowed), self.variance, freedom, self.silent)
    }
}

impl Differences<'_> {
    fn variances(&self, pixel: usize) -> [f64; 2] {
        self.sides.map(|side| f64::from(side.variance[pixel][self.channel]).max(0.0))
    }

    fn difference(&self, pixel: usize) -> f64 {
        let [a, b] = self.sides.map(|side| f64::from(side.mean[pixel][self.channel]));
        a - b
    }

    /// Magnitude of a pixel's difference that counts as none: the tolerance, and the rounding of both values.
    fn allowed(&self, pixel: usize) -> f64 {
        let [a, b] = self.sides.map(|side| f64::from(side.mean[pixel][self.channel]).abs());
        self.tolerance + ROUNDING * (a + b)
    }

    /// Smaller degrees of freedom of the sides that have noise somewhere.
    fn freedom(&self, pixel: usize) -> f64 {
        let sides = self.sides.iter().zip(self.noisy).filter(|(_, noisy)| *noisy);
        sides.map(|(side, _)| side.freedom.at(pixel)).fold(f64::INFINITY, f64::min)
    }

    /// Logarithm of the probability that a pixel's samples, all alike on either side but not on both, are divided
    /// between the sides as they are: 2 of the n over m ways to choose the m samples of one side from all n, which are
    /// equally probable if the sides have the same distribution. A side without noise counts as having as many samples
    /// as the other.
    fn silent(&self, pixel: usize) -> f64 {
        let counts: [f64; 2] = std::array::from_fn(|s| {
            let which = if self.noisy[s] { s } else { 1 - s };
            if self.noisy[which] { self.sides[which].freedom.at(pixel) + 1.0 } else { f64::INFINITY }
        });
        let [m, k] = counts;
        if m + k > MANY {
            return f64::NEG_INFINITY;
        }
        (LN_2 - (ln_gamma(m + k + 1.0) - ln_gamma(m + 1.0) - ln_gamma(k + 1.0))).min(0.0)
    }

    fn sums(&self, x: std::ops::Range<usize>, y: std::ops::Range<usize>) -> Sums {
        let mut sums = Sums { least_freedom: f64::INFINITY, ..Sums::default() };
        for row in y {
            for pixel in x.clone().map(|column| row * self.sides[0].width + column).filter(|p| self.used[*p]) {
                sums.count += 1;
                sums.difference += self.difference(pixel);
                sums.allowed += self.allowed(pixel);
                for (side, variance) in self.sides.iter().zip(self.variances(pixel)) {
                    sums.variance += variance;
                    sums.uncertainty += variance * variance / (side.freedom.at(pixel) + 2.0);
                }
                sums.least_freedom = sums.least_freedom.min(self.freedom(pixel));
                if self.difference(pixel).abs() > self.allowed(pixel) {
                    sums.silent += self.silent(pixel);
                }
            }
        }
        sums
    }

    fn variance(&self, pixel: usize) -> f64 {
        self.variances(pixel).iter().sum()
    }

    /// Sum and number of the variances around a pixel, `reach` pixels far, without its own.
    fn around(&self, pixel: usize, reach: usize) -> (f64, f64) {
        let (width, height) = (self.sides[0].width, self.sides[0].height);
        let (x, y) = (pixel % width, pixel / width);
        let (mut sum, mut count) = (0.0, 0.0);
        for row in y.saturating_sub(reach)..(y + reach + 1).min(height) {
            for column in x.saturating_sub(reach)..(x + reach + 1).min(width) {
                let neighbour = row * width + column;
                if neighbour != pixel && self.used[neighbour] {
                    sum += self.variance(neighbour);
                    count += 1.0;
                }
            }
        }
        (sum, count)
    }

    /// Variance of a pixel's difference: its own, or the mean over its 3 x 3 neighbourhood if that is larger.
    fn guarded_variance(&self, pixel: usize) -> f64 {
        let own = self.variance(pixel);
        let (sum, count) = self.around(pixel, 1);
        own.max((sum + own) / (count + 1.0))
    }

    fn pixels(&self) -> RegionTests {
        let width = self.sides[0].width;
        let test = |pixel: usize| {
            let variance = self.guarded_variance(pixel);
            let beyond = excess(self.difference(pixel), self.allowed(pixel));
            let found = Statistic::of(beyond, variance, self.freedom(pixel), self.silent(pixel));
            (found.p, found, pixel, variance)
        };
        let rows = (0..self.sides[0].height).into_par_iter().map(|row| {
            let all = (row * width..(row + 1) * width).filter(|p| self.used[*p]).map(test);
            all.fold(None, |worst, next| smaller(worst, Some(next), |t| (t.0, t.1.t)))
        });
        // Collected in the order of the rows, so that the first of equal pixels wins with any number of threads.
        let worst = rows.collect::<Vec<_>>().into_iter().fold(None, |a, b| smaller(a, b, |t| (t.0, t.1.t)));
        let count = self.used.iter().filter(|used| **used).count();
        let region = worst.map(|(_, found, pixel, variance)| Region {
            x: pixel % width,
            y: pixel / width,
            width: 1,
            height: 1,
            difference: self.difference(pixel),
            standard_error: variance.sqrt(),
            t: finite(found.t),
            freedom: finite(found.freedom),
        });
        RegionTests { count, p: of_smallest(worst.map_or(1.0, |w| w.0), count), worst: region }
    }

    fn tiles(&self, edge: usize) -> RegionTests {
        let (width, height) = (self.sides[0].width, self.sides[0].height);
        let (mut worst, mut count): (Option<(f64, f64, Region)>, usize) = (None, 0);
        for y in (0..height).step_by(edge) {
            for x in (0..width).step_by(edge) {
                let (right, below) = (width.min(x.saturating_add(edge)), height.min(y.saturating_add(edge)));
                let sums = self.sums(x..right, y..below);
                if sums.count == 0 {
                    continue;
                }
                count += 1;
                let found = sums.statistic();
                let pixels = sums.count as f64;
                let region = Region {
                    x,
                    y,
                    width: right - x,
                    height: below - y,
                    difference: sums.difference / pixels,
                    standard_error: sums.variance.sqrt() / pixels,
                    t: finite(found.t),
                    freedom: finite(found.freedom),
                };
                worst = smaller(worst, Some((found.p, found.t, region)), |w| (w.0, w.1));
            }
        }
        let p = of_smallest(worst.as_ref().map_or(1.0, |w| w.0), count);
        RegionTests { count, p, worst: worst.map(|w| w.2) }
    }

    fn mean(&self) -> MeanTest {
        let sums = self.sums(0..self.sides[0].width, 0..self.sides[0].height);
        let found = sums.statistic();
        let pixels = sums.count.max(1) as f64;
        let difference = sums.difference / pixels;
        let reach = quantile(CONFIDENCE, found.freedom) * sums.variance.sqrt() / pixels;
        MeanTest {
            difference,
            interval: reach.is_finite().then_some([difference - reach, difference + reach]),
            t: finite(found.t),
            freedom: finite(found.freedom),
            p: found.p,
        }
    }

    fn dispersion(&self) -> SpreadTest {
        let pixels = || (0..self.used.len()).filter(|p| self.used[*p]);
        let square = |pixel: usize| excess(self.difference(pixel), self.allowed(pixel)).powi(2);
        let count = pixels().count().max(1) as f64;
        let mean_square = pixels().map(square).sum::<f64>() / count;
        let mean_variance = pixels().map(|p| self.variance(p)).sum::<f64>() / count;
        let term = |pixel: &usize| {
            let (sum, neighbours) = self.around(*pixel, 2);
            // With the floor, no pixel weighs more than a hundred times the mean one.
            let scale = sum / f64::max(neighbours, 1.0) + 0.01 * mean_variance;
            let term = square(*pixel) - self.variance(*pixel);
            if scale > 0.0 { term / scale } else { term }
        };
        // Collected in order, so that the sums do not depend on the number of threads.
        let terms: Vec<f64> = pixels().collect::<Vec<_>>().par_iter().map(term).collect();
        let magnitude = terms.iter().map(|t| t * t).sum::<f64>().sqrt();
        let z = if magnitude > 0.0 { terms.iter().sum::<f64>() / magnitude } else { 0.0 };
        SpreadTest { mean_square, mean_variance, z, p: upper_normal(z) }
    }
}

/// Returns the one of two results whose p-value is smaller, then whose |t| is larger, then the first. (`by` gives p and
/// t.)
fn smaller<T>(a: Option<T>, b: Option<T>, by: impl Fn(&T) -> (f64, f64)) -> Option<T> {
    match (a, b) {
        (Some(a), Some(b)) => {
            let ((p, t), (q, u)) = (by(&a), by(&b));
            Some(if q < p || (q == p && u.abs() > t.abs()) { b } else { a })
        }
        (a, b) => a.or(b),
    }
}

/// Tests one channel of two pictures of equal size.
///
/// # Errors
/// If the tiles have no edge.
pub(super) fn channel(
    sides: [&Estimate; 2],
    used: &[bool],
    channel: usize,
    question: Question,
) -> Result<ChannelTests> {
    if question.tile == 0 {
        return Err(Error::invalid("tiles of 0 pixels").hint("give the edge of a tile in pixels, 1 at least"));
    }
    let noisy = sides.map(|side| side.variance.iter().any(|v| v[channel] > 0.0));
    let all = Differences { sides, noisy, channel, used, tolerance: question.tolerance };
    Ok(ChannelTests {
        channel: CHANNELS[channel],
        mean: all.mean(),
        pixels: all.pixels(),
        tiles: all.tiles(question.tile),
        spread: all.dispersion(),
    })
}
