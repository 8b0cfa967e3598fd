//! The memory of a grid, laid out as NanoVDB's own converter does.

use super::layout::{self, ALIGNMENT, GRID, Kind, LEAF_MASK, LOWER, Level, NODE_MASKS, ROOT_TABLE_SIZE, UPPER};
use super::memory::Memory;
use super::nodes::{LeafRef, Node, Nodes, SIGNS, Slot, Value};
use super::statistics::Statistics;
use super::texts;
use super::volume::Volume;
use crate::error::{Code, Error, Result};
use crate::formats::limits::Limits;
use crate::math::Aabb;
use crate::scene::grid::{GridClass, LEAF_VOXELS};
use glam::{DMat3, DVec3};

/// Version that is written, of OpenVDB 10: all later ones read it.
pub(super) const VERSION: u32 = 32 << 21 | 4 << 10 | 2;
/// Flags of a grid: boxes, extremes, averages and deviations of nodes are there, and nodes are in breadth-first order.
const FLAGS: u32 = 0b11_1110;
/// Flag of a grid whose name has 256 bytes or more.
const LONG_NAME: u32 = 1;
/// Checksum of what has none.
const NO_CHECKSUM: u32 = u32::MAX;
impl Memory {
    fn statistics<V: Value>(&mut self, node: usize, at: usize, statistics: &Statistics<V>, empty: V) {
        let [low, high] = statistics.extremes(empty);
        let [minimum, maximum, average, deviation] = V::KIND.statistics(at);
        low.put(&mut self.0[node + minimum..]);
        high.put(&mut self.0[node + maximum..]);
        let [mean, spread] = statistics.moments();
        self.put(node + average, (mean as f32).to_le_bytes());
        self.put(node + deviation, (spread as f32).to_le_bytes());
    }
}

/// A grid's memory and what the file's directory says of it.
pub(super) struct Encoded {
    pub memory: Vec<u8>,
    pub kind: Kind,
    pub voxels: u64,
    pub bounds: Option<([i32; 3], [i32; 3])>,
    pub nodes: [u32; 3],
    pub tiles: [u32; 3],
}

