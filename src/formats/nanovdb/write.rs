//! Writing of grids: the nodes of each level in a row, as NanoVDB's own converter lays them out.

use super::layout::{self, ALIGNMENT, GRID, Kind, LEAF_MASK, LOWER, Level, NODE_MASKS, ROOT_TABLE_SIZE, TREE, UPPER};
use super::statistics::Statistics;
use super::volume::{Tree, Volume};
use crate::error::{Error, Result};
use crate::formats::atomic;
use crate::formats::limits::Limits;
use crate::scene::grid::{GridClass, LEAF_VOXELS};
use glam::{DMat3, DVec3};
use std::collections::BTreeMap;
use std::path::Path;

/// Version that is written, of OpenVDB 10: all later ones read it.
const VERSION: u32 = 32 << 21 | 4 << 10 | 2;
/// Flags of a grid: boxes, extremes, averages and deviations of nodes are there, and nodes are in breadth-first order.
const FLAGS: u32 = 0b11_1110;
/// Flag of a grid whose name has 256 bytes or more.
const LONG_NAME: u32 = 1;
/// Checksum of what has none.
const NO_CHECKSUM: u32 = u32::MAX;
/// Largest difference of a cube's edges, relative to them.
const CUBE: f64 = 1e-6;

/// A value of a tree.
trait Value: Copy + PartialEq {
    const KIND: Kind;
    fn put(self, into: &mut [u8]);
    /// Value of a scalar, length of a vector.
    fn measure(self) -> f64;
}

impl Value for f32 {
    const KIND: Kind = Kind::Float;
    fn put(self, into: &mut [u8]) {
        into[..4].copy_from_slice(&self.to_le_bytes());
    }
    fn measure(self) -> f64 {
        self.into()
    }
}

impl Value for i32 {
    const KIND: Kind = Kind::Int32;
    fn put(self, into: &mut [u8]) {
        into[..4].copy_from_slice(&self.to_le_bytes());
    }
    fn measure(self) -> f64 {
        self.into()
    }
}

impl Value for [f32; 3] {
    const KIND: Kind = Kind::Vec3f;
    fn put(self, into: &mut [u8]) {
        self.iter().zip(into.chunks_exact_mut(4)).for_each(|(v, to)| to.copy_from_slice(&v.to_le_bytes()));
    }
    fn measure(self) -> f64 {
        self.map(|v| f64::from(v) * f64::from(v)).iter().sum::<f64>().sqrt()
    }
}

/// A leaf with its values in order of their offsets.
struct LeafRef<'a, V> {
    origin: [i32; 3],
    active: &'a [u64; 8],
    value: Box<dyn Fn(usize) -> V + 'a>,
}

/// A constant block.
#[derive(Clone, Copy)]
struct TileRef<V> {
    origin: [i32; 3],
    dim: i32,
    value: V,
    active: bool,
}

/// Entry of an internal node or of the root, by its number: a child, or a tile.
enum Slot<V> {
    Child(usize),
    Tile(V, bool),
}

/// An internal node, or the root, whose entries are numbered by key.
struct Node<V> {
    origin: [i32; 3],
    slots: BTreeMap<u64, Slot<V>>,
}

/// A tree as nodes of each level, in the order in which they are written.
struct Nodes<'a, V> {
    background: V,
    root: Node<V>,
    upper: Vec<Node<V>>,
    lower: Vec<Node<V>>,
    leaves: Vec<LeafRef<'a, V>>,
}

/// Sign bits of the three parts of a root's key. With these flipped, keys are in ascending order of coordinates.
const SIGNS: u64 = 1 << 61 | 1 << 40 | 1 << 19;

/// Key of the root's tile at index coordinates, which are multiples of 4096: a part of x, y and z
/// each, with signs flipped.
fn key([x, y, z]: [i32; 3]) -> u64 {
    let part = |c: i32| u64::from(c.cast_unsigned() >> 12);
    (part(x) << 42 | part(y) << 21 | part(z)) ^ SIGNS
}

fn floor(origin: [i32; 3], dim: i32) -> [i32; 3] {
    origin.map(|c| c & -dim)
}

