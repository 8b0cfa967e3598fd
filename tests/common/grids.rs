//! Generated volumes.

use super::work::{density, fixture};
use cumulo::formats::vdb::{Codec, NativeGrid, RawLeaf, write_grids, write_native};
use cumulo::math::Affine;
use cumulo::scene::grid::{Grid, GridClass, Leaf, Tile};
use glam::DVec3;
use std::collections::BTreeMap;
use std::path::Path;

/// A fog volume of `n`³ leaves from a hash, with about half of the voxels active, an active and an
/// inactive tile.
pub fn fog(name: &str, n: i32, seed: u64) -> Grid {
    let mut state = seed | 1;
    let mut next = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1u64 << 24) as f32
    };
    let mut leaves = Vec::new();
    for x in 0..n {
        for y in 0..n {
            for z in 0..n {
                let mut leaf = Leaf {
                    origin: [8 * (x - n / 2), 8 * (y - n / 2), 8 * (z - n / 2)],
                    values: [0.0; 512],
                    active: [0; 8],
                };
                for i in 0..512 {
                    let v = next();
                    if v > 0.5 {
                        leaf.values[i] = v;
                        leaf.active[i >> 6] |= 1 << (i & 63);
                    }
                }
                leaves.push(leaf);
            }
        }
    }
    Grid {
        name: name.into(),
        class: GridClass::FogVolume,
        transform: Affine::uniform(0.25, DVec3::new(1.0, -2.0, 3.0)).unwrap(),
        background: 0.0,
        leaves,
        tiles: vec![
            Tile { origin: [-4096, 0, 0], dim: 128, value: 0.5, active: true },
            Tile { origin: [512, 512, 512], dim: 8, value: 0.25, active: false },
        ],
        metadata: BTreeMap::new(),
    }
}

/// One without tiles.
pub fn compact(name: &str, n: i32, seed: u64) -> Grid {
    Grid { tiles: vec![], ..fog(name, n, seed) }
}

/// Writes a VDB of these grids.
pub fn write(path: &Path, grids: &[&Grid]) {
    write_grids(path, grids, &BTreeMap::new(), Codec::Blosc, false).unwrap();
}

/// Writes the plume with the same velocity in and around all of it, the grid `velocity`.
pub fn write_wind(path: &Path, speed: [f32; 3]) {
    let plume = density(&fixture("plume.vdb"));
    let ends = |axis: usize| {
        let places = plume.leaves.iter().map(|leaf| leaf.origin[axis]);
        places.fold([i32::MAX, i32::MIN], |[low, high], at| [low.min(at), high.max(at)])
    };
    let along = |axis: usize| {
        let [low, high] = ends(axis);
        (low - 24..=high + 24).step_by(8)
    };
    let mut leaves = Vec::new();
    for x in along(0) {
        for y in along(1) {
            leaves.extend(along(2).map(|z| RawLeaf {
                origin: [x, y, z],
                values: std::iter::repeat_n(speed, 512).flatten().collect(),
                active: [u64::MAX; 8],
            }));
        }
    }
    let wind = NativeGrid::from_vectors("velocity", GridClass::Unknown, &plume.transform, &leaves).unwrap();
    let plume = NativeGrid::from_grid(&plume).unwrap();
    write_native(path, &[&plume, &wind], None, &BTreeMap::new(), Codec::Blosc).unwrap();
}
