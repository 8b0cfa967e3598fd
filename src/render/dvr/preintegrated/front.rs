//! Front-to-back blending of the segments between nodes, batch by batch.

use super::batch::SegmentBatch;
use super::nodes::Queue;
use super::table::{Cumulative, End};
use crate::real::Real;
use crate::real::{LANES, Lanes};
use crate::render::curve::Curve;

/// State of front-to-back blending.
#[derive(Debug, Clone, Copy)]
pub(super) struct Front<'a, R: Real> {
    tables: &'a Cumulative<R>,
    curve: &'a Curve<R, 3>,
    last: End<R>,
    /// Optical depth from the eye.
    pub depth: f64,
    /// Transmittance from the eye.
    transmittance: R,
    /// Light accumulated so far, by channel.
    pub emitted: [f64; 3],
}

impl<'a, R: Real> Front<'a, R> {
    /// Creates the state at the eye, before any segment, at density zero.
    #[inline(always)]
    pub fn new(tables: &'a Cumulative<R>, curve: &'a Curve<R, 3>) -> Self {
        Self { tables, curve, last: tables.zero, depth: 0.0, transmittance: R::ONE, emitted: [0.0; 3] }
    }

    /// Adds the segments that end at the first `fours` groups of four nodes, and leaves them in `batch`.
    #[inline(always)]
    pub fn add(&mut self, values: &[R], queue: &Queue<R>, fours: usize, batch: &mut SegmentBatch<R>) {
        batch.count = LANES * fours.min(super::nodes::FOURS);
        let (densities, lengths) = (batch.density[1..].as_chunks_mut().0, batch.length.as_chunks_mut().0);
        for ((nodes, density), length) in queue.first(fours).zip(densities).zip(lengths) {
            *density = self.tables.within(nodes.densities(values)).store();
            *length = nodes.length.store();
        }
        self.blend(batch);
    }

    /// Adds a last segment of constant density zero.
    #[inline(always)]
    pub fn add_gap(&mut self, length: f64) {
        let [red, green, blue, extinction] = self.tables.zero.values.store().map(Real::f64);
        let depth = length * extinction;
        let absorbed = -(-depth).exp_m1() * self.transmittance.f64();
        self.emitted[0] += red * absorbed;
        self.emitted[1] += green * absorbed;
        self.emitted[2] += blue * absorbed;
        self.depth += depth;
    }

    #[inline(always)]
    fn blend(&mut self, batch: &mut SegmentBatch<R>) {
        batch.cut.clear();
        batch.follow(self.tables, self.curve, &mut self.last);
        let (radiance, depth) = batch.blend(&mut self.transmittance);
        for c in 0..3 {
            self.emitted[c] += radiance[c];
        }
        self.depth += depth;
    }
}
