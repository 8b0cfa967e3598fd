//! Differences of two volumes: PSNR, RMS, largest difference and overlap of their topologies.
//!
//! The domain is the union of the two boxes of active voxels, on the first volume's lattice. Where the lattices differ,
//! the second volume is sampled trilinearly at the first one's voxel centres.

use crate::error::{Error, Result};
use crate::math::{Aabb, Affine};
use crate::scene::bricks::Bricks;
use crate::scene::grid::{Grid, LEAF_VOXELS, voxel_offset};
use glam::{DVec3, IVec3};
use rayon::prelude::*;
use serde::Serialize;
use std::borrow::Cow;
use std::collections::{HashMap, HashSet};
use std::sync::atomic::{AtomicU64, Ordering};

/// Largest number of blocks of 8³ whose voxels are compared one by one (8.6e9 voxels); more would take hours.
const MAX_BLOCKS: usize = 1 << 24;
/// Number of blocks whose sums are held at a time.
const CHUNK: usize = 1 << 16;
/// Largest number of voxels of the second volume that are copied to sample one block of the first.
const WINDOW: usize = 1 << 18;
/// Largest number of cells of the second volume that are compared at once with a constant of the first.
const CELLS: i128 = 1 << 15;
/// Number of levels of cubes. Cubes of a level have edges of `8 << level` voxels; those of the last level are half of
/// index space.
const LEVELS: usize = 29;

#[derive(Debug, Clone, Copy)]
struct Block<'a> {
    values: &'a [f32],
    active: &'a [u64; 8],
}

#[derive(Debug, Clone, Copy)]
struct Constant {
    value: [f32; 3],
    active: bool,
}

impl Constant {
    fn same(&self, other: &Self) -> bool {
        self.value.map(f32::to_bits) == other.value.map(f32::to_bits) && self.active == other.active
    }
}

/// Content of an aligned block of 8³ voxels.
#[derive(Debug, Clone, Copy)]
enum Content<'a> {
    Voxels(Block<'a>),
    Constant(Constant),
}

/// A sparse volume whose voxels are looked up by index coordinates.
#[derive(Debug)]
pub struct Field<'a> {
    components: usize,
    background: [f32; 3],
    transform: Affine,
    active_box: Option<([i32; 3], [i32; 3])>,
    leaves: HashMap<[i32; 3], Block<'a>>,
    tiles: [HashMap<[i32; 3], Constant>; 3],
    /// Cubes that hold a leaf, or a tile smaller than themselves, by level; cube coordinates are voxel coordinates over
    /// the edge. All other cubes are constant.
    mixed: Vec<HashSet<[i32; 3]>>,
}

const TILE_DIMS: [i32; 3] = [8, 128, 4096];

impl<'a> Field<'a> {
    /// An empty volume of 1 to 3 components per voxel. `active_box` holds the lowest and the highest active voxel, if
    /// any is active.
    pub fn new(
        components: usize,
        background: [f32; 3],
        transform: Affine,
        active_box: Option<([i32; 3], [i32; 3])>,
    ) -> Self {
        let mixed = vec![HashSet::new(); LEVELS];
        Self { components, background, transform, active_box, leaves: HashMap::new(), tiles: Default::default(), mixed }
    }

    /// A field of a scalar grid. The box of active voxels is found by a walk over all voxels.
    pub fn from_grid(grid: &'a Grid) -> Self {
        let mut field = Self::new(1, [grid.background, 0.0, 0.0], grid.transform, None);
        let (mut min, mut max) = (IVec3::MAX, IVec3::MIN);
        for leaf in &grid.leaves {
            field.add_leaf(leaf.origin, &leaf.values[..], &leaf.active);
            for i in (0..512).filter(|i| leaf.active[i >> 6] >> (i & 63) & 1 == 1) {
                let p = IVec3::from_array(leaf.origin) + IVec3::new(i as i32 >> 6, i as i32 >> 3 & 7, i as i32 & 7);
                (min, max) = (min.min(p), max.max(p));
            }
        }
        for tile in &grid.tiles {
            field.add_tile(tile.origin, tile.dim, [tile.value, 0.0, 0.0], tile.active);
            if tile.active {
                let p = IVec3::from_array(tile.origin);
                (min, max) = (min.min(p), max.max(p + (tile.dim - 1)));
            }
        }
        field.active_box = min.cmple(max).all().then(|| (min.to_array(), max.to_array()));
        field
    }

