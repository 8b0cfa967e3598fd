//! Adam (Kingma & Ba 2015), also on non-negative unknowns, where the step is projected onto `x ≥ 0`.

use rayon::prelude::*;

/// First and second moments of the gradient.
#[derive(Debug, Clone)]
pub(crate) struct Adam {
    /// Learning rate, in the unknowns' units.
    pub rate: f32,
    step: i32,
    mean: Vec<f32>,
    square: Vec<f32>,
}

const BETA1: f32 = 0.9;
const BETA2: f32 = 0.999;
const EPSILON: f32 = 1e-8;

impl Adam {
    /// For `count` unknowns with learning rate `rate`, in the unknowns' units.
    pub(crate) fn new(count: usize, rate: f32) -> Self {
        Self { rate, step: 0, mean: vec![0.0; count], square: vec![0.0; count] }
    }

    /// One step against the gradient where `mask` is 1, projected onto `x ≥ 0`.
    pub(crate) fn step(&mut self, x: &mut [f32], gradient: &[f32], mask: &[f32]) {
        self.advance(x, gradient, |i, x| mask[i] * x.max(0.0));
    }

    /// One step against the gradient, wherever it leads.
    pub(crate) fn step_free(&mut self, x: &mut [f32], gradient: &[f32]) {
        self.advance(x, gradient, |_, x| x);
    }

    fn advance(&mut self, x: &mut [f32], gradient: &[f32], project: impl Fn(usize, f32) -> f32 + Sync) {
        self.step += 1;
        let (c1, c2) = (1.0 - BETA1.powi(self.step), 1.0 - BETA2.powi(self.step));
        let rate = self.rate;
        x.par_iter_mut()
            .zip(gradient)
            .zip(self.mean.par_iter_mut().zip(self.square.par_iter_mut()))
            .enumerate()
            .for_each(|(i, ((x, g), (m, s)))| {
                *m = BETA1 * *m + (1.0 - BETA1) * g;
                *s = BETA2 * *s + (1.0 - BETA2) * g * g;
                *x = project(i, *x - rate * (*m / c1) / ((*s / c2).sqrt() + EPSILON));
            });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A quadratic bowl with one coordinate whose minimum is not allowed.
    #[test]
    fn finds_the_constrained_minimum() {
        let (mut x, mask) = (vec![1.0_f32; 3], [1.0; 3]);
        let mut adam = Adam::new(3, 0.02);
        for _ in 0..2000 {
            let g = [2.0 * (x[0] - 0.5), 20.0 * (x[1] - 2.0), 2.0 * (x[2] + 1.0)];
            adam.step(&mut x, &g, &mask);
        }
        assert!((x[0] - 0.5).abs() < 1e-3 && (x[1] - 2.0).abs() < 1e-3 && x[2] == 0.0, "{x:?}");
    }
}
