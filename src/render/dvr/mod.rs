//! Direct volume rendering: emission and absorption along straight rays, and its derivative.
//!
//! `L = ∫ T(t) σ(t) c(t) dt + T(end) · background`, `T(t) = exp(-∫σ)`
//! (Max 1995; Weiss & Westermann 2021, eq. 1).
//!
//! [`Dvr`] picks its kernel once a ray: the quadrature rule and the source are types inside the loops, so what a scene
//! does not call for costs nothing there.

mod absorption;
mod adjoint;
mod blend;
mod free_path;
mod inversion;
mod jacobian;
mod jump;
mod preintegrated;
mod ray;
mod sampled;
mod segment_derivatives;
mod shade;
mod stepped;
mod tangent;
mod tape;

#[doc(hidden)]
pub(crate) use adjoint::Pass;
pub(crate) use free_path::TracedRay;
pub(crate) use free_path::density;
pub(crate) use jacobian::ByKnot;
pub use jacobian::TableJacobian;
pub use tangent::Directions;
pub use tape::Tape;

use crate::arch::{Arch, Plain};
use crate::error::{Error, Result};
use crate::math::Ray;
use crate::real::Real;
use crate::render::composited::Composited;
use crate::render::compositing;
use crate::render::curve::{Curve, Piece};
use crate::render::differentiable::{Accumulators, Adjoint, Differentiable, Forward, Loss, Seeds, TangentRadiance};
use crate::render::emission_absorption::{EmissionAbsorption, Radiance};
use crate::render::labels::not_differentiated;
use crate::render::majorant::{Majorants, bound_between};
use crate::render::march::IndexRay;
use crate::render::quadrature::Quadrature;
use crate::render::quadrature::{ExactDepth, ExactSource, Uniform};
use crate::scene::bricks::{Bricks, CELLS, NONE, Topology};
use crate::scene::medium::{Medium, Source};
use absorption::{OpticalDepth, grey};
use blend::Blend;
use preintegrated::Preintegrated;
use sampled::Sampled;
use std::sync::{Arc, OnceLock};

/// Extinction and source as functions of the density, with `C` channels.
#[derive(Debug, Clone)]
struct CompiledCurve<R: Real, const C: usize> {
    curve: Curve<R, C>,
    /// Red, green and blue of each channel of the curve.
    tint: [[f64; 3]; C],
    /// Radiance, in units of the curve's source, that quadrature errors are measured against: the brightest of a
    /// transfer function; for a line 1 in the brightest channel.
    bright: f64,
}

impl<R: Real, const C: usize> CompiledCurve<R, C> {
    /// Returns the piece of the curve at a density, and the extinction there.
    #[inline(always)]
    fn at(&self, density: R) -> (&Piece<R, C>, R) {
        let piece = self.curve.piece(self.curve.find(density));
        (piece, piece.extinction[0] + piece.extinction[1] * (density - piece.base))
    }

    #[inline(always)]
    fn tinted(&self, emitted: &[f64; C]) -> [f64; 3] {
        let mut rgb = [0.0; 3];
        for (emitted, tint) in emitted.iter().zip(&self.tint) {
            for c in 0..3 {
                rgb[c] += emitted * tint[c];
            }
        }
        rgb
    }
}

/// The medium as kernels need it: one channel of source where red, green and blue are proportional, else three.
#[derive(Debug, Clone)]
enum CompiledMedium<R: Real> {
    Line(Arc<CompiledCurve<R, 1>>),
    Table(Arc<CompiledCurve<R, 3>>, Option<Arc<Preintegrated<R>>>),
}

impl<R: Real> CompiledMedium<R> {
    fn new(medium: &Medium) -> Self {
        let line = |source: [f64; 2], color: [f32; 3]| {
            let brightest = f64::from(color.into_iter().fold(f32::MIN_POSITIVE, f32::max));
            let tint = [color.map(f64::from)];
            Self::Line(Arc::new(CompiledCurve {
                curve: Curve::line(medium.extinction, source),
                tint,
                bright: 1.0 / brightest,
            }))
        };
        match &medium.source {
            Source::Grey(color) => line([1.0, 0.0], *color),
            Source::Linear(color) => line([0.0, 1.0], *color),
            Source::Transfer(table) => {
                let brightest = table.peak()[..3].iter().fold(f64::MIN_POSITIVE, |a, b| a.max(*b));
                let tint = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
                let curve = Curve::new(table, medium.extinction);
                Self::Table(Arc::new(CompiledCurve { curve, tint, bright: brightest }), None)
            }
        }
    }
}

