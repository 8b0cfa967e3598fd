//! The gradient of a loss on one pixel with respect to everything along its ray.
//!
//! Let `x_i` be the optical depth of segment i, `c_i` its source at the mean density and `s_i q_i` what
//! varies of its light ([`light`](super::light)), `T_i` the transmittance before it and `V_i` the radiance
//! from beyond it, background included, as it arrives at the eye. From the far end:
//!
//! ```text
//! V ← T_N · background
//! for i = N-1 … 0:   ∂L/∂x_i = c_i T_{i+1} - V    ∂L/∂c_i = T_i - T_{i+1}    ∂L/∂q_i = s_i T_i
//!                    V ← V + c_i (T_i - T_{i+1}) + s_i T_i q_i
//! ```
//! and from there by [`Lit::slopes`] to the densities. No division by `1 - α`: finite for opaque segments,
//! where inverting the blend (Weiss & Westermann 2021, sect. 4.3; here [`Adjoint::Inversion`]) is 0/0.
//!
//! All channels share the transmittance, so the recursion runs once, on the loss-weighted radiance:
//! with `g` the loss derivative, `V = Σ g_c L_c - g_α T`.

use super::inversion;
use super::kernel::{self, Blend, arriving, grey, over};
use super::light::{By, Glow, Light, Lit, Slopes};
use super::{Dvr, Matter, Optics, Precision, Radiance};
use crate::lanes::Lanes;
use crate::math::Ray;
use crate::real::Real;
use crate::render::cell::{Quartet, scatter};
use crate::render::curve::{Curve, Piece};
use crate::render::march::{IndexRay, batches_before};
use crate::render::rule::{DepthRule, ExactDepth, Rule, Uniform};
use crate::render::segment::{Chord, Sample};
use crate::scene::bricks::Topology;
use crate::scene::medium::Source;
use crate::scene::table::TableGradient;
use glam::DVec3;

/// How the backward pass gets at the samples of the forward pass again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Adjoint {
    /// A tape of one ray: fast, memory of one ray's samples per thread.
    Tape,
    /// Walk the ray twice, but for its last bricks: memory of one batch of bricks' samples per thread,
    /// any loss.
    Replay,
    /// The paper's inversion of the blend, for comparison: breaks down where a sample is opaque.
    Inversion,
}

/// Derivatives of the loss with respect to the parameters that all rays share, or a step of these.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ParameterGradient {
    /// With respect to the medium's extinction.
    pub extinction: f64,
    /// With respect to the source's colour; zero with a transfer function, which has its own.
    pub colour: [f64; 3],
    /// With respect to the background.
    pub background: [f64; 3],
}

impl ParameterGradient {
    /// Sum of two.
    #[must_use]
    pub fn plus(self, o: &Self) -> Self {
        Self {
            extinction: self.extinction + o.extinction,
            colour: std::array::from_fn(|c| self.colour[c] + o.colour[c]),
            background: std::array::from_fn(|c| self.background[c] + o.background[c]),
        }
    }
}

/// Derivatives of the loss with respect to one ray's origin and direction (of unit length: only changes
/// across it mean anything), in world space, and to the quadrature's step; or a change of these.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct RayGradient {
    /// With respect to the origin.
    pub origin: DVec3,
    /// With respect to the direction.
    pub direction: DVec3,
    /// With respect to the step of a quadrature that has one, in voxels.
    pub step: f64,
}

/// Derivative of a loss with respect to R, G, B and alpha at a radiance.
pub type Loss<'l, R> = &'l mut dyn FnMut(&Radiance<R>) -> [R; 4];

/// Where a gradient is added to; what is `None` is not computed.
#[derive(Debug)]
pub struct Sinks<'g, R: Real> {
    /// By stored value, as in [`Bricks::values`](crate::scene::bricks::Bricks::values).
    pub voxels: Option<&'g mut [R]>,
    /// By piece of the transfer function; for media that have one.
    pub table: Option<&'g mut TableGradient>,
    /// Of this ray.
    pub ray: Option<&'g mut RayGradient>,
    /// Of all that rays share.
    pub shared: &'g mut ParameterGradient,
}

