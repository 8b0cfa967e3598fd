//! Upper limits of what a part of the light adds to a block's mean, from independent paths through it.

use crate::metrics::statistical::probability::quantile;
use crate::render::accuracy::interval::{FEWEST_MET, Variance};
use crate::render::film::PixelSums;
use crate::render::integrator::Sample;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Ways to a limit of a block.
const WAYS: usize = 3;

/// Paths whose spread tells what more of them will.
const FEWEST_TO_EXPECT: u32 = 256;

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

/// Bounds of a part of the light that are known beforehand, by channel; infinite where nothing is.
#[derive(Debug, Clone, Copy)]
pub(in crate::plan) struct Caps {
    /// Most that is expected of a path by its opacity.
    pub collision: DVec3,
    /// Most that is expected of a path from where it first adds anything, and from any such place on.
    pub event: DVec3,
    /// True if light comes from where no path collides.
    pub apart: bool,
    /// True if light is scattered so narrowly that few paths find most of it: their spread does not tell what others
    /// add.
    pub peaked: bool,
}

/// Sums over the paths of a block.
#[derive(Debug, Clone, Default)]
pub(super) struct Tally {
    /// Sums of what the part adds, and of the opacity.
    sums: PixelSums,
    /// Paths that collided with a medium.
    collisions: u64,
    /// Paths to which the part adds something.
    events: u64,
    /// Sums of what the part adds, at most the cut to a path, and the paths to which it adds more.
    cut: [f64; 3],
    over: u64,
}

impl Tally {
    /// Adds a path, and what the part adds to it. Values above the `cut` are told apart.
    pub(super) fn add(&mut self, value: Vec3, path: &Sample, cut: f64) {
        for (sum, value) in self.cut.iter_mut().zip(value.to_array()) {
            *sum += f64::from(value).min(cut);
        }
        self.over += u64::from(f64::from(value.max_element()) > cut);
        self.sums.merge(&PixelSums::of(1, value.extend(1.0 - path.transmittance).to_array()));
        self.collisions += u64::from(path.first.is_some());
        self.events += u64::from(value != Vec3::ZERO);
    }

    /// Adds other paths.
    pub(super) fn merge(&mut self, other: &Self) {
        self.sums.merge(&other.sums);
        self.collisions += other.collisions;
        self.events += other.events;
        self.cut.iter_mut().zip(other.cut).for_each(|(sum, more)| *sum += more);
        self.over += other.over;
    }

    /// Returns the mean of what the part adds.
    pub(super) fn mean(&self) -> DVec3 {
        let [r, g, b, _] = self.sums.mean();
        DVec3::new(r, g, b)
    }

