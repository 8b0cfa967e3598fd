//! Topology of sparse bricks of 8³ cells: which bricks exist and how their voxels are numbered.
//!
//! A brick owns the 8³ *cells* whose lowest corner lies in one leaf of the VDB tree. It stores the 9³ voxel values at
//! their corners, so that trilinear interpolation never leaves the brick.
//!
//! The values of a brick are `values[(x * 9 + y) * 9 + z]`, z fastest as in OpenVDB's leaves.

use crate::error::{Error, Result};
use crate::math::Aabb;
use crate::scene::grid::{LEAF_VOXELS, voxel_offset};
use bytemuck::Pod;
use glam::IVec3;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::ops::AddAssign;

/// Cells along the edge of a brick.
pub const CELLS: usize = 8;
/// Stored voxels along the edge of a brick: the corners of its cells.
pub const EDGE: usize = CELLS + 1;
/// Stored voxels of a brick.
pub const BRICK: usize = EDGE * EDGE * EDGE;
/// Brick number that marks the absence of a brick.
pub const NONE: u32 = u32::MAX;

/// Index of a stored voxel within its brick, with coordinates from 0 to 8.
#[inline(always)]
pub const fn slot(x: usize, y: usize, z: usize) -> usize {
    (x * EDGE + y) * EDGE + z
}

/// Value of a voxel: a scalar, or the four numbers of a pre-shaded volume. The default is an empty voxel.
pub trait Voxel: Pod + Default + AddAssign + Send + Sync {}
impl<V: Pod + Default + AddAssign + Send + Sync> Voxel for V {}

/// The set of bricks of a field, with a table that finds them by their coordinates.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Topology {
    /// Brick coordinates of the first table entry.
    min: IVec3,
    /// Number of table entries along x, y, z.
    dim: IVec3,
    /// Brick number or [`NONE`] by table entry, z fastest.
    table: Vec<u32>,
    /// Chebyshev distance in bricks to the nearest brick, less one, by table entry; empty if it was not computed.
    clear: Vec<u8>,
    /// Brick coordinates of the box of all bricks that can be found: the lowest, and one past the highest.
    found: [IVec3; 2],
    /// Brick coordinates (voxel coordinates / 8) by number, ascending. A brick with several places has one of them.
    bricks: Vec<IVec3>,
    /// True if a brick may lie in several places.
    instanced: bool,
}

/// Largest number of table entries: 1 GiB of them. Only volumes of distant specks need more.
const TABLE_LIMIT: i64 = 1 << 28;

/// Number of table entries for the box of bricks from `min` to `max`, both included.
///
/// # Errors
/// If the table would exceed 2²⁸ entries; the error states the extent.
pub fn table_entries(min: IVec3, max: IVec3) -> Result<usize> {
    let extent = max.as_i64vec3() - min.as_i64vec3() + 1;
    let entries = extent.x.checked_mul(extent.y).and_then(|e| e.checked_mul(extent.z));
    match entries.filter(|e| *e <= TABLE_LIMIT) {
        Some(entries) => Ok(entries as usize),
        None => Err(Error::unsupported(format!(
            "active voxels are spread over {} x {} x {} voxels, too far apart to index",
            8 * extent.x,
            8 * extent.y,
            8 * extent.z
        ))
        .hint("keep the part that matters with ⟨convert.crop⟩")),
    }
}

/// Refuses more bricks than kernels can address, since they hold offsets of values in 32 bits.
///
/// # Errors
/// If there are too many bricks; the error states how many.
pub(super) fn addressable(bricks: usize) -> Result<()> {
    if bricks <= u32::MAX as usize / BRICK {
        return Ok(());
    }
    Err(Error::unsupported(format!("{bricks} blocks of 8³ voxels are more than can be addressed"))
        .hint("take a part with ⟨convert.crop⟩, or a coarser one with ⟨convert.resample⟩"))
}

impl Topology {
    /// A topology of the given brick coordinates (voxel coordinates divided by 8), without duplicates.
    ///
    /// # Errors
    /// If the bricks are too many to address, or so far apart that the table would be too large.
    pub fn new(bricks: impl IntoIterator<Item = IVec3>) -> Result<Self> {
        let set: BTreeSet<[i32; 3]> = bricks.into_iter().map(|b| b.to_array()).collect();
        let bricks: Vec<IVec3> = set.into_iter().map(IVec3::from_array).collect();
        let Some(&first) = bricks.first() else {
            let (min, found) = (IVec3::ZERO, [IVec3::ZERO; 2]);
            return Ok(Self { min, dim: min, table: Vec::new(), clear: Vec::new(), found, bricks, instanced: false });
        };
        addressable(bricks.len())?;
        let (min, max) = bricks.iter().fold((first, first), |(lo, hi), b| (lo.min(*b), hi.max(*b)));
        let table = vec![NONE; table_entries(min, max)?];
        let dim = max - min + 1;
        let found = [min, min + dim];
        let mut topology = Self { min, dim, table, clear: Vec::new(), found, bricks: Vec::new(), instanced: false };
        for (i, b) in bricks.iter().enumerate() {
            if let Some(entry) = topology.entry(*b) {
                topology.table[entry] = i as u32;
            }
        }
        topology.bricks = bricks;
        Ok(topology)
    }

