//! Cells of a brick that a ray crosses: the points of crossing, and the interpolation weights of the cells' corners,
//! with which values are gathered and gradients scattered.
//!
//! Corner `(x, y, z)` of a cell is `values[offset + slot(x, y, z)]`. Weights and corner values are grouped by x, with
//! corner `(x, y, z)` in lane `2 y + z`.

use crate::real::{LANES, Lanes};
use crate::real::{Number, Real};
use crate::render::march::Span;
use crate::scene::bricks::slot;

/// Four cells with the weights of their corners in the integral over the ray's length in them: all that an optical
/// depth needs. Unused entries of the four have weights of zero.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Quartet<R: Real> {
    /// Offsets of the cells' lowest corners among the field's values.
    pub offset: [u32; LANES],
    /// Corner weights times the ray's length in the cell, in world units, by cell and x of the corner.
    pub weights: [[R::Lanes; 2]; LANES],
}

impl<R: Real> Quartet<R> {
    /// Returns `Σ w v` over all cells as one partial sum per lane.
    #[inline(always)]
    pub(crate) fn gather(&self, values: &[R]) -> R::Lanes {
        let cell = |i: usize| {
            let (v, w) = (corners(values, self.offset[i] as usize), &self.weights[i]);
            w[0] * v[0] + w[1] * v[1]
        };
        (cell(0) + cell(1)) + (cell(2) + cell(3))
    }

    /// Returns the ray's length in one of the cells, in world units, and the integral of the density over it.
    #[inline(always)]
    pub(crate) fn cell(&self, i: usize, values: &[R]) -> [f64; 2] {
        let (v, w) = (corners(values, self.offset[i] as usize), &self.weights[i]);
        // Interpolation weights sum to 1.
        [(w[0] + w[1]).sum().f64(), (w[0] * v[0] + w[1] * v[1]).sum().f64()]
    }

    /// Returns the ray's length in all cells, in world units.
    #[inline(always)]
    pub(crate) fn length(&self) -> f64 {
        // Interpolation weights sum to 1.
        self.weights.iter().map(|w| (w[0] + w[1]).sum().f64()).sum()
    }

    /// Adds `g w` to `values`: the transpose of [`Quartet::gather`].
    #[inline(always)]
    pub(crate) fn scatter(&self, values: &mut [R], g: R) {
        for (offset, w) in self.offset.iter().zip(&self.weights) {
            scatter(values, *offset as usize, g, w);
        }
    }
}

/// Offsets of a cell's corners in the order of their weights, for x = 0 and x = 1.
pub(super) const CORNERS: [[usize; LANES]; 2] = [
    [slot(0, 0, 0), slot(0, 0, 1), slot(0, 1, 0), slot(0, 1, 1)],
    [slot(1, 0, 0), slot(1, 0, 1), slot(1, 1, 0), slot(1, 1, 1)],
];
/// Number of values from a cell's lowest corner to its highest, both included.
pub(super) const REACH: usize = slot(1, 1, 1) + 1;

/// Returns the values at a cell's corners, in the order of their weights.
#[inline(always)]
pub(crate) fn corners<R: Real>(values: &[R], offset: usize) -> [R::Lanes; 2] {
    let v = &values[offset..offset + REACH];
    let load = |[a, b, c, d]: [usize; LANES]| R::Lanes::load([v[a], v[b], v[c], v[d]]);
    [load(CORNERS[0]), load(CORNERS[1])]
}

/// Returns `Σ w v`, the interpolated value.
#[inline(always)]
pub(crate) fn gather<R: Real>(w: &[R::Lanes; 2], v: &[R::Lanes; 2]) -> R {
    (w[0] * v[0] + w[1] * v[1]).sum()
}

/// Adds `g w` to `values`: the transpose of [`gather`].
#[inline(always)]
pub(crate) fn scatter<R: Real>(values: &mut [R], offset: usize, g: R, w: &[R::Lanes; 2]) {
    let v = &mut values[offset..offset + REACH];
    // All are loaded before any is stored: compilers make two loads and two stores of each four.
    for ([a, b, c, d], w) in CORNERS.into_iter().zip(w) {
        let sum = R::Lanes::load([v[a], v[b], v[c], v[d]]) + R::Lanes::splat(g) * *w;
        [v[a], v[b], v[c], v[d]] = sum.store();
    }
}

/// Returns the interpolated values at four points, from the offsets of their cells' lowest corners and their cell-local
/// coordinates.
#[inline(always)]
pub(crate) fn interpolated<R: Real>(values: &[R], offset: [u32; LANES], [x, y, z]: [R::Lanes; 3]) -> R::Lanes {
    let along = x.store();
    let column = |i: usize| {
        let [near, far] = corners(values, offset[i] as usize);
        near + R::Lanes::splat(along[i]) * (far - near)
    };
    let [a, b, c, d] = R::Lanes::transpose([column(0), column(1), column(2), column(3)]);
    let (low, high) = (a + z * (b - a), c + z * (d - c));
    low + y * (high - low)
}

/// Returns the trilinear weights at cell-local coordinates `m`, each from 0 to 1.
#[inline(always)]
pub(crate) fn weights<R: Real>(m: [R; 3]) -> [R::Lanes; 2] {
    let n = [R::ONE - m[0], R::ONE - m[1], R::ONE - m[2]];
    let yz = R::Lanes::load([n[1] * n[2], n[1] * m[2], m[1] * n[2], m[1] * m[2]]);
    let far = yz * R::Lanes::splat(m[0]);
    [yz - far, far]
}

