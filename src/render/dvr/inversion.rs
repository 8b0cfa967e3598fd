//! The backward pass of Weiss & Westermann (2021, sect. 4.3): the state of the front-to-back blend is
//! recovered by inverting it, `α = (α' - a) / (1 - a)`. Kept in the kernel's own precision, as
//! published, so that its error can be shown beside the recursion's: it is 0/0 behind an opaque
//! sample, and drifts with the optical depth.

use super::CompiledCurve;
use super::adjoint::{Pass, SegmentGradients};
use super::blend::{Blend, Entry};
use super::segment_derivatives::SegmentDerivatives;
use super::shade::SegmentCotangent;
use crate::real::Real;
use crate::render::compositing;
use crate::render::differentiable::{Adjoint, Loss};
use crate::render::emission_absorption::Radiance;
use crate::render::quadrature::Rule;
use crate::render::segment::End;

impl<R: Real> Pass<'_, '_, R> {
    /// Computes the gradient by inversion of the blend.
    pub(super) fn inversion<S: SegmentDerivatives<R>, Q: Rule<R, C, Segment = S>, const C: usize>(
        &mut self,
        loss: Loss<'_, R>,
        rule: Q,
        compiled: &CompiledCurve<R, C>,
        (segments, tape): (&mut Vec<S>, &mut Vec<Entry<R, S>>),
    ) -> Radiance {
        tape.clear();
        let mut blend = Blend::new(self.dvr, compiled, rule, segments);
        compositing::record(self.topology(), &self.ray, Adjoint::Tape, &mut blend, tape);
        let (radiance, emitted) = (blend.radiance(compiled), blend.emitted);
        let weighted = self.add_color(loss(&radiance), &emitted, &compiled.tint);
        let transmittance = radiance.transmittance();
        let emitted: f64 = weighted.color.iter().zip(&emitted).map(|(w, e)| w * e).sum();
        let mut segments = SegmentGradients { pass: self, compiled, rule, weighted };
        segments.add_exit(transmittance);
        segments.add_entry(emitted + transmittance * weighted.transmittance);
        segments.add_by_inversion(tape);
        self.finish();
        radiance
    }
}

impl<R: Real, S: SegmentDerivatives<R>, Q: Rule<R, C, Segment = S>, const C: usize>
    SegmentGradients<'_, '_, '_, R, Q, C>
{
    /// Blends the tape forward in `R`, then walks it backward by inversion.
    #[inline(always)]
    fn add_by_inversion(&mut self, tape: &[Entry<R, S>]) {
        let alpha = |entry: &Entry<R, S>| -(-entry.optics.depth).exp_m1();
        let mut opacity = R::ZERO;
        for entry in tape {
            opacity += (R::ONE - opacity) * alpha(entry);
        }
        let mut by_opacity = R::of(-self.weighted.transmittance);
        for entry in tape.iter().rev() {
            let (segment, optics) = (&entry.segment, &entry.optics);
            let source = self.source(segment, optics);
            let (mean, slope) = (R::of(source.mean), R::of(source.slope));
            // More opacity takes away what arrives from behind.
            let incoming = |transmittance: R, by_opacity: R| -(transmittance * by_opacity).f64();
            let after = R::ONE - opacity;
            self.add_jump((segment, End::Far), after.f64(), incoming(after, by_opacity));
            let alpha = alpha(entry);
            opacity = (opacity - alpha) / (R::ONE - alpha);
            let before = R::ONE - opacity;
            // emitted' = emitted + before · e,  opacity' = opacity + before · α,  e = c̄ α + s q
            let by_depth = before * (by_opacity + mean) * (R::ONE - alpha);
            by_opacity = by_opacity * (R::ONE - alpha) - (mean * alpha + slope * optics.varied);
            let by = SegmentCotangent { depth: by_depth, mean: before * alpha, varied: before };
            self.add(segment, optics, slope, by);
            self.add_jump((segment, End::Near), before.f64(), incoming(before, by_opacity));
        }
    }
}