    /// A topology whose bricks may lie in several places each. `table` holds brick numbers or [`NONE`] for the box of
    /// `dim` bricks from `min`, z fastest; `bricks` has one place of each number.
    pub(super) fn from_table(min: IVec3, dim: IVec3, table: Vec<u32>, bricks: Vec<IVec3>) -> Self {
        Self { min, dim, table, clear: Vec::new(), found: [min, min + dim], bricks, instanced: true }
    }

    /// True if a brick may lie in several places, as those of constant tiles do.
    /// Renderers need not distinguish. Code that gives each place separate values works on
    /// [`Bricks::expanded`](crate::scene::bricks::Bricks::expanded).
    pub(crate) fn is_instanced(&self) -> bool {
        self.instanced
    }

    /// All places in ascending order, each with the number of its brick.
    pub fn places(&self) -> impl Iterator<Item = (IVec3, u32)> + '_ {
        self.rows().flat_map(|(start, numbers)| {
            let there = numbers.iter().enumerate().filter(|(_, number)| **number != NONE);
            there.map(move |(z, number)| (start + IVec3::new(0, 0, z as i32), *number))
        })
    }

    /// Rows of the table along z: brick coordinates of the first entry, and the brick numbers.
    pub(super) fn rows(&self) -> impl Iterator<Item = (IVec3, &[u32])> + '_ {
        let rows = self.table.chunks(self.dim.z.max(1) as usize).enumerate();
        rows.map(move |(row, numbers)| {
            let row = row as i32;
            (self.min + IVec3::new(row / self.dim.y, row % self.dim.y, 0), numbers)
        })
    }

    /// Bytes of memory that the table occupies.
    pub fn table_bytes(&self) -> u64 {
        (self.table.len() * size_of::<u32>()) as u64
    }

    #[inline(always)]
    fn entry(&self, brick: IVec3) -> Option<usize> {
        let r = brick - self.min;
        let inside = r.cmpge(IVec3::ZERO).all() && r.cmplt(self.dim).all();
        inside.then(|| ((r.x * self.dim.y + r.y) as usize) * self.dim.z as usize + r.z as usize)
    }

    /// A topology of all bricks in the box around this one.
    ///
    /// # Errors
    /// If the bricks are too many to address.
    pub(crate) fn filled(&self) -> Result<Self> {
        let dim = self.dim;
        let all = (0..dim.x).flat_map(|x| (0..dim.y).map(move |y| (x, y)));
        Self::new(all.flat_map(|(x, y)| (0..dim.z).map(move |z| self.min + IVec3::new(x, y, z))))
    }

    /// Table entry of the brick at brick coordinates that count from those of the first entry and lie within the table.
    #[inline(always)]
    pub(crate) fn entry_of(&self, [x, y, z]: [u32; 3]) -> u32 {
        let [_, height, depth] = self.dim.to_array().map(|d| d as u32);
        (x.wrapping_mul(height).wrapping_add(y)).wrapping_mul(depth).wrapping_add(z)
    }

    /// Brick numbers or [`NONE`] by table entry.
    #[inline(always)]
    pub(crate) fn table(&self) -> &[u32] {
        &self.table
    }

    /// Chebyshev distance in bricks from a table entry without a brick within which there is none either; `None` where
    /// there is a brick.
    #[inline(always)]
    pub(crate) fn clearance_at(&self, entry: u32) -> Option<i32> {
        let entry = entry as usize;
        (self.table[entry] == NONE).then(|| self.clear.get(entry).map_or(0, |c| i32::from(*c)))
    }

    /// Number of the brick at brick coordinates `brick`, or [`NONE`].
    #[inline(always)]
    pub fn find(&self, brick: IVec3) -> u32 {
        self.entry(brick).map_or(NONE, |e| self.table[e])
    }

    /// Number of the brick at brick coordinates `brick`.
    ///
    /// # Errors
    /// If there is no brick: a Chebyshev distance in bricks within which there is none either (0 if unknown).
    #[inline(always)]
    pub(crate) fn lookup(&self, brick: IVec3) -> Result<u32, i32> {
        let Some(entry) = self.entry(brick) else { return Err(0) };
        match self.table[entry] {
            NONE => Err(self.clear.get(entry).map_or(0, |c| i32::from(*c))),
            number => Ok(number),
        }
    }

    /// Brick coordinates by number, ascending. A brick with several places has one of them.
    pub fn bricks(&self) -> &[IVec3] {
        &self.bricks
    }

    /// Number of bricks; one with several places counts once.
    pub fn len(&self) -> usize {
        self.bricks.len()
    }

    /// True if there are no bricks.
    pub fn is_empty(&self) -> bool {
        self.bricks.is_empty()
    }

    /// Index-space box of all cells: the box of the table, bricks that are masked out included.
    pub fn bounds(&self) -> Aabb {
        if self.is_empty() {
            return Aabb::EMPTY;
        }
        Aabb { min: 8.0 * self.min.as_dvec3(), max: 8.0 * (self.min + self.dim).as_dvec3() }
    }

    /// A copy in which only bricks whose number `keep` accepts can be found. Brick numbers stay; empty-space distances
    /// are computed anew.
    #[must_use]
    pub(crate) fn masked(&self, keep: impl Fn(usize) -> bool) -> Self {
        let mut masked = self.clone();
        for entry in masked.table.iter_mut().filter(|e| **e != NONE) {
            if !keep(*entry as usize) {
                *entry = NONE;
            }
        }
        masked.clear = masked.clearance();
        // A brick is kept in all of its places or in none.
        let join = |[low, high]: [IVec3; 2], b: IVec3| [low.min(b), high.max(b + 1)];
        let [low, high] = if masked.instanced {
            masked.places().fold([IVec3::MAX, IVec3::MIN], |found, (b, _)| join(found, b))
        } else {
            let kept = masked.bricks.iter().filter(|b| masked.find(**b) != NONE);
            kept.fold([IVec3::MAX, IVec3::MIN], |found, b| join(found, *b))
        };
        masked.found = if low.cmple(high).all() { [low, high] } else { [IVec3::ZERO; 2] };
        masked
    }

    /// Index-space box of the bricks that can be found; of zero size if there are none.
    pub(crate) fn reach(&self) -> Aabb {
        let [low, high] = self.found;
        Aabb { min: 8.0 * low.as_dvec3(), max: 8.0 * high.as_dvec3() }
    }

    /// Chebyshev distance in bricks to the nearest brick, less one, by table entry (0 where there is one). The result
    /// is empty if no entry is.
    fn clearance(&self) -> Vec<u8> {
        const FAR: u8 = u8::MAX;
        if !self.table.contains(&NONE) {
            return Vec::new();
        }
        let mut distance: Vec<u8> = self.table.iter().map(|e| if *e == NONE { FAR } else { 0 }).collect();
        let dim = self.dim.to_array().map(|d| d as usize);
        // Two sweeps over the 26 neighbours, first those before and then those after an entry, are exact for this
        // distance.
        let (rows, row) = (dim[1] as isize * dim[2] as isize, dim[2] as isize);
        let offset = |d: [i32; 3]| d[0] as isize * rows + d[1] as isize * row + d[2] as isize;
        let before: Vec<[i32; 3]> = (0..13).map(|i| [i / 9 - 1, i / 3 % 3 - 1, i % 3 - 1]).collect();
        let inside = |p: [usize; 3], d: [i32; 3]| (0..3).all(|a| p[a].wrapping_add_signed(d[a] as isize) < dim[a]);
        let mut settle = |entry: usize, sign: i32| {
            let p = [entry / (dim[1] * dim[2]), entry / dim[2] % dim[1], entry % dim[2]];
            let near = before.iter().map(|d| d.map(|v| sign * v)).filter(|d| inside(p, *d));
            let least = near.map(|d| distance[entry.wrapping_add_signed(offset(d))]).min().unwrap_or(FAR);
            distance[entry] = distance[entry].min(least.saturating_add(1));
        };
        (0..self.table.len()).for_each(|entry| settle(entry, 1));
        (0..self.table.len()).rev().for_each(|entry| settle(entry, -1));
        distance.into_iter().map(|d| d.saturating_sub(1)).collect()
    }

    /// Copies owned voxels (512 per brick, z fastest) into stored ones (729 per brick), aprons included.
    pub fn fill_apron<V: Voxel>(&self, owned: &[V], stored: &mut [V]) {
        stored.par_chunks_mut(BRICK).zip(self.bricks.par_iter()).for_each(|(out, brick)| {
            for corner in 0..8 {
                let offset = IVec3::new(corner >> 2 & 1, corner >> 1 & 1, corner & 1);
                let source = self.find(*brick + offset);
                let part = |a: i32| if a == 0 { 0..CELLS } else { CELLS..EDGE };
                for x in part(offset.x) {
                    for y in part(offset.y) {
                        for z in part(offset.z) {
                            out[slot(x, y, z)] = if source == NONE {
                                V::default()
                            } else {
                                owned[source as usize * LEAF_VOXELS + voxel_offset([x, y, z])]
                            };
                        }
                    }
                }
            }
        });
    }

    /// Indices at which an owned voxel (512 per brick, z fastest) is stored: first in its own brick, then in the aprons
    /// of the neighbours below. `None` stands for a neighbour that is missing or does not store the voxel.
    pub(crate) fn slots(&self, voxel: usize) -> [Option<usize>; 8] {
        let (brick, i) = (voxel / LEAF_VOXELS, voxel % LEAF_VOXELS);
        let local = [i >> 6, i >> 3 & 7, i & 7];
        std::array::from_fn(|corner| {
            let below = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
            if (0..3).any(|a| below[a] == 1 && local[a] != 0) {
                return None;
            }
            let number = self.find(self.bricks[brick] - IVec3::from_array(below.map(|b| b as i32)));
            let [x, y, z] = std::array::from_fn(|a| local[a] + below[a] * CELLS);
            (number != NONE).then(|| number as usize * BRICK + slot(x, y, z))
        })
    }

    /// Adds stored values onto the voxels that own them: the transpose of [`Topology::fill_apron`].
    pub fn gather_apron<V: Voxel>(&self, stored: &[V], owned: &mut [V]) {
        owned.par_chunks_mut(LEAF_VOXELS).zip(self.bricks.par_iter().enumerate()).for_each(|(out, (i, brick))| {
            let own = &stored[i * BRICK..(i + 1) * BRICK];
            for x in 0..CELLS {
                for y in 0..CELLS {
                    for z in 0..CELLS {
                        out[voxel_offset([x, y, z])] = own[slot(x, y, z)];
                    }
                }
            }
            for corner in 1..8 {
                let offset = IVec3::new(corner >> 2 & 1, corner >> 1 & 1, corner & 1);
                let source = self.find(*brick - offset);
                if source == NONE {
                    continue;
                }
                let theirs = &stored[source as usize * BRICK..(source as usize + 1) * BRICK];
                let part = |a: i32| if a == 0 { 0..CELLS } else { 0..1 };
                let shift = |a: i32| a as usize * CELLS;
                for x in part(offset.x) {
                    for y in part(offset.y) {
                        for z in part(offset.z) {
                            out[voxel_offset([x, y, z])] +=
                                theirs[slot(x + shift(offset.x), y + shift(offset.y), z + shift(offset.z))];
                        }
                    }
                }
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Filling and gathering are transposes: `⟨fill_apron(u), v⟩ = ⟨u, gather_apron(v)⟩`, exactly in integers.
    #[test]
    fn fold_is_the_transpose_of_spread() {
        let bricks = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 1], [0, 0, 1], [-1, 0, 0]];
        let t = Topology::new(bricks.map(IVec3::from_array)).unwrap();
        let owned: Vec<f64> = (0..t.len() * LEAF_VOXELS).map(|i| (i * 7 % 23) as f64).collect();
        let other: Vec<f64> = (0..t.len() * BRICK).map(|i| (i * 5 % 19) as f64).collect();
        let (mut stored, mut folded) = (vec![0.0; t.len() * BRICK], vec![0.0; t.len() * LEAF_VOXELS]);
        t.fill_apron(&owned, &mut stored);
        t.gather_apron(&other, &mut folded);
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        assert_eq!(dot(&stored, &other), dot(&owned, &folded));
        // The slots of a voxel are the nonzero rows of a column of `fill_apron`.
        for (voxel, sum) in folded.iter().enumerate() {
            let slots = t.slots(voxel);
            assert_eq!(slots.into_iter().flatten().map(|s| other[s]).sum::<f64>(), *sum);
            assert_eq!(slots[0].map(|s| stored[s]), Some(owned[voxel]));
        }
    }

    #[test]
    fn specks_too_far_apart_are_refused() {
        let far = Topology::new([IVec3::ZERO, IVec3::splat(100_000)]);
        assert!(far.unwrap_err().to_string().contains("`convert.crop`"));
    }
}
