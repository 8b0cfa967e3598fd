//! Results of front-to-back blending.

use super::shade::SegmentOptics;
use crate::real::Real;

/// Sums of front-to-back blending along a ray.
#[derive(Debug, Clone, Copy)]
pub(super) struct Blend<const C: usize> {
    /// Emitted radiance `∫ T σ c dt` by the curve's channels; without channels where only the depth is computed.
    pub emitted: [f64; C],
    /// Optical depth.
    pub depth: f64,
    /// World length from the ray's origin at which the last batch of bricks begins.
    pub last: f64,
}

/// A segment with its optics, and the transmittance before it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry<R: Real, S> {
    pub segment: S,
    pub light: SegmentOptics<R>,
    pub open: f64,
}
