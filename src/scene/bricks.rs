//! Fields on sparse bricks with an apron: the arrangement of a scalar grid that rays walk through.
//!
//! A voxel on the low face of a leaf also takes part in cells of the neighbours below; those bricks exist
//! whenever such a voxel is not zero, even where the file has no leaf.

use crate::error::{Error, Result};
use crate::math::{Aabb, Affine};
use crate::real::Real;
use crate::scene::grid::{Grid, GridClass, LEAF_VOXELS, Leaf};
pub use crate::scene::topology::{BRICK, CELLS, EDGE, NONE, Topology, Voxel, slot};
use glam::{DVec3, IVec3, Vec4};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// A field on bricks, trilinear between voxel centres, zero outside: of scalars, or of the four values of a
/// pre-shaded volume (emitted radiance per world length in R, G and B, and extinction).
#[derive(Debug, Clone)]
pub struct Bricks<V> {
    /// Which bricks there are.
    pub topology: Arc<Topology>,
    /// 729 values a brick.
    pub values: Vec<V>,
    /// Index space to world space.
    pub transform: Affine,
    /// Index-space box beyond which there is nothing: a transfer function may absorb where the density is
    /// zero, inside of it. The box of all bricks' cells, or smaller.
    pub domain: Aabb,
}

/// Where the voxels of a brick come from.
#[derive(Clone, Copy)]
enum Source {
    Leaf(usize),
    Constant(f32),
}

impl<V: Voxel> Bricks<V> {
    /// A field of zeros.
    pub fn zeros(topology: Arc<Topology>, transform: Affine) -> Self {
        let values = vec![V::default(); topology.len() * BRICK];
        let domain = topology.bounds();
        Self { topology, values, transform, domain }
    }

    /// World-space box of all cells.
    pub fn world_bounds(&self) -> Aabb {
        self.transform.box_to_world(self.topology.bounds())
    }

    /// The stored values of the brick at these brick coordinates.
    pub fn brick(&self, at: IVec3) -> Option<&[V]> {
        let number = self.topology.find(at);
        (number != NONE).then(|| &self.values[number as usize * BRICK..(number as usize + 1) * BRICK])
    }

    /// The bricks' own voxels, 512 a brick, z fastest: the inverse of [`Topology::spread`].
    pub fn owned(&self) -> Vec<V> {
        let mut owned = vec![V::default(); self.topology.len() * LEAF_VOXELS];
        owned.par_chunks_mut(LEAF_VOXELS).zip(self.values.par_chunks(BRICK)).for_each(|(own, stored)| {
            own.iter_mut().enumerate().for_each(|(i, v)| *v = stored[slot(i >> 6, i >> 3 & 7, i & 7)]);
        });
        owned
    }
}

impl Bricks<Vec4> {
    /// One of the four values of a pre-shaded volume: 0 to 2 the emissions in R, G and B, 3 the extinctions.
    pub fn channel(&self, lane: usize) -> Bricks<f32> {
        Bricks {
            topology: self.topology.clone(),
            values: self.values.par_iter().map(|v| v[lane]).collect(),
            transform: self.transform,
            domain: self.domain,
        }
    }
}

impl<R: Real> Bricks<R> {
    /// Arranges a fog volume for rays, straight from its leaves and tiles.
    ///
    /// # Errors
    /// If the grid is no fog volume with background 0, carries NaN, infinite or negative values, or
    /// would need more than `max_memory` bytes.
    pub fn from_grid(grid: &Grid, max_memory: u64) -> Result<Self> {
        let named = |e: Error| e.part(format!("grid '{}'", grid.name));
        if grid.background != 0.0 {
            return Err(named(
                Error::unsupported(format!("background is {}, a fog volume has 0 outside", grid.background))
                    .hint("convert the grid to a fog volume first; a level set has its narrow band as background"),
            ));
        }
        let bad = grid
            .leaves
            .par_iter()
            .map(|l| l.values.iter().filter(|v| !(v.is_finite() && **v >= 0.0)).count())
            .sum::<usize>()
            + grid.tiles.iter().filter(|t| !(t.value.is_finite() && t.value >= 0.0)).count();
        if bad > 0 {
            return Err(named(
                Error::invalid(format!(
                    "{bad} values are NaN, infinite or negative; densities are finite and at least 0"
                ))
                .hint("`cumulo convert --repair=density` sets them to 0 and says how many there were"),
            ));
        }
        let sources = sources(grid, max_memory).map_err(named)?;
        let mut needed: BTreeSet<[i32; 3]> = BTreeSet::new();
        for (key, source) in &sources {
            for corner in 0..8 {
                let offset = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
                if touches(grid, source, offset) {
                    needed.insert(std::array::from_fn(|a| key[a] - offset[a]));
                }
            }
        }
        let bytes = needed.len() as u64 * (BRICK * size_of::<R>()) as u64;
        if bytes > max_memory {
            return Err(named(too_large(bytes, max_memory)));
        }
        let topology = Arc::new(Topology::new(needed.into_iter().map(IVec3::from_array)).map_err(named)?);
        let mut field = Self::zeros(topology.clone(), grid.transform);
        field.values.par_chunks_mut(BRICK).zip(topology.bricks().par_iter()).for_each(|(out, brick)| {
            for corner in 0..8 {
                let offset = IVec3::new(corner >> 2 & 1, corner >> 1 & 1, corner & 1);
                let Some(source) = sources.get(&(*brick + offset).to_array()) else { continue };
                let part = |a: i32| if a == 0 { 0..CELLS } else { CELLS..EDGE };
                for x in part(offset.x) {
                    for y in part(offset.y) {
                        for z in part(offset.z) {
                            let v = match source {
                                Source::Leaf(l) => grid.leaves[*l].values[(x & 7) << 6 | (y & 7) << 3 | (z & 7)],
                                Source::Constant(v) => *v,
                            };
                            out[slot(x, y, z)] = R::of(f64::from(v));
                        }
                    }
                }
            }
        });
        Ok(field)
    }

