//! The gradient of a loss on one pixel with respect to the emissions and extinctions along its ray, and to the ray.
//!
//! Let `G_k = -share_k g·e_k` be the derivative with respect to the optical depth up to point k, and B the sum of those
//! behind a segment, that of the background, `-T (g·background - g_α)`, included: an extinction in the segment has B by
//! the segment's whole depth, and both G_k by the depths up to its points.
//!
//! With `∂L/∂v` the derivative with respect to the four values at a point at world length t from the origin, `∂v/∂p`
//! their slopes by index coordinates (x, y, z), and M the linear part of world to index, the ray has
//!
//! ```text
//! ∂L/∂origin = Mᵀ (Σ ∂L/∂v ∂v/∂p - F)        ∂L/∂direction = Mᵀ (Σ t ∂L/∂v ∂v/∂p - t F)
//! ```
//! Cells' faces stand still, so that the points where the ray crosses them move along it: F, along a face's axis, is
//! the derivative with respect to the world length to it over the coordinate gained per world length. At entry and exit
//! of the field's box this is the change of the integral; in between, where the integral does not depend on where it is
//! cut, it is the change of the quadrature's error. Derivatives are those of the computed value, to rounding; where a
//! ray grazes faces, the terms of the faces are left out.

use super::Preshaded;
use super::blend::{Blend, Front, segments};
use super::segment::{Segment, scatter};
use super::tape::Tape;
use crate::arch::Arch;
use crate::math::Ray;
use crate::real::Lanes;
use crate::real::Real;
use crate::render::compositing::{self, Backward};
use crate::render::differentiable::{Accumulators, Adjoint, Cotangent, Loss};
use crate::render::emission_absorption::Radiance;
use crate::render::index_ray_gradient::IndexRayGradient;
use crate::render::march::{IndexRay, Span};
use glam::DVec3;

impl<R: Real> Preshaded<'_, R> {
    /// Returns the radiance along a world ray of unit direction, and adds the gradient of a loss on it to the
    /// accumulators. There is no transfer function, and rays have no step. Traced rays on the tape stay there.
    #[inline(always)]
    pub(crate) fn gradient(
        &self,
        ray: &Ray,
        loss: Loss<'_, R>,
        adjoint: Adjoint,
        to: Accumulators<'_, R::Lanes>,
        tape: &mut Tape<R>,
    ) -> Radiance {
        let (mut blend, segments) = (Blend::new(self), &mut tape.segments);
        let Some(ray) = self.index_ray(ray) else {
            loss(&blend.radiance());
            return blend.radiance();
        };
        let topology = &self.field.topology;
        segments.clear();
        let last = compositing::record(topology, &ray, adjoint, &mut blend, segments);
        let radiance = blend.radiance();
        let Cotangent { rgb: [r, g, b], transmittance } = loss(&radiance);
        let by_depth = -radiance.transmittance() * transmittance;
        if adjoint == Adjoint::Inversion {
            let mut transmittance = R::of(radiance.transmittance());
            segments.iter_mut().rev().for_each(|segment| transmittance = segment.invert(transmittance));
        }
        let mut back = SegmentGradients {
            renderer: self,
            ray,
            weights: R::Lanes::load([r, g, b, R::ZERO]),
            by_depth,
            depth: radiance.depth - segments.iter().map(|segment| segment.depth().f64()).sum::<f64>(),
            to,
            by_ray: IndexRayGradient::default(),
        };
        compositing::backward(topology, &ray, (adjoint, last), &mut back, segments);
        back.finish();
        radiance
    }

    /// Computes [`Preshaded::gradient`] with the machine's instruction set.
    pub(crate) fn gradient_on(
        &self,
        ray: &Ray,
        loss: Loss<'_, R>,
        adjoint: Adjoint,
        to: Accumulators<'_, R::Lanes>,
        tape: &mut Tape<R>,
    ) -> Radiance {
        Arch::default().dispatch(Gradient { renderer: self, ray, loss, adjoint, to, tape })
    }
}