impl<'a, V: Value> Nodes<'a, V> {
    /// Arranges leaves and tiles in a tree.
    ///
    /// # Errors
    /// If two of them claim one place, or a tile's edge is not 8, 128 or 4096.
    fn new(background: V, mut leaves: Vec<LeafRef<'a, V>>, tiles: &[TileRef<V>]) -> Result<Self> {
        let clash = |origin: [i32; 3]| {
            Error::invalid(format!("two parts of the tree claim the voxels from {origin:?} on"))
                .hint("write the grid again where it was made")
        };
        // Places of leaves and tiles, ordered as their nodes are.
        let path = |o: [i32; 3]| (key(floor(o, 4096)), UPPER.entry_at(o), LOWER.entry_at(o));
        leaves.sort_by_key(|leaf| path(leaf.origin));
        let mut tiles = tiles.to_vec();
        tiles.sort_by_key(|tile| path(tile.origin));
        let mut of = Self {
            background,
            root: Node { origin: [0; 3], slots: BTreeMap::new() },
            upper: Vec::new(),
            lower: Vec::new(),
            leaves: Vec::new(),
        };
        // Nodes are made in ascending order of place, so that each level is in the order of its parents' entries.
        let small = tiles.iter().filter(|t| t.dim < 4096).map(|t| (t.origin, t.dim));
        let mut places: Vec<([i32; 3], i32)> = leaves.iter().map(|l| (l.origin, 8)).chain(small).collect();
        places.sort_by_key(|(origin, _)| path(*origin));
        for (origin, dim) in places {
            of.make_nodes(origin, dim);
        }
        for tile in tiles {
            let slots = match tile.dim {
                8 => of.lower_at(tile.origin).map(|n| (&mut of.lower[n].slots, LOWER.entry_at(tile.origin) as u64)),
                128 => of.upper_at(tile.origin).map(|n| (&mut of.upper[n].slots, UPPER.entry_at(tile.origin) as u64)),
                4096 => Some((&mut of.root.slots, key(tile.origin))),
                other => return Err(Error::invalid(format!("a tile of {other} voxels' edge; 8, 128 or 4096 fit a tree"))),
            };
            let (slots, entry) = slots.ok_or_else(|| clash(tile.origin))?;
            if slots.insert(entry, Slot::Tile(tile.value, tile.active)).is_some() {
                return Err(clash(tile.origin));
            }
        }
        for leaf in leaves {
            let node = of.lower_at(leaf.origin).ok_or_else(|| clash(leaf.origin))?;
            let entry = LOWER.entry_at(leaf.origin) as u64;
            if of.lower[node].slots.insert(entry, Slot::Child(of.leaves.len())).is_some() {
                return Err(clash(leaf.origin));
            }
            of.leaves.push(leaf);
        }
        Ok(of)
    }

    fn upper_at(&self, origin: [i32; 3]) -> Option<usize> {
        match self.root.slots.get(&key(floor(origin, 4096))) {
            Some(Slot::Child(n)) => Some(*n),
            _ => None,
        }
    }

    fn lower_at(&self, origin: [i32; 3]) -> Option<usize> {
        match self.upper[self.upper_at(origin)?].slots.get(&(UPPER.entry_at(origin) as u64)) {
            Some(Slot::Child(n)) => Some(*n),
            _ => None,
        }
    }

    /// Makes the nodes on the way to a leaf or tile.
    fn make_nodes(&mut self, origin: [i32; 3], dim: i32) {
        let count = self.upper.len();
        let slot = self.root.slots.entry(key(floor(origin, 4096)));
        let Slot::Child(upper) = slot.or_insert(Slot::Child(count)) else { return };
        let upper = *upper;
        if upper == count {
            self.upper.push(Node { origin: floor(origin, 4096), slots: BTreeMap::new() });
        }
        if dim == 128 {
            return;
        }
        let count = self.lower.len();
        let slot = self.upper[upper].slots.entry(UPPER.entry_at(origin) as u64);
        if let Slot::Child(lower) = slot.or_insert(Slot::Child(count))
            && *lower == count
        {
            self.lower.push(Node { origin: floor(origin, 128), slots: BTreeMap::new() });
        }
    }