/// Scratch memory of one thread, reused from ray to ray.
#[derive(Debug, Clone, Default)]
pub struct Tape<R: Real> {
    /// Cells of rays of which only the depth matters.
    pub(super) cells: Vec<Quartet<R>>,
    /// Segments of a batch.
    pub(super) samples: Vec<Sample<R>>,
    pub(super) chords: Vec<Chord<R>>,
    /// Segments of a ray.
    lit_samples: Vec<Entry<R, Sample<R>>>,
    lit_chords: Vec<Entry<R, Chord<R>>>,
}

impl<R: Real> Tape<R> {
    /// Adds `by_depth · extinction` times the interpolation weights of all traced rays to the stored
    /// values of `gradient`, and forgets the rays.
    #[inline(always)]
    pub fn spread(&mut self, by_depth: f64, dvr: &Dvr<'_, R>, gradient: &mut [R]) {
        let g = R::of(dvr.medium.extinction * by_depth);
        if g != R::ZERO {
            for cells in &self.cells {
                cells.scatter(gradient, g);
            }
        }
        self.forget();
    }

    /// Forgets the rays.
    pub fn forget(&mut self) {
        self.cells.clear();
    }
}

/// A segment with its light.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry<R: Real, S> {
    pub segment: S,
    pub light: Light<R>,
}

impl<R: Precision> Dvr<'_, R> {
    #[inline(always)]
    pub(super) fn gradient_with(
        &self,
        ray: &Ray,
        loss: Loss<'_, R>,
        adjoint: Adjoint,
        sinks: Sinks<'_, R>,
        tape: &mut Tape<R>,
    ) -> Radiance<R> {
        let Some(ray) = self.index_ray(ray) else {
            let seen = grey(0.0, [0.0; 3], self.background);
            let g = loss(&seen);
            for c in 0..3 {
                sinks.shared.background[c] += g[c].f64() * seen.transmittance.f64();
            }
            return seen;
        };
        let mut pass = Pass::new(self, ray, sinks);
        // What is not asked for in earnest is compiled once, not for each instruction set.
        if self.uniform(&pass.ray).is_some() || adjoint == Adjoint::Inversion {
            return R::uncommon(&mut pass, loss, adjoint, tape);
        }
        if let (Source::Grey(colour), None) = (&self.medium.source, &pass.sinks.ray) {
            return pass.depth_only(loss, adjoint, ExactDepth, *colour, &mut tape.cells);
        }
        let Tape { chords, lit_chords, .. } = tape;
        match &self.matter {
            Matter::Line(optics) => {
                pass.recursion(loss, adjoint, self.exact_source(optics, false), optics, chords, lit_chords)
            }
            Matter::Table(optics, _) => {
                let rule = self.exact_source(optics, pass.sinks.table.is_some());
                pass.recursion(loss, adjoint, rule, optics, chords, lit_chords)
            }
        }
    }

    /// [`Dvr::trace`] for drivers that are compiled for each instruction set.
    #[inline(always)]
    pub(crate) fn trace_with(&self, ray: &Ray, tape: &mut Tape<R>) -> f64 {
        let Some(ray) = self.index_ray(ray) else { return 0.0 };
        kernel::depth(self, &ray, ExactDepth, &mut tape.cells, true).depth
    }
}

/// The loss's derivatives, and what they weigh.
#[derive(Debug, Clone, Copy)]
pub(super) struct Weighted<const C: usize> {
    /// By red, green, blue and alpha.
    pub loss: [f64; 4],
    /// `Σ g_c background_c - g_α`.
    pub background: f64,
    /// For each channel of the curve.
    pub colour: [f64; C],
}

/// One ray's forward and backward pass.
pub struct Pass<'p, 'a, R: Real> {
    dvr: &'p Dvr<'a, R>,
    ray: IndexRay,
    sinks: Sinks<'p, R>,
    /// Derivatives that wait: a cell of many pieces is scattered once.
    pending: Option<(usize, [R::Lanes; 2])>,
    moved: Moved,
}

/// Derivatives with respect to where a ray's points lie, in index space.
#[derive(Debug, Clone, Copy, Default)]
struct Moved {
    /// With respect to a shift of all points.
    shift: DVec3,
    /// With respect to a shift that grows with the world length from the origin.
    turn: DVec3,
    /// With respect to the world length at which the ray enters the medium's box, and leaves it.
    enter: f64,
    leave: f64,
    /// With respect to the quadrature's step, in world length.
    step: f64,
}

impl<'p, 'a, R: Real> Pass<'p, 'a, R> {
    fn new(dvr: &'p Dvr<'a, R>, ray: IndexRay, sinks: Sinks<'p, R>) -> Self {
        Self { dvr, ray, sinks, pending: None, moved: Moved::default() }
    }

