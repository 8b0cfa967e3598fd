//! Derivatives of all channels with respect to a transfer function's knots in one backward walk: a row of the normal
//! equations. The recursion of [`adjoint`](super::adjoint) runs for each channel in turn; terms that the channels share
//! are computed once: the derivative with respect to a color affects its own channel alone and is equal for all, and
//! that of alpha with respect to an optical depth is the ray's transmittance.

use super::adjoint::Pass;
use super::blend::{Blend, Entry, arriving};
use super::preintegrated::Preintegrated;
use super::shade::{SegmentCotangent, SegmentSource, Shade};
use super::tape::Tape;
use super::{CompiledCurve, CompiledMedium, Dvr, Precision};
use crate::math::Ray;
use crate::real::Lanes;
use crate::render::composited::{Composited, Pixel};
use crate::render::compositing;
use crate::render::differentiable::{Accumulators, Adjoint, Cotangent, ParameterGradient};
use crate::render::emission_absorption::{EmissionAbsorption, Radiance};
use crate::render::march::IndexRay;
use crate::render::quadrature::Rule;

/// Derivatives of a pixel with respect to one knot.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ByKnot {
    /// Derivatives of red, green, blue and alpha with respect to the knot's extinction.
    pub extinction: [f64; 4],
    /// Derivative of each channel with respect to the knot's color in that channel.
    pub color: f64,
}

impl ByKnot {
    /// True if the pixel does not depend on the knot.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }
}

/// Derivatives of a pixel with respect to the values at a table's knots.
#[derive(Debug, Clone)]
pub struct TableJacobian {
    /// One entry per knot, with padding entries before the first and after the last, whose derivatives stay zero.
    knots: Vec<ByKnot>,
}

impl TableJacobian {
    /// Creates a Jacobian of zeros for this many knots.
    pub fn zeros(knots: usize) -> Self {
        Self { knots: vec![ByKnot::default(); knots + 2] }
    }

    /// Sets all derivatives to zero.
    pub fn forget(&mut self) {
        self.knots.fill(ByKnot::default());
    }

    /// Returns the derivatives, one entry per knot.
    pub fn by_knot(&self) -> &[ByKnot] {
        &self.knots[1..self.knots.len() - 1]
    }
}

