//! Fields on sparse bricks with an apron: the layout of a scalar grid for ray traversal.
//!
//! A voxel on the low face of a leaf also takes part in cells of the neighbours below. Those bricks exist whenever such
//! a voxel is not the background, even where the file has no leaf.
//!
//! [`Bricks::from_grid`] stores separate values for every brick. [`Bricks::instanced`] stores the bricks of constant
//! tiles once, for readers that never change a value. Both take densities, which are 0 where voxels are missing and
//! never negative. [`Bricks::from_values`] and [`Bricks::instanced_values`] take values of any sign and background,
//! such as Hounsfield units, for media with a transfer function in the data's own units.

use crate::error::{Code, Error, Result};
use crate::math::{Aabb, Affine};
use crate::real::{Real, extremes};
use crate::scene::grid::{Grid, GridClass, LEAF_VOXELS, Leaf};
use crate::scene::sources::Sources;
use crate::scene::topology;
pub use crate::scene::topology::CELLS;
pub use crate::scene::topology::{BRICK, EDGE, NONE, Topology, Voxel, slot};
use glam::{DVec3, IVec3, Vec4};
use rayon::prelude::*;
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// A field on bricks, trilinear between voxel centres and the background outside.
/// The values are scalars, or the four of a pre-shaded volume: emitted radiance per world length in R, G and B, and
/// extinction.
#[derive(Debug, Clone)]
pub struct Bricks<V> {
    /// The bricks of the field and their places.
    pub topology: Arc<Topology>,
    /// Stored values, [`BRICK`] = 729 per brick, indexed by brick number and [`slot`].
    pub values: Vec<V>,
    /// Stored value of voxels that are missing; 0 for densities.
    pub background: V,
    /// Value of the data that a stored 0 stands for: stored values are differences to it. It is 0 unless the data's
    /// values lie much farther from 0 than from each other, which single precision could not tell apart.
    pub reference: f64,
    /// Map from index space to world space.
    pub transform: Affine,
    /// Index-space box outside which the medium is empty; inside, a transfer function may absorb even where the density
    /// is zero. By default it is the box of all bricks' cells.
    pub domain: Aabb,
}

/// Bytes per brick beside its values during construction: entries in ordered sets.
const OVERHEAD: u64 = 64;

impl<V: Voxel> Bricks<V> {
    /// A field of zeros whose domain is the box of all cells.
    pub fn zeros(topology: Arc<Topology>, transform: Affine) -> Self {
        Self::constant(topology, transform, V::default(), 0.0)
    }

    /// A field of its background whose domain is the box of all cells.
    fn constant(topology: Arc<Topology>, transform: Affine, background: V, reference: f64) -> Self {
        let values = vec![background; topology.len() * BRICK];
        let domain = topology.bounds();
        Self { topology, values, background, reference, transform, domain }
    }

    /// A field like this one, of its background on other bricks.
    fn emptied(&self, topology: Topology) -> Self {
        let empty = Self::constant(Arc::new(topology), self.transform, self.background, self.reference);
        Self { domain: self.domain, ..empty }
    }

    /// World-space box of all cells.
    pub fn world_bounds(&self) -> Aabb {
        self.transform.box_to_world(self.topology.bounds())
    }

    /// The 729 stored values of the brick at brick coordinates `at`; `None` if there is no such brick.
    pub fn brick(&self, at: IVec3) -> Option<&[V]> {
        let number = self.topology.find(at);
        (number != NONE).then(|| &self.values[number as usize * BRICK..(number as usize + 1) * BRICK])
    }

    /// The voxels that bricks own, 512 per brick with z fastest: the inverse of [`Topology::fill_apron`].
    pub fn owned(&self) -> Vec<V> {
        let mut owned = vec![V::default(); self.topology.len() * LEAF_VOXELS];
        owned.par_chunks_mut(LEAF_VOXELS).zip(self.values.par_chunks(BRICK)).for_each(|(own, stored)| {
            own.iter_mut().enumerate().for_each(|(i, v)| *v = stored[slot(i >> 6, i >> 3 & 7, i & 7)]);
        });
        owned
    }
}

