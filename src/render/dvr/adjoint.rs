//! The gradient of a loss on one pixel with respect to everything along its ray.
//!
//! Let `x_i` be the optical depth of segment i, `c_i` its source at the mean density and `s_i q_i` what
//! varies of its light ([`shade`](super::shade)), `T_i` the transmittance before it and `V_i` the radiance
//! from beyond it, background included, as it arrives at the eye. From the far end:
//!
//! ```text
//! V ← T_N · background
//! for i = N-1 … 0:   ∂L/∂x_i = c_i T_{i+1} - V    ∂L/∂c_i = T_i - T_{i+1}    ∂L/∂q_i = s_i T_i
//!                    V ← V + c_i (T_i - T_{i+1}) + s_i T_i q_i
//! ```
//! and from there by [`Shade::slopes`] to the densities. No division by `1 - α`: finite for opaque segments,
//! where inverting the blend (Weiss & Westermann 2021, sect. 4.3; here [`Adjoint::Inversion`]) is 0/0.
//!
//! All channels share the transmittance, so the recursion runs once, on the loss-weighted radiance:
//! with `g` the loss derivative, `V = Σ g_c L_c + g_T T`.

use super::blend::Blend;
use super::blend::Entry;
use super::jump::Jump;
use super::kernel::{self, arriving, grey};
use super::segment_derivatives::SegmentDerivatives;
use super::shade::{SegmentCotangent, SegmentOptics, SegmentSource};
use super::tape::Tape;
use super::{CompiledCurve, CompiledMedium, Dvr, Precision};
use crate::math::Ray;
use crate::real::Lanes;
use crate::real::Real;
use crate::render::cell::{Quartet, scatter};
use crate::render::curve::{Curve, Piece};
use crate::render::differentiable::{Accumulators, Adjoint, Cotangent, Loss};
use crate::render::index_ray_gradient::IndexRayGradient;
use crate::render::integrator::Radiance;
use crate::render::march::{IndexRay, batches_before};
use crate::render::rule::{DepthRule, ExactDepth, Rule};
use crate::render::segment::End;
use crate::scene::bricks::Topology;
use crate::scene::medium::Source;

impl<R: Precision> Dvr<'_, R> {
    #[inline(always)]
    pub(super) fn gradient_with(
        &self,
        ray: &Ray,
        loss: Loss<'_, R>,
        adjoint: Adjoint,
        to: Accumulators<'_, R>,
        tape: &mut Tape<R>,
    ) -> Radiance {
        let Some(ray) = self.index_ray(ray) else {
            let light = Radiance::default();
            loss(&light);
            return light;
        };
        let mut pass = Pass::new(self, ray, to);
        // The paper's inversion is left to the rule that pre-integration approaches.
        if let CompiledMedium::Table(optics, Some(tables)) = &self.compiled
            && adjoint != Adjoint::Inversion
        {
            return tables.gradient(&mut pass, loss, adjoint, optics, &mut tape.preintegrated);
        }
        // What is not asked for in earnest is compiled once, not for each instruction set.
        if self.uniform(&pass.ray).is_some() || adjoint == Adjoint::Inversion {
            return R::stepped(&mut pass, loss, adjoint, tape);
        }
        if let (Source::Grey(color), None) = (&self.medium.source, &pass.to.ray) {
            return pass.depth_only(loss, adjoint, ExactDepth, *color, &mut tape.cells);
        }
        let Tape { chords, lit_chords, .. } = tape;
        match &self.compiled {
            CompiledMedium::Line(optics) => {
                pass.recursion(loss, adjoint, self.exact_source(optics, false), optics, chords, lit_chords)
            }
            CompiledMedium::Table(optics, _) => {
                let rule = self.exact_source(optics, pass.to.table.is_some());
                pass.recursion(loss, adjoint, rule, optics, chords, lit_chords)
            }
        }
    }

    /// Traces a ray as [`Dvr::trace`] does, inlined for drivers that are compiled for each instruction set.
    #[inline(always)]
    pub(crate) fn trace_with(&self, ray: &Ray, tape: &mut Tape<R>) -> f64 {
        let Some(ray) = self.index_ray(ray) else { return 0.0 };
        kernel::depth(self, &ray, ExactDepth, &mut tape.cells, true).depth
    }
}

