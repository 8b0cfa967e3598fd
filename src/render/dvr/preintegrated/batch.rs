//! Batches of segments on each of which the density is linear in the length: their means, and the light that they
//! contribute.
//!
//! With `x` a segment's optical depth, `T` the transmittance before it, `e` the mean of `σ c` over its length h, and
//! `d` the change of the color c from its begin to its end, it adds `T (e h A + d B)`, where `A = (1 - e^{-x}) / x` and
//! `B = A - (1 + e^{-x}) / 2`: this has no error where the color is linear in the optical depth.
//!
//! Where the density is a cubic, which lies by a mean deviation δ beside the line, `σ c` and σ have means that differ
//! by δ times their mean slopes along the line, which are their differences from end to end over that of the densities.
//!
//! Loops run over plain arrays without a branch, so that compilers vectorise them for each instruction set.

use super::deviation::Deviation;
use super::errors::Errors;
use super::nodes::{ROOM, WIDE};
use super::table::{Cumulative, End};
use crate::real::Real;
use crate::real::{LANES, Lanes};
use crate::render::curve::Curve;

/// Least optical depth in divisions: smaller ones are replaced by it.
const LEAST: f64 = 1e-30;
/// Optical depth below which B is computed from its power series.
const THIN: f64 = 0.5;
/// Largest mean deviation, in units of the difference of the densities, that means are corrected by: the mean slope is
/// a quotient of differences across knots, and rounded as such.
const MOST_SHARE: f64 = 32.0;
/// Coefficients of the power series of B, from the second power on: `(-1)^k (1/(k+1)! - 1/(2 k!))`; the truncated terms
/// are below 1e-14.
const POWERS: [f64; 11] = [
    -1.0 / 12.0,
    1.0 / 24.0,
    -1.0 / 80.0,
    1.0 / 360.0,
    -1.0 / 2016.0,
    1.0 / 13440.0,
    -1.0 / 103_680.0,
    1.0 / 907_200.0,
    -1.0 / 8_870_400.0,
    1.0 / 95_800_320.0,
    -1.0 / 1_132_185_600.0,
];

/// Numbers by segment (`Segment`), or by end of a segment (`Ends`): entry 0 is where the first segment begins.
type Segment<R> = [R; ROOM];
type Ends<R> = [R; ROOM + 1];

/// A batch of segments. Their number is a multiple of [`WIDE`]; padding segments have no length.
#[derive(Debug, Clone)]
pub(super) struct SegmentBatch<R: Real> {
    /// Number of segments.
    pub count: usize,
    /// Densities at the segments' ends.
    pub density: Ends<R>,
    /// Pieces of the curve that the densities lie in.
    pub piece: Ends<u32>,
    /// Red, green, blue and extinction at the ends.
    pub values: [Ends<R>; 4],
    /// Slopes of these with the density.
    pub slopes: [Ends<R>; 4],
    /// World lengths of the segments.
    pub length: Segment<R>,
    /// Rounding of the densities at the segments' ends, see [`Deviation`].
    pub noise: Ends<R>,
    /// How far the densities may lie below and above the line.
    pub below: Segment<R>,
    pub above: Segment<R>,
    /// Mean deviations δ that the means are corrected by, and 1; 0 and 0 where they are not.
    pub deviation: Segment<R>,
    pub corrected: Segment<R>,
    /// Means of `σ r`, `σ g`, `σ b` and `σ`.
    pub mean: [Segment<R>; 4],
    /// Optical depths x of the segments.
    pub depth: Segment<R>,
    /// Transmittances `e^{-x}` of the segments.
    pub transmittance: Segment<R>,
    /// Weights A and B of the mean and of the change of color.
    pub mixed: Segment<R>,
    pub drift: Segment<R>,
    /// Transmittances from the eye to the segments' beginnings.
    pub before: Segment<R>,
    /// Bounds of the segments' errors.
    pub errors: Errors<R>,
}

impl<R: Real> Default for SegmentBatch<R> {
    fn default() -> Self {
        let (segment, ends) = ([R::ZERO; ROOM], [R::ZERO; ROOM + 1]);
        Self {
            count: 0,
            density: ends,
            piece: [0; ROOM + 1],
            values: [ends; 4],
            slopes: [ends; 4],
            length: segment,
            noise: ends,
            below: segment,
            above: segment,
            deviation: segment,
            corrected: segment,
            mean: [segment; 4],
            depth: segment,
            transmittance: segment,
            mixed: segment,
            drift: segment,
            before: segment,
            errors: Errors::default(),
        }
    }
}

