//! Normal equations of texels, in blocks: all channels share the colors' block.

use crate::scene::table::Rgbs;
use glam::{DVec4, Vec4};
use nalgebra::{DMatrix, DVector};

/// `Jᵀ J` and `Jᵀ r` of pixels, by texel.
#[derive(Debug, Clone)]
pub(super) struct Normal {
    count: usize,
    /// Extinction by extinction; upper triangle.
    ss: Vec<f64>,
    /// Extinction by color, for each channel.
    sc: [Vec<f64>; 3],
    /// Color by color, for every channel.
    cc: Vec<f64>,
    /// `Jᵀ r` by extinction, red, green, blue.
    gradient: [Vec<f64>; 4],
    /// `Σ r²`.
    pub cost: f64,
}

/// Derivatives of one pixel with respect to the texels it depends on.
#[derive(Debug, Clone, Default)]
pub(super) struct Row {
    /// Which texels, ascending.
    pub texels: Vec<u32>,
    /// Of red, green, blue and alpha by extinction.
    pub by_extinction: Vec<Vec4>,
    /// Of any channel by its color.
    pub by_color: Vec<f32>,
    /// Rendered less target values.
    pub residual: [f64; 4],
}

/// Sums over some thousand pixels, as they come. Products are added in single precision: a step that they make wrong by
/// a millionth leads where the gradient says, which is in double precision.
#[derive(Debug, Clone)]
pub(super) struct Sums {
    count: usize,
    /// Row by row: red, green and blue by extinction i times their color j; color by color.
    mixed: Vec<Vec4>,
    /// Extinction by extinction, of each channel; on and above the diagonal.
    extinctions: Vec<Vec4>,
    gradient: [Vec<f64>; 4],
    cost: f64,
}

impl Sums {
    pub(crate) fn zeros(count: usize) -> Self {
        let (block, vector) = (vec![Vec4::ZERO; count * count], || vec![0.0; count]);
        Self {
            count,
            mixed: block.clone(),
            extinctions: block,
            gradient: [vector(), vector(), vector(), vector()],
            cost: 0.0,
        }
    }

    /// Adds pixels, texel by texel: those of one texel stay in the processor's nearest cache.
    pub(crate) fn add(&mut self, rows: &[Row]) {
        self.cost += rows.iter().flat_map(|row| row.residual).map(|r| r * r).sum::<f64>();
        let mut next = vec![0; rows.len()];
        for i in 0..self.count {
            let row_range = i * self.count..(i + 1) * self.count;
            let (mixed, extinctions) = (&mut self.mixed[row_range.clone()], &mut self.extinctions[row_range]);
            for (row, a) in rows.iter().zip(&mut next) {
                if row.texels.get(*a) != Some(&(i as u32)) {
                    continue;
                }
                let (own, color) = (row.by_extinction[*a], row.by_color[*a]);
                self.gradient[0][i] += own.as_dvec4().dot(DVec4::from_array(row.residual));
                for c in 0..3 {
                    self.gradient[1 + c][i] += f64::from(color) * row.residual[c];
                }
                let with_color = own.truncate().extend(color);
                for (&j, &color) in row.texels.iter().zip(&row.by_color) {
                    mixed[j as usize] += with_color * color;
                }
                for (&j, &other) in row.texels[*a..].iter().zip(&row.by_extinction[*a..]) {
                    extinctions[j as usize] += own * other;
                }
                *a += 1;
            }
        }
    }
}

/// The smoothness prior: `weight · Σ (difference of neighbours)²`, extinctions in units of `scale`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Prior {
    pub weight: f64,
    pub scale: f64,
}

impl Prior {
    pub(crate) fn cost(&self, texels: &[Rgbs]) -> f64 {
        let of = |pair: &[Rgbs]| -> f64 { (0..4).map(|c| ((pair[1][c] - pair[0][c]) / self.unit(c)).powi(2)).sum() };
        self.weight * texels.windows(2).map(of).sum::<f64>()
    }

    fn unit(&self, channel: usize) -> f64 {
        if channel == 3 { self.scale } else { 1.0 }
    }
}

impl Normal {
    pub(crate) fn zeros(count: usize) -> Self {
        let block = || vec![0.0; count * count];
        let vector = || vec![0.0; count];
        Self {
            count,
            ss: block(),
            sc: [block(), block(), block()],
            cc: block(),
            gradient: [vector(), vector(), vector(), vector()],
            cost: 0.0,
        }
    }

