//! Confidence intervals of the means of blocks.

use crate::metrics::statistical::probability::quantile;
use crate::render::film::{Blocks, FEWEST, PixelSums, Replicates};
use crate::scene::film::Film;
use serde::Serialize;

/// Fewest paths of a block that meet the medium, if any do, by which its noise is known.
pub(crate) const FEWEST_MET: f64 = 16.0;

/// Why no interval is stated of a block, or one that is too wide.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, schemars::JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Doubt {
    /// There are fewer than eight replicates.
    FewReplicates,
    /// Few rare events make the variance: the interval is wider by some of them, and holds the mean if none is rarer.
    RareEvents,
    /// No path through the medium has met light: such a block is black, or lit by what is rarely found.
    NoLight,
    /// The interval is known, and wider than the error that was asked for.
    Wide,
}

/// Interval of the expected mean of a block's pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// Mean in red, green and blue.
    pub mean: [f64; 3],
    /// Half of the interval's width in red, green and blue.
    pub half_width: [f64; 3],
    /// Why no interval is stated, or one that is not known to hold the mean with the confidence.
    pub doubt: Option<Doubt>,
}

impl Interval {
    /// Returns the largest half width of a channel.
    pub fn largest(&self) -> f64 {
        self.half_width.into_iter().fold(0.0, f64::max)
    }

    /// Returns why the block is not known to be within an error; `None` if it is.
    pub fn doubt_within(&self, error: f64) -> Option<Doubt> {
        match self.doubt {
            Some(Doubt::RareEvents) | None if self.largest() <= error => None,
            None => Some(Doubt::Wide),
            doubt => doubt,
        }
    }
}

/// Intervals of all blocks of a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Intervals {
    /// Probability with which an interval holds the expected mean.
    pub confidence: f64,
    /// Scale of the picture's radiance, by which errors are divided; see [`scale`].
    pub scale: f64,
    /// Radiance that an opaque medium would show, of the brightest block.
    pub(super) brightness: f64,
    /// Intervals, block by block.
    pub blocks: Vec<Interval>,
}

/// Returns the scale of a picture's radiance from the means r of equal parts: (Σ r / Σ √r)².
///
/// It is the mean of √r, weighted by itself, and squared. Black surroundings do not change it, and few highlights
/// change it little. 0 for a black picture.
pub fn scale(radiance: impl IntoIterator<Item = f64>) -> f64 {
    let sums = radiance.into_iter().map(|r| r.max(0.0)).fold([0.0; 2], |[sum, root], r| [sum + r, root + r.sqrt()]);
    if sums[1] > 0.0 { (sums[0] / sums[1]).powi(2) } else { 0.0 }
}

/// Returns the [`scale`] of a picture, from the means of red, green and blue of its blocks.
pub fn scale_of(film: &Film) -> f64 {
    let grid = Blocks::new([film.width, film.height]);
    let grey = |pixel: usize| film.rgba[pixel][..3].iter().map(|v| f64::from(*v)).sum::<f64>() / 3.0;
    scale((0..grid.count()).map(|block| {
        let [sum, count] = grid.pixels(block).fold([0.0; 2], |[sum, n], pixel| [sum + grey(pixel), n + 1.0]);
        sum / f64::max(count, 1.0)
    }))
}

/// Variance of the mean of a block, with what is known of it.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Variance {
    /// Variance of the block's mean.
    pub variance: f64,
    /// Degrees of freedom of the variance (Satterthwaite 1946, without bias for one pixel).
    pub freedom: f64,
    /// Largest part of it that one replicate of one pixel makes.
    pub largest: f64,
}

