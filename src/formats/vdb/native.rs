//! A grid on the native side: any type OpenVDB knows, with its transform and metadata untouched.

use super::ffi;
use super::meta::Meta;
use crate::error::{Error, Result};
use crate::math::{Aabb, Affine};
use crate::scene::bricks::too_large;
use crate::scene::grid::{Grid, GridClass, LEAF_VOXELS, Leaf, MetaValue, Tile};
use glam::{DMat3, DMat4, DVec3};
use rayon::prelude::*;
use std::collections::{BTreeMap, HashSet};
use std::marker::PhantomData;
use std::ptr::{NonNull, null, null_mut};

/// A grid owned by the native library.
#[derive(Debug)]
pub struct NativeGrid {
    raw: NonNull<ffi::RawGrid>,
    name: String,
}

// SAFETY: a grid is tied to no thread; all mutation takes `&mut self`.
unsafe impl Send for NativeGrid {}

/// Transform of a grid from index space to world space.
#[derive(Debug, Clone, PartialEq)]
// There is one transform per grid, so its size does not matter.
#[allow(clippy::large_enum_variant)]
pub enum Transform {
    /// An invertible affine map.
    Affine(Affine),
    /// Any other map, such as a frustum, by OpenVDB's name.
    Other(String),
}

/// Properties of a grid without its values.
#[derive(Debug, Clone, PartialEq)]
pub struct GridInfo {
    /// Name of the grid, unique within the file it came from.
    pub name: String,
    /// Type of the values: `float`, `vec3s`, `ptdataidx32` and the like.
    pub value_type: String,
    /// Type of the tree: `Tree_float_5_4_3`.
    pub grid_type: String,
    /// Meaning of the values.
    pub class: GridClass,
    /// Map from index space to world space.
    pub transform: Transform,
    /// OpenVDB's name of the map (`UniformScaleMap`, ...).
    pub map_type: String,
    /// True if files store the values as 16-bit floats.
    pub half: bool,
    /// Number of components: 1 or 3 where values can be read, 0 for grids that are only passed through.
    pub components: usize,
    /// Value outside leaves and tiles, one number per component.
    pub background: Vec<f64>,
    /// Number of active voxels, those of active tiles included.
    pub active_voxels: u64,
    /// Inclusive box of active voxels in index space; `None` if there are none.
    pub index_box: Option<([i32; 3], [i32; 3])>,
    /// Number of leaves of 8³ voxels.
    pub leaf_count: u64,
    /// Number of active tiles: constant blocks above the leaf level.
    pub active_tiles: u64,
    /// Bytes of memory that the grid occupies.
    pub memory: u64,
}

impl GridInfo {
    /// Bytes of memory that a leaf occupies on the native side, the allocator's share included.
    pub fn leaf_bytes(&self) -> u64 {
        let value = match self.value_type.as_str() {
            "bool" | "mask" => return 208,
            "double" | "int64" => 8,
            "vec3d" => 24,
            "vec3s" | "vec3i" => 12,
            _ => 4,
        };
        512 * value + 160
    }

    /// World-space box around the active voxels' cells (half a voxel beyond their centres); `None` if there are none or
    /// the transform is not affine.
    pub(crate) fn world_box(&self) -> Option<Aabb> {
        let (Transform::Affine(map), Some((min, max))) = (&self.transform, self.index_box) else { return None };
        let corner = |c: [i32; 3]| DVec3::from_array(c.map(f64::from));
        Some(map.box_to_world(Aabb { min: corner(min) - 0.5, max: corner(max) + 0.5 }))
    }
    /// Affine map of the grid.
    ///
    /// # Errors
    /// If the transform is not affine; the error names it and a remedy.
    pub fn affine(&self) -> Result<Affine> {
        match &self.transform {
            Transform::Affine(map) => Ok(*map),
            Transform::Other(kind) => {
                Err(Error::unsupported(format!("the grid has a {kind}, an affine transform is needed"))
                    .part(format!("grid '{}'", self.name))
                    .hint("resample the grid onto a linear transform first, e.g. in Houdini with VDB Resample"))
            }
        }
    }
}

