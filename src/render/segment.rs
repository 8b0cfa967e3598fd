//! Segments of a ray within one cell, on which a source that varies is integrated.

use crate::real::{LANES, Lanes};
use crate::real::{Number, Real};
use crate::render::cell::{corners, weights};
use crate::render::gauss;
use glam::DVec3;

/// An end of a segment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum End {
    /// The end nearer to the eye.
    Near,
    /// The end farther from the eye.
    Far,
}

/// A point of a ray.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place<R> {
    /// Offset of the cell's lowest corner among the field's values.
    pub offset: usize,
    /// Cell-local coordinates.
    pub at: [R; 3],
    /// World length from the ray's origin.
    pub position: f64,
}

impl<R: Real> Place<R> {
    /// Returns the weights of the cell's corners, by x.
    pub(crate) fn weights(&self) -> [R::Lanes; 2] {
        weights(self.at)
    }

    /// Returns the gradient of the interpolated value with respect to index coordinates.
    pub(crate) fn slopes(&self, values: &[R]) -> DVec3 {
        DVec3::from_array(slopes(corners(values, self.offset).map(Lanes::store), self.at).map(Real::f64))
    }
}

/// A segment with one density for its whole length.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample<R: Real> {
    /// Offset of the cell's lowest corner among the field's values.
    pub offset: usize,
    /// Number of the curve's piece that the density lies in.
    pub piece: u32,
    /// World length of the segment.
    pub length: R,
    /// Cell-local coordinates of the sample.
    pub at: [R; 3],
    /// Density at the sample.
    pub density: R,
    /// Number of the step.
    pub number: u64,
    /// World length from the ray's origin to the sample.
    pub position: f64,
}

/// A segment with the densities at the four points of [`crate::render::gauss`], which determine the cubic that the
/// interpolated density is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Chord<R: Real> {
    /// Offset of the cell's lowest corner among the field's values.
    pub offset: usize,
    /// Number of the curve's piece that the densities lie in.
    pub piece: u32,
    /// World length of the segment.
    pub length: R,
    /// World length from the ray's origin to the near end.
    pub start: R,
    /// Cell-local coordinates of the points.
    pub at: [R::Lanes; 3],
    /// Densities at the points.
    pub density: R::Lanes,
    /// True where the curve jumps: at the near end, at the far end.
    pub jumps: [bool; 2],
}

impl<R: Real> Chord<R> {
    /// Returns the position of one of the segment's ends.
    pub(crate) fn end(&self, end: End) -> Place<R> {
        let [first, .., last] = gauss::NODES;
        let share = if end == End::Far { 1.0 } else { 0.0 };
        let by = R::of((share - first) / (last - first));
        let at = self.at.map(|along| {
            let [from, .., to] = along.store();
            from + by * (to - from)
        });
        Place { offset: self.offset, at, position: self.start.f64() + share * self.length.f64() }
    }

    /// Interpolates a cell's corners (by x, as [`crate::render::cell::corners`] gives them) at four points.
    #[inline(always)]
    pub(crate) fn interpolate(corners: &[R::Lanes; 2], [x, y, z]: [R::Lanes; 3]) -> R::Lanes {
        let all = <R::Lanes as Lanes<R>>::splat;
        let face = |corners: R::Lanes| {
            let [a, b, c, d] = corners.store();
            let (low, high) = (all(a) + z * all(b - a), all(c) + z * all(d - c));
            low + y * (high - low)
        };
        let (low, high) = (face(corners[0]), face(corners[1]));
        low + x * (high - low)
    }

    /// Returns the derivatives with respect to the corners, by x, from those with respect to the densities: the
    /// transpose of [`Chord::interpolate`].
    #[inline(always)]
    pub(crate) fn voxel_vjp(&self, by_density: R::Lanes) -> [R::Lanes; 2] {
        let [x, y, z] = self.at;
        let face = |g: R::Lanes| {
            let high = g * y;
            let low = g - high;
            let (b, d) = (low * z, high * z);
            let columns: [R::Lanes; LANES] = [low - b, b, high - d, d];
            let [i, j, k, l] = R::Lanes::transpose(columns);
            (i + k) + (j + l)
        };
        let high = by_density * x;
        [face(by_density - high), face(high)]
    }
}

/// Returns the gradient of the interpolated value with respect to the cell-local coordinates, from the values at the
/// corners (by x, with corner `(x, y, z)` at `2 y + z`).
#[inline(always)]
pub(crate) fn slopes<N: Number>(corners: [[N; LANES]; 2], [x, y, z]: [N; 3]) -> [N; 3] {
    // On a face of constant x: value, and its derivatives by y and by z.
    let face = |[a, b, c, d]: [N; LANES]| {
        let (low, high) = (a + z * (b - a), c + z * (d - c));
        (low + y * (high - low), high - low, (b - a) + y * ((d - c) - (b - a)))
    };
    let ((low, low_y, low_z), (high, high_y, high_z)) = (face(corners[0]), face(corners[1]));
    [high - low, low_y + x * (high_y - low_y), low_z + x * (high_z - low_z)]
}
