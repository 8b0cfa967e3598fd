//! A grid as files hold it: sparse leaves and tiles with their metadata, not yet arranged for rays.

use crate::math::{Aabb, Affine};
use glam::IVec3;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Largest density that can be rendered: above it, cubics of the density along a ray leave single precision.
pub const MOST_DENSITY: f32 = 1e30;

/// What the values of a grid mean, as OpenVDB names it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GridClass {
    /// Density of a participating medium; zero outside.
    FogVolume,
    /// Signed distance to a surface.
    LevelSet,
    /// Velocity on staggered faces.
    Staggered,
    /// Not stated.
    Unknown,
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

/// 8³ voxels. `values[(x << 6) | (y << 3) | z]` as in OpenVDB: z runs fastest.
#[derive(Debug, Clone, PartialEq)]
pub struct Leaf {
    /// Index coordinates of the first voxel, multiples of 8.
    pub origin: [i32; 3],
    /// All values, those of inactive voxels too.
    pub values: Box<[f32; LEAF_VOXELS]>,
    /// Bit `i & 63` of word `i >> 6` is set if voxel `i` is active.
    pub active: [u64; 8],
}

/// A constant block above leaf level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tile {
    /// Index coordinates of the first voxel.
    pub origin: [i32; 3],
    /// Edge length in voxels (8, 128 or 4096 in OpenVDB's standard tree).
    pub dim: i32,
    /// Value of every voxel inside.
    pub value: f32,
    /// Active tiles count as voxels; inactive ones carry only a value (the inside of a level set).
    pub active: bool,
}

/// Metadata value of a file or a grid.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
#[serde(untagged)]
pub enum MetaValue {
    /// `bool`
    Bool(bool),
    /// `int32` and `int64`
    Int(i64),
    /// `float` and `double`
    Float(f64),
    /// `string`
    Text(String),
    /// `vec2i`, `vec3i`, `vec4i`
    Ints(Vec<i64>),
    /// `vec2s`, `vec3d`, ... and matrices, row by row
    Floats(Vec<f64>),
}

/// A scalar grid in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// Name, unique within a file after OpenVDB's suffixing (`density[0]`).
    pub name: String,
    /// What the values mean.
    pub class: GridClass,
    /// Index space to world space; a voxel's index coordinates are its centre.
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
    /// Bytes that leaves and tiles take in memory.
    pub fn memory(&self) -> u64 {
        // The values of a leaf are an allocation of their own.
        let leaf = size_of::<Leaf>() + LEAF_VOXELS * size_of::<f32>() + 16;
        (self.leaves.len() * leaf + self.tiles.len() * size_of::<Tile>()) as u64
    }

    /// Box of the centres of all active voxels, in index space; empty if there are none.
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
