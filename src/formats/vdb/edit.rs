//! Edits that make another grid: averages on a coarser lattice, fog volumes of level sets and back, vectors turned,
//! taken apart and put together.

use super::ffi;
use super::native::NativeGrid;
use crate::error::{Error, Result};
use crate::math::Affine;
use glam::{DMat3, DVec3};
use std::collections::HashSet;
use std::ptr::null_mut;

/// Voxels on each side of the surface of a level set that is made here, which is OpenVDB's own default.
pub(crate) const HALF_WIDTH: f32 = 3.0;

/// How the values of a new lattice follow from those of the old one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum ResampleFilter {
    /// Means over the new voxels' cells: the sum of value times volume stays what it was.
    Box,
    /// Trilinear interpolation at the new voxels' centres, over halved lattices where voxels grow more than twice.
    Trilinear,
}

/// Bytes that a point and the quads of a cell take while a surface is made.
const CELL_BYTES: f64 = 60.0;
/// Bytes of a leaf of indices, which stands beside each leaf of distances while they are computed.
const INDEX_LEAF_BYTES: u64 = 2208;

/// Cells and leaves that a surface passes.
pub(super) struct Passed {
    /// Number of cells between eight voxels.
    pub cells: f64,
    /// Number of leaves that it passes, and of those about them.
    pub leaves: f64,
}

