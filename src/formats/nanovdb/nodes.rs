//! A tree as it is written: nodes of each level in a row.

use super::layout::{GRID, Kind, LOWER, TREE, UPPER};
use super::volume::{IntegerLeaf, IntegerTile};
use crate::error::{Error, Result};
use crate::formats::vdb::{RawLeaf, RawTile};
use crate::scene::grid::{Leaf, Tile};
use std::collections::BTreeMap;

/// A value of a tree.
pub(super) trait Value: Copy + PartialEq {
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
pub(super) struct LeafRef<'a, V> {
    pub origin: [i32; 3],
    pub active: &'a [u64; 8],
    pub value: Box<dyn Fn(usize) -> V + 'a>,
}

impl<'a> From<&'a Leaf> for LeafRef<'a, f32> {
    fn from(leaf: &'a Leaf) -> Self {
        Self { origin: leaf.origin, active: &leaf.active, value: Box::new(|i| leaf.values[i]) }
    }
}

impl<'a> From<&'a IntegerLeaf> for LeafRef<'a, i32> {
    fn from(leaf: &'a IntegerLeaf) -> Self {
        Self { origin: leaf.origin, active: &leaf.active, value: Box::new(|i| leaf.values[i]) }
    }
}

impl<'a> From<&'a RawLeaf> for LeafRef<'a, [f32; 3]> {
    fn from(leaf: &'a RawLeaf) -> Self {
        let value = |i| std::array::from_fn(|c| leaf.values[3 * i + c]);
        Self { origin: leaf.origin, active: &leaf.active, value: Box::new(value) }
    }
}

impl From<&Tile> for TileRef<f32> {
    fn from(tile: &Tile) -> Self {
        Self { origin: tile.origin, dim: tile.dim, value: tile.value, active: tile.active }
    }
}

impl From<&IntegerTile> for TileRef<i32> {
    fn from(tile: &IntegerTile) -> Self {
        Self { origin: tile.origin, dim: tile.dim, value: tile.value, active: tile.active }
    }
}

impl From<&RawTile> for TileRef<[f32; 3]> {
    fn from(tile: &RawTile) -> Self {
        Self { origin: tile.origin, dim: tile.dim, value: tile.value, active: tile.active }
    }
}

/// A constant block.
#[derive(Clone, Copy)]
pub(super) struct TileRef<V> {
    pub origin: [i32; 3],
    pub dim: i32,
    pub value: V,
    pub active: bool,
}

/// Entry of an internal node or of the root, by its number: a child, or a tile.
pub(super) enum Slot<V> {
    Child(usize),
    Tile(V, bool),
}

/// An internal node, or the root, whose entries are numbered by key.
pub(super) struct Node<V> {
    pub origin: [i32; 3],
    pub slots: BTreeMap<u64, Slot<V>>,
}

/// A tree as nodes of each level, in the order in which they are written.
pub(super) struct Nodes<'a, V> {
    pub background: V,
    pub root: Node<V>,
    pub upper: Vec<Node<V>>,
    pub lower: Vec<Node<V>>,
    pub leaves: Vec<LeafRef<'a, V>>,
}

/// Sign bits of the three parts of a root's key. With these flipped, keys are in ascending order of coordinates.
pub(super) const SIGNS: u64 = 1 << 61 | 1 << 40 | 1 << 19;

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
    pub(crate) fn new(background: V, mut leaves: Vec<LeafRef<'a, V>>, tiles: &[TileRef<V>]) -> Result<Self> {
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
                other => {
                    return Err(Error::invalid(format!("a tile of {other} voxels' edge; 8, 128 or 4096 fit a tree")));
                }
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
    pub(crate) fn sizes(&self) -> [usize; 5] {
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
