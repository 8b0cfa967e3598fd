//! Paths that a wanted error takes, by a pilot.

use super::interval::{Doubt, Intervals, Variance};
use super::pilot::Goal;
use crate::render::film::{Blocks, FEWEST, Replicates, Sampling};

/// Most paths of a pixel.
pub const MOST: u32 = 1 << 16;

/// What the pilot tells of a block.
#[derive(Debug, Clone, Copy, Default)]
struct Block {
    /// Variance of the mean, red, green and blue.
    variances: [Variance; 3],
    /// Paths per pixel.
    paths: f64,
    /// Thread seconds of a path of each pixel.
    seconds: f64,
}

impl Block {
    /// Returns the paths per pixel at which half the width of no channel's interval is larger than `width`.
    fn needed(&self, width: f64, confidence: f64) -> u32 {
        let most = self.variances.iter().map(|v| self.paths * times(v, width, confidence)).fold(0.0, f64::max);
        (most.ceil() as u32).clamp(FEWEST, MOST)
    }
}

/// Returns how many times the pilot's paths make half the width of an interval `width`.
fn times(pilot: &Variance, width: f64, confidence: f64) -> f64 {
    if pilot.variance == 0.0 || width.is_nan() {
        return 0.0;
    }
    // The part of the variance that an event makes falls as others come; where it is not rare, one may have as many.
    let rareness = pilot.rareness();
    let mut times = if rareness > 0.5 { 2.0 * rareness } else { 0.125 };
    // The variance is estimated, here and by the picture's own replicates: two standard deviations more.
    let margin = 1.0 + 2.0 * (3.0 / pilot.freedom).sqrt();
    for _ in 0..4 {
        let half_width = pilot.of_more(times).half_width(confidence);
        times = times.max(margin * times * (half_width / width).powi(2)).min(f64::from(MOST));
    }
    times
}

/// What an error takes, block by block.
#[derive(Debug, Clone)]
pub struct Demand {
    blocks: Vec<Block>,
    /// Scale of the pilot's radiance.
    scale: f64,
    confidence: f64,
}

impl Demand {
    /// Reads what a picture takes off its pilot. Intervals are to hold with `confidence`.
    pub fn of(pilot: &Replicates, confidence: f64) -> Self {
        let grid = Blocks::new(pilot.size());
        let block = |block: usize| {
            let pixels = || grid.pixels(block).map(|pixel| &pilot.sums()[pixel]);
            let paths = pixels().map(|pixel| pixel.paths).max().unwrap_or(0) as f64;
            let variances = [0, 1, 2].map(|c| Variance::of(pixels(), c));
            Block { variances, paths, seconds: pilot.seconds()[block] / paths.max(1.0) }
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
        let scale = Intervals::of(pilot, confidence).scale;
        Self { blocks: (0..grid.count()).map(around).collect(), scale, confidence }
    }

    /// Returns the scale of the pilot's radiance, see [`scale`](super::interval::scale).
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// Returns the paths per pixel of each block at which no interval's half width is larger than `error` times the
    /// scale: at least [`FEWEST`], at most [`MOST`].
    pub fn paths(&self, error: f64) -> Vec<u32> {
        self.blocks.iter().map(|block| block.needed(error * self.scale, self.confidence)).collect()
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

    /// Returns the smallest error that takes no more than these thread seconds, to a hundredth of it; 0 if there is no
    /// noise, infinite if the fewest paths take longer.
    pub fn error_in(&self, seconds: f64) -> f64 {
        let fits = |error: f64| self.seconds(&self.paths(error)) <= seconds;
        if fits(0.0) {
            return 0.0;
        }
        // The cost falls as the error grows.
        let (mut low, mut high) = (2.0_f64.powi(-40), 2.0_f64.powi(40));
        if !fits(high) {
            return f64::INFINITY;
        }
        while high > 1.01 * low {
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
        let before = |paths: u32, number: u32| u64::from(paths) * u64::from(number) / u64::from(self.replicates);
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

/// Returns the number of blocks by what is doubtful about them.
pub fn doubts(intervals: &Intervals, error: Option<f64>) -> Vec<(Doubt, usize)> {
    let all = [Doubt::FewReplicates, Doubt::RareEvents, Doubt::NoLight, Doubt::Wide];
    let within = error.map_or(f64::INFINITY, |error| error * intervals.scale);
    let count = |doubt| intervals.blocks.iter().filter(|block| block.doubt_within(within) == Some(doubt)).count();
    all.into_iter().map(|doubt| (doubt, count(doubt))).filter(|(_, count)| *count > 0).collect()
}
