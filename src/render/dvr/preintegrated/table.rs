//! Cumulative tables of a transfer function.
//!
//! With extinction and colour linear between two knots, what is summed up over the density, `σ r`, `σ g`, `σ b`
//! and `σ`, is quadratic there, and its integral F cubic. Sums are `f64`: their differences over a small range
//! of densities are what is asked for.

use crate::lanes::{LANES, Lanes};
use crate::real::Real;
use crate::render::curve::Curve;
use crate::scene::table::Table;
use glam::DVec4;

/// One piece of a curve, in lanes for red, green, blue and extinction, at a density `base + u`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Piece<R: Real> {
    /// Colours and extinction: `value + slope u`.
    value: R::Lanes,
    pub slope: R::Lanes,
    /// `σ r`, `σ g`, `σ b` and `σ`: `a + 2 b u + 3 c u²`.
    a: R::Lanes,
    b: R::Lanes,
    c: R::Lanes,
    /// F at the base.
    below: DVec4,
    base: R,
}

/// The sums, piece by piece of a curve.
#[derive(Debug, Clone)]
pub(super) struct Cumulative<R: Real> {
    pieces: Vec<Piece<R>>,
    /// Densities beyond these are taken for them: they are far outside the knots.
    outmost: [R; 2],
    /// Densities that differ by no more are taken for one.
    pub same: R,
    /// Where rays begin: at density zero.
    pub zero: End<R>,
    /// Range of the knots, or if they lie in one place the magnitude of their density.
    pub range: f64,
    /// Radiance that one stretch may be off by.
    pub limit: R,
}

/// How far beyond its knots a table is followed, in units of their range.
const BEYOND: f64 = 1e6;

impl<R: Real> Cumulative<R> {
    /// Of a table whose extinctions are multiplied by `scale`; `tolerance` is what a stretch may be off by, in units of
    /// the brightest colour.
    pub fn new(table: &Table, scale: f64, tolerance: f64, curve: &Curve<R, 3>) -> Self {
        let knots = table.knots();
        let (first, last) = (knots[0], knots[knots.len() - 1]);
        let rounded = |v: f64| R::of(v).f64();
        let mut below = DVec4::ZERO;
        let pieces = (0..=knots.len()).map(|p| {
            let ([low, high], [value, _]) = table.ends(p);
            let slope = table.slope_of(p);
            let knot = if p == 0 { high } else { low };
            // Knots are where the curve has them.
            let base = rounded(knot);
            let off = base - knot;
            let at = |c: usize| value[c] + off * slope[c];
            let (s, t) = (scale * at(3), scale * slope[3]);
            let lit = |c: usize| [s * at(c), 0.5 * (s * slope[c] + t * at(c)), t * slope[c] * (1.0 / 3.0)];
            let lines = [lit(0), lit(1), lit(2), [s, 0.5 * t, 0.0]];
            let lanes = |k: usize| R::Lanes::load(lines.map(|line| R::of(line[k])));
            let four = |v: [f64; 4]| R::Lanes::load(v.map(R::of));
            let piece = Piece {
                value: four([at(0), at(1), at(2), s]),
                slope: four([slope[0], slope[1], slope[2], t]),
                a: lanes(0),
                b: lanes(1),
                c: lanes(2),
                below,
                base: R::of(base),
            };
            if p > 0 && high.is_finite() {
                below = piece.sums(R::of(high));
            }
            piece
        });
        let brightest = table.peak()[..3].iter().fold(0.0, |m: f64, v| m.max(*v));
        // Of one colour, all are mixed.
        let colourful = table.values().iter().any(|v| v[..3] != table.values()[0][..3]);
        let scale = (last - first).max(first.abs()).max(last.abs());
        let range = if last > first { last - first } else { scale };
        let pieces: Vec<Piece<R>> = pieces.collect();
        Self {
            zero: End::new(&pieces, curve.find(R::ZERO), R::ZERO),
            pieces,
            outmost: [R::of(first - BEYOND * scale), R::of(last + BEYOND * scale)],
            same: R::of(1e-6 * scale),
            range,
            limit: R::of(if colourful { tolerance * brightest.max(f64::from(f32::MIN_POSITIVE)) } else { 1e30 }),
        }
    }