    /// The same field with all bricks of its domain, for media that absorb where the density is zero.
    ///
    /// # Errors
    /// If it would need more than `max_memory` bytes.
    pub fn filled(self, max_memory: u64) -> Result<Self> {
        if self.is_filled() {
            return Ok(self);
        }
        let (min, max) = self.domain_bricks();
        let count = (max - min).as_u64vec3();
        let bytes =
            count.x.saturating_mul(count.y).saturating_mul(count.z).saturating_mul((BRICK * size_of::<R>()) as u64);
        if bytes > max_memory {
            return Err(too_large(bytes, max_memory));
        }
        let all = (min.x..max.x).flat_map(|x| (min.y..max.y).map(move |y| (x, y)));
        let all = all.flat_map(|(x, y)| (min.z..max.z).map(move |z| IVec3::new(x, y, z)));
        let topology = Topology::new(all.chain(self.topology.bricks().iter().copied()))?;
        let mut filled = Self { domain: self.domain, ..Self::zeros(Arc::new(topology), self.transform) };
        for (brick, values) in self.topology.bricks().iter().zip(self.values.chunks(BRICK)) {
            let to = filled.topology.find(*brick) as usize * BRICK;
            filled.values[to..to + BRICK].copy_from_slice(values);
        }
        Ok(filled)
    }

    /// True if no brick of the domain is missing.
    pub fn is_filled(&self) -> bool {
        let (min, max) = self.domain_bricks();
        let inside = |b: &&IVec3| b.cmpge(min).all() && b.cmplt(max).all();
        let count = (max - min).as_i64vec3();
        self.topology.bricks().iter().filter(inside).count() as i64 == count.x * count.y * count.z
    }

    /// Coordinates of the domain's bricks: the lowest, and one past the highest.
    fn domain_bricks(&self) -> (IVec3, IVec3) {
        if self.domain.is_empty() {
            return (IVec3::ZERO, IVec3::ZERO);
        }
        ((self.domain.min / 8.0).floor().as_ivec3(), (self.domain.max / 8.0).ceil().as_ivec3())
    }

    /// Smallest and largest value (zero counts, being the value outside).
    pub fn range(&self) -> (R, R) {
        self.values
            .par_iter()
            .fold(|| (R::ZERO, R::ZERO), |(a, b), v| (a.lesser(*v), b.greater(*v)))
            .reduce(|| (R::ZERO, R::ZERO), |a, b| (a.0.lesser(b.0), a.1.greater(b.1)))
    }

    /// Values at the voxels of another lattice, 512 a brick of `topology`.
    pub fn resampled(&self, topology: &Topology, lattice: &Affine) -> Vec<R> {
        let mut out = vec![R::ZERO; topology.len() * LEAF_VOXELS];
        out.par_chunks_mut(LEAF_VOXELS).zip(topology.bricks().par_iter()).for_each(|(values, brick)| {
            for (i, v) in values.iter_mut().enumerate() {
                let local = IVec3::new((i >> 6) as i32, (i >> 3 & 7) as i32, (i & 7) as i32);
                let world = lattice.to_world((8 * *brick + local).as_dvec3());
                *v = self.sample(self.transform.to_index(world));
            }
        });
        out
    }

