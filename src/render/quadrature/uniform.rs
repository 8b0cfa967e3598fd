//! Samples at steps of constant length.

use super::{DepthRule, Rule};
use crate::real::{LANES, Lanes, Real};
use crate::render::cell::{Quartet, corners, gather, low, offsets, weights};
use crate::render::curve::Curve;
use crate::render::march::{IndexRay, Span};
use crate::render::segment::Sample;
use std::ops::Range;

/// Steps of constant world length from the ray's entry into the field's box.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Uniform {
    /// World length of a step.
    pub step: f64,
    /// Position of the sample within its step: 0 at the start, 0.5 in the middle.
    phase: f64,
    /// World length from the ray's origin at which the first step begins.
    enter: f64,
    /// World length from the ray's origin at which the last step is cut.
    leave: f64,
    /// Number of the last step.
    pub last: u64,
    /// Steps per world length.
    per_length: f64,
}

impl Uniform {
    /// Creates the steps of a ray: their world length, and the position of the sample within its step, 0 at the start,
    /// 0.5 in the middle.
    #[inline(always)]
    pub(crate) fn new(step: f64, phase: f64, ray: &IndexRay) -> Self {
        let IndexRay { enter, leave, .. } = *ray;
        let last = ((leave - enter) / step).ceil().max(1.0) as u64 - 1;
        Self { step, phase, enter, leave, last, per_length: 1.0 / step }
    }

    /// Returns sample position and length of step `k`; the last step is cut at the exit.
    #[inline(always)]
    pub(crate) fn step(&self, k: u64) -> (f64, f64) {
        let begin = self.enter + k as f64 * self.step;
        let length = self.step.min(self.leave - begin);
        (begin + self.phase * length, length)
    }

    /// Returns the number of steps whose sample lies before `t`.
    #[inline(always)]
    pub(crate) fn before(&self, t: f64) -> u64 {
        let whole = ((t - self.enter) * self.per_length - self.phase).ceil().max(0.0) as u64;
        if whole < self.last { whole } else { self.last + u64::from(self.step(self.last).0 < t) }
    }

    /// Returns the world length of consecutive steps.
    #[inline(always)]
    pub(crate) fn length(&self, steps: Range<u64>) -> f64 {
        let begin = |k: u64| if k > self.last { self.leave } else { self.enter + k as f64 * self.step };
        begin(steps.end) - begin(steps.start)
    }

    /// Returns the numbers of the steps whose samples lie on a span. Spans are half open: each sample belongs to
    /// exactly one.
    #[inline(always)]
    pub(crate) fn on<R: Real>(&self, span: &Span<R>) -> Range<u64> {
        self.before(span.start)..self.before(span.end)
    }

    /// Visits the samples on spans: number of the step and world length from the ray's origin to its sample, offset of
    /// the cell, world length of the step, cell-local coordinates.
    #[inline(always)]
    fn samples<R: Real>(&self, spans: &[Span<R>], mut visit: impl FnMut((u64, f64), usize, R, [R; 3])) {
        for span in spans {
            let [dx, dy, dz] = span.direction;
            for k in self.on(span) {
                let (position, length) = self.step(k);
                let t = R::of(position - span.start);
                let p = [span.entry[0] + t * dx, span.entry[1] + t * dy, span.entry[2] + t * dz];
                let low = p.map(|c| low(R::Lanes::splat(c)));
                let offset = span.base + offsets(low)[0] as usize;
                let m = std::array::from_fn(|a| p[a] - low[a].store()[0]);
                visit((k, position), offset, R::of(length), m);
            }
        }
    }
}

impl<R: Real, const C: usize> Rule<R, C> for Uniform {
    type Segment = Sample<R>;

    #[inline(always)]
    fn segments(&self, curve: &Curve<R, C>, values: &[R], spans: &[Span<R>], segments: &mut Vec<Sample<R>>) {
        self.samples(spans, |(number, position), offset, length, at| {
            let density = gather(&weights(at), &corners(values, offset));
            segments.push(Sample { offset, piece: curve.find(density), length, at, density, number, position });
        });
    }

    const BOUNDED: bool = false;

    #[inline(always)]
    fn vjp(&self, sample: &Sample<R>, by_length: f64, by_position: f64) -> [f64; 3] {
        let number = sample.number as f64;
        if sample.number < self.last {
            return [by_position, 0.0, (number + self.phase) * by_position + by_length];
        }
        let begin = (1.0 - self.phase) * by_position - by_length;
        [begin, self.phase * by_position + by_length, number * begin]
    }

    #[inline(always)]
    fn jvp(&self, sample: &Sample<R>, [enter, leave, step]: [f64; 3]) -> [f64; 2] {
        let number = sample.number as f64;
        let begin = enter + number * step;
        let length = if sample.number < self.last { step } else { leave - begin };
        [length, begin + self.phase * length]
    }
}

impl<R: Real> DepthRule<R> for Uniform {
    #[inline(always)]
    fn cells(&self, spans: &[Span<R>], cells: &mut Vec<Quartet<R>>) {
        let empty = Quartet { offset: [0; LANES], weights: [[R::Lanes::splat(R::ZERO); 2]; LANES] };
        let (mut four, mut count) = (empty, 0);
        self.samples(spans, |_, offset, length, at| {
            let ([near, far], length) = (weights(at), R::Lanes::splat(length));
            four.offset[count] = offset as u32;
            four.weights[count] = [near * length, far * length];
            count += 1;
            if count == LANES {
                cells.push(four);
                (four, count) = (empty, 0);
            }
        });
        if count > 0 {
            cells.push(four);
        }
    }
}
