//! Results of front-to-back blending.

use super::shade::SegmentOptics;
use crate::real::Real;

/// What is found along a ray.
#[derive(Debug, Clone, Copy)]
pub(super) struct Blend<const C: usize> {
    /// `∫ T σ c dt` of the curve's channels; zero where only the depth is asked for.
    pub emitted: [f64; C],
    /// Optical depth.
    pub depth: f64,
    /// Where the last batch of bricks begins.
    pub last: f64,
}

/// A segment with its light, and the transmittance before it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry<R: Real, S> {
    pub segment: S,
    pub light: SegmentOptics<R>,
    pub open: f64,
}