/// A precision that kernels are compiled for in this module: they are large, and generic functions would be compiled
/// again in each crate that uses them.
pub trait Precision: Real {
    /// Computes [`Dvr::radiance`] with scratch memory.
    fn radiance(dvr: &Dvr<'_, Self>, ray: &Ray, tape: &mut Tape<Self>) -> Radiance;
    /// Computes the gradient of a loss; see [`Differentiable::vjp`].
    fn gradient(
        dvr: &Dvr<'_, Self>,
        ray: &Ray,
        loss: Loss<'_, Self>,
        adjoint: Adjoint,
        to: Accumulators<'_, Self>,
        tape: &mut Tape<Self>,
    ) -> Radiance;
    /// Computes gradients of rarely used rules: of quadratures with a step, and by inversion.
    fn stepped(
        pass: &mut Pass<'_, '_, Self>,
        loss: Loss<'_, Self>,
        adjoint: Adjoint,
        tape: &mut Tape<Self>,
    ) -> Radiance;
    /// Computes [`Dvr::trace`].
    fn trace(dvr: &Dvr<'_, Self>, ray: &Ray, tape: &mut Tape<Self>) -> f64;
}

macro_rules! precision {
    ($real:ty, $arch:expr) => {
        impl Precision for $real {
            fn radiance(dvr: &Dvr<'_, Self>, ray: &Ray, tape: &mut Tape<Self>) -> Radiance {
                $arch(dvr).dispatch(Value { dvr, ray, tape })
            }
            fn gradient(
                dvr: &Dvr<'_, Self>,
                ray: &Ray,
                loss: Loss<'_, Self>,
                adjoint: Adjoint,
                to: Accumulators<'_, Self>,
                tape: &mut Tape<Self>,
            ) -> Radiance {
                $arch(dvr).dispatch(Gradient { dvr, ray, loss, adjoint, to, tape })
            }
            #[inline(never)]
            fn stepped(
                pass: &mut Pass<'_, '_, Self>,
                loss: Loss<'_, Self>,
                adjoint: Adjoint,
                tape: &mut Tape<Self>,
            ) -> Radiance {
                pass.stepped(loss, adjoint, tape)
            }
            #[inline(never)]
            fn trace(dvr: &Dvr<'_, Self>, ray: &Ray, tape: &mut Tape<Self>) -> f64 {
                dvr.trace_with(ray, tape)
            }
        }
    };
}
precision!(f32, |dvr: &Dvr<'_, f32>| dvr.arch);
// The reference is compiled for one instruction set alone.
precision!(f64, |_: &Dvr<'_, f64>| Plain);

/// Evaluation of one ray's radiance, as the unit that is compiled for each instruction set. (A closure would not do:
/// its call is compiled for the baseline.)
struct Value<'k, 'd, R: Real> {
    dvr: &'k Dvr<'d, R>,
    ray: &'k Ray,
    tape: &'k mut Tape<R>,
}

impl<R: Real> pulp::NullaryFnOnce for Value<'_, '_, R> {
    type Output = Radiance;

    #[inline(always)]
    fn call(self) -> Radiance {
        self.dvr.radiance_with(self.ray, self.tape)
    }
}

/// Evaluation of one ray's gradient, as the unit that is compiled for each instruction set.
struct Gradient<'k, 'd, R: Real> {
    dvr: &'k Dvr<'d, R>,
    ray: &'k Ray,
    loss: Loss<'k, R>,
    adjoint: Adjoint,
    to: Accumulators<'k, R>,
    tape: &'k mut Tape<R>,
}

impl<R: Precision> pulp::NullaryFnOnce for Gradient<'_, '_, R> {
    type Output = Radiance;

    #[inline(always)]
    fn call(self) -> Radiance {
        self.dvr.gradient_with(self.ray, self.loss, self.adjoint, self.to, self.tape)
    }
}

impl<R: Precision> Dvr<'_, R> {
    /// Returns the radiance along a world ray of unit direction.
    pub fn radiance(&self, ray: &Ray) -> Radiance {
        R::radiance(self, ray, &mut Tape::default())
    }

    /// Returns the optical depth `∫σ` along a world ray of unit direction, summed in `f64`.
    pub fn optical_depth(&self, ray: &Ray) -> f64 {
        R::radiance(self, ray, &mut Tape::default()).depth
    }

    /// Returns the optical depth along a world ray with exact quadrature, and appends the cells crossed to the tape:
    /// the linear operator of tomography. `Tape::accumulate` is its transpose.
    pub fn trace(&self, ray: &Ray, tape: &mut Tape<R>) -> f64 {
        R::trace(self, ray, tape)
    }
}

/// Computation of the optical depth of a part of a ray, as the unit that is compiled for each instruction set.
struct DepthWithin<'k, 'd> {
    dvr: &'k Dvr<'d, f32>,
    ray: &'k Ray,
    length: f64,
    limit: f64,
    tape: &'k mut Tape<f32>,
}

impl pulp::NullaryFnOnce for DepthWithin<'_, '_> {
    type Output = f64;

    #[inline(always)]
    fn call(self) -> f64 {
        let Self { dvr, ray, length, limit, tape } = self;
        let Some(mut ray) = dvr.index_ray(ray) else { return 0.0 };
        ray.leave = ray.leave.min(length);
        match &dvr.compiled {
            CompiledMedium::Line(_) => OpticalDepth::up_to(limit, dvr, &ray, ExactDepth, &mut tape.cells),
            CompiledMedium::Table(compiled, _) => {
                let rule = dvr.exact_source(compiled, false);
                let mut blend = Blend::new(dvr, compiled, rule, &mut tape.chords);
                blend.depth_limit = limit;
                compositing::value(&dvr.visible, &ray, &mut blend, &mut tape.chord_entries);
                blend.depth
            }
        }
    }
}

impl Dvr<'_, f32> {
    /// Returns the optical depth of the first `length` of a world ray of unit direction with exact quadrature, or, if
    /// that is more than `limit`, a depth of at least `limit`.
    pub(crate) fn optical_depth_within(&self, ray: &Ray, length: f64, limit: f64, tape: &mut Tape<f32>) -> f64 {
        self.arch.dispatch(DepthWithin { dvr: self, ray, length, limit, tape })
    }
}

fn largest(color: [f32; 3]) -> f64 {
    color.into_iter().fold(0.0, |m: f64, v| m.max(v.into()))
}

/// Direct volume renderer of a density field in precision `R`.
#[derive(Debug, Clone)]
pub struct Dvr<'a, R: Real> {
    field: &'a Bricks<R>,
    /// Medium of the densities that the field stores.
    medium: Medium,
    compiled: CompiledMedium<R>,
    /// Bricks that rays visit: with a transfer function those that hold a density at which the medium absorbs, else
    /// all.
    visible: Arc<Topology>,
    /// True if a medium with a transfer function absorbs at the field's background, so that gaps between bricks count.
    gaps: bool,
    /// Bricks that rays visit by a quadrature with a step or pre-integration. If gaps count, all but those that hold
    /// the background alone: elsewhere the density is the background. If not, the visible ones: elsewhere nothing is
    /// absorbed.
    occupied: Arc<Topology>,
    /// True if derivatives with respect to voxels are wanted of all voxels on which the light depends.
    by_voxels: bool,
    /// Least and greatest value of each brick.
    ranges: OnceLock<Arc<[[R; 2]]>>,
    majorants: OnceLock<Majorants>,
    quadrature: Quadrature,
    /// Optical depth at which a ray ends; 0 transmittance gives infinity.
    depth_limit: f64,
    /// World length of one voxel along its shortest edge: the unit of the quadrature's steps.
    voxel: f64,
    /// Radiance error allowed per piece where the source varies; see [`Dvr::tolerance`].
    tolerance: f64,
    arch: Arch,
}

impl<'a, R: Real> Dvr<'a, R> {
    /// Creates a renderer with exact quadrature, whose rays end once at most 1e-6 of the light from behind could reach
    /// the eye.
    ///
    /// # Errors
    /// If the medium's numbers are not usable, it scatters, it is chromatic, it absorbs at the field's background where
    /// there are no bricks, or it has no transfer function for a background other than zero.
    pub fn new(field: &'a Bricks<R>, medium: Medium) -> Result<Self> {
        let medium = medium.checked()?.relative_to(field.reference);
        if medium.scatters() {
            return Err(Error::unsupported(
                "direct volume rendering shows absorption and emission, the medium scatters",
            )
            .hint("set its albedo to 0"));
        }
        if medium.is_chromatic() {
            return Err(Error::unsupported(
                "direct volume rendering has one extinction for all channels, the medium has three",
            )
            .hint("path tracing renders it"));
        }
        match &medium.source {
            Source::Transfer(table) if table.is_categorical() => return Err(not_differentiated()),
            Source::Transfer(table) if table.at(field.background.f64())[3] > 0.0 && !field.is_filled() => {
                return Err(Error::invalid(
                    "the transfer function absorbs at the field's background, and bricks are missing there",
                )
                .hint("fill the field first: `Bricks::filled`"));
            }
            Source::Grey(_) | Source::Linear(_) if field.background != R::ZERO || field.reference != 0.0 => {
                return Err(Error::invalid(
                    "a medium without a transfer function has density 0 outside, the field not",
                )
                .hint("give a transfer function in the data's own units: ⟨tf=NAME⟩"));
            }
            _ => {}
        }
        let renderer = Self {
            field,
            compiled: CompiledMedium::new(&medium),
            visible: field.topology.clone(),
            gaps: false,
            occupied: field.topology.clone(),
            by_voxels: false,
            ranges: OnceLock::new(),
            majorants: OnceLock::new(),
            medium,
            quadrature: Quadrature::Exact,
            depth_limit: f64::INFINITY,
            voxel: field.transform.voxel_size().min_element(),
            tolerance: 4e-7,
            arch: Arch::default(),
        };
        Ok(renderer.skipping().early_stop(1e-6))
    }