impl NativeGrid {
    pub(super) fn named(&self) -> impl Fn(Error) -> Error + '_ {
        |e| e.part(format!("grid '{}'", self.name()))
    }

    /// True if cubic voxels of edge `voxel_size` in world units are along no axis finer than those of the grid.
    ///
    /// # Errors
    /// If OpenVDB reports an error, or the transform is not affine.
    pub(crate) fn coarsens(&self, voxel_size: f64) -> Result<bool> {
        // Rounding of a voxel's edge must not make an equal size a finer one.
        Ok(self.info()?.affine()?.voxel_size().max_element() <= voxel_size * (1.0 + 1e-9))
    }

    /// Resamples to the lattice of [`NativeGrid::resample`] by a box filter: a new voxel is the mean of the old
    /// lattice's cells over its cell, so that the sum of value times volume is kept.
    ///
    /// # Errors
    /// If the grid cannot be averaged, its transform is not affine, or
    /// [`writable`](super::writable) refuses the new one.
    pub(crate) fn resample_box(&mut self, voxel_size: f64) -> Result<()> {
        let (matrix, scale) = self.resampled_lattice(voxel_size)?;
        // SAFETY: the grid is alive, the matrix has 16 entries and the scale 3.
        ffi::call(|s| unsafe { ffi::grid_resample_box(self.as_ptr(), matrix.as_ptr(), scale.as_ptr(), s) })
            .map_err(self.named())
    }

    /// Estimate of the bytes that [`NativeGrid::resample_box`] needs beside the grid itself: leaves of the new lattice,
    /// and for each a list of the old leaves and tiles that it meets. Beyond `limit` bytes the estimate may be low.
    ///
    /// # Errors
    /// If OpenVDB reports an error, or the transform is not affine.
    pub(crate) fn resampled_box_bytes(&self, voxel_size: f64, limit: u64) -> Result<u64> {
        let info = self.info()?;
        let scale = (info.affine()?.voxel_size() / voxel_size).to_array();
        // A list's entry, and its share of the table.
        const ENTRY: f64 = 96.0;
        let (mut entries, mut reached) = (0.0, HashSet::new());
        let mut add = |origin: [i32; 3], dim: i32| {
            let block = |voxel: f64, a: usize| (((voxel - 0.5) * scale[a] + 0.5) / 8.0).floor();
            let low: [f64; 3] = std::array::from_fn(|a| block(f64::from(origin[a]), a));
            let high: [f64; 3] = std::array::from_fn(|a| block(f64::from(origin[a]) + f64::from(dim), a));
            entries += (0..3).map(|a| high[a] - low[a] + 1.0).product::<f64>();
            // Indices of more than 32 bits have no lattice.
            let beyond = (0..3).any(|a| low[a].abs().max(high[a].abs()) > f64::from(1 << 27));
            if beyond || entries * ENTRY > limit as f64 {
                entries = if beyond { 1e15 } else { entries };
                return false;
            }
            let [low, high] = [low, high].map(|corner| corner.map(|c| c as i32));
            for x in low[0]..=high[0] {
                for y in low[1]..=high[1] {
                    reached.extend((low[2]..=high[2]).map(|z| [x, y, z]));
                }
            }
            true
        };
        let mut fits = true;
        self.for_each_leaf(|leaf| {
            fits = add(leaf.origin, 8);
            fits
        })?;
        fits = fits && self.tiles()?.iter().all(|tile| add(tile.origin, tile.dim));
        let bytes = reached.len() as f64 * (info.leaf_bytes() as f64 + 64.0) + entries * ENTRY;
        Ok(if fits { bytes as u64 + (1 << 20) } else { (bytes as u64).max(limit.saturating_add(1)) })
    }

    /// Makes a fog volume of a level set: densities are 0 outside, and rise from 0 on the surface to 1 where the narrow
    /// band ends inside (OpenVDB's `sdfToFogVolume`).
    ///
    /// # Errors
    /// If the grid holds neither floats nor doubles.
    pub(crate) fn make_fog(&mut self) -> Result<()> {
        // SAFETY: the grid is alive.
        ffi::call(|s| unsafe { ffi::grid_to_fog(self.as_ptr(), s) }).map_err(self.named())
    }

    /// Makes a level set of the surface on which a fog volume has the value `iso`: distances in world units up to
    /// [`HALF_WIDTH`] voxels from the surface, negative where the density is `iso` or more. The surface is that of
    /// OpenVDB's `volumeToMesh`, distances are those to its quads, and the densities themselves tell the sides, so that
    /// cavities stay cavities. Beyond two voxels from the surface OpenVDB seeks the nearest quad among those of
    /// neighbouring voxels, and distances may be too large by half a voxel.
    ///
    /// # Errors
    /// If the grid holds neither floats nor doubles, its voxels are no cubes, the values outside are not below `iso`,
    /// or none inside is at least that.
    pub(crate) fn make_level_set(&mut self, iso: f64) -> Result<()> {
        let info = self.info()?;
        let voxel = cubic(&info.affine()?).ok_or_else(|| {
            Error::unsupported("level sets need voxels that are cubes")
                .hint("resample the grid to cubes first: ⟨resample⟩ with an edge length")
        });
        let voxel = voxel.map_err(self.named())?;
        if info.background.first().is_none_or(|background| *background >= iso || iso.is_nan()) {
            return Err(self.named()(
                Error::invalid(format!("the value outside is {:?}, which is not below ⟨iso={iso}⟩", info.background))
                    .hint("give an ⟨iso⟩ above the value outside: the surface must enclose something"),
            ));
        }
        // SAFETY: the grid is alive.
        ffi::call(|s| unsafe { ffi::grid_to_level_set(self.as_ptr(), iso, voxel, HALF_WIDTH, s) }).map_err(self.named())
    }

    /// Estimate of the bytes that [`NativeGrid::make_level_set`] needs beside the grid itself: the surface's points and
    /// quads, and twice the leaves of distances and of indices of quads within its narrow band, since each thread has
    /// leaves of its own until they are merged.
    ///
    /// # Errors
    /// If the grid has no values (points).
    pub(crate) fn level_set_bytes(&self, iso: f64) -> Result<u64> {
        let passed = self.passed(iso)?;
        let leaf = (self.info()?.leaf_bytes() + INDEX_LEAF_BYTES) as f64;
        Ok((2.0 * passed.leaves * leaf + passed.cells * CELL_BYTES).min(1e18) as u64 + (1 << 20))
    }

    /// Returns at least what the surface of the value `iso` passes.
    ///
    /// # Errors
    /// If the grid has no values (points).
    pub(super) fn passed(&self, iso: f64) -> Result<Passed> {
        let (mut inside, mut mixed, mut cells) = (HashSet::new(), Vec::new(), 0.0);
        self.for_each_leaf(|leaf| {
            let at = leaf.origin.map(|c| c >> 3);
            match leaf.values.iter().filter(|v| f64::from(**v) >= iso).count() {
                0 => {}
                512 => _ = inside.insert(at),
                n => {
                    // Each voxel of the smaller side has at most eight cells about it.
                    cells += f64::min(512.0, 8.0 * n.min(512 - n) as f64);
                    mixed.push(at);
                }
            }
            true
        })?;
        let neighbours =
            |at: [i32; 3]| (0..27).map(move |i| [at[0] + i / 9 - 1, at[1] + i / 3 % 3 - 1, at[2] + i % 3 - 1]);
        // A leaf of which all lies inside meets the surface where a neighbour does not.
        let border = inside.iter().filter(|at| neighbours(**at).any(|n| !inside.contains(&n)));
        let mut band = HashSet::new();
        let (mut tiles, mut surface) = (0.0, 0.0);
        for at in border.chain(&mixed) {
            band.extend(neighbours(*at));
            surface += 1.0;
        }
        for tile in self.tiles()?.iter().filter(|t| f64::from(t.value[0]) >= iso) {
            tiles += 6.0 * (f64::from(tile.dim) / 8.0 + 2.0).powi(2);
        }
        cells += 64.0 * (surface - mixed.len() as f64 + tiles);
        Ok(Passed { cells, leaves: band.len() as f64 + 3.0 * tiles })
    }

    /// Smallest and largest value of a grid of scalars, inactive voxels included; those that are not finite are left
    /// out.
    ///
    /// # Errors
    /// If the grid has no values (points).
    pub(crate) fn value_range(&self) -> Result<(f64, f64)> {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        let mut include = |v: f32| {
            if v.is_finite() {
                (low, high) = (low.min(f64::from(v)), high.max(f64::from(v)));
            }
        };
        self.for_each_leaf(|leaf| {
            leaf.values.iter().for_each(|v| include(*v));
            true
        })?;
        self.tiles()?.iter().for_each(|tile| include(tile.value[0]));
        Ok((low, high))
    }

    /// Multiplies every vector of the grid, the value outside included, by a matrix.
    ///
    /// # Errors
    /// If the grid holds no vectors.
    pub(crate) fn turn_vectors(&mut self, turn: DMat3) -> Result<()> {
        let rows = turn.transpose().to_cols_array();
        // SAFETY: the grid is alive and the matrix has 9 entries.
        ffi::call(|s| unsafe { ffi::grid_turn_vectors(self.as_ptr(), rows.as_ptr(), s) }).map_err(self.named())
    }

    /// Makes a grid of one component of the vectors, 0 for x to 2 for z, under another name. Voxels, tiles and metadata
    /// are kept, class and vector type are not.
    ///
    /// # Errors
    /// If the grid holds no vectors, or the name contains a NUL byte.
    pub fn component(&self, component: usize, name: &str) -> Result<Self> {
        let mut raw = null_mut();
        // SAFETY: the grid is alive and `raw` a valid place for the handle.
        ffi::call(|s| unsafe { ffi::grid_component(self.as_ptr(), component as i32, &mut raw, s) })
            .map_err(self.named())?;
        // SAFETY: fresh from the shim.
        let mut made = unsafe { Self::own(raw, name.to_owned()) }?;
        made.set_name(name)?;
        Ok(made)
    }

    /// Makes a grid of vectors of three grids of scalars of one type. A voxel is active where one of theirs is; places
    /// and metadata are those of the first, class and vector type are not kept.
    ///
    /// # Errors
    /// If the grids lie on different lattices, hold different types or none of float, double and int32, or the name
    /// contains a NUL byte.
    pub(crate) fn merge([x, y, z]: [&Self; 3], name: &str) -> Result<Self> {
        let lattice = x.info()?.affine()?;
        for other in [y, z] {
            if !lattice.is_close(&other.info()?.affine()?) {
                return Err(Error::unsupported(format!(
                    "grids '{}' and '{}' lie on different lattices",
                    x.name(),
                    other.name()
                ))
                .hint("resample both to one lattice first: ⟨convert.resample⟩"));
            }
        }
        let mut raw = null_mut();
        // SAFETY: the grids are alive and `raw` a valid place for the handle.
        ffi::call(|s| unsafe { ffi::grid_merge(x.as_ptr(), y.as_ptr(), z.as_ptr(), &mut raw, s) })?;
        // SAFETY: fresh from the shim.
        let mut made = unsafe { Self::own(raw, name.to_owned()) }?;
        made.set_name(name)?;
        Ok(made)
    }
}

