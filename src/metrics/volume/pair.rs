//! Two volumes under comparison: their domain is divided into what is constant in both, and what is compared voxel by
//! voxel.

use super::effort::{Effort, OnStep};
use super::field::{Constant, Field, Window};
use super::partial::{Partial, Run};
use crate::error::{Error, Result};
use crate::math::Aabb;
use glam::DVec3;
use rayon::prelude::*;
use std::borrow::Cow;
use std::sync::atomic::{AtomicU64, Ordering};

/// Largest number of blocks of 8³ whose voxels are compared one by one (8.6e9 voxels); more would take hours.
const MAX_BLOCKS: usize = 1 << 24;
/// Number of blocks whose sums are held at a time.
const CHUNK: usize = 1 << 16;
/// Largest number of cells of the second volume that are compared at once with a constant of the first.
const CELLS: i128 = 1 << 15;

/// Two volumes under comparison, with the partition of their domain.
#[derive(Debug)]
pub(super) struct Pair<'f, 'a> {
    pub(super) a: &'f Field<'a>,
    pub(super) b: &'f Field<'a>,
    /// True if both volumes lie on one lattice.
    pub(super) same: bool,
    /// Lowest voxel of the domain; `max` is the highest.
    pub(super) min: [i32; 3],
    pub(super) max: [i32; 3],
    /// True if the lattices differ but have parallel axes.
    pub(super) along_axes: bool,
    /// Origins of blocks in which voxels are compared one by one.
    pub(super) blocks: Vec<[i32; 3]>,
    /// Boxes, by lowest and highest voxel, in which the first volume has this value and the second is interpolated.
    pub(super) interpolated: Vec<([i32; 3], [i32; 3], Constant)>,
    /// Sums over the cubes in which both volumes are constant.
    pub(super) constant: Partial,
}

impl Pair<'_, '_> {
    /// Divides the domain, cube by cube.
    ///
    /// # Errors
    /// If there are too many blocks.
    pub(super) fn divide(&mut self) -> Result<()> {
        let [min, max] = [self.min, self.max].map(|corner| corner.map(i64::from));
        // Cubes that the domain meets, at most two along each axis.
        let few = |shift: &u32| (0..3).all(|i| (max[i] >> shift) - (min[i] >> shift) <= 1);
        let shift = (3..=32).find(few).unwrap_or(32);
        let along = |i: usize| min[i] >> shift..=max[i] >> shift;
        for x in along(0) {
            for y in along(1) {
                for z in along(2) {
                    self.part([x, y, z].map(|c| c << shift), shift)?;
                }
            }
        }
        // Sums are added in ascending order of origin: they depend neither on the threads nor on how cubes are divided.
        self.blocks.sort_unstable();
        Ok(())
    }

    /// Returns the sums over the divided domain, and the number of voxels that they are of. Of more blocks than
    /// `effort` allows on different lattices, one of each group of neighbors stands for all.
    pub(super) fn sum(&self, effort: Effort, step: OnStep<'_>) -> (Partial, Option<u64>) {
        let group = if self.same { 1 } else { self.blocks.len().div_ceil(effort.blocks) };
        let chosen = subsampled(&self.blocks, group);
        let total = (chosen.len() + self.interpolated.len()) as u64;
        let done = AtomicU64::new(0);
        let tick = || {
            let done = done.fetch_add(1, Ordering::Relaxed) + 1;
            // One lattice takes a block in less time than a display does.
            if done.is_multiple_of(64) || done == total {
                step(done, total);
            }
        };
        let mut sum = Partial::default();
        for blocks in chosen.chunks(CHUNK) {
            let of = |window: &mut Window, origin: &[i32; 3]| {
                tick();
                self.block(window, *origin)
            };
            let partials: Vec<Partial> = blocks.par_iter().map_init(Window::default, of).collect();
            partials.iter().for_each(|p| sum.add(p));
        }
        let left_out = (group > 1).then(|| {
            let voxels = |blocks: &[[i32; 3]]| blocks.iter().map(|origin| self.voxels_of(*origin)).sum::<u64>();
            let (all, part) = (voxels(&self.blocks), voxels(&chosen));
            sum.scale(all as f64 / part.max(1) as f64);
            all - part
        });
        for boxes in self.interpolated.chunks(CHUNK) {
            let of = |window: &mut Window, (low, high, a): &([i32; 3], [i32; 3], Constant)| {
                tick();
                self.cells(window, *low, *high, a)
            };
            let partials: Vec<Partial> = boxes.par_iter().map_init(Window::default, of).collect();
            partials.iter().for_each(|p| sum.add(p));
        }
        sum.add(&self.constant);
        (sum, left_out)
    }

