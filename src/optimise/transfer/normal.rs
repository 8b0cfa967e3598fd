//! Normal equations of texels, in blocks: all channels share the colours' block.

use crate::scene::table::Rgbs;
use nalgebra::{DMatrix, DVector};

/// `Jᵀ J` and `Jᵀ r` of pixels, by texel.
#[derive(Debug, Clone)]
pub(super) struct Normal {
    count: usize,
    /// Extinction by extinction; upper triangle.
    ss: Vec<f64>,
    /// Extinction by colour, for each channel.
    sc: [Vec<f64>; 3],
    /// Colour by colour, for every channel; upper triangle.
    cc: Vec<f64>,
    /// `Jᵀ r` by extinction, red, green, blue.
    slope: [Vec<f64>; 4],
    /// `Σ r²`.
    pub cost: f64,
}

/// Derivatives of one pixel with respect to the texels it depends on.
#[derive(Debug, Clone, Default)]
pub(super) struct Row {
    /// Which texels.
    pub texels: Vec<usize>,
    /// Of red, green, blue and alpha by extinction.
    pub by_extinction: [Vec<f64>; 4],
    /// Of any channel by its colour.
    pub by_colour: Vec<f64>,
    /// Seen less wanted.
    pub residual: [f64; 4],
}

impl Row {
    /// Leaves out the texels that nothing depends on; before, there is an entry for each.
    pub fn compact(&mut self) {
        let depends = |j: usize| self.by_colour[j] != 0.0 || self.by_extinction.iter().any(|by| by[j] != 0.0);
        self.texels.clear();
        self.texels.extend((0..self.by_colour.len()).filter(|j| depends(*j)));
        for values in self.by_extinction.iter_mut().chain([&mut self.by_colour]) {
            for (k, &j) in self.texels.iter().enumerate() {
                values[k] = values[j];
            }
            values.truncate(self.texels.len());
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
    pub fn cost(&self, texels: &[Rgbs]) -> f64 {
        let of = |pair: &[Rgbs]| -> f64 { (0..4).map(|c| ((pair[1][c] - pair[0][c]) / self.unit(c)).powi(2)).sum() };
        self.weight * texels.windows(2).map(of).sum::<f64>()
    }

    fn unit(&self, channel: usize) -> f64 {
        if channel == 3 { self.scale } else { 1.0 }
    }
}

impl Normal {
    pub fn zeros(count: usize) -> Self {
        let block = || vec![0.0; count * count];
        let line = || vec![0.0; count];
        Self {
            count,
            ss: block(),
            sc: [block(), block(), block()],
            cc: block(),
            slope: [line(), line(), line(), line()],
            cost: 0.0,
        }
    }

    /// How many texels there are.
    pub fn texels(&self) -> usize {
        self.count
    }

    /// Adds one pixel.
    pub fn add(&mut self, row: &Row) {
        self.cost += row.residual.iter().map(|r| r * r).sum::<f64>();
        let [red, green, blue, alpha] = &row.by_extinction;
        for (a, &i) in row.texels.iter().enumerate() {
            let (r, g, b, t, w) = (red[a], green[a], blue[a], alpha[a], row.by_colour[a]);
            let residual = row.residual;
            self.slope[0][i] += r * residual[0] + g * residual[1] + b * residual[2] + t * residual[3];
            for c in 0..3 {
                self.slope[1 + c][i] += w * residual[c];
            }
            let line = i * self.count;
            for (k, &j) in row.texels.iter().enumerate() {
                let by_colour = row.by_colour[k];
                self.sc[0][line + j] += r * by_colour;
                self.sc[1][line + j] += g * by_colour;
                self.sc[2][line + j] += b * by_colour;
                if j >= i {
                    self.ss[line + j] += r * red[k] + g * green[k] + b * blue[k] + t * alpha[k];
                    self.cc[line + j] += w * by_colour;
                }
            }
        }
    }

    /// Adds another's sums.
    pub fn merge(&mut self, other: &Self) {
        let add = |a: &mut [f64], b: &[f64]| a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
        add(&mut self.ss, &other.ss);
        add(&mut self.cc, &other.cc);
        for c in 0..3 {
            add(&mut self.sc[c], &other.sc[c]);
        }
        for c in 0..4 {
            add(&mut self.slope[c], &other.slope[c]);
        }
        self.cost += other.cost;
    }

    /// Mean of the diagonal: what the prior's weight is measured in.
    pub fn level(&self) -> f64 {
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
    pub fn solve(&self, texels: &[Rgbs], prior: &Prior, damping: f64, all: bool) -> Option<Vec<Rgbs>> {
        let n = self.count;
        let channels: &[usize] = if all { &[3, 0, 1, 2] } else { &[0, 1, 2] };
        let mut x = DVector::zeros(channels.len() * n);
        let mut slope = DVector::zeros(channels.len() * n);
        let mut matrix = self.matrix(all);
        for (block, &c) in channels.iter().enumerate() {
            for i in 0..n {
                x[block * n + i] = texels[i][c] / prior.unit(c);
                slope[block * n + i] = self.slope[(c + 1) % 4][i];
            }
            for i in 0..n - 1 {
                let (a, b) = (block * n + i, block * n + i + 1);
                let pull = prior.weight * (x[b] - x[a]);
                slope[a] -= pull;
                slope[b] += pull;
                for (i, j, v) in [(a, a, 1.0), (b, b, 1.0), (a, b, -1.0), (b, a, -1.0)] {
                    matrix[(i, j)] += v * prior.weight;
                }
            }
        }
        let floor = 1e-12 * self.level();
        for i in 0..x.len() {
            matrix[(i, i)] += damping * matrix[(i, i)] + floor;
        }
        let found = bounded(&matrix, &slope, &x)?;
        let mut out = texels.to_vec();
        for (block, &c) in channels.iter().enumerate() {
            for i in 0..n {
                out[i][c] = found[block * n + i] * prior.unit(c);
            }
        }
        Some(out)
    }

    /// Share of the data in the curvature at each texel, of extinction and colour.
    pub fn confidence(&self, prior: &Prior) -> Vec<[f64; 2]> {
        let n = self.count;
        let share = |m: &[f64], i: usize| {
            let own = m[i * n + i];
            own / (own + 2.0 * prior.weight).max(f64::MIN_POSITIVE)
        };
        (0..n).map(|i| [share(&self.ss, i), share(&self.cc, i)]).collect()
    }
}

/// `x + argmin ½ dᵀ M d + gᵀ d` with no element below zero: those that would be are held at zero, and the
/// rest is solved for again.
pub(super) fn bounded(matrix: &DMatrix<f64>, slope: &DVector<f64>, x: &DVector<f64>) -> Option<DVector<f64>> {
    let mut held: Vec<bool> = (0..x.len()).map(|i| x[i] <= 0.0 && slope[i] > 0.0).collect();
    loop {
        let free: Vec<usize> = (0..x.len()).filter(|i| !held[*i]).collect();
        let mut out = DVector::zeros(x.len());
        if free.is_empty() {
            return Some(out);
        }
        // Those held move to zero, which the rest feels.
        let moved: Vec<usize> = (0..x.len()).filter(|i| held[*i] && x[*i] != 0.0).collect();
        let own = matrix.select_rows(&free).select_columns(&free);
        let right = DVector::from_iterator(
            free.len(),
            free.iter().map(|&i| -slope[i] + moved.iter().map(|&j| matrix[(i, j)] * x[j]).sum::<f64>()),
        );
        let step = own.cholesky()?.solve(&right);
        let mut below = false;
        for (k, &i) in free.iter().enumerate() {
            out[i] = x[i] + step[k];
            if !out[i].is_finite() {
                return None;
            }
            if out[i] < 0.0 {
                held[i] = true;
                below = true;
            }
        }
        if !below {
            return Some(out);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn what_would_be_negative_is_held_at_zero() {
        // ½ |d - (2, -3, 1)|² from (1, 1, 1) with the first two coupled.
        let m = DMatrix::from_row_slice(3, 3, &[2.0, 0.5, 0.0, 0.5, 2.0, 0.0, 0.0, 0.0, 1.0]);
        let x = DVector::from_vec(vec![1.0, 1.0, 1.0]);
        let found = bounded(&m, &DVector::from_vec(vec![-2.0, 5.0, -1.0]), &x).unwrap();
        // The second is at zero: the first minimises 2 d²/2 + (-2 - 0.5) d.
        assert_eq!(found[1], 0.0);
        assert!((found[0] - 2.25).abs() < 1e-12 && (found[2] - 2.0).abs() < 1e-12, "{found}");
    }
}
