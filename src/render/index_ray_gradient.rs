//! Derivatives with respect to a ray in index space, collected from its points and ends.

use crate::math::Affine;
use crate::render::differentiable::RayGradient;
use glam::DVec3;

/// Derivatives of the loss with respect to the position of a ray's points, in index space.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct IndexRayGradient {
    /// Derivative with respect to a shift of all points.
    pub shift: DVec3,
    /// Derivative with respect to a shift that grows with the world length from the origin.
    pub turn: DVec3,
    /// Derivative with respect to the world length at which the ray enters the medium's box.
    pub enter: f64,
    /// Derivative with respect to the world length at which the ray leaves the medium's box.
    pub leave: f64,
    /// Derivative with respect to the quadrature's step, in world length.
    pub step: f64,
}

impl IndexRayGradient {
    /// Adds a derivative with respect to the world length at which the ray meets a face, given by its axis and the
    /// coordinate gained along it per world length. The face stands still: t = (face - o) / d. Without a face nothing
    /// is added.
    #[inline(always)]
    pub(crate) fn add_face(&mut self, face: Option<(usize, f64)>, t: f64, by: f64) {
        if let Some((axis, along)) = face {
            self.shift[axis] -= by / along;
            self.turn[axis] -= by * t / along;
        }
    }

    /// Adds the derivatives with respect to the ray's origin and direction, transformed to world space, to `to`.
    #[inline(never)]
    pub(crate) fn add_to(&self, transform: &Affine, to: &mut RayGradient) {
        let to_world = transform.inverse_matrix().transpose();
        to.origin += to_world.transform_vector3(self.shift);
        to.direction += to_world.transform_vector3(self.turn);
    }
}
