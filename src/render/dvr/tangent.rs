//! Forward mode: radiance and its derivatives along `P` directions in one walk, for few parameters (Weiss & Westermann
//! 2021, sect. 4.2).
//!
//! Walk and segments are those of the value ([`blend`]), which is returned bit for bit; dual numbers are computed
//! beside it. In a segment, densities, extinctions and length change; from there
//!
//! ```text
//! x' = x + Δx    T' = e^{-x'}    E ← E + c (T - T') + s T q
//! ```
//! as in [`shade`](super::shade) and [`kernel`](super::kernel), each symbol with its derivatives. The result is the
//! transpose of [`adjoint`](super::adjoint), term by term.

use super::blend::Blend;
use super::jump::Jump;
use super::kernel::blend;
use super::segment_derivatives::SegmentDerivatives;
use super::shade::{SegmentOptics, Shade};
use super::tape::Tape;
use super::{CompiledCurve, CompiledMedium, Dvr, Precision};
use crate::dual::Dual;
use crate::math::Ray;
use crate::real::Lanes;
use crate::real::Real;
use crate::render::cell::{corners, gather};
use crate::render::differentiable::{RayGradient, Seeds, TangentRadiance};
use crate::render::integrator::Radiance;
use crate::render::march::IndexRay;
use crate::render::rule::Rule;
use crate::render::segment::End;
use crate::scene::bricks::Topology;
use crate::scene::medium::Source;
use glam::DVec3;

/// A precision that forward mode with `P` directions at once is compiled for.
pub trait Directions<const P: usize>: Precision {
    /// Computes [`Forward::jvp`](crate::render::differentiable::Forward::jvp).
    fn tangent(dvr: &Dvr<'_, Self>, ray: &Ray, seeds: &Seeds<'_, Self, P>, tape: &mut Tape<Self>)
    -> TangentRadiance<P>;
}

macro_rules! directions {
    ($($real:ty: $($count:literal)*),*) => {
        $($(impl Directions<$count> for $real {
            #[inline(never)]
            fn tangent(
                dvr: &Dvr<'_, Self>,
                ray: &Ray,
                seeds: &Seeds<'_, Self, $count>,
                tape: &mut Tape<Self>,
            ) -> TangentRadiance<$count> {
                dvr.tangent_with(ray, seeds, tape)
            }
        })*)*
    };
}
// One parameter, a point on a sphere, a pose, a pose and a step. More are taken in turns.
directions!(f32: 1 2 6 7, f64: 1 2 6 7);

impl<R: Precision> Dvr<'_, R> {
    fn tangent_with<const P: usize>(
        &self,
        ray: &Ray,
        seeds: &Seeds<'_, R, P>,
        tape: &mut Tape<R>,
    ) -> TangentRadiance<P> {
        let Some(found) = self.index_ray(ray) else {
            return TangentRadiance { rgb: [Dual::constant(0.0); 3], depth: Dual::constant(0.0) };
        };
        let mut seen = match &self.compiled {
            CompiledMedium::Line(optics) => self.tangent_of(&found, optics, seeds, tape),
            CompiledMedium::Table(optics, _) => self.tangent_of(&found, optics, seeds, tape),
        };
        // Where these walks differ from the value's, they do so by rounding: it sees depths alone, or fewer bricks.
        if matches!(self.medium.source, Source::Grey(_)) || seeds.table.iter().any(Option::is_some) {
            let value = R::radiance(self, ray, tape);
            (0..3).for_each(|c| seen.rgb[c].value = value.rgb[c]);
            seen.depth.value = value.depth;
        }
        seen
    }

    fn tangent_of<const C: usize, const P: usize>(
        &self,
        ray: &IndexRay,
        optics: &CompiledCurve<R, C>,
        seeds: &Seeds<'_, R, P>,
        tape: &mut Tape<R>,
    ) -> TangentRadiance<P> {
        let Tape { samples, chords, .. } = tape;
        // A transfer function's own derivative does not vanish where it is clear.
        let all = seeds.table.iter().any(Option::is_some);
        match self.uniform(ray) {
            None => follow(self, ray, self.exact_source(optics, all), optics, seeds, all, chords),
            Some(rule) => follow(self, ray, rule, optics, seeds, all, samples),
        }
    }
}

