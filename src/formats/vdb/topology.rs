//! Walks of a grid's tree in the file without OpenVDB: every length and offset is checked, and leaves, nodes and the
//! memory they will take are counted before the library reads a byte.
//!
//! The layout is that of OpenVDB's `RootNode::readTopology`, `InternalNode::readTopology`, `LeafNode::readBuffers` and
//! `io::readCompressedValues`, file versions 222 to 224.

use super::cursor::Cursor;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use std::io::{Read, Seek};
use std::ops::Range;

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
}

/// Returns true if the grids of a tree's type hold scalars that can be walked.
pub(super) fn is_scalar(grid_type: &str) -> bool {
    let scalar = |value: ValueType| value.leaf != LeafKind::Opaque && value.size <= 8;
    ValueType::of(grid_type, false).is_some_and(scalar)
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
pub(super) struct Walk {
    value: ValueType,
    compression: u32,
    limits: Limits,
    found: Topology,
    /// Origin and number of active voxels of each leaf, in the order of their buffers.
    leaves: Vec<([i32; 3], u16)>,
}

fn ones(mask: &[u8]) -> u64 {
    mask.iter().map(|b| u64::from(b.count_ones())).sum()
}

/// Reads the key of a root entry. Root entries are written from an ordered map, so keys ascend, are unique and
/// multiples of 4096.
fn root_key<R: Read + Seek>(c: &mut Cursor<R>, last: &mut Option<[i32; 3]>) -> Result<[i32; 3]> {
    let key = c.coord("root entry")?;
    if key.iter().any(|c| c & 4095 != 0) || last.is_some_and(|l| l >= key) {
        return Err(c.damaged(format_args!("root entry {key:?} is out of order or off its lattice")));
    }
    *last = Some(key);
    Ok(key)
}

impl Walk {
    /// Walks the topology of a tree, from the buffer count to the last leaf's mask.
    pub(super) fn topology<R: Read + Seek>(
        c: &mut Cursor<R>,
        value: ValueType,
        compression: u32,
        limits: Limits,
    ) -> Result<Self> {
        if compression & !(ZIP | ACTIVE_MASK | BLOSC) != 0 {
            return Err(c.damaged(format_args!("compression flags {compression:#x} are unknown")));
        }
        let mut walk = Self { value, compression, limits, found: Topology::default(), leaves: Vec::new() };
        walk.root(c).map_err(|e| e.at(c.path()))?;
        Ok(walk)
    }

    /// Size of the tree.
    pub(super) fn tree_size(&self) -> Topology {
        self.found
    }

    /// Returns the origin and the number of active voxels of each leaf, in the order of the file.
    pub(super) fn origins(&self) -> &[([i32; 3], u16)] {
        &self.leaves
    }

    /// True if the buffers are walked too, so that nothing in the grid is left unchecked.
    pub(super) fn is_complete(&self) -> bool {
        self.value.leaf != LeafKind::Opaque
    }

    fn charge(&mut self, bytes: u64) -> Result<()> {
        self.found.memory = self.found.memory.saturating_add(bytes);
        if self.found.memory > self.limits.max_memory {
            return Err(self.limits.exceeded(self.found.memory, self.found.leaves));
        }
        Ok(())
    }

    fn root<R: Read + Seek>(&mut self, c: &mut Cursor<R>) -> Result<()> {
        let buffers = c.i32("buffer count")?;
        if buffers != 1 {
            return Err(c.damaged(format_args!("the tree has {buffers} buffers, 1 expected")));
        }
        self.root_value(c, "background")?;
        let tiles = c.u32("root tile count")?;
        let children = c.u32("root child count")?;
        let mut tile_keys = std::collections::BTreeSet::new();
        let mut last = None;
        for _ in 0..tiles {
            let key = root_key(c, &mut last)?;
            self.root_value(c, "root tile")?;
            c.bool("root tile state")?;
            self.charge(96)?;
            tile_keys.insert(key);
        }
        let mut last = None;
        for _ in 0..children {
            let origin = root_key(c, &mut last)?;
            if tile_keys.contains(&origin) {
                return Err(c.damaged(format_args!("root entry {origin:?} is both a tile and a child")));
            }
            self.charge(96)?;
            self.internal(c, origin, 5, 7)?;
        }
        Ok(())
    }

    fn root_value<R: Read + Seek>(&self, c: &mut Cursor<R>, what: &str) -> Result<()> {
        if self.value.size == 1 { c.bool(what).map(drop) } else { c.skip(self.value.size, what) }
    }

    /// Walks an internal node of `1 << log2` entries along its edge, whose children have edges of `1 << child_total`
    /// voxels.
    fn internal<R: Read + Seek>(
        &mut self,
        c: &mut Cursor<R>,
        origin: [i32; 3],
        log2: u32,
        child_total: u32,
    ) -> Result<()> {
        let entries = 1_u64 << (3 * log2);
        let mut masks = vec![0_u8; entries as usize / 4];
        c.fill(&mut masks, "node masks")?;
        self.charge(entries * self.value.entry_bytes + entries / 4 + 64)?;
        let (children, values) = masks.split_at(entries as usize / 8);
        if children.iter().zip(values).any(|(child, tile)| child & tile != 0) {
            return Err(c.damaged("a node's entry is both a child and an active tile"));
        }
        self.compressed(c, entries, ones(values), "node values")?;
        for n in (0..entries as usize).filter(|n| children[n >> 3] >> (n & 7) & 1 == 1) {
            let n = n as i32;
            let edge = (1 << log2) - 1;
            let local = [n >> (2 * log2), n >> log2 & edge, n & edge];
            let child: [i32; 3] = std::array::from_fn(|a| origin[a].wrapping_add(local[a] << child_total));
            if log2 == 5 {
                self.internal(c, child, 4, 3)?;
            } else {
                let mut mask = [0; 64];
                c.fill(&mut mask, "leaf mask")?;
                self.found.leaves += 1;
                self.charge(self.value.leaf_bytes)?;
                self.leaves.push((child, ones(&mask) as u16));
            }
        }
        Ok(())
    }

    /// Skips `count` values, `active` of them active, as `io::readCompressedValues` would read them.
    fn compressed<R: Read + Seek>(&self, c: &mut Cursor<R>, count: u64, active: u64, what: &str) -> Result<()> {
        let size = self.value.size;
        let flag = c.u8("compression flag")?;
        let (inactive, selection) = match flag {
            0 | 1 | 6 => (0, false),
            2 => (1, false),
            3 => (0, true),
            4 => (1, true),
            5 => (2, true),
            n => return Err(c.damaged(format_args!("compression flag {n} is above 6"))),
        };
        c.skip(inactive * size + if selection { count / 8 } else { 0 }, "inactive values")?;
        let stored = if self.compression & ACTIVE_MASK != 0 && flag != 6 { active } else { count };
        if stored == 0 && self.value.stored != size {
            return Ok(()); // half values: not even a length is written
        }
        let bytes = stored * self.value.stored;
        if self.compression & (BLOSC | ZIP) == 0 {
            return c.skip(bytes, what);
        }
        let length = c.i64("compressed size")?;
        if length <= 0 {
            // Stored uncompressed. The library reads this many bytes before it compares the sizes.
            if length.unsigned_abs() != bytes {
                return Err(c.damaged(format_args!("{what}: {length} stored for {bytes} bytes")));
            }
            return c.skip(bytes, what);
        }
        if self.compression & BLOSC != 0 {
            // Blosc trusts its own header, so the header must agree with the file.
            let [_, unpacked, _, packed] = std::array::from_fn(|_| c.u32("Blosc header"));
            let (unpacked, packed) = (u64::from(unpacked?), u64::from(packed?));
            if unpacked != bytes || packed != length as u64 || packed < 16 {
                return Err(c.damaged(format_args!(
                    "{what}: Blosc block of {packed} for {unpacked} bytes, {length} for {bytes} expected"
                )));
            }
            return c.skip(packed - 16, what);
        }
        c.skip(length as u64, what)
    }

    /// Walks all leaf buffers and returns the first byte of each run of [`RUN`] leaves.
    pub(super) fn buffers<R: Read + Seek>(&self, c: &mut Cursor<R>) -> Result<Vec<u64>> {
        let mut runs = Vec::new();
        for first in (0..self.leaves.len()).step_by(RUN) {
            runs.push(c.position());
            self.run(c, first..self.leaves.len().min(first + RUN))?;
        }
        Ok(runs)
    }

    /// Walks the buffers of some leaves.
    pub(super) fn run<R: Read + Seek>(&self, c: &mut Cursor<R>, leaves: Range<usize>) -> Result<()> {
        for (origin, active) in self.leaves.get(leaves).unwrap_or_default() {
            c.skip(64, "leaf mask")?;
            match self.value.leaf {
                LeafKind::Values => self.compressed(c, 512, u64::from(*active), "leaf values")?,
                LeafKind::Bool | LeafKind::Mask => {
                    let stated = c.coord("leaf origin")?;
                    if stated != *origin {
                        return Err(c.damaged(format_args!("leaf {origin:?} says it is at {stated:?}")));
                    }
                    if self.value.leaf == LeafKind::Bool {
                        c.skip(64, "leaf values")?;
                    }
                }
                LeafKind::Opaque => return Err(Error::unsupported("point buffers are not walked")),
            }
        }
        Ok(())
    }
}
