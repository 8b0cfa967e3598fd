//! Nodes that are visited together, and the derivatives with respect to the segments between them.

use super::batch::{ROOM, SegmentBatch};
use super::light::Front;
use super::nodes::Queue;
use crate::real::Real;

/// Nodes that were visited together, and the segments that end at them.
#[derive(Debug, Clone, Default)]
pub(in super::super) struct Visit<R: Real> {
    pub(super) nodes: Box<Queue<R>>,
    pub(super) fours: usize,
    pub(super) batch: Box<SegmentBatch<R>>,
    /// Light of all visits up to this one.
    pub(super) emitted: [f64; 3],
}

impl<R: Real> Visit<R> {
    #[inline(always)]
    pub(super) fn record(&mut self, front: &mut Front<'_, R>, values: &[R], queue: &mut Box<Queue<R>>, fours: usize) {
        front.add(values, queue, fours, &mut self.batch);
        std::mem::swap(queue, &mut self.nodes);
        queue.succeed(&self.nodes, fours);
        self.fours = fours;
        self.emitted = front.emitted;
    }
}

/// Derivatives with respect to what a batch holds, and what goes into them. Channels share all weights but those of the
/// loss: sources are loss-weighted sums of them.
#[derive(Debug, Clone)]
pub(super) struct BatchGradient<R> {
    /// By segment: the mean of extinction times source; the derivatives with respect to that, to the source's drift, to
    /// the mean extinction and to the optical depth; its light.
    pub(super) mean: [R; ROOM],
    pub(super) mixed: [R; ROOM],
    pub(super) drift: [R; ROOM],
    pub(super) extinction: [R; ROOM],
    pub(super) depth: [R; ROOM],
    pub(super) light: [R; ROOM],
    /// Source at the ends, and slopes of source and extinction.
    pub(super) source: [R; ROOM + 1],
    pub(super) slopes: [[R; ROOM + 1]; 2],
    /// With respect to the densities at the ends; in `behind` that of the segments that end there alone, and before
    /// that what arrives from behind each segment.
    pub(super) density: [R; ROOM + 1],
    pub(super) behind: [R; ROOM + 1],
}

impl<R> BatchGradient<R> {
    /// Derivatives by the logarithms of segments' lengths: of their extinctions', once these are added up.
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
            slopes: [ends; 2],
            density: ends,
            behind: ends,
        }
    }
}
