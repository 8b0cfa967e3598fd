//! Front-to-back blending of the segments between nodes, batch by batch.

use super::batch::SegmentBatch;
use super::bound::Budget;
use super::deviation::Deviations;
use super::nodes::{BRICK_END, Divided, FOURS, Queue};
use super::table::{Cumulative, End};
use crate::real::Real;
use crate::real::{LANES, Lanes};
use crate::render::curve::Curve;
use crate::render::march::IndexRay;
use glam::DVec3;

/// State of front-to-back blending.
#[derive(Debug, Clone, Copy)]
pub(super) struct Front<'a, R: Real> {
    tables: &'a Cumulative<R>,
    curve: &'a Curve<R, 3>,
    /// Index coordinates gained per world length.
    direction: DVec3,
    /// Optical depth at which the ray ends.
    limit: f64,
    pub deviations: Deviations<R>,
    budget: Budget,
    /// Offset of the cell of the last node, and rounding of the density there.
    cell: u32,
    noise: R,
    last: End<R>,
    /// Position of the last node in its interval, as nodes have it.
    share: R,
    /// Optical depth from the eye.
    pub depth: f64,
    /// Transmittance from the eye.
    transmittance: R,
    /// Light accumulated so far, by channel.
    pub emitted: [f64; 3],
}

impl<'a, R: Real> Front<'a, R> {
    /// Creates the state at the eye, before any segment, at the background, for an attempt at a ray that ends at an
    /// optical depth.
    #[inline(always)]
    pub(crate) fn new(
        tables: &'a Cumulative<R>,
        curve: &'a Curve<R, 3>,
        (ray, limit): (&IndexRay, f64),
        attempt: usize,
    ) -> Self {
        Self {
            tables,
            curve,
            direction: ray.direction(),
            limit,
            deviations: Deviations::new(ray.direction()),
            budget: Budget::new(attempt),
            cell: u32::MAX,
            noise: R::ZERO,
            last: tables.outside,
            share: R::of(BRICK_END),
            depth: 0.0,
            transmittance: R::ONE,
            emitted: [0.0; 3],
        }
    }

    /// True until the ray's optical depth exceeds its limit.
    #[inline(always)]
    pub(crate) fn goes_on(&self) -> bool {
        self.depth < self.limit
    }

    /// True if the error so far is within the tolerance.
    #[inline(always)]
    pub(crate) fn is_accurate(&self) -> bool {
        self.budget.used <= self.tables.tolerance
    }

    /// Adds the segments that end at the first `fours` groups of four nodes. Where they would err too much they are
    /// divided first; `added` is called with the nodes and segments of each part, and may exchange both for others.
    #[inline(always)]
    pub(crate) fn add(
        &mut self,
        values: &[R],
        (queue, fours): (&mut Box<Queue<R>>, usize),
        divided: &mut Divided<R>,
        batch: &mut Box<SegmentBatch<R>>,
        mut added: impl FnMut(&Self, &mut Box<Queue<R>>, usize, &mut Box<SegmentBatch<R>>),
    ) {
        let mut chunk: Option<Box<Queue<R>>> = None;
        loop {
            let (nodes, fours) = chunk.as_ref().map_or((&*queue, fours), |chunk| (chunk, chunk.fours()));
            if self.try_add(values, nodes, fours, batch) {
                added(self, chunk.as_mut().unwrap_or(queue), fours, batch);
            } else {
                divided.divide(nodes, fours, &batch.errors.parts, (self.direction, self.share));
            }
            if let Some(chunk) = chunk {
                divided.reuse(chunk);
            }
            if !self.goes_on() {
                divided.reset();
            }
            chunk = divided.next();
            if chunk.is_none() {
                return;
            }
        }
    }

    /// Adds the segments that end at nodes, and leaves them in `batch`; if some of them have to be divided, adds none
    /// and returns false.
    #[inline(always)]
    fn try_add(&mut self, values: &[R], queue: &Queue<R>, fours: usize, batch: &mut SegmentBatch<R>) -> bool {
        batch.count = LANES * fours.min(FOURS);
        let mut cell = self.cell;
        batch.noise[0] = self.noise;
        for (n, nodes) in queue.first(fours).enumerate() {
            let corners = nodes.corners(values);
            let deviation = self.deviations.of(&nodes, &corners, cell);
            cell = nodes.offset[LANES - 1];
            batch.place(n, self.tables.within(nodes.densities(&corners)), nodes.length, &deviation);
        }
        let (mut last, mut transmittance) = (self.last, self.transmittance);
        batch.follow(self.tables, self.curve, &mut last);
        batch.arrive(&mut transmittance);
        if !self.budget.charge(batch, queue.level, self.tables) {
            return false;
        }
        let shares = queue.shares(batch.count);
        self.share = shares.iter().rev().find(|share| **share >= R::ZERO).copied().unwrap_or(self.share);
        (self.last, self.cell, self.transmittance) = (last, cell, transmittance);
        self.noise = batch.noise[batch.count];
        let (radiance, depth) = batch.blend();
        for c in 0..3 {
            self.emitted[c] += radiance[c];
        }
        self.depth += depth;
        true
    }

    /// Adds a last segment of the background's density.
    #[inline(always)]
    pub(crate) fn add_gap(&mut self, length: f64) {
        let [red, green, blue, extinction] = self.tables.outside.values.store().map(Real::f64);
        let depth = length * extinction;
        let absorbed = -(-depth).exp_m1() * self.transmittance.f64();
        self.emitted[0] += red * absorbed;
        self.emitted[1] += green * absorbed;
        self.emitted[2] += blue * absorbed;
        self.depth += depth;
    }
}