impl<V> Bricks<V> {
    /// Returns the places in [`Bricks::values`] of the eight voxels around index coordinates, and their weights by
    /// trilinear interpolation; `None` outside the bricks.
    #[inline(always)]
    pub fn corners(&self, index: DVec3) -> Option<[(usize, f64); 8]> {
        self.corners_of(index.floor(), index)
    }

    /// Returns the places of the eight voxels around the cell with this lowest corner, and their weights at index
    /// coordinates in it; `None` outside the bricks.
    #[inline(always)]
    fn corners_of(&self, base: DVec3, index: DVec3) -> Option<[(usize, f64); 8]> {
        let f = index - base;
        let base = base.as_ivec3();
        let brick = self.topology.find(base >> 3);
        if brick == NONE {
            return None;
        }
        let at = brick as usize * BRICK + slot((base.x & 7) as usize, (base.y & 7) as usize, (base.z & 7) as usize);
        Some(std::array::from_fn(|corner| {
            let pick = |bit: usize, v: f64| if corner >> bit & 1 == 1 { v } else { 1.0 - v };
            let weight = pick(2, f.x) * pick(1, f.y) * pick(0, f.z);
            (at + slot(corner >> 2 & 1, corner >> 1 & 1, corner & 1), weight)
        }))
    }
}

impl Bricks<Vec4> {
    /// One of the four values of a pre-shaded volume as a scalar field: lanes 0 to 2 are the emission in R, G and B,
    /// lane 3 the extinction.
    pub fn channel(&self, lane: usize) -> Bricks<f32> {
        Bricks {
            topology: self.topology.clone(),
            values: self.values.par_iter().map(|v| v[lane]).collect(),
            background: self.background[lane],
            reference: self.reference,
            transform: self.transform,
            domain: self.domain,
        }
    }
}

impl<R: Real> Bricks<R> {
    /// Arranges the leaves and tiles of a fog volume in bricks, each with separate values.
    ///
    /// # Errors
    /// If the grid is no fog volume with background 0, if a value is NaN, infinite, negative or above
    /// `MOST_DENSITY`, or if the grid and its bricks together would need more than
    /// `max_memory` bytes.
    pub fn from_grid(grid: &Grid, max_memory: u64) -> Result<Self> {
        Self::separate(grid, Sources::densities(grid), max_memory)
    }

    /// Arranges the leaves and tiles of a grid of any values in bricks, each with separate values.
    ///
    /// # Errors
    /// If a value or the background is NaN, infinite or beyond `MOST_DENSITY`, or if the grid and its bricks together
    /// would need more than `max_memory` bytes.
    pub fn from_values(grid: &Grid, max_memory: u64) -> Result<Self> {
        Self::separate(grid, Sources::values(grid), max_memory)
    }

    fn separate(grid: &Grid, sources: Result<Sources<'_>>, max_memory: u64) -> Result<Self> {
        let named = |e: Error| e.part(format!("grid '{}'", grid.name));
        let sources = sources.map_err(named)?;
        let each = (BRICK * size_of::<R>()) as u64 + OVERHEAD;
        let within = |bytes: u64| if bytes > max_memory { Err(named(too_large(bytes, max_memory))) } else { Ok(()) };
        let held = grid.memory() + sources.memory();
        // The bricks of giant tiles are counted before they are listed, because not even their list would fit.
        within(held.saturating_add(sources.tile_bricks().saturating_mul(each)))?;
        let mut needed = sources.needed_by_leaves();
        for (low, high) in sources.tile_boxes() {
            needed.extend(boxed(low, high).map(|b| b.to_array()));
        }
        let (low, high) = bounds(needed.iter().copied().map(IVec3::from_array));
        let entries = if needed.is_empty() { 0 } else { topology::table_entries(low, high).map_err(named)? };
        within(held + needed.len() as u64 * each + 4 * entries as u64)?;
        let topology = Arc::new(Topology::new(needed.into_iter().map(IVec3::from_array)).map_err(named)?);
        let mut field = Self::constant(topology.clone(), grid.transform, sources.background(), sources.reference);
        let stored = field.values.par_chunks_mut(BRICK).zip(topology.bricks().par_iter());
        stored.for_each(|(out, brick)| sources.fill(*brick, out));
        Ok(field)
    }

