//! The volume that a use case works on, arranged for rays, with the transfer function that goes with it.

use super::scan::ScanSettings;
use super::scan::grids::{Nano, Scan};
use super::transfer::TransferSettings;
use crate::error::{Error, Result};
use crate::formats::format::{FileKind, Format};
use crate::formats::imaging::tiff;
use crate::formats::limits::Limits;
use crate::formats::transfer::Function;
use crate::formats::vdb::{File, shaded};
use crate::formats::{captures, protected, registry, transfer};
use crate::scene::bricks::{Bricks, too_large};
use crate::scene::grid::{Grid, Leaf};
use crate::scene::transfer::{Class, MOST_LABEL, Transfer};
use crate::scene::volume::Grids;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Returns the format of an input: that of its content; of a folder that is no capture, or a pattern, that of the scan
/// whose slices it names.
///
/// # Errors
/// If nothing is there, or it cannot be read.
pub(crate) fn format_of(path: &Path) -> Result<&'static Format> {
    let is_image = |kind| matches!(kind, FileKind::Image(_));
    let folder = path.is_dir() && !captures::file(path).exists();
    if (folder || !path.exists())
        && let Some(format) = registry::find(path, is_image).ok().flatten()
    {
        return Ok(format);
    }
    registry::sniff(path)
}

/// True for the path of a scan: of a file, of the folder of a series, or of a pattern of slices.
pub(crate) fn is_scan(path: &Path) -> bool {
    format_of(path).is_ok_and(|format| matches!(format.kind, FileKind::Image(_)))
}

/// True for a pattern whose files are the slices of one scan, and not the frames of a sequence.
pub(crate) fn is_stack(path: &Path) -> bool {
    !path.exists() && format_of(path).is_ok_and(|format| !format.frames)
}

/// Returns the files that a volume is read from: the file itself, and those that the header of a scan names, or that
/// belong to its series. A folder stands for all files in it.
pub(crate) fn files(path: &Path, scan: &ScanSettings, limits: Limits) -> Vec<PathBuf> {
    let itself = || vec![path.to_path_buf()];
    let Ok(Format { kind: FileKind::Image(reader), .. }) = format_of(path) else { return itself() };
    if path.is_dir() {
        return itself();
    }
    if !path.exists() {
        return tiff::files(path).unwrap_or_else(|_| itself());
    }
    let folder = path.parent().unwrap_or(Path::new(""));
    let open = || scan.reading().and_then(|options| reader.open(path, &options, limits));
    let (opened, mut files) = protected::recorded(folder, || open().is_ok());
    if !opened {
        return itself();
    }
    files.insert(path.to_path_buf());
    files.into_iter().collect()
}

/// Opens a volume: an OpenVDB file; a NanoVDB; or a scan, which is placed by its header as a conversion places it, and
/// by `scan` where it does not say. The grids are read as they are asked for. Of another file the error says how it
/// becomes one.
///
/// # Errors
/// If the file cannot be read, is no volume, or a setting of `scan` has no effect on it.
pub(crate) fn open(path: &Path, scan: &ScanSettings, limits: Limits) -> Result<File> {
    let format = format_of(path)?;
    match format.kind {
        FileKind::Unknown | FileKind::Mesh(_) => return Err(registry::unread(format, path)),
        FileKind::Exr | FileKind::DeepExr | FileKind::Picture(_) => {
            return Err(Error::invalid("this is a picture, and no volume")
                .hint("give an OpenVDB file; cumulo compare compares pictures, and cumulo view shows them")
                .at(path));
        }
        _ => scan.check(format, path)?,
    }
    match format.kind {
        FileKind::Image(reader) => {
            let scan = Scan::open(path, (format, reader), scan, limits)?;
            Ok(File::of_grids(path, Box::new(scan), limits))
        }
        FileKind::NanoVdb => Ok(File::of_grids(path, Box::new(Nano::open(path, limits)?), limits)),
        _ => File::open(path, limits),
    }
}

/// Returns the name of the grid that becomes an array or a mesh unless one is named: the only one, or the density.
///
/// # Errors
/// If there are several, and none of them is the density.
pub(crate) fn array_grid(file: &File, path: &Path) -> Result<String> {
    let names: Vec<&str> = file.entries().iter().map(|e| e.name.as_str()).collect();
    match &names[..] {
        [only] => Ok((*only).to_owned()),
        names if names.contains(&"density") => Ok("density".into()),
        names => Err(Error::invalid(format!("one grid is converted; the file has {}", names.join(", ")))
            .at(path)
            .hint("name one of them with ⟨grid⟩")),
    }
}