    /// Densities within reach of the tables.
    #[inline(always)]
    pub fn within(&self, density: R::Lanes) -> R::Lanes {
        density.clamped(self.outmost[0], self.outmost[1])
    }
}

impl<R: Real> Piece<R> {
    #[inline(always)]
    fn sums(&self, density: R) -> DVec4 {
        let wide = |v: R::Lanes| {
            let [x, y, z, w] = v.store();
            DVec4::new(x.f64(), y.f64(), z.f64(), w.f64())
        };
        let u = density.f64() - self.base.f64();
        self.below + u * (wide(self.a) + u * (wide(self.b) + u * wide(self.c)))
    }

    #[inline(always)]
    fn values(&self, density: R) -> R::Lanes {
        self.value + R::Lanes::splat(density - self.base) * self.slope
    }
}

/// The end of a stretch.
#[derive(Debug, Clone, Copy)]
pub(super) struct End<R: Real> {
    density: R,
    piece: u32,
    sums: DVec4,
    /// Colours and extinction.
    values: R::Lanes,
}

impl<R: Real> End<R> {
    fn new(pieces: &[Piece<R>], piece: u32, density: R) -> Self {
        let p = &pieces[piece as usize];
        Self { density, piece, sums: p.sums(density), values: p.values(density) }
    }
}

/// Four stretches in a row on each of which the density is linear in the length.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stretches<R: Real> {
    /// Densities where they begin and end.
    pub ends: [R::Lanes; 2],
    /// Pieces that the ends lie in, each after that in which the one before it lies.
    pub pieces: [u32; LANES + 1],
    /// Red, green, blue and extinction where they begin and end.
    pub values: [[R::Lanes; 4]; 2],
    /// Mean of `σ r`, `σ g`, `σ b` and `σ` over each.
    pub mean: [R::Lanes; 4],
    /// Above zero where a stretch has its mean from the sums, not from its ends.
    summed: R::Lanes,
}

impl<R: Real> Stretches<R> {
    /// From where the last one ended to the densities given, one after the other.
    #[inline(always)]
    pub fn new(tables: &Cumulative<R>, curve: &Curve<R, 3>, last: &mut End<R>, to: R::Lanes) -> Self {
        let all = <R::Lanes as Lanes<R>>::splat;
        let from = to.after(last.density);
        let found = curve.find_all(to);
        let pieces = [last.piece, found[0], found[1], found[2], found[3]];
        let d = to.store();
        let [p, q, r, s] = [0, 1, 2, 3].map(|i| &tables.pieces[found[i] as usize]);
        let [a, b, c, e] = [p.sums(d[0]), q.sums(d[1]), r.sums(d[2]), s.sums(d[3])];
        let apart = |before: DVec4, after: DVec4| {
            let [x, y, z, w] = (after - before).to_array();
            R::Lanes::load([R::of(x), R::of(y), R::of(z), R::of(w)])
        };
        let sums = R::Lanes::transpose([apart(last.sums, a), apart(a, b), apart(b, c), apart(c, e)]);
        let values = s.values(d[3]);
        let second = R::Lanes::transpose([p.values(d[0]), q.values(d[1]), r.values(d[2]), values]);
        let before = last.values.store();
        let first = [
            second[0].after(before[0]),
            second[1].after(before[1]),
            second[2].after(before[2]),
            second[3].after(before[3]),
        ];
        let width = to - from;
        let inverse = all(R::ONE) / width;
        let other = |i: usize| if pieces[i] == pieces[i + 1] { R::ZERO } else { R::ONE };
        let other = R::Lanes::load([other(0), other(1), other(2), other(3)]);
        let summed = width.abs().select_above(all(tables.same), other, all(R::ZERO));
        // In one piece Simpson's rule has no error: of the product of two linear functions, from their ends.
        let (begin, end) = (all(R::of(1.0 / 6.0)) * first[3], all(R::of(1.0 / 6.0)) * second[3]);
        let (at_first, at_second) = (begin + begin + end, begin + end + end);
        let pick = |c: usize, simpson: R::Lanes| summed.select_above(all(R::ZERO), sums[c] * inverse, simpson);
        let lit = |c: usize| pick(c, at_first * first[c] + at_second * second[c]);
        let mean = [lit(0), lit(1), lit(2), pick(3, at_first + at_second)];
        *last = End { density: d[3], piece: found[3], sums: e, values };
        Self { ends: [from, to], pieces, values: [first, second], mean, summed }
    }