    /// Arranges a fog volume in bricks for reading only: equal bricks that no leaf reaches into are stored once.
    /// Radiance along a ray is bit-identical to that with [`Bricks::from_grid`].
    ///
    /// # Errors
    /// The conditions are those of [`Bricks::from_grid`].
    pub fn instanced(grid: &Grid, max_memory: u64) -> Result<Self> {
        Self::shared(grid, Sources::densities(grid), max_memory)
    }

    /// Arranges a grid of any values in bricks for reading only, as [`Bricks::instanced`] does.
    ///
    /// # Errors
    /// The conditions are those of [`Bricks::from_values`].
    pub fn instanced_values(grid: &Grid, max_memory: u64) -> Result<Self> {
        Self::shared(grid, Sources::values(grid), max_memory)
    }

    fn shared(grid: &Grid, sources: Result<Sources<'_>>, max_memory: u64) -> Result<Self> {
        let named = |e: Error| e.part(format!("grid '{}'", grid.name));
        let sources = sources.map_err(named)?;
        let each = (BRICK * size_of::<R>()) as u64 + OVERHEAD;
        let own = sources.needed_by_leaves();
        let corners = sources.tile_boxes().flat_map(|(low, high)| [low, high]);
        let (min, max) = bounds(own.iter().copied().map(IVec3::from_array).chain(corners));
        if !min.cmple(max).all() {
            let topology = Arc::new(Topology::from_table(IVec3::ZERO, IVec3::ZERO, vec![], vec![]));
            return Ok(Self::constant(topology, grid.transform, sources.background(), sources.reference));
        }
        let entries = topology::table_entries(min, max).map_err(named)?;
        let needed = grid.memory() + sources.memory() + own.len() as u64 * each + 4 * entries as u64;
        if needed > max_memory {
            return Err(named(too_large(needed, max_memory)));
        }
        let dim = max - min + 1;
        let row = |x: i32, y: i32| ((x - min.x) as usize * dim.y as usize + (y - min.y) as usize) * dim.z as usize;
        let mut table = vec![NONE; entries];
        let mut places: Vec<IVec3> = own.into_iter().map(IVec3::from_array).collect();
        let leaves = places.len();
        for (number, b) in places.iter().enumerate() {
            table[row(b.x, b.y) + (b.z - min.z) as usize] = number as u32;
        }
        // A brick of constants is determined by eight numbers, one for each brick that it reaches into.
        let mut alike: HashMap<[u32; 8], u32> = HashMap::new();
        for (low, high) in sources.tile_boxes() {
            // Away from the tile's faces all eight constants are the tile's value.
            let inside = |a: i32, low: i32, high: i32| a > low && a < high;
            for x in low.x..=high.x {
                for y in low.y..=high.y {
                    let whole = inside(x, low.x, high.x) && inside(y, low.y, high.y);
                    let mut z = low.z;
                    while z <= high.z {
                        let end = if whole && inside(z, low.z, high.z) { high.z - 1 } else { z };
                        let at = row(x, y) + (z - min.z) as usize;
                        let run = &mut table[at..=at + (end - z) as usize];
                        if run.contains(&NONE) {
                            let place = IVec3::new(x, y, z);
                            let number =
                                *alike.entry(sources.constants(place).map(f32::to_bits)).or_insert_with(|| {
                                    places.push(place);
                                    places.len() as u32 - 1
                                });
                            run.iter_mut().filter(|n| **n == NONE).for_each(|n| *n = number);
                        }
                        z = end + 1;
                    }
                }
            }
        }
        topology::addressable(places.len()).map_err(named)?;
        let bytes = needed + (places.len() - leaves) as u64 * each;
        if bytes > max_memory {
            return Err(named(too_large(bytes, max_memory)));
        }
        let topology = Arc::new(Topology::from_table(min, dim, table, places));
        let mut field = Self::constant(topology.clone(), grid.transform, sources.background(), sources.reference);
        let stored = field.values.par_chunks_mut(BRICK).zip(topology.bricks().par_iter());
        stored.for_each(|(out, brick)| sources.fill(*brick, out));
        Ok(field)
    }

