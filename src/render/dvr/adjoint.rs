//! The gradient of a loss on one pixel with respect to everything along its ray.
//!
//! Let `x_i` be the optical depth of segment i, `e_i` the radiance that leaves it, `T_i` the transmittance
//! before it and `V_i` the radiance from beyond it, background included, as it arrives at the eye. From
//! the far end:
//!
//! ```text
//! V ← T_N · background
//! for i = N-1 … 0:   ∂L/∂x_i = -V     ∂L/∂e_i = T_i     V ← V + T_i e_i
//! ```
//! and from there by [`Lit::slopes`] to the densities. No division by `1 - α`: finite for opaque segments,
//! where inverting the blend (Weiss & Westermann 2021, sect. 4.3; here [`Adjoint::Inversion`]) is 0/0.
//!
//! All channels share the transmittance, so the recursion runs once, on the loss-weighted radiance:
//! with `g` the loss derivative, `V = Σ g_c L_c - g_α T`.

use super::inversion;
use super::kernel::{self, Blend, grey, over};
use super::light::{Constant, Emission, Light, Lit, Proportional};
use super::{Dvr, Radiance};
use crate::math::Ray;
use crate::real::Real;
use crate::render::cell::{Quartet, scatter};
use crate::render::march::{IndexRay, batches_before};
use crate::render::quadrature::Quadrature;
use crate::render::rule::{DepthRule, ExactDepth, Rule};
use crate::render::segment::{Chord, Sample};
use crate::scene::medium::Source;

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

/// Derivatives of the loss with respect to the parameters that all rays share.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ParameterGradient {
    /// With respect to the medium's extinction.
    pub extinction: f64,
    /// With respect to the source's colour.
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

impl<R: Real> Dvr<'_, R> {
    /// Radiance along a world ray, and the gradient of a loss on it: `loss` maps the radiance to the
    /// derivative with respect to R, G, B and alpha. The density gradient is added to `gradient`,
    /// stored values as in [`Bricks::values`](crate::scene::bricks::Bricks::values), and that of the
    /// shared parameters to `parameters`.
    #[inline(always)]
    pub fn gradient(
        &self,
        ray: &Ray,
        loss: impl FnOnce(&Radiance<R>) -> [R; 4],
        adjoint: Adjoint,
        gradient: &mut [R],
        parameters: &mut ParameterGradient,
        tape: &mut Tape<R>,
    ) -> Radiance<R> {
        let Some(ray) = self.index_ray(ray) else {
            let seen = grey(0.0, [0.0; 3], self.background);
            self.outside(&seen, loss(&seen), parameters);
            return seen;
        };
        let mut pass = Pass { dvr: self, ray, gradient, parameters, pending: None };
        match (self.medium.source, self.quadrature, adjoint) {
            (Source::Grey(c), Quadrature::Exact, Adjoint::Inversion) => {
                pass.recursion(loss, adjoint, self.exact_source(c), Constant, &mut tape.chords, &mut tape.lit_chords)
            }
            (Source::Grey(_), Quadrature::Midpoint(h), Adjoint::Inversion) => pass.recursion(
                loss,
                adjoint,
                self.uniform(h, 0.5, &ray),
                Constant,
                &mut tape.samples,
                &mut tape.lit_samples,
            ),
            (Source::Grey(_), Quadrature::Riemann(h), Adjoint::Inversion) => pass.recursion(
                loss,
                adjoint,
                self.uniform(h, 0.0, &ray),
                Constant,
                &mut tape.samples,
                &mut tape.lit_samples,
            ),
            (Source::Grey(c), Quadrature::Exact, _) => pass.depth_only(loss, adjoint, ExactDepth, c, &mut tape.cells),
            (Source::Grey(c), Quadrature::Midpoint(h), _) => {
                pass.depth_only(loss, adjoint, self.uniform(h, 0.5, &ray), c, &mut tape.cells)
            }
            (Source::Grey(c), Quadrature::Riemann(h), _) => {
                pass.depth_only(loss, adjoint, self.uniform(h, 0.0, &ray), c, &mut tape.cells)
            }
            (Source::Linear(c), Quadrature::Exact, _) => pass.recursion(
                loss,
                adjoint,
                self.exact_source(c),
                Proportional,
                &mut tape.chords,
                &mut tape.lit_chords,
            ),
            (Source::Linear(_), Quadrature::Midpoint(h), _) => pass.recursion(
                loss,
                adjoint,
                self.uniform(h, 0.5, &ray),
                Proportional,
                &mut tape.samples,
                &mut tape.lit_samples,
            ),
            (Source::Linear(_), Quadrature::Riemann(h), _) => pass.recursion(
                loss,
                adjoint,
                self.uniform(h, 0.0, &ray),
                Proportional,
                &mut tape.samples,
                &mut tape.lit_samples,
            ),
        }
    }

    /// Optical depth along a world ray with exact quadrature, its pieces appended to the tape: the
    /// linear operator of tomography. [`Tape::spread`] is its transpose.
    #[inline(always)]
    pub fn trace(&self, ray: &Ray, tape: &mut Tape<R>) -> f64 {
        let Some(ray) = self.index_ray(ray) else { return 0.0 };
        kernel::depth(self, &ray, ExactDepth, &mut tape.cells, true).depth
    }

    /// What is left of the gradient where the ray meets no medium.
    #[inline(always)]
    fn outside(&self, seen: &Radiance<R>, g: [R; 4], parameters: &mut ParameterGradient) {
        for c in 0..3 {
            parameters.background[c] += g[c].f64() * seen.transmittance.f64();
        }
    }
}

