//! Bounds of the error in light and transmittance that nodes too far apart cause: the density is not linear between
//! them, nor the color in the optical depth.
//!
//! [`Deviations`](super::deviation::Deviations) bounds how far the density lies from the line between two nodes, and
//! [`Variation`](super::variation::Variation) turns that into bounds of the errors of a segment's optical depth and
//! color.
//!
//! If segments are exchanged one after the other, from the far end, for exact ones, each changes the pixel by at most
//! its own error times the transmittance in front of it: the sum over the segments bounds the error of the pixel, in
//! units of the brightest radiance of medium and background.

use super::batch::{SegmentBatch, at};
use super::nodes::ROOM;
use super::table::Cumulative;
use crate::real::{LANES, Lanes, Real};

/// Shares of the tolerance that segments may use in proportion to the light that they absorb, by attempt: in the first,
/// most use far less than they may, and the sum decides; in the second, it cannot exceed the tolerance. Segments that
/// absorb next to nothing, as in front of and beside a surface, have the rest.
const BY_ABSORPTION: [f64; ATTEMPTS] = [2.4, 0.6];
/// Attempts at a ray.
pub(super) const ATTEMPTS: usize = 2;
/// Share of the tolerance that is the rest.
const REST: f64 = 0.4;
/// Share of what is left of that rest that one segment may use.
const OF_REST: f64 = 1.0 / 16.0;
/// The most parts that a segment is divided into at a time.
pub(super) const MOST_PARTS: usize = 16;
/// How often a segment is divided before its error is accepted as it is.
const MOST_LEVELS: u8 = 3;
/// The error of a mean that is corrected, per variation of the slope and largest deviation, that is made by the slope's
/// following the deviation; see [`super::variation`].
const FOLLOWS: f64 = 0.13;
/// Share of the difference of a segment's densities up to which their rounding is left out.
const BLURRED: f64 = 1e-3;
/// More than any error.
const NO_BOUND: f64 = 1e30;

/// The bound of the error that a ray's nodes have caused so far, and the attempt that decides what they may.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Budget {
    /// Bound of the error so far, in units of the brightest radiance.
    pub used: f64,
    /// Part of it in segments that absorb too little for it.
    rest: f64,
    /// Number of the attempt at the ray.
    attempt: usize,
}

impl Budget {
    /// Creates the budget of an attempt at a ray.
    pub(crate) fn new(attempt: usize) -> Self {
        Self { attempt, ..Self::default() }
    }

    /// Charges the segments of a batch, before which transmittances are known. If some need nodes in between, nothing
    /// is charged, their numbers of parts are left in the batch, and the result is false; segments that were divided
    /// `level` times before may be too many to be divided again.
    #[inline(always)]
    pub(crate) fn charge<R: Real>(&mut self, batch: &mut SegmentBatch<R>, level: u8, tables: &Cumulative<R>) -> bool {
        batch.bound(tables, BY_ABSORPTION[self.attempt] * tables.tolerance);
        let (count, errors) = (batch.count.min(ROOM), &mut batch.errors);
        let (mut sum, mut more) = (R::Lanes::ZERO, R::Lanes::ZERO);
        for n in (0..count).step_by(LANES) {
            let (error, allowed) = (at(&errors.error, n.min(ROOM - LANES)), at(&errors.allowed, n.min(ROOM - LANES)));
            sum += error;
            more = more.greater(error - allowed);
        }
        if R::Lanes::ZERO.reach(more) {
            self.used += sum.sum().f64();
            return true;
        }
        let tolerance = tables.tolerance;
        let (mut rest, mut used, mut whole) = (self.rest, self.used, true);
        for i in 0..count {
            let (error, by_absorption) = (errors.error[i].f64(), errors.allowed[i].f64());
            errors.parts[i] = 1;
            if error > by_absorption {
                let allowed = (OF_REST * (REST * tolerance - rest)).max(by_absorption);
                rest += error.min(allowed);
                if error > allowed && level < MOST_LEVELS {
                    // The error falls with the square of the number of parts, of which there is no end where none is
                    // allowed.
                    let wanted = 1.1 * (error / allowed.max(f64::MIN_POSITIVE)).sqrt();
                    errors.parts[i] = (wanted.min(MOST_PARTS as f64) as usize + 1).clamp(2, MOST_PARTS) as u8;
                    whole = false;
                }
            }
            used += error;
        }
        if whole {
            (self.used, self.rest) = (used, rest);
        }
        whole
    }
}

impl<R: Real> SegmentBatch<R> {
    /// Computes bounds of the changes of the pixel that the segments cause, by densities between their ends that are
    /// not where they are taken to be, and by colors that are taken as linear in the optical depth.
    #[inline(always)]
    fn bound(&mut self, tables: &Cumulative<R>, by_absorption: f64) {
        let count = self.count.min(ROOM);
        for n in (0..count).step_by(LANES) {
            let n = n.min(ROOM - LANES);
            let (a, b) = (at(&self.density, n), at(&self.density, n + 1));
            let noise = at(&self.noise, n).greater(at(&self.noise, n + 1));
            let (low, high) = (a.lesser(b) - at(&self.below, n) - noise, a.greater(b) + at(&self.above, n) + noise);
            let varied = tables.variation.between(low, high);
            let errors = &mut self.errors;
            errors.extinction[n..n + LANES].copy_from_slice(&varied.extinction.store());
            errors.shift[n..n + LANES].copy_from_slice(&varied.shift.store());
            errors.color[n..n + LANES].copy_from_slice(&varied.color.store());
            errors.extinction_slope[n..n + LANES].copy_from_slice(&varied.extinction_slope.store());
            errors.emitted_slope[n..n + LANES].copy_from_slice(&varied.emitted_slope.store());
            errors.steps[n..n + LANES].copy_from_slice(&varied.steps.store());
        }
        self.bound_depths(tables);
        self.bound_light(tables, by_absorption);
    }

