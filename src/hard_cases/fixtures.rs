//! Fields and rays that the cases are made of.

use crate::error::Result;
use crate::math::{Aabb, Affine, Ray};
use crate::real::Real;
use crate::scene::bricks::Bricks;
use crate::scene::grid::{Grid, GridClass, LEAF_VOXELS, Leaf};
use glam::{DMat3, DMat4, DVec3};
use std::collections::BTreeMap;

/// Memory that a field may take, in bytes.
pub(super) const MEMORY: u64 = 1 << 30;

/// Returns a grid of `n³` voxels, index (0, 0, 0) first, from a function of the index coordinates.
pub(super) fn grid(n: i32, transform: Affine, value: impl Fn(DVec3) -> f64) -> Grid {
    let mut leaves = Vec::new();
    let corners = (0..n).step_by(8);
    for origin in corners.clone().flat_map(|x| corners.clone().map(move |y| [x, y])) {
        for z in corners.clone() {
            let mut values = [0.0_f32; LEAF_VOXELS];
            let mut active = [0_u64; 8];
            for i in 0..LEAF_VOXELS {
                let p = [origin[0] + (i as i32 >> 6), origin[1] + (i as i32 >> 3 & 7), z + (i as i32 & 7)];
                if p.iter().all(|c| *c < n) {
                    values[i] = value(DVec3::from_array(p.map(f64::from))) as f32;
                    active[i >> 6] |= 1 << (i & 63);
                }
            }
            leaves.push(Leaf { origin: [origin[0], origin[1], z], values, active });
        }
    }
    Grid {
        name: "density".into(),
        class: GridClass::FogVolume,
        transform,
        background: 0.0,
        leaves,
        tiles: Vec::new(),
        metadata: BTreeMap::new(),
    }
}

/// Returns such a grid as bricks.
pub(super) fn field<R: Real>(n: i32, transform: Affine, value: impl Fn(DVec3) -> f64) -> Result<Bricks<R>> {
    Bricks::from_grid(&grid(n, transform, value), MEMORY)
}

/// Returns a constant field without the fall-off at its faces: between voxels 3 and 19 along each axis.
pub(super) fn slab<R: Real>(density: f64) -> Result<Bricks<R>> {
    let mut slab = field(24, unit()?, |_| density)?;
    slab.domain = Aabb { min: DVec3::splat(3.0), max: DVec3::splat(19.0) };
    Ok(slab)
}

/// World length of an axis-parallel ray through a [`slab`].
pub(super) const SLAB: f64 = 16.0;

/// Returns a ray along the x axis, between the voxels.
pub(super) fn along_x() -> Ray {
    Ray::new(DVec3::new(-3.0, 7.3, 6.8), DVec3::X)
}

/// Returns a ray along no axis.
pub(super) fn slanted() -> Ray {
    Ray::new(DVec3::new(-20.0, 3.1, 5.2), DVec3::new(0.9, 0.3, 0.2).normalize())
}

/// Returns the map of voxels of edge 1 at integer world positions.
pub(super) fn unit() -> Result<Affine> {
    Affine::uniform(1.0, DVec3::ZERO)
}

/// Returns a sheared, mirrored, non-uniform and shifted map.
pub(super) fn sheared() -> Result<Affine> {
    let linear = DMat3::from_cols(DVec3::new(-0.7, 0.1, 0.05), DVec3::new(0.2, 1.3, -0.1), DVec3::new(0.0, 0.3, 0.45));
    Affine::new(DMat4::from_mat3_translation(linear, DVec3::new(3.0, -7.0, 11.0)))
}

/// Returns a number from 0 to 1 that a seed stands for, the same on every machine.
pub(super) fn noise(seed: u64) -> f64 {
    let mut h = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0xD1B5_4A32_D192_ED03;
    h = (h ^ (h >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    h = (h ^ (h >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((h ^ (h >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// Returns a smooth positive field of `n³` voxels without symmetry, as a function of the index coordinates.
pub(super) fn lumps(n: i32) -> impl Fn(DVec3) -> f64 {
    move |p| {
        let q = p / f64::from(n);
        let blob = |c: DVec3, s: f64| (-(q - c).length_squared() / (2.0 * s * s)).exp();
        let wave = 1.0 + 0.5 * (9.0 * q.x + 4.0 * q.y * q.y).sin() * (7.0 * q.z - 3.0 * q.x).cos();
        let edge = |c: f64| (c * (1.0 - c) * 8.0).clamp(0.0, 1.0);
        let blobs = blob(DVec3::new(0.4, 0.5, 0.45), 0.16) + 0.6 * blob(DVec3::new(0.65, 0.4, 0.6), 0.1);
        blobs * wave * edge(q.x) * edge(q.y) * edge(q.z)
    }
}

/// Returns rays from a sphere around a box towards points inside it.
pub(super) fn rays(bounds: Aabb, count: u64, seed: u64) -> Vec<Ray> {
    let (centre, size) = (bounds.centre(), bounds.size());
    let ray = |i: u64| {
        let r = |k: u64| noise(seed.wrapping_add(i * 16 + k)) - 0.5;
        let target = centre + size * DVec3::new(r(0), r(1), r(2)) * 0.8;
        let from = DVec3::new(r(3), r(4), r(5)).normalize() * size.length();
        Ray::new(centre + from, (target - centre - from).normalize())
    };
    (0..count).map(ray).collect()
}
