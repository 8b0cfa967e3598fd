//! What a reconstruction did: its report, kept beside the page so that the page can be made again.

use super::provenance::Provenance;
use crate::optimise::density::{Stage, Step};
use crate::optimise::plausibility::Warning;
use crate::optimise::plausibility::cost::Cost;
use crate::scene::capture::PixelFilter;
use indicatif::ProgressBar;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::PathBuf;

/// How the densities were found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Solver {
    /// Conjugate gradients in the smoothness prior's metric.
    Cg,
    /// Weiss & Westermann (2021).
    #[serde(alias = "paper")]
    Weiss2021,
    /// Extinctions, then emissions: a pre-shaded volume.
    #[serde(alias = "colour")]
    Color,
    /// A pre-shaded volume, the densities of its colors, and descent: behind a transfer function.
    #[serde(alias = "behind")]
    ThroughTransfer,
}

/// A reconstruction of densities.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Run {
    /// The pictures' transforms.json.
    #[serde(serialize_with = "crate::cli::paths::text")]
    pub capture: PathBuf,
    /// The VDB that was written.
    #[serde(serialize_with = "crate::cli::paths::text")]
    pub output: PathBuf,
    /// Name of its grid.
    pub grid: String,
    /// How the densities were found.
    pub solver: Solver,
    /// Layer of the pictures that was asked for.
    pub layer: Option<String>,
    /// Iterations, all levels counted.
    pub iterations: u32,
    /// Wall time up to the writing of the VDB.
    pub seconds: f64,
    /// PSNR of the views that were used, peak 1; none if it was not measured any more after a stop.
    pub train_psnr_db: Option<f64>,
    /// PSNR of those that were not.
    pub held_out_psnr_db: Option<f64>,
    /// Largest resident memory of the process in MB (2²⁰ bytes); none where the system does not tell.
    pub peak_memory_mb: Option<f64>,
    /// True if the user stopped it.
    pub stopped: bool,
    /// Number of views.
    pub views: usize,
    /// Numbers of the held-out views.
    pub held_out: Vec<usize>,
    /// Numbers of the views that the page shows.
    pub shown: Vec<usize>,
    /// Edge lengths of the voxels in world units.
    pub voxel_size: [f64; 3],
    /// Unknown voxels on the finest level.
    pub unknowns: usize,
    /// What it was expected to cost.
    #[serde(default)]
    pub expected: Option<Cost>,
    /// What contradicts the model, before the work and after it.
    #[serde(default)]
    pub warnings: Vec<Warning>,
    /// The page, if one was asked for.
    #[serde(serialize_with = "crate::cli::paths::text")]
    pub report: Option<PathBuf>,
    /// Time by stage.
    pub stages: Vec<Stage>,
    /// Every iteration.
    pub history: Vec<Step>,
    /// Version, command line and hash of the inputs.
    pub provenance: Provenance,
}

/// Rays along each edge of a pixel by which its filter is followed.
pub fn rays_per_edge(filter: PixelFilter) -> usize {
    match filter {
        PixelFilter::Point => 1,
        PixelFilter::Box => 2,
    }
}

/// Warnings as a report's text shows them.
pub fn write_warnings(f: &mut fmt::Formatter<'_>, warnings: &[Warning]) -> fmt::Result {
    warnings.iter().try_for_each(|w| writeln!(f, "  warning: {}\n    {}", w.what, w.remedy))
}

/// Largest resident memory of this process so far, in units of 2²⁰ bytes.
pub fn peak_memory_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    let kib: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib / 1024.0)
}

/// Shows where a reconstruction is.
pub fn show(bar: &ProgressBar, step: &Step) {
    let psnr = step.held_out_psnr_db.map(|p| format!(", held-out {p:.2} dB")).unwrap_or_default();
    let position = u64::from(step.iteration);
    bar.set_length(bar.length().unwrap_or(0).max(position));
    bar.set_position(position);
    bar.set_message(format!("level {}, loss {:.3e}{psnr}", step.level, step.loss));
}

impl fmt::Display for Run {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.voxel_size;
        writeln!(f, "{}: grid '{}', {} voxels of {x} x {y} x {z}", self.output.display(), self.grid, self.unknowns)?;
        writeln!(f, "  {} iterations in {:.2} s", self.iterations, self.seconds)?;
        if let Some(psnr) = self.train_psnr_db {
            writeln!(f, "  used views     {psnr:.2} dB ({})", self.views.saturating_sub(self.held_out.len()))?;
        }
        if let Some(psnr) = self.held_out_psnr_db {
            writeln!(f, "  held-out views {psnr:.2} dB ({})", self.held_out.len())?;
        }
        if let Some(mb) = self.peak_memory_mb {
            writeln!(f, "  peak memory    {mb:.0} MB")?;
        }
        if let Some(page) = &self.report {
            writeln!(f, "  report         {}", page.display())?;
        }
        write_warnings(f, &self.warnings)
    }
}
