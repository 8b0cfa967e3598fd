//! Mean gradients by value, and their maxima.

use super::samples::Sample;

/// Number of bins of the values.
pub(super) const BINS: usize = 256;
/// Standard deviation in bins of the window that means are taken in; it is doubled until the window has enough voxels.
const WINDOW: f64 = 1.5;
/// Number of voxels that a mean is taken of, at least.
const LEAST: f64 = 64.0;
/// Least ratio of a maximum to the median of the gradients, above which it is no noise.
const ABOVE_FLOOR: f64 = 1.5;
/// Least prominence of a maximum, as a share of the largest gradient above the floor, of its own, and in standard
/// errors.
const PROMINENCE: f64 = 0.12;
const OWN: f64 = 0.4;
const ERRORS: f64 = 4.0;

/// Voxels by value, in bins of equal width.
pub(super) struct Curve {
    /// Lower end of the first bin.
    pub low: f64,
    /// Width of a bin.
    pub width: f64,
    /// Number of voxels.
    pub counts: Vec<f64>,
    /// Mean value of the voxels; NaN without voxels.
    pub values: Vec<f64>,
    /// Mean magnitude of the gradient.
    pub gradients: Vec<f64>,
    /// Standard error of the mean gradient.
    errors: Vec<f64>,
    /// Mean gradient at the median voxel: of noise, where most voxels lie inside materials.
    pub floor: f64,
}

/// A maximum of the mean gradient.
#[derive(Debug, Clone, Copy)]
pub(super) struct Maximum {
    /// Bin of the maximum.
    pub bin: usize,
    /// Height above the higher one of the two minima beside it.
    pub prominence: f64,
}

/// Sums over voxels.
#[derive(Clone, Copy, Default)]
struct Sums {
    count: f64,
    value: f64,
    gradient: f64,
    square: f64,
}

impl Curve {
    /// Takes the means of the voxels between two values.
    pub(super) fn of(samples: &[Sample], [low, high]: [f64; 2]) -> Self {
        let width = (high - low) / BINS as f64;
        let mut sums = [Sums::default(); BINS];
        for Sample { value, gradient } in samples.iter().filter(|s| s.value >= low && s.value <= high) {
            let sums = &mut sums[(((value - low) / width) as usize).min(BINS - 1)];
            let gradient = f64::from(*gradient);
            sums.count += 1.0;
            sums.value += value;
            sums.gradient += gradient;
            sums.square += gradient * gradient;
        }
        let means: Vec<Sums> = (0..BINS).map(|bin| smoothed(&sums, bin)).collect();
        let mean = |s: &Sums| s.gradient / s.count;
        let gradients: Vec<f64> = means.iter().map(mean).collect();
        let error = |s: &Sums| ((s.square / s.count - mean(s).powi(2)).max(0.0) / s.count).sqrt();
        let counts: Vec<f64> = sums.iter().map(|s| s.count).collect();
        Self {
            low,
            width,
            values: sums.iter().map(|s| s.value / s.count).collect(),
            errors: means.iter().map(error).collect(),
            floor: weighted_median(&gradients, &counts),
            gradients,
            counts,
        }
    }

    /// Value at a place in bins, from the low end of the first.
    pub(super) fn value(&self, place: f64) -> f64 {
        self.low + place * self.width
    }

    /// Number of voxels between two values; bins that lie partly between them count in part.
    pub(super) fn count(&self, low: f64, high: f64) -> f64 {
        let [low, high] = [low, high].map(|value| (value - self.low) / self.width);
        let share = |bin: usize| (high.min(bin as f64 + 1.0) - low.max(bin as f64)).max(0.0);
        self.counts.iter().enumerate().map(|(bin, count)| count * share(bin)).sum()
    }

    /// Returns the world length of a path straight through a boundary, between two places in bins.
    pub(super) fn length(&self, low: f64, high: f64) -> f64 {
        let share = |bin: usize| (high.min(bin as f64 + 1.0) - low.max(bin as f64)).max(0.0);
        let passed = self.gradients.iter().enumerate().map(|(bin, gradient)| (share(bin), gradient));
        passed.filter(|(share, _)| *share > 0.0).map(|(share, gradient)| share * self.width / gradient).sum()
    }

