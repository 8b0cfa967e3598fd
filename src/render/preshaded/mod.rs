//! Rendering of a pre-shaded volume: emission and extinction are fields of their own.
//!
//! `L = ∫ T e dt + T(end) · background` with e the radiance emitted per world length and `T = exp(-∫ σ)`; both are
//! trilinear. (Interpolating e, not the color `e / σ`, corresponds to associated colors in pictures: Wittenbrink,
//! Malzbender & Goss 1998.) e is linear in the voxels, and so is the picture for a fixed σ.
//!
//! Each cell has two Gauss points, which are exact for its optical depth x. At them the transmittance follows from an
//! extinction that is linear in between (the Gauss collocation of order 4; Hairer, Nørsett & Wanner 1993, sect. II.7):
//! a constant source errs by x⁴/4320 of itself, one that is as rough as voxels can be by up to 2e-4, less than half a
//! step of half-precision pictures. Cells that are thicker are cut.

mod adjoint;
mod blend;
mod segment;
mod tangent;
mod tape;

pub use tape::Tape;

use crate::arch::Arch;
use crate::math::Ray;
use crate::real::Lanes;
use crate::real::Real;
use crate::render::composited::Composited;
use crate::render::compositing;
use crate::render::differentiable::{Accumulators, Adjoint, Differentiable, Forward, Loss, Seeds, TangentRadiance};
use crate::render::emission_absorption::{EmissionAbsorption, Radiance};
use crate::render::march::IndexRay;
use crate::scene::bricks::{Bricks, CELLS};
use blend::{Blend, Footprints};
use rayon::prelude::*;

/// Renderer of a pre-shaded volume in precision `R`.
#[derive(Debug, Clone)]
pub struct Preshaded<'a, R: Real> {
    field: &'a Bricks<R::Lanes>,
    depth_limit: f64,
}

impl<'a, R: Real> Preshaded<'a, R> {
    /// Creates a renderer whose rays end once at most 1e-6 of the light from behind could reach the eye.
    pub fn new(field: &'a Bricks<R::Lanes>) -> Self {
        Self { field, depth_limit: 0.0 }.early_stop(1e-6)
    }

    /// Composites the volume over a constant background.
    pub fn over(self, background: [f32; 3]) -> Composited<Self> {
        Composited { medium: self, background }
    }

    /// Ends a ray once its transmittance is below `transmittance` (0: never); [`Composited::left_out`] bounds the
    /// error.
    #[must_use]
    pub fn early_stop(mut self, transmittance: f64) -> Self {
        self.depth_limit = -transmittance.ln();
        self
    }

    /// Returns the transmittance at which a ray ends.
    pub(crate) fn least_transmittance(&self) -> f64 {
        (-self.depth_limit).exp()
    }

    /// Returns the largest ratio of emission and extinction, and an upper bound of the radiance emitted along the box's
    /// diagonal, in any channel.
    pub fn brightest(&self) -> [f64; 2] {
        let of = |v: &R::Lanes| {
            let [r, g, b, extinction] = v.store().map(Real::f64);
            let emitted = r.max(g).max(b).max(0.0);
            (emitted, if emitted > 0.0 { emitted / extinction.max(0.0) } else { 0.0 })
        };
        let larger = |a: (f64, f64), b: (f64, f64)| (a.0.max(b.0), a.1.max(b.1));
        let (emitted, ratio) = self.field.values.par_iter().map(of).reduce(|| (0.0, 0.0), larger);
        [ratio, emitted * self.field.transform.box_to_world(self.field.domain).size().length()]
    }

    /// Returns the volume that is rendered.
    pub fn field(&self) -> &'a Bricks<R::Lanes> {
        self.field
    }

    /// Returns the radiance along a world ray of unit direction, and appends the ray to the tape.
    #[inline(always)]
    pub fn trace(&self, ray: &Ray, tape: &mut Tape<R>) -> Radiance {
        let mut blend = Footprints(Blend::new(self));
        if let Some(ray) = self.index_ray(ray) {
            compositing::record(&self.field.topology, &ray, Adjoint::Tape, &mut blend, &mut tape.footprints);
        }
        blend.0.radiance()
    }

    /// Returns the radiance along a world ray of unit direction.
    #[inline(always)]
    fn radiance_with(&self, ray: &Ray, tape: &mut Tape<R>) -> Radiance {
        let mut blend = Blend::new(self);
        if let Some(ray) = self.index_ray(ray) {
            compositing::value(&self.field.topology, &ray, &mut blend, &mut tape.segments);
        }
        blend.radiance()
    }

    #[inline(always)]
    fn index_ray(&self, ray: &Ray) -> Option<IndexRay> {
        IndexRay::new(&self.field.domain, &self.field.transform, ray)
    }
}

/// The unit that is compiled for each instruction set.
struct Value<'a, 'd, R: Real> {
    renderer: &'a Preshaded<'d, R>,
    ray: &'a Ray,
    tape: &'a mut Tape<R>,
}

impl<R: Real> pulp::NullaryFnOnce for Value<'_, '_, R> {
    type Output = Radiance;

    #[inline(always)]
    fn call(self) -> Radiance {
        self.renderer.radiance_with(self.ray, self.tape)
    }
}

impl<R: Real> Composited<Preshaded<'_, R>> {
    /// Returns a bound of the change that ending rays early makes in any channel of a pixel, alpha included. Behind a
    /// transmittance T the radiance is at most T times the greater of background and the brightest ratio of emission to
    /// extinction, and at most T times the sum of background and emission along the box's diagonal; the picture has T
    /// times the background instead.
    pub fn left_out(&self) -> f64 {
        self.medium.least_transmittance() * self.unit()
    }

    /// Returns the radiance that is the bound at a transmittance of 1.
    pub(crate) fn unit(&self) -> f64 {
        let ([ratio, emitted], background) = (self.medium.brightest(), self.brightest_background());
        ratio.max(background).min(emitted + background).max(1.0)
    }
}

impl<R: Real> EmissionAbsorption for Preshaded<'_, R> {
    type Real = R;
    type Scratch = Tape<R>;

    fn integrate(&self, ray: &Ray, tape: &mut Tape<R>) -> Radiance {
        Arch::default().dispatch(Value { renderer: self, ray, tape })
    }
}

impl<R: Real> Differentiable for Preshaded<'_, R> {
    type Voxel = R::Lanes;

    fn field(&self) -> &Bricks<R::Lanes> {
        self.field
    }

    fn lookups(&self, _: bool) -> Vec<f32> {
        // All are alike: two points a cell, of four numbers.
        vec![8.0 * CELLS as f32; self.field.topology.len()]
    }

    fn vjp(
        &self,
        ray: &Ray,
        loss: Loss<'_, R>,
        adjoint: Adjoint,
        to: Accumulators<'_, R::Lanes>,
        tape: &mut Tape<R>,
    ) -> Radiance {
        self.gradient_on(ray, loss, adjoint, to, tape)
    }
}

impl<R: Real, const P: usize> Forward<P> for Preshaded<'_, R> {
    fn jvp(&self, ray: &Ray, seeds: &Seeds<'_, R::Lanes, P>, tape: &mut Tape<R>) -> TangentRadiance<P> {
        self.tangent(ray, seeds, tape)
    }
}
