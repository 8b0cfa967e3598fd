//! The volume that a use case works on, arranged for rays, with the transfer function that goes with it.

use super::transfer::TransferSettings;
use crate::error::{Error, Result};
use crate::formats::format::FileKind;
use crate::formats::limits::Limits;
use crate::formats::transfer::Function;
use crate::formats::vdb::{File, shaded};
use crate::formats::{registry, transfer};
use crate::scene::bricks::{Bricks, too_large};
use crate::scene::grid::Grid;
use crate::scene::transfer::Transfer;
use crate::scene::volume::Grids;
use std::path::Path;

/// Opens an OpenVDB file. Of another file the error says how it becomes one.
///
/// # Errors
/// If the file cannot be read, or is none of OpenVDB.
pub(crate) fn open(path: &Path, limits: Limits) -> Result<File> {
    let format = registry::sniff(path)?;
    match format.kind {
        FileKind::Image(_) | FileKind::Unknown => Err(registry::unread(format, path)),
        FileKind::Exr | FileKind::Picture(_) => Err(Error::invalid("this is a picture, and no volume")
            .hint("give an OpenVDB file; cumulo compare compares pictures, and cumulo view shows them")
            .at(path)),
        _ => File::open(path, limits),
    }
}

/// Reads a fog volume, and the transfer function that the settings name, else the one that the volume's grid carries.
///
/// # Errors
/// If the volume or the transfer function cannot be read or used.
pub(crate) fn read(
    path: &Path,
    name: Option<&str>,
    function: &TransferSettings,
    limits: Limits,
) -> Result<(Grid, Option<Transfer>)> {
    let (grid, function) = read_with_function(path, name, function, limits)?;
    Ok((grid, function.map(|function| function.transfer)))
}

/// Reads a fog volume as [`read`] does, and the function with the albedo that it may have.
///
/// # Errors
/// If the volume or the transfer function cannot be read or used.
pub(crate) fn read_with_function(
    path: &Path,
    name: Option<&str>,
    function: &TransferSettings,
    limits: Limits,
) -> Result<(Grid, Option<Function>)> {
    let requested = function.function(limits)?;
    let grid = open(path, limits)?.read_fog(name)?;
    let named = |e: Error| e.part(format!("grid '{}'", grid.name)).at(path);
    let function = match requested {
        Some(function) => Some(function),
        None => transfer::function_from_metadata(&grid.metadata).map_err(named)?,
    };
    Ok((grid, function))
}

/// Arranges a grid for rays that only read it: constant tiles share bricks. With a transfer function values may have any
/// sign and background, and the volume ends at its outermost active voxels, since there are no values beyond them to
/// interpolate with; if the function absorbs at the background, the volume fills its box.
///
/// # Errors
/// If values cannot be used, or the bricks would need more memory than is allowed.
pub(crate) fn arrange(grid: &Grid, transfer: Option<&Transfer>, limits: Limits) -> Result<Bricks<f32>> {
    let Some(transfer) = transfer else { return Bricks::instanced(grid, limits.max_memory) };
    let field = ended(Bricks::instanced_values(grid, limits.max_memory)?, grid, transfer, limits)?;
    // Renderers keep two tables of their own: of visible bricks, and of the distances to them.
    let bytes = grid.memory() + size_of_val(field.values.as_slice()) as u64 + 4 * field.topology.table_bytes();
    if bytes > limits.max_memory {
        return Err(too_large(bytes, limits.max_memory).part(format!("grid '{}'", grid.name)));
    }
    Ok(field)
}

/// Arranges a grid as [`arrange`] does, with values of its own for every voxel: for gradients by voxel.
///
/// # Errors
/// If values cannot be used, or the bricks would need more memory than is allowed.
pub(crate) fn arrange_by_voxel(grid: &Grid, transfer: Option<&Transfer>, limits: Limits) -> Result<Bricks<f32>> {
    match transfer {
        Some(transfer) => ended(Bricks::from_values(grid, limits.max_memory)?, grid, transfer, limits),
        None => Bricks::from_grid(grid, limits.max_memory),
    }
}

fn ended(mut field: Bricks<f32>, grid: &Grid, transfer: &Transfer, limits: Limits) -> Result<Bricks<f32>> {
    field.domain = grid.active_box();
    let absorbs = transfer.table()?.at(f64::from(grid.background))[3] > 0.0;
    if absorbs { field.filled(limits.max_memory) } else { Ok(field) }
}

/// Reads a pre-shaded volume; `name` is that of its extinctions.
///
/// # Errors
/// If it cannot be read or used.
pub(crate) fn read_pre_shaded(path: &Path, name: Option<&str>, limits: Limits) -> Result<Grids> {
    Ok(Grids::EmissionExtinction(shaded::read(&open(path, limits)?, name, limits.max_memory)?))
}
