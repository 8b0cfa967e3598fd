//! Equations with a penalty on differences of neighbours, for pictures with noise.
//!
//! What is minimised besides is `λ Σ (xᵢ - xⱼ)²` over neighbours, with zeros outside of the bricks: the most probable field
//! if noise is white and differences are independent and normal. Where the pictures say little, as behind an opaque
//! medium, they are left to their neighbours, which no early stop sees to.

use crate::optimise::region::neighbours::Neighbours;
use crate::optimise::solver::conjugate::{Equations, dot};
use crate::optimise::solver::smoother::laplacian;
use rayon::prelude::*;

/// Equations `E`, and the penalty with its weight λ.
#[derive(Debug)]
pub struct Rough<'a, E> {
    /// The equations themselves.
    pub equations: E,
    /// Weight λ; once it is changed the solver has to begin anew.
    pub weight: f64,
    neighbours: &'a Neighbours,
    differences: Vec<f32>,
}

impl<'a, E: Equations> Rough<'a, E> {
    /// Adds the penalty of weight `weight` to `equations`; the unknowns have these neighbours.
    pub fn new(equations: E, neighbours: &'a Neighbours, weight: f64) -> Self {
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

impl<E: Equations> Equations for Rough<'_, E> {
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
