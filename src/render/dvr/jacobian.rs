//! All channels' derivatives with respect to a transfer function's knots in one backward walk: a row of the
//! normal equations. The recursion of [`adjoint`](super::adjoint), for each channel in turn but with what the channels
//! share taken once: the derivative by a color is that channel's alone and the same for all, and that of alpha by an
//! optical depth is the ray's transmittance.

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

/// Derivatives of a pixel by one knot.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ByKnot {
    /// Of red, green, blue and alpha by its extinction.
    pub extinction: [f64; 4],
    /// Of each channel by its own color.
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
    /// With one before the first knot and one behind the last, which the outermost pieces do not depend on.
    knots: Vec<ByKnot>,
}

impl TableJacobian {
    /// Zero for each of so many knots.
    pub fn zeros(knots: usize) -> Self {
        Self { knots: vec![ByKnot::default(); knots + 2] }
    }

    /// Forgets all derivatives.
    pub fn forget(&mut self) {
        self.knots.fill(ByKnot::default());
    }

    /// SegmentCotangent knot.
    pub fn by_knot(&self) -> &[ByKnot] {
        &self.knots[1..self.knots.len() - 1]
    }
}

impl<R: Precision> Dvr<'_, R> {
    /// Radiance along a world ray of unit direction, and `weight` times the derivatives of the pixel that it makes over the
    /// background, with respect to the values at the transfer function's knots, which are added to `jacobian`, made for as
    /// many. For pre-integration both are
    /// those of what it approaches; media without a transfer function have no derivatives.
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
    /// What a world ray of unit direction shows, and `weight` times its derivatives with respect to the values at the
    /// transfer function's knots, which are added to `jacobian`, made for as many; as
    /// [`Dvr::table_jacobian`].
    pub fn table_jacobian(&self, ray: &Ray, weight: f64, jacobian: &mut TableJacobian, tape: &mut Tape<R>) -> Pixel<R> {
        self.composite(&self.integrator.table_jacobian(ray, self.background, (weight, jacobian), tape))
    }
}
