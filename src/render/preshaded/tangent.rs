//! Forward mode: radiance and its derivatives along `P` directions, the transpose of [`adjoint`](super::adjoint).
//!
//! The walk is that of the value, which is returned bit for bit. Beside it, each with derivatives: the segments' ends,
//! the positions of their points, the values there, and from these light and optical depth.

use super::Preshaded;
use super::blend::Blend;
use super::segment::{POINTS, Segment, UP_TO};
use super::tape::Tape;
use crate::dual::Dual;
use crate::math::Ray;
use crate::real::Lanes;
use crate::real::Real;
use crate::render::compositing;
use crate::render::differentiable::{Adjoint, RayGradient, Seeds, TangentRadiance};
use crate::render::emission_absorption::Radiance;
use crate::render::march::IndexRay;
use glam::DVec3;

impl<R: Real> Preshaded<'_, R> {
    /// Returns the radiance along a world ray of unit direction, with its derivatives along `P` directions of the ray
    /// and the stored values; other seeds have no effect. Traced rays on the tape stay there.
    pub(crate) fn tangent<const P: usize>(
        &self,
        ray: &Ray,
        seeds: &Seeds<'_, R::Lanes, P>,
        tape: &mut Tape<R>,
    ) -> TangentRadiance<P> {
        let ray = self.index_ray(ray);
        let radiance = self.record(ray.as_ref(), &mut tape.segments);
        let mut front = Front { depth: Dual::constant(0.0), emitted: [Dual::constant(0.0); 3] };
        if let Some(ray) = ray {
            let motion = Motion::new(self, ray, seeds);
            tape.segments.iter().for_each(|segment| front.pass(self, &motion, seeds, segment));
        }
        let with = |value, dual: Dual<f64, P>| Dual { value, ..dual };
        TangentRadiance {
            rgb: std::array::from_fn(|c| with(radiance.rgb[c], front.emitted[c])),
            depth: with(radiance.depth, front.depth),
        }
    }

    /// Records the segments of a ray and returns its radiance; compiled once for all numbers of directions.
    #[inline(never)]
    fn record(&self, ray: Option<&IndexRay>, segments: &mut Vec<Segment<R>>) -> Radiance {
        segments.clear();
        let mut blend = Blend::new(self);
        if let Some(ray) = ray {
            compositing::record(&self.field.topology, ray, Adjoint::Tape, &mut blend, segments);
        }
        blend.radiance()
    }
}

/// Motion of a ray's points along each direction, in index space.
struct Motion<const P: usize> {
    ray: IndexRay,
    moves: bool,
    /// Changes of the index coordinates of all points alike.
    shift: [DVec3; P],
    /// Changes of the index coordinates per world length from the origin.
    turn: [DVec3; P],
}

impl<const P: usize> Motion<P> {
    fn new<R: Real>(renderer: &Preshaded<'_, R>, ray: IndexRay, seeds: &Seeds<'_, R::Lanes, P>) -> Self {
        let to_index = |v: DVec3| renderer.field.transform.vector_to_index(v);
        Self {
            ray,
            moves: seeds.ray.iter().any(|by| *by != RayGradient::default()),
            shift: seeds.ray.map(|by| to_index(by.origin)),
            turn: seeds.ray.map(|by| to_index(by.direction)),
        }
    }

    /// Returns the change of a point that is fixed to the ray, at world length `t` from its origin, along direction
    /// `p`.
    fn point(&self, t: f64, p: usize) -> DVec3 {
        self.shift[p] + t * self.turn[p]
    }

    /// Returns the world length at which a segment's cell is entered or left, with its derivatives; faces stand still.
    fn face<R: Real>(&self, renderer: &Preshaded<'_, R>, t: f64) -> Dual<f64, P> {
        let crossed = self.ray.crossed(&renderer.field.domain, t).filter(|_| self.moves);
        let by = |p: usize| crossed.map_or(0.0, |(axis, along)| -self.point(t, p)[axis] / along);
        Dual { value: t, tangent: std::array::from_fn(by) }
    }
}

/// Optical depth and light so far.
struct Front<const P: usize> {
    depth: Dual<f64, P>,
    emitted: [Dual<f64, P>; 3],
}

impl<const P: usize> Front<P> {
    /// Adds a segment.
    fn pass<R: Real>(
        &mut self,
        renderer: &Preshaded<'_, R>,
        motion: &Motion<P>,
        seeds: &Seeds<'_, R::Lanes, P>,
        segment: &Segment<R>,
    ) {
        let [enter, leave] = segment.faces.map(|t| motion.face(renderer, t));
        let (cell, [begin, end]) = (leave - enter, segment.ends);
        let mut half = cell.linear(|length| 0.5 * (end - begin) * length);
        half.value = segment.half.f64();
        let mut values = segment.values.map(Dual::<R::Lanes, P>::constant);
        if motion.moves {
            for (k, value) in values.iter_mut().enumerate() {
                let slopes = segment.slopes(&renderer.field.values, k);
                let position = enter + cell.linear(|length| (begin + (end - begin) * POINTS[k]) * length);
                for p in 0..P {
                    let by = motion.point(position.value, p) + position.tangent[p] * motion.ray.direction();
                    for (a, slope) in slopes.into_iter().enumerate() {
                        value.tangent[p] += slope * R::Lanes::splat(R::of(by[a]));
                    }
                }
            }
        }
        for (p, by) in seeds.voxels.iter().enumerate().filter_map(|(p, by)| Some((p, (*by)?))) {
            let added = segment.interpolated(by);
            values.iter_mut().zip(added).for_each(|(value, added)| value.tangent[p] += added);
        }
        let channel = |k: usize, c: usize| values[k].linear(|v| v.store()[c].f64());
        let extinctions = [channel(0, 3), channel(1, 3)];
        for k in 0..2 {
            let mean = extinctions[0].linear(|s| UP_TO[k][0] * s) + extinctions[1].linear(|s| UP_TO[k][1] * s);
            let depth = self.depth + (half + half) * mean;
            let transmittance = segment.transmittances[k].f64();
            let share = depth.function(transmittance, -transmittance) * half;
            for (c, emitted) in self.emitted.iter_mut().enumerate() {
                *emitted = *emitted + share * channel(k, c);
            }
        }
        self.depth = self.depth + half * (extinctions[0] + extinctions[1]);
    }
}