/// Derivatives of the loss with respect to a pixel's radiance, in the form that the recursion needs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Weighted<const C: usize> {
    /// Derivatives with respect to red, green and blue.
    pub rgb: [f64; 3],
    /// Derivative with respect to the transmittance.
    pub transmittance: f64,
    /// Derivatives with respect to the channels of the curve.
    pub color: [f64; C],
}

/// One ray's forward and backward pass.
pub struct Pass<'p, 'a, R: Real> {
    pub(super) dvr: &'p Dvr<'a, R>,
    pub(super) ray: IndexRay,
    pub(super) to: Accumulators<'p, R>,
    /// Derivatives with respect to a cell's corners that are not yet scattered: a cell of several pieces is scattered
    /// once.
    pub(super) pending: Option<(usize, [R::Lanes; 2])>,
    pub(super) moved: IndexRayGradient,
}

impl<'p, 'a, R: Real> Pass<'p, 'a, R> {
    fn new(dvr: &'p Dvr<'a, R>, ray: IndexRay, to: Accumulators<'p, R>) -> Self {
        Self { dvr, ray, to, pending: None, moved: IndexRayGradient::default() }
    }

    /// Computes the gradient for grey sources, which depends on one derivative for the whole ray, that of the optical
    /// depth.
    #[inline(always)]
    pub(super) fn depth_only<Q: DepthRule<R>>(
        &mut self,
        loss: Loss<'_, R>,
        adjoint: Adjoint,
        rule: Q,
        color: [f32; 3],
        tape: &mut Vec<Quartet<R>>,
    ) -> Radiance {
        tape.clear();
        let Blend { depth, last, .. } = kernel::depth(self.dvr, &self.ray, rule, tape, adjoint == Adjoint::Tape);
        let seen = grey(depth, color);
        let tint = [color.map(f64::from)];
        let weighted = self.shared(loss(&seen), &[-(-depth).exp_m1()], &tint);
        // ∂L/∂depth: more depth replaces background by source.
        let slope = (-depth).exp() * (weighted.color[0] - weighted.transmittance);
        let g = R::of(slope * self.dvr.medium.extinction);
        self.to.shared.extinction += slope * depth / self.dvr.medium.extinction;
        let Some(gradient) = self.to.voxels.as_deref_mut() else { return seen };
        let mut back = |tape: &mut Vec<Quartet<R>>| tape.drain(..).rev().for_each(|cells| cells.scatter(gradient, g));
        back(tape);
        if adjoint == Adjoint::Replay {
            batches_before(
                &self.dvr.field.topology,
                &self.ray,
                last,
                #[inline(always)]
                |spans| {
                    rule.cells(spans, tape);
                    back(tape);
                },
            );
        }
        seen
    }

