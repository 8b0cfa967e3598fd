//! How far two volumes are apart: PSNR, RMS, largest difference and overlap of their topologies.
//!
//! The domain is the union of the two boxes of active voxels, on the first volume's lattice. Where
//! the lattices differ, the second volume is sampled trilinearly at the first one's voxel centres.

use crate::error::{Error, Result};
use crate::math::{Aabb, Affine};
use crate::scene::bricks::Bricks;
use crate::scene::grid::{Grid, LEAF_VOXELS};
use glam::{DVec3, IVec3};
use rayon::prelude::*;
use serde::Serialize;
use std::collections::HashMap;

/// Blocks of 8³ that one comparison may visit (8.6e9 voxels): beyond, the boxes are too far apart.
const MAX_BLOCKS: i128 = 1 << 24;

#[derive(Debug, Clone, Copy)]
struct Block<'a> {
    values: &'a [f32],
    active: &'a [u64; 8],
}

#[derive(Debug, Clone, Copy)]
struct Constant {
    value: [f32; 3],
    active: bool,
}

/// A sparse volume to look values up in.
#[derive(Debug)]
pub struct Field<'a> {
    components: usize,
    background: [f32; 3],
    transform: Affine,
    active_box: Option<([i32; 3], [i32; 3])>,
    leaves: HashMap<[i32; 3], Block<'a>>,
    tiles: [HashMap<[i32; 3], Constant>; 3],
}

const TILE_DIMS: [i32; 3] = [8, 128, 4096];

impl<'a> Field<'a> {
    /// An empty volume. `active_box` is the inclusive box of active voxels.
    pub fn new(
        components: usize,
        background: [f32; 3],
        transform: Affine,
        active_box: Option<([i32; 3], [i32; 3])>,
    ) -> Self {
        Self { components, background, transform, active_box, leaves: HashMap::new(), tiles: Default::default() }
    }

    /// A scalar grid. Its box of active voxels is found by a walk.
    pub fn from_grid(grid: &'a Grid) -> Self {
        let mut field = Self::new(1, [grid.background, 0.0, 0.0], grid.transform, None);
        let (mut min, mut max) = (IVec3::MAX, IVec3::MIN);
        for leaf in &grid.leaves {
            field.add_leaf(leaf.origin, &leaf.values[..], &leaf.active);
            for i in (0..512).filter(|i| leaf.active[i >> 6] >> (i & 63) & 1 == 1) {
                let p = IVec3::from_array(leaf.origin) + IVec3::new(i as i32 >> 6, i as i32 >> 3 & 7, i as i32 & 7);
                (min, max) = (min.min(p), max.max(p));
            }
        }
        for tile in &grid.tiles {
            field.add_tile(tile.origin, tile.dim, [tile.value, 0.0, 0.0], tile.active);
            if tile.active {
                let p = IVec3::from_array(tile.origin);
                (min, max) = (min.min(p), max.max(p + (tile.dim - 1)));
            }
        }
        field.active_box = min.cmple(max).all().then(|| (min.to_array(), max.to_array()));
        field
    }

    /// Adds 8³ voxels, components interleaved, z fastest.
    pub fn add_leaf(&mut self, origin: [i32; 3], values: &'a [f32], active: &'a [u64; 8]) {
        self.leaves.insert(origin, Block { values, active });
    }

    /// Adds a constant block of edge 8, 128 or 4096.
    pub fn add_tile(&mut self, origin: [i32; 3], dim: i32, value: [f32; 3], active: bool) {
        if let Some(level) = TILE_DIMS.iter().position(|d| *d == dim) {
            self.tiles[level].insert(origin, Constant { value, active });
        }
    }

    fn constant(&self, p: [i32; 3]) -> Constant {
        for (level, dim) in TILE_DIMS.iter().enumerate() {
            if self.tiles[level].is_empty() {
                continue;
            }
            if let Some(t) = self.tiles[level].get(&p.map(|c| c & !(dim - 1))) {
                return *t;
            }
        }
        Constant { value: self.background, active: false }
    }

    fn voxel(&self, p: [i32; 3]) -> Constant {
        match self.leaves.get(&p.map(|c| c & !7)) {
            Some(block) => {
                let i = ((p[0] & 7) << 6 | (p[1] & 7) << 3 | (p[2] & 7)) as usize;
                let mut value = [0.0; 3];
                value[..self.components].copy_from_slice(&block.values[i * self.components..][..self.components]);
                Constant { value, active: block.active[i >> 6] >> (i & 63) & 1 == 1 }
            }
            None => self.constant(p),
        }
    }

