//! Derivatives with respect to a ray's origin and direction.

use super::adjoint::{Pass, SegmentGradients};
use super::segment_derivatives::SegmentDerivatives;
use super::shade::{SegmentGradient, SegmentSource};
use crate::real::Real;
use crate::render::index_ray_gradient::IndexRayGradient;
use crate::render::quadrature::Rule;

impl<R: Real, S: SegmentDerivatives<R>, Q: Rule<R, C, Segment = S>, const C: usize>
    SegmentGradients<'_, '_, '_, R, Q, C>
{
    /// Adds the derivative with respect to the world length to the exit of the field's box, where the transmittance is
    /// given and the background arrives.
    #[inline(always)]
    pub(crate) fn add_exit(&mut self, transmittance: f64) {
        if self.pass.to.ray.is_some() && Q::BOUNDED {
            let by = self.gain(self.pass.ray.leave, self.weighted.transmittance);
            self.pass.by_ray.leave = transmittance * by;
        }
    }

    /// Adds the derivative with respect to the world length to the entry of the field's box, where the given
    /// loss-weighted radiance arrives.
    #[inline(always)]
    pub(crate) fn add_entry(&mut self, incoming: f64) {
        if self.pass.to.ray.is_some() && Q::BOUNDED {
            self.pass.by_ray.enter = -self.gain(self.pass.ray.enter, incoming);
        }
    }

    /// Returns the change of the loss-weighted radiance per world length that is added at world length `t`, in front of
    /// the loss-weighted radiance `incoming`.
    #[inline(never)]
    fn gain(&self, t: f64, incoming: f64) -> f64 {
        let density = self.pass.dvr.field.sample_at_end(self.pass.ray.at(t));
        let (piece, extinction) = self.compiled.at(density);
        extinction.f64() * (SegmentSource::new(piece, density, &self.weighted.color).mean - incoming)
    }

    /// Adds a segment's derivatives with respect to the ray.
    #[inline(never)]
    pub(super) fn add_ray(&mut self, segment: &S, gradient: &SegmentGradient<R>) {
        let pass = &mut *self.pass;
        let (shift, turn) = segment.ray_vjp(&pass.dvr.field.values, gradient.density);
        pass.by_ray.shift += shift;
        pass.by_ray.turn += turn;
        let by_position = shift.dot(pass.ray.direction());
        let [enter, leave, step] = self.rule.vjp(segment, gradient.length.f64(), by_position);
        pass.by_ray.enter += enter;
        pass.by_ray.leave += leave;
        pass.by_ray.step += step;
    }
}

impl<R: Real> Pass<'_, '_, R> {
    /// Adds the ray's derivatives, transformed to world space, to the accumulators.
    #[inline(never)]
    pub(super) fn finish_ray(&mut self) {
        if let Some(ray) = self.to.ray.as_deref_mut() {
            let IndexRayGradient { enter, leave, .. } = self.by_ray;
            for (t, by) in [(self.ray.enter, enter), (self.ray.leave, leave)] {
                self.by_ray.add_face(self.ray.face(&self.dvr.field.domain, t), t, by);
            }
            self.by_ray.add_to(&self.dvr.field.transform, ray);
            ray.step += self.by_ray.step * self.dvr.voxel;
        }
    }
}