    /// Computes bounds of the errors of optical depths, and of the light that segments emit by their mean color.
    #[inline(always)]
    fn bound_depths(&mut self, tables: &Cumulative<R>) {
        let abs = |v: R| v.greater(-v);
        let (half, same, [steepest, steepest_shift]) = (R::of(0.5), tables.same, tables.variation.steepest);
        let errors = &mut self.errors;
        for i in 0..self.count.min(ROOM) {
            let length = self.length[i];
            let width = abs(self.density[i + 1] - self.density[i]);
            let inverse = R::ONE / width.greater(same);
            let (below, above) = (self.below[i], self.above[i]);
            let farthest = below.greater(above);
            // Without the correction by the mean deviation: the variation of the function. A correction may be wrong by
            // all that it is.
            let correction = abs(self.deviation[i]);
            let turned = correction * inverse;
            // Between densities that count as equal, of different pieces, the function may be anything that it is
            // there.
            let unknown = (self.piece[i] != self.piece[i + 1]) & (width <= same);
            let (least, reach) = if unknown { (R::ONE, width) } else { (R::ZERO, R::ZERO) };
            let share = ((below + above) * inverse).lesser(R::ONE).greater(least) + turned;
            let first = (errors.extinction[i] * share).lesser((farthest + correction + reach) * steepest);
            // With it: the variation of the function's slope.
            let around = farthest.lesser(half * (below * below + above * above) * inverse);
            let second = R::of(FOLLOWS) * farthest + around;
            let steps = if self.corrected[i] > R::ZERO { errors.steps[i] } else { R::ONE };
            let none = steps * R::of(NO_BOUND);
            // What the ends' rounding may move, where it is not small beside the difference of the densities.
            let rounded = self.noise[i] + self.noise[i + 1];
            let blurred = (rounded * inverse).lesser(R::ONE);
            let blurred = if blurred > R::of(BLURRED) { blurred } else { R::ZERO };
            let moved = (errors.extinction[i] * blurred).lesser(rounded * steepest);
            let shifted = (errors.shift[i] * blurred).lesser(rounded * steepest_shift);
            let off = length * (first.lesser(second * errors.extinction_slope[i] + none) + moved);
            errors.depth[i] = off;
            // The mean color is between those at hand, but for the correction, and moves by what it is made of.
            let color = errors.color[i];
            let beside = if correction > R::ZERO { length * first * color } else { R::ZERO };
            let by_first = length * errors.shift[i] * share + off.lesser(R::ONE) * color + beside;
            let by_second = length * second * errors.emitted_slope[i] + off + none;
            errors.light[i] = by_first.lesser(by_second) + length * shifted;
            let ends = (self.values[3][i] + self.values[3][i + 1]) / self.mean[3][i].greater(R::of(1e-30));
            errors.range[i] = color + color * turned * ends;
        }
    }

    /// Computes bounds of the changes of the pixel, and `by_absorption` of the light that is absorbed.
    #[inline(always)]
    fn bound_light(&mut self, tables: &Cumulative<R>, by_absorption: f64) {
        let (half, three) = (R::of(0.5), R::of(3.0));
        let by_absorption = R::of(by_absorption);
        let colorful = if tables.per_brightest > R::ZERO { R::ONE } else { R::ZERO };
        for i in 0..self.count.min(ROOM) {
            let (off, through) = (self.errors.depth[i], self.transmittance[i]);
            // Of optical depths x and y, `|e^-x - e^-y| ≤ e^-x (e^|x - y| - 1)`; the series is an upper bound up to 3.
            let few = off.lesser(three);
            let growth = few * (R::ONE + half * few * (R::ONE + R::of(4.0 / 3.0) * few));
            let lost = if off < three { (through * growth).lesser(R::ONE) } else { R::ONE };
            let absorbed = (R::ONE - through + through * few).lesser(R::ONE);
            let moved = self.errors.light[i].lesser(absorbed * self.errors.range[i]);
            // A color that differs from one linear in the optical depth by at most its variation, on average by
            // nothing.
            let across = absorbed * self.errors.color[i] * (R::of(0.25) * self.depth[i]).lesser(R::ONE);
            let within = self.color_error(i) * tables.per_brightest;
            let mixed = if self.piece[i] == self.piece[i + 1] { within } else { across };
            let before = self.before[i];
            let error = before * (lost + colorful * (moved + mixed));
            self.errors.error[i] = if self.length[i] > R::ZERO { error } else { R::ZERO };
            self.errors.allowed[i] = by_absorption * (before - before * through);
        }
    }

    /// Returns an estimate of the error, in light that a segment would add with nothing in front of it, of taking the
    /// color as linear in the optical depth, if the function has one piece between its ends.
    #[inline(always)]
    fn color_error(&self, i: usize) -> R {
        let abs = |v: R| v.greater(-v);
        let [red, green, blue, extinction] = &self.values;
        let (begin, end) = (R::of(0.5) * extinction[i], R::of(0.5) * extinction[i + 1]);
        let red = abs(self.mean[0][i] - (begin * red[i] + end * red[i + 1]));
        let green = abs(self.mean[1][i] - (begin * green[i] + end * green[i + 1]));
        let blue = abs(self.mean[2][i] - (begin * blue[i] + end * blue[i + 1]));
        abs(self.drift[i]) * self.length[i] * red.greater(green).greater(blue)
    }
}