    /// Returns the bricks that rays visit. All of the field's for a gradient with respect to the transfer function,
    /// which does not vanish where the medium is clear; else the visible ones.
    #[inline(always)]
    pub(super) fn topology(&self) -> &'p Topology {
        if self.to.table.is_some() { &self.dvr.field.topology } else { &self.dvr.visible }
    }

    /// Runs the recursion of this module's header, for sources that vary.
    #[inline(always)]
    pub(super) fn recursion<S: SegmentDerivatives<R>, Q: Rule<R, C, Segment = S>, const C: usize>(
        &mut self,
        loss: Loss<'_, R>,
        adjoint: Adjoint,
        rule: Q,
        optics: &CompiledCurve<R, C>,
        segments: &mut Vec<S>,
        tape: &mut Vec<Entry<R, S>>,
    ) -> Radiance {
        tape.clear();
        let keep = adjoint != Adjoint::Replay;
        let (dvr, ray, curve) = (self.dvr, self.ray, &optics.curve);
        let topology = self.topology();
        let blend = kernel::blend(
            dvr,
            topology,
            &ray,
            rule,
            curve,
            segments,
            #[inline(always)]
            |found| match found {
                Some(entry) => tape.push(entry),
                None if !keep => tape.clear(),
                None => (),
            },
        );
        let transmittance = (-blend.depth).exp();
        let seen = Radiance { rgb: optics.tinted(&blend.emitted), depth: blend.depth };
        let weighted = self.shared(loss(&seen), &blend.emitted, &optics.tint);
        let mut back = Backward {
            beyond: transmittance * weighted.transmittance,
            depth: blend.depth,
            open: transmittance,
            weighted,
        };
        if self.to.ray.is_some() && Q::BOUNDED {
            self.moved.leave = transmittance * self.gain(optics, ray.leave, weighted.transmittance, &weighted);
        }
        for entry in tape.iter().rev() {
            back.step(self, curve, rule, &entry.segment, &entry.light);
        }
        if adjoint == Adjoint::Replay {
            batches_before(
                topology,
                &ray,
                blend.last,
                #[inline(always)]
                |spans| {
                    segments.clear();
                    rule.segments(curve, &dvr.field.values, spans, segments);
                    for segment in segments.iter().rev() {
                        let light = segment.light(curve.piece(segment.piece()));
                        back.step(self, curve, rule, segment, &light);
                    }
                },
            );
        }
        if self.to.ray.is_some() && Q::BOUNDED {
            self.moved.enter = -self.gain(optics, ray.enter, back.beyond, &weighted);
        }
        self.finish();
        seen
    }

    /// Adds the gradient with respect to the source's color; returns the loss weights that the recursion needs.
    #[inline(always)]
    pub(super) fn shared<const C: usize>(
        &mut self,
        by: Cotangent<R>,
        emitted: &[f64; C],
        tint: &[[f64; 3]; C],
    ) -> Weighted<C> {
        let rgb = by.rgb.map(Real::f64);
        let mut weighted = Weighted { rgb, transmittance: by.transmittance, color: [0.0; C] };
        let shared = &mut *self.to.shared;
        for c in 0..3 {
            for (weight, tint) in weighted.color.iter_mut().zip(tint) {
                *weight += rgb[c] * tint[c];
            }
            if C == 1 {
                shared.color[c] += rgb[c] * emitted[0];
            }
        }
        weighted
    }

    /// Adds the derivatives of one segment to the gradient accumulators.
    #[inline(always)]
    pub(super) fn deposit<S: SegmentDerivatives<R>, Q: Rule<R, C, Segment = S>, const C: usize>(
        &mut self,
        rule: Q,
        line: &Piece<R, C>,
        (segment, light): (&S, &SegmentOptics<R>),
        slope: R,
        by: SegmentCotangent<R>,
        weighted: &Weighted<C>,
    ) {
        let extinction = self.dvr.medium.extinction;
        let slopes = segment.slopes(line, light, slope, by);
        self.to.shared.extinction += (slopes.length * segment.length()).f64() / extinction;
        if self.to.voxels.is_some() {
            let [near, far] = segment.spread(slopes.density);
            let offset = segment.offset();
            match &mut self.pending {
                Some((waiting, [a, b])) if *waiting == offset => (*a, *b) = (*a + near, *b + far),
                _ => {
                    self.flush();
                    self.pending = Some((offset, [near, far]));
                }
            }
        }
        if let Some(table) = self.to.table.as_deref_mut() {
            let all = <R::Lanes as Lanes<R>>::splat;
            let fraction = all(line.fraction(R::ZERO)) + segment.densities() * all(line.fraction_slope());
            let upper = (slopes.extinction * fraction).sum().f64();
            let both = slopes.extinction.sum().f64();
            let by_mean = by.mean.f64();
            let lit =
                by_mean * line.fraction(light.mean).f64() + (by.varied * light.varied * line.fraction_slope()).f64();
            let [low, high] = &mut table.pieces[segment.piece() as usize];
            for c in 0..3 {
                low[c] += weighted.rgb[c] * (by_mean - lit);
                high[c] += weighted.rgb[c] * lit;
            }
            low[3] += extinction * (both - upper);
            high[3] += extinction * upper;
        }
        if self.to.ray.is_some() {
            self.follow(rule, segment, &slopes);
        }
    }

    /// Adds the derivatives of moving one end of a segment where the transfer function jumps, given the transmittance
    /// there and the loss-weighted radiance that arrives from behind it.
    #[inline(always)]
    pub(super) fn jump<S: SegmentDerivatives<R>, const C: usize>(
        &mut self,
        curve: &Curve<R, C>,
        (segment, end): (&S, End),
        [open, beyond]: [f64; 2],
        weighted: &Weighted<C>,
    ) {
        let Some(jump) = Jump::find(curve, &self.dvr.field.values, &self.ray, segment, end) else { return };
        let [own, more] = jump.gains(&weighted.color, open, beyond);
        if let Some(voxels) = self.to.voxels.as_deref_mut() {
            scatter(voxels, jump.place.offset, R::of(-own), &jump.place.weights());
        }
        if let Some(table) = self.to.table.as_deref_mut() {
            table.steps[jump.knot] += more;
        }
        if self.to.ray.is_some() {
            self.moved.shift -= own * jump.slopes;
            self.moved.turn -= own * jump.place.position * jump.slopes;
        }
    }

    /// Scatters the pending derivatives.
    #[inline(always)]
    fn flush(&mut self) {
        if let (Some((offset, weights)), Some(voxels)) = (self.pending.take(), self.to.voxels.as_deref_mut()) {
            scatter(voxels, offset, R::ONE, &weights);
        }
    }

    /// Scatters the pending derivatives, and transforms the ray's derivatives to world space.
    #[inline(always)]
    pub(super) fn finish(&mut self) {
        self.flush();
        if self.to.ray.is_some() {
            self.hand_over();
        }
    }
}

