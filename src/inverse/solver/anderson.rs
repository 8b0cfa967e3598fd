//! Anderson acceleration of a fixed-point iteration `x ← g(x)` (Anderson 1965; Walker & Ni 2011, eq. 2.4).
//!
//! Of the last iterates the combination is taken whose steps `g(x) - x`, taken as linear in x, cancel best.

use nalgebra::{DMatrix, DVector};
use std::collections::VecDeque;

/// Share of a step's square below which combinations of former steps count as the same.
const SINGULAR: f64 = 1e-8;

/// The last iterates of an iteration.
#[derive(Debug)]
pub(crate) struct Anderson {
    /// Number of differences that are combined, at most.
    memory: usize,
    /// Pairs of `g(x)` and `g(x) - x`, the newest last.
    iterates: VecDeque<[DVector<f64>; 2]>,
}

impl Anderson {
    /// Begins an iteration that remembers so many differences of iterates.
    pub(crate) fn new(memory: usize) -> Self {
        Self { memory, iterates: VecDeque::new() }
    }

    /// Returns what follows on `x`, whose image is `g(x)`.
    pub(crate) fn next(&mut self, x: &DVector<f64>, image: DVector<f64>) -> DVector<f64> {
        let step = &image - x;
        self.iterates.push_back([image.clone(), step.clone()]);
        if self.iterates.len() > self.memory + 1 {
            self.iterates.pop_front();
        }
        let differences = |of: usize| -> Vec<DVector<f64>> {
            self.iterates.iter().zip(self.iterates.iter().skip(1)).map(|(a, b)| &b[of] - &a[of]).collect()
        };
        if self.iterates.len() < 2 {
            return image;
        }
        let [images, steps] = [0, 1].map(|of| DMatrix::from_columns(&differences(of)));
        let damping = DMatrix::identity(steps.ncols(), steps.ncols()) * (SINGULAR * step.norm_squared());
        let weights = (steps.tr_mul(&steps) + damping).cholesky().map(|split| split.solve(&steps.tr_mul(&step)));
        match weights {
            Some(weights) => image - images * weights,
            None => image,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A linear iteration in three dimensions is solved once three differences are known, slow as it is by itself.
    #[test]
    fn a_linear_iteration_ends_after_as_many_steps_as_it_has_dimensions() {
        let rates = DVector::from_vec(vec![0.95, -0.5, 0.7]);
        let fixed = DVector::from_vec(vec![1.0, -2.0, 3.0]);
        let image = |x: &DVector<f64>| &fixed + (x - &fixed).component_mul(&rates);
        let (mut accelerated, mut x, mut plain) = (Anderson::new(3), DVector::zeros(3), DVector::zeros(3));
        for _ in 0..5 {
            x = accelerated.next(&x, image(&x));
            plain = image(&plain);
        }
        assert!((&x - &fixed).norm() < 1e-5, "{x}");
        assert!((&plain - &fixed).norm() > 0.5, "{plain}");
    }

    #[test]
    fn an_iteration_that_has_ended_stays() {
        let (mut anderson, x) = (Anderson::new(2), DVector::from_vec(vec![1.0, 2.0]));
        for _ in 0..4 {
            assert_eq!(anderson.next(&x, x.clone()), x);
        }
    }
}