    /// The bricks' own voxels as a fog volume; voxels that are not positive are inactive, leaves
    /// without active voxels left out.
    pub fn to_grid(&self, name: &str) -> Grid {
        let leaves = self.topology.bricks().iter().zip(self.values.chunks(BRICK)).filter_map(|(brick, stored)| {
            let mut leaf =
                Leaf { origin: (8 * *brick).to_array(), values: Box::new([0.0; LEAF_VOXELS]), active: [0; 8] };
            for i in 0..LEAF_VOXELS {
                let value = stored[slot(i >> 6, i >> 3 & 7, i & 7)].f64() as f32;
                if value > 0.0 {
                    leaf.values[i] = value;
                    leaf.active[i >> 6] |= 1 << (i & 63);
                }
            }
            (leaf.active != [0; 8]).then_some(leaf)
        });
        Grid {
            name: name.into(),
            class: GridClass::FogVolume,
            transform: self.transform,
            background: 0.0,
            leaves: leaves.collect(),
            tiles: Vec::new(),
            metadata: BTreeMap::new(),
        }
    }

    /// World-space corners of boxes, one a brick, around the voxels that are not zero and the cells
    /// they reach into; none for an empty field.
    pub fn outline(&self) -> Vec<DVec3> {
        let boxes = self.topology.bricks().par_iter().zip(self.values.par_chunks(BRICK)).map(|(brick, stored)| {
            (0..BRICK).filter(|i| stored[*i] != R::ZERO).fold(Aabb::EMPTY, |b, i| {
                let local = IVec3::new((i / EDGE / EDGE) as i32, (i / EDGE % EDGE) as i32, (i % EDGE) as i32);
                b.including((8 * *brick + local).as_dvec3())
            })
        });
        boxes
            .filter(|b| !b.is_empty())
            .flat_map_iter(|b| Aabb { min: b.min - 1.0, max: b.max + 1.0 }.corners())
            .map(|corner| self.transform.to_world(corner))
            .collect()
    }

    /// Trilinear value at index coordinates.
    pub fn sample(&self, index: DVec3) -> R {
        let base = index.floor();
        let f = index - base;
        let base = base.as_ivec3();
        let brick = self.topology.find(IVec3::new(base.x >> 3, base.y >> 3, base.z >> 3));
        if brick == NONE {
            return R::ZERO;
        }
        let at = brick as usize * BRICK + slot((base.x & 7) as usize, (base.y & 7) as usize, (base.z & 7) as usize);
        let mut sum = R::ZERO;
        for corner in 0..8 {
            let pick = |bit: usize, v: f64| if corner >> bit & 1 == 1 { v } else { 1.0 - v };
            let w = pick(2, f.x) * pick(1, f.y) * pick(0, f.z);
            sum += R::of(w) * self.values[at + slot(corner >> 2 & 1, corner >> 1 & 1, corner & 1)];
        }
        sum
    }
}

fn too_large(bytes: u64, limit: u64) -> Error {
    Error::unsupported(format!("needs {} MiB in memory, {} MiB are allowed", bytes >> 20, limit >> 20))
        .hint("raise --max-memory, or reduce the grid with `cumulo convert --crop` or `--resample`")
}

/// Leaves and expanded tiles by brick coordinates; zero ones are left out.
fn sources(grid: &Grid, max_memory: u64) -> Result<BTreeMap<[i32; 3], Source>> {
    let mut sources = BTreeMap::new();
    for tile in grid.tiles.iter().filter(|t| t.value != 0.0) {
        let n = i64::from(tile.dim / 8);
        let bytes = (sources.len() as u64 + (n * n * n) as u64) * (BRICK * size_of::<f32>()) as u64;
        if bytes > max_memory {
            return Err(too_large(bytes, max_memory));
        }
        let n = n as i32;
        for x in 0..n {
            for y in 0..n {
                for z in 0..n {
                    let o = tile.origin;
                    sources.insert(
                        [o[0].div_euclid(8) + x, o[1].div_euclid(8) + y, o[2].div_euclid(8) + z],
                        Source::Constant(tile.value),
                    );
                }
            }
        }
    }
    for (i, leaf) in grid.leaves.iter().enumerate() {
        if leaf.values.iter().any(|v| *v != 0.0) {
            sources.insert(leaf.origin.map(|c| c.div_euclid(8)), Source::Leaf(i));
        }
    }
    Ok(sources)
}

/// True if a voxel that is not zero lies on the low faces named by `offset` (all voxels for none).
fn touches(grid: &Grid, source: &Source, offset: [i32; 3]) -> bool {
    match source {
        Source::Constant(_) => true,
        Source::Leaf(l) => {
            let end = |a: usize| if offset[a] == 1 { 1 } else { CELLS };
            let values = &grid.leaves[*l].values;
            (0..end(0)).any(|x| (0..end(1)).any(|y| (0..end(2)).any(|z| values[x << 6 | y << 3 | z] != 0.0)))
        }
    }
}
