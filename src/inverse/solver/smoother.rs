//! The smoothness prior, as the metric in which the solver looks for the smallest change.
//!
//! `M = P B (L + a) B P`: the mask P (0 outside the hull, else a weight), a binomial blur B and the negative Laplacian
//! L. Conjugate gradients preconditioned by M from a start x₀ converge to the solution nearest to x₀ in the norm of M⁻¹
//! (prior-conditioning: Calvetti & Somersalo 2005), so what the pictures leave open is filled smoothly instead of with
//! the stripes of single rays. `L + a` lifts the middle frequencies against the 1/|k| of back-projection, which is what
//! the ramp filter of filtered back-projection does.

use crate::cancel::Cancel;
use crate::scene::bricks::{NONE, Topology};
use crate::scene::grid::LEAF_VOXELS;
use crate::scene::neighbours::Neighbours;
use rayon::prelude::*;

/// The preconditioner on a topology, 512 values a brick.
#[derive(Debug)]
pub struct Smoother {
    neighbours: Neighbours,
    /// Blur passes before and after the Laplacian.
    pub passes: u32,
    ridge: f32,
    scratch: Vec<f32>,
    /// Polled between blur passes; what the methods that it stopped wrote is incomplete.
    pub cancel: Cancel,
}

impl Smoother {
    /// Blurs `passes` times before and after the Laplacian; `ridge` is `a` above, per voxel².
    pub fn new(topology: &Topology, passes: u32, ridge: f32) -> Self {
        let scratch = vec![0.0; topology.len() * LEAF_VOXELS];
        Self { neighbours: Neighbours::new(topology), passes, ridge, scratch, cancel: Cancel::NEVER }
    }

    /// Voxels of a field.
    pub fn len(&self) -> usize {
        self.scratch.len()
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.scratch.is_empty()
    }

    /// Writes √((x̄ + ε) / (x* + ε)) for every voxel of a field: x̄ its blurred values, x* their 99th percentile, ε a
    /// tenth of that. As weights of the mask they make the prior one on relative change: where there
    /// is much, much may change, and where there is nothing, little appears (the reweighting of FOCUSS,
    /// Gorodnitsky & Rao 1997, at its exponent for sparse fields). A field of zeros gives 1.
    pub fn relative(&mut self, field: &[f32], out: &mut [f32]) {
        out.copy_from_slice(field);
        self.blur(out);
        let mut positive: Vec<f32> = out.iter().copied().filter(|v| *v > 0.0).collect();
        if positive.is_empty() {
            out.fill(1.0);
            return;
        }
        let at = (positive.len() - 1) * 99 / 100;
        let (_, top, _) = positive.select_nth_unstable_by(at, f32::total_cmp);
        let (top, floor) = (*top, 0.1 * *top);
        out.par_iter_mut().for_each(|v| *v = ((*v + floor) / (top + floor)).sqrt());
    }

    /// `out = M r`; `mask` is 0 for known voxels and the prior's weight for unknown ones.
    pub fn apply(&mut self, r: &[f32], mask: &[f32], out: &mut [f32]) {
        out.par_iter_mut().zip(r).zip(mask).for_each(|((o, r), m)| *o = r * m);
        for _ in 0..self.passes {
            self.blur(out);
        }
        ridged_laplacian(&self.neighbours, out, self.ridge, &mut self.scratch);
        out.copy_from_slice(&self.scratch);
        for _ in 0..self.passes {
            self.blur(out);
        }
        out.par_iter_mut().zip(mask).for_each(|(o, m)| *o *= m);
    }

    /// `[1 2 1] / 4` along each axis.
    fn blur(&mut self, values: &mut [f32]) {
        for axis in 0..3 {
            if self.cancel.requested() {
                return;
            }
            self.stencil(values, axis, |centre, sides| 0.5 * centre + 0.25 * sides);
        }
    }

    /// Replaces each value by a function of itself and the sum of its two neighbours along an axis.
    fn stencil(&mut self, values: &mut [f32], axis: usize, f: impl Fn(f32, f32) -> f32 + Sync) {
        let neighbours = &self.neighbours;
        let source: &[f32] = values;
        self.scratch.par_chunks_mut(LEAF_VOXELS).enumerate().for_each(|(b, out)| {
            let brick = Lines::new(source, b, neighbours.of_brick(b, axis), axis);
            brick.each(|i, centre, sides| out[i] = f(centre, sides));
        });
        values.copy_from_slice(&self.scratch);
    }
}

/// `out = L values` of the negative Laplacian, with zeros outside the bricks.
pub(super) fn laplacian(neighbours: &Neighbours, values: &[f32], out: &mut [f32]) {
    ridged_laplacian(neighbours, values, 0.0, out);
}

/// `out = (L + a) values`, zero outside the bricks.
fn ridged_laplacian(neighbours: &Neighbours, values: &[f32], ridge: f32, out: &mut [f32]) {
    out.par_chunks_mut(LEAF_VOXELS).enumerate().for_each(|(b, out)| {
        for (o, v) in out.iter_mut().zip(&values[b * LEAF_VOXELS..]) {
            *o = ridge * v;
        }
        for axis in 0..3 {
            let brick = Lines::new(values, b, neighbours.of_brick(b, axis), axis);
            brick.each(|i, centre, sides| out[i] += 2.0 * centre - sides);
        }
    });
}

/// A brick and its two neighbours along one axis.
struct Lines<'a> {
    own: &'a [f32],
    below: Option<&'a [f32]>,
    above: Option<&'a [f32]>,
    stride: usize,
}

impl<'a> Lines<'a> {
    fn new(values: &'a [f32], brick: usize, [below, above]: [u32; 2], axis: usize) -> Self {
        let of = |b: u32| (b != NONE).then(|| &values[b as usize * LEAF_VOXELS..(b as usize + 1) * LEAF_VOXELS]);
        Self {
            own: &values[brick * LEAF_VOXELS..(brick + 1) * LEAF_VOXELS],
            below: of(below),
            above: of(above),
            stride: [64, 8, 1][axis],
        }
    }

    /// Visits every voxel with the sum of its two neighbours along the axis.
    #[inline(always)]
    fn each(&self, mut visit: impl FnMut(usize, f32, f32)) {
        let (s, last) = (self.stride, 7 * self.stride);
        for i in 0..LEAF_VOXELS {
            let place = (i / s) & 7;
            let before = if place > 0 { self.own[i - s] } else { self.below.map_or(0.0, |n| n[i + last]) };
            let after = if place < 7 { self.own[i + s] } else { self.above.map_or(0.0, |n| n[i - last]) };
            visit(i, self.own[i], before + after);
        }
    }
}
