//! Walks of a grid's tree in the file without OpenVDB: every length and offset is checked, and leaves, nodes and the
//! memory they will take are counted before the library reads a byte.
//!
//! The layout is that of OpenVDB's `RootNode::readTopology`, `InternalNode::readTopology`, `LeafNode::readBuffers` and
//! `io::readCompressedValues`, file versions 222 to 224.

use super::cursor::Cursor;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;

/// Compression flags of OpenVDB, `io::COMPRESS_*`.
const ZIP: u32 = 1;
const ACTIVE_MASK: u32 = 2;
const BLOSC: u32 = 4;

/// Storage of a leaf's values in the file.
#[derive(Debug, Clone, Copy, PartialEq)]
enum LeafKind {
    /// Value mask, then compressed values.
    Values,
    /// Value mask, origin, and one bit per voxel.
    Bool,
    /// Value mask, which also holds the values, and origin.
    Mask,
    /// Point attributes in several passes; only the topology is walked.
    Opaque,
}

/// Number of leaves that are decoded in one call.
pub(super) const RUN: usize = 128;

/// A value type of a standard tree.
#[derive(Debug, Clone, Copy)]
pub(super) struct ValueType {
    size: u64,
    stored: u64,
    leaf: LeafKind,
    /// Bytes of memory that a leaf occupies, the allocator's share included.
    leaf_bytes: u64,
    /// Bytes of memory that an entry of an internal node's table occupies, including its share of values on the heap.
    entry_bytes: u64,
}

impl ValueType {
    /// Value type of the tree `Tree_<type>_5_4_3`; `None` if this module cannot walk it.
    pub(super) fn of(grid_type: &str, half: bool) -> Option<Self> {
        let name = grid_type.strip_prefix("Tree_")?.strip_suffix("_5_4_3")?;
        let (size, real, leaf) = match name {
            "float" => (4, true, LeafKind::Values),
            "double" => (8, true, LeafKind::Values),
            "int32" => (4, false, LeafKind::Values),
            "int64" => (8, false, LeafKind::Values),
            "vec3s" => (12, true, LeafKind::Values),
            "vec3d" => (24, true, LeafKind::Values),
            "vec3i" => (12, false, LeafKind::Values),
            "bool" => (1, false, LeafKind::Bool),
            "mask" => (1, false, LeafKind::Mask),
            "ptdataidx32" | "ptidx32" => (4, false, LeafKind::Opaque),
            _ => return None,
        };
        // Half values take 2 bytes per component; components are float or double.
        let stored = match name {
            "vec3s" | "vec3d" if half => 6,
            _ if half && real => 2,
            _ => size,
        };
        // Vectors do not fit the node's union of value and pointer and live on the heap.
        let entry_bytes = if size > 8 { 48 } else { 8 };
        let leaf_bytes = match leaf {
            LeafKind::Bool | LeafKind::Mask => 208,
            LeafKind::Values => 512 * size + 160,
            LeafKind::Opaque => 512 * size + 512,
        };
        Some(Self { size, stored, leaf, leaf_bytes, entry_bytes })
    }

    /// True if buffers of this type are walked too, so that nothing in the grid is left unchecked.
    pub(super) fn is_complete(&self) -> bool {
        self.leaf != LeafKind::Opaque
    }
}

/// Size of a tree, counted in the file.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Topology {
    /// Number of leaves of 8³ voxels.
    pub leaves: u64,
    /// Bytes that the tree will take in memory.
    pub memory: u64,
}

/// Walk of one grid's tree in the file.
pub(super) struct Walk<'a> {
    cursor: &'a mut Cursor,
    value: ValueType,
    compression: u32,
    limits: &'a Limits,
    found: Topology,
    /// Origin and number of active voxels of each leaf, in the order of their buffers.
    leaves: Vec<([i32; 3], u16)>,
}

fn ones(mask: &[u8]) -> u64 {
    mask.iter().map(|b| u64::from(b.count_ones())).sum()
}

impl<'a> Walk<'a> {
    pub(super) fn new(cursor: &'a mut Cursor, value: ValueType, compression: u32, limits: &'a Limits) -> Result<Self> {
        if compression & !(ZIP | ACTIVE_MASK | BLOSC) != 0 {
            return Err(cursor.damaged(format_args!("compression flags {compression:#x} are unknown")));
        }
        Ok(Self { cursor, value, compression, limits, found: Topology::default(), leaves: Vec::new() })
    }

    fn charge(&mut self, bytes: u64) -> Result<()> {
        self.found.memory = self.found.memory.saturating_add(bytes);
        if self.found.memory > self.limits.max_memory {
            return Err(self.limits.exceeded(self.found.memory, self.found.leaves).at(self.cursor.path()));
        }
        Ok(())
    }

    /// Walks the tree's topology, from the buffer count to the last leaf's mask, and returns the tree's size.
    pub(super) fn topology(&mut self) -> Result<Topology> {
        let buffers = self.cursor.i32("buffer count")?;
        if buffers != 1 {
            return Err(self.cursor.damaged(format_args!("the tree has {buffers} buffers, 1 expected")));
        }
        self.root_value("background")?;
        let tiles = self.cursor.u32("root tile count")?;
        let children = self.cursor.u32("root child count")?;
        let mut tile_keys = std::collections::BTreeSet::new();
        let mut last = None;
        for _ in 0..tiles {
            let key = self.root_key(&mut last)?;
            self.root_value("root tile")?;
            self.cursor.bool("root tile state")?;
            self.charge(96)?;
            tile_keys.insert(key);
        }
        let mut last = None;
        for _ in 0..children {
            let origin = self.root_key(&mut last)?;
            if tile_keys.contains(&origin) {
                return Err(self.cursor.damaged(format_args!("root entry {origin:?} is both a tile and a child")));
            }
            self.charge(96)?;
            self.internal(origin, 5, 7)?;
        }
        Ok(self.found)
    }

