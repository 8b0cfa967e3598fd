//! Cumulative tables of a transfer function.
//!
//! With extinction and color linear between two knots, the integrands over the density, `σ r`, `σ g`, `σ b` and `σ`,
//! are quadratic there, and their integrals F cubic. Sums are `f64`, because differences of them over a small range of
//! densities are needed.

use super::variation::Variation;
use crate::real::Lanes;
use crate::real::Real;
use crate::render::curve::Curve;
use crate::scene::table::Table;

/// One piece of a curve, in lanes for red, green, blue and extinction, at a density `base + u`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Piece<R: Real> {
    /// Colors and extinction at the base; they are `value + slope u`.
    value: R::Lanes,
    pub slope: R::Lanes,
    /// `σ r`, `σ g`, `σ b` and `σ`: `a + 2 b u + 3 c u²`.
    a: R::Lanes,
    b: R::Lanes,
    c: R::Lanes,
    /// Integrals F at the base.
    below: [f64; 4],
    base: R,
}

/// Cumulative sums F, by the pieces of a curve.
#[derive(Debug, Clone)]
pub(super) struct Cumulative<R: Real> {
    pieces: Vec<Piece<R>>,
    /// Range that densities are clamped to; its ends are far outside the knots.
    outmost: [R; 2],
    /// Difference of densities up to which they are treated as equal.
    pub same: R,
    /// Begin of every ray, at the background.
    pub outside: End<R>,
    /// Total variation of the function, which bounds the error of nodes too far apart.
    pub variation: Variation<R>,
    /// Error that is allowed along a ray, in units of the brightest color.
    pub tolerance: f64,
    /// Reciprocal of the brightest color; 0 if all colors are the same.
    pub per_brightest: R,
}

/// Distance beyond its knots up to which a table is evaluated, in units of their range or magnitude, whichever is
/// larger.
const BEYOND: f64 = 1e6;

impl<R: Real> Cumulative<R> {
    /// Creates the sums of a table whose extinctions are multiplied by `scale`, for a field of this range of densities
    /// and this background; `tolerance` is the error allowed along a ray, in units of the brightest color.
    pub(crate) fn new(
        (table, scale): (&Table, f64),
        tolerance: f64,
        curve: &Curve<R, 3>,
        range: [f64; 2],
        background: R,
    ) -> Self {
        let knots = table.knots();
        let (first, last) = (knots[0], knots[knots.len() - 1]);
        let rounded = |v: f64| R::of(v).f64();
        let mut below = [0.0; 4];
        let pieces = (0..=knots.len()).map(|p| {
            let ([low, high], [value, _]) = table.ends(p);
            // Knots are where the curve has them, and so are the values: shifted along a steep slope they would be
            // negative.
            let slope = table.slope_between(p, rounded);
            let base = rounded(if p == 0 { high } else { low });
            let (s, t) = (scale * value[3], scale * slope[3]);
            let emitted = |c: usize| [s * value[c], 0.5 * (s * slope[c] + t * value[c]), t * slope[c] * (1.0 / 3.0)];
            let lines = [emitted(0), emitted(1), emitted(2), [s, 0.5 * t, 0.0]];
            let lanes = |k: usize| R::Lanes::load(lines.map(|line| R::of(line[k])));
            let four = |v: [f64; 4]| R::Lanes::load(v.map(R::of));
            let piece = Piece {
                value: four([value[0], value[1], value[2], s]),
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
        // Of one color, all are mixed.
        let colorful = table.values().iter().any(|v| v[..3] != table.values()[0][..3]);
        let variation = Variation::new(table, scale, brightest.max(f64::from(f32::MIN_POSITIVE)), range);
        let scale = (last - first).max(first.abs()).max(last.abs());
        let pieces: Vec<Piece<R>> = pieces.collect();
        Self {
            outside: End::new(&pieces, curve.find(background), background),
            pieces,
            outmost: [R::of(first - BEYOND * scale), R::of(last + BEYOND * scale)],
            same: R::of(1e-6 * scale),
            variation,
            tolerance,
            per_brightest: R::of(if colorful { 1.0 / brightest.max(f64::from(f32::MIN_POSITIVE)) } else { 0.0 }),
        }
    }

    /// Returns a piece by its number.
    #[inline(always)]
    pub(crate) fn piece(&self, number: u32) -> &Piece<R> {
        &self.pieces[number as usize]
    }

    /// Clamps densities to the range of the tables.
    #[inline(always)]
    pub(crate) fn within(&self, density: R::Lanes) -> R::Lanes {
        density.clamped(self.outmost[0], self.outmost[1])
    }
}

impl<R: Real> Piece<R> {
    /// Returns the cumulative sums F at a density: `σ r`, `σ g`, `σ b` and `σ`.
    #[inline(always)]
    pub(crate) fn sums(&self, density: R) -> [f64; 4] {
        let u = density.f64() - self.base.f64();
        let (a, b, c) = (self.a.store(), self.b.store(), self.c.store());
        let of = |i: usize| self.below[i] + u * (a[i].f64() + u * (b[i].f64() + u * c[i].f64()));
        [of(0), of(1), of(2), of(3)]
    }

    /// Returns colors and extinction at a density.
    #[inline(always)]
    pub(crate) fn values(&self, density: R) -> R::Lanes {
        self.value + R::Lanes::splat(density - self.base) * self.slope
    }
}

/// The end of a segment.
#[derive(Debug, Clone, Copy)]
pub(super) struct End<R: Real> {
    pub density: R,
    pub piece: u32,
    /// Cumulative sums F.
    pub sums: [f64; 4],
    /// Colors and extinction.
    pub values: R::Lanes,
}

impl<R: Real> End<R> {
    fn new(pieces: &[Piece<R>], piece: u32, density: R) -> Self {
        let p = &pieces[piece as usize];
        Self { density, piece, sums: p.sums(density), values: p.values(density) }
    }
}