/// Loss-weighted radiance of the background and of a unit of source.
#[derive(Debug, Clone, Copy)]
pub(super) struct Weighted {
    /// `Σ g_c background_c - g_α`.
    pub background: f64,
    /// `Σ g_c colour_c`.
    pub colour: f64,
}

/// One ray's forward and backward pass.
pub(super) struct Pass<'p, 'a, R: Real> {
    pub dvr: &'p Dvr<'a, R>,
    pub ray: IndexRay,
    pub gradient: &'p mut [R],
    pub parameters: &'p mut ParameterGradient,
    /// Derivatives that wait: a cell of many pieces is scattered once.
    pending: Option<(usize, [R::Lanes; 2])>,
}

impl<R: Real> Pass<'_, '_, R> {
    /// Grey sources: one derivative for the whole ray.
    #[inline(always)]
    fn depth_only<Q: DepthRule<R>>(
        &mut self,
        loss: impl FnOnce(&Radiance<R>) -> [R; 4],
        adjoint: Adjoint,
        rule: Q,
        colour: [f32; 3],
        tape: &mut Vec<Quartet<R>>,
    ) -> Radiance<R> {
        tape.clear();
        let mut blend = kernel::depth(self.dvr, &self.ray, rule, tape, adjoint == Adjoint::Tape);
        let depth = blend.depth;
        let seen = grey(depth, colour, self.dvr.background);
        blend.emitted = -(-depth).exp_m1();
        let weighted = self.shared(loss(&seen), &blend, colour);
        // ∂L/∂depth: more depth replaces background by source.
        let slope = (-depth).exp() * (weighted.colour - weighted.background);
        let g = R::of(slope * self.dvr.medium.extinction);
        self.parameters.extinction += slope * depth / self.dvr.medium.extinction;
        let gradient = &mut *self.gradient;
        let mut back = |tape: &mut Vec<Quartet<R>>| tape.drain(..).rev().for_each(|cells| cells.scatter(gradient, g));
        back(tape);
        if adjoint == Adjoint::Replay {
            batches_before(
                &self.dvr.field.topology,
                &self.ray,
                blend.last,
                #[inline(always)]
                |spans| {
                    rule.cells(spans, tape);
                    back(tape);
                },
            );
        }
        seen
    }

