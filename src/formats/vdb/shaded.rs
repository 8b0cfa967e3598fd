//! Pre-shaded volumes in VDB files: a grid of extinction per world length and a `vec3s` grid of the radiance emitted
//! per world length, on one lattice.

use super::file::File;
use super::native::{NativeGrid, RawLeaf};
use super::write::{Codec, write_native};
use crate::error::{Error, Result};
use crate::scene::bricks::{BRICK, Bricks, Topology};
use crate::scene::grid::{Grid, GridClass, LEAF_VOXELS, Leaf, MetaValue, Tile};
use glam::Vec4;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// Name under which the extinction grid is written.
pub(crate) const EXTINCTION: &str = "density";
/// Name of the emission grid.
pub(crate) const EMISSION: &str = "emission";

/// Writes a pre-shaded volume, and the grids `beside` it, to one file.
///
/// # Errors
/// The conditions are those of [`NativeGrid::from_grid`] and [`write_native`].
pub fn write(
    path: &Path,
    volume: &Bricks<Vec4>,
    beside: &[&Grid],
    metadata: &BTreeMap<String, MetaValue>,
) -> Result<()> {
    let owned = volume.owned();
    let leaves: Vec<RawLeaf> = volume
        .topology
        .bricks()
        .par_iter()
        .zip(owned.par_chunks(LEAF_VOXELS))
        .filter_map(|(brick, voxels)| {
            let mut active = [0; 8];
            for (i, _) in voxels.iter().enumerate().filter(|(_, v)| v.truncate() != glam::Vec3::ZERO) {
                active[i >> 6] |= 1 << (i & 63);
            }
            let values = voxels.iter().flat_map(|v| v.truncate().to_array()).collect();
            (active != [0; 8]).then_some(RawLeaf { origin: (8 * *brick).to_array(), values, active })
        })
        .collect();
    let mut grids = vec![
        NativeGrid::from_grid(&volume.channel(3).to_grid(EXTINCTION))?,
        NativeGrid::from_vectors(EMISSION, GridClass::FogVolume, &volume.transform, &leaves)?,
    ];
    for grid in beside {
        grids.push(NativeGrid::from_grid(grid)?);
    }
    write_native(path, &grids.iter().collect::<Vec<_>>(), None, metadata, Codec::default())
}

/// Reads a pre-shaded volume. `extinction` names the extinction grid, which otherwise is the choice of
/// [`File::read_fog`].
///
/// # Errors
/// If [`File::read_fog`] fails; if there is no grid `EMISSION`, it holds no vectors, lies on another lattice, or a
/// value is negative or not finite; if the volume does not fit into `max_memory` bytes.
pub fn read(file: &File, extinction: Option<&str>, max_memory: u64) -> Result<Bricks<Vec4>> {
    let extinctions = file.read_fog(extinction)?;
    let place = |e: Error| e.part(format!("grid '{EMISSION}'")).at(file.path());
    if !file.entries().iter().any(|e| e.base_name == EMISSION) {
        return Err(place(Error::invalid("a pre-shaded volume needs a vec3s grid of this name"))
            .hint("`cumulo reconstruct color` writes one; `cumulo info` lists what the file has"));
    }
    let native = file.read(EMISSION)?;
    let info = native.info().map_err(place)?;
    if info.components != 3 {
        return Err(place(
            Error::unsupported(format!("the grid holds {} values, vec3s are needed", info.value_type))
                .hint("`cumulo reconstruct color` writes such a grid"),
        ));
    }
    let transform = info.affine().map_err(place)?;
    if !transform.is_close(&extinctions.transform) {
        return Err(place(Error::unsupported(format!("its lattice is not that of grid '{}'", extinctions.name)))
            .hint("resample one of them with ⟨convert.resample⟩"));
    }
    if info.background.iter().any(|v| *v != 0.0) {
        return Err(place(Error::unsupported(format!(
            "background is {:?}, nothing is emitted outside",
            info.background
        )))
        .hint("set the background to 0 where the grid was made"));
    }
    let raw = native.to_raw().map_err(place)?;
    drop(native);
    let channel = |c: usize| Grid {
        name: EMISSION.into(),
        class: GridClass::FogVolume,
        transform,
        background: 0.0,
        leaves: raw
            .leaves
            .iter()
            .map(|l| Leaf { origin: l.origin, values: std::array::from_fn(|i| l.values[3 * i + c]), active: l.active })
            .collect(),
        tiles: raw
            .tiles
            .iter()
            .map(|t| Tile { origin: t.origin, dim: t.dim, value: t.value[c], active: t.active })
            .collect(),
        metadata: BTreeMap::new(),
    };
    // Memory holds four scalar fields, one field of four numbers per voxel, and a channel's grid beside the field made
    // of it.
    let held = raw.leaves.len() as u64 * (3 * 2048 + 120) + extinctions.memory();
    let each = max_memory.saturating_sub(held) / 9;
    let field = |grid: &Grid| Bricks::<f32>::from_grid(grid, each).map_err(|e| e.at(file.path()));
    let lanes = [field(&channel(0))?, field(&channel(1))?, field(&channel(2))?, field(&extinctions)?];
    let bricks = lanes.iter().flat_map(|lane| lane.topology.bricks().iter().copied());
    let topology = Arc::new(Topology::new(bricks).map_err(place)?);
    let mut volume = Bricks::<Vec4>::zeros(topology.clone(), transform);
    volume.values.par_chunks_mut(BRICK).zip(topology.bricks().par_iter()).for_each(|(out, brick)| {
        for (c, lane) in lanes.iter().enumerate() {
            if let Some(values) = lane.brick(*brick) {
                out.iter_mut().zip(values).for_each(|(v, own)| v[c] = *own);
            }
        }
    });
    Ok(volume)
}
