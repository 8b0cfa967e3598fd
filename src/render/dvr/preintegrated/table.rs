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

/// `σ r`, `σ g`, `σ b` and `σ` on one piece, in a lane each: `a + 2 b u + 3 c u²` at a density `base + u`.
#[derive(Debug, Clone, Copy)]
struct Piece<R: Real> {
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
    /// True if the colour depends on the density.
    pub colourful: bool,
}

/// How far beyond its knots a table is followed, in units of their range.
const BEYOND: f64 = 1e6;

impl<R: Real> Cumulative<R> {
    /// Of a table whose extinctions are multiplied by `scale`.
    pub fn new(table: &Table, scale: f64, curve: &Curve<R, 3>) -> Self {
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
            let piece = Piece { a: lanes(0), b: lanes(1), c: lanes(2), below, base: R::of(base) };
            if p > 0 && high.is_finite() {
                below = piece.sums(R::of(high));
            }
            piece
        });
        let scale = (last - first).max(first.abs()).max(last.abs());
        let range = if last > first { last - first } else { scale };
        let pieces: Vec<Piece<R>> = pieces.collect();
        let piece = curve.find(R::ZERO);
        Self {
            zero: End { density: R::Lanes::ZERO, piece, sums: pieces[piece as usize].sums(R::ZERO) },
            pieces,
            outmost: [R::of(first - BEYOND * scale), R::of(last + BEYOND * scale)],
            same: R::of(1e-6 * scale),
            range,
            colourful: table.values().iter().any(|v| v[..3] != table.values()[0][..3]),
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
        let wide = |v: R::Lanes| DVec4::from_array(v.store().map(Real::f64));
        let u = density.f64() - self.base.f64();
        self.below + u * (wide(self.a) + u * (wide(self.b) + u * wide(self.c)))
    }

    /// Mean over a stretch: if it lies in `one` piece, from the sum of its ends' distances from the base, and what
    /// the square of the density adds to that of its middle; else from the sums.
    #[inline(always)]
    fn mean(&self, one: bool, middle: R, bend: R, before: DVec4, sums: DVec4, inverse: R) -> R::Lanes {
        let all = <R::Lanes as Lanes<R>>::splat;
        if one {
            self.a + all(middle) * self.b + all(bend) * self.c
        } else {
            R::Lanes::load((sums - before).to_array().map(R::of)) * all(inverse)
        }
    }
}

/// The end of a stretch.
#[derive(Debug, Clone, Copy)]
pub(super) struct End<R: Real> {
    /// Its density in the last lane.
    density: R::Lanes,
    piece: u32,
    sums: DVec4,
}

/// Four stretches in a row on each of which the density is linear in the length.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stretches<R: Real> {
    /// Densities where they begin and end.
    pub ends: [R::Lanes; 2],
    /// Pieces that the ends lie in, each after that in which the one before it lies.
    pub pieces: [u32; LANES + 1],
    /// Mean of `σ r`, `σ g`, `σ b` and `σ` over each.
    pub mean: [R::Lanes; LANES],
}

impl<R: Real> Stretches<R> {
    /// Of no density.
    pub const NONE: Self = Self { ends: [R::Lanes::ZERO; 2], pieces: [0; LANES + 1], mean: [R::Lanes::ZERO; LANES] };

    /// From where the last one ended to the densities given, one after the other.
    #[inline(always)]
    pub fn new(tables: &Cumulative<R>, curve: &Curve<R, 3>, last: &mut End<R>, to: R::Lanes) -> Self {
        let from = to.after(last.density.store()[LANES - 1]);
        let found = curve.find_all(to);
        let pieces = [last.piece, found[0], found[1], found[2], found[3]];
        let width = to - from;
        let inverse = (R::Lanes::splat(R::ONE) / width).store();
        let [p, q, r, s] = found.map(|p| &tables.pieces[p as usize]);
        let base = R::Lanes::load([p.base, q.base, r.base, s.base]);
        let middle = (from - base) + (to - base);
        let bend = R::Lanes::splat(R::of(0.75)) * middle * middle + R::Lanes::splat(R::of(0.25)) * width * width;
        let (middle, bend) = (middle.store(), bend.store());
        let (densities, apart) = (to.store(), width.abs().store());
        let sums = [p.sums(densities[0]), q.sums(densities[1]), r.sums(densities[2]), s.sums(densities[3])];
        let one = |i: usize| pieces[i] == pieces[i + 1] || apart[i] <= tables.same;
        let mean = R::Lanes::transpose([
            p.mean(one(0), middle[0], bend[0], last.sums, sums[0], inverse[0]),
            q.mean(one(1), middle[1], bend[1], sums[0], sums[1], inverse[1]),
            r.mean(one(2), middle[2], bend[2], sums[1], sums[2], inverse[2]),
            s.mean(one(3), middle[3], bend[3], sums[2], sums[3], inverse[3]),
        ]);
        *last = End { density: to, piece: found[3], sums: sums[3] };
        Self { ends: [from, to], pieces, mean }
    }

    /// Where the first one begins.
    #[inline(always)]
    pub fn begin(&self, tables: &Cumulative<R>) -> End<R> {
        let (density, piece) = (self.ends[0].store()[0], self.pieces[0]);
        End { density: R::Lanes::splat(density), piece, sums: tables.pieces[piece as usize].sums(density) }
    }

    /// Derivatives with respect to the densities where they begin and end, from those with respect to the means.
    #[inline(always)]
    pub fn slopes(&self, tables: &Cumulative<R>, by_mean: [R::Lanes; LANES]) -> [R::Lanes; 2] {
        let all = <R::Lanes as Lanes<R>>::splat;
        let [from, to] = self.ends;
        let width = to - from;
        let inverse = (all(R::ONE) / width).store();
        let (begin, end, width) = (from.store(), to.store(), width.store());
        let (means, by_mean) = (R::Lanes::transpose(self.mean), R::Lanes::transpose(by_mean));
        let of = |i: usize| {
            let [first, second] = [self.pieces[i], self.pieces[i + 1]].map(|p| &tables.pieces[p as usize]);
            let (two, three) = (all(R::of(2.0)), all(R::of(3.0)));
            if self.pieces[i] == self.pieces[i + 1] || width[i].greater(-width[i]) <= tables.same {
                let middle = (begin[i] - second.base) + (end[i] - second.base);
                let rise = second.b + all(R::of(1.5) * middle) * second.c;
                let bend = all(R::of(0.5) * width[i]) * second.c;
                return (by_mean[i] * (rise - bend), by_mean[i] * (rise + bend));
            }
            let at = |piece: &Piece<R>, density: R| {
                let u = all(density - piece.base);
                piece.a + u * (two * piece.b + u * (three * piece.c))
            };
            let by = by_mean[i] * all(inverse[i]);
            (by * (means[i] - at(first, begin[i])), by * (at(second, end[i]) - means[i]))
        };
        let four = [of(0), of(1), of(2), of(3)];
        let sums = |v: [R::Lanes; LANES]| {
            let [a, b, c, d] = R::Lanes::transpose(v);
            (a + b) + (c + d)
        };
        [sums(four.map(|s| s.0)), sums(four.map(|s| s.1))]
    }
}
