//! Forward mode: radiance and its derivatives along `P` directions in one walk, for few parameters (Weiss & Westermann
//! 2021, sect. 4.2).
//!
//! Walk and segments are those of the value ([`Blend`]), which is returned bit for bit; dual numbers are computed
//! beside it. In a segment, densities, extinctions and length change; from there
//!
//! ```text
//! x' = x + Δx    T' = e^{-x'}    E ← E + c (T - T') + s T q
//! ```
//! as in [`shade`](super::shade) and [`blend`](super::blend), each symbol with its derivatives. The result is the
//! transpose of [`adjoint`](super::adjoint), term by term.

use super::blend::{Blend, Entry};
use super::jump::Jump;
use super::segment_derivatives::SegmentDerivatives;
use super::shade::{SegmentOptics, Shade};
use super::tape::Tape;
use super::{CompiledCurve, CompiledMedium, Dvr, Precision};
use crate::dual::Dual;
use crate::math::Ray;
use crate::real::Lanes;
use crate::real::Real;
use crate::render::cell::{corners, gather};
use crate::render::compositing;
use crate::render::differentiable::{RayGradient, Seeds, TangentRadiance};
use crate::render::emission_absorption::Radiance;
use crate::render::march::IndexRay;
use crate::render::quadrature::Rule;
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
        let mut radiance = match &self.compiled {
            CompiledMedium::Line(compiled) => self.tangent_of(&found, compiled, seeds, tape),
            CompiledMedium::Table(compiled, tables) => {
                let preintegrated = tables.as_ref().and_then(|tables| tables.jvp(self, found, compiled, seeds, tape));
                preintegrated.unwrap_or_else(|| self.tangent_of(&found, compiled, seeds, tape))
            }
        };
        // Where these walks differ from the value's, they do so by rounding: it sees depths alone, or fewer bricks.
        let preintegrated = matches!(&self.compiled, CompiledMedium::Table(_, Some(_)));
        if preintegrated || matches!(self.medium.source, Source::Grey(_)) || seeds.table.iter().any(Option::is_some) {
            let value = R::radiance(self, ray, tape);
            (0..3).for_each(|c| radiance.rgb[c].value = value.rgb[c]);
            radiance.depth.value = value.depth;
        }
        radiance
    }

    fn tangent_of<const C: usize, const P: usize>(
        &self,
        ray: &IndexRay,
        compiled: &CompiledCurve<R, C>,
        seeds: &Seeds<'_, R, P>,
        tape: &mut Tape<R>,
    ) -> TangentRadiance<P> {
        let Tape { samples, chords, sample_entries, chord_entries, .. } = tape;
        // A transfer function's own derivative does not vanish where it is clear.
        let all = seeds.table.iter().any(Option::is_some);
        let topology = if all { &self.field.topology } else { &self.visible };
        let front = Front::new(self, ray, compiled, seeds);
        match self.uniform(ray) {
            None => {
                let clear = all || self.by_voxels && seeds.voxels.iter().any(Option::is_some);
                follow(front, self.exact_source(compiled, clear), topology, (chords, chord_entries))
            }
            Some(rule) => follow(front, rule, topology, (samples, sample_entries)),
        }
    }
}

/// Walks one ray with its derivatives.
fn follow<R: Real, S: SegmentDerivatives<R>, Q: Rule<R, C, Segment = S>, const C: usize, const P: usize>(
    mut front: Front<'_, '_, R, C, P>,
    rule: Q,
    topology: &Topology,
    scratch: (&mut Vec<S>, &mut Vec<Entry<R, S>>),
) -> TangentRadiance<P> {
    let Front { dvr, ray, compiled, .. } = front;
    if let (Some(motion), true) = (&front.motion, Q::BOUNDED) {
        // What the entry leaves behind is no longer in front.
        front.extend(ray.enter, motion.bounds.map(|[enter, ..]| -enter));
    }
    let radiance = walk((dvr, compiled, topology), ray, rule, scratch, &mut |Entry { segment, optics, .. }| {
        front.jump(segment, End::Near);
        front.add(rule, segment, optics);
        front.jump(segment, End::Far);
    });
    if let (Some(motion), true) = (&front.motion, Q::BOUNDED) {
        front.extend(ray.leave, motion.bounds.map(|[_, leave, _]| leave));
    }
    front.radiance(radiance)
}

