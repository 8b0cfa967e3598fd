//! Grids of NanoVDB files.

use crate::error::Result;
use crate::formats::limits::Limits;
use crate::formats::nanovdb::{Codec, File};
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
}

/// Reads the directory of a NanoVDB file.
///
/// # Errors
/// If the file cannot be read, or its directory is damaged.
pub(crate) fn summary(path: &Path, limits: Limits) -> Result<Summary> {
    let file = File::open(path, limits)?;
    let [major, minor, patch] = file.version();
    let grid = |e: &crate::formats::nanovdb::Entry| Grid {
        name: e.name.clone(),
        value_type: e.kind_name(),
        class: e.class.name(),
        active_voxels: e.active_voxels,
        codec: e.codec,
        memory: e.bytes,
        bytes: e.stored_bytes,
    };
    Ok(Summary { version: format!("{major}.{minor}.{patch}"), grids: file.entries().iter().map(grid).collect() })
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "NanoVDB {}, {} grids", self.version, self.grids.len())?;
        for grid in &self.grids {
            let (name, kind, class, voxels) = (printable(&grid.name), grid.value_type, grid.class, grid.active_voxels);
            let codec = format!("{:?}", grid.codec).to_lowercase();
            writeln!(f, "grid '{name}': {kind}, {class}, {voxels} active voxels")?;
            writeln!(f, "  {} bytes in memory, {} in the file, compression {codec}", grid.memory, grid.bytes)?;
        }
        Ok(())
    }
}
