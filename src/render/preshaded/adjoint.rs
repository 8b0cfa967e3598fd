//! The gradient of a loss on one pixel with respect to everything along its ray.
//!
//! Let `G_k = -share_k g·e_k` be the derivative by the optical depth up to point k, and B the sum of those beyond
//! a stretch, `-T (g·background - g_α)` of its end included: an extinction in the stretch has B by the stretch's
//! whole depth, and both G_k by the depths up to its points.
//!
//! With `∂L/∂v` the derivative by the four values at a point at world length t from the origin, `∂v/∂p` their slopes
//! by index coordinates (x, y, z), and M the linear part of world to index, the ray has
//!
//! ```text
//! ∂L/∂origin = Mᵀ (Σ ∂L/∂v ∂v/∂p - F)        ∂L/∂direction = Mᵀ (Σ t ∂L/∂v ∂v/∂p - t F)
//! ```
//! Cells' faces stand still, so that where the ray crosses them moves along it: F, along a face's axis, is the
//! derivative by the world length to it over the coordinate gained a world length. It is what the integral gains at
//! entry and exit of the field's box; in between, where it does not depend on where it is cut, it is what the
//! quadrature's error does. Derivatives are those of what is computed, to rounding; where a ray grazes faces these are
//! left out.

use super::stretch::scatter;
use super::tape::Tape;
use super::{Preshaded, Radiance};
use crate::lanes::Lanes;
use crate::math::Ray;
use crate::real::Real;
use crate::render::arch::Arch;
use crate::render::dvr::{Loss, RayGradient};
use crate::render::moved::Moved;
use glam::DVec3;

/// Where a gradient is added to; what is `None` is not computed.
#[derive(Debug)]
pub struct Sinks<'g, R: Real> {
    /// By stored value, as in [`Bricks::values`](crate::scene::bricks::Bricks::values): emissions in R, G and B,
    /// and extinction.
    pub values: Option<&'g mut [R::Lanes]>,
    /// Of this ray, in world space; it has no step.
    pub ray: Option<&'g mut RayGradient>,
    /// By the background's R, G and B.
    pub background: &'g mut [f64; 3],
}

impl<R: Real> Preshaded<'_, R> {
    /// Radiance along a world ray of unit direction, and the gradient of a loss on it: `loss` maps the radiance to
    /// the derivative with respect to R, G, B and alpha. Rays on the tape stay there.
    #[inline(always)]
    pub fn gradient(&self, ray: &Ray, loss: Loss<'_, R>, sinks: Sinks<'_, R>, tape: &mut Tape<R>) -> Radiance<R> {
        let Sinks { values: mut by_value, ray: by_ray, background } = sinks;
        let ray = self.index_ray(ray);
        let stretches = &mut tape.stretches;
        stretches.clear();
        let seen = self.walk(
            ray.as_ref(),
            #[inline(always)]
            |stretch| stretches.push(*stretch),
        );
        let [r, g, b, alpha] = loss(&seen);
        let weights = R::Lanes::load([r, g, b, R::ZERO]);
        let transmittance = (-seen.depth).exp();
        let mut beyond = transmittance * alpha.f64();
        for (c, weight) in [r, g, b].into_iter().enumerate() {
            background[c] += weight.f64() * transmittance;
            beyond -= weight.f64() * transmittance * f64::from(self.background[c]);
        }
        let Some(ray) = ray else { return seen };
        let mut moved = Moved::default();
        for stretch in stretches.iter().rev() {
            let lit = stretch.lit(weights);
            let by_depths = lit.map(|lit| -stretch.half.f64() * lit);
            let (shares, mut by_reached) = (stretch.shares(), [0.0; 2]);
            for k in 0..2 {
                let by_extinction = R::of(stretch.by_extinction(k, by_depths, beyond));
                let by =
                    weights * R::Lanes::splat(shares[k]) + R::Lanes::load([R::ZERO, R::ZERO, R::ZERO, by_extinction]);
                if let Some(by_value) = by_value.as_deref_mut() {
                    scatter::<R>(by_value, stretch.offset, &stretch.weights[k], by);
                }
                if by_ray.is_some() {
                    let slopes = stretch.slopes(&self.field.values, k);
                    let shift = DVec3::from_array(slopes.map(|slope| (by * slope).sum().f64()));
                    by_reached[k] = shift.dot(ray.direction());
                    moved.shift += shift;
                    moved.turn += stretch.reached(k) * shift;
                }
            }
            if by_ray.is_some() {
                let by_faces = stretch.by_faces(lit, by_depths, beyond, by_reached);
                for (t, by) in stretch.faces.into_iter().zip(by_faces) {
                    moved.stop(ray.crossed(&self.field.domain, t), t, by);
                }
            }
            beyond += by_depths[0] + by_depths[1];
        }
        if let Some(by_ray) = by_ray {
            moved.hand_over(&self.field.transform, by_ray);
        }
        seen
    }
}

impl Preshaded<'_, f32> {
    /// [`Preshaded::gradient`] with the machine's instruction set.
    pub fn gradient_on(
        &self,
        ray: &Ray,
        loss: Loss<'_, f32>,
        sinks: Sinks<'_, f32>,
        tape: &mut Tape<f32>,
    ) -> Radiance<f32> {
        Arch::default().dispatch(Gradient { renderer: self, ray, loss, sinks, tape })
    }
}

/// The unit that is compiled for each instruction set.
struct Gradient<'a, 'd> {
    renderer: &'a Preshaded<'d, f32>,
    ray: &'a Ray,
    loss: Loss<'a, f32>,
    sinks: Sinks<'a, f32>,
    tape: &'a mut Tape<f32>,
}

impl pulp::NullaryFnOnce for Gradient<'_, '_> {
    type Output = Radiance<f32>;

    #[inline(always)]
    fn call(self) -> Radiance<f32> {
        self.renderer.gradient(self.ray, self.loss, self.sinks, self.tape)
    }
}
