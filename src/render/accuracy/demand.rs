//! Paths that a wanted error takes, by a pilot.

use super::interval::{FEWEST_MET, Intervals, Variance, block_mean, unseen_light};
use crate::metrics::statistical::probability::quantile;
use crate::render::film::{Blocks, FEWEST, Replicates, Sampling};

/// Most paths of a pixel.
pub const MOST: u32 = 1 << 16;

/// Limit that a picture is to keep to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Goal {
    /// Half width of each block's interval, by the picture's scale.
    Error(f64),
    /// Thread seconds, the pilot's among them.
    Seconds(f64),
}

/// Measurements of a block by the pilot.
#[derive(Debug, Clone, Copy, Default)]
struct Block {
    /// Variance of the mean, red, green and blue.
    variances: [Variance; 3],
    /// Paths per pixel.
    paths: f64,
    /// Opacity, the mean over the pixels, and the number of them.
    alpha: f64,
    pixels: f64,
    /// Thread seconds of a path of each pixel.
    seconds: f64,
}

impl Block {
    /// Returns the paths per pixel at which half the width of no channel's interval is larger than `width`; `z` is the
    /// normal quantile of the confidence.
    fn needed(&self, width: f64, brightness: f64, z: f64) -> u32 {
        let most = self.variances.iter().map(|v| self.paths * times(v, width, z)).fold(0.0, f64::max);
        // Light that nobody has met may be left unseen where it is too faint to matter.
        let matters = self.alpha > 0.0 && unseen_light(self.alpha, brightness) > 0.5 * width;
        let met = if matters { 1.5 * FEWEST_MET / (self.alpha * self.pixels) } else { 0.0 };
        (most.max(met).ceil() as u32).clamp(FEWEST, MOST)
    }
}

/// Returns how many times the pilot's paths make half the width of an interval `width`.
fn times(pilot: &Variance, width: f64, z: f64) -> f64 {
    if pilot.variance == 0.0 || width.is_nan() {
        return 0.0;
    }
    // Abramowitz and Stegun 26.7.5. Below three degrees of freedom a picture would not state an interval.
    let quantile = |freedom: f64| {
        let (v, z2) = (1.0 / freedom.max(3.0), z * z);
        z * (1.0 + v / 4.0 * ((z2 + 1.0) + v / 24.0 * (5.0 * z2 * z2 + 16.0 * z2 + 3.0)))
    };
    // The variance is estimated, here and by the picture's own replicates: two standard deviations more.
    let margin = 1.0 + 2.0 * (3.0 / pilot.freedom.max(3.0)).sqrt();
    let needed = |times: f64| {
        let more = pilot.of_more(times);
        let half_width = more.half_width(quantile).min(10.0 * z * more.variance.sqrt());
        (margin * times * (half_width / width).powi(2)).clamp(1e-3, f64::from(MOST))
    };
    // The part of the variance that an event makes falls as others come, and the interval by more than their root.
    (0..6).fold(needed(1.0), |times, _| (times * needed(times)).sqrt())
}

/// Paths that an error takes, block by block.
#[derive(Debug, Clone)]
pub struct Demand {
    blocks: Vec<Block>,
    /// Scale of the pilot's radiance.
    scale: f64,
    /// Radiance that an opaque medium would show, of the brightest block.
    brightness: f64,
    /// Normal quantile of the confidence.
    z: f64,
}

impl Demand {
    /// Reads what a picture takes off its pilot. Intervals are to hold with `confidence`.
    pub fn of(pilot: &Replicates, confidence: f64) -> Self {
        let grid = Blocks::new(pilot.size());
        let block = |block: usize| {
            let pixels = || grid.pixels(block).map(|pixel| &pilot.sums()[pixel]);
            let paths = pixels().map(|pixel| pixel.paths).max().unwrap_or(0) as f64;
            let variances = [0, 1, 2].map(|c| Variance::of(pixels(), c));
            let [.., alpha] = block_mean(pixels());
            let seconds = pilot.seconds()[block] / paths.max(1.0);
            Block { variances, paths, alpha, pixels: pixels().count() as f64, seconds }
        };
        let alone: Vec<Block> = (0..grid.count()).map(block).collect();
        // A block beside one of rare events has probably missed its own.
        let around = |block: usize| {
            let mean = |c: usize| {
                let sum = grid.around(block).fold([0.0; 2], |[n, v], b| [n + 1.0, v + alone[b].variances[c].variance]);
                sum[1] / sum[0]
            };
            let of = |c: usize| {
                let own = alone[block].variances[c];
                Variance { variance: own.variance.max(mean(c)), ..own }
            };
            Block { variances: [0, 1, 2].map(of), ..alone[block] }
        };
        let Intervals { scale, brightness, .. } = Intervals::of(pilot, confidence);
        Self {
            blocks: (0..grid.count()).map(around).collect(),
            scale,
            brightness,
            z: quantile(confidence, f64::INFINITY),
        }
    }