    /// Adds a leaf of 8³ voxels at `origin`: components interleaved, z fastest.
    pub fn add_leaf(&mut self, origin: [i32; 3], values: &'a [f32], active: &'a [u64; 8]) {
        self.leaves.insert(origin, Block { values, active });
        self.mark(origin, 0);
    }

    /// Adds a tile at `origin`: a constant block with an edge of 8, 128 or 4096 voxels. Tiles of other edges are
    /// ignored.
    pub fn add_tile(&mut self, origin: [i32; 3], dim: i32, value: [f32; 3], active: bool) {
        if let Some(level) = TILE_DIMS.iter().position(|d| *d == dim) {
            self.tiles[level].insert(origin, Constant { value, active });
            self.mark(origin, dim.ilog2() as usize - 2);
        }
    }

    /// Marks the cubes that contain a voxel as mixed, from level `from` on.
    fn mark(&mut self, voxel: [i32; 3], from: usize) {
        for level in from..LEVELS {
            // The cubes around a marked cube are marked already.
            if !self.mixed[level].insert(voxel.map(|c| c >> (level + 3))) {
                break;
            }
        }
    }

    fn constant(&self, p: [i32; 3]) -> Constant {
        for (level, dim) in TILE_DIMS.iter().enumerate() {
            if self.tiles[level].is_empty() {
                continue;
            }
            if let Some(t) = self.tiles[level].get(&p.map(|c| c & !(dim - 1))) {
                return *t;
            }
        }
        Constant { value: self.background, active: false }
    }

    /// Content of the aligned block of 8³ voxels that contains a voxel.
    fn content(&self, p: [i32; 3]) -> Content<'a> {
        match self.leaves.get(&p.map(|c| c & !7)) {
            Some(block) => Content::Voxels(*block),
            None => Content::Constant(self.constant(p)),
        }
    }

    /// Value of all voxels of a box, both corners included; `None` where voxels may differ.
    fn uniform(&self, low: [i64; 3], high: [i64; 3]) -> Option<Constant> {
        let outside = Constant { value: self.background, active: false };
        let (least, most) = (i64::from(i32::MIN), i64::from(i32::MAX));
        if (0..3).any(|a| high[a] < least || low[a] > most) {
            return Some(outside);
        }
        let beyond = (0..3).any(|a| low[a] < least || high[a] > most);
        let [low, high] = [low, high].map(|corner| corner.map(|c| c.clamp(least, most) as i32));
        // Smallest cubes of which the box meets at most two along each axis.
        let few = |level: &usize| (0..3).all(|a| (high[a] >> (level + 3)) - (low[a] >> (level + 3)) <= 1);
        let level = (0..LEVELS).find(few)?;
        let [first, last] = [low, high].map(|corner| corner.map(|c| c >> (level + 3)));
        let mut found: Option<Constant> = beyond.then_some(outside);
        for x in first[0]..=last[0] {
            for y in first[1]..=last[1] {
                for z in first[2]..=last[2] {
                    if self.mixed[level].contains(&[x, y, z]) {
                        return None;
                    }
                    let here = self.constant([x, y, z].map(|c| c << (level + 3)));
                    if found.is_some_and(|found| !found.same(&here)) {
                        return None;
                    }
                    found = Some(here);
                }
            }
        }
        found
    }

    /// Trilinearly interpolated value at index coordinates, with the activity of the nearest voxel; `voxel` looks
    /// voxels up.
    fn sample(p: DVec3, voxel: impl Fn([i32; 3]) -> Constant) -> Constant {
        let base = p.floor();
        let f = p - base;
        let base = base.as_ivec3();
        let mut value = [0.0_f64; 3];
        for corner in 0..8 {
            let d = IVec3::new(corner >> 2 & 1, corner >> 1 & 1, corner & 1);
            let w: f64 = (0..3).map(|a| if d[a] == 1 { f[a] } else { 1.0 - f[a] }).product();
            if w > 0.0 {
                let v = voxel((base.saturating_add(d)).to_array()).value;
                (0..3).for_each(|c| value[c] += w * f64::from(v[c]));
            }
        }
        Constant { value: value.map(|v| v as f32), active: voxel(p.round().as_ivec3().to_array()).active }
    }

    fn peak(&self) -> f64 {
        let in_leaves = self.leaves.values().flat_map(|b| {
            (0..512)
                .filter(|i| b.active[i >> 6] >> (i & 63) & 1 == 1)
                .flat_map(|i| b.values[i * self.components..(i + 1) * self.components].iter().copied())
        });
        let in_tiles = self.tiles.iter().flat_map(HashMap::values).filter(|t| t.active).flat_map(|t| t.value);
        in_leaves.chain(in_tiles).filter(|v| v.is_finite()).fold(0.0, |m, v| m.max(f64::from(v.abs())))
    }
}