    /// Copies an instanced field into one with separate values for every place; other fields are returned unchanged.
    ///
    /// # Errors
    /// If old and new field together would need more than `max_memory` bytes.
    pub fn expanded(self, max_memory: u64) -> Result<Self> {
        if !self.topology.is_instanced() {
            return Ok(self);
        }
        let stored = size_of_val(self.values.as_slice()) as u64 + self.topology.table_bytes();
        let count = self.topology.places().count() as u64;
        let bytes = stored + self.topology.table_bytes() + count * ((BRICK * size_of::<R>()) as u64 + OVERHEAD);
        if bytes > max_memory {
            return Err(too_large(bytes, max_memory));
        }
        let mut own = self.emptied(Topology::new(self.topology.places().map(|(place, _)| place))?);
        own.values.par_chunks_mut(BRICK).zip(own.topology.bricks().par_iter()).for_each(|(out, brick)| {
            if let Some(values) = self.brick(*brick) {
                out.copy_from_slice(values);
            }
        });
        Ok(own)
    }

    /// Adds the missing bricks of the domain, for media that absorb at the background. An instanced field stores the
    /// added bricks once.
    ///
    /// # Errors
    /// If old and new field together would need more than `max_memory` bytes.
    pub fn filled(self, max_memory: u64) -> Result<Self> {
        if self.is_filled() {
            return Ok(self);
        }
        if self.topology.is_instanced() {
            return self.filled_instanced(max_memory);
        }
        let (min, max) = self.domain_bricks();
        let count = (max.as_i64vec3() - min.as_i64vec3()).as_u64vec3();
        let stored = size_of_val(self.values.as_slice()) as u64 + self.topology.table_bytes();
        let each = (BRICK * size_of::<R>()) as u64 + OVERHEAD;
        let bytes = count.x.saturating_mul(count.y).saturating_mul(count.z).saturating_mul(each).saturating_add(stored);
        if bytes > max_memory {
            return Err(too_large(bytes, max_memory));
        }
        let all = (min.x..max.x).flat_map(|x| (min.y..max.y).map(move |y| (x, y)));
        let all = all.flat_map(|(x, y)| (min.z..max.z).map(move |z| IVec3::new(x, y, z)));
        let topology = Topology::new(all.chain(self.topology.bricks().iter().copied()))?;
        let mut filled = self.emptied(topology);
        for (brick, values) in self.topology.bricks().iter().zip(self.values.chunks(BRICK)) {
            let to = filled.topology.find(*brick) as usize * BRICK;
            filled.values[to..to + BRICK].copy_from_slice(values);
        }
        Ok(filled)
    }

