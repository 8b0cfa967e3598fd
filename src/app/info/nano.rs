//! Grids of NanoVDB files.

use crate::app::statistics::statistics_of;
use crate::error::{Kind, Result};
use crate::formats::limits::Limits;
use crate::formats::nanovdb::{Codec, Entry, File};
use crate::scene::statistics::Statistics;
use crate::text::printable;
use serde::Serialize;
use std::fmt;
use std::path::Path;

/// Content of a NanoVDB file, by its directory.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(super) struct Summary {
    /// Version of the library that wrote the file.
    version: String,
    grids: Vec<Grid>,
}

#[derive(Debug, Serialize, schemars::JsonSchema)]
struct Grid {
    name: String,
    /// Type of the values, by NanoVDB's name.
    value_type: &'static str,
    class: &'static str,
    active_voxels: u64,
    codec: Codec,
    /// Bytes in memory.
    memory: u64,
    /// Bytes in the file.
    bytes: u64,
    /// Edges of a voxel in world units; none if the grid cannot be read.
    voxel_size: Option<[f64; 3]>,
    /// Smallest and largest index of active voxels; none if there are none, or the grid cannot be read.
    index_bounds: Option<[[i32; 3]; 2]>,
    /// Statistics of the active values; none if the grid cannot be read.
    statistics: Option<Statistics>,
    /// Why the grid cannot be read.
    #[serde(skip_serializing_if = "Option::is_none")]
    unread: Option<String>,
}

/// Statistics of the values of a grid.
struct Values {
    voxel_size: [f64; 3],
    index_bounds: Option<[[i32; 3]; 2]>,
    statistics: Statistics,
}

impl Values {
    fn read(file: &mut File, index: usize) -> Result<Self> {
        let (native, _) = file.read(index)?.into_native()?;
        let info = native.info()?;
        Ok(Self {
            voxel_size: info.affine()?.voxel_size().to_array(),
            index_bounds: info.index_box.map(|(low, high)| [low, high]),
            statistics: statistics_of(&native)?,
        })
    }
}

/// Reads the directory of a NanoVDB file, and the values of the grids that can be read.
///
/// # Errors
/// If the file cannot be read, or is damaged.
pub(crate) fn summary(path: &Path, limits: Limits) -> Result<Summary> {
    let mut file = File::open(path, limits)?;
    let values: Vec<_> = (0..file.entries().len()).map(|index| Values::read(&mut file, index)).collect();
    let [major, minor, patch] = file.version();
    let grid = |(e, values): (&Entry, Result<Values>)| {
        let (values, unread) = match values {
            Ok(values) => (Some(values), None),
            Err(error) if error.kind() == Kind::Unsupported => (None, Some(error.what().into_owned())),
            Err(error) => return Err(error),
        };
        Ok(Grid {
            name: e.name.clone(),
            value_type: e.kind_name(),
            class: e.class.name(),
            active_voxels: e.active_voxels,
            codec: e.codec,
            memory: e.bytes,
            bytes: e.stored_bytes,
            voxel_size: values.as_ref().map(|values| values.voxel_size),
            index_bounds: values.as_ref().and_then(|values| values.index_bounds),
            statistics: values.map(|values| values.statistics),
            unread,
        })
    };
    let grids = file.entries().iter().zip(values).map(grid).collect::<Result<_>>()?;
    Ok(Summary { version: format!("{major}.{minor}.{patch}"), grids })
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "NanoVDB {}, {} grids", self.version, self.grids.len())?;
        for grid in &self.grids {
            let (name, kind, class, voxels) = (printable(&grid.name), grid.value_type, grid.class, grid.active_voxels);
            let codec = format!("{:?}", grid.codec).to_lowercase();
            writeln!(f, "grid '{name}': {kind}, {class}, {voxels} active voxels")?;
            writeln!(f, "  {} bytes in memory, {} in the file, compression {codec}", grid.memory, grid.bytes)?;
            if let Some([x, y, z]) = grid.voxel_size {
                writeln!(f, "  voxel size {x} x {y} x {z}")?;
            }
            if let Some([low, high]) = grid.index_bounds {
                writeln!(f, "  index bounds {low:?} to {high:?}")?;
            }
            if let Some(s) = &grid.statistics
                && let (Some(min), Some(max), Some(mean)) = (s.min, s.max, s.mean)
            {
                writeln!(f, "  min {min}, max {max}, mean {mean:.6}; histogram {:?}", s.histogram)?;
            }
            if let Some(what) = &grid.unread {
                writeln!(f, "  cannot be read: {}", printable(what))?;
            }
        }
        Ok(())
    }
}