    /// Skips bricks in which nothing absorbs. Without a transfer function no brick is skipped: empty ones are stored
    /// for the interpolation between their voxels and their neighbours', and are few.
    fn skipping(self) -> Self {
        if matches!(self.medium.source, Source::Transfer(_)) { self.skipping_empty() } else { self }
    }

    /// Skips bricks in which nothing absorbs, for fields that have many. Derivatives with respect to voxels of such
    /// bricks are left out, unless [`Dvr::by_voxels`] was called.
    #[must_use]
    pub fn skipping_empty(mut self) -> Self {
        self.visible = Arc::new(match (&self.medium.source, self.by_voxels) {
            (Source::Transfer(table), true) => {
                let depends =
                    |[low, high]: [R; 2]| bound_between(&self.medium, [low.f64(), table.above(high.f64())]) > 0.0;
                let ranges = self.ranges();
                self.field.topology.masked(|brick| depends(ranges[brick]))
            }
            _ => {
                let bounds = self.majorants().bricks();
                self.field.topology.masked(|brick| bounds[brick] > 0.0)
            }
        });
        self
    }

    /// Makes derivatives with respect to voxels whole: also clear voxels have theirs where a greater density would
    /// absorb, and quadrature with few nodes has no larger gaps between them than voxels. Rays visit more bricks.
    ///
    /// Where a transfer function has a kink at the very value of a voxel, the derivative is that for greater or for
    /// lesser values, as rounding decides; at zero it is that for greater ones.
    #[must_use]
    pub fn by_voxels(mut self) -> Self {
        self.by_voxels = true;
        let quadrature = self.quadrature;
        self.skipping().quadrature(quadrature)
    }

