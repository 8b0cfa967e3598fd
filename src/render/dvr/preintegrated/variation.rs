//! Total variation of a transfer function and of its slope, by which the error of a density bounds that of the light.
//!
//! Of a function f with total variation V, `|f(x) - f(u)| ≤ V(u + e) - V(u - e)` where `|x - u| ≤ e`; averaged over a
//! range of u from a to b this is at most `2 e / (b - a)` times `V(b + e) - V(a - e)`, and never more than that
//! difference itself.
//!
//! If x is corrected by the mean δ of its distances from u, so that f has the mean `f + δ (f(b) - f(a)) / (b - a)`, the
//! variation W of the slope f' remains. `|f(x) - f(u) - f'(u) (x - u)|` is at most `|x - u|` times the change of the
//! slope between the two, on average at most `e W` and `(e₋² + e₊²) W / (2 (b - a))`, with e₋ and e₊ the largest
//! distances to both sides; and `f'(u)` follows `x - u` by at most half of W times the mean of `|x - u - δ|`, which for
//! a cubic is at most `0.257 e`.

use crate::real::{Lanes, Real};
use crate::scene::table::Table;

/// Bins of a table, and bins per knot if these are more.
const BINS: usize = 512;
const PER_KNOT: usize = 4;
/// The most bins of a table.
const MOST_BINS: usize = 2048;
/// Share of a bin by which a density may be misplaced when its bin is looked up.
const SLACK: f64 = 1e-3;

/// Variations between pairs of densities, in four lanes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Varied<R: Real> {
    /// Variation of the extinction.
    pub extinction: R::Lanes,
    /// Extinction times the variation of the color, integrated over the latter.
    pub shift: R::Lanes,
    /// Variation of the color, in units of the brightest.
    pub color: R::Lanes,
    /// Variations of the slopes of the extinction, and of the extinction times the color; without those at steps.
    pub extinction_slope: R::Lanes,
    pub emitted_slope: R::Lanes,
    /// Number of the function's steps.
    pub steps: R::Lanes,
}

/// Relative error of interpolated densities.
const ROUNDED: f64 = 1e-6;
/// Numbers of lanes by which variations are added up.
const KINDS: usize = 6;

/// Cumulative total variation of a transfer function over the density.
#[derive(Debug, Clone)]
pub(super) struct Variation<R: Real> {
    /// Variations up to the edges of bins, which divide the range of the knots evenly; in double precision, since next
    /// to a needle of the function nothing would be left of the others.
    edges: Vec<[f64; KINDS]>,
    /// Steepest slope of the extinction, and largest product of the extinction and the color's slope; infinite at a
    /// step.
    pub steepest: [R; 2],
    first: R,
    bins_per_density: R,
}

impl<R: Real> Variation<R> {
    /// Creates the table of a transfer function whose extinctions are multiplied by `scale`; `brightest` is the unit of
    /// its colors, `densities` holds the least and the greatest density.
    pub(crate) fn new(table: &Table, scale: f64, brightest: f64, densities: [f64; 2]) -> Self {
        let knots = table.knots();
        let (first, range) = (knots[0], knots[knots.len() - 1] - knots[0]);
        let count = if range > 0.0 { (PER_KNOT * knots.len()).clamp(BINS, MOST_BINS) } else { 1 };
        // Knots that coincide are a step in the middle of one bin.
        let width = if range > 0.0 { range / count as f64 } else { first.abs().max(1e-6) * 1e-5 };
        let first = if range > 0.0 { first } else { first - 0.5 * width };
        let mut added = vec![[0.0; KINDS]; count];
        let bin_of = |density: f64| (((density - first) / width).max(0.0) as usize).min(count - 1);
        let mut steepest = [0.0_f64; 2];
        // Slopes of extinction, and of extinction times color, where the piece before ends.
        let mut before = [0.0; 4];
        for piece in 1..=knots.len() {
            let ([low, high], [a, b]) = table.ends(piece);
            let extinctions = [scale * a[3], scale * b[3]];
            let inner = piece < knots.len();
            if inner && high <= low {
                let color = (0..3).map(|c| (b[c] - a[c]).abs()).fold(0.0, f64::max) / brightest;
                let change = (extinctions[1] - extinctions[0]).abs();
                let bin = &mut added[bin_of(low)];
                let step = [change, extinctions[0].max(extinctions[1]) * color, color];
                (0..3).for_each(|c| bin[c] += step[c]);
                bin[5] += 1.0;
                steepest = [f64::INFINITY; 2];
                continue;
            }
            // Slopes at both ends of the piece; none beyond the knots.
            let slope = |v: &[f64; 4]| {
                let by_density = |c: usize| if inner { (b[c] - a[c]) / (high - low) } else { 0.0 };
                let extinction = scale * by_density(3);
                let emitted = |c: usize| (extinction * v[c] + scale * v[3] * by_density(c)) / brightest;
                [emitted(0), emitted(1), emitted(2), extinction]
            };
            let [near, far] = [slope(&a), slope(&b)];
            let most = |a: &[f64; 4], b: &[f64; 4]| (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f64::max);
            // Slopes differ on both sides of a knot; of none that all densities lie beside, rounded as they are. A
            // density at the knot itself counts as above it.
            let slack = ROUNDED * low.abs();
            if densities[0] < low + slack && low <= densities[1] + slack {
                let kink = &mut added[bin_of(low)];
                kink[3] += (near[3] - before[3]).abs();
                kink[4] += most(&near, &before);
            }
            before = far;
            if !inner {
                break;
            }
            let color = (0..3).map(|c| (b[c] - a[c]).abs()).fold(0.0, f64::max) / brightest;
            let change = (extinctions[1] - extinctions[0]).abs();
            let shift = extinctions[0].max(extinctions[1]) * color;
            steepest = [(steepest[0], change), (steepest[1], shift)].map(|(most, by)| most.max(by / (high - low)));
            for (bin, added) in added.iter_mut().enumerate().take(bin_of(high) + 1).skip(bin_of(low)) {
                let from = low.max(first + bin as f64 * width);
                let to = high.min(first + (bin + 1) as f64 * width);
                if to <= from {
                    continue;
                }
                let at = |d: f64| extinctions[0] + (extinctions[1] - extinctions[0]) * ((d - low) / (high - low));
                let (share, mean) = ((to - from) / (high - low), 0.5 * (at(from) + at(to)));
                added[0] += change * share;
                added[1] += mean * color * share;
                added[2] += color * share;
                added[4] += most(&near, &far) * share;
            }
        }
        let mut sum = [0.0; KINDS];
        let mut edges = vec![sum];
        for added in added {
            (0..KINDS).for_each(|c| sum[c] += added[c]);
            edges.push(sum);
        }
        let steepest = steepest.map(|most| R::of(most.min(f64::from(f32::MAX))));
        Self { edges, steepest, first: R::of(first), bins_per_density: R::of(1.0 / width) }
    }