/// Reads a fog volume, and the transfer function that the settings name, else the one that the volume's grid carries.
///
/// # Errors
/// If the volume or the transfer function cannot be read or used.
pub(crate) fn read(
    path: &Path,
    name: Option<&str>,
    (scan, function): (&ScanSettings, &TransferSettings),
    limits: Limits,
) -> Result<(Grid, Option<Transfer>)> {
    let (grid, function) = read_with_function(path, name, (scan, function), limits)?;
    Ok((grid, function.map(|function| function.transfer)))
}

/// Reads a fog volume as [`read`] does, and the function with the albedo that it may have. A function of labels has the
/// classes that the volume has.
///
/// # Errors
/// If the volume or the transfer function cannot be read or used.
pub(crate) fn read_with_function(
    path: &Path,
    name: Option<&str>,
    (scan, function): (&ScanSettings, &TransferSettings),
    limits: Limits,
) -> Result<(Grid, Option<Function>)> {
    let requested = function.function(limits)?;
    let grid = open(path, scan, limits)?.read_fog(name)?;
    let named = |e: Error| e.part(format!("grid '{}'", grid.name)).at(path);
    let function = match requested {
        Some(function) => Some(function),
        None => transfer::function_from_metadata(&grid.metadata).map_err(named)?,
    };
    let function = match function {
        Some(Function { transfer: Transfer::Labels { classes }, albedo }) => {
            let found = labels_of(&grid).map_err(named)?;
            Some(Function { transfer: Transfer::Labels { classes: present(classes, &found).map_err(named)? }, albedo })
        }
        other => other,
    };
    Ok((grid, function))
}

/// Returns the labels of a grid, its background among them.
///
/// # Errors
/// If a value is no label, or there are too many of them.
fn labels_of(grid: &Grid) -> Result<BTreeSet<i32>> {
    let of_leaf = |mut found: BTreeSet<i32>, leaf: &Leaf| {
        let mut last = f32::NAN;
        for value in leaf.values {
            if value != last {
                found.insert(label_of(value)?);
                last = value;
            }
        }
        Ok(found)
    };
    let both = |mut a: BTreeSet<i32>, mut b: BTreeSet<i32>| {
        a.append(&mut b);
        Ok(a)
    };
    let of_leaves = grid.leaves.par_iter().try_fold(BTreeSet::new, of_leaf).try_reduce(BTreeSet::new, both);
    let mut found = of_leaves?;
    for value in grid.tiles.iter().map(|tile| tile.value).chain([grid.background]) {
        found.insert(label_of(value)?);
    }
    Ok(found)
}

/// Returns the label that a value is.
fn label_of(value: f32) -> Result<i32> {
    if value.round() == value && value.abs() <= MOST_LABEL as f32 {
        return Ok(value as i32);
    }
    Err(Error::invalid(format!(
        "the value {value} is no label: the function is one of labels, which are whole numbers"
    ))
    .hint("give a volume of labels, or a function that is none of labels"))
}

/// Returns the classes whose labels are found.
///
/// # Errors
/// If none is found.
fn present(classes: Vec<Class>, found: &BTreeSet<i32>) -> Result<Vec<Class>> {
    let all = [classes.first(), classes.last()].map(|class| class.map_or(0, |class| class.label));
    let here: Vec<Class> = classes.into_iter().filter(|class| found.contains(&class.label)).collect();
    if here.is_empty() {
        let [first, last] = [found.first(), found.last()].map(|label| label.copied().unwrap_or_default());
        return Err(Error::invalid(format!(
            "none of the function's labels, {} to {}, is in the volume, whose labels are {first} to {last}",
            all[0], all[1]
        ))
        .hint("give a function of the volume's labels: ⟨tf=labels⟩ has a color for each"));
    }
    Ok(here)
}

/// Arranges a grid for rays that only read it: constant tiles share bricks. With a transfer function values may have
/// any sign and background, and the volume ends at its outermost active voxels, since there are no values beyond them
/// to interpolate with; if the function absorbs at the background, the volume fills its box.
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
pub(crate) fn read_pre_shaded(path: &Path, name: Option<&str>, scan: &ScanSettings, limits: Limits) -> Result<Grids> {
    Ok(Grids::EmissionExtinction(shaded::read(&open(path, scan, limits)?, name, limits.max_memory)?))
}