    /// Composites the medium over a constant background.
    pub fn over(self, background: [f32; 3]) -> Composited<Self> {
        Composited { medium: self, background }
    }

    /// Sets the quadrature rule.
    #[must_use]
    pub fn quadrature(mut self, quadrature: Quadrature) -> Self {
        self.quadrature = quadrature;
        if let (Source::Transfer(table), CompiledMedium::Table(compiled, tables)) =
            (&self.medium.source, &mut self.compiled)
        {
            let ranges = || self.ranges.get_or_init(|| self.field.ranges().into());
            let background = self.field.background;
            self.gaps = table.at(background.f64())[3] > 0.0;
            self.occupied = if self.gaps && quadrature != Quadrature::Exact {
                let ranges = ranges();
                Arc::new(self.field.topology.masked(|brick| ranges[brick] != [background; 2]))
            } else {
                self.visible.clone()
            };
            *tables = match quadrature {
                Quadrature::Preintegrated(tolerance) => {
                    let medium = (table.as_ref(), self.medium.extinction);
                    let bricks = (self.field, &**ranges(), self.by_voxels);
                    let occupied = (self.occupied.clone(), self.gaps);
                    Some(Arc::new(Preintegrated::new(medium, tolerance, &compiled.curve, bricks, occupied)))
                }
                _ => None,
            };
        }
        self
    }

