//! A grid as stored in files: sparse leaves and tiles with metadata, before the layout for ray traversal.

use crate::math::{Aabb, Affine};
use glam::IVec3;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Largest density that can be rendered; above it, cubic polynomials of the density along a ray overflow single
/// precision.
pub const MOST_DENSITY: f32 = 1e30;

/// Meaning of a grid's values, as classified by OpenVDB.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GridClass {
    /// Density of a participating medium; zero outside.
    FogVolume,
    /// Signed distance to a surface.
    LevelSet,
    /// Staggered vectors, such as velocities on voxel faces.
    Staggered,
    /// No class stated.
    Unknown,
}

impl GridClass {
    /// Name of the class as reports state it.
    pub fn name(self) -> &'static str {
        match self {
            Self::FogVolume => "fog volume",
            Self::LevelSet => "level set",
            Self::Staggered => "staggered",
            Self::Unknown => "unknown",
        }
    }
}

/// Voxels along the edge of a leaf.
pub const LEAF_DIM: i32 = 8;
/// Voxels in a leaf.
pub const LEAF_VOXELS: usize = 512;

/// Returns the offset, among a leaf's voxels, of the voxel at these index coordinates (x, y, z), z fastest.
#[inline(always)]
pub const fn voxel_offset([x, y, z]: [usize; 3]) -> usize {
    (x & 7) << 6 | (y & 7) << 3 | (z & 7)
}

/// A block of 8³ voxels.
#[derive(Debug, Clone, PartialEq)]
pub struct Leaf {
    /// Index coordinates of the first voxel, multiples of 8.
    pub origin: [i32; 3],
    /// Values of all voxels, inactive ones included: `values[(x << 6) | (y << 3) | z]` as in OpenVDB, z fastest.
    pub values: [f32; LEAF_VOXELS],
    /// Activity mask: bit `i & 63` of word `i >> 6` is set if voxel `i` is active.
    pub active: [u64; 8],
}

/// A block of constant value above the leaf level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tile {
    /// Index coordinates of the first voxel.
    pub origin: [i32; 3],
    /// Edge length in voxels (8, 128 or 4096 in OpenVDB's standard tree).
    pub dim: i32,
    /// Value of every voxel inside.
    pub value: f32,
    /// True if the tile's voxels count as active; inactive tiles carry only a value (the inside of a level set).
    pub active: bool,
}

/// A metadata value of a file or a grid.
#[derive(Debug, Clone, PartialEq, serde::Serialize, schemars::JsonSchema)]
#[serde(untagged)]
pub enum MetaValue {
    /// Value of type `bool`.
    Bool(bool),
    /// Value of type `int32` or `int64`.
    Int(i64),
    /// Value of type `float` or `double`.
    Float(f64),
    /// Value of type `string`.
    Text(String),
    /// Value of type `vec2i`, `vec3i` or `vec4i`.
    Ints(Vec<i64>),
    /// Value of type `vec2s`, `vec3d` and the like, or a matrix row by row.
    Floats(Vec<f64>),
}

/// A scalar grid in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// Name, unique within a file after OpenVDB's suffixing (`density[0]`).
    pub name: String,
    /// Meaning of the values.
    pub class: GridClass,
    /// Map from index space to world space; a voxel's index coordinates are those of its centre.
    pub transform: Affine,
    /// Value wherever there is neither leaf nor tile.
    pub background: f32,
    /// Leaves in ascending order of origin (x, then y, then z).
    pub leaves: Vec<Leaf>,
    /// Tiles in ascending order of origin.
    pub tiles: Vec<Tile>,
    /// Metadata that a writer should keep, by name.
    pub metadata: BTreeMap<String, MetaValue>,
}

impl Grid {
    /// Bytes of memory that leaves and tiles occupy.
    pub fn memory(&self) -> u64 {
        (self.leaves.len() * size_of::<Leaf>() + self.tiles.len() * size_of::<Tile>()) as u64
    }

    /// Index-space box of the centres of all active voxels; empty if there are none.
    pub fn active_box(&self) -> Aabb {
        let of_leaf = |leaf: &Leaf| {
            let origin = IVec3::from_array(leaf.origin);
            let active = (0..LEAF_VOXELS).filter(|i| leaf.active[i >> 6] >> (i & 63) & 1 == 1);
            active.fold(Aabb::EMPTY, |b, i| {
                let local = IVec3::new((i >> 6) as i32, (i >> 3 & 7) as i32, (i & 7) as i32);
                b.including((origin + local).as_dvec3())
            })
        };
        let of_tile = |tile: &Tile| {
            let low = IVec3::from_array(tile.origin).as_dvec3();
            Aabb { min: low, max: low + f64::from(tile.dim - 1) }
        };
        let leaves = self.leaves.par_iter().map(of_leaf).reduce(|| Aabb::EMPTY, Aabb::union);
        self.tiles.iter().filter(|t| t.active).map(of_tile).fold(leaves, Aabb::union)
    }
}
