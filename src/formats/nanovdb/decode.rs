//! Walk through a grid's memory: header, tree, root, upper and lower nodes, leaves.

use super::bytes::{Bytes, DAMAGED};
use super::collect::Collector;
use super::layout::{self, Kind, LOWER, Level, NODE_MASKS, UPPER};
use super::texts;
use super::volume::{KEPT, Volume};
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::math::Affine;
use crate::scene::grid::GridClass;
use glam::{DMat3, DMat4, DVec3};
use std::collections::{BTreeMap, HashSet};

/// Decodes a grid.
///
/// # Errors
/// If a node lies outside the memory, two nodes claim one place, the transform is singular, or the leaves do not fit
/// into the limits.
pub(super) fn volume(memory: Bytes, name: &str, kind: Kind, class: GridClass, limits: Limits) -> Result<Volume> {
    let mut notes = Vec::new();
    let number = memory.u32(layout::GRID_KIND, "the type")?;
    if number != kind as u32 {
        let what = format!("the directory says {}, the grid itself {}", kind.name(), layout::name(number));
        return Err(Error::invalid(what).hint(DAMAGED));
    }
    let transform = transform(memory)?;
    if !checksum_agrees(memory, kind)? {
        notes.push("the checksum of the header disagrees: the grid is damaged, or was edited".to_owned());
    }
    if matches!(kind, Kind::Double | Kind::Vec3d | Kind::Int64 | Kind::UInt32) {
        notes.push(format!("{} values are rounded to 32-bit floats", kind.name()));
    }
    let tree = layout::GRID as u64;
    let root = tree
        .checked_add(memory.u64(tree + 24, "the offset of the root")?)
        .ok_or_else(|| Error::invalid("the root lies outside the grid").hint(DAMAGED))?;
    let background =
        memory.slice(root.saturating_add(kind.root_background() as u64), kind.value().0, "the background")?;
    let claimed = memory.u32(tree + layout::TREE_LEAVES, "the number of leaves")? as usize;
    let taken = memory.0.len();
    let leaves = claimed.min(taken / (kind.leaf_values() + kind.leaf_value_bytes(0)));
    let collector = Collector::new(kind, background, limits, taken as u64, leaves)?;
    let mut walk = Walk { memory, kind, walked: 0, collector };
    walk.root(root)?;
    let tree = walk.collector.finish();
    let texts = texts::read(memory, &KEPT).unwrap_or_else(|e| {
        notes.push(format!("what is stated beside the grid cannot be read, be it its up axis: {}", e.what()));
        BTreeMap::new()
    });
    Ok(Volume { name: name.to_owned(), class, transform, kind, tree, texts, notes })
}

fn transform(memory: Bytes) -> Result<Affine> {
    let at = |offset: u64, i: u64| memory.f64(layout::GRID_MAP + offset + 8 * i, "the transform");
    let mut rows = [0.0; 9];
    for (i, entry) in rows.iter_mut().enumerate() {
        *entry = at(layout::MAP_MATRIX, i as u64)?;
    }
    let translation = |i| at(layout::MAP_TRANSLATION, i);
    let translation = DVec3::new(translation(0)?, translation(1)?, translation(2)?);
    Affine::new(DMat4::from_mat3_translation(DMat3::from_cols_array(&rows).transpose(), translation))
}

/// True if the checksum of the header is absent or right. It covers the grid's header and the tree's, and up to version
/// 32.6.0 the root and its tiles too, from the version on.
fn checksum_agrees(memory: Bytes, kind: Kind) -> Result<bool> {
    let stated = memory.u32(8, "the checksum")?;
    if stated == u32::MAX {
        return Ok(true);
    }
    let version = memory.u32(layout::GRID_VERSION, "the version")?;
    let mut end = layout::GRID + layout::TREE;
    if (version >> 10 & 0x7ff, version & 0x3ff) <= (6, 0) {
        let tiles = memory.u32((end + layout::ROOT_TABLE_SIZE) as u64, "the number of tiles")? as usize;
        end = end.saturating_add(kind.root()).saturating_add(tiles.saturating_mul(kind.root_tile()));
    }
    let from = layout::GRID_VERSION as usize;
    let covered = memory.slice(from as u64, end.saturating_sub(from), "the root")?;
    Ok(libdeflater::crc32(covered) == stated)
}