/// Walks one ray with its derivatives.
fn follow<R: Real, S: SegmentDerivatives<R>, Q: Rule<R, C, Segment = S>, const C: usize, const P: usize>(
    dvr: &Dvr<'_, R>,
    ray: &IndexRay,
    rule: Q,
    optics: &CompiledCurve<R, C>,
    seeds: &Seeds<'_, R, P>,
    all: bool,
    segments: &mut Vec<S>,
) -> TangentRadiance<P> {
    let motion = Motion::new(dvr, ray, seeds);
    let mut front = Front { depth: Dual::constant(0.0), open: Dual::constant(1.0), emitted: [Dual::constant(0.0); C] };
    if let (Some(motion), true) = (&motion, Q::BOUNDED) {
        // What the entry leaves behind is no longer in front.
        front.extend(dvr, ray, optics, ray.enter, motion.bounds.map(|[enter, ..]| -enter));
    }
    let topology = if all { &dvr.field.topology } else { &dvr.visible };
    let found = walk(dvr, topology, ray, rule, optics, segments, &mut |segment, light| {
        front.jump(dvr, ray, optics, seeds, motion.as_ref(), (segment, End::Near));
        front.add(dvr, ray, rule, optics, seeds, motion.as_ref(), segment, light);
        front.jump(dvr, ray, optics, seeds, motion.as_ref(), (segment, End::Far));
    });
    if let (Some(motion), true) = (&motion, Q::BOUNDED) {
        front.extend(dvr, ray, optics, ray.leave, motion.bounds.map(|[_, leave, _]| leave));
    }
    front.seen(Radiance { rgb: optics.tinted(&found.emitted), depth: found.depth }, &optics.tint, seeds)
}

/// Blends as [`blend`] does, compiled once for all numbers of directions.
#[inline(never)]
fn walk<R: Real, S: Shade<R>, Q: Rule<R, C, Segment = S>, const C: usize>(
    dvr: &Dvr<'_, R>,
    topology: &Topology,
    ray: &IndexRay,
    rule: Q,
    optics: &CompiledCurve<R, C>,
    segments: &mut Vec<S>,
    see: &mut dyn FnMut(&S, &SegmentOptics<R>),
) -> Blend<C> {
    blend(dvr, topology, ray, rule, &optics.curve, segments, |found| {
        if let Some(entry) = found {
            see(&entry.segment, &entry.light);
        }
    })
}

/// Motion of a ray's points along each direction.
struct Motion<const P: usize> {
    /// Changes of the index coordinates of all points alike.
    shift: [DVec3; P],
    /// Changes of the index coordinates per world length from the origin.
    turn: [DVec3; P],
    /// Changes of the world lengths to entry and exit, and of the quadrature's step, in world length.
    bounds: [[f64; 3]; P],
}

impl<const P: usize> Motion<P> {
    /// Returns `None` if nothing moves.
    fn new<R: Real>(dvr: &Dvr<'_, R>, ray: &IndexRay, seeds: &Seeds<'_, R, P>) -> Option<Self> {
        if seeds.ray.iter().all(|by| *by == RayGradient::default()) {
            return None;
        }
        let to_index = |v: DVec3| dvr.field.transform.vector_to_index(v);
        let shift = seeds.ray.map(|by| to_index(by.origin));
        let turn = seeds.ray.map(|by| to_index(by.direction));
        // The box's faces stand still: t = (face - o) / d.
        let face = |t: f64, p: usize| match ray.face(&dvr.field.domain, t) {
            Some((axis, along)) => -(shift[p][axis] + t * turn[p][axis]) / along,
            None => 0.0,
        };
        let bounds = std::array::from_fn(|p| [face(ray.enter, p), face(ray.leave, p), seeds.ray[p].step * dvr.voxel]);
        Some(Self { shift, turn, bounds })
    }
}

/// State of front-to-back blending with derivatives.
struct Front<const C: usize, const P: usize> {
    /// Optical depth from the eye; `open` is the transmittance.
    depth: Dual<f64, P>,
    open: Dual<f64, P>,
    /// Emitted radiance so far, by the curve's channels.
    emitted: [Dual<f64, P>; C],
}

impl<const C: usize, const P: usize> Front<C, P> {
    /// Adds the derivatives of lengthening the ray at world length `t`, at the rates `by`.
    #[inline(never)]
    fn extend<R: Real>(
        &mut self,
        dvr: &Dvr<'_, R>,
        ray: &IndexRay,
        optics: &CompiledCurve<R, C>,
        t: f64,
        by: [f64; P],
    ) {
        let density = dvr.field.sample(ray.at(t));
        let (line, extinction) = optics.at(density);
        let extinction = extinction.f64();
        for p in 0..P {
            for (emitted, [at_base, slope]) in self.emitted.iter_mut().zip(line.source) {
                let source = at_base + slope * (density - line.base);
                emitted.tangent[p] += self.open.value * extinction * source.f64() * by[p];
            }
            self.depth.tangent[p] += extinction * by[p];
            self.open.tangent[p] = -self.open.value * self.depth.tangent[p];
        }
    }

