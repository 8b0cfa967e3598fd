//! Stretches of a ray within one cell, on which a source that varies is integrated.

use crate::lanes::{LANES, Lanes};
use crate::real::Real;

/// A stretch with one density for all of it.
#[derive(Debug, Clone, Copy)]
pub struct Sample<R: Real> {
    /// Offset of the cell's lowest corner among the field's values.
    pub offset: usize,
    /// World length.
    pub length: R,
    /// Interpolation weights of the corners, by x.
    pub weights: [R::Lanes; 2],
    /// The density.
    pub density: R,
}

/// A stretch with the densities at the four points of [`crate::render::gauss`], which determine the
/// cubic that the interpolated density is.
#[derive(Debug, Clone, Copy)]
pub struct Chord<R: Real> {
    /// Offset of the cell's lowest corner among the field's values.
    pub offset: usize,
    /// World length.
    pub length: R,
    /// Cell-local coordinates of the points.
    pub at: [R::Lanes; 3],
    /// Densities there.
    pub density: R::Lanes,
}

impl<R: Real> Chord<R> {
    /// Interpolates a cell's corners (by x, as [`crate::render::cell::corners`] gives them) at four points.
    #[inline(always)]
    pub fn interpolate(corners: &[R::Lanes; 2], [x, y, z]: [R::Lanes; 3]) -> R::Lanes {
        let all = <R::Lanes as Lanes<R>>::splat;
        let face = |corners: R::Lanes| {
            let [a, b, c, d] = corners.store();
            let (low, high) = (all(a) + z * all(b - a), all(c) + z * all(d - c));
            low + y * (high - low)
        };
        let (low, high) = (face(corners[0]), face(corners[1]));
        low + x * (high - low)
    }

    /// Derivatives with respect to the corners, by x, from those with respect to the densities: the
    /// transpose of [`Chord::interpolate`].
    #[inline(always)]
    pub fn spread(&self, by_density: R::Lanes) -> [R::Lanes; 2] {
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