    /// Returns the number of voxels of a block that lie in the domain.
    fn voxels_of(&self, origin: [i32; 3]) -> u64 {
        let along = |i: usize| {
            let (low, high) = (origin[i].max(self.min[i]), origin[i].saturating_add(7).min(self.max[i]));
            (i64::from(high) - i64::from(low) + 1).max(0) as u64
        };
        along(0) * along(1) * along(2)
    }

    /// Divides a cube of edge `1 << shift` into cubes in which both volumes are constant, boxes of interpolation, and
    /// blocks.
    ///
    /// # Errors
    /// If there are too many blocks.
    fn part(&mut self, origin: [i64; 3], shift: u32) -> Result<()> {
        let low: [i64; 3] = std::array::from_fn(|i| origin[i].max(self.min[i].into()));
        let high: [i64; 3] = std::array::from_fn(|i| (origin[i] + (1 << shift) - 1).min(self.max[i].into()));
        if (0..3).any(|i| low[i] > high[i]) {
            return Ok(());
        }
        let (from, until) = if self.same { (low, high) } else { self.in_b(low, high) };
        let (a, b) = (self.a.uniform(low, high), self.b.uniform(from, until));
        let voxels: i128 = (0..3).map(|i| i128::from(high[i] - low[i] + 1)).product();
        if let (Some(a), Some(b)) = (a, b) {
            self.constant.count(&a, &b, self.a.components, voxels.min(u64::MAX.into()) as u64);
            return Ok(());
        }
        if let (Some(a), true) = (a, self.along_axes) {
            // Where the second volume is the coarser one, it has far fewer cells than the first has voxels.
            let cells: i128 = (0..3).map(|i| i128::from(until[i]) - i128::from(from[i]) + 1).product();
            if cells <= CELLS && voxels >= 2 * cells {
                self.interpolated.push((low.map(|c| c as i32), high.map(|c| c as i32), a));
                return Ok(());
            }
        }
        if shift == 3 {
            self.blocks.push(origin.map(|c| c as i32));
            if self.blocks.len() > MAX_BLOCKS {
                return Err(Error::unsupported(format!(
                    "more than {MAX_BLOCKS} blocks of 8³ voxels would have to be compared voxel by voxel"
                ))
                .hint("crop both to the part that matters first: ⟨convert.crop⟩"));
            }
            return Ok(());
        }
        let half = 1_i64 << (shift - 1);
        for i in 0..8 {
            let by = [i >> 2 & 1, i >> 1 & 1, i & 1];
            self.part(std::array::from_fn(|a| origin[a] + by[a] * half), shift - 1)?;
        }
        Ok(())
    }

    /// Lowest and highest voxel of the second volume on which samples at these voxels of the first depend.
    fn in_b(&self, low: [i64; 3], high: [i64; 3]) -> ([i64; 3], [i64; 3]) {
        let corner = |c: [i64; 3]| DVec3::from_array(c.map(|c| c as f64));
        let corners = Aabb { min: corner(low), max: corner(high) }.corners();
        let index = corners.map(|c| self.b.transform.to_index(self.a.transform.to_world(c)));
        let found = index.into_iter().fold(Aabb::EMPTY, |b, p| b.including(p));
        // Rounding may move a sample at a voxel into the cell beside it.
        let slack = 1e-6 + 1e-12 * found.min.abs().max(found.max.abs());
        let (min, max) = ((found.min - slack).floor(), (found.max + slack).floor() + 1.0);
        (min.to_array().map(|c| c as i64), max.to_array().map(|c| c as i64))
    }