    /// Trilinear value at index coordinates, and whether the nearest voxel is active.
    fn sample(&self, p: DVec3) -> Constant {
        let base = p.floor();
        let f = p - base;
        let base = base.as_ivec3();
        let mut value = [0.0_f64; 3];
        for corner in 0..8 {
            let d = IVec3::new(corner >> 2 & 1, corner >> 1 & 1, corner & 1);
            let w: f64 = (0..3).map(|a| if d[a] == 1 { f[a] } else { 1.0 - f[a] }).product();
            if w > 0.0 {
                let v = self.voxel((base + d).to_array()).value;
                (0..3).for_each(|c| value[c] += w * f64::from(v[c]));
            }
        }
        Constant { value: value.map(|v| v as f32), active: self.voxel(p.round().as_ivec3().to_array()).active }
    }

    fn peak(&self) -> f64 {
        let in_leaves = self.leaves.values().flat_map(|b| {
            (0..512)
                .filter(|i| b.active[i >> 6] >> (i & 63) & 1 == 1)
                .flat_map(|i| b.values[i * self.components..(i + 1) * self.components].iter().copied())
        });
        let in_tiles = self.tiles.iter().flat_map(HashMap::values).filter(|t| t.active).flat_map(|t| t.value);
        in_leaves.chain(in_tiles).filter(|v| v.is_finite()).fold(0.0, |m, v| m.max(f64::from(v.abs())))
    }
}

/// Difference of two volumes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    /// `20 log10(peak / rms)` with `peak = max |A|` over active voxels; `None` if the volumes are
    /// identical (or A is zero where B is not: see `rms`).
    pub psnr_db: Option<f64>,
    /// Root of the mean squared difference over all voxels (and components) of the domain.
    pub rms: f64,
    /// Largest absolute difference.
    pub max_abs: f64,
    /// Voxels active in both over voxels active in either; 1 if none is active in either.
    pub topology_iou: f64,
    /// How far the two transforms move a corner of the domain apart, in world units; 0 if equal.
    pub transform_difference: f64,
    /// Voxels of the domain.
    pub voxels: u64,
    /// Values of which one is finite and the other is not, or whose kinds of infinity differ; they are
    /// left out of `rms` and `max_abs`.
    pub incomparable: u64,
}

impl Difference {
    /// True if nothing differs by more than `max_abs`, neither in value nor in place nor in topology.
    pub fn within(&self, max_abs: f64) -> bool {
        self.max_abs <= max_abs
            && self.incomparable == 0
            && self.transform_difference == 0.0
            && (max_abs > 0.0 || self.topology_iou == 1.0)
    }
}

#[derive(Debug, Clone, Copy, Default)]
struct Partial {
    squares: f64,
    max: f64,
    both: u64,
    either: u64,
    incomparable: u64,
}

/// Compares `b` with `a`.
///
/// # Errors
/// If the components differ, or the domain is too large.
pub fn compare(a: &Field<'_>, b: &Field<'_>) -> Result<Difference> {
    if a.components != b.components {
        return Err(Error::invalid(format!(
            "one grid has {} values a voxel, the other {}",
            a.components, b.components
        )));
    }
    let same = a.transform == b.transform;
    let b_box = b.active_box.map(|(min, max)| if same { (min, max) } else { on_lattice(min, max, b, a) });
    let Some((min, max)) = union(a.active_box, b_box) else {
        return Ok(Difference {
            psnr_db: None,
            rms: 0.0,
            max_abs: 0.0,
            topology_iou: 1.0,
            transform_difference: transform_difference(a, b, [0; 3], [0; 3]),
            voxels: 0,
            incomparable: 0,
        });
    };
    let first: [i32; 3] = min.map(|c| c >> 3);
    let counts: [i128; 3] = std::array::from_fn(|i| i128::from(max[i] >> 3) - i128::from(first[i]) + 1);
    let blocks: i128 = counts.iter().product();
    if blocks > MAX_BLOCKS {
        return Err(Error::unsupported(format!(
            "the volumes span {blocks} blocks of 8³ together, at most {MAX_BLOCKS}"
        ))
        .hint("crop them to the same region first: cumulo convert --crop"));
    }
    let partials: Vec<Partial> = (0..blocks as i64)
        .into_par_iter()
        .map(|n| {
            let (ny, nz) = (counts[1] as i64, counts[2] as i64);
            let block = [n / (ny * nz), n / nz % ny, n % nz];
            let origin: [i32; 3] = std::array::from_fn(|i| (first[i] + block[i] as i32) << 3);
            compare_block(a, b, same, origin, min, max)
        })
        .collect();
    // Added in order, so that the sum does not depend on the threads.
    let mut sum = Partial::default();
    for p in partials {
        sum.squares += p.squares;
        sum.max = sum.max.max(p.max);
        sum.both += p.both;
        sum.either += p.either;
        sum.incomparable += p.incomparable;
    }
    let voxels: i128 = (0..3).map(|i| i128::from(max[i]) - i128::from(min[i]) + 1).product();
    let rms = (sum.squares / (voxels as f64 * a.components as f64)).sqrt();
    let peak = a.peak();
    Ok(Difference {
        psnr_db: (rms > 0.0 && peak > 0.0).then(|| 20.0 * (peak / rms).log10()),
        rms,
        max_abs: sum.max,
        topology_iou: if sum.either == 0 { 1.0 } else { sum.both as f64 / sum.either as f64 },
        transform_difference: transform_difference(a, b, min, max),
        voxels: voxels as u64,
        incomparable: sum.incomparable,
    })
}

