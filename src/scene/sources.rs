//! Sources of brick values: the leaves and tiles of a grid, found by brick coordinates.

use crate::error::{Error, Result};
use crate::real::Real;
use crate::scene::grid::{Grid, LEAF_VOXELS, Leaf, MOST_DENSITY, voxel_offset};
use crate::scene::topology::{CELLS, EDGE, slot};
use glam::IVec3;
use rayon::prelude::*;
use std::collections::{BTreeSet, HashMap};

/// Edges of tiles, in bricks.
const TILE_EDGES: [i32; 3] = [1, 16, 512];

/// Source of the voxels of one brick: a leaf by number, or the value of a tile.
#[derive(Debug, Clone, Copy)]
enum Source {
    Leaf(usize),
    Constant(f32),
}

/// Values are at most this many times their spread away from 0 to be stored as they are.
const MOST_DISTANT: f64 = 64.0;

/// Returns the number of values that are wrong.
fn count(grid: &Grid, wrong: fn(f32) -> bool) -> usize {
    let in_leaf = |leaf: &Leaf| leaf.values.iter().filter(|v| wrong(**v)).count();
    let in_leaves = grid.leaves.par_iter().map(in_leaf).sum::<usize>();
    in_leaves + grid.tiles.iter().filter(|tile| wrong(tile.value)).count()
}

/// Refuses what is no density: another background than 0, and values that are not finite or negative.
fn check_densities(grid: &Grid) -> Result<()> {
    if grid.background != 0.0 {
        let hint = if grid.background.is_finite() {
            "a transfer function in the data's own units shows such values as they are: ⟨tf=NAME⟩; \
             ⟨convert.map=LOW,HIGH⟩ makes densities of them; a level set, which has its narrow band as background, is \
             converted to a fog volume first"
        } else {
            "⟨convert.repair⟩ sets the background to 0"
        };
        let what = format!("background is {}, a fog volume has 0 outside", grid.background);
        return Err(Error::unsupported(what).hint(hint));
    }
    let kinds = [
        (count(grid, |v| v < 0.0), "negative"),
        (count(grid, |v| !v.is_finite() && v >= 0.0 || v.is_nan()), "NaN or infinite"),
    ];
    let found = kinds.iter().filter(|(count, _)| *count > 0);
    let found: Vec<String> = found.map(|(count, kind)| format!("{count} values are {kind}")).collect();
    if found.is_empty() {
        return Ok(());
    }
    Err(Error::invalid(format!("{}; densities are finite and at least 0", found.join(" and "))).hint(
        "a transfer function in the data's own units, such as Hounsfield units, shows signed values as they are: \
         ⟨tf=NAME⟩; ⟨convert.map=LOW,HIGH⟩ makes densities of them; ⟨convert.repair=density⟩ sets them to 0 and says \
         how many there were",
    ))
}

/// Refuses values that are not finite.
fn check_finite(grid: &Grid) -> Result<()> {
    if !grid.background.is_finite() {
        return Err(Error::invalid(format!("background is {}, a finite number is needed", grid.background))
            .hint("⟨convert.repair⟩ sets the background to 0"));
    }
    match count(grid, |v| !v.is_finite()) {
        0 => Ok(()),
        found => Err(Error::invalid(format!("{found} values are NaN or infinite, finite ones are needed"))
            .hint("⟨convert.repair⟩ sets them to 0 and says how many there were")),
    }
}

/// Returns the value that others are best stored as differences to: 0, or the least active value where all lie much
/// farther from 0 than from each other, so that single precision tells them apart.
fn reference(grid: &Grid) -> f64 {
    let of_leaf = |leaf: &Leaf| {
        let active = (0..LEAF_VOXELS).filter(|i| leaf.active[i >> 6] >> (i & 63) & 1 == 1);
        active.fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), i| (a.min(leaf.values[i]), b.max(leaf.values[i])))
    };
    let widest = |a: (f32, f32), b: (f32, f32)| (a.0.min(b.0), a.1.max(b.1));
    let leaves = grid.leaves.par_iter().map(of_leaf).reduce(|| (f32::INFINITY, f32::NEG_INFINITY), widest);
    let tiles = grid.tiles.iter().filter(|tile| tile.active).map(|tile| (tile.value, tile.value));
    let (low, high) = tiles.fold(leaves, widest);
    let (low, spread) = (f64::from(low), f64::from(high) - f64::from(low));
    let distance = low.max(-f64::from(high));
    if spread > 0.0 && distance > MOST_DISTANT * spread { low } else { 0.0 }
}