    /// Reads the key of a root entry. Root entries are written from an ordered map, so keys ascend, are unique and
    /// multiples of 4096.
    fn root_key(&mut self, last: &mut Option<[i32; 3]>) -> Result<[i32; 3]> {
        let key = self.cursor.coord("root entry")?;
        if key.iter().any(|c| c & 4095 != 0) || last.is_some_and(|l| l >= key) {
            return Err(self.cursor.damaged(format_args!("root entry {key:?} is out of order or off its lattice")));
        }
        *last = Some(key);
        Ok(key)
    }

    fn root_value(&mut self, what: &str) -> Result<()> {
        if self.value.size == 1 { self.cursor.bool(what).map(drop) } else { self.cursor.skip(self.value.size, what) }
    }

    /// Walks an internal node of `1 << log2` entries along its edge, whose children have edges of `1 << child_total`
    /// voxels.
    fn internal(&mut self, origin: [i32; 3], log2: u32, child_total: u32) -> Result<()> {
        let entries = 1_u64 << (3 * log2);
        let mut masks = vec![0_u8; entries as usize / 4];
        self.cursor.fill(&mut masks, "node masks")?;
        self.charge(entries * self.value.entry_bytes + entries / 4 + 64)?;
        let (children, values) = masks.split_at(entries as usize / 8);
        if children.iter().zip(values).any(|(c, v)| c & v != 0) {
            return Err(self.cursor.damaged("a node's entry is both a child and an active tile"));
        }
        self.compressed(entries, ones(values), "node values")?;
        for n in (0..entries as usize).filter(|n| children[n >> 3] >> (n & 7) & 1 == 1) {
            let n = n as i32;
            let edge = (1 << log2) - 1;
            let local = [n >> (2 * log2), n >> log2 & edge, n & edge];
            let child: [i32; 3] = std::array::from_fn(|a| origin[a].wrapping_add(local[a] << child_total));
            if log2 == 5 {
                self.internal(child, 4, 3)?;
            } else {
                let mut mask = [0; 64];
                self.cursor.fill(&mut mask, "leaf mask")?;
                self.found.leaves += 1;
                self.charge(self.value.leaf_bytes)?;
                self.leaves.push((child, ones(&mask) as u16));
            }
        }
        Ok(())
    }

    /// Skips `count` values, `active` of them active, as `io::readCompressedValues` would read them.
    fn compressed(&mut self, count: u64, active: u64, what: &str) -> Result<()> {
        let size = self.value.size;
        let flag = self.cursor.u8("compression flag")?;
        let (inactive, selection) = match flag {
            0 | 1 | 6 => (0, false),
            2 => (1, false),
            3 => (0, true),
            4 => (1, true),
            5 => (2, true),
            n => return Err(self.cursor.damaged(format_args!("compression flag {n} is above 6"))),
        };
        self.cursor.skip(inactive * size + if selection { count / 8 } else { 0 }, "inactive values")?;
        let stored = if self.compression & ACTIVE_MASK != 0 && flag != 6 { active } else { count };
        if stored == 0 && self.value.stored != size {
            return Ok(()); // half values: not even a length is written
        }
        let bytes = stored * self.value.stored;
        if self.compression & (BLOSC | ZIP) == 0 {
            return self.cursor.skip(bytes, what);
        }
        let length = self.cursor.i64("compressed size")?;
        if length <= 0 {
            // Stored uncompressed. The library reads this many bytes before it compares the sizes.
            if length.unsigned_abs() != bytes {
                return Err(self.cursor.damaged(format_args!("{what}: {length} stored for {bytes} bytes")));
            }
            return self.cursor.skip(bytes, what);
        }
        if self.compression & BLOSC != 0 {
            // Blosc trusts its own header, so the header must agree with the file.
            let [_, unpacked, _, packed] = std::array::from_fn(|_| self.cursor.u32("Blosc header"));
            let (unpacked, packed) = (u64::from(unpacked?), u64::from(packed?));
            if unpacked != bytes || packed != length as u64 || packed < 16 {
                return Err(self.cursor.damaged(format_args!(
                    "{what}: Blosc block of {packed} for {unpacked} bytes, {length} for {bytes} expected"
                )));
            }
            return self.cursor.skip(packed - 16, what);
        }
        self.cursor.skip(length as u64, what)
    }

    /// Walks all leaf buffers and returns the first byte of each run of [`RUN`] leaves. [`Walk::topology`] must have
    /// been called before.
    pub(super) fn buffers(&mut self) -> Result<Vec<u64>> {
        let mut runs = Vec::new();
        for (i, (origin, active)) in std::mem::take(&mut self.leaves).into_iter().enumerate() {
            if i % RUN == 0 {
                runs.push(self.cursor.position());
            }
            self.cursor.skip(64, "leaf mask")?;
            match self.value.leaf {
                LeafKind::Values => self.compressed(512, u64::from(active), "leaf values")?,
                LeafKind::Bool | LeafKind::Mask => {
                    let stated = self.cursor.coord("leaf origin")?;
                    if stated != origin {
                        return Err(self.cursor.damaged(format_args!("leaf {origin:?} says it is at {stated:?}")));
                    }
                    if self.value.leaf == LeafKind::Bool {
                        self.cursor.skip(64, "leaf values")?;
                    }
                }
                LeafKind::Opaque => return Err(Error::unsupported("point buffers are not walked")),
            }
        }
        Ok(runs)
    }
}
