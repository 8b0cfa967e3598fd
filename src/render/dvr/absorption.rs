//! Grey sources: the picture depends on a ray's optical depth alone, `L = c (1 - T)`.

use super::adjoint::Pass;
use super::{Dvr, Tape};
use crate::math::Ray;
use crate::real::Lanes;
use crate::real::Real;
use crate::render::cell::Quartet;
use crate::render::compositing::{self, Backward, Compositing};
use crate::render::differentiable::{Adjoint, Loss};
use crate::render::emission_absorption::Radiance;
use crate::render::march::{IndexRay, Span};
use crate::render::quadrature::{DepthRule, ExactDepth};

/// Returns the radiance `L = c (1 - T)` of a grey source.
#[inline(always)]
pub(super) fn grey(depth: f64, color: [f32; 3]) -> Radiance {
    let opacity = -(-depth).exp_m1();
    Radiance { rgb: color.map(|c| f64::from(c) * opacity), depth }
}

/// Cells, in fours, that are summed in `R`: no fewer than a batch of bricks has. Samples may be many more, and the sum
/// of thousands of equal numbers drifts in single precision.
const SUMMED: usize = 64;

/// The optical depth of a ray as it is summed: a few cells in `R`, all in `f64`.
pub(super) struct OpticalDepth<'d, R: Real, Q> {
    dvr: &'d Dvr<'d, R>,
    rule: Q,
    /// Integral of the density up to here.
    integral: f64,
    /// Integral of the density at which the ray ends.
    limit: f64,
}

impl<'d, R: Real, Q: DepthRule<R>> OpticalDepth<'d, R, Q> {
    #[inline(always)]
    fn new(dvr: &'d Dvr<'_, R>, rule: Q) -> Self {
        Self { dvr, rule, integral: 0.0, limit: dvr.depth_limit / dvr.medium.extinction }
    }

    /// Returns the optical depth of a whole ray.
    #[inline(always)]
    pub(crate) fn of(dvr: &'d Dvr<'_, R>, ray: &IndexRay, rule: Q, scratch: &mut Vec<Quartet<R>>) -> f64 {
        Self::up_to(dvr.depth_limit, dvr, ray, rule, scratch)
    }

    /// Returns the optical depth of a ray that ends after the batch in which it exceeds `limit`.
    #[inline(always)]
    pub(crate) fn up_to(
        limit: f64,
        dvr: &'d Dvr<'_, R>,
        ray: &IndexRay,
        rule: Q,
        scratch: &mut Vec<Quartet<R>>,
    ) -> f64 {
        let mut sum = Self { limit: limit / dvr.medium.extinction, ..Self::new(dvr, rule) };
        compositing::value(&dvr.field.topology, ray, &mut sum, scratch);
        sum.depth()
    }

    /// Returns the optical depth of a whole ray, and appends its cells to the tape.
    #[inline(always)]
    pub(crate) fn traced(dvr: &'d Dvr<'_, R>, ray: &IndexRay, rule: Q, tape: &mut Vec<Quartet<R>>) -> f64 {
        let mut sum = Self::new(dvr, rule);
        compositing::record(&dvr.field.topology, ray, Adjoint::Tape, &mut sum, tape);
        sum.depth()
    }

    #[inline(always)]
    fn depth(&self) -> f64 {
        self.dvr.medium.extinction * self.integral
    }
}

impl<R: Real, Q: DepthRule<R>> Compositing<R> for OpticalDepth<'_, R, Q> {
    type Entry = Quartet<R>;

    #[inline(always)]
    fn composite<const KEEP: bool>(&mut self, spans: &[Span<R>], tape: &mut Vec<Quartet<R>>) -> bool {
        let first = tape.len();
        self.rule.cells(spans, tape);
        for few in tape[first..].chunks(SUMMED) {
            let mut sum = R::Lanes::splat(R::ZERO);
            for cells in few {
                sum += cells.gather(&self.dvr.field.values);
            }
            self.integral += sum.sum().f64();
        }
        self.integral < self.limit
    }
}

/// Scatters the derivative with respect to the integral of the density, which is one number for the whole ray.
struct Scatter<'g, R, Q> {
    rule: Q,
    by_integral: R,
    gradient: &'g mut [R],
}

impl<R: Real, Q: DepthRule<R>> Backward<R> for Scatter<'_, R, Q> {
    type Entry = Quartet<R>;

    #[inline(always)]
    fn add(&mut self, tape: &[Quartet<R>]) {
        tape.iter().rev().for_each(|cells| cells.scatter(self.gradient, self.by_integral));
    }

    #[inline(always)]
    fn replay(&mut self, spans: &[Span<R>], tape: &mut Vec<Quartet<R>>) {
        self.rule.cells(spans, tape);
        self.add(tape);
    }
}

impl<R: Real> Dvr<'_, R> {
    /// Traces a ray as [`Dvr::trace`] does, inlined for drivers that are compiled for each instruction set.
    #[inline(always)]
    pub(crate) fn trace_with(&self, ray: &Ray, tape: &mut Tape<R>) -> f64 {
        let Some(ray) = self.index_ray(ray) else { return 0.0 };
        OpticalDepth::traced(self, &ray, ExactDepth, &mut tape.cells)
    }
}

impl<R: Real> Pass<'_, '_, R> {
    /// Computes the gradient for a grey source.
    #[inline(always)]
    pub(super) fn absorption<Q: DepthRule<R>>(
        &mut self,
        (loss, adjoint): (Loss<'_, R>, Adjoint),
        rule: Q,
        color: [f32; 3],
        tape: &mut Vec<Quartet<R>>,
    ) -> Radiance {
        tape.clear();
        let topology = &self.dvr.field.topology;
        let mut sum = OpticalDepth::new(self.dvr, rule);
        let last = compositing::record(topology, &self.ray, adjoint, &mut sum, tape);
        let depth = sum.depth();
        let radiance = grey(depth, color);
        let tint = [color.map(f64::from)];
        let weighted = self.add_color(loss(&radiance), &[-(-depth).exp_m1()], &tint);
        // More depth replaces background by source.
        let by_depth = (-depth).exp() * (weighted.color[0] - weighted.transmittance);
        self.to.shared.extinction += by_depth * depth / self.dvr.medium.extinction;
        if let Some(gradient) = self.to.voxels.as_deref_mut() {
            let by_integral = R::of(by_depth * self.dvr.medium.extinction);
            let mut scatter = Scatter { rule, by_integral, gradient };
            compositing::backward(topology, &self.ray, (adjoint, last), &mut scatter, tape);
        }
        radiance
    }
}
