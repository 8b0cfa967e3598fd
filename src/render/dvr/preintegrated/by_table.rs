//! The gradient of pre-integration with respect to the transfer function.

use super::batch::SegmentBatch;
use super::table::Cumulative;
use crate::real::Real;
use crate::render::curve::{Curve, Piece};
use crate::scene::table::TableGradient;

impl<R: Real> SegmentBatch<R> {
    /// Adds derivatives with respect to the ends of the transfer function's pieces, from those with respect to the
    /// means and drift of segment `i`; the curve's extinctions are the table's times `scale`.
    #[inline(never)]
    pub(crate) fn by_table(
        &self,
        i: usize,
        tables: &Cumulative<R>,
        curve: &Curve<R, 3>,
        scale: f64,
        (by_mean, by_drift): ([f64; 4], [f64; 3]),
        table: &mut TableGradient,
    ) {
        let (begin, end, pieces) = (self.density[i], self.density[i + 1], [self.piece[i], self.piece[i + 1]]);
        for (number, density, sign) in [(pieces[0], begin, -1.0), (pieces[1], end, 1.0)] {
            let upper = upper(curve.piece(number), density.f64());
            let ends = &mut table.pieces[number as usize];
            for c in 0..3 {
                ends[0][c] += sign * (1.0 - upper) * by_drift[c];
                ends[1][c] += sign * upper * by_drift[c];
            }
        }
        let (low, high) = (begin.lesser(end).f64(), begin.greater(end).f64());
        let mut add = |number: u32, density: f64, share: f64| {
            let line = curve.piece(number);
            add(&mut table.pieces[number as usize], line, scale, density, by_mean.map(|g| share * g));
        };
        let deviation = self.deviation[i].f64();
        if pieces[0] != pieces[1] && deviation != 0.0 {
            let share = deviation / (end.f64() - begin.f64());
            add(pieces[1], end.f64(), share);
            add(pieces[0], begin.f64(), -share);
        } else if deviation != 0.0 {
            // The slope of a quadratic in the middle is its difference over any range around it.
            let (middle, line) = (0.5 * (low + high), curve.piece(pieces[0]));
            let reach = (line.high.f64() - line.low.f64()).clamp(1e-3, 1e3);
            add(pieces[0], middle + reach, 0.5 * deviation / reach);
            add(pieces[0], middle - reach, -0.5 * deviation / reach);
        }
        if high - low <= tables.same.f64() {
            return add(pieces[1], 0.5 * (low + high), 1.0);
        }
        let [first, last] = [pieces[0].min(pieces[1]), pieces[0].max(pieces[1])];
        for number in first..=last {
            let line = curve.piece(number);
            if line.is_step() && (first + 1..last).contains(&number) {
                let side = |number: u32| curve.piece(number).side(line.low);
                let (below, above) = (side(number - 1), side(number + 1));
                // What a side has more than the ramp that would lie between the two.
                let more = |[_, (extinction, emitted)]: [(f64, [f64; 3]); 2]| {
                    let emitted: f64 = (0..3).map(|c| by_mean[c] * emitted[c]).sum();
                    (by_mean[3] * extinction + emitted) / (high - low)
                };
                let (below, above) = (more(below.sides(&above)), more(above.sides(&below)));
                table.steps[number as usize - 1] += below;
                table.steps[number as usize] -= above;
                continue;
            }
            // The outermost reach beyond the knots, not less far than the densities do.
            let from = if number == first { low } else { line.low.f64() };
            let to = if number == last { high } else { line.high.f64() };
            if to > from {
                // The mean is that of a quadratic: Simpson's rule is exact.
                let share = (to - from) / (high - low) / 6.0;
                add(number, from, share);
                add(number, 0.5 * (from + to), 4.0 * share);
                add(number, to, share);
            }
        }
    }
}

/// Returns the weight of the upper end's value in the value at a density.
fn upper<R: Real>(line: &Piece<R, 3>, density: f64) -> f64 {
    line.fraction(R::ZERO).f64() + density * line.fraction_slope().f64()
}

/// Adds derivatives with respect to a piece's ends, from those with respect to `σ r`, `σ g`, `σ b` and `σ` at one
/// density.
fn add<R: Real>(ends: &mut [[f64; 4]; 2], line: &Piece<R, 3>, scale: f64, density: f64, by: [f64; 4]) {
    let offset = density - line.base.f64();
    let at = |[at_base, slope]: [R; 2]| at_base.f64() + slope.f64() * offset;
    let upper = upper(line, density);
    let extinction = at(line.extinction);
    let mut by_extinction = by[3];
    for c in 0..3 {
        by_extinction += by[c] * at(line.source[c]);
        ends[0][c] += by[c] * extinction * (1.0 - upper);
        ends[1][c] += by[c] * extinction * upper;
    }
    ends[0][3] += scale * by_extinction * (1.0 - upper);
    ends[1][3] += scale * by_extinction * upper;
}
