//! Segments of a ray in one cell each, with two Gauss points.

use crate::real::Real;
use crate::real::{LANES, Lanes};
use crate::render::cell::{CORNERS, REACH, weights};
use crate::render::quadrature::cells::Cell;
use crate::render::segment::slopes;

/// Quadrature points on 0..1.
pub(super) const POINTS: [f64; 2] = [0.211_324_865_405_187_1, 0.788_675_134_594_812_9];
/// Row k: weights of the extinctions at the points in the optical depth up to point k.
pub(super) const UP_TO: [[f64; 2]; 2] = [[0.25, -0.038_675_134_594_812_88], [0.538_675_134_594_812_9, 0.25]];

/// A segment with its quadrature points: a cell, or one of the parts that it is cut into.
#[derive(Debug, Clone, Copy)]
pub(super) struct Segment<R: Real> {
    /// Offset of the cell's lowest corner.
    pub offset: usize,
    /// World lengths from the ray's origin to where the cell is entered and left.
    pub faces: [f64; 2],
    /// Begin and end of the segment between the cell's faces, from 0 to 1.
    pub ends: [f64; 2],
    /// Cell-local coordinates of the points.
    at: [[R; 3]; 2],
    /// Interpolation weights of the corners at the points.
    pub weights: [[R::Lanes; 2]; 2],
    /// Emission in R, G and B, and extinction, at the points.
    pub values: [R::Lanes; 2],
    /// Half the segment's world length: the quadrature weight of each point.
    pub half: R,
    /// Transmittance from the eye to the points.
    pub transmittances: [R; 2],
}

/// Weights of the emissions at a cell's corners in the picture, which is linear in them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Footprint<R: Real> {
    pub offset: usize,
    pub weights: [R::Lanes; 2],
}

/// Adds `weights · by` to `gradient`.
#[inline(always)]
pub(super) fn scatter<R: Real>(gradient: &mut [R::Lanes], offset: usize, weights: &[R::Lanes; 2], by: R::Lanes) {
    let v = &mut gradient[offset..offset + REACH];
    for (corners, w) in CORNERS.iter().zip(weights) {
        for (corner, w) in corners.iter().zip(w.store()) {
            v[*corner] += R::Lanes::splat(w) * by;
        }
    }
}

/// Returns the values at the two points.
#[inline(always)]
fn interpolated<R: Real>(values: &[R::Lanes], offset: usize, weights: &[[R::Lanes; 2]; 2]) -> [R::Lanes; 2] {
    let v = &values[offset..offset + REACH];
    let mut own = [R::Lanes::default(); 2];
    for (x, corners) in CORNERS.iter().enumerate() {
        let (near, far) = (weights[0][x].store(), weights[1][x].store());
        for (k, corner) in corners.iter().enumerate() {
            let value = v[*corner];
            own = [own[0] + R::Lanes::splat(near[k]) * value, own[1] + R::Lanes::splat(far[k]) * value];
        }
    }
    own
}

impl<R: Real> Segment<R> {
    #[inline(always)]
    pub(crate) fn new(values: &[R::Lanes], cell: &Cell<R>, from: R, length: R) -> Self {
        let (offset, at) = cell.places(POINTS.map(|u| from + R::of(u) * length));
        let w = at.map(weights);
        let own = interpolated::<R>(values, offset, &w);
        let faces = [cell.reached(from), cell.reached(from + length)];
        let half = R::of(0.5) * length;
        Self { offset, faces, ends: [0.0, 1.0], at, weights: w, values: own, half, transmittances: [R::ZERO; 2] }
    }

    /// Creates one of `count` parts of a cell.
    #[inline(always)]
    pub(crate) fn part(values: &[R::Lanes], cell: &Cell<R>, from: R, length: R, number: i32, count: i32) -> Self {
        let part = length / R::int(count);
        let faces = [cell.reached(from), cell.reached(from + length)];
        let ends = [number, number + 1].map(|k| f64::from(k) / f64::from(count));
        Self { faces, ends, ..Self::new(values, cell, from + R::int(number) * part, part) }
    }

    #[inline(always)]
    fn extinctions(&self) -> [R; 2] {
        self.values.map(|v| v.store()[3])
    }

    #[inline(always)]
    pub(crate) fn depth(&self) -> R {
        let [first, second] = self.extinctions();
        self.half * (first + second)
    }

