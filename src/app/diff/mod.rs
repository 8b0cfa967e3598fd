//! How far the grids of two VDB files, or of two sequences of them, are apart.

mod files;
mod frames;
mod grids;
mod loaded;
mod report;
mod turn;

pub use frames::SequencesReport;
pub use report::FilesReport;

use crate::app::Context;
use crate::app::scan::ScanSettings;
use crate::app::sequence::FrameSelection;
use crate::app::use_case::{Report, Status, use_case};
use crate::error::{Error, Result};
use crate::formats::format::FileKind;
use crate::formats::limits::Limits;
use crate::metrics::volume::Effort;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::{Path, PathBuf};

/// Settings of the comparison of the grids of two VDBs, or of two sequences of them.
///
/// Where the transforms differ, the second file's grids are sampled trilinearly at the centers of the first one's
/// voxels. Grids are paired by name; the only grids of both files are compared whatever their names, but names that
/// differ are a difference, unless the grid is chosen.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct DiffSettings {
    /// VDB, NanoVDB or scan that is the reference; or the pattern or the folder of a sequence.
    #[serde(with = "crate::app::paths")]
    pub a: PathBuf,
    /// VDB, NanoVDB or scan to compare with the reference; or the pattern or the folder of a sequence.
    #[serde(with = "crate::app::paths")]
    pub b: PathBuf,
    /// Name of the only grid to compare; none for all.
    pub grid: Option<String>,
    /// Parts of scans that are read, and where their voxels lie.
    #[serde(flatten)]
    pub scan: ScanSettings,
    /// Largest absolute difference of values that counts as equal, 0 or more.
    pub tolerance: f64,
    /// Voxels to compare where the transforms differ.
    pub voxels: Voxels,
    /// Frames of sequences to compare.
    pub frames: FrameSelection,
    /// Memory that the work may take.
    #[serde(flatten)]
    pub limits: Limits,
}

/// Voxels to compare where transforms differ, evenly spread; as JSON a number, or "all".
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Voxels {
    /// All voxels.
    All,
    /// About so many voxels.
    #[serde(untagged)]
    About(u64),
}

impl Default for Voxels {
    /// 67 million voxels, which take some seconds.
    fn default() -> Self {
        Self::About(1 << 26)
    }
}

impl Voxels {
    fn effort(self) -> Effort {
        match self {
            Self::All => Effort::ALL,
            Self::About(count) => Effort::voxels(count),
        }
    }
}

/// Report of two files, or of two sequences.
#[derive(Debug, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum DiffReport {
    /// Report of two files.
    Files(FilesReport),
    /// Report of two sequences.
    Sequences(SequencesReport),
}

impl DiffReport {
    /// True if no difference was found.
    pub(crate) fn same(&self) -> bool {
        match self {
            Self::Files(files) => files.same,
            Self::Sequences(sequences) => sequences.same,
        }
    }

    /// True if no frame failed.
    pub(crate) fn complete(&self) -> bool {
        match self {
            Self::Files(_) => true,
            Self::Sequences(sequences) => sequences.failed.is_empty(),
        }
    }
}

impl fmt::Display for DiffReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Files(files) => files.fmt(f),
            Self::Sequences(sequences) => sequences.fmt(f),
        }
    }
}

use_case!(DiffSettings => DiffReport, limits);

impl Report for DiffReport {
    fn status(&self) -> Result<Status> {
        Ok(Status::of_check(self.complete(), !self.same()))
    }
}

impl DiffSettings {
    /// Reads and compares. Frames that fail are part of the report.
    ///
    /// # Errors
    /// If a file cannot be read, a grid is not there, two grids cannot be compared, or two sequences have no frame in
    /// common.
    pub fn run(&self, context: &Context) -> Result<DiffReport> {
        if self.tolerance.is_nan() || self.tolerance < 0.0 {
            return Err(Error::invalid(format!("⟨tolerance⟩ {}: zero or more is needed", self.tolerance))
                .hint("give the largest absolute difference of a value that still counts as equal"));
        }
        let is_volume = |kind| matches!(kind, FileKind::Vdb | FileKind::NanoVdb);
        let find = |path: &Path| self.frames.of_volumes(path, is_volume);
        if let Some(sequences) = self.frames.pair([&self.a, &self.b], find)? {
            return self.sequences(&sequences, context).map(DiffReport::Sequences);
        }
        self.files([&self.a, &self.b], self.limits, context).map(DiffReport::Files)
    }
}