    /// Grey sources: one derivative for the whole ray.
    #[inline(always)]
    fn depth_only<Q: DepthRule<R>>(
        &mut self,
        loss: Loss<'_, R>,
        adjoint: Adjoint,
        rule: Q,
        colour: [f32; 3],
        tape: &mut Vec<Quartet<R>>,
    ) -> Radiance<R> {
        tape.clear();
        let Blend { depth, last, .. } = kernel::depth(self.dvr, &self.ray, rule, tape, adjoint == Adjoint::Tape);
        let seen = grey(depth, colour, self.dvr.background);
        let tint = [colour.map(f64::from)];
        let weighted = self.shared(loss(&seen), &[-(-depth).exp_m1()], depth, &tint);
        // ∂L/∂depth: more depth replaces background by source.
        let slope = (-depth).exp() * (weighted.colour[0] - weighted.background);
        let g = R::of(slope * self.dvr.medium.extinction);
        self.sinks.shared.extinction += slope * depth / self.dvr.medium.extinction;
        let Some(gradient) = self.sinks.voxels.as_deref_mut() else { return seen };
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

    /// Quadratures with a step, and the paper's inversion.
    pub(super) fn uncommon(&mut self, loss: Loss<'_, R>, adjoint: Adjoint, tape: &mut Tape<R>) -> Radiance<R> {
        let dvr = self.dvr;
        let uniform = dvr.uniform(&self.ray);
        // Depths are averages over cells: where the ray goes needs their points.
        if let (Source::Grey(colour), None, Some(rule)) = (&dvr.medium.source, &self.sinks.ray, uniform)
            && adjoint != Adjoint::Inversion
        {
            return self.depth_only(loss, adjoint, rule, *colour, &mut tape.cells);
        }
        match &dvr.matter {
            Matter::Line(optics) => self.uncommon_of(loss, adjoint, uniform, optics, tape),
            Matter::Table(optics, _) => self.uncommon_of(loss, adjoint, uniform, optics, tape),
        }
    }

    fn uncommon_of<const C: usize>(
        &mut self,
        loss: Loss<'_, R>,
        adjoint: Adjoint,
        uniform: Option<Uniform>,
        optics: &Optics<R, C>,
        tape: &mut Tape<R>,
    ) -> Radiance<R> {
        let Tape { samples, chords, lit_samples, lit_chords, .. } = tape;
        match (uniform, adjoint) {
            (Some(rule), Adjoint::Inversion) => self.inversion(loss, rule, optics, samples, lit_samples),
            (Some(rule), _) => self.recursion(loss, adjoint, rule, optics, samples, lit_samples),
            (None, _) => {
                let rule = self.dvr.exact_source(optics, self.sinks.table.is_some());
                self.inversion(loss, rule, optics, chords, lit_chords)
            }
        }
    }

    /// The paper's backward pass.
    fn inversion<S: Traced<R>, Q: Rule<R, C, Segment = S>, const C: usize>(
        &mut self,
        loss: Loss<'_, R>,
        rule: Q,
        optics: &Optics<R, C>,
        segments: &mut Vec<S>,
        tape: &mut Vec<Entry<R, S>>,
    ) -> Radiance<R> {
        tape.clear();
        let (dvr, curve) = (self.dvr, &optics.curve);
        let blend = kernel::blend(dvr, self.topology(), &self.ray, rule, curve, segments, |found| {
            tape.extend(found.map(|(segment, light)| Entry { segment: *segment, light: *light }));
        });
        let seen = over(optics.tinted(&blend.emitted), blend.depth, dvr.background);
        let weighted = self.shared(loss(&seen), &blend.emitted, blend.depth, &optics.tint);
        if self.sinks.ray.is_some() && Q::BOUNDED {
            let transmittance = (-blend.depth).exp();
            let emitted: f64 = weighted.colour.iter().zip(&blend.emitted).map(|(w, e)| w * e).sum();
            let whole = emitted + transmittance * weighted.background;
            self.moved.leave = transmittance * self.gain(optics, self.ray.leave, weighted.background, &weighted);
            self.moved.enter = -self.gain(optics, self.ray.enter, whole, &weighted);
        }
        inversion::backward(self, curve, rule, tape, &weighted);
        self.finish();
        seen
    }

    /// The bricks that matter: a transfer function's own derivative does not vanish where it is clear.
    #[inline(always)]
    fn topology(&self) -> &'p Topology {
        if self.sinks.table.is_some() { &self.dvr.field.topology } else { &self.dvr.visible }
    }