/// The leaves and tiles of a grid that differ from its background.
#[derive(Debug)]
pub(super) struct Sources<'g> {
    grid: &'g Grid,
    /// Value that others are stored as differences to.
    pub(super) reference: f64,
    /// Leaf numbers by brick coordinates.
    leaves: HashMap<IVec3, usize>,
    /// Tile values by the coordinates of the tile's lowest brick, for each edge in [`TILE_EDGES`].
    tiles: [HashMap<IVec3, f32>; 3],
}

fn brick(origin: [i32; 3]) -> IVec3 {
    IVec3::from_array(origin.map(|c| c.div_euclid(8)))
}

/// Offset to one of the eight bricks that a brick reaches into, itself being corner 0: bits 2, 1 and 0 of `corner` step
/// along x, y and z.
fn offset(corner: i32) -> IVec3 {
    IVec3::new(corner >> 2 & 1, corner >> 1 & 1, corner & 1)
}

impl<'g> Sources<'g> {
    /// Checks a grid of densities and indexes its nonzero leaves and tiles.
    ///
    /// # Errors
    /// If the grid is no fog volume with background 0, if a value is NaN, infinite, negative or above [`MOST_DENSITY`],
    /// or if a tile fits no VDB tree.
    pub(super) fn densities(grid: &'g Grid) -> Result<Self> {
        check_densities(grid)?;
        Self::new(grid, 0.0)
    }

    /// Checks a grid of any values and indexes its leaves and tiles that differ from the background.
    ///
    /// # Errors
    /// If a value or the background is NaN, infinite or beyond [`MOST_DENSITY`], or if a tile fits no VDB tree.
    pub(super) fn values(grid: &'g Grid) -> Result<Self> {
        check_finite(grid)?;
        Self::new(grid, reference(grid))
    }

    fn new(grid: &'g Grid, reference: f64) -> Result<Self> {
        let largest = |values: &[f32]| values.iter().fold(0.0, |a: f32, b| a.max(b.abs()));
        let leaves = grid.leaves.par_iter().map(|l| largest(&l.values[..])).reduce(|| 0.0, f32::max);
        let most = grid.tiles.iter().fold(leaves.max(grid.background.abs()), |a, t| a.max(t.value.abs()));
        if most > MOST_DENSITY {
            return Err(Error::invalid(format!("densities reach {most:e}, above {MOST_DENSITY:e}"))
                .hint("scale them down where the grid was made; ⟨density_scale⟩ takes the rest"));
        }
        let mut tiles: [HashMap<IVec3, f32>; 3] = Default::default();
        for tile in grid.tiles.iter().filter(|t| t.value != grid.background) {
            let level = TILE_EDGES.iter().position(|edge| 8 * edge == tile.dim);
            let level = level.filter(|_| tile.origin.iter().all(|c| c.rem_euclid(tile.dim) == 0)).ok_or_else(|| {
                Error::invalid(format!("a tile of {}³ voxels at {:?} fits no VDB tree", tile.dim, tile.origin))
                    .hint("tiles have edges of 8, 128 or 4096 voxels and begin at multiples of their edge")
            })?;
            tiles[level].insert(brick(tile.origin), tile.value);
        }
        let differs = |leaf: &Leaf| leaf.values.iter().any(|v| *v != grid.background);
        let filled = grid.leaves.iter().enumerate().filter(|(_, leaf)| differs(leaf));
        Ok(Self { grid, reference, leaves: filled.map(|(i, leaf)| (brick(leaf.origin), i)).collect(), tiles })
    }