impl<V: Value> Nodes<'_, V> {
    fn leaf(&self, memory: &mut Memory, at: usize, leaf: &LeafRef<'_, V>) -> Statistics<V> {
        let mut statistics = Statistics::new();
        let values = at + V::KIND.leaf_values();
        let size = V::KIND.value().0;
        for i in 0..LEAF_VOXELS {
            let value = (leaf.value)(i);
            value.put(&mut memory.0[values + i * size..]);
            if leaf.active[i >> 6] >> (i & 63) & 1 == 1 {
                statistics.add(value, value.measure(), 1.0);
                let [x, y, z] = leaf.origin;
                let voxel = [x + (i >> 6) as i32, y + (i >> 3 & 7) as i32, z + (i & 7) as i32];
                statistics.include(voxel, voxel);
            }
        }
        let (low, high) = statistics.bounds.unwrap_or((leaf.origin, leaf.origin));
        memory.coordinates(at, low);
        for a in 0..3 {
            memory.0[at + 12 + a] = (high[a] - low[a]) as u8;
        }
        // Bit 1 says that there is a box.
        memory.0[at + 15] = u8::from(statistics.bounds.is_some()) << 1;
        for (word, bits) in leaf.active.iter().enumerate() {
            memory.u64(at + LEAF_MASK + 8 * word, *bits);
        }
        memory.statistics(at, layout::LEAF_STATISTICS, &statistics, self.background);
        statistics
    }

    /// Writes an internal node, whose children are at `child`, and returns the statistics of all below.
    fn node(
        &self,
        memory: &mut Memory,
        (at, level): (usize, Level),
        node: &Node<V>,
        child: impl Fn(usize) -> usize,
        below: &[Statistics<V>],
    ) -> Statistics<V> {
        let (table, entry) = (at + level.table(V::KIND), V::KIND.entry());
        for i in 0..level.entries() {
            self.background.put(&mut memory.0[table + i * entry..]);
        }
        let mut statistics = Statistics::new();
        let edge = 1 << level.child_log2;
        for (i, slot) in &node.slots {
            let i = *i as usize;
            let bit = 1 << (i % 8);
            match slot {
                Slot::Child(n) => {
                    memory.0[at + NODE_MASKS + level.mask() + i / 8] |= bit;
                    memory.0[table + i * entry..table + (i + 1) * entry].fill(0);
                    memory.u64(table + i * entry, (child(*n) - at) as u64);
                    statistics.merge(&below[*n]);
                }
                Slot::Tile(value, active) => {
                    value.put(&mut memory.0[table + i * entry..]);
                    if *active {
                        memory.0[at + NODE_MASKS + i / 8] |= bit;
                        statistics.add(*value, value.measure(), f64::from(edge).powi(3));
                        let low: [i32; 3] = std::array::from_fn(|a| node.origin[a] + level.offset(i)[a]);
                        statistics.include(low, low.map(|c| c + (edge - 1)));
                    }
                }
            }
        }
        memory.bounds(at, statistics.bounds, node.origin);
        // Bit 1 says that there is a box, bit 0 that there is nothing to render.
        memory.u64(at + 24, if statistics.bounds.is_some() { 2 } else { 1 });
        memory.statistics(at, level.statistics(), &statistics, self.background);
        statistics
    }

    fn root(&self, memory: &mut Memory, at: usize, upper: usize, below: &[Statistics<V>]) -> Statistics<V> {
        let kind = V::KIND;
        let mut statistics = Statistics::new();
        for (i, (key, slot)) in self.root.slots.iter().enumerate() {
            let tile = at + kind.root() + i * kind.root_tile();
            let key = *key ^ SIGNS;
            memory.u64(tile, key);
            match slot {
                Slot::Child(n) => {
                    memory.u64(tile + 8, (upper + n * UPPER.node(kind) - at) as u64);
                    statistics.merge(&below[*n]);
                }
                Slot::Tile(value, active) => {
                    memory.u32(tile + 16, u32::from(*active));
                    value.put(&mut memory.0[tile + kind.root_tile_value()..]);
                    if *active {
                        statistics.add(*value, value.measure(), 4096_f64.powi(3));
                        let low = [42, 21, 0].map(|shift| ((key >> shift & 0x1f_ffff) as u32).wrapping_shl(12) as i32);
                        statistics.include(low, low.map(|c| c.saturating_add(4095)));
                    }
                }
            }
        }
        match statistics.bounds {
            Some(bounds) => memory.bounds(at, Some(bounds), [0; 3]),
            None => memory.bounds(at, Some(([i32::MAX; 3], [i32::MIN; 3])), [0; 3]),
        }
        memory.u32(at + ROOT_TABLE_SIZE, self.root.slots.len() as u32);
        self.background.put(&mut memory.0[at + kind.root_background()..]);
        let after = kind.root_background() + kind.value().0;
        memory.statistics(at, after, &statistics, self.background);
        statistics
    }

    /// Number of active tiles of the lower nodes, the upper nodes and the root.
    fn tiles(&self) -> [u32; 3] {
        let count = |nodes: &[Node<V>]| {
            let slots = nodes.iter().flat_map(|n| n.slots.values());
            slots.filter(|s| matches!(s, Slot::Tile(_, true))).count() as u32
        };
        [count(&self.lower), count(&self.upper), count(std::slice::from_ref(&self.root))]
    }

    /// Lays out the memory of a grid.
    ///
    /// # Errors
    /// If it exceeds the limits.
    pub(super) fn encode(&self, volume: &Volume, limits: Limits) -> Result<Encoded> {
        let kind = V::KIND;
        let sizes = self.sizes();
        let tree = sizes.iter().sum::<usize>();
        let total = tree + texts::size(volume);
        if total as u64 > limits.max_memory {
            let what = format!("the grid's memory takes {total} bytes, {} are allowed", limits.max_memory);
            return Err(Error::unsupported(what)
                .coded(Code::MemoryLimit)
                .hint("raise ⟨max_memory⟩, or crop or resample the grid first"));
        }
        let mut memory = Memory(vec![0; total]);
        let root = sizes[0];
        let upper = root + sizes[1];
        let lower = upper + sizes[2];
        let leaves = lower + sizes[3];
        let leaf_size = kind.leaf_values() + kind.leaf_value_bytes(0);
        let leaf_at = |n: usize| leaves + n * leaf_size;
        let lower_at = |n: usize| lower + n * LOWER.node(kind);
        let below: Vec<_> =
            self.leaves.iter().enumerate().map(|(n, leaf)| self.leaf(&mut memory, leaf_at(n), leaf)).collect();
        let node = |(n, node)| self.node(&mut memory, (lower_at(n), LOWER), node, leaf_at, &below);
        let below: Vec<_> = self.lower.iter().enumerate().map(node).collect();
        let node = |(n, node)| self.node(&mut memory, (upper + n * UPPER.node(kind), UPPER), node, lower_at, &below);
        let below: Vec<_> = self.upper.iter().enumerate().map(node).collect();
        let bounds = self.root(&mut memory, root, upper, &below).bounds;
        let nodes = [self.leaves.len(), self.lower.len(), self.upper.len()].map(|n| n as u32);
        let tiles = self.tiles();
        let voxels = self.leaves.iter().flat_map(|l| l.active).map(|w| u64::from(w.count_ones())).sum::<u64>()
            + tiles.iter().zip([8_u64, 128, 4096]).map(|(n, edge)| u64::from(*n) * edge.pow(3)).sum::<u64>();
        let first = [leaves, lower, upper].into_iter().zip(nodes);
        for (i, (at, count)) in first.enumerate() {
            // A level without nodes has no first one.
            memory.u64(GRID + 8 * i, if count > 0 { (at - GRID) as u64 } else { 0 });
            memory.u32(GRID + 32 + 4 * i, count);
            memory.u32(GRID + 44 + 4 * i, tiles[i]);
        }
        memory.u64(GRID + 24, (root - GRID) as u64);
        memory.u64(GRID + layout::TREE_VOXELS as usize, voxels);
        header(&mut memory, volume, kind, bounds);
        texts::write(&mut memory, tree, volume);
        // The checksum covers the headers, the root and its tiles, from the version on.
        let from = layout::GRID_VERSION as usize;
        let checksum = libdeflater::crc32(&memory.0[from..upper]);
        memory.u32(8, checksum);
        memory.u32(12, NO_CHECKSUM);
        debug_assert!(total.is_multiple_of(ALIGNMENT));
        Ok(Encoded { memory: memory.0, kind, voxels, bounds, nodes, tiles })
    }
}

