//! Total variation of a transfer function, by which the error of a density bounds that of the light.
//!
//! Of a function f with total variation V, `|f(x) - f(u)| ≤ V(u + e) - V(u - e)` where `|x - u| ≤ e`; averaged over a
//! range of u from a to b this is at most `2 e / (b - a)` times `V(b + e) - V(a - e)`, and never more than that
//! difference itself.

use crate::real::{Lanes, Real};
use crate::scene::table::Table;

/// The most bins of a table.
const MOST_BINS: usize = 512;
/// Bins per knot: with four, most bins hold no knot, and the variation is linear in them.
const BINS: usize = 4;
/// Share of a bin by which a density may be misplaced when its bin is looked up.
const SLACK: f64 = 1e-3;
/// Slope of the variation at a step; products with it stay finite.
const STEEP: f64 = 1e24;

/// Variations at the edges of a bin of densities, and the steepest slopes in it. Lanes: extinction; extinction times
/// the change of color; color. Colors are in units of the brightest.
#[derive(Debug, Clone, Copy)]
struct Bin<R: Real> {
    low: R::Lanes,
    high: R::Lanes,
    slope: R::Lanes,
}

/// Cumulative total variation of a transfer function over the density, bounded from both sides.
#[derive(Debug, Clone)]
pub(super) struct Variation<R: Real> {
    /// The first and the last one lie outside the knots, where nothing varies.
    bins: Vec<Bin<R>>,
    /// The error of a thin segment is at most its length times the deviation of the density, times this.
    pub steepest: R,
    /// Largest slope of the color.
    pub steepest_color: R,
    first: R,
    width: R,
    bins_per_density: R,
}

impl<R: Real> Variation<R> {
    /// Creates the table of a transfer function whose extinctions are multiplied by `scale`; `brightest` is the unit of
    /// its colors.
    pub fn new(table: &Table, scale: f64, brightest: f64) -> Self {
        let knots = table.knots();
        let (first, range) = (knots[0], knots[knots.len() - 1] - knots[0]);
        let count = if range > 0.0 { (BINS * knots.len()).min(MOST_BINS) } else { 1 };
        // Knots that coincide are a step in the middle of one bin.
        let width = if range > 0.0 { range / count as f64 } else { first.abs().max(1e-6) * 1e-5 };
        let first = if range > 0.0 { first } else { first - 0.5 * width };
        let mut added = vec![[0.0; 3]; count];
        let mut slopes = vec![[0.0; 3]; count];
        let bin_of = |density: f64| (((density - first) / width).max(0.0) as usize).min(count - 1);
        for piece in 1..knots.len() {
            let ([low, high], [a, b]) = table.ends(piece);
            let color = (0..3).map(|c| (b[c] - a[c]).abs()).fold(0.0, f64::max) / brightest;
            let extinctions = [scale * a[3], scale * b[3]];
            let change = (extinctions[1] - extinctions[0]).abs();
            if high <= low {
                let step = [change, extinctions[0].max(extinctions[1]) * color, color];
                let bin = bin_of(low);
                // A density at the step may be placed in the bin beside it.
                let beside = [bin_of(low - SLACK * width), bin_of(low + SLACK * width)];
                for c in (0..3).filter(|c| step[*c] > 0.0) {
                    added[bin][c] += step[c];
                    [bin, beside[0], beside[1]].into_iter().for_each(|bin| slopes[bin][c] = STEEP);
                }
                continue;
            }
            for bin in bin_of(low)..=bin_of(high) {
                let from = low.max(first + bin as f64 * width);
                let to = high.min(first + (bin + 1) as f64 * width);
                if to <= from {
                    continue;
                }
                let at = |d: f64| extinctions[0] + (extinctions[1] - extinctions[0]) * ((d - low) / (high - low));
                let (share, near, far) = ((to - from) / (high - low), at(from), at(to));
                let add = [change * share, 0.5 * (near + far) * color * share, color * share];
                let slope = [change, near.max(far) * color, color].map(|v| v / (high - low));
                for c in 0..3 {
                    added[bin][c] += add[c];
                    slopes[bin][c] = f64::max(slopes[bin][c], slope[c]);
                }
            }
        }
        let lanes = |[a, b, c]: [f64; 3]| R::Lanes::load([R::of(a), R::of(b), R::of(c), R::ZERO]);
        let mut sum = [0.0; 3];
        let flat = |sum: [f64; 3]| Bin { low: lanes(sum), high: lanes(sum), slope: R::Lanes::ZERO };
        let mut bins = vec![flat(sum)];
        for (added, slope) in added.into_iter().zip(slopes) {
            let low = lanes(sum);
            (0..3).for_each(|c| sum[c] += added[c]);
            bins.push(Bin { low, high: lanes(sum), slope: lanes(slope.map(|s| s.min(STEEP))) });
        }
        bins.push(flat(sum));
        // Of an optical depth of up to a half, `e^x - 1 ≤ 1.3 x`.
        let steepest = |c: usize| bins.iter().map(|bin: &Bin<R>| bin.slope.store()[c].f64()).fold(0.0, f64::max);
        let [depth, shift, color] = [steepest(0), steepest(1), steepest(2)];
        let steepest = R::of(((1.3 + sum[2]) * depth + shift).min(STEEP));
        Self {
            bins,
            steepest,
            steepest_color: R::of(color),
            first: R::of(first),
            width: R::of(width),
            bins_per_density: R::of(1.0 / width),
        }
    }

    /// Returns the number of the bin that holds a density, and the distance from its lower edge in units of density.
    #[inline(always)]
    fn place(&self, density: R) -> (usize, R) {
        let last = R::int(self.bins.len() as i32 - 1);
        let scaled = ((density - self.first) * self.bins_per_density + R::ONE).greater(R::ZERO).lesser(last);
        let bin = (scaled.f64() as usize).min(self.bins.len() - 1);
        (bin, (scaled - R::int(bin as i32)) * self.width)
    }

    /// Returns upper bounds of the variations between two ascending densities.
    #[inline(always)]
    pub fn between(&self, low: R, high: R) -> R::Lanes {
        let all = <R::Lanes as Lanes<R>>::splat;
        let slack = R::of(SLACK) * self.width;
        let (above, rise) = self.place(high);
        let (below, fall) = self.place(low);
        let (above, below) = (&self.bins[above], &self.bins[below]);
        let upper = above.high.lesser(above.low + above.slope * all(rise + slack));
        let lower = below.low.greater(below.high - below.slope * all(self.width - fall + slack));
        (upper - lower).greater(R::Lanes::ZERO)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
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
            let variation = Variation::<f64>::new(&table, 2.0, 9.0);
            let [low, high] = if ends[0] <= ends[1] { ends } else { [ends[1], ends[0]] };
            let at = |k: usize| 2.0 * table.values()[k][3];
            // The variation is that of a polygon through the ends and the knots between them.
            let inside = (0..knots.len()).filter(|k| low < knots[*k] && knots[*k] <= high);
            let points: Vec<f64> = [2.0 * table.at(low)[3]].into_iter().chain(inside.map(at)).chain([2.0 * table.at(high)[3]]).collect();
            let exact: f64 = points.windows(2).map(|p| (p[1] - p[0]).abs()).sum();
            let bound = variation.between(low, high).store()[0];
            prop_assert!(bound >= exact - 1e-9 * (1.0 + exact), "{} {}", bound, exact);
            let total = variation.between(-1e9, 1e9).store()[0];
            prop_assert!(bound <= total + 1e-9);
        }
    }
}
