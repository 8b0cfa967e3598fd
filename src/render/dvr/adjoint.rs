//! The gradient of a loss on one pixel with respect to everything along its ray.
//!
//! Let `x_i` be the optical depth of segment i, `c_i` its source at the mean density and `s_i q_i` what
//! varies of its light ([`shade`](super::shade)), `T_i` the transmittance before it and `V_i` the radiance
//! that arrives from behind it, background included, at the eye. From the far end:
//!
//! ```text
//! V ← T_N · background
//! for i = N-1 … 0:   ∂L/∂x_i = c_i T_{i+1} - V    ∂L/∂c_i = T_i - T_{i+1}    ∂L/∂q_i = s_i T_i
//!                    V ← V + c_i (T_i - T_{i+1}) + s_i T_i q_i
//! ```
//! and from there by [`Shade::vjp`] to the densities. No division by `1 - α`: finite for opaque segments,
//! where inverting the blend (Weiss & Westermann 2021, sect. 4.3; here [`Adjoint::Inversion`]) is 0/0.
//!
//! All channels share the transmittance, so the recursion runs once, on the loss-weighted radiance:
//! with `g` the loss derivative, `V = Σ g_c L_c + g_T T`.

use super::blend::{Blend, Entry, arriving};
use super::jump::Jump;
use super::preintegrated::VoxelSeeds;
use super::segment_derivatives::SegmentDerivatives;
use super::shade::{SegmentCotangent, SegmentOptics, SegmentSource};
use super::tape::Tape;
use super::{CompiledCurve, CompiledMedium, Dvr, Precision};
use crate::math::Ray;
use crate::real::Lanes;
use crate::real::Real;
use crate::render::cell::scatter;
use crate::render::compositing::{self, Backward};
use crate::render::curve::Piece;
use crate::render::differentiable::{Accumulators, Adjoint, Cotangent, Loss};
use crate::render::emission_absorption::Radiance;
use crate::render::index_ray_gradient::IndexRayGradient;
use crate::render::march::{IndexRay, Span};
use crate::render::quadrature::{ExactDepth, Rule};
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
            let radiance = Radiance::default();
            loss(&radiance);
            return radiance;
        };
        let mut pass = Pass::new(self, ray, to);
        if let CompiledMedium::Table(compiled, Some(tables)) = &self.compiled
            && let Some(radiance) = tables.gradient(&mut pass, loss, adjoint, compiled, &mut tape.preintegrated)
        {
            return radiance;
        }
        // Rare variants are compiled once, not for each instruction set.
        if self.uniform(&pass.ray).is_some() || adjoint == Adjoint::Inversion {
            return R::stepped(&mut pass, loss, adjoint, tape);
        }
        // Averaged weights of cells cannot be differentiated with respect to the ray.
        if let (Source::Grey(color), None) = (&self.medium.source, &pass.to.ray) {
            return pass.absorption((loss, adjoint), ExactDepth, *color, &mut tape.cells);
        }
        let scratch = (&mut tape.chords, &mut tape.chord_entries);
        match &self.compiled {
            CompiledMedium::Line(compiled) => {
                pass.recursion((loss, adjoint), self.exact_source(compiled, false), compiled, scratch)
            }
            CompiledMedium::Table(compiled, _) => {
                // Where it is clear, light depends on the function, and on densities that make it less so.
                let clear = pass.to.table.is_some() || self.by_voxels && pass.to.voxels.is_some();
                let rule = self.exact_source(compiled, clear);
                pass.recursion((loss, adjoint), rule, compiled, scratch)
            }
        }
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
    pending: Option<(usize, [R::Lanes; 2])>,
    /// Derivatives with respect to the ray, in index space.
    pub(super) by_ray: IndexRayGradient,
    /// Directions in voxels along which pre-integration adds derivatives, for its forward mode.
    pub(super) voxel_seeds: Option<VoxelSeeds<'p, R>>,
}

