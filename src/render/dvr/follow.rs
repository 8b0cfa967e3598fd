//! Derivatives with respect to where a ray begins and goes.

use super::Optics;
use super::adjoint::{Pass, Weighted};
use super::light::{Glow, Slopes};
use super::traced::Traced;
use crate::real::Real;
use crate::render::rule::Rule;
use glam::DVec3;

/// Derivatives with respect to where a ray's points lie, in index space.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Moved {
    /// With respect to a shift of all points.
    pub shift: DVec3,
    /// With respect to a shift that grows with the world length from the origin.
    pub turn: DVec3,
    /// With respect to the world length at which the ray enters the medium's box, and leaves it.
    pub enter: f64,
    pub leave: f64,
    /// With respect to the quadrature's step, in world length.
    pub step: f64,
}

impl<R: Real> Pass<'_, '_, R> {
    /// Loss-weighted light that a unit of length at world length `t` adds, in front of light `beyond`.
    #[inline(never)]
    pub(super) fn gain<const C: usize>(
        &self,
        optics: &Optics<R, C>,
        t: f64,
        beyond: f64,
        weighted: &Weighted<C>,
    ) -> f64 {
        let density = self.dvr.field.sample(self.ray.at(t));
        let (line, extinction) = optics.at(density);
        extinction.f64() * (Glow::new(line, density, &weighted.colour).mean - beyond)
    }

    /// Notes what a segment's points ask the ray to do.
    #[inline(never)]
    pub(super) fn follow<S: Traced<R>, Q: Rule<R, C, Segment = S>, const C: usize>(
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

    /// Brings the ray's derivatives to world space.
    #[inline(never)]
    pub(super) fn hand_over(&mut self) {
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