/// Blends as the value does, compiled once for all numbers of directions.
#[inline(never)]
fn walk<R: Real, S: Shade<R>, Q: Rule<R, C, Segment = S>, const C: usize>(
    (dvr, compiled, topology): (&Dvr<'_, R>, &CompiledCurve<R, C>, &Topology),
    ray: &IndexRay,
    rule: Q,
    (segments, entries): (&mut Vec<S>, &mut Vec<Entry<R, S>>),
    visit: &mut dyn FnMut(&Entry<R, S>),
) -> Radiance {
    let mut blend = Blend::new(dvr, compiled, rule, segments);
    compositing::each(topology, ray, &mut blend, entries, visit);
    blend.radiance(compiled)
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
struct Front<'t, 'd, R: Real, const C: usize, const P: usize> {
    dvr: &'t Dvr<'d, R>,
    ray: &'t IndexRay,
    compiled: &'t CompiledCurve<R, C>,
    seeds: &'t Seeds<'t, R, P>,
    /// Motion of the ray's points, if any moves.
    motion: Option<Motion<P>>,
    /// Optical depth from the eye.
    depth: Dual<f64, P>,
    /// Transmittance from the eye.
    transmittance: Dual<f64, P>,
    /// Emitted radiance so far, by the curve's channels.
    emitted: [Dual<f64, P>; C],
}

impl<'t, 'd, R: Real, const C: usize, const P: usize> Front<'t, 'd, R, C, P> {
    /// Creates the state at the eye.
    fn new(
        dvr: &'t Dvr<'d, R>,
        ray: &'t IndexRay,
        compiled: &'t CompiledCurve<R, C>,
        seeds: &'t Seeds<'t, R, P>,
    ) -> Self {
        Self {
            dvr,
            ray,
            compiled,
            seeds,
            motion: Motion::new(dvr, ray, seeds),
            depth: Dual::constant(0.0),
            transmittance: Dual::constant(1.0),
            emitted: [Dual::constant(0.0); C],
        }
    }

    /// Adds the derivatives of lengthening the ray at world length `t`, at the rates `by`.
    #[inline(never)]
    fn extend(&mut self, t: f64, by: [f64; P]) {
        let density = self.dvr.field.sample_at_end(self.ray.at(t));
        let (piece, extinction) = self.compiled.at(density);
        let extinction = extinction.f64();
        for p in 0..P {
            for (emitted, [at_base, slope]) in self.emitted.iter_mut().zip(piece.source) {
                let source = at_base + slope * (density - piece.base);
                emitted.tangent[p] += self.transmittance.value * extinction * source.f64() * by[p];
            }
            self.depth.tangent[p] += extinction * by[p];
            self.transmittance.tangent[p] = -self.transmittance.value * self.depth.tangent[p];
        }
    }

    /// Adds the derivatives of moving one end of a segment where the transfer function jumps.
    #[inline(always)]
    fn jump<S: SegmentDerivatives<R>>(&mut self, segment: &S, end: End) {
        let Self { dvr, ray, compiled, seeds, .. } = *self;
        let Some(jump) = Jump::find(&compiled.curve, &dvr.field.values, ray, segment, end) else { return };
        let place = &jump.place;
        for p in 0..P {
            let mut density = 0.0;
            if let Some(Motion { shift, turn, .. }) = &self.motion {
                density += jump.slopes.dot(shift[p] + place.position * turn[p]);
            }
            if let Some(by_value) = seeds.voxels[p] {
                density += gather::<R>(&place.weights(), &corners(by_value, place.offset)).f64();
            }
            let step = seeds.table[p].map_or(0.0, |table| table.steps[jump.knot]);
            let by = [-density * jump.longer, step * jump.longer];
            for (c, emitted) in self.emitted.iter_mut().enumerate() {
                emitted.tangent[p] +=
                    self.transmittance.value * (jump.emitted[0][c] * by[0] + jump.emitted[1][c] * by[1]);
            }
            self.depth.tangent[p] += jump.extinction[0] * by[0] + jump.extinction[1] * by[1];
            self.transmittance.tangent[p] = -self.transmittance.value * self.depth.tangent[p];
        }
    }

    /// Adds a segment.
    #[inline(never)]
    fn add<S: SegmentDerivatives<R>, Q: Rule<R, C, Segment = S>>(
        &mut self,
        rule: Q,
        segment: &S,
        optics: &SegmentOptics<R>,
    ) {
        let Self { dvr, ray, compiled, seeds, .. } = *self;
        let all = <R::Lanes as Lanes<R>>::splat;
        let piece = compiled.curve.piece(segment.piece());
        let mut density = Dual::constant(segment.densities());
        let mut length = Dual::constant(segment.length());
        if let Some(Motion { shift, turn, bounds }) = &self.motion {
            let (slopes, t) = segment.ray_jvp(&dvr.field.values);
            for p in 0..P {
                let [longer, further] = rule.jvp(segment, bounds[p]);
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
        let mut extinction = density.linear(|v| all(piece.extinction[1]) * v);
        extinction.value = all(piece.extinction[0]) + all(piece.extinction[1]) * (density.value - all(piece.base));
        let fraction = all(piece.fraction(R::ZERO)) + density.value * all(piece.fraction_slope());
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
        let [depth, mean, varied] = segment.jvp(density, depths);
        self.depth = self.depth + depth.f64();
        let after = (-self.depth).exp();
        let (absorbed, varied) = (self.transmittance - after, self.transmittance * varied.f64());
        for (c, emitted) in self.emitted.iter_mut().enumerate() {
            let [at_base, slope] = piece.source[c];
            let mut source = mean.linear(|v| slope * v);
            source.value = at_base + slope * (mean.value - piece.base);
            let (mut source, mut slope) = (source.f64(), Dual::constant(slope.f64()));
            for p in 0..P {
                if let Some(table) = seeds.table[p] {
                    let [low, high] = table.pieces[segment.piece() as usize].map(|end| end[c]);
                    source.tangent[p] += low + (high - low) * piece.fraction(optics.mean).f64();
                    slope.tangent[p] = (high - low) * piece.fraction_slope().f64();
                }
            }
            *emitted = *emitted + source * absorbed + slope * varied;
        }
        self.transmittance = after;
    }

    /// Returns the given radiance with its derivatives.
    fn radiance(&self, value: Radiance) -> TangentRadiance<P> {
        let channel = |c: usize, p: usize| {
            let own = |emitted: &Dual<f64, P>| if C == 1 { emitted.value * self.seeds.shared[p].color[c] } else { 0.0 };
            self.emitted
                .iter()
                .zip(&self.compiled.tint)
                .map(|(emitted, tint)| emitted.tangent[p] * tint[c] + own(emitted))
                .sum()
        };
        TangentRadiance {
            rgb: std::array::from_fn(|c| Dual { value: value.rgb[c], tangent: std::array::from_fn(|p| channel(c, p)) }),
            depth: Dual { value: value.depth, tangent: self.depth.tangent },
        }
    }
}