    /// Adds the derivatives of moving one end of a segment where the transfer function jumps.
    #[inline(always)]
    fn jump<R: Real, S: SegmentDerivatives<R>>(
        &mut self,
        dvr: &Dvr<'_, R>,
        ray: &IndexRay,
        optics: &CompiledCurve<R, C>,
        seeds: &Seeds<'_, R, P>,
        motion: Option<&Motion<P>>,
        (segment, end): (&S, End),
    ) {
        let Some(jump) = Jump::find(&optics.curve, &dvr.field.values, ray, segment, end) else { return };
        let place = &jump.place;
        for p in 0..P {
            let mut density = 0.0;
            if let Some(Motion { shift, turn, .. }) = motion {
                density += jump.slopes.dot(shift[p] + place.position * turn[p]);
            }
            if let Some(by_value) = seeds.voxels[p] {
                density += gather::<R>(&place.weights(), &corners(by_value, place.offset)).f64();
            }
            let step = seeds.table[p].map_or(0.0, |table| table.steps[jump.knot]);
            let by = [-density * jump.longer, step * jump.longer];
            for (c, emitted) in self.emitted.iter_mut().enumerate() {
                emitted.tangent[p] += self.open.value * (jump.lit[0][c] * by[0] + jump.lit[1][c] * by[1]);
            }
            self.depth.tangent[p] += jump.extinction[0] * by[0] + jump.extinction[1] * by[1];
            self.open.tangent[p] = -self.open.value * self.depth.tangent[p];
        }
    }

    /// Adds a segment.
    #[inline(never)]
    fn add<R: Real, S: SegmentDerivatives<R>, Q: Rule<R, C, Segment = S>>(
        &mut self,
        dvr: &Dvr<'_, R>,
        ray: &IndexRay,
        rule: Q,
        optics: &CompiledCurve<R, C>,
        seeds: &Seeds<'_, R, P>,
        motion: Option<&Motion<P>>,
        segment: &S,
        light: &SegmentOptics<R>,
    ) {
        let all = <R::Lanes as Lanes<R>>::splat;
        let line = optics.curve.piece(segment.piece());
        let mut density = Dual::constant(segment.densities());
        let mut length = Dual::constant(segment.length());
        if let Some(Motion { shift, turn, bounds }) = motion {
            let (slopes, t) = segment.ray_jvp(&dvr.field.values);
            for p in 0..P {
                let [longer, further] = rule.carried(segment, bounds[p]);
                length.tangent[p] = R::of(longer);
                let shift = shift[p] + further * ray.direction();
                for a in 0..3 {
                    let moved = all(R::of(shift[a])) + t * all(R::of(turn[p][a]));
                    density.tangent[p] += slopes[a] * moved;
                }
            }
        }
        for p in 0..P {
            if let Some(by_value) = seeds.voxels[p] {
                density.tangent[p] += segment.voxel_jvp(by_value);
            }
        }
        let mut extinction = density.linear(|v| all(line.extinction[1]) * v);
        extinction.value = all(line.extinction[0]) + all(line.extinction[1]) * (density.value - all(line.base));
        let fraction = all(line.fraction(R::ZERO)) + density.value * all(line.fraction_slope());
        let scale = dvr.medium.extinction;
        for p in 0..P {
            let relative = seeds.shared[p].extinction / scale;
            let mut more = extinction.tangent[p] + all(R::of(relative)) * extinction.value;
            if let Some(table) = seeds.table[p] {
                let [low, high] = table.pieces[segment.piece() as usize];
                more = more + all(R::of(scale * low[3])) + all(R::of(scale * (high[3] - low[3]))) * fraction;
            }
            extinction.tangent[p] = more;
        }
        let depths = length.linear(all) * extinction;
        let [depth, mean, varied] = segment.forward(density, depths);
        self.depth = self.depth + depth.f64();
        let beyond = (-self.depth).exp();
        let (absorbed, varied) = (self.open - beyond, self.open * varied.f64());
        for (c, emitted) in self.emitted.iter_mut().enumerate() {
            let [at_base, slope] = line.source[c];
            let mut source = mean.linear(|v| slope * v);
            source.value = at_base + slope * (mean.value - line.base);
            let (mut source, mut slope) = (source.f64(), Dual::constant(slope.f64()));
            for p in 0..P {
                if let Some(table) = seeds.table[p] {
                    let [low, high] = table.pieces[segment.piece() as usize].map(|end| end[c]);
                    source.tangent[p] += low + (high - low) * line.fraction(light.mean).f64();
                    slope.tangent[p] = (high - low) * line.fraction_slope().f64();
                }
            }
            *emitted = *emitted + source * absorbed + slope * varied;
        }
        self.open = beyond;
    }

    /// Returns the given radiance with its derivatives.
    fn seen<V>(&self, value: Radiance, tint: &[[f64; 3]; C], seeds: &Seeds<'_, V, P>) -> TangentRadiance<P> {
        let channel = |c: usize, p: usize| {
            let own = |emitted: &Dual<f64, P>| if C == 1 { emitted.value * seeds.shared[p].color[c] } else { 0.0 };
            self.emitted.iter().zip(tint).map(|(emitted, tint)| emitted.tangent[p] * tint[c] + own(emitted)).sum()
        };
        TangentRadiance {
            rgb: std::array::from_fn(|c| Dual { value: value.rgb[c], tangent: std::array::from_fn(|p| channel(c, p)) }),
            depth: Dual { value: value.depth, tangent: self.depth.tangent },
        }
    }
}