impl Content<'_> {
    fn voxel(&self, p: [i32; 3], components: usize) -> Constant {
        match self {
            Self::Constant(constant) => *constant,
            Self::Voxels(block) => {
                let i = voxel_offset(p.map(|c| c as usize));
                let mut value = [0.0; 3];
                value[..components].copy_from_slice(&block.values[i * components..][..components]);
                Constant { value, active: block.active[i >> 6] >> (i & 63) & 1 == 1 }
            }
        }
    }
}

/// A dense copy of a box of voxels.
#[derive(Debug, Default)]
struct Window {
    low: [i64; 3],
    size: [usize; 3],
    voxels: Vec<Constant>,
}

impl Window {
    /// Copies the box with these corners, both included. Returns false if the box is too large or leaves index space.
    fn copy(&mut self, field: &Field<'_>, low: [i64; 3], high: [i64; 3]) -> bool {
        let size = [0, 1, 2].map(|a| high[a] - low[a] + 1);
        let inside = (0..3).all(|a| low[a] >= i64::from(i32::MIN) && high[a] <= i64::from(i32::MAX));
        if !inside || size.iter().try_fold(1_i64, |n, s| n.checked_mul(*s)).is_none_or(|n| n > WINDOW as i64) {
            return false;
        }
        (self.low, self.size) = (low, size.map(|s| s as usize));
        self.voxels.clear();
        self.voxels.resize(self.size.iter().product(), Constant { value: [0.0; 3], active: false });
        let blocks = |a: usize| low[a] >> 3..=high[a] >> 3;
        let along = |block: i64, a: usize| (block << 3).max(low[a])..=((block << 3) + 7).min(high[a]);
        for (bx, by) in blocks(0).flat_map(|x| blocks(1).map(move |y| (x, y))) {
            for bz in blocks(2) {
                let content = field.content([bx, by, bz].map(|b| (b << 3) as i32));
                for x in along(bx, 0) {
                    for y in along(by, 1) {
                        for z in along(bz, 2) {
                            let voxel = content.voxel([x as i32, y as i32, z as i32], field.components);
                            let at = self.offset([x, y, z]);
                            self.voxels[at] = voxel;
                        }
                    }
                }
            }
        }
        true
    }

    fn offset(&self, p: [i64; 3]) -> usize {
        let local: [usize; 3] = std::array::from_fn(|a| (p[a] - self.low[a]) as usize);
        (local[0] * self.size[1] + local[1]) * self.size[2] + local[2]
    }
}

/// Difference of a volume B from a reference A.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Difference {
    /// PSNR in dB, `20 log10(peak / rms)` with `peak = max |A|` over active voxels; `None` if `rms` or the peak is 0.
    pub psnr_db: Option<f64>,
    /// Root mean square difference over all voxels and components of the domain.
    pub rms: f64,
    /// Largest absolute difference of a value.
    pub max_abs: f64,
    /// Intersection over union of the topologies: voxels active in both over voxels active in either; 1 if none is
    /// active.
    pub topology_iou: f64,
    /// Largest distance in world units between the positions of a corner of the domain under the two transforms; 0 if
    /// equal.
    pub transform_difference: f64,
    /// Number of voxels of the domain.
    pub voxels: u64,
    /// Number of these voxels that were compared: all of them, or the part that [`Effort`] allows.
    pub compared: u64,
    /// True if figures are estimates from a part of the voxels. `max_abs` is the largest difference of that part.
    pub sampled: bool,
    /// Number of values of which one is finite and the other is not, or whose kinds of infinity differ. They are left
    /// out of `rms` and `max_abs`.
    pub incomparable: u64,
}

