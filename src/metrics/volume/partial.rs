//! Sums over the differences of voxels, one by one and cell by cell.

use super::field::Constant;

#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Partial {
    pub(super) squares: f64,
    /// Sums of the squares of the values of the first volume and of the second.
    pub(super) energies: [f64; 2],
    pub(super) max: f64,
    pub(super) both: u64,
    pub(super) either: u64,
    pub(super) incomparable: u64,
}

impl Partial {
    pub(super) fn add(&mut self, p: &Self) {
        self.squares += p.squares;
        (0..2).for_each(|i| self.energies[i] += p.energies[i]);
        self.max = self.max.max(p.max);
        self.both += p.both;
        self.either += p.either;
        self.incomparable += p.incomparable;
    }

    /// Has the sums stand for `factor` times as many voxels.
    pub(super) fn scale(&mut self, factor: f64) {
        let scaled = |count: u64| (count as f64 * factor).round() as u64;
        self.squares *= factor;
        self.energies.iter_mut().for_each(|energy| *energy *= factor);
        (self.both, self.either) = (scaled(self.both), scaled(self.either));
        self.incomparable = scaled(self.incomparable);
    }

    /// Counts a pair of voxels, one of each volume, `times` times.
    pub(super) fn count(&mut self, a: &Constant, b: &Constant, components: usize, times: u64) {
        self.both = self.both.saturating_add(if a.active && b.active { times } else { 0 });
        self.either = self.either.saturating_add(if a.active || b.active { times } else { 0 });
        for c in 0..components {
            let (u, v) = (a.value[c], b.value[c]);
            if u.is_finite() && v.is_finite() {
                let d = f64::from(u) - f64::from(v);
                self.squares += d * d * times as f64;
                for (energy, value) in self.energies.iter_mut().zip([u, v]) {
                    *energy += f64::from(value).powi(2) * times as f64;
                }
                self.max = self.max.max(d.abs());
            } else if !(u == v || u.is_nan() && v.is_nan()) {
                self.incomparable = self.incomparable.saturating_add(times);
            }
        }
    }
}

/// The voxels of the first volume, along one axis, that lie in one cell of the second.
#[derive(Debug)]
pub(super) struct Run {
    /// Lower coordinate of the cell.
    pub(super) base: f64,
    /// Least and greatest position of a voxel within the cell, from 0 to 1.
    pub(super) ends: [f64; 2],
    /// Sums over the voxels of the products of the interpolation weights of the cell's two corners.
    pub(super) products: [[f64; 2]; 2],
    /// Number of voxels nearer to each corner.
    pub(super) nearer: [u64; 2],
    /// Coordinates of the first and the last voxel.
    pub(super) voxels: [i32; 2],
}

impl Run {
    pub(super) fn new(at: f64, voxel: i32) -> Self {
        let f = at - at.floor();
        let mut run =
            Self { base: at.floor(), ends: [f, f], products: [[0.0; 2]; 2], nearer: [0; 2], voxels: [voxel, voxel] };
        run.add(at, voxel);
        run
    }

    pub(super) fn add(&mut self, at: f64, voxel: i32) {
        let f = at - self.base;
        let weights = [1.0 - f, f];
        self.ends = [self.ends[0].min(f), self.ends[1].max(f)];
        (0..2).for_each(|i| (0..2).for_each(|j| self.products[i][j] += weights[i] * weights[j]));
        self.nearer[usize::from(at.round() > self.base)] += 1;
        self.voxels[1] = voxel;
    }
}

impl Partial {
    /// Adds the voxels of a constant `a` in one cell of the other volume. Returns false, and adds nothing, if a value
    /// is not finite.
    pub(super) fn cell(
        &mut self,
        runs: [&Run; 3],
        a: &Constant,
        components: usize,
        voxel: &impl Fn([i64; 3]) -> Constant,
    ) -> bool {
        let at = |corner: usize| [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
        // A corner without weight is not looked up, since no voxel depends on it.
        let beyond = runs.map(|run| run.ends[1] == 0.0);
        let used = |corner: usize| !(0..3).any(|i| at(corner)[i] == 1 && beyond[i]);
        let corners: [Constant; 8] = std::array::from_fn(|corner| {
            let p = std::array::from_fn(|i| runs[i].base as i64 + if used(corner) { at(corner)[i] as i64 } else { 0 });
            voxel(p)
        });
        let finite = |v: &Constant| v.value[..components].iter().all(|v| v.is_finite());
        if !finite(a) || !corners.iter().all(finite) {
            return false;
        }
        for (corner, value) in corners.iter().enumerate() {
            let count: u64 = (0..3).map(|i| runs[i].nearer[at(corner)[i]]).product();
            self.both += if a.active && value.active { count } else { 0 };
            self.either += if a.active || value.active { count } else { 0 };
        }
        for c in 0..components {
            let value = |f: [f64; 3]| {
                let mut sum = 0.0;
                for (corner, voxel) in corners.iter().enumerate() {
                    let w: f64 = (0..3).map(|i| if at(corner)[i] == 1 { f[i] } else { 1.0 - f[i] }).product();
                    sum += if w > 0.0 { w * f64::from(voxel.value[c]) } else { 0.0 };
                }
                sum as f32
            };
            let apart: [f64; 8] = std::array::from_fn(|k| f64::from(corners[k].value[c]) - f64::from(a.value[c]));
            for (i, first) in apart.iter().enumerate() {
                for (j, second) in apart.iter().enumerate() {
                    let weight: f64 = (0..3).map(|axis| runs[axis].products[at(i)[axis]][at(j)[axis]]).product();
                    self.squares += weight * first * second;
                    self.energies[1] += weight * f64::from(corners[i].value[c]) * f64::from(corners[j].value[c]);
                }
            }
            let voxels: f64 =
                runs.iter().map(|run| f64::from(run.voxels[1]) - f64::from(run.voxels[0]) + 1.0).product();
            self.energies[0] += f64::from(a.value[c]).powi(2) * voxels;
            for end in 0..8 {
                let f = std::array::from_fn(|i| runs[i].ends[at(end)[i]]);
                self.max = self.max.max((f64::from(value(f)) - f64::from(a.value[c])).abs());
            }
        }
        true
    }
}