/// Mean of the trilinear weights at `m ± h`, without evaluating both, times a length: for `h` = half
/// the chord / √3 this is the two-point Gauss rule, exact for the cubic that the field is along the chord.
#[inline(always)]
pub(super) fn chord_weights<N: Number>(m: [N; 3], h: [N; 3], length: N) -> ([N; 4], [N; 4]) {
    let n = [N::one() - m[0], N::one() - m[1], N::one() - m[2]];
    let (my, ny) = (length * m[1], length * n[1]);
    let (hx, hy) = (length * h[0], length * h[1]);
    let (hxy, hxz, hyz) = (hx * h[1], hx * h[2], hy * h[2]);
    let yz = [ny * n[2] + hyz, ny * m[2] - hyz, my * n[2] - hyz, my * m[2] + hyz];
    let cross = [-(n[1] * hxz + n[2] * hxy), n[1] * hxz - m[2] * hxy, n[2] * hxy - m[1] * hxz, m[1] * hxz + m[2] * hxy];
    let far = [yz[0] * m[0] + cross[0], yz[1] * m[0] + cross[1], yz[2] * m[0] + cross[2], yz[3] * m[0] + cross[3]];
    ([yz[0] - far[0], yz[1] - far[1], yz[2] - far[2], yz[3] - far[3]], far)
}

/// The largest number of cells in a span, rounded up: eight planes along each axis, and three at the entry.
pub(super) const MOST: usize = 28;
/// Lengths from a span's entry to where it crosses the faces of its cells: ascending from zero to the
/// span's length, which is repeated until one past a multiple of four; nothing is meant by the rest.
pub(super) type Crossings<R> = [R; MOST + 1];

/// Crossings of four spans of one ray in lockstep. (One by one, each would wait for its own chain of
/// comparisons, and its end could not be foreseen.)
#[inline(always)]
pub(super) fn crossings<R: Real>(spans: [&Span<R>; LANES], at: &mut [Crossings<R>; LANES]) {
    let [a, b, c, d] = spans;
    let all = <R::Lanes as Lanes<R>>::splat;
    // Along each axis: the length to the next plane, and from plane to plane.
    let axis = |k: usize| {
        let (up, inverse) = (a.direction[k] > R::ZERO, a.inverse[k]);
        if !inverse.f64().is_finite() {
            return (all(R::of(f64::MAX)), all(R::ZERO));
        }
        let entry = R::Lanes::load([a.entry[k], b.entry[k], c.entry[k], d.entry[k]]);
        let plane = if up { low(entry) + all(R::ONE) } else { low(entry) };
        ((plane - entry) * all(inverse), all(if up { inverse } else { -inverse }))
    };
    let [(mut x, dx), (mut y, dy), (mut z, dz)] = [axis(0), axis(1), axis(2)];
    let length = R::Lanes::load([a.length, b.length, c.length, d.length]);
    let mut advance = || {
        let nearest = x.lesser(y).lesser(z);
        (x, y, z) = (x.advanced(nearest, dx), y.advanced(nearest, dy), z.advanced(nearest, dz));
        nearest.lesser(length)
    };
    let mut first = all(R::ZERO);
    for k in (0..MOST).step_by(LANES) {
        let second = advance();
        let third = advance();
        let fourth = advance();
        let rows = R::Lanes::transpose([first, second, third, fourth]);
        for (at, row) in at.iter_mut().zip(rows) {
            at[k..k + LANES].copy_from_slice(&row.store());
        }
        first = advance();
        if first.reach(length) || k == MOST - LANES {
            for (at, length) in at.iter_mut().zip(length.store()) {
                at[k + LANES] = length;
            }
            return;
        }
    }
}

/// Lowest corners, along one axis, of the cells of a brick that hold these coordinates. On a face it
/// may be either cell; what rounds past the brick's faces stays in the outermost cells.
#[inline(always)]
pub(super) fn low<R: Real, L: Lanes<R>>(coordinate: L) -> L {
    // Adding rounds to the nearest whole number: down, half a cell lower.
    let ones = L::splat(R::ONES);
    (coordinate.clamped(R::ZERO, R::of(7.75)) - L::splat(R::of(0.5)) + ones) - ones
}

/// Offsets in a brick of the cells with these lowest corners.
#[inline(always)]
pub(super) fn offsets<R: Real, L: Lanes<R>>(low: [L; 3]) -> [u32; LANES] {
    let all = |v: usize| L::splat(R::int(v as i32));
    let sum = low[0] * all(slot(1, 0, 0)) + low[1] * all(slot(0, 1, 0)) + low[2];
    let [a, b, c, d] = (sum + L::splat(R::ONES)).store();
    [a.low_bits(), b.low_bits(), c.low_bits(), d.low_bits()]
}

/// Offset in a brick of the cell that holds a point, and the point's coordinates in the cell: [`low`] and [`offsets`]
/// for loops over plain arrays.
#[inline(always)]
pub(super) fn placed<R: Real>(at: [R; 3]) -> (u32, [R; 3]) {
    let low = |v: R| (v.greater(R::ZERO).lesser(R::of(7.75)) - R::of(0.5) + R::ONES) - R::ONES;
    let all = |v: usize| R::int(v as i32);
    let [x, y, z] = [low(at[0]), low(at[1]), low(at[2])];
    let offset = x * all(slot(1, 0, 0)) + y * all(slot(0, 1, 0)) + z;
    ((offset + R::ONES).low_bits(), [at[0] - x, at[1] - y, at[2] - z])
}