    /// True if enough paths met the medium to know what it shows.
    fn is_sampled(&self) -> bool {
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

    /// Returns the number of paths.
    pub(super) fn paths(&self) -> u32 {
        self.sums.replicates
    }

    /// True if the mean exceeds `most`, or so many paths that its upper limit by as many as `last` is expected to.
    pub(super) fn exceeds(&self, most: f64, last: u32, shares: &Shares) -> bool {
        let (mean, variance) = (self.sums.mean(), self.sums.variance());
        let channel = |c: usize| {
            let error = variance[c].sqrt();
            let surely = mean[c] - 3.0 * error;
            let left = (f64::from(self.paths()) / f64::from(last)).sqrt();
            let expected = surely.max(0.0) + shares.z * error * left;
            surely > most || self.paths() >= FEWEST_TO_EXPECT && expected > most
        };
        (0..3).any(|c| variance[c].is_finite() && channel(c))
    }

    /// Returns the upper limit of the mean opacity.
    fn opacity(&self, shares: &Shares) -> f64 {
        let [.., alpha] = self.sums.mean();
        let half_width = Variance::of([&self.sums].into_iter(), 3).half_width(|freedom| shares.student(freedom));
        let by_spread = if alpha > 0.0 { alpha + half_width } else { 1.0 };
        by_spread.min(shares.probability(self.collisions, self.paths().into()))
    }

    /// Returns the upper limit by values that are cut (Hoeffding 1963), and by how many exceed the cut: what a path
    /// collects from then on is no more than is known of any.
    fn by_cut(&self, caps: &Caps, cut: f64, shares: &Shares) -> DVec3 {
        let paths = f64::from(self.paths().max(1));
        let below = DVec3::from_array(self.cut) / paths + cut * (-shares.miss.ln() / (2.0 * paths)).sqrt();
        let beyond = shares.probability(self.over, self.paths().into()) * caps.event;
        DVec3::select(caps.event.cmpeq(DVec3::ZERO), DVec3::ZERO, below + beyond)
    }

    /// Returns the upper limit of the mean, where the brightest block shows `lit` by opacity and values are cut.
    pub(super) fn limit(&self, caps: &Caps, (lit, cut): (DVec3, f64), shares: &Shares) -> DVec3 {
        let by_spread = if caps.peaked { DVec3::INFINITY } else { self.by_spread(shares) };
        if caps.apart {
            return by_spread;
        }
        let product = |p: f64, most: DVec3| DVec3::select(most.cmpeq(DVec3::ZERO), DVec3::ZERO, p * most);
        // What hardly any path met is as bright as what others met, or twice as bright.
        let source = if self.is_sampled() || caps.peaked { caps.collision } else { caps.collision.min(2.0 * lit) };
        let by_opacity = product(self.opacity(shares), source);
        by_spread.min(by_opacity).min(self.by_cut(caps, cut, shares))
    }
}

/// Returns the largest limit of a block by its opacity, by channel; infinite where no block shows anything that is
/// known.
pub(super) fn brightness(found: &[Tally], shares: &Shares) -> DVec3 {
    let of_block = |found: &Tally| {
        let [.., alpha] = found.sums.mean();
        found.by_spread(shares) / alpha
    };
    let known: Vec<DVec3> = found.par_iter().filter(|found| found.is_sampled()).map(of_block).collect();
    let channel = |c: usize| known.iter().map(|limit| limit[c]).filter(|limit| limit.is_finite()).reduce(f64::max);
    DVec3::from_array([0, 1, 2].map(|c| channel(c).unwrap_or(f64::INFINITY)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::integrator::{First, Interaction};
    use crate::render::sampler::Sampler;

    const UNKNOWN: Caps = Caps { collision: DVec3::INFINITY, event: DVec3::INFINITY, apart: false, peaked: false };

    /// Returns the probability of `seen` events or fewer.
    fn binomial(seen: u64, draws: u64, p: f64) -> f64 {
        let term = |t: f64, k: u64| t * (draws - k) as f64 / (k + 1) as f64 * p / (1.0 - p);
        (0..seen).fold([(1.0 - p).powf(draws as f64); 2], |[t, sum], k| [term(t, k), sum + term(t, k)])[1]
    }

    #[test]
    fn probabilities_of_events_are_below_their_limits() {
        let shares = Shares::new(0.95, 100);
        for (seen, draws) in [(0, 64), (1, 64), (7, 64), (3, 4096), (60, 64)] {
            let limit = shares.probability(seen, draws);
            assert!(binomial(seen, draws, limit) <= shares.miss * (1.0 + 1e-9), "{seen} {draws} {limit}");
        }
        let rule_of_three = -f64::exp_m1(shares.miss.ln() / 64.0);
        assert!((shares.probability(0, 64) - rule_of_three).abs() < 1e-9);
        assert_eq!(shares.probability(64, 64), 1.0);
        // The series goes on where the quantiles of few degrees of freedom end.
        let [exact, series] = [99.999, 100.0].map(|freedom| shares.student(freedom));
        assert!((exact / series - 1.0).abs() < 2e-3, "{exact} {series}");
    }

    /// Returns what paths find to each of which `value` adds something, if it collides.
    fn found(paths: u64, seed: u64, value: impl Fn(&mut Sampler) -> Option<f32>) -> Tally {
        let mut found = Tally::default();
        for path in 0..paths {
            let mut sampler = Sampler::new(seed, [path as usize, 0], 0);
            let value = value(&mut sampler);
            let interaction = Interaction::Volume(0);
            let none = First { distance: 1.0, position: DVec3::ZERO, albedo: Vec3::ONE, interaction, share: 1.0 };
            let first = value.map(|_| none);
            let transmittance = if first.is_some() { 0.0 } else { 1.0 };
            let path = Sample { first, transmittance, ..Sample::default() };
            found.add(Vec3::splat(value.unwrap_or(0.0)), &path, 0.0);
        }
        found
    }

    /// Skewed draws: limits fail no more often than they may, and are not beyond all measure.
    #[test]
    fn means_are_below_their_limits() {
        let shares = Shares::new(0.95, 1);
        let failed = |paths: u64, mean: f64, value: &dyn Fn(&mut Sampler) -> Option<f32>| {
            let limit = |seed| found(paths, seed, value).limit(&UNKNOWN, (DVec3::INFINITY, 0.0), &shares).x;
            let limits: Vec<f64> = (0..1000).map(limit).collect();
            let typical = limits.iter().filter(|limit| **limit < 3.0 * mean).count();
            assert!(typical > 500, "{typical}");
            limits.iter().filter(|limit| **limit < mean).count()
        };
        assert!(failed(64, 1.0, &|s| Some(s.exponential())) <= 15);
        assert!(failed(256, 0.05, &|s| Some(if s.uniform() < 0.05 { 1.0 } else { 0.0 })) <= 15);
        assert!(failed(1024, 0.02, &|s| (s.uniform() < 0.02).then(|| s.exponential())) <= 15);
    }

    #[test]
    fn what_was_not_seen_is_not_left_out_without_a_bound() {
        let shares = Shares::new(0.95, 1000);
        let dark = found(256, 1, |_| Some(0.0));
        let limit = |found: &Tally, caps: Caps, lit: f64| found.limit(&caps, (DVec3::splat(lit), 0.0), &shares).x;
        assert_eq!(limit(&dark, UNKNOWN, 1.0), f64::INFINITY);
        let known = Caps { event: DVec3::splat(2.0), ..UNKNOWN };
        let rule_of_three = -2.0 * f64::exp_m1(shares.miss.ln() / 256.0);
        assert!((limit(&dark, known, 1.0) - rule_of_three).abs() < 1e-9);
        // Without collisions a block is as bright as others at most, unless light comes from elsewhere.
        let empty = found(256, 1, |_| None);
        assert!((limit(&empty, UNKNOWN, 1.0) - rule_of_three).abs() < 1e-9);
        assert_eq!(limit(&empty, Caps { apart: true, ..UNKNOWN }, 1.0), f64::INFINITY);
        assert_eq!(limit(&empty, UNKNOWN, f64::INFINITY), f64::INFINITY);
        let seen = found(256, 1, |s| Some(s.exponential()));
        assert!(limit(&seen, UNKNOWN, 1.0).is_finite());
        assert_eq!(limit(&seen, Caps { peaked: true, ..UNKNOWN }, 1.0), f64::INFINITY);
        let lit = brightness(&[dark, empty, seen.clone()], &shares);
        assert_eq!(lit, seen.by_spread(&shares));
    }
}