    /// Returns the maxima that stand out of noise and of their neighbourhood, in ascending order of value.
    pub(super) fn maxima(&self) -> Vec<Maximum> {
        let g = &self.gradients;
        let peaks = (1..BINS - 1).filter(|i| g[*i] > g[i - 1] && g[*i] >= g[i + 1]);
        let all: Vec<Maximum> = peaks.map(|bin| Maximum { bin, prominence: self.prominence(bin) }).collect();
        let highest = all.iter().map(|m| g[m.bin]).fold(self.floor, f64::max);
        let stands_out = |m: &Maximum| {
            let height = g[m.bin] - self.floor;
            let least = (PROMINENCE * (highest - self.floor)).max(OWN * height).max(ERRORS * self.errors[m.bin]);
            m.prominence > least && g[m.bin] > ABOVE_FLOOR * self.floor
        };
        all.into_iter().filter(stands_out).collect()
    }

    fn prominence(&self, bin: usize) -> f64 {
        let g = &self.gradients;
        // Of maxima alike, as data of few values have them, the first one counts.
        let tie = 1e-9 * g[bin];
        let least = |side: &mut dyn Iterator<Item = usize>, most: f64| {
            side.take_while(|i| g[*i] < most).map(|i| g[i]).fold(f64::INFINITY, f64::min)
        };
        let below = least(&mut (0..bin).rev(), g[bin] - tie);
        g[bin] - below.min(g[bin]).max(least(&mut (bin + 1..BINS), g[bin] + tie))
    }

    /// Returns the places at which the gradient falls to half of a maximum above the floor, and whether it does before
    /// it rises to the next maximum on that side.
    pub(super) fn half_fall(&self, Maximum { bin, .. }: Maximum, between: [usize; 2]) -> [(f64, bool); 2] {
        let g = &self.gradients;
        let half = 0.5 * (g[bin] + self.floor);
        let centre = |i: usize| i as f64 + 0.5;
        let crossing =
            |from: usize, to: usize| centre(from) + (centre(to) - centre(from)) * (g[from] - half) / (g[from] - g[to]);
        let [first, last] = between;
        let below = (first..bin).rev().find(|i| g[*i] < half);
        let above = (bin + 1..=last).find(|i| g[*i] < half);
        [
            below.map_or((centre(first), false), |i| (crossing(i + 1, i), true)),
            above.map_or((centre(last), false), |i| (crossing(i - 1, i), true)),
        ]
    }

    /// Returns the bin of the least gradient between two bins.
    pub(super) fn valley(&self, from: usize, to: usize) -> usize {
        (from..=to).min_by(|a, b| self.gradients[*a].total_cmp(&self.gradients[*b])).unwrap_or(from)
    }
}

/// Sums over a Gaussian window about a bin that holds enough voxels for means.
fn smoothed(sums: &[Sums; BINS], bin: usize) -> Sums {
    let mut deviation = WINDOW;
    loop {
        let mut all = Sums::default();
        for (i, s) in sums.iter().enumerate() {
            let apart = (i as f64 - bin as f64) / deviation;
            if apart.abs() > 3.0 {
                continue;
            }
            let weight = (-0.5 * apart * apart).exp();
            all.count += weight * s.count;
            all.gradient += weight * s.gradient;
            all.square += weight * s.square;
        }
        if all.count >= LEAST || deviation > BINS as f64 {
            return all;
        }
        deviation *= 2.0;
    }
}

/// Median of values that count as often as their weights say.
fn weighted_median(values: &[f64], weights: &[f64]) -> f64 {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    let half = 0.5 * weights.iter().sum::<f64>();
    let mut sum = 0.0;
    let reached = |i: &usize| {
        sum += weights[*i];
        sum >= half
    };
    order.iter().copied().find(reached).map_or(0.0, |i| values[i])
}
