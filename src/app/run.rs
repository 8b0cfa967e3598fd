//! The record of a volume's reconstruction, kept beside the page so that the page can be made again.

use super::context;
use super::provenance::Provenance;
use crate::app::checks::Warning;
use crate::app::use_case::{Report, Status};
use crate::error::Result;
use crate::inverse::cost::Cost;
use crate::inverse::progress::{Stage, Step};
use crate::scene::capture::PixelFilter;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::PathBuf;

/// Solver of a reconstruction of voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Solver {
    /// Conjugate gradients in the smoothness prior's metric.
    Cg,
    /// Adam on the pictures, as in Weiss & Westermann (2021).
    #[serde(alias = "paper")]
    Weiss2021,
    /// Conjugate gradients on extinctions, then on emissions: a pre-shaded volume.
    #[serde(alias = "colour")]
    Color,
    /// Densities through a transfer function: a pre-shaded volume, densities matched to its colors, then a descent.
    #[serde(alias = "behind")]
    ThroughTransfer,
}

/// Record of a reconstruction of voxels.
#[derive(Debug, Clone, Serialize, Deserialize, schemars::JsonSchema)]
pub struct Run {
    /// Path of the pictures' transforms.json.
    #[serde(serialize_with = "crate::app::paths::text")]
    pub capture: PathBuf,
    /// Path of the VDB that was written.
    #[serde(serialize_with = "crate::app::paths::text")]
    pub output: PathBuf,
    /// Name of the written grid of densities or extinctions.
    pub grid: String,
    /// Solver of the voxels.
    pub solver: Solver,
    /// Layer of the pictures, if `layer` names one.
    pub layer: Option<String>,
    /// Number of iterations over all levels.
    pub iterations: u32,
    /// Wall time in seconds up to the writing of the VDB.
    pub seconds: f64,
    /// PSNR of the training views in dB, peak 1; none if the work was stopped before it was measured.
    pub train_psnr_db: Option<f64>,
    /// PSNR of the held-out views in dB, peak 1; none without such views.
    pub held_out_psnr_db: Option<f64>,
    /// Largest resident memory of the process in MB (2²⁰ bytes); none where the system does not tell.
    pub peak_memory_mb: Option<f64>,
    /// True if the user stopped the work.
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
    /// Cost that was expected before the work.
    #[serde(default)]
    pub expected: Option<Cost>,
    /// Cameras that were refined, if `refine_cameras` asks for it.
    #[serde(default)]
    pub cameras: Option<RefinedCameras>,
    /// Contradictions between pictures and model, found before and after the work.
    #[serde(default)]
    pub warnings: Vec<Warning>,
    /// Path of the page, if `report` requests one.
    #[serde(serialize_with = "crate::app::paths::text")]
    pub report: Option<PathBuf>,
    /// Wall time of each stage.
    pub stages: Vec<Stage>,
    /// Every iteration.
    pub history: Vec<Step>,
    /// Version, command line and hashes of the inputs.
    pub provenance: Provenance,
}

/// How cameras were refined.
#[derive(Debug, Clone, Serialize, Deserialize, schemars::JsonSchema)]
pub struct RefinedCameras {
    /// Path of the capture that was written with the refined cameras.
    #[serde(serialize_with = "crate::app::paths::text")]
    pub capture: PathBuf,
    /// Focal length divided by that of the capture; none if it was not to be found.
    pub focal_factor: Option<f64>,
    /// How far each camera moved, in the order of the capture's frames.
    pub motions: Vec<CameraMotion>,
}

/// How far a camera moved in its refinement.
#[derive(Debug, Clone, Serialize, Deserialize, schemars::JsonSchema)]
pub struct CameraMotion {
    /// File name of its picture.
    pub picture: String,
    /// Angle in degrees between the camera's axes before and after.
    pub rotated_degrees: f64,
    /// Distance between the positions before and after, in percent of the distance to the region's centre.
    pub moved_percent: f64,
    /// Displacement of the volume in the picture, in pixels (root mean square over the region).
    pub displaced_pixels: f64,
}

impl RefinedCameras {
    /// Returns the displacement of the pictures in pixels, a root mean square over all cameras.
    pub(crate) fn displaced_pixels(&self) -> f64 {
        self.mean(|motion| motion.displaced_pixels)
    }

    fn mean(&self, of: fn(&CameraMotion) -> f64) -> f64 {
        let sum: f64 = self.motions.iter().map(|motion| of(motion).powi(2)).sum();
        (sum / self.motions.len().max(1) as f64).sqrt()
    }
}

impl fmt::Display for RefinedCameras {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [degrees, percent] = [self.mean(|m| m.rotated_degrees), self.mean(|m| m.moved_percent)];
        let pixels = self.displaced_pixels();
        writeln!(f, "  cameras        {}", self.capture.display())?;
        writeln!(f, "    moved by {degrees:.3} degrees, {percent:.3} % of their distance, {pixels:.2} pixels (rms)")?;
        let farthest = self.motions.iter().max_by(|a, b| a.displaced_pixels.total_cmp(&b.displaced_pixels));
        if let Some(CameraMotion { picture, displaced_pixels, .. }) = farthest {
            writeln!(f, "    farthest {picture}: {displaced_pixels:.2} pixels")?;
        }
        match self.focal_factor {
            Some(factor) => writeln!(f, "    focal length times {factor:.6}"),
            None => Ok(()),
        }
    }
}

/// Returns the number of rays along each edge of a pixel that its filter is sampled with.
pub(crate) fn rays_per_edge(filter: PixelFilter) -> usize {
    match filter {
        PixelFilter::Point => 1,
        PixelFilter::Box => 2,
    }
}

/// Writes warnings as the text of a report shows them.
pub(crate) fn write_warnings(f: &mut fmt::Formatter<'_>, warnings: &[Warning]) -> fmt::Result {
    warnings.iter().try_for_each(|w| writeln!(f, "  warning: {}\n    {}", w.what, w.remedy))
}

/// Returns the largest resident memory of this process so far in MB (2²⁰ bytes); none where the system does not tell.
pub(crate) fn peak_memory_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    let kib: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib / 1024.0)
}

/// Shows the step of a reconstruction as the state of its stage.
pub(crate) fn show(stage: &context::Stage, step: &Step) {
    let psnr = step.held_out_psnr_db.map(|p| format!(", held-out {p:.2} dB")).unwrap_or_default();
    stage.reach(step.iteration.into(), format!("level {}, loss {:.3e}{psnr}", step.level, step.loss));
}

impl Report for Run {
    fn status(&self) -> Result<Status> {
        Ok(Status::stopped(self.stopped))
    }
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
        if let Some(cameras) = &self.cameras {
            write!(f, "{cameras}")?;
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