impl<'p, 'a, R: Real> Pass<'p, 'a, R> {
    pub(super) fn new(dvr: &'p Dvr<'a, R>, ray: IndexRay, to: Accumulators<'p, R>) -> Self {
        Self { dvr, ray, to, pending: None, by_ray: IndexRayGradient::default(), voxel_seeds: None }
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
        (loss, adjoint): (Loss<'_, R>, Adjoint),
        rule: Q,
        compiled: &CompiledCurve<R, C>,
        (segments, tape): (&mut Vec<S>, &mut Vec<Entry<R, S>>),
    ) -> Radiance {
        tape.clear();
        let (topology, ray) = (self.topology(), self.ray);
        let mut blend = Blend::new(self.dvr, compiled, rule, segments);
        let last = compositing::record(topology, &ray, adjoint, &mut blend, tape);
        let (radiance, emitted) = (blend.radiance(compiled), blend.emitted);
        let weighted = self.add_color(loss(&radiance), &emitted, &compiled.tint);
        let transmittance = radiance.transmittance();
        let incoming = transmittance * weighted.transmittance;
        let mut segments = SegmentGradients { pass: self, compiled, rule, weighted };
        segments.add_exit(transmittance);
        let mut back = Recursion { incoming, depth: radiance.depth, transmittance, scratch: blend.segments, segments };
        compositing::backward(topology, &ray, (adjoint, last), &mut back, tape);
        let Recursion { incoming, mut segments, .. } = back;
        segments.add_entry(incoming);
        self.finish();
        radiance
    }

    /// Adds the gradient with respect to the source's color; returns the loss weights that the recursion needs.
    #[inline(always)]
    pub(super) fn add_color<const C: usize>(
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
            self.finish_ray();
        }
    }
}

/// Derivatives of a ray's segments, added one by one to the gradient accumulators.
pub(super) struct SegmentGradients<'r, 'p, 'a, R: Real, Q, const C: usize> {
    pub pass: &'r mut Pass<'p, 'a, R>,
    pub compiled: &'r CompiledCurve<R, C>,
    pub rule: Q,
    pub weighted: Weighted<C>,
}

impl<R: Real, S: SegmentDerivatives<R>, Q: Rule<R, C, Segment = S>, const C: usize>
    SegmentGradients<'_, '_, '_, R, Q, C>
{
    /// Returns the piece of the curve in which a segment lies.
    #[inline(always)]
    pub(crate) fn piece(&self, segment: &S) -> &Piece<R, C> {
        self.compiled.curve.piece(segment.piece())
    }

    /// Returns the loss-weighted source along a segment.
    #[inline(always)]
    pub(crate) fn source(&self, segment: &S, optics: &SegmentOptics<R>) -> SegmentSource {
        SegmentSource::new(self.piece(segment), optics.mean, &self.weighted.color)
    }

    /// Adds the derivatives of one segment; `slope` is that of its loss-weighted source with the density.
    #[inline(always)]
    pub(crate) fn add(&mut self, segment: &S, optics: &SegmentOptics<R>, slope: R, by: SegmentCotangent<R>) {
        let piece = self.compiled.curve.piece(segment.piece());
        let pass = &mut *self.pass;
        let extinction = pass.dvr.medium.extinction;
        let gradient = segment.vjp(piece, optics, slope, by);
        // Extinction and length enter as their product alone.
        pass.to.shared.extinction += (gradient.length * segment.length()).f64() / extinction;
        if pass.to.voxels.is_some() {
            let [near, far] = segment.voxel_vjp(gradient.density);
            let offset = segment.offset();
            match &mut pass.pending {
                Some((waiting, [a, b])) if *waiting == offset => (*a, *b) = (*a + near, *b + far),
                _ => {
                    pass.flush();
                    pass.pending = Some((offset, [near, far]));
                }
            }
        }
        if let Some(table) = pass.to.table.as_deref_mut() {
            let all = <R::Lanes as Lanes<R>>::splat;
            let fraction = all(piece.fraction(R::ZERO)) + segment.densities() * all(piece.fraction_slope());
            let upper = (gradient.extinction * fraction).sum().f64();
            let both = gradient.extinction.sum().f64();
            let by_mean = by.mean.f64();
            let emitted = by_mean * piece.fraction(optics.mean).f64()
                + (by.varied * optics.varied * piece.fraction_slope()).f64();
            let [low, high] = &mut table.pieces[segment.piece() as usize];
            for c in 0..3 {
                low[c] += self.weighted.rgb[c] * (by_mean - emitted);
                high[c] += self.weighted.rgb[c] * emitted;
            }
            low[3] += extinction * (both - upper);
            high[3] += extinction * upper;
        }
        if self.pass.to.ray.is_some() {
            self.add_ray(segment, &gradient);
        }
    }

    /// Adds the derivatives of moving one end of a segment where the transfer function jumps, given the transmittance
    /// there and the loss-weighted radiance that arrives from behind it.
    #[inline(always)]
    pub(crate) fn add_jump(&mut self, (segment, end): (&S, End), transmittance: f64, incoming: f64) {
        let pass = &mut *self.pass;
        let Some(jump) = Jump::find(&self.compiled.curve, &pass.dvr.field.values, &pass.ray, segment, end) else {
            return;
        };
        let [own, more] = jump.gains(&self.weighted.color, transmittance, incoming);
        if let Some(voxels) = pass.to.voxels.as_deref_mut() {
            scatter(voxels, jump.place.offset, R::of(-own), &jump.place.weights());
        }
        if let Some(table) = pass.to.table.as_deref_mut() {
            table.steps[jump.knot] += more;
        }
        if pass.to.ray.is_some() {
            pass.by_ray.shift -= own * jump.slopes;
            pass.by_ray.turn -= own * jump.place.position * jump.slopes;
        }
    }
}

