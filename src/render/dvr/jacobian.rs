//! Derivatives of all channels with respect to a transfer function's knots in one backward walk: a row of the normal
//! equations. The recursion of [`adjoint`](super::adjoint) runs for each channel in turn; terms that the channels share
//! are computed once: the derivative with respect to a color affects its own channel alone and is equal for all, and
//! that of alpha with respect to an optical depth is the ray's transmittance.

use super::blend::Entry;
use super::kernel;
use super::shade::{SegmentCotangent, SegmentSource, Shade};
use super::tape::Tape;
use super::{CompiledCurve, CompiledMedium, Dvr, Precision};
use crate::math::Ray;
use crate::real::Lanes;
use crate::render::composited::{Composited, Pixel};
use crate::render::integrator::{Integrator, Radiance};
use crate::render::march::IndexRay;
use crate::render::rule::Rule;

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
    /// `jacobian` must have as many knots as the function. With pre-integration, radiance and derivatives are those of
    /// the exact quadrature that it approximates. Without a transfer function nothing is added.
    pub fn table_jacobian(
        &self,
        ray: &Ray,
        background: [f32; 3],
        (weight, jacobian): (f64, &mut TableJacobian),
        tape: &mut Tape<R>,
    ) -> Radiance {
        let (CompiledMedium::Table(optics, _), Some(ray)) = (&self.compiled, self.index_ray(ray)) else {
            return self.li(ray, tape);
        };
        let Tape { samples, chords, lit_samples, lit_chords, .. } = tape;
        match self.uniform(&ray) {
            Some(rule) => self.rows(&ray, rule, optics, background, (weight, jacobian), (samples, lit_samples)),
            None => {
                let rule = self.exact_source(optics, true);
                self.rows(&ray, rule, optics, background, (weight, jacobian), (chords, lit_chords))
            }
        }
    }

    fn rows<S: Shade<R>, Q: Rule<R, 3, Segment = S>>(
        &self,
        ray: &IndexRay,
        rule: Q,
        optics: &CompiledCurve<R, 3>,
        background: [f32; 3],
        (weight, jacobian): (f64, &mut TableJacobian),
        (segments, tape): (&mut Vec<S>, &mut Vec<Entry<R, S>>),
    ) -> Radiance {
        tape.clear();
        let all = <R::Lanes as Lanes<R>>::splat;
        let (curve, topology) = (&optics.curve, &self.field.topology);
        let blend = kernel::blend(self, topology, ray, rule, curve, segments, |found| {
            tape.extend(found);
        });
        let extinction = weight * self.medium.extinction;
        let closed = (-blend.depth).exp();
        let mut beyond = background.map(|b| closed * f64::from(b));
        let mut after = closed;
        for Entry { segment, light, open } in tape.iter().rev() {
            let line = curve.piece(segment.piece());
            // A curve has one piece more than the table has knots: none lies outside.
            let (below, above) = jacobian.knots.split_at_mut(segment.piece() as usize + 1);
            let (Some(low), Some(high)) = (below.last_mut(), above.first_mut()) else { continue };
            let absorbed = open - after;
            let fraction = all(line.fraction(R::ZERO)) + segment.densities() * all(line.fraction_slope());
            // Of the light that arrives, the upper knot's share.
            let lit = absorbed * line.fraction(light.mean).f64()
                + (R::of(*open) * light.varied * line.fraction_slope()).f64();
            high.color += weight * lit;
            low.color += weight * (absorbed - lit);
            let mut add = |channel: usize, slope: R, by: SegmentCotangent<R>| {
                let slopes = segment.slopes(line, light, slope, by).extinction;
                let (both, upper) = (slopes.sum().f64(), (slopes * fraction).sum().f64());
                low.extinction[channel] += extinction * (both - upper);
                high.extinction[channel] += extinction * upper;
            };
            for (c, beyond) in beyond.iter_mut().enumerate() {
                let mut only = [0.0; 3];
                only[c] = 1.0;
                let glow = SegmentSource::new(line, light.mean, &only);
                let by = SegmentCotangent {
                    depth: R::of(glow.mean * after - *beyond),
                    mean: R::of(absorbed),
                    varied: R::of(*open),
                };
                add(c, R::of(glow.slope), by);
                *beyond += kernel::arriving(glow, light, *open, after);
            }
            let by = SegmentCotangent { depth: R::of(closed), mean: R::ZERO, varied: R::ZERO };
            add(3, R::ZERO, by);
            after = *open;
        }
        Radiance { rgb: optics.tinted(&blend.emitted), depth: blend.depth }
    }
}

impl<R: Precision> Composited<Dvr<'_, R>> {
    /// Returns the pixel of a world ray of unit direction. Adds to `jacobian`, which must have as many knots as the
    /// transfer function, `weight` times its derivatives with respect to the values at the knots; see
    /// [`Dvr::table_jacobian`].
    pub fn table_jacobian(&self, ray: &Ray, weight: f64, jacobian: &mut TableJacobian, tape: &mut Tape<R>) -> Pixel<R> {
        self.composite(&self.integrator.table_jacobian(ray, self.background, (weight, jacobian), tape))
    }
}
