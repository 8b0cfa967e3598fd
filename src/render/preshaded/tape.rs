//! Scratch memory of rays.

use super::segment::{Footprint, Segment, scatter};
use crate::real::Lanes;
use crate::real::Real;

/// Scratch memory of one thread, reused from ray to ray.
#[derive(Debug, Clone, Default)]
pub struct Tape<R: Real> {
    /// Weights of the emissions in the rays traced, by segment.
    pub(super) footprints: Vec<Footprint<R>>,
    /// Segments of a ray.
    pub(super) segments: Vec<Segment<R>>,
}

impl<R: Real> Tape<R> {
    /// Adds the derivative of `Σ g_c L_c` over the rays traced with respect to the stored emissions to `gradient`, and
    /// forgets the rays. The last lane, that of extinctions, is left unchanged.
    #[inline(always)]
    pub fn accumulate(&mut self, by: [R; 3], gradient: &mut [R::Lanes]) {
        let by = R::Lanes::load([by[0], by[1], by[2], R::ZERO]);
        for footprint in &self.footprints {
            scatter::<R>(gradient, footprint.offset, &footprint.weights, by);
        }
        self.forget();
    }

    /// Forgets the rays.
    pub(crate) fn forget(&mut self) {
        self.footprints.clear();
    }
}
