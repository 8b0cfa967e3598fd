//! What renderers have in common.

use super::dvr::{self, Adjoint, Directions, Dvr, Loss, ParameterGradient, Precision, Radiance, RayGradient};
use super::dvr::{Seeds, Sinks, TangentRadiance};
use super::preshaded::{self, Preshaded};
use crate::math::Ray;
use crate::real::Real;
use crate::scene::bricks::{Bricks, CELLS, Voxel};

/// What can be seen along rays, and how that changes.
pub trait Renderer: Sync {
    /// What it computes in.
    type Real: Real;
    /// What its field is made of.
    type Voxel: Voxel;
    /// Scratch memory of one thread.
    type Tape: Default + Send;
    /// What it shows.
    fn field(&self) -> &Bricks<Self::Voxel>;
    /// For each of the field's bricks what a ray through it takes, about, in look-ups of a voxel; nothing where it does
    /// not look: gradients by voxel are zero there. Rays that look for a gradient by the transfer function too
    /// (`by_table`) look everywhere.
    fn lookups(&self, by_table: bool) -> Vec<f32>;
    /// Radiance along a world ray of unit direction.
    fn seen(&self, ray: &Ray, tape: &mut Self::Tape) -> Radiance<Self::Real>;
    /// The same, and the gradient of a loss on it: `loss` maps the radiance to the derivative with respect to red, green,
    /// blue and alpha.
    fn gradient(
        &self,
        ray: &Ray,
        loss: Loss<'_, Self::Real>,
        adjoint: Adjoint,
        sinks: Sinks<'_, Self::Voxel>,
        tape: &mut Self::Tape,
    ) -> Radiance<Self::Real>;

    /// The same of a loss that is given by its derivatives; that by the ray alone is added to `by`.
    fn followed(
        &self,
        ray: &Ray,
        loss: [Self::Real; 4],
        by: &mut RayGradient,
        tape: &mut Self::Tape,
    ) -> Radiance<Self::Real> {
        let mut shared = ParameterGradient::default();
        let sinks = Sinks { voxels: None, table: None, ray: Some(by), shared: &mut shared };
        self.gradient(ray, &mut |_| loss, Adjoint::Tape, sinks, tape)
    }
}

/// A renderer with derivatives along `P` directions at once.
pub trait Tangent<const P: usize>: Renderer {
    /// Radiance along a world ray of unit direction, with the bits of [`Renderer::seen`], and its derivatives: what
    /// [`Renderer::gradient`] is the transpose of.
    fn tangent(
        &self,
        ray: &Ray,
        seeds: &Seeds<'_, Self::Voxel, P>,
        tape: &mut Self::Tape,
    ) -> TangentRadiance<Self::Real, P>;
}

impl<R: Precision> Renderer for Dvr<'_, R> {
    type Real = R;
    type Voxel = R;
    type Tape = dvr::Tape<R>;

    fn field(&self) -> &Bricks<R> {
        self.field()
    }

    fn lookups(&self, by_table: bool) -> Vec<f32> {
        self.lookups(by_table)
    }

    fn seen(&self, ray: &Ray, tape: &mut Self::Tape) -> Radiance<R> {
        self.radiance_on(ray, tape)
    }

    fn gradient(
        &self,
        ray: &Ray,
        loss: Loss<'_, R>,
        adjoint: Adjoint,
        sinks: Sinks<'_, R>,
        tape: &mut Self::Tape,
    ) -> Radiance<R> {
        self.gradient(ray, loss, adjoint, sinks, tape)
    }
}

impl<R: Directions<P>, const P: usize> Tangent<P> for Dvr<'_, R> {
    fn tangent(&self, ray: &Ray, seeds: &Seeds<'_, R, P>, tape: &mut Self::Tape) -> TangentRadiance<R, P> {
        self.tangent(ray, seeds, tape)
    }
}

impl<R: Real> Renderer for Preshaded<'_, R> {
    type Real = R;
    type Voxel = R::Lanes;
    type Tape = preshaded::Tape<R>;

    fn field(&self) -> &Bricks<R::Lanes> {
        self.field()
    }

    fn lookups(&self, _: bool) -> Vec<f32> {
        // All are alike: two points a cell, of four numbers.
        vec![8.0 * CELLS as f32; self.field().topology.len()]
    }

    fn seen(&self, ray: &Ray, tape: &mut Self::Tape) -> Radiance<R> {
        self.radiance_on(ray, tape)
    }

    fn gradient(
        &self,
        ray: &Ray,
        loss: Loss<'_, R>,
        adjoint: Adjoint,
        sinks: Sinks<'_, R::Lanes>,
        tape: &mut Self::Tape,
    ) -> Radiance<R> {
        self.gradient_on(ray, loss, adjoint, sinks, tape)
    }
}

impl<R: Real, const P: usize> Tangent<P> for Preshaded<'_, R> {
    fn tangent(&self, ray: &Ray, seeds: &Seeds<'_, R::Lanes, P>, tape: &mut Self::Tape) -> TangentRadiance<R, P> {
        self.tangent(ray, seeds, tape)
    }
}