    /// Bytes of the parts: the grid's and the tree's header, the root with its tiles, upper and lower nodes, leaves.
    fn sizes(&self) -> [usize; 5] {
        let kind = V::KIND;
        [
            GRID + TREE,
            kind.root() + self.root.slots.len() * kind.root_tile(),
            self.upper.len() * UPPER.node(kind),
            self.lower.len() * LOWER.node(kind),
            self.leaves.len() * (kind.leaf_values() + kind.leaf_value_bytes(0)),
        ]
    }
}

/// Memory of a grid that is being laid out.
struct Memory(Vec<u8>);

impl Memory {
    fn put<const N: usize>(&mut self, at: usize, bytes: [u8; N]) {
        self.0[at..at + N].copy_from_slice(&bytes);
    }
    fn u32(&mut self, at: usize, value: u32) {
        self.put(at, value.to_le_bytes());
    }
    fn u64(&mut self, at: usize, value: u64) {
        self.put(at, value.to_le_bytes());
    }
    fn f64s(&mut self, at: usize, values: &[f64]) {
        values.iter().enumerate().for_each(|(i, v)| self.put(at + 8 * i, v.to_le_bytes()));
    }
    fn coordinates(&mut self, at: usize, values: [i32; 3]) {
        values.iter().enumerate().for_each(|(i, v)| self.put(at + 4 * i, v.to_le_bytes()));
    }
    fn bounds(&mut self, at: usize, bounds: Option<([i32; 3], [i32; 3])>, empty: [i32; 3]) {
        let (low, high) = bounds.unwrap_or((empty, empty));
        self.coordinates(at, low);
        self.coordinates(at + 12, high);
    }
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
struct Encoded {
    memory: Vec<u8>,
    kind: Kind,
    voxels: u64,
    bounds: Option<([i32; 3], [i32; 3])>,
    nodes: [u32; 3],
    tiles: [u32; 3],
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