    fn filled_instanced(mut self, max_memory: u64) -> Result<Self> {
        let (min, max) = self.domain_bricks();
        let (low, high) = bounds([min, max - 1].into_iter().chain(self.topology.places().map(|(place, _)| place)));
        let entries = topology::table_entries(low, high)?;
        // The value array grows by one brick and may be reallocated, hence twice its size.
        let values = size_of_val(self.values.as_slice()) as u64 + (BRICK * size_of::<R>()) as u64;
        let bytes = 2 * values + self.topology.table_bytes() + 4 * entries as u64;
        if bytes > max_memory {
            return Err(too_large(bytes, max_memory));
        }
        let dim = high - low + 1;
        let at = |b: IVec3| {
            let b = b - low;
            (b.x as usize * dim.y as usize + b.y as usize) * dim.z as usize + b.z as usize
        };
        let mut table = vec![NONE; entries];
        for (start, numbers) in self.topology.rows() {
            // A row that is not empty starts inside the new box, because the box includes all bricks.
            let there = numbers.iter().enumerate().filter(|(_, number)| **number != NONE);
            there.for_each(|(z, number)| table[at(start + IVec3::new(0, 0, z as i32))] = *number);
        }
        let empty = self.topology.len() as u32;
        let mut first = None;
        for x in min.x..max.x {
            for y in min.y..max.y {
                let from = at(IVec3::new(x, y, min.z));
                let row = &mut table[from..from + (max.z - min.z) as usize];
                for (z, number) in row.iter_mut().enumerate().filter(|(_, number)| **number == NONE) {
                    first.get_or_insert(IVec3::new(x, y, min.z + z as i32));
                    *number = empty;
                }
            }
        }
        let mut bricks = self.topology.bricks().to_vec();
        if let Some(first) = first {
            bricks.push(first);
            topology::addressable(bricks.len())?;
            self.values.resize(bricks.len() * BRICK, self.background);
        }
        self.topology = Arc::new(Topology::from_table(low, dim, table, bricks));
        Ok(self)
    }

    /// True if every brick of the domain is present.
    pub fn is_filled(&self) -> bool {
        let (min, max) = self.domain_bricks();
        let inside = |b: &IVec3| b.cmpge(min).all() && b.cmplt(max).all();
        let count = (max.as_i64vec3() - min.as_i64vec3()).to_array();
        let there = if self.topology.is_instanced() {
            self.topology.places().filter(|(place, _)| inside(place)).count()
        } else {
            self.topology.bricks().iter().filter(|b| inside(b)).count()
        };
        count.into_iter().try_fold(1, |product: i64, n| product.checked_mul(n)) == Some(there as i64)
    }

    /// Brick coordinates of the domain: the lowest, and one past the highest.
    fn domain_bricks(&self) -> (IVec3, IVec3) {
        if self.domain.is_empty() {
            return (IVec3::ZERO, IVec3::ZERO);
        }
        ((self.domain.min / 8.0).floor().as_ivec3(), (self.domain.max / 8.0).ceil().as_ivec3())
    }

    /// Smallest and largest stored value; the background is included, as it is the value outside.
    pub fn range(&self) -> (R, R) {
        let outside = (self.background, self.background);
        self.ranges().iter().fold(outside, |found, [low, high]| (found.0.lesser(*low), found.1.greater(*high)))
    }

    /// Smallest and largest stored value of each brick.
    pub(crate) fn ranges(&self) -> Vec<[R; 2]> {
        let of_brick = |values: &[R]| extremes(values).map_or([R::ZERO; 2], |(low, high)| [low, high]);
        self.values.par_chunks(BRICK).map(of_brick).collect()
    }

