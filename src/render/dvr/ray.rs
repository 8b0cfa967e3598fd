//! Derivatives with respect to a ray's origin and direction.

use super::CompiledCurve;
use super::adjoint::{Pass, Weighted};
use super::segment_derivatives::SegmentDerivatives;
use super::shade::{SegmentGradient, SegmentSource};
use crate::real::Real;
use crate::render::index_ray_gradient::IndexRayGradient;
use crate::render::rule::Rule;

impl<R: Real> Pass<'_, '_, R> {
    /// Returns the change of the loss-weighted light per world length that is added at world length `t`, in front of
    /// the loss-weighted radiance `beyond`.
    #[inline(never)]
    pub(super) fn gain<const C: usize>(
        &self,
        optics: &CompiledCurve<R, C>,
        t: f64,
        beyond: f64,
        weighted: &Weighted<C>,
    ) -> f64 {
        let density = self.dvr.field.sample(self.ray.at(t));
        let (line, extinction) = optics.at(density);
        extinction.f64() * (SegmentSource::new(line, density, &weighted.color).mean - beyond)
    }

    /// Adds a segment's derivatives with respect to the ray.
    #[inline(never)]
    pub(super) fn follow<S: SegmentDerivatives<R>, Q: Rule<R, C, Segment = S>, const C: usize>(
        &mut self,
        rule: Q,
        segment: &S,
        slopes: &SegmentGradient<R>,
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

    /// Adds the ray's derivatives, transformed to world space, to the accumulators.
    #[inline(never)]
    pub(super) fn hand_over(&mut self) {
        if let Some(ray) = self.to.ray.as_deref_mut() {
            let IndexRayGradient { enter, leave, .. } = self.moved;
            for (t, by) in [(self.ray.enter, enter), (self.ray.leave, leave)] {
                self.moved.add_face(self.ray.face(&self.dvr.field.domain, t), t, by);
            }
            self.moved.add_to(&self.dvr.field.transform, ray);
            ray.step += self.moved.step * self.dvr.voxel;
        }
    }
}