    fn encode(&self, volume: &Volume, limits: Limits) -> Result<Encoded> {
        let kind = V::KIND;
        let sizes = self.sizes();
        let total = sizes.iter().sum::<usize>();
        if total as u64 > limits.max_memory {
            let what = format!("the grid's memory takes {total} bytes, {} are allowed", limits.max_memory);
            return Err(Error::unsupported(what).hint("raise --max-memory, or crop or resample the grid first"));
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
fn world_box(volume: &Volume, bounds: Option<([i32; 3], [i32; 3])>) -> [f64; 6] {
    let Some((low, high)) = bounds else { return [0.0; 6] };
    let corner = |c: [i32; 3], more: f64| DVec3::from_array(c.map(f64::from)) + more;
    let index = crate::math::Aabb { min: corner(low, 0.0), max: corner(high, 1.0) };
    let world = volume.transform.box_to_world(index);
    [world.min.x, world.min.y, world.min.z, world.max.x, world.max.y, world.max.z]
}

fn class(class: GridClass) -> u32 {
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

fn encoded(volume: &Volume, limits: Limits) -> Result<Encoded> {
    match &volume.tree {
        Tree::Scalars { background, leaves, tiles } => {
            let leaves = leaves.iter().map(|l| LeafRef {
                origin: l.origin,
                active: &l.active,
                value: Box::new(|i| l.values[i]),
            });
            let tiles: Vec<_> = tiles
                .iter()
                .map(|t| TileRef { origin: t.origin, dim: t.dim, value: t.value, active: t.active })
                .collect();
            Nodes::new(*background, leaves.collect(), &tiles)?.encode(volume, limits)
        }
        Tree::Vectors { background, leaves, tiles } => {
            if let Some(leaf) = leaves.iter().find(|l| l.values.len() != 3 * LEAF_VOXELS) {
                return Err(Error::invalid(format!("a leaf of {} numbers; 1536 are expected", leaf.values.len())));
            }
            let leaves = leaves.iter().map(|l| LeafRef {
                origin: l.origin,
                active: &l.active,
                value: Box::new(|i| std::array::from_fn(|c| l.values[3 * i + c])),
            });
            let tiles: Vec<_> = tiles
                .iter()
                .map(|t| TileRef { origin: t.origin, dim: t.dim, value: t.value, active: t.active })
                .collect();
            Nodes::new(*background, leaves.collect(), &tiles)?.encode(volume, limits)
        }
        Tree::Integers { background, leaves, tiles } => {
            let leaves = leaves.iter().map(|l| LeafRef {
                origin: l.origin,
                active: &l.active,
                value: Box::new(|i| l.values[i]),
            });
            let tiles: Vec<_> = tiles
                .iter()
                .map(|t| TileRef { origin: t.origin, dim: t.dim, value: t.value, active: t.active })
                .collect();
            Nodes::new(*background, leaves.collect(), &tiles)?.encode(volume, limits)
        }
    }
}

/// Hash by which NanoVDB finds a grid of a name.
fn name_key(name: &str) -> u64 {
    name.bytes().fold(0_u64, |hash, byte| {
        let overflow = hash >> 56;
        hash.wrapping_mul(67).wrapping_add(u64::from(byte) + overflow)
    })
}

/// Entry of the file's directory.
fn metadata(volume: &Volume, encoded: &Encoded) -> Vec<u8> {
    let mut entry = Memory(vec![0; 176]);
    let size = encoded.memory.len() as u64;
    [size, size, name_key(&volume.name), encoded.voxels].iter().enumerate().for_each(|(i, v)| entry.u64(8 * i, *v));
    entry.u32(32, encoded.kind as u32);
    entry.u32(36, class(volume.class));
    entry.f64s(40, &world_box(volume, encoded.bounds));
    let empty = Some(([i32::MAX; 3], [i32::MIN; 3]));
    entry.bounds(88, encoded.bounds.or(empty), [0; 3]);
    entry.f64s(112, &volume.transform.voxel_size().to_array());
    entry.u32(136, volume.name.len() as u32 + 1);
    let nodes = encoded.nodes.iter().chain(&[1]).chain(&encoded.tiles);
    nodes.enumerate().for_each(|(i, n)| entry.u32(140 + 4 * i, *n));
    entry.u32(172, VERSION);
    entry.0.extend(volume.name.as_bytes());
    entry.0.push(0);
    entry.0
}

/// Lays out a file of one segment, not compressed.
///
/// # Errors
/// If there are no grids or more than 65535, two parts of a tree claim one place, or the memory of a grid exceeds the
/// limits.
pub fn encode(volumes: &[Volume], limits: Limits) -> Result<Vec<Vec<u8>>> {
    let count = u16::try_from(volumes.len()).ok().filter(|n| *n > 0).ok_or_else(|| {
        Error::invalid(format!("{} grids; a segment has 1 to 65535", volumes.len())).hint("choose some with --grid")
    })?;
    let mut head = b"NanoVDB0".to_vec();
    head.extend(VERSION.to_le_bytes());
    head.extend(count.to_le_bytes());
    head.extend([0; 2]);
    let mut parts = vec![Vec::new()];
    let mut held = 0;
    for volume in volumes {
        let left = Limits { max_memory: limits.max_memory.saturating_sub(held) };
        let encoded = encoded(volume, left).map_err(|e| e.part(format!("grid '{}'", volume.name)))?;
        head.extend(metadata(volume, &encoded));
        held += encoded.memory.len() as u64;
        parts.push(encoded.memory);
    }
    parts[0] = head;
    Ok(parts)
}

/// Writes grids to a file, whole or not at all, and returns what a user should know, one sentence each.
///
/// # Errors
/// If [`encode`] fails, or the operating system reports an error.
pub fn write(path: &Path, volumes: &[Volume], limits: Limits) -> Result<Vec<String>> {
    let parts = encode(volumes, limits).map_err(|e| e.at(path))?;
    atomic::write(path, |draft| parts.iter().try_for_each(|part| draft.write(part)))?;
    let oblong = volumes.iter().filter(|v| {
        let size = v.transform.voxel_size();
        size.max_element() - size.min_element() > CUBE * size.max_element()
    });
    Ok(oblong
        .map(|v| format!("grid '{}' has voxels that are no cubes, which some programs take for cubes", v.name))
        .collect())
}