/// State of the division-free recursion.
struct Recursion<'r, 'p, 'a, R: Real, S, Q, const C: usize> {
    segments: SegmentGradients<'r, 'p, 'a, R, Q, C>,
    /// Segments of one batch that is computed a second time.
    scratch: &'r mut Vec<S>,
    /// Loss-weighted radiance from behind the current segment, as it arrives at the eye.
    incoming: f64,
    /// Optical depth from the eye to the segment's far end.
    depth: f64,
    /// Transmittance from the eye to the segment's far end.
    transmittance: f64,
}

impl<R: Real, S: SegmentDerivatives<R>, Q: Rule<R, C, Segment = S>, const C: usize> Recursion<'_, '_, '_, R, S, Q, C> {
    #[inline(always)]
    fn step(&mut self, segment: &S, optics: &SegmentOptics<R>) {
        let source = self.segments.source(segment, optics);
        self.segments.add_jump((segment, End::Far), self.transmittance, self.incoming);
        // Not from the tape: replay, which has none, must agree bit for bit.
        self.depth -= optics.depth.f64();
        let before = (-self.depth).exp();
        let by = SegmentCotangent {
            depth: R::of(source.mean * self.transmittance - self.incoming),
            mean: R::of(before - self.transmittance),
            varied: R::of(before),
        };
        self.segments.add(segment, optics, R::of(source.slope), by);
        self.incoming += arriving(source, optics, before, self.transmittance);
        self.transmittance = before;
        self.segments.add_jump((segment, End::Near), self.transmittance, self.incoming);
    }
}

impl<R: Real, S: SegmentDerivatives<R>, Q: Rule<R, C, Segment = S>, const C: usize> Backward<R>
    for Recursion<'_, '_, '_, R, S, Q, C>
{
    type Entry = Entry<R, S>;

    #[inline(always)]
    fn add(&mut self, tape: &[Entry<R, S>]) {
        for entry in tape.iter().rev() {
            self.step(&entry.segment, &entry.optics);
        }
    }

    #[inline(always)]
    fn replay(&mut self, spans: &[Span<R>], _: &mut Vec<Entry<R, S>>) {
        let SegmentGradients { pass, compiled, rule, .. } = &self.segments;
        self.scratch.clear();
        rule.segments(&compiled.curve, &pass.dvr.field.values, spans, self.scratch);
        for k in (0..self.scratch.len()).rev() {
            let segment = self.scratch[k];
            let optics = segment.segment_optics(self.segments.piece(&segment));
            self.step(&segment, &optics);
        }
    }
}
