//! Gradients of rarely used rules: of quadratures with a step, and by the inversion of Weiss & Westermann (2021).

use super::adjoint::Pass;
use super::blend::Entry;
use super::kernel;
use super::segment_derivatives::SegmentDerivatives;
use super::tape::Tape;
use super::{CompiledCurve, CompiledMedium, inversion};
use crate::real::Real;
use crate::render::differentiable::{Adjoint, Loss};
use crate::render::integrator::Radiance;
use crate::render::rule::{Rule, Uniform};
use crate::scene::medium::Source;

impl<R: Real> Pass<'_, '_, R> {
    /// Computes the gradient for quadratures with a step, or by inversion of the blend.
    pub(super) fn stepped(&mut self, loss: Loss<'_, R>, adjoint: Adjoint, tape: &mut Tape<R>) -> Radiance {
        let dvr = self.dvr;
        let uniform = dvr.uniform(&self.ray);
        // Depths are averages over cells: where the ray goes needs their points.
        if let (Source::Grey(color), None, Some(rule)) = (&dvr.medium.source, &self.to.ray, uniform)
            && adjoint != Adjoint::Inversion
        {
            return self.depth_only(loss, adjoint, rule, *color, &mut tape.cells);
        }
        match &dvr.compiled {
            CompiledMedium::Line(optics) => self.stepped_of(loss, adjoint, uniform, optics, tape),
            CompiledMedium::Table(optics, _) => self.stepped_of(loss, adjoint, uniform, optics, tape),
        }
    }

    fn stepped_of<const C: usize>(
        &mut self,
        loss: Loss<'_, R>,
        adjoint: Adjoint,
        uniform: Option<Uniform>,
        optics: &CompiledCurve<R, C>,
        tape: &mut Tape<R>,
    ) -> Radiance {
        let Tape { samples, chords, lit_samples, lit_chords, .. } = tape;
        match (uniform, adjoint) {
            (Some(rule), Adjoint::Inversion) => self.inversion(loss, rule, optics, samples, lit_samples),
            (Some(rule), _) => self.recursion(loss, adjoint, rule, optics, samples, lit_samples),
            (None, _) => {
                let rule = self.dvr.exact_source(optics, self.to.table.is_some());
                self.inversion(loss, rule, optics, chords, lit_chords)
            }
        }
    }

    /// Runs the backward pass by inversion of the blend (Weiss & Westermann 2021, sect. 4.3).
    fn inversion<S: SegmentDerivatives<R>, Q: Rule<R, C, Segment = S>, const C: usize>(
        &mut self,
        loss: Loss<'_, R>,
        rule: Q,
        optics: &CompiledCurve<R, C>,
        segments: &mut Vec<S>,
        tape: &mut Vec<Entry<R, S>>,
    ) -> Radiance {
        tape.clear();
        let (dvr, curve) = (self.dvr, &optics.curve);
        let blend = kernel::blend(dvr, self.topology(), &self.ray, rule, curve, segments, |found| {
            tape.extend(found);
        });
        let seen = Radiance { rgb: optics.tinted(&blend.emitted), depth: blend.depth };
        let weighted = self.shared(loss(&seen), &blend.emitted, &optics.tint);
        if self.to.ray.is_some() && Q::BOUNDED {
            let transmittance = (-blend.depth).exp();
            let emitted: f64 = weighted.color.iter().zip(&blend.emitted).map(|(w, e)| w * e).sum();
            let whole = emitted + transmittance * weighted.transmittance;
            self.moved.leave = transmittance * self.gain(optics, self.ray.leave, weighted.transmittance, &weighted);
            self.moved.enter = -self.gain(optics, self.ray.enter, whole, &weighted);
        }
        inversion::backward(self, curve, rule, tape, &weighted);
        self.finish();
        seen
    }
}