    /// Returns upper bounds of the variations between pairs of ascending densities.
    #[inline(always)]
    pub(crate) fn between(&self, low: R::Lanes, high: R::Lanes) -> Varied<R> {
        let all = <R::Lanes as Lanes<R>>::splat;
        let last = R::int(self.edges.len() as i32 - 1);
        let half = R::of(0.5 + SLACK);
        // Adding rounds to the nearest whole number: with half of one less or more, down or up.
        let edge = |density: R::Lanes, by: R| {
            let scaled = (density - all(self.first)) * all(self.bins_per_density) + all(by);
            (scaled.clamped(R::ZERO, last) + all(R::ONES)).store()
        };
        let (below, above) = (edge(low, -half), edge(high, half));
        let most = self.edges.len() - 1;
        let at = |edge: R| &self.edges[(edge.low_bits() as usize).min(most)];
        let pair = |i: usize| {
            let (from, to) = (at(below[i]), at(above[i]));
            let apart = |c: usize| R::of(to[c] - from[c]);
            let functions = R::Lanes::load([apart(0), apart(1), apart(2), R::ZERO]);
            (functions, R::Lanes::load([apart(3), apart(4), apart(5), R::ZERO]))
        };
        let ((a, e), (b, f), (c, g), (d, h)) = (pair(0), pair(1), pair(2), pair(3));
        let [extinction, shift, color, _] = R::Lanes::transpose([a, b, c, d]);
        let [extinction_slope, emitted_slope, steps, _] = R::Lanes::transpose([e, f, g, h]);
        Varied { extinction, shift, color, extinction_slope, emitted_slope, steps }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use glam::DVec4;
    use proptest::prelude::*;

    proptest! {
        /// Bounds of the variation of the extinction are never below it, and equal it where a bin holds no knot.
        #[test]
        fn bounds_hold(
            mut knots in prop::collection::vec(-2.0..3.0_f64, 1..40), step in any::<bool>(),
            heights in prop::collection::vec(0.0..9.0_f64, 40), ends in prop::array::uniform2(-3.0..4.0_f64),
        ) {
            knots.sort_by(f64::total_cmp);
            if step && knots.len() > 1 {
                knots[1] = knots[0];
            }
            prop_assume!(knots.windows(3).all(|k| k[0] < k[2]));
            let values = (0..knots.len()).map(|k| [heights[k], 1.0, heights[39 - k], heights[k]]).collect();
            let table = Table::new(knots.clone(), values).unwrap();
            let variation = Variation::<f64>::new(&table, 2.0, 9.0, [-9.0, 9.0]);
            let [low, high] = if ends[0] <= ends[1] { ends } else { [ends[1], ends[0]] };
            let at = |k: usize| 2.0 * table.values()[k][3];
            // The variation is that of a polygon through the ends and the knots between them.
            let inside = (0..knots.len()).filter(|k| low < knots[*k] && knots[*k] <= high);
            let [first, last] = [low, high].map(|density| 2.0 * table.at(density)[3]);
            let points: Vec<f64> = [first].into_iter().chain(inside.map(at)).chain([last]).collect();
            let exact: f64 = points.windows(2).map(|p| (p[1] - p[0]).abs()).sum();
            let between = |low: f64, high: f64| variation.between(DVec4::splat(low), DVec4::splat(high));
            let bound = between(low, high).extinction.x;
            prop_assert!(bound >= exact - 1e-9 * (1.0 + exact), "{} {}", bound, exact);
            prop_assert!(bound <= between(-1e9, 1e9).extinction.x + 1e-9);
            // So is that of its slope, where there is no step.
            let slopes = |from: usize, to: usize| (from..=to).map(|p| 2.0 * table.slope_of(p)[3]).collect::<Vec<f64>>();
            let [from, to] = [low, high].map(|density| table.piece(density));
            let exact: f64 = slopes(from, to).windows(2).map(|s| (s[1] - s[0]).abs()).sum();
            let found = between(low, high);
            let bounded = found.steps.x > 0.0 || found.extinction_slope.x >= exact - 1e-6 * (1.0 + exact);
            prop_assert!(bounded, "{:?} {}", found, exact);
        }
    }
}
