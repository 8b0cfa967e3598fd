//! Leaves and tiles as they are met on the walk, with their values decoded.

use super::layout::{Kind, LEAF_MASK};
use super::volume::{IntegerLeaf, IntegerTile, Tree};
use crate::error::Result;
use crate::formats::limits::Limits;
use crate::formats::vdb::{RawLeaf, RawTile};
use crate::scene::grid::{LEAF_VOXELS, Leaf, Tile};
use half::f16;

/// Collects the parts of a tree within the limits.
pub(super) struct Collector {
    kind: Kind,
    tree: Tree,
    background: Vec<u8>,
    limits: Limits,
    held: u64,
    leaves: u64,
}

/// A 32-bit float at the start of `bytes`.
fn f32_at(bytes: &[u8], at: usize) -> f32 {
    f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

/// A 32-bit integer at the start of `bytes`.
fn i32_at(bytes: &[u8], at: usize) -> i32 {
    i32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

fn eight(bytes: &[u8], at: usize) -> [u8; 8] {
    std::array::from_fn(|i| bytes[at + i])
}

/// Value number `i` of unquantized scalars.
fn scalar(kind: Kind, bytes: &[u8], i: usize) -> f32 {
    match kind {
        Kind::Double => f64::from_le_bytes(eight(bytes, 8 * i)) as f32,
        Kind::Int64 => i64::from_le_bytes(eight(bytes, 8 * i)) as f32,
        Kind::UInt32 => i32_at(bytes, 4 * i).cast_unsigned() as f32,
        Kind::Half => f16::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]]).to_f32(),
        Kind::Mask | Kind::Boolean => f32::from(bytes[i] & 1),
        _ => f32_at(bytes, 4 * i),
    }
}

/// Value number `i` of integers of up to 32 bits.
fn integer(kind: Kind, bytes: &[u8], i: usize) -> i32 {
    if kind == Kind::Int16 { i16::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]]).into() } else { i32_at(bytes, 4 * i) }
}

/// Component number `i` of vectors.
fn component(kind: Kind, bytes: &[u8], i: usize) -> f32 {
    if kind == Kind::Vec3d { f64::from_le_bytes(eight(bytes, 8 * i)) as f32 } else { f32_at(bytes, 4 * i) }
}

/// Value number `i` of a leaf whose codes have `bits` bits, without scale and offset.
fn code(values: &[u8], bits: usize, i: usize) -> f32 {
    if bits == 16 {
        return u16::from_le_bytes([values[2 * i], values[2 * i + 1]]).into();
    }
    let bit = i * bits;
    let mask = ((1_u16 << bits) - 1) as u8;
    f32::from(values[bit / 8] >> (bit % 8) & mask)
}

impl Collector {
    /// Starts with nothing; `taken` is the number of bytes that the grid's memory occupies beside what is collected,
    /// and `leaves` that of the leaves which the grid claims to have.
    ///
    /// # Errors
    /// If so many leaves exceed the limits.
    pub(super) fn new(kind: Kind, background: &[u8], limits: Limits, taken: u64, leaves: usize) -> Result<Self> {
        // All at once: leaves that are moved to a larger place are there twice.
        let needed = taken.saturating_add(leaves as u64 * size_of::<Leaf>() as u64);
        if needed > limits.max_memory {
            return Err(limits.exceeded(needed, leaves as u64));
        }
        let tree = match kind {
            Kind::Int16 | Kind::Int32 => {
                Tree::Integers { background: integer(kind, background, 0), leaves: Vec::new(), tiles: Vec::new() }
            }
            Kind::Vec3f | Kind::Vec3d => {
                let background = std::array::from_fn(|c| component(kind, background, c));
                Tree::Vectors { background, leaves: Vec::new(), tiles: Vec::new() }
            }
            _ => {
                let background = scalar(kind, background, 0);
                Tree::Scalars { background, leaves: Vec::with_capacity(leaves), tiles: Vec::new() }
            }
        };
        Ok(Self { kind, tree, background: background.to_vec(), limits, held: taken, leaves: 0 })
    }

    fn hold(&mut self, bytes: usize) -> Result<()> {
        self.held += bytes as u64;
        if self.held > self.limits.max_memory { Err(self.limits.exceeded(self.held, self.leaves)) } else { Ok(()) }
    }