impl<R: Real> SegmentBatch<R> {
    /// Sets densities, lengths and deviations of the `n`-th four segments.
    #[inline(always)]
    pub(crate) fn place(&mut self, n: usize, density: R::Lanes, length: R::Lanes, deviation: &Deviation<R>) {
        let n = (LANES * n).min(ROOM - LANES);
        self.density[n + 1..n + 1 + LANES].copy_from_slice(&density.store());
        self.length[n..n + LANES].copy_from_slice(&length.store());
        self.below[n..n + LANES].copy_from_slice(&deviation.below.store());
        self.above[n..n + LANES].copy_from_slice(&deviation.above.store());
        self.noise[n + 1..n + 1 + LANES].copy_from_slice(&deviation.noise.store());
        self.deviation[n..n + LANES].copy_from_slice(&deviation.mean.store());
        self.corrected[n..n + LANES].copy_from_slice(&deviation.within.store());
    }

    /// Computes the remaining numbers from what was placed. `last` is the end at which the first segment begins;
    /// it is set to that at which the last one ends.
    #[inline(always)]
    pub(crate) fn follow(&mut self, tables: &Cumulative<R>, curve: &Curve<R, 3>, last: &mut End<R>) {
        debug_assert!(self.count.is_multiple_of(WIDE) && self.count <= ROOM, "{} segments", self.count);
        self.look_up(tables, curve, last);
        self.settle(tables);
    }

    /// Looks up values at the ends, and stores as means the differences of sums (means times the difference of
    /// densities).
    #[inline(always)]
    fn look_up(&mut self, tables: &Cumulative<R>, curve: &Curve<R, 3>, last: &mut End<R>) {
        self.density[0] = last.density;
        self.piece[0] = last.piece;
        let (first, slopes) = (last.values.store(), tables.piece(last.piece).slope.store());
        for c in 0..4 {
            (self.values[c][0], self.slopes[c][0]) = (first[c], slopes[c]);
        }
        for four in 0..self.count / LANES {
            let n = (LANES * four).min(ROOM - LANES);
            let d = [self.density[n + 1], self.density[n + 2], self.density[n + 3], self.density[n + 4]];
            let found = curve.find_all(R::Lanes::load(d));
            self.piece[n + 1..n + 1 + LANES].copy_from_slice(&found);
            let piece = |i: usize| tables.piece(found[i]);
            let (p, q, r, s) = (piece(0), piece(1), piece(2), piece(3));
            let [a, b, c, e] = [p.sums(d[0]), q.sums(d[1]), r.sums(d[2]), s.sums(d[3])];
            let apart = |before: [f64; 4], after: [f64; 4]| {
                let of = |c: usize| R::of(after[c] - before[c]);
                R::Lanes::load([of(0), of(1), of(2), of(3)])
            };
            let sums = R::Lanes::transpose([apart(last.sums, a), apart(a, b), apart(b, c), apart(c, e)]);
            let end = s.values(d[3]);
            let values = R::Lanes::transpose([p.values(d[0]), q.values(d[1]), r.values(d[2]), end]);
            let slopes = R::Lanes::transpose([p.slope, q.slope, r.slope, s.slope]);
            for c in 0..4 {
                self.slopes[c][n + 1..n + 1 + LANES].copy_from_slice(&slopes[c].store());
                self.mean[c][n..n + LANES].copy_from_slice(&sums[c].store());
                self.values[c][n + 1..n + 1 + LANES].copy_from_slice(&values[c].store());
            }
            *last = End { density: d[3], piece: found[3], sums: e, values: end };
        }
    }

    /// True if the densities at a segment's ends are apart by more than rounding.
    #[inline(always)]
    fn is_wide(&self, tables: &Cumulative<R>, i: usize) -> bool {
        let width = self.density[i + 1] - self.density[i];
        width.greater(-width) > tables.same
    }

    /// True if a segment's mean is computed from cumulative sums, not from the values at its ends.
    #[inline(always)]
    pub(crate) fn is_summed(&self, tables: &Cumulative<R>, i: usize) -> bool {
        (self.piece[i] != self.piece[i + 1]) & self.is_wide(tables, i)
    }