struct Walk<'a> {
    memory: Bytes<'a>,
    kind: Kind,
    /// Bytes of the nodes that were met. A tree whose nodes are shared or lie over each other has more than its memory.
    walked: u64,
    collector: Collector,
}

impl<'a> Walk<'a> {
    /// Bytes of a node that was met.
    fn take(&mut self, at: u64, length: usize, what: &str) -> Result<&'a [u8]> {
        let bytes = self.memory.slice(at, length, what)?;
        self.walked += length as u64;
        if self.walked > self.memory.0.len() as u64 {
            return Err(Error::invalid("several entries of the tree lead to one node").hint(DAMAGED));
        }
        Ok(bytes)
    }

    fn root(&mut self, root: u64) -> Result<()> {
        let count = self.memory.u32(root + layout::ROOT_TABLE_SIZE as u64, "the number of tiles")?;
        let tiles = root + self.kind.root() as u64;
        let mut keys = HashSet::new();
        for i in 0..u64::from(count) {
            let tile = tiles + i * self.kind.root_tile() as u64;
            let key = self.memory.u64(tile, "a tile of the root")?;
            if !keys.insert(key) {
                return Err(Error::invalid("two tiles of the root have one place").hint(DAMAGED));
            }
            // 21 bits for each of x, y and z, of index coordinates divided by 4096; the upper bits are lost.
            let origin = [42, 21, 0].map(|shift| ((key >> shift & 0x1f_ffff) as u32).wrapping_shl(12) as i32);
            let child = self.memory.i64(tile + 8, "a tile of the root")?;
            if child == 0 {
                let active = self.memory.u32(tile + 16, "a tile of the root")? != 0;
                let value = tile + self.kind.root_tile_value() as u64;
                let value = self.memory.slice(value, self.kind.value().0, "a tile of the root")?;
                self.collector.tile(origin, 4096, value, active)?;
            } else {
                self.node(child_of(root, child)?, origin, UPPER)?;
            }
        }
        Ok(())
    }

    fn node(&mut self, node: u64, origin: [i32; 3], level: Level) -> Result<()> {
        let bytes = self.take(node, level.node(self.kind), "a node")?;
        let masks = &bytes[NODE_MASKS..];
        let set = |mask: usize, i: usize| masks[mask * level.mask() + i / 8] >> (i % 8) & 1 == 1;
        let table = &bytes[level.table(self.kind)..];
        let entry = self.kind.entry();
        for i in 0..level.entries() {
            let value = &table[i * entry..(i + 1) * entry];
            let offset = level.offset(i);
            let place: [i32; 3] = std::array::from_fn(|a| origin[a].wrapping_add(offset[a]));
            if !set(1, i) {
                self.collector.tile(place, 1 << level.child_log2, &value[..self.kind.value().0], set(0, i))?;
                continue;
            }
            let mut offset = [0; 8];
            offset.copy_from_slice(&value[..8]);
            let child = child_of(node, i64::from_le_bytes(offset))?;
            if level.log2 == UPPER.log2 {
                self.node(child, place, LOWER)?;
            } else {
                self.leaf(child, place)?;
            }
        }
        Ok(())
    }

    fn leaf(&mut self, leaf: u64, origin: [i32; 3]) -> Result<()> {
        let head = self.take(leaf, self.kind.leaf_values(), "a leaf")?;
        // The three upper bits of the flags are the width of FpN's values.
        let width = head[15] >> 5;
        if self.kind == Kind::FpN && width > 4 {
            return Err(Error::invalid(format!("a leaf of values of 2^{width} bits, at most 16 bits are expected"))
                .hint(DAMAGED));
        }
        let count = self.kind.leaf_value_bytes(1 << width.min(4));
        let values = self.take(leaf + self.kind.leaf_values() as u64, count, "the values of a leaf")?;
        self.collector.leaf(origin, head, values)
    }
}

/// Address of a child, whose offset counts from its parent.
fn child_of(parent: u64, offset: i64) -> Result<u64> {
    parent.checked_add_signed(offset).ok_or_else(|| Error::invalid("a node lies outside the grid").hint(DAMAGED))
}