    /// Adds what pixels summed up to.
    pub(crate) fn merge(&mut self, sums: &Sums) {
        for (k, (mixed, extinctions)) in sums.mixed.iter().zip(&sums.extinctions).enumerate() {
            let [red, green, blue, colors] = mixed.to_array().map(f64::from);
            for (sum, part) in self.sc.iter_mut().zip([red, green, blue]) {
                sum[k] += part;
            }
            self.cc[k] += colors;
            self.ss[k] += extinctions.as_dvec4().element_sum();
        }
        for (sum, part) in self.gradient.iter_mut().flatten().zip(sums.gradient.iter().flatten()) {
            *sum += part;
        }
        self.cost += sums.cost;
    }

    /// Mean of the diagonal: what the prior's weight is measured in.
    pub(crate) fn level(&self) -> f64 {
        let diagonal = |m: &[f64]| (0..self.count).map(|i| m[i * self.count + i]).sum::<f64>();
        (diagonal(&self.ss) + 3.0 * diagonal(&self.cc)) / (4 * self.count) as f64
    }

    /// The matrix of all unknowns, those of a channel together: extinctions first, or (`all` false) none.
    fn matrix(&self, all: bool) -> DMatrix<f64> {
        let n = self.count;
        let first = usize::from(all);
        let mut m = DMatrix::zeros((3 + first) * n, (3 + first) * n);
        for i in 0..n {
            for j in i..n {
                let (ss, cc) = (self.ss[i * n + j], self.cc[i * n + j]);
                if all {
                    (m[(i, j)], m[(j, i)]) = (ss, ss);
                }
                for c in 0..3 {
                    let at = (first + c) * n;
                    (m[(at + i, at + j)], m[(at + j, at + i)]) = (cc, cc);
                }
            }
            if all {
                for (c, sc) in self.sc.iter().enumerate() {
                    for j in 0..n {
                        (m[(i, (1 + c) * n + j)], m[((1 + c) * n + j, i)]) = (sc[i * n + j], sc[i * n + j]);
                    }
                }
            }
        }
        m
    }

    /// Texels after a step that is not allowed to make any value negative; `None` if the equations have no
    /// solution. Extinctions enter divided by the prior's scale, as their derivatives do.
    pub(crate) fn solve(&self, texels: &[Rgbs], prior: &Prior, damping: f64, all: bool) -> Option<Vec<Rgbs>> {
        let n = self.count;
        let channels: &[usize] = if all { &[3, 0, 1, 2] } else { &[0, 1, 2] };
        let mut x = DVector::zeros(channels.len() * n);
        let mut gradient = DVector::zeros(channels.len() * n);
        let mut matrix = self.matrix(all);
        for (block, &c) in channels.iter().enumerate() {
            for i in 0..n {
                x[block * n + i] = texels[i][c] / prior.unit(c);
                gradient[block * n + i] = self.gradient[(c + 1) % 4][i];
            }
            for i in 0..n - 1 {
                let (a, b) = (block * n + i, block * n + i + 1);
                let prior_derivative = prior.weight * (x[b] - x[a]);
                gradient[a] -= prior_derivative;
                gradient[b] += prior_derivative;
                for (i, j, v) in [(a, a, 1.0), (b, b, 1.0), (a, b, -1.0), (b, a, -1.0)] {
                    matrix[(i, j)] += v * prior.weight;
                }
            }
        }
        let floor = 1e-12 * self.level();
        for i in 0..x.len() {
            matrix[(i, i)] += damping * matrix[(i, i)] + floor;
        }
        let solution = bounded(&matrix, &gradient, &x)?;
        let mut out = texels.to_vec();
        for (block, &c) in channels.iter().enumerate() {
            for i in 0..n {
                out[i][c] = solution[block * n + i] * prior.unit(c);
            }
        }
        Some(out)
    }

    /// Share of the data in the curvature at each texel, of extinction and color.
    pub(crate) fn confidence(&self, prior: &Prior) -> Vec<[f64; 2]> {
        let n = self.count;
        let share = |m: &[f64], i: usize| {
            let own = m[i * n + i];
            own / (own + 2.0 * prior.weight).max(f64::MIN_POSITIVE)
        };
        (0..n).map(|i| [share(&self.ss, i), share(&self.cc, i)]).collect()
    }
}