/// Checks that OpenVDB can write a grid with this transform, before work whose result would be lost. OpenVDB refuses
/// determinants below 3e-15 (voxels of about 1e-5), except for a uniform scale about the origin.
///
/// # Errors
/// If OpenVDB cannot write it; the error states the determinant and a remedy.
pub fn writable(transform: &Affine) -> Result<()> {
    const LEAST: f64 = 3e-15;
    let matrix = transform.matrix();
    let determinant = DMat3::from_mat4(matrix).determinant();
    let uniform = DMat4::from_scale(DVec3::splat(matrix.x_axis.x));
    if determinant.abs() >= LEAST || matrix == uniform {
        return Ok(());
    }
    let voxel = transform.voxel_size();
    Err(Error::unsupported(format!(
        "voxels of {:e} x {:e} x {:e} are too small for OpenVDB to write (determinant {:e}, at least {LEAST:e} is \
         needed)",
        voxel.x,
        voxel.y,
        voxel.z,
        determinant.abs()
    ))
    .hint(
        "scale the scene up; voxels as small as these can only be cubes along the axes, with voxel (0, 0, 0) at the \
           origin",
    ))
}

/// A leaf of 8³ voxels with all components: `values[i * components + c]` with `i = (x << 6) | (y << 3) | z`.
#[derive(Debug, Clone, PartialEq)]
pub struct RawLeaf {
    /// Index coordinates of the first voxel.
    pub origin: [i32; 3],
    /// Values of all voxels, components interleaved.
    pub values: Vec<f32>,
    /// Activity mask: bit `i & 63` of word `i >> 6` is set if voxel `i` is active.
    pub active: [u64; 8],
}

/// A tile with all components, of which the first ones of three are used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RawTile {
    /// Index coordinates of the first voxel.
    pub origin: [i32; 3],
    /// Edge length in voxels.
    pub dim: i32,
    /// Value of every voxel; unused components are zero.
    pub value: [f32; 3],
    /// True if the tile's voxels count as active.
    pub active: bool,
}

/// A grid of one or three components in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct RawGrid {
    /// Number of values per voxel.
    pub components: usize,
    /// Leaves in ascending order of origin.
    pub leaves: Vec<RawLeaf>,
    /// Tiles in ascending order of origin.
    pub tiles: Vec<RawTile>,
}

/// Sorted list of a grid's leaves on the native side. It borrows the grid, because an edit could free the leaves.
struct Leaves<'g> {
    raw: NonNull<ffi::RawLeaves>,
    count: usize,
    components: usize,
    grid: PhantomData<&'g NativeGrid>,
}

// SAFETY: copying a leaf only reads, and the grid that it borrows is not edited meanwhile.
unsafe impl Sync for Leaves<'_> {}

impl Leaves<'_> {
    /// Copies the values of a leaf, components interleaved, and returns its origin and active mask.
    ///
    /// # Errors
    /// If there is no leaf of that number, or `values` has less room than a leaf needs.
    fn copy(&self, index: usize, values: &mut [f32]) -> Result<([i32; 3], [u64; 8])> {
        let (mut origin, mut active) = ([0; 3], [0; 8]);
        if index >= self.count || values.len() < LEAF_VOXELS * self.components {
            return Err(Error::native(format!(
                "leaf {index} of {} does not fit in {} values, {} a voxel",
                self.count,
                values.len(),
                self.components
            )));
        }
        // SAFETY: the leaf is there, `values` has room for all its components, and the origin and the mask are as long
        // as the shim expects.
        ffi::call(|s| unsafe {
            ffi::leaves_copy(
                self.raw.as_ptr(),
                index,
                origin.as_mut_ptr(),
                values.as_mut_ptr(),
                values.len(),
                active.as_mut_ptr(),
                s,
            )
        })?;
        Ok((origin, active))
    }
}

impl Drop for Leaves<'_> {
    /// Releases the list and its reference to the grid.
    fn drop(&mut self) {
        // SAFETY: owned, and freed once.
        unsafe { ffi::leaves_free(self.raw.as_ptr()) }
    }
}

/// A view of a grid's metadata, which borrows the grid.
struct MetaView<'g> {
    meta: Meta,
    grid: PhantomData<&'g NativeGrid>,
}

/// A view that can change a grid's metadata, which borrows the grid exclusively.
struct MetaViewMut<'g> {
    meta: Meta,
    grid: PhantomData<&'g mut NativeGrid>,
}

impl NativeGrid {
    /// Takes ownership of a raw handle; a null pointer is an error.
    ///
    /// # Safety
    /// `raw` must come from the shim and be owned by nobody else.
    pub(super) unsafe fn own(raw: *mut ffi::RawGrid, name: String) -> Result<Self> {
        let raw = NonNull::new(raw).ok_or_else(|| Error::native("no grid handle"))?;
        Ok(Self { raw, name })
    }