    /// Computes means, optical depths, transmittances and the weights A and B.
    #[inline(always)]
    fn settle(&mut self, tables: &Cumulative<R>) {
        let (sixth, half) = (R::of(1.0 / 6.0), R::of(0.5));
        let [red, green, blue, extinction] = &self.values;
        let [by_red, by_green, by_blue, by_extinction] = &self.slopes;
        for i in 0..self.count.min(ROOM) {
            let inverse = R::ONE / (self.density[i + 1] - self.density[i]);
            let wide = self.is_wide(tables, i);
            let one_piece = self.piece[i] == self.piece[i + 1];
            let summed = !one_piece & wide;
            // In one piece Simpson's rule has no error: of the product of two linear functions, from their ends.
            let (near, far) = (extinction[i], extinction[i + 1]);
            let (begin, end) = (sixth * near, sixth * far);
            let (at_first, at_second) = (begin + begin + end, begin + end + end);
            let pick = |sums: R, simpson: R| if summed { sums * inverse } else { simpson };
            let line = [
                pick(self.mean[0][i], at_first * red[i] + at_second * red[i + 1]),
                pick(self.mean[1][i], at_first * green[i] + at_second * green[i + 1]),
                pick(self.mean[2][i], at_first * blue[i] + at_second * blue[i + 1]),
                pick(self.mean[3][i], at_first + at_second),
            ];
            // Mean slopes: within a piece those in the middle, of which nothing cancels.
            let (middle, steep) = (half * (near + far), half * by_extinction[i + 1]);
            let slope = |v: &Ends<R>, by: &Ends<R>| {
                let (inside, across) = (steep * (v[i] + v[i + 1]) + middle * by[i + 1], far * v[i + 1] - near * v[i]);
                if one_piece { inside } else { across * inverse }
            };
            let deviation = self.deviation[i];
            let more = |slope: R| deviation * slope;
            let mean = [
                line[0] + more(slope(red, by_red)),
                line[1] + more(slope(green, by_green)),
                line[2] + more(slope(blue, by_blue)),
                line[3] + more(if one_piece { by_extinction[i + 1] } else { (far - near) * inverse }),
            ];
            // A quotient of differences is rounded as such. Neither light nor extinction is negative; next to where
            // they end the slope is none of them.
            let share = deviation * inverse;
            let steady = one_piece | (wide & (share.greater(-share) <= R::of(MOST_SHARE)));
            let least = mean[0].lesser(mean[1]).lesser(mean[2].lesser(mean[3]));
            let corrected = steady & (least >= R::ZERO) & (self.corrected[i] > R::ZERO);
            self.corrected[i] = if corrected { R::ONE } else { R::ZERO };
            self.deviation[i] = if corrected { deviation } else { R::ZERO };
            self.mean[0][i] = if corrected { mean[0] } else { line[0] };
            self.mean[1][i] = if corrected { mean[1] } else { line[1] };
            self.mean[2][i] = if corrected { mean[2] } else { line[2] };
            let mean = if corrected { mean[3] } else { line[3] };
            self.mean[3][i] = mean;
            self.depth[i] = (self.length[i] * mean).greater(R::ZERO);
        }
        for i in 0..self.count.min(ROOM) {
            [self.transmittance[i], self.mixed[i], self.drift[i]] = shares(self.depth[i]);
        }
    }

    /// Computes the transmittances before the segments; `transmittance` is that before the first one, and is set to
    /// that behind the last.
    #[inline(always)]
    pub(crate) fn arrive(&mut self, transmittance: &mut R) {
        for four in 0..self.count / LANES {
            let n = (LANES * four).min(ROOM - LANES);
            let through = at(&self.transmittance, n).running_product();
            let before = R::Lanes::splat(*transmittance) * through.after(R::ONE);
            *transmittance = *transmittance * through.store()[LANES - 1];
            self.before[n..n + LANES].copy_from_slice(&before.store());
        }
    }

    /// Returns the segments' light, by channel, and their optical depth.
    #[inline(always)]
    pub(crate) fn blend(&self) -> ([f64; 3], f64) {
        let mut light = [R::Lanes::ZERO; 3];
        let mut depths = R::Lanes::ZERO;
        for four in 0..self.count / LANES {
            let n = (LANES * four).min(ROOM - LANES);
            let before = at(&self.before, n);
            let (mixed, drift) = (before * at(&self.mixed, n) * at(&self.length, n), before * at(&self.drift, n));
            for c in 0..3 {
                let v = &self.values[c];
                let change = R::Lanes::load([v[n + 1], v[n + 2], v[n + 3], v[n + 4]]) - at(v, n);
                light[c] += mixed * at(&self.mean[c], n) + drift * change;
            }
            depths += at(&self.depth, n);
        }
        (light.map(|l| l.sum().f64()), depths.sum().f64())
    }
}

