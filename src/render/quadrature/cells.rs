//! Cells that a ray crosses, four at a time.

use crate::real::{LANES, Lanes, Real};
use crate::render::cell;
use crate::render::cell::{Crossings, MOST, corners, low, offsets};
use crate::render::gauss;
use crate::render::march::{BATCH, Span};
use crate::render::segment::Chord;

/// Returns the crossings of a batch of spans.
#[inline(always)]
pub(super) fn crossings<R: Real>(spans: &[Span<R>]) -> [Crossings<R>; BATCH] {
    let mut at = [[R::ZERO; MOST + 1]; BATCH];
    for (spans, at) in spans.chunks(LANES).zip(at.as_chunks_mut().0) {
        let last = spans.len() - 1;
        cell::crossings([0, 1, 2, 3].map(|i| &spans[last.min(i)]), at);
    }
    at
}

/// A cell that a ray crosses.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cell<R: Real> {
    /// Offset of the cell's lowest corner among the field's values.
    offset: usize,
    /// World length from the ray's origin to the span's entry.
    begin: f64,
    /// Cell-local coordinates of the span's entry, the same in all lanes.
    entry: [R::Lanes; 3],
    /// Cell-local coordinates gained per world length.
    along: [R::Lanes; 3],
}

/// Visits the cells of at most [`BATCH`] spans of one ray, near to far, four at a time, with the world lengths from the
/// span's entry at which they are entered and left. Padding cells have no length.
#[inline(always)]
pub(crate) fn cells<R: Real>(spans: &[Span<R>], mut visit: impl FnMut([Cell<R>; LANES], R::Lanes, R::Lanes)) {
    let all = <R::Lanes as Lanes<R>>::splat;
    for (span, at) in spans.iter().zip(&crossings(spans)) {
        let ([x, y, z], [dx, dy, dz]) = (span.entry, span.direction);
        let along = [all(dx), all(dy), all(dz)];
        for at in at.windows(LANES + 1).step_by(LANES) {
            if at[0] >= span.length {
                break;
            }
            let from = R::Lanes::load([at[0], at[1], at[2], at[3]]);
            let until = R::Lanes::load([at[1], at[2], at[3], at[4]]);
            let middle = all(R::of(0.5)) * (from + until);
            let low =
                [low(all(x) + middle * along[0]), low(all(y) + middle * along[1]), low(all(z) + middle * along[2])];
            let offset = offsets(low);
            let [ex, ey, ez] = [(all(x) - low[0]).store(), (all(y) - low[1]).store(), (all(z) - low[2]).store()];
            let cell = |i: usize| Cell {
                offset: span.base + offset[i] as usize,
                begin: span.start,
                entry: [all(ex[i]), all(ey[i]), all(ez[i])],
                along,
            };
            visit([cell(0), cell(1), cell(2), cell(3)], from, until);
        }
    }
}

impl<R: Real> Cell<R> {
    /// Returns the world length from the ray's origin to a length from the span's entry.
    #[inline(always)]
    pub(crate) fn reached(&self, from: R) -> f64 {
        self.begin + from.f64()
    }

    /// Returns the offset of the lowest corner, and cell-local coordinates, of the points at two lengths from the
    /// span's entry.
    #[inline(always)]
    pub(crate) fn places(&self, [near, far]: [R; 2]) -> (usize, [[R; 3]; 2]) {
        let t = R::Lanes::load([near, far, R::ZERO, R::ZERO]);
        let [x, y, z] = [0, 1, 2].map(|a| (self.entry[a] + t * self.along[a]).store());
        (self.offset, [[x[0], y[0], z[0]], [x[1], y[1], z[1]]])
    }

    /// Returns the cell-local coordinates of the four points of [`gauss`] on a segment.
    #[inline(always)]
    fn at(&self, start: R, length: R) -> [R::Lanes; 3] {
        let all = <R::Lanes as Lanes<R>>::splat;
        let t = all(start) + all(length) * gauss::lanes::<R>(gauss::NODES);
        let ([x, y, z], [dx, dy, dz]) = (self.entry, self.along);
        [x + t * dx, y + t * dy, z + t * dz]
    }

    #[inline(always)]
    pub(super) fn chord(&self, values: &[R], start: R, length: R, piece: u32) -> Chord<R> {
        let at = self.at(start, length);
        let density = Chord::<R>::interpolate(&corners(values, self.offset), at);
        Chord { offset: self.offset, piece, length, start: R::of(self.reached(start)), at, density, jumps: [false; 2] }
    }
}