    /// Sources that vary: the recursion of this module's head, or the paper's inversion.
    #[inline(always)]
    fn recursion<E: Emission, S: Lit<R>, Q: Rule<R, Segment = S>>(
        &mut self,
        loss: impl FnOnce(&Radiance<R>) -> [R; 4],
        adjoint: Adjoint,
        rule: Q,
        emission: E,
        segments: &mut Vec<S>,
        tape: &mut Vec<Entry<R, S>>,
    ) -> Radiance<R> {
        tape.clear();
        let (Source::Grey(colour) | Source::Linear(colour)) = self.dvr.medium.source;
        let keep = adjoint != Adjoint::Replay;
        let blend = kernel::blend(
            self.dvr,
            &self.ray,
            rule,
            emission,
            segments,
            #[inline(always)]
            |found| match found {
                Some((segment, light)) => tape.push(Entry { segment: *segment, light: *light }),
                None if !keep => tape.clear(),
                None => (),
            },
        );
        let transmittance = (-blend.depth).exp();
        let seen = over(blend.emitted, transmittance, colour, self.dvr.background);
        let weighted = self.shared(loss(&seen), &blend, colour);
        let mut back =
            Backward { beyond: transmittance * weighted.background, depth: blend.depth, colour: weighted.colour };
        if adjoint == Adjoint::Inversion {
            inversion::backward::<R, E, S>(self, tape, weighted);
        } else {
            for entry in tape.iter().rev() {
                back.step::<R, E, S>(self, &entry.segment, &entry.light);
            }
        }
        if adjoint == Adjoint::Replay {
            let (dvr, ray) = (self.dvr, self.ray);
            let extinction = R::of(dvr.medium.extinction);
            batches_before(
                &dvr.field.topology,
                &ray,
                blend.last,
                #[inline(always)]
                |spans| {
                    segments.clear();
                    rule.segments(&dvr.field.values, spans, segments);
                    for segment in segments.iter().rev() {
                        back.step::<R, E, S>(self, segment, &segment.light::<E>(extinction));
                    }
                },
            );
        }
        self.flush();
        seen
    }

    /// Gradient of colour and background; the weights that the voxels' gradient needs.
    #[inline(always)]
    fn shared(&mut self, g: [R; 4], blend: &Blend, colour: [f32; 3]) -> Weighted {
        let g = g.map(Real::f64);
        let transmittance = (-blend.depth).exp();
        let mut weighted = Weighted { background: -g[3], colour: 0.0 };
        for c in 0..3 {
            self.parameters.colour[c] += g[c] * blend.emitted;
            self.parameters.background[c] += g[c] * transmittance;
            weighted.background += g[c] * f64::from(self.dvr.background[c]);
            weighted.colour += g[c] * f64::from(colour[c]);
        }
        weighted
    }

    /// Scatters the derivatives with respect to a segment's optical depth and emitted radiance.
    #[inline(always)]
    pub(super) fn deposit<E: Emission, S: Lit<R>>(
        &mut self,
        segment: &S,
        light: &Light<R>,
        by_depth: f64,
        by_emitted: f64,
    ) {
        let extinction = self.dvr.medium.extinction;
        let slopes = segment.slopes::<E>(R::of(extinction), light, R::of(by_depth), R::of(by_emitted));
        self.parameters.extinction += slopes.extinction.f64() / extinction;
        let [near, far] = slopes.corners;
        let offset = segment.offset();
        match &mut self.pending {
            Some((waiting, [a, b])) if *waiting == offset => (*a, *b) = (*a + near, *b + far),
            _ => {
                self.flush();
                self.pending = Some((offset, [near, far]));
            }
        }
    }

    /// Scatters what waits.
    #[inline(always)]
    pub(super) fn flush(&mut self) {
        if let Some((offset, weights)) = self.pending.take() {
            scatter(self.gradient, offset, R::ONE, &weights);
        }
    }
}

/// State of the division-free recursion.
struct Backward {
    /// Loss-weighted radiance from beyond the segment at hand, as it arrives at the eye.
    beyond: f64,
    /// Optical depth from the eye to the segment's far end.
    depth: f64,
    /// Loss-weighted source colour.
    colour: f64,
}

impl Backward {
    #[inline(always)]
    fn step<R: Real, E: Emission, S: Lit<R>>(&mut self, pass: &mut Pass<'_, '_, R>, segment: &S, light: &Light<R>) {
        self.depth -= light.depth.f64();
        let by_emitted = self.colour * (-self.depth).exp();
        pass.deposit::<E, S>(segment, light, -self.beyond, by_emitted);
        self.beyond += by_emitted * light.emitted.f64();
    }
}