    /// Sources that vary: the recursion of this module's head.
    #[inline(always)]
    fn recursion<S: Traced<R>, Q: Rule<R, C, Segment = S>, const C: usize>(
        &mut self,
        loss: Loss<'_, R>,
        adjoint: Adjoint,
        rule: Q,
        optics: &Optics<R, C>,
        segments: &mut Vec<S>,
        tape: &mut Vec<Entry<R, S>>,
    ) -> Radiance<R> {
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
                Some((segment, light)) => tape.push(Entry { segment: *segment, light: *light }),
                None if !keep => tape.clear(),
                None => (),
            },
        );
        let transmittance = (-blend.depth).exp();
        let seen = over(optics.tinted(&blend.emitted), blend.depth, dvr.background);
        let weighted = self.shared(loss(&seen), &blend.emitted, blend.depth, &optics.tint);
        let mut back =
            Backward { beyond: transmittance * weighted.background, depth: blend.depth, open: transmittance, weighted };
        if self.sinks.ray.is_some() && Q::BOUNDED {
            self.moved.leave = transmittance * self.gain(optics, ray.leave, weighted.background, &weighted);
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
        if self.sinks.ray.is_some() && Q::BOUNDED {
            self.moved.enter = -self.gain(optics, ray.enter, back.beyond, &weighted);
        }
        self.finish();
        seen
    }

    /// Loss-weighted light that a unit of length at world length `t` adds, in front of light `beyond`.
    #[inline(never)]
    fn gain<const C: usize>(&self, optics: &Optics<R, C>, t: f64, beyond: f64, weighted: &Weighted<C>) -> f64 {
        let density = self.dvr.field.sample(self.ray.at(t));
        let (line, extinction) = optics.at(density);
        extinction.f64() * (Glow::new(line, density, &weighted.colour).mean - beyond)
    }

    /// Gradient of colour and background; the weights that the rest needs.
    #[inline(always)]
    fn shared<const C: usize>(
        &mut self,
        g: [R; 4],
        emitted: &[f64; C],
        depth: f64,
        tint: &[[f64; 3]; C],
    ) -> Weighted<C> {
        let loss = g.map(Real::f64);
        let transmittance = (-depth).exp();
        let mut weighted = Weighted { loss, background: -loss[3], colour: [0.0; C] };
        let shared = &mut *self.sinks.shared;
        for c in 0..3 {
            shared.background[c] += loss[c] * transmittance;
            weighted.background += loss[c] * f64::from(self.dvr.background[c]);
            for (weight, tint) in weighted.colour.iter_mut().zip(tint) {
                *weight += loss[c] * tint[c];
            }
            if C == 1 {
                shared.colour[c] += loss[c] * emitted[0];
            }
        }
        weighted
    }

    /// Hands the derivatives of one segment to the sinks.
    #[inline(always)]
    pub(super) fn deposit<S: Traced<R>, Q: Rule<R, C, Segment = S>, const C: usize>(
        &mut self,
        rule: Q,
        line: &Piece<R, C>,
        (segment, light): (&S, &Light<R>),
        slope: R,
        by: By<R>,
        weighted: &Weighted<C>,
    ) {
        let extinction = self.dvr.medium.extinction;
        let slopes = segment.slopes(line, light, slope, by);
        self.sinks.shared.extinction += (slopes.length * segment.length()).f64() / extinction;
        if self.sinks.voxels.is_some() {
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
        if let Some(table) = self.sinks.table.as_deref_mut() {
            let all = <R::Lanes as Lanes<R>>::splat;
            let fraction = all(line.fraction(R::ZERO)) + segment.densities() * all(line.fraction_slope());
            let upper = (slopes.extinction * fraction).sum().f64();
            let both = slopes.extinction.sum().f64();
            let by_mean = by.mean.f64();
            let lit =
                by_mean * line.fraction(light.mean).f64() + (by.varied * light.varied * line.fraction_slope()).f64();
            let [low, high] = &mut table.pieces[segment.piece() as usize];
            for c in 0..3 {
                low[c] += weighted.loss[c] * (by_mean - lit);
                high[c] += weighted.loss[c] * lit;
            }
            low[3] += extinction * (both - upper);
            high[3] += extinction * upper;
        }
        if self.sinks.ray.is_some() {
            self.follow(rule, segment, &slopes);
        }
    }

    /// Notes what a segment's points ask the ray to do.
    #[inline(never)]
    fn follow<S: Traced<R>, Q: Rule<R, C, Segment = S>, const C: usize>(
        &mut self,
        rule: Q,
        segment: &S,
        slopes: &Slopes<R>,
    ) {
        let (shift, turn) = segment.moved(&self.dvr.field.values, slopes.density);
        self.moved.shift += shift;
        self.moved.turn += turn;
        let by_position = shift.dot(self.ray.direction());
        let [enter, leave, step] = rule.moved(segment, slopes.length.f64(), by_position);
        self.moved.enter += enter;
        self.moved.leave += leave;
        self.moved.step += step;
    }

    /// Scatters what waits.
    #[inline(always)]
    fn flush(&mut self) {
        if let (Some((offset, weights)), Some(voxels)) = (self.pending.take(), self.sinks.voxels.as_deref_mut()) {
            scatter(voxels, offset, R::ONE, &weights);
        }
    }

    /// Scatters what waits, and brings the ray's derivatives to world space.
    #[inline(always)]
    fn finish(&mut self) {
        self.flush();
        if self.sinks.ray.is_some() {
            self.hand_over();
        }
    }

    #[inline(never)]
    fn hand_over(&mut self) {
        if let Some(ray) = self.sinks.ray.as_deref_mut() {
            let Moved { mut shift, mut turn, enter, leave, step } = self.moved;
            // The box's faces stand still: t = (face - o) / d.
            for (t, by) in [(self.ray.enter, enter), (self.ray.leave, leave)] {
                if let Some((axis, along)) = self.ray.face(&self.dvr.field.domain, t) {
                    shift[axis] -= by / along;
                    turn[axis] -= by * t / along;
                }
            }
            let to_world = self.dvr.field.transform.inverse_matrix();
            ray.origin += to_world.transpose().transform_vector3(shift);
            ray.direction += to_world.transpose().transform_vector3(turn);
            ray.step += step * self.dvr.voxel;
        }
    }
}

