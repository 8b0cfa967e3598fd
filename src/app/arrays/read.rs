//! Grids of files as arrays.

use crate::app::scan::ScanSettings;
use crate::app::volume;
use crate::error::{Error, Result};
use crate::formats::imaging::source::Source;
use crate::formats::limits::Limits;
use crate::scene::bricks::too_large;
use glam::DMat4;
use std::path::Path;

/// A grid as an array over the box of its active voxels.
#[derive(Debug, Clone)]
pub struct Volume {
    /// Values at [i, j, k] or [i, j, k, component], the last axis the fastest.
    pub values: Vec<f32>,
    /// Number of voxels along x, y and z.
    pub shape: [usize; 3],
    /// Numbers of a voxel: 1 or 3.
    pub components: usize,
    /// Map from the array's indices, those of voxel centres, to the world; it acts on column vectors.
    pub transform: DMat4,
    /// Name of the grid.
    pub name: String,
    /// Index coordinates of the array's first voxel.
    pub low: [i32; 3],
    /// Values of the other voxels, one a component.
    pub background: Vec<f64>,
}

/// Reads a grid of a volume: the named one, the only one, or `density`.
///
/// # Errors
/// If the file or the grid cannot be read, or the array would take more memory than is allowed.
pub fn volume(path: &Path, name: Option<&str>, limits: Limits) -> Result<Volume> {
    let file = volume::open(path, &ScanSettings::default(), limits)?;
    let name = match name {
        Some(name) => file.find(name)?.name.clone(),
        None => volume::array_grid(&file, path)?,
    };
    let place = |e: Error| e.part(format!("grid '{name}'")).at(path);
    let native = file.read(&name)?;
    let info = native.info().map_err(place)?;
    let source = Source::new(&native, limits).map_err(place)?;
    let count = source.count().map_err(place)?;
    if count.saturating_mul(4) > limits.max_memory {
        return Err(place(too_large(count.saturating_mul(4), limits.max_memory)));
    }
    let mut values = Vec::with_capacity(usize::try_from(count).unwrap_or(0));
    let mut slab = Vec::new();
    for x in 0..source.size[0] {
        source.slab(x, &mut slab).map_err(place)?;
        values.extend(slab.iter().map(|v| *v as f32));
    }
    Ok(Volume {
        values,
        shape: source.size,
        components: source.components,
        transform: source.index_to_world.matrix(),
        low: source.low,
        background: info.background.clone(),
        name,
    })
}