impl Difference {
    /// True if no value differs by more than `max_abs`, all values are comparable and the transforms are equal. With a
    /// `max_abs` of 0 the topologies must be equal too.
    pub fn within(&self, max_abs: f64) -> bool {
        self.max_abs <= max_abs
            && self.incomparable == 0
            && self.transform_difference == 0.0
            && (max_abs > 0.0 || self.topology_iou == 1.0)
    }
}

/// Bound of the work of a comparison of volumes on different lattices. (On one lattice all voxels are always compared, which
/// takes a fraction of the time.)
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Effort {
    /// Largest number of blocks of 8³ voxels that are compared voxel by voxel.
    blocks: usize,
}

impl Effort {
    /// All voxels.
    pub const ALL: Self = Self { blocks: usize::MAX };

    /// About so many voxels, one block of 8³ at least.
    pub fn voxels(count: u64) -> Self {
        Self { blocks: usize::try_from(count / LEAF_VOXELS as u64).unwrap_or(usize::MAX).max(1) }
    }
}

impl Default for Effort {
    /// 67 million voxels, which take some seconds.
    fn default() -> Self {
        Self { blocks: 1 << 17 }
    }
}

/// Receives how many of how many steps of a comparison are done.
pub type OnStep<'s> = &'s (dyn Fn(u64, u64) + Sync);

#[derive(Debug, Clone, Copy, Default)]
struct Partial {
    squares: f64,
    max: f64,
    both: u64,
    either: u64,
    incomparable: u64,
}

impl Partial {
    fn add(&mut self, p: &Self) {
        self.squares += p.squares;
        self.max = self.max.max(p.max);
        self.both += p.both;
        self.either += p.either;
        self.incomparable += p.incomparable;
    }

    /// Has the sums stand for `factor` times as many voxels.
    fn scale(&mut self, factor: f64) {
        let scaled = |count: u64| (count as f64 * factor).round() as u64;
        self.squares *= factor;
        (self.both, self.either) = (scaled(self.both), scaled(self.either));
        self.incomparable = scaled(self.incomparable);
    }

    /// Counts a pair of voxels, one of each volume, `times` times.
    fn count(&mut self, a: &Constant, b: &Constant, components: usize, times: u64) {
        self.both = self.both.saturating_add(if a.active && b.active { times } else { 0 });
        self.either = self.either.saturating_add(if a.active || b.active { times } else { 0 });
        for c in 0..components {
            let (u, v) = (a.value[c], b.value[c]);
            if u.is_finite() && v.is_finite() {
                let d = f64::from(u) - f64::from(v);
                self.squares += d * d * times as f64;
                self.max = self.max.max(d.abs());
            } else if !(u == v || u.is_nan() && v.is_nan()) {
                self.incomparable = self.incomparable.saturating_add(times);
            }
        }
    }
}

/// The voxels of the first volume, along one axis, that lie in one cell of the second.
#[derive(Debug)]
struct Run {
    /// Lower coordinate of the cell.
    base: f64,
    /// Least and greatest position of a voxel within the cell, from 0 to 1.
    ends: [f64; 2],
    /// Sums over the voxels of the products of the interpolation weights of the cell's two corners.
    products: [[f64; 2]; 2],
    /// Number of voxels nearer to each corner.
    nearer: [u64; 2],
    /// Coordinates of the first and the last voxel.
    voxels: [i32; 2],
}

impl Run {
    fn new(at: f64, voxel: i32) -> Self {
        let f = at - at.floor();
        let mut run =
            Self { base: at.floor(), ends: [f, f], products: [[0.0; 2]; 2], nearer: [0; 2], voxels: [voxel, voxel] };
        run.add(at, voxel);
        run
    }

    fn add(&mut self, at: f64, voxel: i32) {
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
    fn cell(
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
                }
            }
            for end in 0..8 {
                let f = std::array::from_fn(|i| runs[i].ends[at(end)[i]]);
                self.max = self.max.max((f64::from(value(f)) - f64::from(a.value[c])).abs());
            }
        }
        true
    }
}