    /// Compares a constant with the second volume's interpolation, cell by cell of its lattice.
    /// Over the voxels of the first volume in one cell, the squares of a trilinear function add up to a quadratic form
    /// of the cell's corners. Its extremes lie at the outermost of these voxels.
    fn cells(&self, window: &mut Window, low: [i32; 3], high: [i32; 3], a: &Constant) -> Partial {
        let mut p = Partial::default();
        let (from, until) = self.in_b(low.map(i64::from), high.map(i64::from));
        let copied = window.copy(self.b, from, until);
        let runs: [Vec<Run>; 3] = std::array::from_fn(|axis| {
            let mut runs: Vec<Run> = Vec::new();
            for c in low[axis]..=high[axis] {
                let mut corner = low;
                corner[axis] = c;
                let world = self.a.transform.to_world(DVec3::from_array(corner.map(f64::from)));
                let at = self.b.transform.to_index(world)[axis];
                match runs.last_mut().filter(|run| run.base == at.floor()) {
                    Some(run) => run.add(at, c),
                    None => runs.push(Run::new(at, c)),
                }
            }
            runs
        });
        let voxel = |p: [i64; 3]| {
            if copied {
                window.voxels[window.offset(p)]
            } else {
                let p = p.map(|c| c.clamp(i32::MIN.into(), i32::MAX.into()) as i32);
                self.b.content(p).voxel(p, self.b.components)
            }
        };
        for x in &runs[0] {
            for y in &runs[1] {
                for z in &runs[2] {
                    if p.cell([x, y, z], a, self.a.components, &voxel) {
                        continue;
                    }
                    let along = |run: &Run| run.voxels[0]..=run.voxels[1];
                    for (i, j) in along(x).flat_map(|i| along(y).map(move |j| (i, j))) {
                        for k in along(z) {
                            let world = self.a.transform.to_world(DVec3::new(i.into(), j.into(), k.into()));
                            let at = self.b.transform.to_index(world);
                            let b = Field::sample(at, |p| voxel(p.map(i64::from)));
                            p.count(a, &b, self.a.components, 1);
                        }
                    }
                }
            }
        }
        p
    }

    fn block(&self, window: &mut Window, origin: [i32; 3]) -> Partial {
        let mut p = Partial::default();
        let range = |i: usize| origin[i].max(self.min[i])..=origin[i].saturating_add(7).min(self.max[i]);
        let (a, n) = (self.a.content(origin), self.a.components);
        let b = self.b.content(origin);
        let copied = !self.same && {
            let low = std::array::from_fn(|i| (*range(i).start()).into());
            let high = std::array::from_fn(|i| (*range(i).end()).into());
            let (from, until) = self.in_b(low, high);
            window.copy(self.b, from, until)
        };
        for x in range(0) {
            for y in range(1) {
                for z in range(2) {
                    let vb = if self.same {
                        b.voxel([x, y, z], n)
                    } else {
                        let world = self.a.transform.to_world(DVec3::new(x.into(), y.into(), z.into()));
                        let at = self.b.transform.to_index(world);
                        if copied { window.sample(at, n) } else { Field::sample(at, |p| self.b.content(p).voxel(p, n)) }
                    };
                    p.count(&a.voxel([x, y, z], n), &vb, n, 1);
                }
            }
        }
        p
    }
}

/// Returns one of each `group` of blocks in a row, at a place that a hash of the row's number tells: a regular pattern
/// of the volume's is not mistaken for the whole.
fn subsampled(blocks: &[[i32; 3]], group: usize) -> Cow<'_, [[i32; 3]]> {
    if group <= 1 {
        return Cow::Borrowed(blocks);
    }
    let pick = |(row, blocks): (usize, &[[i32; 3]])| {
        let hash = (row as u64).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        blocks[(hash >> 32) as usize % blocks.len()]
    };
    blocks.chunks(group).enumerate().map(pick).collect::<Vec<_>>().into()
}