impl Variance {
    /// Returns that of a channel of a block.
    pub(crate) fn of<'p>(pixels: impl Iterator<Item = &'p PixelSums>, channel: usize) -> Self {
        let (mut count, mut sum, mut squares, mut largest, mut least) = (0.0, 0.0, 0.0, 0.0_f64, f64::INFINITY);
        for pixel in pixels {
            let (variance, freedom) = (pixel.variance()[channel], f64::from(pixel.replicates.max(1)) - 1.0);
            count += 1.0;
            sum += variance;
            squares += variance * variance / (freedom + 2.0);
            largest = largest.max(pixel.by_largest()[channel]);
            least = least.min(freedom);
        }
        let freedom = if squares > 0.0 { (sum * sum / squares - 2.0).max(least) } else { f64::INFINITY };
        Self {
            variance: sum / f64::max(count * count, 1.0),
            freedom,
            largest: if sum > 0.0 { largest / sum } else { 0.0 },
        }
    }

    /// Returns what `times` as many paths would make of it.
    pub(super) fn of_more(&self, times: f64) -> Self {
        let Self { variance, freedom, largest } = *self;
        Self { variance: variance / times, freedom, largest: largest / times.max(1.0) }
    }

    /// Returns by how much the largest part of the variance exceeds what chance makes it: above 1, rare events make the
    /// variance, and others that make as much have probably not been met.
    ///
    /// The largest of ν squared normal numbers is about 2 ln ν, of which the largest part is 2 ln(ν) / ν; where one
    /// event makes all of a pixel's variance, it is three times as large and more. Sixteen events are enough.
    pub(super) fn rareness(&self) -> f64 {
        let by_chance = 2.0 * self.freedom.max(2.0).ln() / self.freedom.max(2.0);
        self.largest / f64::max(by_chance, 1.0 / 16.0)
    }

    /// Returns half the width of the interval that holds the mean with a confidence, whose `quantile` of Student's
    /// distribution with degrees of freedom is given.
    ///
    /// Few events tell as little of a variance as few degrees of freedom: if all made equal parts of it, there would be
    /// one over the largest part of them. Where events are rare, the interval is wider by three of the largest: the
    /// mean number of events of which k have come is below k + 2√k + 3 (Poisson, 97.5 %).
    pub(crate) fn half_width(&self, quantile: impl Fn(f64) -> f64) -> f64 {
        if self.variance == 0.0 {
            return 0.0;
        }
        let freedom = self.freedom.min(2.0 / self.largest - 2.0);
        // One event that makes nearly all tells nothing.
        if freedom < 1.0 {
            return f64::INFINITY;
        }
        let events = if self.rareness() > 1.0 { 3.0 * self.largest.sqrt() } else { 0.0 };
        (quantile(freedom) + events) * self.variance.sqrt()
    }
}

impl Intervals {
    /// States intervals with a confidence between 0 and 1 from the replicates of a picture.
    pub fn of(replicates: &Replicates, confidence: f64) -> Self {
        Self::of_sums(replicates.size(), replicates.sums(), confidence)
    }

    /// States intervals from the sums of each pixel of a picture of this width and height.
    pub fn of_sums(size: [usize; 2], sums: &[PixelSums], confidence: f64) -> Self {
        let grid = Blocks::new(size);
        let pixels = |block: usize| grid.pixels(block).map(|pixel| &sums[pixel]);
        let means: Vec<[f64; 4]> = (0..grid.count()).map(|block| block_mean(pixels(block))).collect();
        let scale = scale(means.iter().map(|[r, g, b, _]| (r + g + b) / 3.0));
        let brightness = brightness(size, sums, &means);
        let blocks = (0..grid.count()).map(|block| interval(|| pixels(block), brightness, confidence)).collect();
        Self { confidence, scale, brightness, blocks }
    }

    /// Returns half the width of a block's interval by the picture's scale, the largest of its channels.
    pub fn relative(&self, block: usize) -> f64 {
        let width = self.blocks[block].largest();
        if width == 0.0 { 0.0 } else { width / self.scale }
    }

    /// Returns why a block is not known to be within an error by the scale; without one, why no interval of it is
    /// stated.
    pub fn doubt(&self, block: usize, error: Option<f64>) -> Option<Doubt> {
        match error {
            Some(error) => self.blocks[block].doubt_within(error * self.scale),
            None => self.blocks[block].doubt,
        }
    }

    /// Returns the number of blocks by why they are not known to be within an error, as [`Intervals::doubt`] says.
    pub fn doubts(&self, error: Option<f64>) -> Vec<(Doubt, usize)> {
        let count = |which| (0..self.blocks.len()).filter(|block| self.doubt(*block, error) == Some(which)).count();
        let all = [Doubt::FewReplicates, Doubt::RareEvents, Doubt::NoLight, Doubt::Wide];
        all.into_iter().map(|which| (which, count(which))).filter(|(_, count)| *count > 0).collect()
    }