/// Returns four numbers, from the `n`-th on.
#[inline(always)]
pub(super) fn at<R: Real>(v: &[R], n: usize) -> R::Lanes {
    R::Lanes::load([v[n], v[n + 1], v[n + 2], v[n + 3]])
}

/// Returns `e^{-x}`, A and B.
#[inline(always)]
pub(crate) fn shares<R: Real>(depth: R) -> [R; 3] {
    let [transmittance, _] = depth.through_and_absorbed();
    let ends = R::of(0.5) * (R::ONE + transmittance);
    let thin = depth * depth * powers(depth);
    let thick = depth > R::of(THIN);
    // Never zero where it is divided by.
    let mixed = (R::ONE - transmittance) / depth.greater(R::of(THIN));
    if thick { [transmittance, mixed, mixed - ends] } else { [transmittance, thin + ends, thin] }
}

/// Returns the derivatives of A and B with respect to x, from x, `e^{-x}`, A and B.
#[inline(always)]
pub(super) fn share_slopes<R: Real>(depth: R, [transmittance, mixed, drift]: [R; 3]) -> [R; 2] {
    let half = R::of(0.5);
    let inverse = R::ONE / depth.greater(R::of(LEAST));
    let thick = (transmittance - mixed) * inverse;
    // The same by B, from which nothing cancels: `e^{-x} - A = -x A / 2 - B`.
    let (by_drift, halved) = (drift * inverse, half * mixed);
    let thin = [-halved - by_drift, -half * (depth * halved + drift) - by_drift];
    if depth > R::of(THIN) { [thick, thick + half * transmittance] } else { thin }
}

/// Returns the power series of B divided by x².
#[inline(always)]
fn powers<R: Real>(x: R) -> R {
    // Single precision has enough of seven.
    let count = if R::EPSILON.f64() > 1e-10 { 7 } else { POWERS.len() };
    let mut sum = R::of(POWERS[count - 1]);
    for k in (0..count - 1).rev() {
        sum = R::of(POWERS[k]) + x * sum;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Means over a segment of `e^{-x u}` and, times x, of `(u - 1/2) e^{-x u}`, and their derivatives; on both sides
    /// of where powers end.
    #[test]
    fn shares_are_integrals() {
        for x in [1e-9, 1e-3, 0.1, 0.499_999, 0.500_001, 2.0, 30.0, 800.0] {
            let [transmittance, mixed, drift] = shares::<f64>(x);
            let n = 200_000;
            let (mut means, mut slopes) = ([0.0; 2], [0.0; 2]);
            for k in 0..n {
                let u = (f64::from(k) + 0.5) / f64::from(n);
                let light = (-x * u).exp() / f64::from(n);
                means[0] += light;
                means[1] += x * (u - 0.5) * light;
                slopes[0] -= u * light;
                slopes[1] += (u - 0.5) * (1.0 - x * u) * light;
            }
            let [by_mixed, by_drift] = share_slopes(x, [transmittance, mixed, drift]);
            let found = [mixed, drift, by_mixed, by_drift];
            for (found, expected) in found.into_iter().zip(means.into_iter().chain(slopes)) {
                assert!((found - expected).abs() < 2e-6 * expected.abs() + 1e-9, "{x}: {found} {expected}");
            }
            let single = shares(x as f32);
            let slopes = share_slopes(x as f32, single);
            let double = [transmittance, mixed, drift, by_mixed, by_drift];
            for (single, double) in single.into_iter().chain(slopes).zip(double) {
                assert!((f64::from(single) - double).abs() < 5e-7, "{x}: {single} {double}");
            }
        }
    }

    /// Both shares are within two units in the last place of those in double precision, from depths of next to nothing
    /// on.
    #[test]
    fn what_passes_and_what_is_absorbed_are_accurate() {
        let mut most = [0.0_f64; 2];
        for step in 0..400_000 {
            let x = (1e-38_f64.ln() + f64::from(step) * (87e38_f64.ln() / 400_000.0)).exp() as f32;
            let exact = f64::from(x).through_and_absorbed();
            for (k, (single, double)) in x.through_and_absorbed().into_iter().zip(exact).enumerate() {
                let unit = f64::from((double as f32).next_up()) - f64::from(double as f32);
                most[k] = most[k].max((f64::from(single) - double).abs() / unit);
            }
        }
        assert!(most.iter().all(|units| *units <= 2.0), "{most:?}");
        assert_eq!(1e30_f32.through_and_absorbed()[1], 1.0);
        assert_eq!(0.0_f32.through_and_absorbed(), [1.0, 0.0]);
    }
}
