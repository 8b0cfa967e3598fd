//! Upper limits of what a part of the light adds to a block's mean, from independent paths through it.

use crate::metrics::statistical::probability::quantile;
use crate::render::accuracy::interval::{FEWEST_MET, Variance};
use crate::render::film::PixelSums;
use crate::render::integrator::Sample;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Ways to a limit of a block.
const WAYS: usize = 3;

/// Degrees of freedom from which quantiles are those of a series.
const MANY: f64 = 100.0;

/// Shares of what the statements may fail together.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shares {
    /// Probability with which one statement may fail.
    miss: f64,
    /// Normal quantile of it, on one side.
    z: f64,
}

impl Shares {
    /// Shares out a confidence among this many statements of color blocks.
    pub(super) fn new(confidence: f64, statements: usize) -> Self {
        let miss = (1.0 - confidence) / (statements.max(1) * 3 * WAYS) as f64;
        Self { miss, z: quantile(1.0 - 2.0 * miss, f64::INFINITY) }
    }

    /// Returns the quantile of Student's distribution, on one side.
    fn student(&self, freedom: f64) -> f64 {
        if freedom < MANY {
            return quantile(1.0 - 2.0 * self.miss, freedom);
        }
        // Abramowitz and Stegun 26.7.5.
        let (z, z2, v) = (self.z, self.z * self.z, 1.0 / freedom);
        let second = 5.0 * z2 * z2 + 16.0 * z2 + 3.0;
        z * (1.0 + v * ((z2 + 1.0) / 4.0 + v * second / 96.0))
    }

    /// Returns an upper limit of the probability of events of which `seen` were met in `draws` independent draws
    /// (Chernoff's bound; without any, the rule of three).
    fn probability(&self, seen: u64, draws: u64) -> f64 {
        if seen >= draws {
            return 1.0;
        }
        let (share, n) = (seen as f64 / draws as f64, draws as f64);
        let term = |p: f64, q: f64| if p > 0.0 { p * (p / q).ln() } else { 0.0 };
        let less_likely = |p: f64| n * (term(share, p) + term(1.0 - share, 1.0 - p)) > -self.miss.ln();
        let (mut low, mut high) = (share, 1.0);
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            *if less_likely(middle) { &mut high } else { &mut low } = middle;
        }
        high
    }
}

/// What is known of a part of the light beforehand, by channel; infinite where nothing is.
#[derive(Debug, Clone, Copy)]
pub(in crate::plan) struct Caps {
    /// Most that is expected of a path that collides with a medium.
    pub collision: DVec3,
    /// Most that is expected of a path that adds anything.
    pub event: DVec3,
    /// True if light comes from where no path collides.
    pub apart: bool,
}

/// What the paths of a block have found.
#[derive(Debug, Clone, Default)]
pub(super) struct Found {
    /// Sums of what the part adds, and of the opacity.
    sums: PixelSums,
    /// Paths that collided with a medium.
    collisions: u64,
    /// Paths to which the part adds something.
    events: u64,
}

impl Found {
    /// Adds a path, and what the part adds to it.
    pub(super) fn add(&mut self, value: Vec3, path: &Sample) {
        self.sums.add(1, value.extend(1.0 - path.transmittance).to_array());
        self.collisions += u64::from(path.first.is_some());
        self.events += u64::from(value != Vec3::ZERO);
    }

    /// Adds other paths.
    pub(super) fn merge(&mut self, other: &Self) {
        self.sums.merge(&other.sums);
        self.collisions += other.collisions;
        self.events += other.events;
    }

    /// Returns the mean of what the part adds.
    pub(super) fn mean(&self) -> DVec3 {
        let [r, g, b, _] = self.sums.mean();
        DVec3::new(r, g, b)
    }

    /// True if enough paths met the medium to know what it shows.
    fn met(&self) -> bool {
        self.collisions as f64 >= FEWEST_MET
    }

    /// Returns the upper limit by the spread of the paths, infinite where they found nothing or little.
    fn by_spread(&self, shares: &Shares) -> DVec3 {
        let mean = self.mean();
        if self.events == 0 || self.sums.replicates < 2 {
            return DVec3::INFINITY;
        }
        let channel = |c: usize| {
            let half_width = Variance::of([&self.sums].into_iter(), c).half_width(|freedom| shares.student(freedom));
            // A channel that is black by itself tells nothing of what was not seen.
            if mean[c] > 0.0 { mean[c] + half_width } else { f64::INFINITY }
        };
        DVec3::new(channel(0), channel(1), channel(2))
    }

    /// Returns the mean and its upper limit, where the brightest block shows `lit` by opacity.
    pub(super) fn limit(&self, caps: &Caps, lit: DVec3, shares: &Shares) -> [DVec3; 2] {
        if caps.apart {
            return [self.mean(), self.by_spread(shares)];
        }
        let draws = u64::from(self.sums.replicates);
        let product = |p: f64, most: DVec3| DVec3::select(most.cmpeq(DVec3::ZERO), DVec3::ZERO, p * most);
        // What hardly any path met is as bright as what others met, or twice as bright.
        let source = if self.met() { caps.collision } else { caps.collision.min(2.0 * lit) };
        let by_collisions = product(shares.probability(self.collisions, draws), source);
        let by_events = product(shares.probability(self.events, draws), caps.event);
        [self.mean(), self.by_spread(shares).min(by_collisions).min(by_events)]
    }
}

/// Returns the largest limit of a block by its opacity, by channel; infinite where no block shows anything that is
/// known.
pub(super) fn brightness(found: &[Found], shares: &Shares) -> DVec3 {
    let of_block = |found: &Found| {
        let [.., alpha] = found.sums.mean();
        found.by_spread(shares) / alpha
    };
    let known: Vec<DVec3> = found.par_iter().filter(|found| found.met()).map(of_block).collect();
    let channel = |c: usize| known.iter().map(|limit| limit[c]).filter(|limit| limit.is_finite()).reduce(f64::max);
    DVec3::from_array([0, 1, 2].map(|c| channel(c).unwrap_or(f64::INFINITY)))
}