/// State of the division-free recursion.
struct Backward<const C: usize> {
    /// Loss-weighted radiance from behind the current segment, as it arrives at the eye.
    beyond: f64,
    /// Optical depth from the eye to the segment's far end; `open` is the transmittance.
    depth: f64,
    open: f64,
    weighted: Weighted<C>,
}

impl<const C: usize> Backward<C> {
    #[inline(always)]
    fn step<R: Real, S: SegmentDerivatives<R>, Q: Rule<R, C, Segment = S>>(
        &mut self,
        pass: &mut Pass<'_, '_, R>,
        curve: &Curve<R, C>,
        rule: Q,
        segment: &S,
        light: &SegmentOptics<R>,
    ) {
        let line = curve.piece(segment.piece());
        let glow = SegmentSource::new(line, light.mean, &self.weighted.color);
        pass.jump(curve, (segment, End::Far), [self.open, self.beyond], &self.weighted);
        // Not as the tape has it: replay is to find the same.
        self.depth -= light.depth.f64();
        let before = (-self.depth).exp();
        let by = SegmentCotangent {
            depth: R::of(glow.mean * self.open - self.beyond),
            mean: R::of(before - self.open),
            varied: R::of(before),
        };
        pass.deposit(rule, line, (segment, light), R::of(glow.slope), by, &self.weighted);
        self.beyond += arriving(glow, light, before, self.open);
        self.open = before;
        pass.jump(curve, (segment, End::Near), [self.open, self.beyond], &self.weighted);
    }
}
