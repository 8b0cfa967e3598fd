//! Errors of the segments of a batch, and what they are bounded by.

use super::nodes::ROOM;
use crate::real::Real;

/// Numbers by segment of a batch.
type Segment<R> = [R; ROOM];

/// Errors of a batch's segments.
#[derive(Debug, Clone)]
pub(super) struct Errors<R> {
    /// Bounds of the errors, and what the segments may use by the light that they absorb.
    pub error: Segment<R>,
    pub allowed: Segment<R>,
    /// Variations of the function where the segments' densities may lie, as [`Varied`](super::variation::Varied) has
    /// them.
    pub extinction: Segment<R>,
    pub shift: Segment<R>,
    pub color: Segment<R>,
    pub extinction_slope: Segment<R>,
    pub emitted_slope: Segment<R>,
    pub steps: Segment<R>,
    /// Bounds of the errors of the segments' optical depths, of their light by the mean color, and of that color.
    pub depth: Segment<R>,
    pub light: Segment<R>,
    pub range: Segment<R>,
    /// Numbers of parts that the segments need.
    pub parts: [u8; ROOM],
}

impl<R: Real> Default for Errors<R> {
    fn default() -> Self {
        let zero = [R::ZERO; ROOM];
        Self {
            error: zero,
            allowed: zero,
            extinction: zero,
            shift: zero,
            color: zero,
            extinction_slope: zero,
            emitted_slope: zero,
            steps: zero,
            depth: zero,
            light: zero,
            range: zero,
            parts: [1; ROOM],
        }
    }
}
