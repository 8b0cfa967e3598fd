//! Sparse volumes whose voxels are looked up by index coordinates.

use crate::math::Affine;
use crate::scene::grid::{Grid, voxel_offset};
use glam::{DVec3, IVec3};
use std::collections::{HashMap, HashSet};

/// Largest number of voxels of the second volume that are copied to sample one block of the first.
pub(super) const WINDOW: usize = 1 << 18;
/// Number of levels of cubes. Cubes of a level have edges of `8 << level` voxels; those of the last level are half of
/// index space.
const LEVELS: usize = 29;

#[derive(Debug, Clone, Copy)]
pub(super) struct Block<'a> {
    pub(super) values: &'a [f32],
    pub(super) active: &'a [u64; 8],
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Constant {
    pub(super) value: [f32; 3],
    pub(super) active: bool,
}

impl Constant {
    pub(super) fn same(&self, other: &Self) -> bool {
        self.value.map(f32::to_bits) == other.value.map(f32::to_bits) && self.active == other.active
    }
}

/// Content of an aligned block of 8³ voxels.
#[derive(Debug, Clone, Copy)]
pub(super) enum Content<'a> {
    Voxels(Block<'a>),
    Constant(Constant),
}

/// A sparse volume whose voxels are looked up by index coordinates.
#[derive(Debug)]
pub struct Field<'a> {
    pub(super) components: usize,
    pub(super) background: [f32; 3],
    pub(super) transform: Affine,
    pub(super) active_box: Option<([i32; 3], [i32; 3])>,
    pub(super) leaves: HashMap<[i32; 3], Block<'a>>,
    pub(super) tiles: [HashMap<[i32; 3], Constant>; 3],
    /// Cubes that hold a leaf, or a tile smaller than themselves, by level; cube coordinates are voxel coordinates over
    /// the edge. All other cubes are constant.
    pub(super) mixed: Vec<HashSet<[i32; 3]>>,
}

pub(super) const TILE_DIMS: [i32; 3] = [8, 128, 4096];

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
    pub(super) fn mark(&mut self, voxel: [i32; 3], from: usize) {
        for level in from..LEVELS {
            // The cubes around a marked cube are marked already.
            if !self.mixed[level].insert(voxel.map(|c| c >> (level + 3))) {
                break;
            }
        }
    }

    pub(super) fn constant(&self, p: [i32; 3]) -> Constant {
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
    pub(super) fn content(&self, p: [i32; 3]) -> Content<'a> {
        match self.leaves.get(&p.map(|c| c & !7)) {
            Some(block) => Content::Voxels(*block),
            None => Content::Constant(self.constant(p)),
        }
    }

    /// Value of all voxels of a box, both corners included; `None` where voxels may differ.
    pub(super) fn uniform(&self, low: [i64; 3], high: [i64; 3]) -> Option<Constant> {
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
    pub(super) fn sample(p: DVec3, voxel: impl Fn([i32; 3]) -> Constant) -> Constant {
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

    pub(super) fn peak(&self) -> f64 {
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
    pub(super) fn voxel(&self, p: [i32; 3], components: usize) -> Constant {
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
pub(super) struct Window {
    pub(super) low: [i64; 3],
    pub(super) size: [usize; 3],
    pub(super) voxels: Vec<Constant>,
}

impl Window {
    /// Copies the box with these corners, both included. Returns false if the box is too large or leaves index space.
    pub(super) fn copy(&mut self, field: &Field<'_>, low: [i64; 3], high: [i64; 3]) -> bool {
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

    /// Trilinearly interpolated value of `components` numbers at index coordinates, as [`Field::sample`] returns it.
    pub(super) fn sample(&self, p: DVec3, components: usize) -> Constant {
        let base = p.floor();
        let upper = p - base;
        let [x, y, z] = [upper.x, upper.y, upper.z].map(|f| [1.0 - f, f]);
        let [across, along] = [self.size[1] * self.size[2], self.size[2]];
        let start = self.offset(base.to_array().map(|c| c as i64));
        let mut value = [0.0_f64; 3];
        for i in 0..2 {
            for j in 0..2 {
                for k in 0..2 {
                    let weight = x[i] * y[j] * z[k];
                    // What has no weight may lie beyond the copy.
                    if weight > 0.0 {
                        let voxel = &self.voxels[start + i * across + j * along + k];
                        (0..components).for_each(|c| value[c] += weight * f64::from(voxel.value[c]));
                    }
                }
            }
        }
        let [i, j, k] = (p.round() - base).to_array().map(|c| c as usize);
        let active = self.voxels[start + i * across + j * along + k].active;
        Constant { value: value.map(|v| v as f32), active }
    }

    pub(super) fn offset(&self, p: [i64; 3]) -> usize {
        let local: [usize; 3] = std::array::from_fn(|a| (p[a] - self.low[a]) as usize);
        (local[0] * self.size[1] + local[1]) * self.size[2] + local[2]
    }
}