    /// Returns the largest of [`Intervals::relative`] of blocks that have no [`Intervals::doubt`]; `None` without any.
    pub fn worst(&self, error: Option<f64>) -> Option<f64> {
        let certified = (0..self.blocks.len()).filter(|block| self.doubt(*block, error).is_none());
        certified.map(|block| self.relative(block)).reduce(f64::max)
    }
}

/// Returns how much light a medium of this opacity may scatter of which nothing has been seen: twice what it shows
/// where it is seen best.
pub(super) fn unseen_light(alpha: f64, brightness: f64) -> f64 {
    2.0 * alpha * brightness
}

/// Returns the paths of pixels that meet a medium.
fn medium_paths<'p>(pixels: impl Iterator<Item = &'p PixelSums>) -> f64 {
    pixels.map(|pixel| pixel.paths as f64 * pixel.mean()[3]).sum()
}

/// Returns the largest radiance by opacity of blocks, whose `means` are given, that enough paths met the medium in; of
/// all blocks that any have, where there is none.
fn brightness(size: [usize; 2], sums: &[PixelSums], means: &[[f64; 4]]) -> f64 {
    let grid = Blocks::new(size);
    let by_opacity = |[r, g, b, alpha]: &[f64; 4]| r.max(*g).max(*b) / alpha;
    let of = |fewest: f64| {
        let seen =
            (0..grid.count()).filter(|block| medium_paths(grid.pixels(*block).map(|pixel| &sums[pixel])) > fewest);
        seen.map(|block| by_opacity(&means[block])).fold(0.0, f64::max)
    };
    Some(of(FEWEST_MET)).filter(|brightness| *brightness > 0.0).unwrap_or_else(|| of(0.0))
}

/// Returns the mean of a block's pixels: red, green, blue and alpha.
pub(super) fn block_mean<'p>(pixels: impl Iterator<Item = &'p PixelSums>) -> [f64; 4] {
    let (count, sum) = pixels.fold((0.0, [0.0; 4]), |(n, sum), pixel| {
        let mean = pixel.mean();
        (n + 1.0, std::array::from_fn(|c| sum[c] + mean[c]))
    });
    sum.map(|sum: f64| sum / f64::max(count, 1.0))
}

/// States the interval of a block from its pixels.
fn interval<'p, P: Iterator<Item = &'p PixelSums>>(
    pixels: impl Fn() -> P,
    brightness: f64,
    confidence: f64,
) -> Interval {
    let [r, g, b, alpha] = block_mean(pixels());
    let variances = [0, 1, 2].map(|c| Variance::of(pixels(), c));
    // Paths that meet the medium: where there are hardly any, what it scatters has hardly been seen.
    let met = medium_paths(pixels());
    let unseen = met > 0.0 && met < FEWEST_MET;
    let doubt = if pixels().any(|pixel| pixel.replicates < FEWEST) {
        Some(Doubt::FewReplicates)
    } else if unseen || variances.iter().any(|v| v.rareness() > 1.0) {
        Some(Doubt::RareEvents)
    } else if [r, g, b] == [0.0; 3] && alpha > 0.0 {
        Some(Doubt::NoLight)
    } else {
        None
    };
    let wider = if unseen { unseen_light(alpha, brightness) } else { 0.0 };
    let half_width = |v: Variance| v.half_width(|freedom| quantile(confidence, freedom)) + wider;
    Interval { mean: [r, g, b], half_width: variances.map(half_width), doubt }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn the_scale_is_that_of_what_shines() {
        assert!((scale([2.0; 9]) - 2.0).abs() < 1e-12);
        assert!((scale([0.5; 7].into_iter().chain([0.0; 100])) - 0.5).abs() < 1e-12);
        assert!(scale([1.0; 99].into_iter().chain([100.0])) < 4.0);
        assert_eq!((scale([]), scale([0.0, -1.0])), (0.0, 0.0));
    }
}
