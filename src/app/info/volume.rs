//! Content and statistics of an OpenVDB file.

use crate::app::statistics::statistics_of;
use crate::app::up::{self, ChosenUp};
use crate::error::Result;
use crate::formats::limits::Limits;
use crate::formats::transfer::{METADATA_KEY, TransferSummary, function_from_metadata};
use crate::formats::vdb::{File, GridInfo, Transform};
use crate::scene::grid::MetaValue;
use crate::scene::statistics::Statistics;
use crate::text::bytes as human;
use crate::text::{printable, printable_lines};
use crate::wording::worded;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

/// Description of an OpenVDB file.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(super) struct Volume {
    file_version: u32,
    library_version: String,
    /// Axis that points upwards.
    up: ChosenUp,
    metadata: BTreeMap<String, MetaValue>,
    grids: Vec<Grid>,
}

#[derive(Debug, Serialize, schemars::JsonSchema)]
struct Grid {
    name: String,
    value_type: String,
    grid_type: String,
    class: &'static str,
    half: bool,
    instance_of: Option<String>,
    transform: Placement,
    active_voxels: u64,
    leaves: u64,
    active_tiles: u64,
    background: Vec<f64>,
    index_bounds: Option<Bounds<i32>>,
    world_bounds: Option<Bounds<f64>>,
    memory_bytes: u64,
    statistics: Option<Statistics>,
    transfer: Option<Carried>,
    metadata: BTreeMap<String, MetaValue>,
}

/// Transfer function that a grid carries as metadata.
#[derive(Debug, Serialize, schemars::JsonSchema)]
#[serde(untagged)]
enum Carried {
    Usable(TransferSummary),
    Unusable { problem: String },
}

#[derive(Debug, Serialize, schemars::JsonSchema)]
struct Placement {
    kind: String,
    /// Index-to-world matrix for column vectors, by rows; none for maps that are not affine.
    matrix: Option<[[f64; 4]; 4]>,
    voxel_size: Option<[f64; 3]>,
}

#[derive(Debug, Serialize, schemars::JsonSchema)]
struct Bounds<T> {
    min: [T; 3],
    max: [T; 3],
}

impl Volume {
    /// Returns the grids in a line.
    pub(super) fn line(&self) -> String {
        let of = |grid: &Grid| {
            let figures = grid.statistics.as_ref().and_then(|s| Some((s.max?, s.mean?)));
            let figures = figures.map(|(max, mean)| format!(", max {max}, mean {mean:.6}")).unwrap_or_default();
            format!("'{}' {} voxels{figures}", printable(&grid.name), grid.active_voxels)
        };
        match self.grids[..] {
            [] => "no grids".into(),
            _ => self.grids.iter().map(of).collect::<Vec<_>>().join("; "),
        }
    }
}

/// Reads all grids of a file with their values, and describes them.
///
/// # Errors
/// If the file or one of its grids cannot be read.
pub(super) fn summary(path: &Path, limits: Limits) -> Result<Volume> {
    let file = File::open(path, limits)?;
    let mut grids = Vec::new();
    for entry in file.entries() {
        let native = file.read(&entry.name)?;
        let info = native.info().map_err(|e| e.at(path))?;
        let statistics = if info.components > 0 { Some(statistics_of(&native).map_err(|e| e.at(path))?) } else { None };
        grids.push(grid(info, entry.instance_of.clone(), statistics, native.metadata()?));
    }
    let (major, minor) = file.preflight().library;
    Ok(Volume {
        file_version: file.preflight().version,
        library_version: format!("{major}.{minor}"),
        up: up::of_file(&file),
        metadata: file.metadata()?,
        grids,
    })
}

/// Reads the transfer function of a grid's metadata; one that cannot be used is described by its problem.
fn carried(metadata: &BTreeMap<String, MetaValue>) -> Option<Carried> {
    match function_from_metadata(metadata).and_then(|t| t.map(|t| TransferSummary::of(&t)).transpose()) {
        Ok(usable) => usable.map(Carried::Usable),
        Err(error) => Some(Carried::Unusable { problem: error.what().into_owned() }),
    }
}