    /// Adds a tile, unless it is inactive and says no more than the background.
    pub(super) fn tile(&mut self, origin: [i32; 3], dim: i32, value: &[u8], active: bool) -> Result<()> {
        if !active && value == self.background {
            return Ok(());
        }
        self.hold(size_of::<RawTile>())?;
        let kind = self.kind;
        match &mut self.tree {
            Tree::Scalars { tiles, .. } => {
                // A mask has no values: what is active is 1.
                let value = if kind == Kind::Mask { f32::from(u8::from(active)) } else { scalar(kind, value, 0) };
                tiles.push(Tile { origin, dim, value, active });
            }
            Tree::Vectors { tiles, .. } => {
                let value = std::array::from_fn(|c| component(kind, value, c));
                tiles.push(RawTile { origin, dim, value, active });
            }
            Tree::Integers { tiles, .. } => {
                tiles.push(IntegerTile { origin, dim, value: integer(kind, value, 0), active });
            }
        }
        Ok(())
    }

    /// Adds a leaf: `head` is what stands before its values.
    pub(super) fn leaf(&mut self, origin: [i32; 3], head: &[u8], values: &[u8]) -> Result<()> {
        let components = self.kind.components();
        self.leaves += 1;
        // The allocator's share is counted as in grids of other files.
        self.hold(size_of::<RawLeaf>() + 4 * LEAF_VOXELS * components + 16)?;
        let active = std::array::from_fn(|word| u64::from_le_bytes(eight(head, LEAF_MASK + 8 * word)));
        let kind = self.kind;
        match &mut self.tree {
            Tree::Scalars { leaves, .. } => {
                let mut decoded = [0.0; LEAF_VOXELS];
                scalars(kind, head, values, &active, &mut decoded);
                leaves.push(Leaf { origin, values: decoded, active });
            }
            Tree::Vectors { leaves, .. } => {
                let values = (0..LEAF_VOXELS * components).map(|i| component(kind, values, i)).collect();
                leaves.push(RawLeaf { origin, values, active });
            }
            Tree::Integers { leaves, .. } => {
                let mut decoded = Box::new([0; LEAF_VOXELS]);
                decoded.iter_mut().enumerate().for_each(|(i, v)| *v = integer(kind, values, i));
                leaves.push(IntegerLeaf { origin, values: decoded, active });
            }
        }
        Ok(())
    }

    /// Returns the tree, in ascending order of origin.
    pub(super) fn finish(mut self) -> Tree {
        match &mut self.tree {
            Tree::Scalars { leaves, tiles, .. } => {
                // In place: leaves hold their values, and no two are at one origin.
                leaves.sort_unstable_by_key(|l| l.origin);
                tiles.sort_by_key(|t| t.origin);
            }
            Tree::Vectors { leaves, tiles, .. } => {
                leaves.sort_unstable_by_key(|l| l.origin);
                tiles.sort_by_key(|t| t.origin);
            }
            Tree::Integers { leaves, tiles, .. } => {
                leaves.sort_unstable_by_key(|l| l.origin);
                tiles.sort_by_key(|t| t.origin);
            }
        }
        self.tree
    }
}

/// Decodes the values of a leaf of scalars.
fn scalars(kind: Kind, head: &[u8], values: &[u8], active: &[u64; 8], decoded: &mut [f32; LEAF_VOXELS]) {
    let bits = match kind {
        Kind::Fp4 => 4,
        Kind::Fp8 => 8,
        Kind::Fp16 => 16,
        Kind::FpN => 1 << (head[15] >> 5).min(4),
        _ => 0,
    };
    let on = |i: usize| f32::from((active[i >> 6] >> (i & 63) & 1) as u8);
    for (i, value) in decoded.iter_mut().enumerate() {
        *value = match kind {
            Kind::Mask => on(i),
            Kind::Boolean => code(values, 1, i),
            // Minimum and quantum of the leaf follow the mask.
            _ if bits > 0 => code(values, bits, i) * f32_at(head, 84) + f32_at(head, 80),
            _ => scalar(kind, values, i),
        };
    }
}
