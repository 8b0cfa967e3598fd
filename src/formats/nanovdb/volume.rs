//! A grid of NanoVDB in memory.

use super::layout::Kind;
use crate::formats::vdb::up::UP_KEY;
use crate::formats::vdb::{RawLeaf, RawTile};
use crate::math::Affine;
use crate::scene::grid::{GridClass, LEAF_VOXELS, Leaf, Tile};
use std::collections::BTreeMap;

/// A leaf of 8³ integers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct IntegerLeaf {
    /// Index coordinates of the first voxel, multiples of 8.
    pub origin: [i32; 3],
    /// Values of all voxels, inactive ones included: `values[(x << 6) | (y << 3) | z]`.
    pub values: Box<[i32; LEAF_VOXELS]>,
    /// Activity mask: bit `i & 63` of word `i >> 6` is set if voxel `i` is active.
    pub active: [u64; 8],
}

/// A block of constant integer value above the leaf level.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct IntegerTile {
    /// Index coordinates of the first voxel.
    pub origin: [i32; 3],
    /// Edge length in voxels: 8, 128 or 4096.
    pub dim: i32,
    /// Value of every voxel.
    pub value: i32,
    /// True if the tile's voxels count as active.
    pub active: bool,
}

/// Leaves, tiles and background of a grid, by what its values are. Leaves and tiles are in ascending order of origin;
/// tiles that are inactive and have the background's value are left out.
#[derive(Debug, Clone, PartialEq)]
pub enum Tree {
    /// One real number per voxel.
    Scalars {
        /// Value wherever there is neither leaf nor tile.
        background: f32,
        /// Leaves of 8³ voxels.
        leaves: Vec<Leaf>,
        /// Constant blocks.
        tiles: Vec<Tile>,
    },
    /// Three real numbers per voxel.
    Vectors {
        /// Value wherever there is neither leaf nor tile.
        background: [f32; 3],
        /// Leaves of 8³ voxels, three components each.
        leaves: Vec<RawLeaf>,
        /// Constant blocks.
        tiles: Vec<RawTile>,
    },
    /// One integer per voxel.
    Integers {
        /// Value wherever there is neither leaf nor tile.
        background: i32,
        /// Leaves of 8³ voxels.
        leaves: Vec<IntegerLeaf>,
        /// Constant blocks.
        tiles: Vec<IntegerTile>,
    },
}

/// Names of the texts that are read of a grid: entries of a VDB's own metadata, which NanoVDB has no field for, and by
/// which the up axis is known.
pub(crate) const KEPT: [&str; 2] = ["creator", UP_KEY];

/// A grid as read from or written to a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Volume {
    /// Name of the grid.
    pub name: String,
    /// Meaning of the values.
    pub class: GridClass,
    /// Map from index space to world space; a voxel's index coordinates are those of its centre.
    pub transform: Affine,
    /// Type of the values in the file that was read; writing goes by [`Tree`].
    pub kind: Kind,
    /// Values.
    pub tree: Tree,
    /// Texts by their names, which files keep beside the grid: those of `KEPT`.
    pub texts: BTreeMap<String, String>,
    /// Remarks of the reader for the user, one sentence each: changes and doubts.
    pub notes: Vec<String>,
}