/// Two volumes under comparison, with the partition of their domain.
#[derive(Debug)]
struct Pair<'f, 'a> {
    a: &'f Field<'a>,
    b: &'f Field<'a>,
    /// True if both volumes lie on one lattice.
    same: bool,
    /// Lowest voxel of the domain; `max` is the highest.
    min: [i32; 3],
    max: [i32; 3],
    /// True if the lattices differ but have parallel axes.
    along_axes: bool,
    /// Origins of blocks in which voxels are compared one by one.
    blocks: Vec<[i32; 3]>,
    /// Boxes, by lowest and highest voxel, in which the first volume has this value and the second is interpolated.
    interpolated: Vec<([i32; 3], [i32; 3], Constant)>,
    /// Sums over the cubes in which both volumes are constant.
    constant: Partial,
}

impl Pair<'_, '_> {
    /// Divides the domain, cube by cube.
    ///
    /// # Errors
    /// If there are too many blocks.
    fn divide(&mut self) -> Result<()> {
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

    /// Returns the sums over the divided domain, and the number of voxels that they are of. Of more blocks than `effort`
    /// allows on different lattices, one of each group of neighbors stands for all.
    fn sum(&self, effort: Effort, step: OnStep<'_>) -> (Partial, Option<u64>) {
        let group = if self.same { 1 } else { self.blocks.len().div_ceil(effort.blocks) };
        let chosen = chosen(&self.blocks, group);
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
                .hint("crop both to the part that matters first: cumulo convert --crop"));
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
                        if copied {
                            Field::sample(at, |p| window.voxels[window.offset(p.map(i64::from))])
                        } else {
                            Field::sample(at, |p| self.b.content(p).voxel(p, n))
                        }
                    };
                    p.count(&a.voxel([x, y, z], n), &vb, n, 1);
                }
            }
        }
        p
    }
}

/// Returns one of each `group` of blocks in a row, at a place that a hash of the row's number tells: a regular pattern of the
/// volume's is not mistaken for the whole.
fn chosen(blocks: &[[i32; 3]], group: usize) -> Cow<'_, [[i32; 3]]> {
    if group <= 1 {
        return Cow::Borrowed(blocks);
    }
    let pick = |(row, blocks): (usize, &[[i32; 3]])| {
        let hash = (row as u64).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        blocks[(hash >> 32) as usize % blocks.len()]
    };
    blocks.chunks(group).enumerate().map(pick).collect::<Vec<_>>().into()
}

/// Compares all of `b` with the reference `a`, as [`compare_within`] does.
///
/// # Errors
/// The conditions are those of [`compare_within`].
pub fn compare(a: &Field<'_>, b: &Field<'_>) -> Result<Difference> {
    compare_within(a, b, Effort::ALL, &|_, _| {})
}

/// Compares `b` with the reference `a`, with no more work than `effort` allows. Regions in which both are constant are compared
/// as a whole. `step` is called again and again.
///
/// # Errors
/// If the components differ, or too many voxels would have to be compared.
pub fn compare_within(a: &Field<'_>, b: &Field<'_>, effort: Effort, step: OnStep<'_>) -> Result<Difference> {
    if a.components != b.components {
        return Err(Error::invalid(format!(
            "one grid has {} values a voxel, the other {}",
            a.components, b.components
        ))
        .hint("compare grids of one kind: name them with --grid"));
    }
    let same = a.transform == b.transform;
    let b_box = b.active_box.map(|(min, max)| if same { (min, max) } else { on_lattice(min, max, b, a) });
    let Some((min, max)) = union(a.active_box, b_box) else {
        return Ok(Difference {
            psnr_db: None,
            rms: 0.0,
            max_abs: 0.0,
            topology_iou: 1.0,
            transform_difference: transform_difference(a, b, [0; 3], [0; 3]),
            voxels: 0,
            compared: 0,
            sampled: false,
            incomparable: 0,
        });
    };
    let along_axes = !same && {
        let turn = b.transform.inverse_matrix() * a.transform.matrix();
        let columns = [turn.x_axis, turn.y_axis, turn.z_axis].map(|c| c.truncate().to_array());
        (0..3).all(|i| (0..3).all(|j| i == j || columns[i][j].abs() <= 1e-12 * columns[i][i].abs()))
    };
    let mut pair = Pair {
        a,
        b,
        same,
        min,
        max,
        along_axes,
        blocks: Vec::new(),
        interpolated: Vec::new(),
        constant: Partial::default(),
    };
    pair.divide()?;
    let (sum, left_out) = pair.sum(effort, step);
    let voxels: i128 = (0..3).map(|i| i128::from(max[i]) - i128::from(min[i]) + 1).product();
    let rms = (sum.squares / (voxels as f64 * a.components as f64)).sqrt();
    let peak = a.peak();
    Ok(Difference {
        psnr_db: (rms > 0.0 && peak > 0.0).then(|| 20.0 * (peak / rms).log10()),
        rms,
        max_abs: sum.max,
        topology_iou: if sum.either == 0 { 1.0 } else { sum.both as f64 / sum.either as f64 },
        transform_difference: transform_difference(a, b, min, max),
        voxels: voxels.min(u64::MAX.into()) as u64,
        compared: (voxels - i128::from(left_out.unwrap_or(0))).min(u64::MAX.into()) as u64,
        sampled: left_out.is_some(),
        incomparable: sum.incomparable,
    })
}

