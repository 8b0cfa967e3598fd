//! Nodes that are visited together, and the derivatives with respect to the segments between them.

use super::batch::SegmentBatch;
use super::front::Front;
use super::nodes::{Queue, ROOM};
use crate::real::Real;

/// Nodes that were visited together, and the segments that end at them.
#[derive(Debug, Clone, Default)]
pub(in super::super) struct Visit<R: Real> {
    pub(super) nodes: Box<Queue<R>>,
    pub(super) fours: usize,
    pub(super) batch: Box<SegmentBatch<R>>,
    /// Light of all visits up to and including this one.
    pub(super) emitted: [f64; 3],
}

impl<R: Real> Visit<R> {
    /// Takes the nodes and segments that were added to `front`, and leaves others in their places.
    #[inline(always)]
    pub(super) fn record(
        &mut self,
        front: &Front<'_, R>,
        queue: &mut Box<Queue<R>>,
        fours: usize,
        batch: &mut Box<SegmentBatch<R>>,
    ) {
        std::mem::swap(batch, &mut self.batch);
        std::mem::swap(queue, &mut self.nodes);
        queue.succeed(&self.nodes, fours);
        self.fours = fours;
        self.emitted = front.emitted;
    }
}

/// Derivatives of the loss with respect to the numbers of a batch, and intermediate values. Channels share all weights
/// but those of the loss, so that sources here are loss-weighted sums of the channels.
#[derive(Debug, Clone)]
pub(super) struct BatchGradient<R> {
    /// Numbers by segment. `mean`: extinction times source. `mixed`, `drift`, `extinction`, `depth`: derivatives with
    /// respect to that mean, the source's drift, the mean extinction and the optical depth. `light`: light of the
    /// segment.
    pub(super) mean: [R; ROOM],
    pub(super) mixed: [R; ROOM],
    pub(super) drift: [R; ROOM],
    pub(super) extinction: [R; ROOM],
    pub(super) depth: [R; ROOM],
    pub(super) light: [R; ROOM],
    /// Source at the segments' ends, and its slope with the density.
    pub(super) source: [R; ROOM + 1],
    pub(super) source_slope: [R; ROOM + 1],
    /// Derivatives with respect to the densities at the ends. `incoming` first holds the radiance that arrives from
    /// behind each segment, then the derivatives from the segments that end there alone.
    pub(super) density: [R; ROOM + 1],
    pub(super) incoming: [R; ROOM + 1],
    /// Derivatives with respect to the mean deviations of the densities.
    pub(super) deviation: [R; ROOM],
}

impl<R> BatchGradient<R> {
    /// Returns the derivatives with respect to the logarithms of the segments' lengths; these equal those with respect
    /// to the logarithms of their extinctions.
    pub(super) fn by_length(&self, count: usize) -> &[R] {
        &self.light[..count]
    }
}

impl<R: Real> Default for BatchGradient<R> {
    fn default() -> Self {
        let (segment, ends) = ([R::ZERO; ROOM], [R::ZERO; ROOM + 1]);
        Self {
            mean: segment,
            mixed: segment,
            drift: segment,
            extinction: segment,
            depth: segment,
            light: segment,
            source: ends,
            source_slope: ends,
            density: ends,
            incoming: ends,
            deviation: segment,
        }
    }
}