/// State of the backward pass.
struct SegmentGradients<'a, 'd, R: Real> {
    renderer: &'a Preshaded<'d, R>,
    ray: IndexRay,
    /// Derivatives of the loss with respect to red, green and blue; the last lane is 0.
    weights: R::Lanes,
    /// Sum of the derivatives with respect to optical depths behind the current segment.
    by_depth: f64,
    /// Optical depth from the eye to the segments on the tape.
    depth: f64,
    to: Accumulators<'a, R::Lanes>,
    /// Derivatives with respect to the ray, in index space.
    by_ray: IndexRayGradient,
}

impl<R: Real> Backward<R> for SegmentGradients<'_, '_, R> {
    type Entry = Segment<R>;

    #[inline(always)]
    fn add(&mut self, tape: &[Segment<R>]) {
        tape.iter().rev().for_each(
            #[inline(always)]
            |segment| self.step(segment),
        );
    }

    #[inline(always)]
    fn replay(&mut self, spans: &[Span<R>], tape: &mut Vec<Segment<R>>) {
        let depth = &mut self.depth;
        segments(
            &self.renderer.field.values,
            spans,
            #[inline(always)]
            |segment| {
                *depth -= segment.depth().f64();
                tape.push(*segment);
            },
        );
        let mut front = Front::at(self.depth);
        tape.iter_mut().for_each(|segment| front.add(segment));
        self.add(tape);
    }
}

impl<R: Real> SegmentGradients<'_, '_, R> {
    #[inline(always)]
    fn step(&mut self, segment: &Segment<R>) {
        let (follows, field) = (self.to.ray.is_some(), self.renderer.field);
        let emitted = segment.emitted(self.weights);
        let by_depths = emitted.map(|emitted| -segment.half.f64() * emitted);
        let (shares, mut by_positions) = (segment.shares(), [0.0; 2]);
        for k in 0..2 {
            let by_extinction = R::of(segment.by_extinction(k, by_depths, self.by_depth));
            let by =
                self.weights * R::Lanes::splat(shares[k]) + R::Lanes::load([R::ZERO, R::ZERO, R::ZERO, by_extinction]);
            if let Some(by_value) = self.to.voxels.as_deref_mut() {
                scatter::<R>(by_value, segment.offset, &segment.weights[k], by);
            }
            if follows {
                let slopes = segment.slopes(&field.values, k);
                let shift = DVec3::from_array(slopes.map(|slope| (by * slope).sum().f64()));
                by_positions[k] = shift.dot(self.ray.direction());
                self.by_ray.shift += shift;
                self.by_ray.turn += segment.position(k) * shift;
            }
        }
        if follows {
            let by_faces = segment.by_faces(emitted, by_depths, self.by_depth, by_positions);
            for (t, by) in segment.faces.into_iter().zip(by_faces) {
                self.by_ray.add_face(self.ray.crossed(&field.domain, t), t, by);
            }
        }
        self.by_depth += by_depths[0] + by_depths[1];
    }

    #[inline(always)]
    fn finish(self) {
        if let Some(by_ray) = self.to.ray {
            self.by_ray.add_to(&self.renderer.field.transform, by_ray);
        }
    }
}

/// The unit that is compiled for each instruction set.
struct Gradient<'a, 'd, R: Real> {
    renderer: &'a Preshaded<'d, R>,
    ray: &'a Ray,
    loss: Loss<'a, R>,
    adjoint: Adjoint,
    to: Accumulators<'a, R::Lanes>,
    tape: &'a mut Tape<R>,
}

impl<R: Real> pulp::NullaryFnOnce for Gradient<'_, '_, R> {
    type Output = Radiance;

    #[inline(always)]
    fn call(self) -> Radiance {
        self.renderer.gradient(self.ray, self.loss, self.adjoint, self.to, self.tape)
    }
}