    /// Ends a ray after the batch of bricks in which its transmittance falls below `transmittance`, from 0 (never) to
    /// 1; [`Composited::left_out`] bounds the error.
    #[must_use]
    pub fn early_stop(mut self, transmittance: f64) -> Self {
        self.depth_limit = -transmittance.ln();
        self
    }

    /// Returns the transmittance at which a ray ends.
    pub(crate) fn least_transmittance(&self) -> f64 {
        (-self.depth_limit).exp()
    }

    /// Returns the largest radiance of the medium's source, in any channel.
    pub fn brightest(&self) -> f64 {
        match &self.medium.source {
            Source::Grey(color) => largest(*color),
            Source::Linear(color) => largest(*color) * self.field.range().1.f64().max(0.0),
            Source::Transfer(table) => table.peak()[..3].iter().fold(0.0, |m: f64, v| m.max(*v)),
        }
    }

    /// Sets the radiance error that exact quadrature may leave in each piece of a ray (default 4e-7), relative to the
    /// brightest color of the transfer function, or absolute without one; optical depths have no such error.
    #[must_use]
    pub fn tolerance(mut self, tolerance: f64) -> Self {
        self.tolerance = tolerance;
        self
    }

    /// Sets the instruction set of `f32` kernels; results do not depend on it.
    #[must_use]
    pub fn arch(mut self, arch: Arch) -> Self {
        self.arch = arch;
        self
    }

    /// Returns the estimated voxel lookups per ray and brick; see [`Differentiable::lookups`].
    pub fn lookups(&self, by_table: bool) -> Vec<f32> {
        let topology = if by_table { &self.field.topology } else { &self.visible };
        let through = |brick: usize| match &self.compiled {
            CompiledMedium::Table(_, Some(tables)) => tables.lookups(brick),
            // Measured: cells with an exponential, and those of many pieces.
            CompiledMedium::Table(_, None) => 16.0 * CELLS as f32,
            CompiledMedium::Line(_) if matches!(self.medium.source, Source::Linear(_)) => 3.0 * CELLS as f32,
            CompiledMedium::Line(_) => CELLS as f32,
        };
        let bricks = topology.bricks().iter().enumerate();
        bricks.map(|(i, brick)| if topology.find(*brick) == NONE { 0.0 } else { through(i) }).collect()
    }

    /// Returns upper bounds of the extinction, computed on first use.
    pub(crate) fn majorants(&self) -> &Majorants {
        self.majorants.get_or_init(|| Majorants::of_ranges(self.ranges(), self.field.background, &self.medium))
    }

    /// Returns the least and the greatest value of each brick, computed on first use.
    fn ranges(&self) -> &[[R; 2]] {
        self.ranges.get_or_init(|| self.field.ranges().into())
    }

    /// Returns the bricks that rays visit.
    pub fn visible(&self) -> &Topology {
        &self.visible
    }

    /// Returns the field that is rendered.
    pub fn field(&self) -> &'a Bricks<R> {
        self.field
    }

    #[inline(always)]
    fn index_ray(&self, ray: &Ray) -> Option<IndexRay> {
        IndexRay::new(&self.field.domain, &self.field.transform, ray)
    }

    /// Returns the rule of a quadrature with a step; `None` for the others.
    #[inline(always)]
    fn uniform(&self, ray: &IndexRay) -> Option<Uniform> {
        let (step, phase) = match self.quadrature {
            Quadrature::Exact | Quadrature::Preintegrated(_) => return None,
            Quadrature::Midpoint(step) => (step, 0.5),
            Quadrature::Riemann(step) => (step, 0.0),
        };
        Some(Uniform::new(step * self.voxel, phase, ray))
    }

    #[inline(always)]
    fn exact_source<const C: usize>(&self, compiled: &CompiledCurve<R, C>, keep_clear: bool) -> ExactSource {
        ExactSource { tolerance: self.tolerance * compiled.bright, keep_clear }
    }

    #[inline(always)]
    fn depth_with(&self, ray: &Ray, tape: &mut Tape<R>) -> f64 {
        let Some(ray) = self.index_ray(ray) else { return 0.0 };
        match self.uniform(&ray) {
            None => OpticalDepth::of(self, &ray, ExactDepth, &mut tape.cells),
            Some(rule) => OpticalDepth::of(self, &ray, rule, &mut tape.cells),
        }
    }

