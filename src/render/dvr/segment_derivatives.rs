//! Derivatives of segments with respect to voxels and to the positions of the ray's points, from those with respect to
//! densities.

use super::shade::Shade;
use crate::real::Real;
use crate::real::{LANES, Lanes};
use crate::render::cell::{corners, gather, weights};
use crate::render::gauss;
use crate::render::segment::{Chord, End, Place, Sample, slopes};
use glam::DVec3;

/// A segment with its position in a cell.
pub(super) trait SegmentDerivatives<R: Real>: Shade<R> {
    /// Returns the offset of the segment's cell among the field's values.
    fn offset(&self) -> usize;
    /// Returns the world length of the segment.
    fn length(&self) -> R;
    /// Returns the derivatives with respect to the corners of the segment's cell, from those with respect to densities.
    fn voxel_vjp(&self, by_density: R::Lanes) -> [R::Lanes; 2];
    /// Returns the derivatives with respect to the points' index coordinates: their sum, and the sum weighted by the
    /// points' world lengths from the origin.
    fn ray_vjp(&self, values: &[R], by_density: R::Lanes) -> (DVec3, DVec3);
    /// Returns the change of the densities for a change of the stored values: the transpose of
    /// [`SegmentDerivatives::voxel_vjp`].
    fn voxel_jvp(&self, by_value: &[R]) -> R::Lanes;
    /// Returns the derivatives of the densities with respect to the points' index coordinates, and the points' world
    /// lengths from the origin: [`SegmentDerivatives::ray_vjp`] is the transpose.
    fn ray_jvp(&self, values: &[R]) -> ([R::Lanes; 3], R::Lanes);
    /// Returns an end of the segment, if the transfer function jumps there and the segment ends because of it.
    fn jump(&self, end: End) -> Option<Place<R>>;
}

impl<R: Real> SegmentDerivatives<R> for Sample<R> {
    #[inline(always)]
    fn offset(&self) -> usize {
        self.offset
    }

    #[inline(always)]
    fn length(&self) -> R {
        self.length
    }

    #[inline(always)]
    fn voxel_vjp(&self, by_density: R::Lanes) -> [R::Lanes; 2] {
        let g = R::Lanes::splat(by_density.store()[0]);
        weights(self.at).map(|w| g * w)
    }

    #[inline(always)]
    fn ray_vjp(&self, values: &[R], by_density: R::Lanes) -> (DVec3, DVec3) {
        let g = by_density.store()[0].f64();
        let slopes = slopes(everywhere::<R>(values, self.offset), self.at.map(R::Lanes::splat));
        let shift = g * DVec3::from_array(slopes.map(|s| s.store()[0].f64()));
        (shift, self.position * shift)
    }

    #[inline(always)]
    fn voxel_jvp(&self, by_value: &[R]) -> R::Lanes {
        R::Lanes::splat(gather(&weights(self.at), &corners(by_value, self.offset)))
    }

    #[inline(always)]
    fn ray_jvp(&self, values: &[R]) -> ([R::Lanes; 3], R::Lanes) {
        let slopes = slopes(everywhere::<R>(values, self.offset), self.at.map(R::Lanes::splat));
        (slopes, R::Lanes::splat(R::of(self.position)))
    }

    #[inline(always)]
    fn jump(&self, _: End) -> Option<Place<R>> {
        None
    }
}

impl<R: Real> SegmentDerivatives<R> for Chord<R> {
    #[inline(always)]
    fn offset(&self) -> usize {
        self.offset
    }

    #[inline(always)]
    fn length(&self) -> R {
        self.length
    }

    #[inline(always)]
    fn voxel_vjp(&self, by_density: R::Lanes) -> [R::Lanes; 2] {
        Self::voxel_vjp(self, by_density)
    }

    #[inline(always)]
    fn ray_vjp(&self, values: &[R], by_density: R::Lanes) -> (DVec3, DVec3) {
        let all = <R::Lanes as Lanes<R>>::splat;
        let t = all(self.start) + all(self.length) * gauss::lanes::<R>(gauss::NODES);
        let slopes = slopes(everywhere::<R>(values, self.offset), self.at);
        let by = |g: R::Lanes| DVec3::from_array(slopes.map(|s| (s * g).sum().f64()));
        (by(by_density), by(by_density * t))
    }

    #[inline(always)]
    fn voxel_jvp(&self, by_value: &[R]) -> R::Lanes {
        Self::interpolate(&corners(by_value, self.offset), self.at)
    }

    #[inline(always)]
    fn ray_jvp(&self, values: &[R]) -> ([R::Lanes; 3], R::Lanes) {
        let all = <R::Lanes as Lanes<R>>::splat;
        let t = all(self.start) + all(self.length) * gauss::lanes::<R>(gauss::NODES);
        (slopes(everywhere::<R>(values, self.offset), self.at), t)
    }

    #[inline(always)]
    fn jump(&self, end: End) -> Option<Place<R>> {
        self.jumps[usize::from(end == End::Far)].then(|| self.end(end))
    }
}

/// Returns the values at a cell's corners, each repeated for four points.
#[inline(always)]
fn everywhere<R: Real>(values: &[R], offset: usize) -> [[R::Lanes; LANES]; 2] {
    corners(values, offset).map(|four| four.store().map(R::Lanes::splat))
}