/// Edge of the voxels in world units if they are cubes, in any orientation; deviations of a millionth are rounding.
fn cubic(map: &Affine) -> Option<f64> {
    let m = DMat3::from_mat4(map.matrix());
    let axes = [m.x_axis, m.y_axis, m.z_axis];
    let edge = axes.iter().map(|a| a.length()).sum::<f64>() / 3.0;
    let close = |a: f64, b: f64| (a - b).abs() <= 1e-6 * edge * edge;
    let dot = |a: usize, b: usize| DVec3::dot(axes[a], axes[b]);
    let equal = (0..3).all(|a| close(dot(a, a), edge * edge));
    (equal && close(dot(0, 1), 0.0) && close(dot(0, 2), 0.0) && close(dot(1, 2), 0.0)).then_some(edge)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::scene::grid::{Grid, GridClass, Leaf, Tile};
    use glam::DMat4;
    use std::collections::BTreeMap;

    /// A fog volume of `n`³ leaves of a wavy density, with a tile beside them.
    fn wavy(n: i32) -> NativeGrid {
        let leaf = |i: i32| {
            let origin = [i / (n * n), i / n % n, i % n].map(|c| 8 * c);
            let values = std::array::from_fn(|v| 0.5 + 0.5 * (v as f32 * 0.37 + i as f32).sin());
            Leaf { origin, values, active: [u64::MAX; 8] }
        };
        NativeGrid::from_grid(&Grid {
            name: "density".into(),
            class: GridClass::FogVolume,
            transform: Affine::uniform(0.5, DVec3::ZERO).unwrap(),
            background: 0.0,
            leaves: (0..n * n * n).map(leaf).collect(),
            tiles: vec![Tile { origin: [-128, 0, 0], dim: 128, value: 0.9, active: true }],
            metadata: BTreeMap::new(),
        })
        .unwrap()
    }

    #[test]
    fn estimates_hold_what_the_edits_make() {
        let leaves = |grid: &NativeGrid| grid.info().map(|i| i.leaf_count * i.leaf_bytes()).unwrap();
        for voxel in [0.5, 0.7, 2.0, 9.0, 0.3] {
            let mut grid = wavy(4);
            let estimate = grid.resampled_box_bytes(voxel, u64::MAX).unwrap();
            grid.resample_box(voxel).unwrap();
            assert!(estimate >= leaves(&grid), "{voxel}: {estimate} {}", leaves(&grid));
        }
        let mut grid = wavy(4);
        let estimate = grid.level_set_bytes(0.5).unwrap();
        grid.make_level_set(0.5).unwrap();
        assert!(estimate >= leaves(&grid), "{estimate} {}", leaves(&grid));
        // What does not fit is told without being counted: half a million entries take more than a mebibyte.
        assert!(wavy(2).resampled_box_bytes(0.01, 1 << 20).unwrap() > 1 << 20);
        assert!(wavy(2).resampled_box_bytes(1e-9, 1 << 20).unwrap() > 1 << 20);
    }

    #[test]
    fn cubes_are_cubes_in_any_orientation() {
        let map = |matrix: DMat4| Affine::new(matrix).unwrap();
        let turned = DMat4::from_rotation_x(0.7) * DMat4::from_rotation_z(1.9) * DMat4::from_scale(DVec3::splat(0.25));
        assert!((cubic(&map(turned)).unwrap() - 0.25).abs() < 1e-12);
        assert!(cubic(&map(DMat4::from_scale(DVec3::new(1.0, 1.0, -1.0)))).is_some(), "mirrored cubes are cubes");
        assert_eq!(cubic(&map(DMat4::from_scale(DVec3::new(1.0, 1.0, 1.01)))), None);
        let mut sheared = DMat4::IDENTITY;
        sheared.y_axis.x = 0.1;
        assert_eq!(cubic(&map(sheared)), None);
    }
}