    /// Where the first one begins.
    #[inline(always)]
    pub fn begin(&self, tables: &Cumulative<R>) -> End<R> {
        End::new(&tables.pieces, self.pieces[0], self.ends[0].store()[0])
    }

    /// Change of colours over each.
    #[inline(always)]
    pub fn drift(&self) -> [R::Lanes; 3] {
        let [first, second] = &self.values;
        [second[0] - first[0], second[1] - first[1], second[2] - first[2]]
    }

    /// How far the means are from those of the ends.
    #[inline(always)]
    pub fn bent(&self) -> R::Lanes {
        let [first, second] = &self.values;
        let half = R::Lanes::splat(R::of(0.5));
        let off = |c: usize| (self.mean[c] - half * (first[3] * first[c] + second[3] * second[c])).abs();
        let extinction = (self.mean[3] - half * (first[3] + second[3])).abs();
        extinction.greater(off(0)).greater(off(1)).greater(off(2))
    }

    /// Derivatives with respect to the densities where they begin and end, from those with respect to the means and
    /// to the drift.
    #[inline(always)]
    pub fn slopes(
        &self,
        tables: &Cumulative<R>,
        by_mean: [R::Lanes; 4],
        by_drift: [R::Lanes; 3],
    ) -> [R::Lanes; 2] {
        let all = <R::Lanes as Lanes<R>>::splat;
        let [first, second] = &self.values;
        let slope = |i: usize| tables.pieces[self.pieces[i] as usize].slope;
        let slopes = [
            R::Lanes::transpose([slope(0), slope(1), slope(2), slope(3)]),
            R::Lanes::transpose([slope(1), slope(2), slope(3), slope(4)]),
        ];
        let zero = all(R::ZERO);
        let inverse = all(R::ONE) / (self.ends[1] - self.ends[0]);
        let (sixth, half) = (all(R::of(1.0 / 6.0)), all(R::of(0.5)));
        // Of Simpson's rule, at either end.
        let of_ends = |near: usize, far: usize| {
            let (here, there) = (&self.values[near], &self.values[far]);
            let share = sixth * (here[3] + here[3] + there[3]);
            let (mut by_colours, mut by_extinction) = (zero, half * by_mean[3]);
            for c in 0..3 {
                by_colours += by_mean[c] * share * slopes[near][c];
                by_extinction += by_mean[c] * sixth * (here[c] + here[c] + there[c]);
            }
            by_colours + by_extinction * slopes[near][3]
        };
        // Of a difference of sums, divided by that of the densities.
        let of_sums = |end: &[R::Lanes; 4]| {
            let off = |c: usize| by_mean[c] * (end[3] * end[c] - self.mean[c]);
            ((off(0) + off(1)) + (off(2) + by_mean[3] * (end[3] - self.mean[3]))) * inverse
        };
        let drift = |at: usize| {
            by_drift[0] * slopes[at][0] + by_drift[1] * slopes[at][1] + by_drift[2] * slopes[at][2]
        };
        [
            self.summed.select_above(zero, zero - of_sums(first), of_ends(0, 1)) - drift(0),
            self.summed.select_above(zero, of_sums(second), of_ends(1, 0)) + drift(1),
        ]
    }
}