    #[inline(always)]
    fn radiance_with(&self, ray: &Ray, tape: &mut Tape<R>) -> Radiance {
        if let Source::Grey(color) = self.medium.source {
            return grey(self.depth_with(ray, tape), color);
        }
        let Some(ray) = self.index_ray(ray) else { return Radiance::default() };
        match &self.compiled {
            CompiledMedium::Line(compiled) => self.blended(&ray, compiled, tape),
            CompiledMedium::Table(compiled, tables) => {
                if let Some(rule) = self.uniform(&ray) {
                    return self.sampled(&compiled.curve).radiance(&ray, rule, &mut tape.batch);
                }
                // No closures: they would be compiled for the oldest instruction set.
                if let Some(tables) = tables
                    && let Some(radiance) = tables.radiance(self, &compiled.curve, &ray, &mut tape.preintegrated)
                {
                    return radiance;
                }
                self.blended(&ray, compiled, tape)
            }
        }
    }

    #[inline(always)]
    fn sampled<'s>(&'s self, curve: &'s Curve<R, 3>) -> Sampled<'s, R> {
        let Self { field, ref occupied, gaps, depth_limit, .. } = *self;
        Sampled { field, occupied, gaps, curve, depth_limit }
    }

    #[inline(always)]
    fn blended<const C: usize>(&self, ray: &IndexRay, compiled: &CompiledCurve<R, C>, tape: &mut Tape<R>) -> Radiance {
        let (topology, Tape { samples, chords, sample_entries, chord_entries, .. }) = (&self.visible, tape);
        match self.uniform(ray) {
            None => {
                let mut blend = Blend::new(self, compiled, self.exact_source(compiled, false), chords);
                compositing::value(topology, ray, &mut blend, chord_entries);
                blend.radiance(compiled)
            }
            Some(rule) => {
                let mut blend = Blend::new(self, compiled, rule, samples);
                compositing::value(topology, ray, &mut blend, sample_entries);
                blend.radiance(compiled)
            }
        }
    }
}

impl<R: Precision> Composited<Dvr<'_, R>> {
    /// Returns a bound of the change that ending rays early makes in any channel of a pixel, alpha included. Behind a
    /// transmittance T, medium and background contribute T times a mean of their radiances; the picture has T times the
    /// background instead.
    pub fn left_out(&self) -> f64 {
        self.medium.least_transmittance() * self.unit()
    }

    /// Returns the radiance that relative errors of a pixel are measured by: the brightest of medium and background, at
    /// least the 1 of alpha.
    pub(crate) fn unit(&self) -> f64 {
        self.medium.brightest().max(self.brightest_background()).max(1.0)
    }

    /// Returns a bound of the error that the quadrature makes in any channel of a pixel, alpha included, beside
    /// rounding to the precision `R`; `None` for rules that state none.
    pub(crate) fn quadrature_error(&self) -> Option<f64> {
        match (self.medium.quadrature, &self.medium.compiled) {
            (Quadrature::Preintegrated(tolerance), CompiledMedium::Table(..)) => Some(tolerance * self.unit()),
            _ => None,
        }
    }
}

impl<R: Precision> EmissionAbsorption for Dvr<'_, R> {
    type Real = R;
    type Scratch = Tape<R>;

    fn integrate(&self, ray: &Ray, tape: &mut Tape<R>) -> Radiance {
        R::radiance(self, ray, tape)
    }
}

impl<R: Precision> Differentiable for Dvr<'_, R> {
    type Voxel = R;

    fn field(&self) -> &Bricks<R> {
        self.field
    }

    fn lookups(&self, by_table: bool) -> Vec<f32> {
        self.lookups(by_table)
    }

    fn vjp(
        &self,
        ray: &Ray,
        loss: Loss<'_, R>,
        adjoint: Adjoint,
        to: Accumulators<'_, R>,
        tape: &mut Tape<R>,
    ) -> Radiance {
        R::gradient(self, ray, loss, adjoint, to, tape)
    }
}

impl<R: Directions<P>, const P: usize> Forward<P> for Dvr<'_, R> {
    fn jvp(&self, ray: &Ray, seeds: &Seeds<'_, R, P>, tape: &mut Tape<R>) -> TangentRadiance<P> {
        R::tangent(self, ray, seeds, tape)
    }
}
