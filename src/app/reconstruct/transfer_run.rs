//! The record of a transfer function's reconstruction, kept beside the page so that the page can be made again.

use crate::app::checks::Warning;
use crate::app::provenance::Provenance;
use crate::app::run;
use crate::inverse::cost::Cost;
use crate::inverse::progress::Stage;
use crate::inverse::transfer::{Solver, Step};
use crate::render::quadrature::Quadrature;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::{Path, PathBuf};

/// Record of a reconstruction of a transfer function.
#[derive(Debug, Clone, Serialize, Deserialize, schemars::JsonSchema)]
pub struct TransferRun {
    /// Path of the pictures' transforms.json.
    #[serde(serialize_with = "crate::app::paths::text")]
    pub capture: PathBuf,
    /// Path of the volume in the pictures.
    #[serde(serialize_with = "crate::app::paths::text")]
    pub volume: PathBuf,
    /// Grid of the volume, if `grid` names one.
    pub grid: Option<String>,
    /// Path of the transfer function that was written.
    #[serde(serialize_with = "crate::app::paths::text")]
    pub output: PathBuf,
    /// Solver of the texels.
    pub solver: Solver,
    /// Layer of the pictures, if `layer` names one.
    pub layer: Option<String>,
    /// Number of texels.
    pub texels: u32,
    /// Range of densities that the texels cover.
    pub domain: [f64; 2],
    /// Weight of the smoothness prior.
    pub smooth: f64,
    /// Number of refinements, or of epochs.
    pub iterations: usize,
    /// Wall time in seconds up to the writing of the function.
    pub seconds: f64,
    /// Root mean square difference over the rays of the training views, after the last step.
    pub train_rms: Option<f64>,
    /// Number of views.
    pub views: usize,
    /// Numbers of the held-out views.
    pub held_out: Vec<usize>,
    /// Numbers of the views that the page shows.
    pub shown: Vec<usize>,
    /// PSNR of the held-out views in dB, peak 1; none without such views.
    pub held_out_psnr_db: Option<f64>,
    /// Structural similarity of the held-out views, mean over views; none without such views.
    pub held_out_ssim: Option<f64>,
    /// Quadrature of the rays.
    pub quadrature: Quadrature,
    /// Largest resident memory of the process in MB (2²⁰ bytes); none where the system does not tell.
    pub peak_memory_mb: Option<f64>,
    /// True if the user stopped the work.
    pub stopped: bool,
    /// Cost that was expected before the work.
    #[serde(default)]
    pub expected: Option<Cost>,
    /// Contradictions between pictures and model, found before and after the work.
    #[serde(default)]
    pub warnings: Vec<Warning>,
    /// Path of the page, if `report` requests one.
    #[serde(serialize_with = "crate::app::paths::text")]
    pub report: Option<PathBuf>,
    /// Confidence of each texel's extinction and color, 0 to 1: the share of the pictures beside that of the prior;
    /// empty after a descent.
    pub confidence: Vec<[f64; 2]>,
    /// Wall time of each stage.
    pub stages: Vec<Stage>,
    /// Every refinement or epoch.
    pub history: Vec<Step>,
    /// Version, command line and hashes of the inputs.
    pub provenance: Provenance,
}

impl TransferRun {
    /// Returns a copy of the record with `map` applied to the paths of capture, volume and output.
    #[must_use]
    pub(in crate::app) fn with_paths(&self, map: fn(&Path) -> PathBuf) -> Self {
        Self { capture: map(&self.capture), volume: map(&self.volume), output: map(&self.output), ..self.clone() }
    }
}

impl fmt::Display for TransferRun {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [low, high] = self.domain;
        let steps = self.solver.steps();
        writeln!(f, "{}: {} texels over densities {low} to {high}", self.output.display(), self.texels)?;
        writeln!(f, "  {} {steps} in {:.2} s, smoothness {:.0e}", self.iterations, self.seconds, self.smooth)?;
        if let (Some(psnr), Some(ssim)) = (self.held_out_psnr_db, self.held_out_ssim) {
            writeln!(f, "  held-out views {psnr:.2} dB, SSIM {ssim:.4} ({})", self.held_out.len())?;
        }
        let unseen = self.confidence.iter().filter(|c| c[0] < 0.5).count();
        if unseen > 0 {
            let texels = if self.texels == 1 { "texel" } else { "texels" };
            writeln!(
                f,
                "  {unseen} of {} {texels} follow from the smoothness prior more than from the pictures",
                self.texels
            )?;
        }
        if let Some(page) = &self.report {
            writeln!(f, "  report         {}", page.display())?;
        }
        run::write_warnings(f, &self.warnings)
    }
}