/// World-space box of the voxels' cells, each from its index coordinates to the next ones, as NanoVDB takes them.
pub(super) fn world_box(volume: &Volume, bounds: Option<([i32; 3], [i32; 3])>) -> [f64; 6] {
    let Some((low, high)) = bounds else { return [0.0; 6] };
    let corner = |c: [i32; 3], more: f64| DVec3::from_array(c.map(f64::from)) + more;
    let index = Aabb { min: corner(low, 0.0), max: corner(high, 1.0) };
    let world = volume.transform.box_to_world(index);
    [world.min.x, world.min.y, world.min.z, world.max.x, world.max.y, world.max.z]
}

/// NanoVDB's number of a class.
pub(super) fn class(class: GridClass) -> u32 {
    match class {
        GridClass::Unknown => 0,
        GridClass::LevelSet => 1,
        GridClass::FogVolume => 2,
        GridClass::Staggered => 3,
    }
}

/// Writes the header of a grid but for its checksum.
fn header(memory: &mut Memory, volume: &Volume, kind: Kind, bounds: Option<([i32; 3], [i32; 3])>) {
    memory.put(0, *b"NanoVDB0");
    memory.u32(layout::GRID_VERSION as usize, VERSION);
    let name = volume.name.as_bytes();
    let long = if name.len() >= layout::GRID_NAME_BYTES { LONG_NAME } else { 0 };
    memory.u32(20, if bounds.is_some() { FLAGS } else { FLAGS & !2 } | long);
    memory.u32(28, 1);
    let total = memory.0.len() as u64;
    memory.u64(layout::GRID_SIZE as usize, total);
    let shown = &name[..name.len().min(layout::GRID_NAME_BYTES - 1)];
    let at = layout::GRID_NAME as usize;
    memory.0[at..at + shown.len()].copy_from_slice(shown);
    let map = layout::GRID_MAP as usize;
    let rows = |m: DMat3| m.transpose().to_cols_array();
    let forward = rows(DMat3::from_mat4(volume.transform.matrix()));
    let inverse = rows(DMat3::from_mat4(volume.transform.inverse_matrix()));
    let translation = volume.transform.matrix().w_axis.truncate().to_array();
    // Single precision first, then double, each with a taper of 1.
    let singles = forward.iter().chain(&inverse).chain(&translation).chain(&[1.0]);
    singles.enumerate().for_each(|(i, v)| memory.put(map + 4 * i, (*v as f32).to_le_bytes()));
    memory.f64s(map + layout::MAP_MATRIX as usize, &forward);
    memory.f64s(map + 160, &inverse);
    memory.f64s(map + layout::MAP_TRANSLATION as usize, &translation);
    memory.f64s(map + 256, &[1.0]);
    memory.f64s(560, &world_box(volume, bounds));
    memory.f64s(608, &volume.transform.voxel_size().to_array());
    memory.u32(layout::GRID_CLASS as usize, class(volume.class));
    memory.u32(layout::GRID_KIND as usize, kind as u32);
}
