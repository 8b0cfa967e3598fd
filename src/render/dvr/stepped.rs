//! Gradients of rarely used rules: of quadratures with a step, and by the inversion of Weiss & Westermann (2021).

use super::adjoint::Pass;
use super::tape::Tape;
use super::{CompiledCurve, CompiledMedium};
use crate::real::Real;
use crate::render::differentiable::{Adjoint, Loss};
use crate::render::emission_absorption::Radiance;
use crate::render::quadrature::Uniform;
use crate::scene::medium::Source;

impl<R: Real> Pass<'_, '_, R> {
    /// Computes the gradient for quadratures with a step, or by inversion of the blend.
    pub(super) fn stepped(&mut self, loss: Loss<'_, R>, adjoint: Adjoint, tape: &mut Tape<R>) -> Radiance {
        let dvr = self.dvr;
        let uniform = dvr.uniform(&self.ray);
        // Averaged weights of cells cannot be differentiated with respect to the ray.
        if let (Source::Grey(color), None, Some(rule)) = (&dvr.medium.source, &self.to.ray, uniform)
            && adjoint != Adjoint::Inversion
        {
            return self.absorption((loss, adjoint), rule, *color, &mut tape.cells);
        }
        match &dvr.compiled {
            CompiledMedium::Line(compiled) => self.stepped_of(loss, adjoint, uniform, compiled, tape),
            CompiledMedium::Table(compiled, _) => self.stepped_of(loss, adjoint, uniform, compiled, tape),
        }
    }

    fn stepped_of<const C: usize>(
        &mut self,
        loss: Loss<'_, R>,
        adjoint: Adjoint,
        uniform: Option<Uniform>,
        compiled: &CompiledCurve<R, C>,
        tape: &mut Tape<R>,
    ) -> Radiance {
        let Tape { samples, chords, sample_entries, chord_entries, .. } = tape;
        match (uniform, adjoint) {
            (Some(rule), Adjoint::Inversion) => self.inversion(loss, rule, compiled, (samples, sample_entries)),
            (Some(rule), _) => self.recursion((loss, adjoint), rule, compiled, (samples, sample_entries)),
            (None, _) => {
                let rule = self.dvr.exact_source(compiled, self.to.table.is_some());
                self.inversion(loss, rule, compiled, (chords, chord_entries))
            }
        }
    }
}