/// `x + argmin ½ dᵀ M d + gᵀ d` with no element below zero: those that would be are held at zero, and the
/// rest is solved for again, on the same factors: with `Z` the columns of `M⁻¹` of those that are held since, `d + Z λ`
/// minimises the same where `λ` makes them zero.
pub(super) fn bounded(matrix: &DMatrix<f64>, gradient: &DVector<f64>, x: &DVector<f64>) -> Option<DVector<f64>> {
    let at_zero = |i: &usize| x[*i] <= 0.0 && gradient[*i] > 0.0;
    let free: Vec<usize> = (0..x.len()).filter(|i| !at_zero(i)).collect();
    let mut out = DVector::zeros(x.len());
    // Those held move to zero, which the rest feels.
    let to_zero: Vec<usize> = (0..x.len()).filter(|i| at_zero(i) && x[*i] != 0.0).collect();
    let right = DVector::from_iterator(
        free.len(),
        free.iter().map(|&i| -gradient[i] + to_zero.iter().map(|&j| matrix[(i, j)] * x[j]).sum::<f64>()),
    );
    let factors = matrix.select_rows(&free).select_columns(&free).cholesky()?;
    let unconstrained = factors.solve(&right);
    let (mut step, mut held, mut columns) = (unconstrained.clone(), Vec::new(), Vec::new());
    loop {
        if !step.iter().all(|d| d.is_finite()) {
            return None;
        }
        let below: Vec<usize> = (0..free.len()).filter(|k| !held.contains(k) && x[free[*k]] + step[*k] < 0.0).collect();
        if below.is_empty() {
            break;
        }
        for &k in &below {
            let mut unit = DVector::zeros(free.len());
            unit[k] = 1.0;
            columns.push(factors.solve(&unit));
        }
        held.extend(below);
        let n = held.len();
        let pulls = DMatrix::from_fn(n, n, |i, j| columns[j][held[i]]);
        let missing = DVector::from_fn(n, |i, _| -x[free[held[i]]] - unconstrained[held[i]]);
        // Rounding may leave it a little less than definite.
        let lambda = pulls.lu().solve(&missing)?;
        step.copy_from(&unconstrained);
        for (column, lambda) in columns.iter().zip(&lambda) {
            step.axpy(*lambda, column, 1.0);
        }
    }
    for (k, &i) in free.iter().enumerate() {
        out[i] = if held.contains(&k) { 0.0 } else { x[i] + step[k] };
    }
    Some(out)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    /// Where nothing is held the gradient is zero, however many rounds it took and whatever was at zero before.
    #[test]
    fn what_is_above_zero_is_where_the_gradient_vanishes() {
        let noise = |k: usize| ((k as f64 * 12.9898).sin() * 43_758.545_3).fract();
        let mut several = 0;
        for case in 0..40 {
            let n = 2 + case % 11;
            let factor = DMatrix::from_fn(n, n, |i, j| noise(1 + case * 977 + i * 31 + j));
            let m = &factor * factor.transpose() + DMatrix::identity(n, n) * 0.05;
            let gradient = DVector::from_fn(n, |i, _| noise(7 + case * 613 + i));
            let x = DVector::from_fn(n, |i, _| noise(3 + case * 389 + i).max(0.0));
            let solution = bounded(&m, &gradient, &x).unwrap();
            let left = &m * (&solution - &x) + &gradient;
            assert!(solution.iter().all(|v| *v >= 0.0), "{solution}");
            for i in (0..n).filter(|i| solution[*i] > 0.0) {
                assert!(left[i].abs() < 1e-9, "case {case}: {left} at {solution}");
            }
            several += usize::from(solution.iter().filter(|v| **v == 0.0).count() > 2);
        }
        assert!(several > 5, "some cases hold several");
    }

    #[test]
    fn what_would_be_negative_is_held_at_zero() {
        // ½ |d - (2, -3, 1)|² from (1, 1, 1) with the first two coupled.
        let m = DMatrix::from_row_slice(3, 3, &[2.0, 0.5, 0.0, 0.5, 2.0, 0.0, 0.0, 0.0, 1.0]);
        let x = DVector::from_vec(vec![1.0, 1.0, 1.0]);
        let solution = bounded(&m, &DVector::from_vec(vec![-2.0, 5.0, -1.0]), &x).unwrap();
        // The second is at zero: the first minimises 2 d²/2 + (-2 - 0.5) d.
        assert_eq!(solution[1], 0.0);
        assert!((solution[0] - 2.25).abs() < 1e-12 && (solution[2] - 2.0).abs() < 1e-12, "{solution}");
    }
}