fn compare_block(a: &Field<'_>, b: &Field<'_>, same: bool, origin: [i32; 3], min: [i32; 3], max: [i32; 3]) -> Partial {
    let mut p = Partial::default();
    let range = |i: usize| origin[i].max(min[i])..=(origin[i] + 7).min(max[i]);
    for x in range(0) {
        for y in range(1) {
            for z in range(2) {
                let va = a.voxel([x, y, z]);
                let vb = if same {
                    b.voxel([x, y, z])
                } else {
                    let world = a.transform.to_world(DVec3::new(x.into(), y.into(), z.into()));
                    b.sample(b.transform.to_index(world))
                };
                p.both += u64::from(va.active && vb.active);
                p.either += u64::from(va.active || vb.active);
                for c in 0..a.components {
                    let (u, v) = (va.value[c], vb.value[c]);
                    if u.is_finite() && v.is_finite() {
                        let d = f64::from(u) - f64::from(v);
                        p.squares += d * d;
                        p.max = p.max.max(d.abs());
                    } else if !(u == v || u.is_nan() && v.is_nan()) {
                        p.incomparable += 1;
                    }
                }
            }
        }
    }
    p
}

fn corner(c: [i32; 3]) -> DVec3 {
    DVec3::from_array(c.map(f64::from))
}

/// Box of `from`'s voxels on `onto`'s lattice, rounded outwards.
fn on_lattice(min: [i32; 3], max: [i32; 3], from: &Field<'_>, onto: &Field<'_>) -> ([i32; 3], [i32; 3]) {
    let world = Aabb { min: corner(min), max: corner(max) }.corners().map(|c| from.transform.to_world(c));
    let index = world.into_iter().fold(Aabb::EMPTY, |b, w| b.including(onto.transform.to_index(w)));
    // A rounding error below a millionth of a voxel must not add a layer.
    ((index.min + 1e-6).floor().as_ivec3().to_array(), (index.max - 1e-6).ceil().as_ivec3().to_array())
}

type IndexBox = ([i32; 3], [i32; 3]);

fn union(a: Option<IndexBox>, b: Option<IndexBox>) -> Option<IndexBox> {
    match (a, b) {
        (Some((a0, a1)), Some((b0, b1))) => {
            Some((std::array::from_fn(|i| a0[i].min(b0[i])), std::array::from_fn(|i| a1[i].max(b1[i]))))
        }
        (one, other) => one.or(other),
    }
}

fn transform_difference(a: &Field<'_>, b: &Field<'_>, min: [i32; 3], max: [i32; 3]) -> f64 {
    let corners = Aabb { min: corner(min), max: corner(max) }.corners();
    corners.map(|c| a.transform.to_world(c).distance(b.transform.to_world(c))).into_iter().fold(0.0, f64::max)
}
/// Root mean squares of the differences at the voxels of `a` that are not zero in both, apart by a third field
/// `known`: where it is a half or more, and elsewhere; none where there are no voxels.
pub fn rms_apart(a: &Bricks<f32>, b: &Bricks<f32>, known: &Bricks<f32>) -> [Option<f64>; 2] {
    let brick = |(brick, voxels): (&IVec3, &[f32])| {
        let mut sums = [[0.0_f64; 2]; 2];
        for (i, own) in voxels.iter().enumerate() {
            let local = IVec3::new((i >> 6) as i32, (i >> 3 & 7) as i32, (i & 7) as i32);
            let world = a.transform.to_world((8 * *brick + local).as_dvec3());
            let other = b.sample(b.transform.to_index(world));
            if *own != 0.0 || other != 0.0 {
                let part = &mut sums[usize::from(known.sample(known.transform.to_index(world)) < 0.5)];
                *part = [part[0] + f64::from(own - other).powi(2), part[1] + 1.0];
            }
        }
        sums
    };
    let owned = a.owned();
    let bricks = a.topology.bricks().par_iter().zip(owned.par_chunks(LEAF_VOXELS));
    let all: Vec<_> = bricks.map(brick).collect();
    [0, 1].map(|part| {
        let [square, count] = all.iter().fold([0.0; 2], |t, s| [t[0] + s[part][0], t[1] + s[part][1]]);
        (count > 0.0).then(|| (square / count).sqrt())
    })
}
