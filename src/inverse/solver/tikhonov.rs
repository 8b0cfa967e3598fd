//! Tikhonov regularization: equations with a penalty on differences of neighbours, for pictures with noise.
//!
//! What is minimised besides is `λ Σ (xᵢ - xⱼ)²` over neighbours, with zeros outside of the bricks: the most probable
//! field if noise is white and differences are independent and normal. Where the pictures say little, as behind an
//! opaque medium, voxels follow their neighbours, which no early stop sees to.

use crate::inverse::solver::conjugate::{Equations, dot};
use crate::inverse::solver::smoother::laplacian;
use crate::scene::neighbours::Neighbours;
use rayon::prelude::*;

/// Equations `E`, and the penalty with its weight λ.
#[derive(Debug)]
pub(crate) struct Tikhonov<'a, E> {
    /// The equations themselves.
    pub equations: E,
    /// Weight λ; once it is changed the solver has to begin anew.
    pub weight: f64,
    neighbours: &'a Neighbours,
    differences: Vec<f32>,
}

impl<'a, E: Equations> Tikhonov<'a, E> {
    /// Adds the penalty of weight `weight` to `equations`; the unknowns have these neighbours.
    pub(crate) fn new(equations: E, neighbours: &'a Neighbours, weight: f64) -> Self {
        Self { equations, weight, neighbours, differences: Vec::new() }
    }

    /// Adds `scale λ L x` to `out` and returns `λ ⟨x, L x⟩`.
    fn add(&mut self, x: &[f32], scale: f32, out: &mut [f32]) -> f64 {
        if self.weight == 0.0 {
            return 0.0;
        }
        self.differences.resize(x.len(), 0.0);
        laplacian(self.neighbours, x, &mut self.differences);
        let weight = scale * self.weight as f32;
        out.par_iter_mut().zip(&self.differences).for_each(|(o, d)| *o += weight * d);
        self.weight * dot(x, &self.differences)
    }
}

impl<E: Equations> Equations for Tikhonov<'_, E> {
    fn rows(&self) -> usize {
        self.equations.rows()
    }

    fn normal(&mut self, x: &[f32], out: &mut [f32]) -> f64 {
        let curvature = self.equations.normal(x, out);
        curvature + self.add(x, 1.0, out)
    }

    fn residual(&mut self, x: &[f32], bound: f64, out: &mut [f32]) -> [f64; 2] {
        let [absolute, square] = self.equations.residual(x, bound, out);
        [absolute, square + self.add(x, -1.0, out)]
    }

    fn cancelled(&self) -> bool {
        self.equations.cancelled()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::bricks::Topology;
    use crate::scene::grid::LEAF_VOXELS;
    use glam::IVec3;

    /// No rows at all: what is left is the penalty.
    struct Nothing;

    impl Equations for Nothing {
        fn rows(&self) -> usize {
            0
        }

        fn normal(&mut self, _: &[f32], out: &mut [f32]) -> f64 {
            out.fill(0.0);
            0.0
        }

        fn residual(&mut self, _: &[f32], _: f64, out: &mut [f32]) -> [f64; 2] {
            out.fill(0.0);
            [0.0; 2]
        }
    }

    /// Half of the gradient of `λ Σ (xᵢ - xⱼ)²` is `λ L x`, and the residual is its negative.
    #[test]
    fn the_penalty_and_its_gradient_agree() -> crate::error::Result<()> {
        let neighbours = Neighbours::new(&Topology::new([IVec3::ZERO, IVec3::X])?);
        let mut x = vec![0.0; 2 * LEAF_VOXELS];
        // The last voxel of the first brick along x, in its middle, and one beside it in the second.
        let (own, beside) = (7 * 64 + 3 * 8 + 3, LEAF_VOXELS + 3 * 8 + 3);
        (x[own], x[beside]) = (2.0, 1.0);
        let mut tikhonov = Tikhonov::new(Nothing, &neighbours, 0.5);
        let mut out = vec![0.0; x.len()];
        // Five differences of 2 and of 1 with zeros, and one of 1 between the two.
        assert_eq!(tikhonov.normal(&x, &mut out), 0.5 * (5.0 * 4.0 + 5.0 + 1.0));
        assert_eq!((out[own], out[beside], out[own - 64]), (0.5 * (12.0 - 1.0), 0.5 * (6.0 - 2.0), -1.0));
        let gradient = out.clone();
        assert_eq!(tikhonov.residual(&x, f64::INFINITY, &mut out), [0.0, 13.0]);
        assert!(out.iter().zip(gradient).all(|(r, g)| *r == -g));
        Ok(())
    }
}