    pub(super) fn as_ptr(&self) -> *mut ffi::RawGrid {
        self.raw.as_ptr()
    }

    fn place(&self) -> impl Fn(Error) -> Error + '_ {
        |e| e.part(format!("grid '{}'", self.name))
    }

    /// Name of the grid, unique within the file it came from.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Properties of the grid. The tree is walked once for boxes and counts.
    ///
    /// # Errors
    /// If OpenVDB reports an error, or the transform is singular.
    pub fn info(&self) -> Result<GridInfo> {
        let mut info = ffi::Info { grid_type: [0; 128], ..ffi::Info::default() };
        // SAFETY: the grid is alive and `info` a valid place.
        ffi::call(|s| unsafe { ffi::grid_info(self.as_ptr(), &mut info, s) }).map_err(self.place())?;
        let map_type = ffi::text(&info.map_type);
        let transform = if info.linear != 0 {
            // Row vectors in row order are column vectors in column order: no transposition needed.
            Transform::Affine(Affine::new(DMat4::from_cols_array(&info.matrix)).map_err(self.place())?)
        } else {
            Transform::Other(map_type.clone())
        };
        let components = info.components.clamp(0, 3) as usize;
        // An empty grid's box is (INT_MAX, INT_MIN).
        let filled = (0..3).all(|a| info.box_min[a] <= info.box_max[a]);
        Ok(GridInfo {
            name: self.name.clone(),
            value_type: ffi::text(&info.value_type),
            grid_type: ffi::text(&info.grid_type),
            class: match info.grid_class {
                1 => GridClass::LevelSet,
                2 => GridClass::FogVolume,
                3 => GridClass::Staggered,
                _ => GridClass::Unknown,
            },
            transform,
            map_type,
            half: info.saved_as_half != 0,
            components,
            background: info.background[..components].to_vec(),
            active_voxels: info.active_voxels,
            index_box: filled.then_some((info.box_min, info.box_max)),
            leaf_count: info.leaf_count,
            active_tiles: info.active_tiles,
            memory: info.memory,
        })
    }

    fn native_metadata(&self) -> Result<MetaView<'_>> {
        self.view().map(|meta| MetaView { meta, grid: PhantomData })
    }

    fn native_metadata_mut(&mut self) -> Result<MetaViewMut<'_>> {
        self.view().map(|meta| MetaViewMut { meta, grid: PhantomData })
    }

    fn view(&self) -> Result<Meta> {
        let mut raw = null_mut();
        // SAFETY: the grid is alive and `raw` a valid place for the handle.
        ffi::call(|s| unsafe { ffi::grid_meta(self.as_ptr(), &mut raw, s) }).map_err(self.place())?;
        // SAFETY: fresh from the shim.
        unsafe { Meta::own(raw) }.ok_or_else(|| Error::native("no metadata handle"))
    }

    /// Metadata of the grid, including the entries that OpenVDB itself maintains.
    ///
    /// # Errors
    /// If OpenVDB reports an error.
    pub fn metadata(&self) -> Result<BTreeMap<String, MetaValue>> {
        self.native_metadata()?.meta.entries().map_err(self.place())
    }

    /// Sets or replaces one metadata entry.
    ///
    /// # Errors
    /// If OpenVDB has no type for the value's shape.
    pub fn set_metadata(&mut self, name: &str, value: &MetaValue) -> Result<()> {
        self.native_metadata_mut()?.meta.set(name, value).map_err(self.place())
    }

    /// Removes metadata entries that OpenVDB itself maintains (`class`, `file_compression`, ...) if they have another
    /// type than it gives them, because it cannot write the grid with them. Returns the number of entries removed, and
    /// the name of one.
    ///
    /// # Errors
    /// If OpenVDB reports an error.
    pub(crate) fn mend_metadata(&mut self) -> Result<(u64, String)> {
        let (mut dropped, mut first) = (0, [0; 64]);
        // SAFETY: the grid is alive, and both are valid places.
        ffi::call(|s| unsafe { ffi::grid_mend_meta(self.as_ptr(), &mut dropped, &mut first, s) })
            .map_err(self.place())?;
        Ok((dropped, ffi::text(&first)))
    }

    /// Renames the grid.
    ///
    /// # Errors
    /// If the name contains a NUL byte.
    pub(crate) fn set_name(&mut self, name: &str) -> Result<()> {
        self.set_stored_name(name)?;
        self.name = name.to_owned();
        Ok(())
    }

    /// Sets the name under which the grid is written, but not the one that errors mention.
    pub(super) fn set_stored_name(&mut self, name: &str) -> Result<()> {
        let c = ffi::c_name(name)?;
        // SAFETY: the grid is alive and the name NUL-terminated.
        ffi::call(|s| unsafe { ffi::grid_set_name(self.as_ptr(), c.as_ptr(), s) }).map_err(self.place())
    }

    /// Sets the class of the grid, which states the meaning of its values.
    ///
    /// # Errors
    /// If OpenVDB reports an error.
    pub(crate) fn set_class(&mut self, class: GridClass) -> Result<()> {
        let code = match class {
            GridClass::Unknown => 0,
            GridClass::LevelSet => 1,
            GridClass::FogVolume => 2,
            GridClass::Staggered => 3,
        };
        // SAFETY: the grid is alive.
        ffi::call(|s| unsafe { ffi::grid_set_class(self.as_ptr(), code, s) }).map_err(self.place())
    }

    /// Sets whether files store real values as 16-bit floats.
    ///
    /// # Errors
    /// If OpenVDB reports an error.
    pub(crate) fn set_half(&mut self, half: bool) -> Result<()> {
        // SAFETY: the grid is alive.
        ffi::call(|s| unsafe { ffi::grid_set_half(self.as_ptr(), half.into(), s) }).map_err(self.place())
    }

    /// Replaces the transform from index space to world space.
    ///
    /// # Errors
    /// If [`writable`] refuses the transform, or OpenVDB reports an error.
    pub(crate) fn set_transform(&mut self, transform: &Affine) -> Result<()> {
        writable(transform).map_err(self.place())?;
        let matrix = transform.matrix().to_cols_array();
        // SAFETY: the grid is alive and the matrix has 16 entries.
        ffi::call(|s| unsafe { ffi::grid_set_matrix(self.as_ptr(), matrix.as_ptr(), s) }).map_err(self.place())
    }

    /// Sets everything outside a world-space box to the background. Under a rotated or sheared transform the box is
    /// replaced by its bounding box in index space.
    ///
    /// # Errors
    /// If the grid has no values (points).
    pub fn crop(&mut self, world: Aabb) -> Result<()> {
        let (min, max) = (world.min.to_array(), world.max.to_array());
        // SAFETY: the grid is alive and the corners have 3 entries.
        ffi::call(|s| unsafe { ffi::grid_crop(self.as_ptr(), min.as_ptr(), max.as_ptr(), s) }).map_err(self.place())
    }

    /// Replaces blocks whose values agree within `tolerance` by tiles. Level sets lose the values outside their narrow
    /// band.
    ///
    /// # Errors
    /// If the grid has no values (points).
    pub(crate) fn prune(&mut self, tolerance: f64) -> Result<()> {
        // SAFETY: the grid is alive.
        ffi::call(|s| unsafe { ffi::grid_prune(self.as_ptr(), tolerance, s) }).map_err(self.place())
    }

    /// Resamples trilinearly to cubic voxels of edge `voxel_size` in world units. The axes keep their directions, and
    /// index (0, 0, 0) its position.
    ///
    /// # Errors
    /// If the grid cannot be interpolated, its transform is not affine, or [`writable`] refuses the new one.
    pub fn resample(&mut self, voxel_size: f64) -> Result<()> {
        let (matrix, scale) = self.resampled_lattice(voxel_size)?;
        // SAFETY: the grid is alive, the matrix has 16 entries and the scale 3.
        ffi::call(|s| unsafe { ffi::grid_resample(self.as_ptr(), matrix.as_ptr(), scale.as_ptr(), s) })
            .map_err(self.place())
    }

    /// Matrix of the lattice of cubic voxels that [`NativeGrid::resample`] makes, and the factors from indices of this
    /// lattice to that one.
    pub(super) fn resampled_lattice(&self, voxel_size: f64) -> Result<([f64; 16], [f64; 3])> {
        let map = self.info()?.affine()?;
        let (m, scale) = (map.matrix(), (map.voxel_size() / voxel_size).to_array());
        let axis = |v: glam::DVec4| v * (voxel_size / v.length());
        let target = Affine::new(DMat4::from_cols(axis(m.x_axis), axis(m.y_axis), axis(m.z_axis), m.w_axis))
            .map_err(self.place())?;
        writable(&target).map_err(self.place())?;
        Ok((target.matrix().to_cols_array(), scale))
    }

    /// Estimate of the bytes that [`NativeGrid::resample`] to this voxel size needs beside the grid itself. Active
    /// voxels and tiles are resampled densely; if the bytes of all their voxels exceed `limit`, the estimate is that
    /// number.
    ///
    /// # Errors
    /// If OpenVDB reports an error, or the transform is not affine.
    pub fn resampled_bytes(&self, voxel_size: f64, limit: u64) -> Result<u64> {
        let info = self.info()?;
        let scale = info.affine()?.voxel_size() / voxel_size;
        // OpenVDB halves the resolution until a scale of at least 1/2 is left, and keeps one result while it makes the
        // next.
        let halvings = |s: f64| if s < 0.5 { (0.5 / s).log2().ceil() } else { 0.0 };
        let first = scale.map(|s| s * halvings(s).exp2());
        let mipmapped = first != scale;
        let leaf = info.leaf_bytes() as f64;
        let mut boxes = Vec::new();
        let leaves = self.leaves()?;
        let mut values = vec![0.0; LEAF_VOXELS * leaves.components];
        for index in 0..leaves.count {
            boxes.push((leaves.copy(index, &mut values).map_err(self.place())?.0, 8));
        }
        boxes.extend(self.tiles()?.iter().map(|t| (t.origin, t.dim)));
        let dense: f64 = boxes.iter().map(|(_, dim)| f64::from(*dim).powi(3)).sum::<f64>() * first.element_product();
        let bytes = dense / LEAF_VOXELS as f64 * leaf;
        if bytes.is_nan() || bytes > limit as f64 {
            return Ok(bytes.min(1e18) as u64);
        }
        // Blocks of the new lattice that a block of the old one reaches, with one voxel of interpolation on each side.
        let mut reached = HashSet::new();
        for (origin, dim) in boxes {
            let block = |voxel: i64, a: usize| (voxel as f64 * first[a] / 8.0).floor() as i32;
            let low: [i32; 3] = std::array::from_fn(|a| block(i64::from(origin[a]) - 1, a));
            let high: [i32; 3] = std::array::from_fn(|a| block(i64::from(origin[a]) + i64::from(dim), a));
            for x in low[0]..=high[0] {
                for y in low[1]..=high[1] {
                    reached.extend((low[2]..=high[2]).map(|z| [x, y, z]));
                }
            }
        }
        // Each thread makes a separate tree, and the trees are merged: leaves at their borders exist twice for a while.
        let share = if mipmapped { 2.0 } else { 1.1 };
        Ok((reached.len() as f64 * leaf * share) as u64 + (1 << 20))
    }

    /// Estimate of the bytes that [`NativeGrid::crop`] to this world-space box needs beside the grid itself. Where a
    /// tile crosses the box's faces, all blocks along them become leaves.
    ///
    /// # Errors
    /// If OpenVDB reports an error.
    pub fn cropped_bytes(&self, world: Aabb) -> Result<u64> {
        let info = self.info()?;
        let Transform::Affine(map) = info.transform else { return Ok(0) };
        if info.components == 0 {
            return Ok(0);
        }
        let index = world.corners().into_iter().fold(Aabb::EMPTY, |b, corner| b.including(map.to_index(corner)));
        // Number of blocks of edge `edge` in a tile that the box cuts: all that it meets except those wholly inside.
        let cut = |tile: &RawTile, edge: i32| {
            let (mut met, mut inside) = (1.0, 1.0);
            for a in 0..3 {
                let (low, high) = (f64::from(tile.origin[a]), f64::from(tile.origin[a]) + f64::from(tile.dim));
                let (low, high) = (low.max(index.min[a].floor()), high.min(index.max[a].floor() + 1.0));
                let edge = f64::from(edge);
                met *= ((high / edge).ceil() - (low / edge).floor()).max(0.0);
                inside *= ((high / edge).floor() - (low / edge).ceil()).max(0.0);
            }
            if met > 0.0 { met - inside } else { 0.0 }
        };
        let node = 4096.0 * 8.0 * info.components as f64 + 1200.0;
        let of = |tile: &RawTile| {
            let nodes = if tile.dim >= 128 { cut(tile, 128) * node } else { 0.0 };
            let root = if tile.dim >= 4096 { 8.0 * node } else { 0.0 };
            cut(tile, 8) * info.leaf_bytes() as f64 + nodes + root * cut(tile, 4096).min(1.0)
        };
        Ok(self.tiles()?.iter().map(of).sum::<f64>().min(1e18) as u64)
    }

    /// Sets values that are not finite to zero, and with `negative` also negative scalars. Returns the number of voxels
    /// and tiles that changed.
    ///
    /// # Errors
    /// If OpenVDB reports an error.
    pub(crate) fn repair(&mut self, negative: bool) -> Result<u64> {
        let mut changed = 0;
        // SAFETY: the grid is alive and `changed` a valid place.
        ffi::call(|s| unsafe { ffi::grid_repair(self.as_ptr(), negative.into(), &mut changed, s) })
            .map_err(self.place())?;
        Ok(changed)
    }

    /// True if both grids have equal trees: nodes, active states and values, in the type's own precision. The result is
    /// false for grids of different types and for grids of points.
    ///
    /// # Errors
    /// If OpenVDB reports an error.
    pub fn same_values(&self, other: &Self) -> Result<bool> {
        let mut same = 0;
        // SAFETY: both grids are alive and `same` a valid place.
        ffi::call(|s| unsafe { ffi::grid_same(self.as_ptr(), other.as_ptr(), &mut same, s) }).map_err(self.place())?;
        Ok(same != 0)
    }

    fn leaves(&self) -> Result<Leaves<'_>> {
        let mut raw = null_mut();
        // SAFETY: the grid is alive and `raw` a valid place for the handle.
        ffi::call(|s| unsafe { ffi::leaves_new(self.as_ptr(), &mut raw, s) }).map_err(self.place())?;
        let raw = NonNull::new(raw).ok_or_else(|| Error::native("no leaves handle"))?;
        let mut leaves = Leaves { raw, count: 0, components: 0, grid: PhantomData };
        let mut components = 0;
        // SAFETY: the handle is fresh from the shim, and both are valid places.
        ffi::call(|s| unsafe { ffi::leaves_count(leaves.raw.as_ptr(), &mut leaves.count, &mut components, s) })
            .map_err(self.place())?;
        leaves.components = components.clamp(0, 3) as usize;
        Ok(leaves)
    }

    /// Visits all leaves in ascending order of origin. Each is copied to `f32` into a buffer that the next one
    /// overwrites; `visit` returns false to stop.
    ///
    /// # Errors
    /// If the grid has no values (points).
    pub(crate) fn for_each_leaf(&self, mut visit: impl FnMut(&RawLeaf) -> bool) -> Result<()> {
        let leaves = self.leaves()?;
        let values = vec![0.0; LEAF_VOXELS * leaves.components];
        let mut leaf = RawLeaf { origin: [0; 3], values, active: [0; 8] };
        for index in 0..leaves.count {
            (leaf.origin, leaf.active) = leaves.copy(index, &mut leaf.values).map_err(self.place())?;
            if !visit(&leaf) {
                break;
            }
        }
        Ok(())
    }

    /// Active tiles, and inactive ones whose value is not the background, in ascending order of origin.
    ///
    /// # Errors
    /// If the grid has no values (points).
    pub(crate) fn tiles(&self) -> Result<Vec<RawTile>> {
        // A second walk costs more than this room, which few grids exceed.
        let mut raw = vec![ffi::RawTile::default(); 256];
        let mut count = 0;
        loop {
            // SAFETY: `raw` has room for `raw.len()` tiles; beyond, the shim only counts.
            ffi::call(|s| unsafe { ffi::tiles(self.as_ptr(), raw.as_mut_ptr(), raw.len(), &mut count, s) })
                .map_err(self.place())?;
            if count <= raw.len() {
                break;
            }
            raw.resize(count, ffi::RawTile::default());
        }
        raw.truncate(count);
        let mut tiles: Vec<_> = raw
            .iter()
            .map(|t| RawTile { origin: t.origin, dim: t.dim, value: t.value, active: t.active != 0 })
            .collect();
        tiles.sort_by_key(|t| t.origin);
        Ok(tiles)
    }

    /// Copies all values, one or three per voxel, to `f32`.
    ///
    /// # Errors
    /// If the grid has no values (points).
    pub fn to_raw(&self) -> Result<RawGrid> {
        let leaves = self.leaves()?;
        let components = leaves.components;
        let copied = (0..leaves.count).into_par_iter().map(|index| {
            let mut values = vec![0.0; LEAF_VOXELS * components];
            let (origin, active) = leaves.copy(index, &mut values)?;
            Ok(RawLeaf { origin, values, active })
        });
        let leaves = copied.collect::<Result<_>>().map_err(self.place())?;
        Ok(RawGrid { components, leaves, tiles: self.tiles()? })
    }

    /// Copies a scalar grid (float, double, integers, bool; stored as half or not) to `f32`, with active and inactive
    /// values, tiles and metadata.
    ///
    /// # Errors
    /// If the grid holds vectors or points, or its transform is not affine.
    pub fn to_grid(&self) -> Result<Grid> {
        self.to_grid_within(u64::MAX)
    }

    /// Copies a scalar grid as [`NativeGrid::to_grid`] does, if the grid and its copy fit into `max_memory` bytes
    /// together.
    ///
    /// # Errors
    /// If [`NativeGrid::to_grid`] fails, or both do not fit.
    pub(crate) fn to_grid_within(&self, max_memory: u64) -> Result<Grid> {
        let info = self.info()?;
        let bytes = info.memory.saturating_add(info.leaf_count * size_of::<Leaf>() as u64);
        if bytes > max_memory {
            return Err(too_large(bytes, max_memory).part(format!("grid '{}'", self.name)));
        }
        if info.components != 1 {
            return Err(Error::unsupported(format!("the grid holds {} values, scalars are needed", info.value_type))
                .part(format!("grid '{}'", self.name))
                .hint("name a scalar grid with ⟨grid⟩; cumulo info lists them"));
        }
        let leaves = self.leaves()?;
        let copied = (0..leaves.count).into_par_iter().map(|index| {
            let mut values = [0.0; LEAF_VOXELS];
            let (origin, active) = leaves.copy(index, &mut values)?;
            Ok(Leaf { origin, values, active })
        });
        self.grid_of(copied.collect::<Result<_>>().map_err(self.place())?)
    }

    /// Returns the scalar grid of these leaves with the tiles, the metadata and all else of this one.
    ///
    /// # Errors
    /// If the transform is not affine.
    pub(super) fn grid_of(&self, leaves: Vec<Leaf>) -> Result<Grid> {
        let info = self.info()?;
        let tile = |t: RawTile| Tile { origin: t.origin, dim: t.dim, value: t.value[0], active: t.active };
        Ok(Grid {
            transform: info.affine()?,
            name: info.name,
            class: info.class,
            background: info.background[0] as f32,
            leaves,
            tiles: self.tiles()?.into_iter().map(tile).collect(),
            metadata: self.metadata()?,
        })
    }

    /// Builds a float grid with the contents of `grid`.
    ///
    /// # Errors
    /// If a tile's edge is not 8, 128 or 4096, OpenVDB has no type for the shape of a metadata value, or [`writable`]
    /// refuses the transform.
    pub fn from_grid(grid: &Grid) -> Result<Self> {
        Self::of_grid(grid, true)
    }

    /// Builds a float grid as [`NativeGrid::from_grid`] does, whose leaves have no values unless `values` is set.
    pub(super) fn of_grid(grid: &Grid, values: bool) -> Result<Self> {
        let leaves = grid.leaves.iter().map(|l| (l.origin, values.then_some(l.values.as_slice()), &l.active));
        let tiles = grid.tiles.iter().map(|t| ffi::RawTile {
            origin: t.origin,
            dim: t.dim,
            value: [t.value, 0.0, 0.0],
            active: t.active.into(),
        });
        let mut native = Self::build(&grid.name, &[grid.background], leaves, &tiles.collect::<Vec<_>>())?;
        for (name, value) in &grid.metadata {
            native.set_metadata(name, value)?;
        }
        native.set_name(&grid.name)?;
        native.set_class(grid.class)?;
        native.set_transform(&grid.transform)?;
        Ok(native)
    }

    /// Builds a `vec3s` grid with background 0 from leaves of three components.
    ///
    /// # Errors
    /// If a leaf has the wrong number of values, [`writable`] refuses the transform, or OpenVDB reports an error.
    pub fn from_vectors(name: &str, class: GridClass, transform: &Affine, leaves: &[RawLeaf]) -> Result<Self> {
        let leaves = leaves.iter().map(|l| (l.origin, Some(l.values.as_slice()), &l.active));
        let mut native = Self::build(name, &[0.0; 3], leaves, &[])?;
        native.set_name(name)?;
        native.set_class(class)?;
        native.set_transform(transform)?;
        Ok(native)
    }

    /// Builds a `vec3s` grid with the contents of `raw`, which has three components.
    ///
    /// # Errors
    /// If a leaf has the wrong number of values, a tile's edge is not 8, 128 or 4096, [`writable`] refuses the
    /// transform, or OpenVDB reports an error.
    pub(crate) fn from_raw(
        name: &str,
        class: GridClass,
        transform: &Affine,
        background: [f32; 3],
        raw: &RawGrid,
    ) -> Result<Self> {
        let leaves = raw.leaves.iter().map(|l| (l.origin, Some(l.values.as_slice()), &l.active));
        let tiles = raw.tiles.iter().map(|t| ffi::RawTile {
            origin: t.origin,
            dim: t.dim,
            value: t.value,
            active: t.active.into(),
        });
        let mut native = Self::build(name, &background, leaves, &tiles.collect::<Vec<_>>())?;
        native.set_name(name)?;
        native.set_class(class)?;
        native.set_transform(transform)?;
        Ok(native)
    }

    /// Builds a grid of as many components as `background` has. All of its leaves have values, or none.
    fn build<'l>(
        name: &str,
        background: &[f32],
        leaves: impl Iterator<Item = ([i32; 3], Option<&'l [f32]>, &'l [u64; 8])>,
        tiles: &[ffi::RawTile],
    ) -> Result<Self> {
        let components = background.len();
        let (mut origins, mut values, mut active) = (Vec::new(), Vec::new(), Vec::new());
        for (origin, own, mask) in leaves {
            if let Some(own) = own {
                if own.len() != LEAF_VOXELS * components {
                    let what = format!("a leaf of {} values", own.len());
                    return Err(Error::invalid(what).part(format!("grid '{name}'")));
                }
                values.push(own.as_ptr());
            }
            origins.push(origin);
            active.push(mask.as_ptr());
        }
        let mut raw = null_mut();
        // The pointer of an empty list is none.
        let values = if values.len() == origins.len() { values.as_ptr() } else { null() };
        // SAFETY: the arrays have as many entries as their lengths say, each leaf 512 values a component, or none, and
        // 8 words, and the shim copies them before it returns.
        let made = ffi::call(|s| unsafe {
            ffi::grid_new(
                components as i32,
                background.as_ptr(),
                origins.as_ptr(),
                values,
                active.as_ptr(),
                origins.len(),
                tiles.as_ptr(),
                tiles.len(),
                &mut raw,
                s,
            )
        });
        made.map_err(|e| e.part(format!("grid '{name}'")))?;
        // SAFETY: fresh from the shim.
        unsafe { Self::own(raw, name.to_owned()) }
    }
}