/// A segment that knows where it lies.
pub(super) trait Traced<R: Real>: Lit<R> {
    /// Offset of its cell.
    fn offset(&self) -> usize;
    /// World length.
    fn length(&self) -> R;
    /// Derivatives with respect to the corners of its cell, from those by density.
    fn spread(&self, by_density: R::Lanes) -> [R::Lanes; 2];
    /// Derivatives with respect to its points' index coordinates: summed, and times their world length
    /// from the origin.
    fn moved(&self, values: &[R], by_density: R::Lanes) -> (DVec3, DVec3);
    /// Change of the densities with the stored values: the transpose of [`Traced::spread`].
    fn interpolated(&self, by_value: &[R]) -> R::Lanes;
    /// Change of the densities with its points' index coordinates, and the points' world lengths from the
    /// origin: what [`Traced::moved`] is the transpose of.
    fn slopes_along(&self, values: &[R]) -> ([R::Lanes; 3], R::Lanes);
}

/// State of the division-free recursion.
struct Backward<const C: usize> {
    /// Loss-weighted radiance from beyond the segment at hand, as it arrives at the eye.
    beyond: f64,
    /// Optical depth from the eye to the segment's far end, and the transmittance.
    depth: f64,
    open: f64,
    weighted: Weighted<C>,
}

impl<const C: usize> Backward<C> {
    #[inline(always)]
    fn step<R: Real, S: Traced<R>, Q: Rule<R, C, Segment = S>>(
        &mut self,
        pass: &mut Pass<'_, '_, R>,
        curve: &Curve<R, C>,
        rule: Q,
        segment: &S,
        light: &Light<R>,
    ) {
        let line = curve.piece(segment.piece());
        let glow = Glow::new(line, light.mean, &self.weighted.colour);
        self.depth -= light.depth.f64();
        let before = (-self.depth).exp();
        let by = By {
            depth: R::of(glow.mean * self.open - self.beyond),
            mean: R::of(before - self.open),
            varied: R::of(before),
        };
        pass.deposit(rule, line, (segment, light), R::of(glow.slope), by, &self.weighted);
        self.beyond += arriving(glow, light, before, self.open);
        self.open = before;
    }
}