fn grid(
    info: GridInfo,
    instance_of: Option<String>,
    statistics: Option<Statistics>,
    metadata: BTreeMap<String, MetaValue>,
) -> Grid {
    let world_bounds = info.world_box().map(|b| Bounds { min: b.min.to_array(), max: b.max.to_array() });
    let affine = match &info.transform {
        Transform::Affine(a) => Some(a),
        Transform::Other(_) => None,
    };
    Grid {
        transform: Placement {
            kind: info.map_type.clone(),
            matrix: affine.map(|a| a.matrix().transpose().to_cols_array_2d()),
            voxel_size: affine.map(|a| a.voxel_size().to_array()),
        },
        name: info.name,
        value_type: info.value_type,
        grid_type: info.grid_type,
        class: info.class.name(),
        half: info.half,
        instance_of,
        active_voxels: info.active_voxels,
        leaves: info.leaf_count,
        active_tiles: info.active_tiles,
        background: info.background,
        index_bounds: info.index_box.map(|(min, max)| Bounds { min, max }),
        world_bounds,
        memory_bytes: info.memory,
        statistics,
        transfer: carried(&metadata),
        metadata,
    }
}

fn show(value: &MetaValue) -> String {
    match value {
        MetaValue::Bool(v) => v.to_string(),
        MetaValue::Int(v) => v.to_string(),
        MetaValue::Float(v) => v.to_string(),
        // Lines of a longer text are indented, so that none passes for an entry.
        MetaValue::Text(v) => printable_lines(v).replace('\n', "\n    "),
        MetaValue::Ints(v) => format!("{v:?}"),
        MetaValue::Floats(v) => format!("{v:?}"),
    }
}

impl fmt::Display for Volume {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "OpenVDB file version {}, written by library {}, {} grid(s)",
            self.file_version,
            self.library_version,
            self.grids.len()
        )?;
        writeln!(f, "{}", self.up)?;
        for (name, value) in &self.metadata {
            writeln!(f, "{}: {}", printable(name), show(value))?;
        }
        self.grids.iter().try_for_each(|grid| write!(f, "{grid}"))
    }
}

impl fmt::Display for Grid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let half = if self.half { ", stored as half" } else { "" };
        writeln!(f, "grid '{}': {}, {}{half}", printable(&self.name), self.value_type, self.class)?;
        if let Some(parent) = &self.instance_of {
            writeln!(f, "  shares the tree of '{}'", printable(parent))?;
        }
        match (&self.transform.voxel_size, &self.transform.matrix) {
            (Some(v), Some(m)) => {
                writeln!(f, "  voxel size {} x {} x {} ({})", v[0], v[1], v[2], self.transform.kind)?;
                for row in &m[..3] {
                    writeln!(f, "    [{:>12.6} {:>12.6} {:>12.6} {:>12.6}]", row[0], row[1], row[2], row[3])?;
                }
            }
            _ => writeln!(f, "  transform {} (not affine: resample before use)", self.transform.kind)?,
        }
        writeln!(
            f,
            "  {} active voxels in {} leaves and {} tiles, {} in memory, background {:?}",
            self.active_voxels,
            self.leaves,
            self.active_tiles,
            human(self.memory_bytes),
            self.background
        )?;
        match &self.index_bounds {
            Some(b) => writeln!(f, "  index bounds {:?} to {:?}", b.min, b.max)?,
            None => writeln!(f, "  empty")?,
        }
        if let Some(b) = &self.world_bounds {
            writeln!(f, "  world bounds {:?} to {:?}", b.min, b.max)?;
        }
        if let Some(s) = &self.statistics {
            if let (Some(min), Some(max), Some(mean)) = (s.min, s.max, s.mean) {
                writeln!(f, "  min {min}, max {max}, mean {mean:.6}; histogram {:?}", s.histogram)?;
            }
            if s.nan + s.infinite > 0 {
                let remedy = worded("cumulo convert ⟨repair⟩ sets them to zero");
                writeln!(f, "  {} NaN, {} infinite: {remedy}", s.nan, s.infinite)?;
            }
        }
        match &self.transfer {
            Some(Carried::Usable(transfer)) => writeln!(f, "  transfer function: {transfer}")?,
            Some(Carried::Unusable { problem }) => writeln!(f, "  transfer function that cannot be used: {problem}")?,
            None => {}
        }
        // The transfer function's text, of any length, is summed up above.
        for (name, value) in self.metadata.iter().filter(|(name, _)| *name != METADATA_KEY) {
            writeln!(f, "  {}: {}", printable(name), show(value))?;
        }
        Ok(())
    }
}