    /// Returns the optical depths from the segment's near end to the points.
    #[inline(always)]
    pub(crate) fn depths(&self) -> [R; 2] {
        let length = self.half + self.half;
        let s = self.extinctions();
        UP_TO.map(|w| length * (R::of(w[0]) * s[0] + R::of(w[1]) * s[1]))
    }

    /// Returns the weights of the emissions at the points: transmittance from the eye times half the world length.
    #[inline(always)]
    pub(crate) fn shares(&self) -> [R; 2] {
        self.transmittances.map(|transmittance| transmittance * self.half)
    }

    /// Interpolates another field of the same topology at the points.
    #[inline(always)]
    pub(crate) fn interpolated(&self, values: &[R::Lanes]) -> [R::Lanes; 2] {
        interpolated::<R>(values, self.offset, &self.weights)
    }

    /// Computes the transmittance from the eye to the points, and returns that to the near end, from that to the far
    /// end: the inverse of the forward walk (Weiss & Westermann 2021, sect. 4.3). Where the segment is opaque it is
    /// 0/0.
    #[inline(always)]
    pub(crate) fn invert(&mut self, after: R) -> R {
        let before = after / (-self.depth()).exp();
        self.transmittances = self.depths().map(|depth| before * (-depth).exp());
        before
    }

    #[inline(always)]
    pub(crate) fn footprint(&self) -> Footprint<R> {
        let shares = self.shares().map(R::Lanes::splat);
        let corner = |x: usize| shares[0] * self.weights[0][x] + shares[1] * self.weights[1][x];
        Footprint { offset: self.offset, weights: [corner(0), corner(1)] }
    }

    /// Returns the light per world length at the points, as it arrives at the eye, with colors weighted by `by`.
    #[inline(always)]
    pub(crate) fn emitted(&self, by: R::Lanes) -> [f64; 2] {
        [0, 1].map(|k| self.transmittances[k].f64() * (by * self.values[k]).sum().f64())
    }

    /// Returns the derivative with respect to the extinction at a point, from those with respect to the optical depths
    /// up to both points and up to the end.
    #[inline(always)]
    pub(crate) fn by_extinction(&self, point: usize, by_depths: [f64; 2], by_depth: f64) -> f64 {
        let up_to = UP_TO[0][point] * by_depths[0] + UP_TO[1][point] * by_depths[1];
        self.half.f64() * (by_depth + 2.0 * up_to)
    }

    /// Returns the world length from the ray's origin to a point.
    #[inline(always)]
    pub(crate) fn position(&self, point: usize) -> f64 {
        let [enter, leave] = self.faces;
        let [begin, end] = self.ends;
        enter + (leave - enter) * (begin + (end - begin) * POINTS[point])
    }

    /// Returns the derivatives of the values at a point with respect to its index coordinates.
    #[inline(always)]
    pub(crate) fn slopes(&self, values: &[R::Lanes], point: usize) -> [R::Lanes; 3] {
        let v = &values[self.offset..self.offset + REACH];
        let corners: [[R::Lanes; LANES]; 2] = CORNERS.map(|corners| corners.map(|corner| v[corner]));
        slopes(corners, self.at[point].map(R::Lanes::splat))
    }

    /// Returns the derivatives with respect to the world lengths at which the cell is entered and left, from the light
    /// `emitted` per world length, the derivatives with respect to the optical depths up to the points and up to the
    /// end, and those with respect to the points' world lengths from the origin.
    #[inline(always)]
    pub(crate) fn by_faces(
        &self,
        emitted: [f64; 2],
        by_depths: [f64; 2],
        by_depth: f64,
        by_positions: [f64; 2],
    ) -> [f64; 2] {
        let s = self.extinctions().map(R::f64);
        let mut by_end = 0.5 * (s[0] + s[1]) * by_depth;
        for k in 0..2 {
            let depth = UP_TO[k][0] * s[0] + UP_TO[k][1] * s[1];
            by_end += 0.5 * emitted[k] + depth * by_depths[k] + POINTS[k] * by_positions[k];
        }
        let by_begin = by_positions[0] + by_positions[1] - by_end;
        let by_leave = self.ends[0] * by_begin + self.ends[1] * by_end;
        [by_begin + by_end - by_leave, by_leave]
    }
}
