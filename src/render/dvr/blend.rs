//! Front-to-back blending of segments whose source varies.

use super::shade::{SegmentOptics, SegmentSource, Shade};
use super::{CompiledCurve, Dvr};
use crate::real::Real;
use crate::render::compositing::Compositing;
use crate::render::curve::Curve;
use crate::render::emission_absorption::Radiance;
use crate::render::march::Span;
use crate::render::quadrature::Rule;

/// A segment with its optics, and the transmittance before it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry<R: Real, S> {
    pub segment: S,
    pub optics: SegmentOptics<R>,
    pub transmittance: f64,
}

/// A ray's segments, blended front to back; [`shade`](super::shade) has the formulas. Optical depth and transmittance
/// are carried in `f64`: a constant source contributes `c (T_before - T_after)`, which would cancel in `f32`.
pub(super) struct Blend<'b, R: Real, S, Q, const C: usize> {
    values: &'b [R],
    curve: &'b Curve<R, C>,
    rule: Q,
    /// Optical depth at which the ray ends.
    pub depth_limit: f64,
    /// Segments of one batch.
    pub segments: &'b mut Vec<S>,
    /// Emitted radiance `∫ T σ c dt` by the curve's channels.
    pub emitted: [f64; C],
    /// Optical depth.
    pub depth: f64,
    /// Transmittance, `exp(-depth)`.
    transmittance: f64,
}

impl<'b, R: Real, S, Q, const C: usize> Blend<'b, R, S, Q, C> {
    #[inline(always)]
    pub(crate) fn new(
        dvr: &'b Dvr<'_, R>,
        compiled: &'b CompiledCurve<R, C>,
        rule: Q,
        segments: &'b mut Vec<S>,
    ) -> Self {
        Self {
            values: &dvr.field.values,
            curve: &compiled.curve,
            rule,
            depth_limit: dvr.depth_limit,
            segments,
            emitted: [0.0; C],
            depth: 0.0,
            transmittance: 1.0,
        }
    }

    #[inline(always)]
    pub(crate) fn radiance(&self, compiled: &CompiledCurve<R, C>) -> Radiance {
        Radiance { rgb: compiled.tinted(&self.emitted), depth: self.depth }
    }
}

impl<R: Real, S: Shade<R>, Q: Rule<R, C, Segment = S>, const C: usize> Compositing<R> for Blend<'_, R, S, Q, C> {
    type Entry = Entry<R, S>;

    #[inline(always)]
    fn composite<const KEEP: bool>(&mut self, spans: &[Span<R>], tape: &mut Vec<Entry<R, S>>) -> bool {
        self.segments.clear();
        self.rule.segments(self.curve, self.values, spans, self.segments);
        for segment in self.segments.iter() {
            let piece = self.curve.piece(segment.piece());
            let optics = segment.segment_optics(piece);
            self.depth += optics.depth.f64();
            let after = (-self.depth).exp();
            let (absorbed, varied) = (self.transmittance - after, self.transmittance * optics.varied.f64());
            for c in 0..C {
                let [at_base, slope] = piece.source[c];
                let mean = at_base + slope * (optics.mean - piece.base);
                self.emitted[c] += mean.f64() * absorbed + slope.f64() * varied;
            }
            if KEEP {
                tape.push(Entry { segment: *segment, optics, transmittance: self.transmittance });
            }
            self.transmittance = after;
        }
        self.depth < self.depth_limit
    }
}

/// Returns the loss-weighted radiance of one segment, as it arrives at the eye, from the transmittances before and
/// behind it.
#[inline(always)]
pub(super) fn arriving<R: Real>(source: SegmentSource, optics: &SegmentOptics<R>, before: f64, after: f64) -> f64 {
    source.mean * (before - after) + source.slope * before * optics.varied.f64()
}