    /// Bytes of memory that the index occupies.
    pub(super) fn memory(&self) -> u64 {
        let tiles: usize = self.tiles.iter().map(HashMap::capacity).sum();
        (self.leaves.capacity() * 25 + tiles * 17) as u64
    }

    /// Number of bricks that the tiles cover.
    pub(super) fn tile_bricks(&self) -> u64 {
        let of = |(tiles, edge): (&HashMap<IVec3, f32>, &i32)| tiles.len() as u64 * (*edge as u64).pow(3);
        self.tiles.iter().zip(&TILE_EDGES).map(of).sum()
    }

    /// Lowest and highest brick coordinates of the box that each tile reaches into: largest tiles first, ascending
    /// within a size.
    pub(super) fn tile_boxes(&self) -> impl Iterator<Item = (IVec3, IVec3)> + '_ {
        self.tiles.iter().zip(TILE_EDGES).rev().flat_map(|(tiles, edge)| {
            let mut sorted: Vec<[i32; 3]> = tiles.keys().map(|b| b.to_array()).collect();
            sorted.sort_unstable();
            sorted.into_iter().map(IVec3::from_array).map(move |low| (low - 1, low + (edge - 1)))
        })
    }

    /// Coordinates of all bricks that store a voxel of a leaf that differs from the background, as their own or in
    /// their apron.
    pub(super) fn needed_by_leaves(&self) -> BTreeSet<[i32; 3]> {
        let mut needed = BTreeSet::new();
        for (at, leaf) in &self.leaves {
            for corner in 0..8 {
                if self.touches(*leaf, offset(corner)) {
                    needed.insert((*at - offset(corner)).to_array());
                }
            }
        }
        needed
    }

    /// True if a leaf has a voxel that differs from the background on the low faces along the axes where `offset` is 1,
    /// or anywhere if it is 0.
    fn touches(&self, leaf: usize, offset: IVec3) -> bool {
        let end = |a: usize| if offset[a] == 1 { 1 } else { CELLS };
        let (values, empty) = (&self.grid.leaves[leaf].values, self.grid.background);
        (0..end(0)).any(|x| (0..end(1)).any(|y| (0..end(2)).any(|z| values[voxel_offset([x, y, z])] != empty)))
    }

    fn at(&self, brick: IVec3) -> Option<Source> {
        if let Some(leaf) = self.leaves.get(&brick) {
            return Some(Source::Leaf(*leaf));
        }
        let of = |(tiles, edge): (&HashMap<IVec3, f32>, &i32)| {
            if tiles.is_empty() { None } else { tiles.get(&brick.map(|c| c & !(edge - 1))).copied() }
        };
        self.tiles.iter().zip(&TILE_EDGES).find_map(of).map(Source::Constant)
    }

    /// Constant values of the eight bricks that a brick reaches into. Valid for bricks that store no voxel of a leaf
    /// that differs from the background.
    pub(super) fn constants(&self, brick: IVec3) -> [f32; 8] {
        std::array::from_fn(|corner| match self.at(brick + offset(corner as i32)) {
            Some(Source::Constant(value)) => value,
            _ => self.grid.background,
        })
    }

    /// Returns a value as it is stored.
    fn stored<R: Real>(&self, value: f32) -> R {
        R::of(f64::from(value) - self.reference)
    }

    /// Returns the background as it is stored.
    pub(super) fn background<R: Real>(&self) -> R {
        self.stored(self.grid.background)
    }

    /// Writes the stored values of a brick into `out`, which must hold the background.
    pub(super) fn fill<R: Real>(&self, brick: IVec3, out: &mut [R]) {
        for corner in 0..8 {
            let offset = offset(corner);
            let Some(source) = self.at(brick + offset) else { continue };
            let part = |a: i32| if a == 0 { 0..CELLS } else { CELLS..EDGE };
            for x in part(offset.x) {
                for y in part(offset.y) {
                    for z in part(offset.z) {
                        let v = match source {
                            Source::Leaf(l) => self.grid.leaves[l].values[voxel_offset([x, y, z])],
                            Source::Constant(v) => v,
                        };
                        out[slot(x, y, z)] = self.stored(v);
                    }
                }
            }
        }
    }
}