    /// Returns the scale of the pilot's radiance, see [`scale`](super::interval::scale).
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// Returns the paths per pixel of each block at which no interval's half width is larger than `error` times the
    /// scale: at least [`FEWEST`], at most [`MOST`].
    pub fn paths(&self, error: f64) -> Vec<u32> {
        self.blocks.iter().map(|block| block.needed(error * self.scale, self.brightness, self.z)).collect()
    }

    /// Returns the mean number of paths per pixel that a goal takes.
    pub(super) fn mean_paths(&self, goal: Goal) -> f64 {
        let paths = self.paths(match goal {
            Goal::Error(error) => error,
            Goal::Seconds(seconds) => self.error_in(seconds),
        });
        paths.iter().copied().map(f64::from).sum::<f64>() / paths.len().max(1) as f64
    }

    /// Returns the thread seconds that numbers of paths per pixel take.
    pub fn seconds(&self, paths: &[u32]) -> f64 {
        self.blocks.iter().zip(paths).map(|(block, paths)| block.seconds * f64::from(*paths)).sum()
    }

    /// Returns the smallest error that takes no more than these thread seconds, to half a per cent of it; 0 if there is
    /// no noise, infinite if the fewest paths take longer.
    pub fn error_in(&self, seconds: f64) -> f64 {
        let fits = |error: f64| self.seconds(&self.paths(error)) <= seconds;
        if fits(0.0) {
            return 0.0;
        }
        // The cost falls as the error grows.
        let (mut low, mut high) = (2.0_f64.powi(-24), 2.0_f64.powi(8));
        if !fits(high) {
            return f64::INFINITY;
        }
        while high > 1.005 * low {
            let middle = (low * high).sqrt();
            *if fits(middle) { &mut high } else { &mut low } = middle;
        }
        high
    }
}

/// Paths of a picture's blocks, dealt out to its replicates.
#[derive(Debug, Clone)]
pub struct Deal {
    paths: Vec<u32>,
    replicates: u32,
}

impl Deal {
    /// Deals out the paths per pixel of each block to a number of replicates: as evenly as whole numbers go.
    pub fn new(paths: Vec<u32>, replicates: u32) -> Self {
        Self { paths, replicates: replicates.max(FEWEST) }
    }

    /// Returns the number of replicates.
    pub fn replicates(&self) -> u32 {
        self.replicates
    }

    /// Returns the paths per pixel of each block.
    pub fn paths(&self) -> &[u32] {
        &self.paths
    }

    /// Returns the rays of each block in a replicate, whose random numbers are its own.
    pub fn replicate(&self, number: u32, sampling: impl Fn(u32) -> Sampling) -> Vec<Option<Sampling>> {
        // The first replicate has a path of every pixel, however soon the time is over.
        let before = |paths: u32, number: u32| (u64::from(paths) * u64::from(number)).div_ceil(self.replicates.into());
        let of = |paths: &u32| {
            // Blocks of fewer paths than replicates are in some of these.
            let count = match *paths / self.replicates {
                0 => (before(*paths, number % self.replicates + 1) - before(*paths, number % self.replicates)) as u32,
                _ => Sampling::shared(paths.div_ceil(self.replicates)),
            };
            (count > 0).then(|| sampling(count))
        };
        self.paths.iter().map(of).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Replicates have the paths that are dealt out, or a few more; blocks of few paths are in that many of them.
    #[test]
    fn all_paths_are_dealt_out() {
        let deal = Deal::new(vec![8, 9, 16, 100, 1000], 16);
        let mut dealt = [0; 5];
        for number in 0..deal.replicates() {
            let rays = deal.replicate(number, |paths| Sampling::random(paths, 0));
            dealt.iter_mut().zip(rays).for_each(|(sum, rays)| *sum += rays.map_or(0, |rays| rays.samples()));
        }
        assert_eq!(dealt[..3], [8, 9, 16]);
        assert!((100..=130).contains(&dealt[3]) && (1000..=1130).contains(&dealt[4]), "{dealt:?}");
    }

    /// Of normal noise an interval half as wide takes four times the paths; of one rare event more at first.
    #[test]
    fn narrow_intervals_take_many_paths() {
        let normal = Variance { variance: 1.0, freedom: 400.0, largest: 0.02 };
        let (wide, narrow) = (times(&normal, 0.02, 1.96), times(&normal, 0.01, 1.96));
        assert!((narrow / wide - 4.0).abs() < 0.1, "{wide} {narrow}");
        assert!((wide / (1.96_f64 / 0.02).powi(2) - 1.0).abs() < 0.4, "{wide}");
        let rare = Variance { freedom: 7.0, largest: 0.9, ..normal };
        assert!(times(&rare, 1.0, 1.96) > 2.0 * times(&normal, 1.0, 1.96));
        assert_eq!(times(&Variance::default(), 0.1, 1.96), 0.0);
    }
}