fn corner(c: [i32; 3]) -> DVec3 {
    DVec3::from_array(c.map(f64::from))
}

/// Box of the voxels of `from` on the lattice of `onto`, rounded outwards.
fn on_lattice(min: [i32; 3], max: [i32; 3], from: &Field<'_>, onto: &Field<'_>) -> ([i32; 3], [i32; 3]) {
    let world = Aabb { min: corner(min), max: corner(max) }.corners().map(|c| from.transform.to_world(c));
    let index = world.into_iter().fold(Aabb::EMPTY, |b, w| b.including(onto.transform.to_index(w)));
    // A rounding error below a millionth of a voxel must not add a layer.
    ((index.min + 1e-6).floor().as_ivec3().to_array(), (index.max - 1e-6).ceil().as_ivec3().to_array())
}

type IndexBox = ([i32; 3], [i32; 3]);

fn union(a: Option<IndexBox>, b: Option<IndexBox>) -> Option<IndexBox> {
    match (a, b) {
        (Some((a0, a1)), Some((b0, b1))) => {
            Some((std::array::from_fn(|i| a0[i].min(b0[i])), std::array::from_fn(|i| a1[i].max(b1[i]))))
        }
        (one, other) => one.or(other),
    }
}

fn transform_difference(a: &Field<'_>, b: &Field<'_>, min: [i32; 3], max: [i32; 3]) -> f64 {
    let corners = Aabb { min: corner(min), max: corner(max) }.corners();
    corners.map(|c| a.transform.to_world(c).distance(b.transform.to_world(c))).into_iter().fold(0.0, f64::max)
}
/// Root mean square differences at the voxels of `a` where `a` or `b` is not zero, in two parts: where a third field
/// `known` is at least one half, and elsewhere. `None` stands for a part without voxels.
pub fn rms_apart(a: &Bricks<f32>, b: &Bricks<f32>, known: &Bricks<f32>) -> [Option<f64>; 2] {
    let brick = |(brick, voxels): (&IVec3, &[f32])| {
        let mut sums = [[0.0_f64; 2]; 2];
        for (i, own) in voxels.iter().enumerate() {
            let local = IVec3::new((i >> 6) as i32, (i >> 3 & 7) as i32, (i & 7) as i32);
            let world = a.transform.to_world((8 * *brick + local).as_dvec3());
            let other = b.sample(b.transform.to_index(world));
            if *own != 0.0 || other != 0.0 {
                let part = &mut sums[usize::from(known.sample(known.transform.to_index(world)) < 0.5)];
                *part = [part[0] + f64::from(own - other).powi(2), part[1] + 1.0];
            }
        }
        sums
    };
    let owned = a.owned();
    let bricks = a.topology.bricks().par_iter().zip(owned.par_chunks(LEAF_VOXELS));
    let all: Vec<_> = bricks.map(brick).collect();
    [0, 1].map(|part| {
        let [square, count] = all.iter().fold([0.0; 2], |t, s| [t[0] + s[part][0], t[1] + s[part][1]]);
        (count > 0.0).then(|| (square / count).sqrt())
    })
}