impl<R: Precision> Dvr<'_, R> {
    /// Returns the radiance along a world ray of unit direction. Adds to `jacobian` `weight` times the derivatives of
    /// the pixel, composited over the background, with respect to the values at the transfer function's knots;
    /// `jacobian` must have as many knots as the function. Without a transfer function nothing is added.
    pub(crate) fn table_jacobian(
        &self,
        ray: &Ray,
        background: [f32; 3],
        (weight, jacobian): (f64, &mut TableJacobian),
        tape: &mut Tape<R>,
    ) -> Radiance {
        let (CompiledMedium::Table(compiled, tables), Some(ray)) = (&self.compiled, self.index_ray(ray)) else {
            return self.integrate(ray, tape);
        };
        if let Some(tables) = tables
            && let Some(radiance) =
                self.preintegrated_rows(ray, (compiled, tables), background, (weight, jacobian), tape)
        {
            return radiance;
        }
        let Tape { samples, chords, sample_entries, chord_entries, .. } = tape;
        match self.uniform(&ray) {
            Some(rule) => self.rows(&ray, rule, compiled, background, (weight, jacobian), (samples, sample_entries)),
            None => {
                let rule = self.exact_source(compiled, true);
                self.rows(&ray, rule, compiled, background, (weight, jacobian), (chords, chord_entries))
            }
        }
    }

    /// Adds the derivatives of pre-integration, channel by channel in reverse mode; `None`, with nothing added, if the
    /// ray's error may exceed the tolerance.
    fn preintegrated_rows(
        &self,
        ray: IndexRay,
        (compiled, tables): (&CompiledCurve<R, 3>, &Preintegrated<R>),
        background: [f32; 3],
        (weight, jacobian): (f64, &mut TableJacobian),
        tape: &mut Tape<R>,
    ) -> Option<Radiance> {
        let (mut radiance, mut shared) = (Radiance::default(), ParameterGradient::default());
        for channel in 0..4 {
            let mut loss = |_: &Radiance| {
                let mut cotangent = Cotangent { rgb: [R::ZERO; 3], transmittance: -1.0 };
                if channel < 3 {
                    cotangent.rgb[channel] = R::ONE;
                    cotangent.transmittance = background[channel].into();
                }
                cotangent
            };
            tape.by_table.reset(jacobian.by_knot().len());
            let table = Some(&mut tape.by_table);
            let to = Accumulators { voxels: None, table, ray: None, shared: &mut shared };
            radiance = tables.whole(&mut Pass::new(self, ray, to), &mut loss, compiled, &mut tape.preintegrated)?;
            // The ends of piece i are the knots i - 1 and i; padding entries stand at the index of the first end.
            for (piece, ends) in tape.by_table.pieces.iter().enumerate() {
                for (knot, by) in jacobian.knots[piece..].iter_mut().zip(ends) {
                    knot.extinction[channel] += weight * by[3];
                    // A color's derivative is the same in all channels.
                    knot.color += if channel == 0 { weight * by[0] } else { 0.0 };
                }
            }
        }
        Some(radiance)
    }

    fn rows<S: Shade<R>, Q: Rule<R, 3, Segment = S>>(
        &self,
        ray: &IndexRay,
        rule: Q,
        compiled: &CompiledCurve<R, 3>,
        background: [f32; 3],
        (weight, jacobian): (f64, &mut TableJacobian),
        (segments, tape): (&mut Vec<S>, &mut Vec<Entry<R, S>>),
    ) -> Radiance {
        tape.clear();
        let all = <R::Lanes as Lanes<R>>::splat;
        let curve = &compiled.curve;
        let mut blend = Blend::new(self, compiled, rule, segments);
        compositing::record(&self.field.topology, ray, Adjoint::Tape, &mut blend, tape);
        let extinction = weight * self.medium.extinction;
        let transmittance = (-blend.depth).exp();
        let mut incoming = background.map(|b| transmittance * f64::from(b));
        let mut after = transmittance;
        for Entry { segment, optics, transmittance: before } in tape.iter().rev() {
            let piece = curve.piece(segment.piece());
            // A curve has one piece more than the table has knots: none lies outside.
            let (below, above) = jacobian.knots.split_at_mut(segment.piece() as usize + 1);
            let (Some(low), Some(high)) = (below.last_mut(), above.first_mut()) else { continue };
            let absorbed = before - after;
            let fraction = all(piece.fraction(R::ZERO)) + segment.densities() * all(piece.fraction_slope());
            // Of the light that arrives, the upper knot's share.
            let emitted = absorbed * piece.fraction(optics.mean).f64()
                + (R::of(*before) * optics.varied * piece.fraction_slope()).f64();
            high.color += weight * emitted;
            low.color += weight * (absorbed - emitted);
            let mut add = |channel: usize, slope: R, by: SegmentCotangent<R>| {
                let by_extinction = segment.vjp(piece, optics, slope, by).extinction;
                let (both, upper) = (by_extinction.sum().f64(), (by_extinction * fraction).sum().f64());
                low.extinction[channel] += extinction * (both - upper);
                high.extinction[channel] += extinction * upper;
            };
            for (c, incoming) in incoming.iter_mut().enumerate() {
                let mut only = [0.0; 3];
                only[c] = 1.0;
                let source = SegmentSource::new(piece, optics.mean, &only);
                let by = SegmentCotangent {
                    depth: R::of(source.mean * after - *incoming),
                    mean: R::of(absorbed),
                    varied: R::of(*before),
                };
                add(c, R::of(source.slope), by);
                *incoming += arriving(source, optics, *before, after);
            }
            let by = SegmentCotangent { depth: R::of(transmittance), mean: R::ZERO, varied: R::ZERO };
            add(3, R::ZERO, by);
            after = *before;
        }
        blend.radiance(compiled)
    }
}

impl<R: Precision> Composited<Dvr<'_, R>> {
    /// Returns the pixel of a world ray of unit direction. Adds to `jacobian`, which must have as many knots as the
    /// transfer function, `weight` times its derivatives with respect to the values at the knots; see
    /// `Dvr::table_jacobian`.
    pub fn table_jacobian(&self, ray: &Ray, weight: f64, jacobian: &mut TableJacobian, tape: &mut Tape<R>) -> Pixel<R> {
        self.composite(&self.medium.table_jacobian(ray, self.background, (weight, jacobian), tape))
    }
}