impl Drop for NativeGrid {
    /// Releases this reference to the grid; the tree is freed with the last one.
    fn drop(&mut self) {
        // SAFETY: owned, and freed once.
        unsafe { ffi::grid_free(self.as_ptr()) }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    /// A copy that does not fit is an error in release builds too, not a write past the end.
    #[test]
    fn a_leaf_is_copied_only_where_it_is_and_where_it_fits() {
        let leaf = RawLeaf { origin: [8, 0, -8], values: vec![0.5; 3 * LEAF_VOXELS], active: [1; 8] };
        let map = Affine::uniform(1.0, DVec3::ZERO).unwrap();
        let native = NativeGrid::from_vectors("v", GridClass::FogVolume, &map, &[leaf]).unwrap();
        let leaves = native.leaves().unwrap();
        let mut values = vec![0.0; 3 * LEAF_VOXELS];
        assert_eq!((leaves.count, leaves.components), (1, 3));
        assert_eq!(leaves.copy(0, &mut values).unwrap(), ([8, 0, -8], [1; 8]));
        assert!(leaves.copy(1, &mut values).is_err());
        assert!(leaves.copy(0, &mut values[..3 * LEAF_VOXELS - 1]).is_err());
        // The shim checks the room as well, for callers that did not.
        let (mut origin, mut active) = ([0; 3], [0; 8]);
        for (index, room) in [(1, values.len()), (0, LEAF_VOXELS)] {
            let raw = leaves.raw.as_ptr();
            // SAFETY: all places are valid for the lengths that the shim is given.
            let copied = ffi::call(|s| unsafe {
                let (origin, active) = (origin.as_mut_ptr(), active.as_mut_ptr());
                ffi::leaves_copy(raw, index, origin, values.as_mut_ptr(), room, active, s)
            });
            assert!(copied.is_err(), "{index} {room}");
        }
    }
}