    /// Smallest and largest value of the data among the voxels that rays interpolate between: those of the domain, and
    /// the background where bricks of it are missing. Of bricks that lie in several places one place counts.
    pub fn seen_range(&self) -> [f64; 2] {
        let (first, last) = (self.domain.min.floor(), self.domain.max.ceil());
        let of_brick = |(brick, values): (&IVec3, &[R])| {
            let shown = (0..BRICK).filter(|i| {
                let at = (8 * *brick
                    + IVec3::from_array([i / EDGE / EDGE, i / EDGE % EDGE, i % EDGE].map(|v| v as i32)))
                .as_dvec3();
                at.cmpge(first).all() && at.cmple(last).all()
            });
            shown.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], i| [a.min(values[i].f64()), b.max(values[i].f64())])
        };
        let widest = |a: [f64; 2], b: [f64; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        let bricks = self.topology.bricks().par_iter().zip(self.values.par_chunks(BRICK));
        let of_bricks = bricks.map(of_brick).reduce(|| [f64::INFINITY, f64::NEG_INFINITY], widest);
        let seen = if self.is_filled() { of_bricks } else { widest(of_bricks, [self.background.f64(); 2]) };
        seen.map(|stored| self.reference + stored)
    }

    /// Samples the field at the voxels of another lattice (index to world): 512 values per brick of `topology`, z
    /// fastest.
    pub(crate) fn resampled(&self, topology: &Topology, lattice: &Affine) -> Vec<R> {
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

    /// A fog volume named `name` of the densities of the voxels that bricks own. Voxels that are not positive are
    /// inactive; leaves without active voxels are left out.
    pub fn to_grid(&self, name: &str) -> Grid {
        let leaves = self.topology.places().filter_map(|(brick, number)| {
            let stored = &self.values[number as usize * BRICK..(number as usize + 1) * BRICK];
            let mut leaf = Leaf { origin: (8 * brick).to_array(), values: [0.0; LEAF_VOXELS], active: [0; 8] };
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

    /// Derivatives of the interpolated value with respect to the index coordinates. On the
    /// face between two cells they are those of the higher one.
    pub fn slopes(&self, index: DVec3) -> DVec3 {
        let cell = index.floor();
        let at = |d: DVec3| self.sample(cell + d).f64();
        let t = index - cell;
        let slope = |axis: usize| {
            let (mut sum, step) = (0.0, DVec3::AXES[axis]);
            for corner in 0..4 {
                let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
                let mut from = DVec3::ZERO;
                (from[b], from[c]) = (f64::from(corner & 1), f64::from(corner >> 1));
                let weight = |axis: usize| if from[axis] == 1.0 { t[axis] } else { 1.0 - t[axis] };
                sum += weight(b) * weight(c) * (at(from + step) - at(from));
            }
            sum
        };
        DVec3::new(slope(0), slope(1), slope(2))
    }

    /// Trilinearly interpolated stored value at index coordinates; the background outside the bricks.
    pub fn sample(&self, index: DVec3) -> R {
        self.interpolated(self.corners(index))
    }

    /// Value at the end of a ray, on a face of the domain. Rounding may place it beyond the face, where there need not
    /// be bricks: the cell is one within the domain.
    pub(crate) fn sample_at_end(&self, index: DVec3) -> R {
        let Aabb { min, max } = self.domain;
        let index = index.clamp(min, max);
        let first = min.floor();
        self.interpolated(self.corners_of(index.floor().clamp(first, first.max(max.ceil() - 1.0)), index))
    }

    #[inline(always)]
    fn interpolated(&self, corners: Option<[(usize, f64); 8]>) -> R {
        let Some(corners) = corners else { return self.background };
        let mut sum = R::ZERO;
        for (voxel, weight) in corners {
            sum += R::of(weight) * self.values[voxel];
        }
        sum
    }
}

/// The error that `bytes` of memory are needed where `limit` are allowed.
pub fn too_large(bytes: u64, limit: u64) -> Error {
    Error::unsupported(format!("needs {} MiB in memory, {} MiB are allowed", bytes.div_ceil(1 << 20), limit >> 20))
        .coded(Code::MemoryLimit)
        .hint("raise ⟨max_memory⟩, or reduce the grid with ⟨convert.crop⟩ or ⟨convert.resample⟩")
}

/// All brick coordinates from `low` to `high`, both included.
fn boxed(low: IVec3, high: IVec3) -> impl Iterator<Item = IVec3> {
    let columns = (low.x..=high.x).flat_map(move |x| (low.y..=high.y).map(move |y| (x, y)));
    columns.flat_map(move |(x, y)| (low.z..=high.z).map(move |z| IVec3::new(x, y, z)))
}

/// Lowest and highest coordinates per axis; the lowest exceed the highest if there are no bricks.
fn bounds(bricks: impl Iterator<Item = IVec3>) -> (IVec3, IVec3) {
    bricks.fold((IVec3::MAX, IVec3::MIN), |(low, high), b| (low.min(b), high.max(b)))
}
