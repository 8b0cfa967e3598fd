//! `cumulo reconstruct density`: a VDB from absorption or emission-absorption pictures.

use crate::app::reconstruct::density::Loss;
use crate::app::reconstruct::{DensitySettings, RefinementSettings, RegionSettings};
use crate::app::transfer::TransferSettings;
use crate::cli::args::density::DensityCost;
use crate::cli::args::read_as;
use crate::cli::args::single::{Layer, PageFolder, Resume};
use crate::cli::memory::Memory;
use crate::cli::parse;
use crate::differentiate::loss::prior::{VolumePrior, Weighted};
use std::path::PathBuf;

/// Reconstruct the density of a volume from pictures of it
///
/// The pictures' density scale is divided out, so that the result stands beside the volume that was rendered. Ctrl-C
/// writes what is there (exit code 130); --resume goes on from it.
#[derive(Debug, clap::Args)]
struct DensityArgs {
    /// transforms.json of the pictures, a model of COLMAP, or the folder of either
    capture: PathBuf,
    /// VDB to write
    #[arg(long, short, value_name = "OUT.vdb")]
    output: PathBuf,
    #[command(flatten)]
    region: RegionSettings,
    #[command(flatten)]
    refinement: RefinementSettings,
    #[command(flatten)]
    transfer: TransferSettings,
    /// Start from this volume, whatever made it
    #[arg(long, value_name = "IN.vdb")]
    init: Option<PathBuf>,
    #[command(flatten)]
    cost: DensityCost,
    /// Prior on neighbouring voxels of a descent (through a transfer function, or weiss2021): smooth=W, or tv=W for
    /// total variation, W the weight in units of the range of densities (default: smooth=0.001, weiss2021 smooth=0.5)
    #[arg(long, value_name = "NAME=W")]
    prior: Option<Weighted<VolumePrior>>,
    /// Loss that cg minimises: huber bounds the influence of outliers, l2 is plain least squares
    #[arg(long, value_enum, default_value_t = Loss::Huber)]
    loss: Loss,
    #[command(flatten)]
    layer: Layer,
    /// Name of the grid
    #[arg(long, value_name = "NAME", default_value = "density")]
    grid: String,
    #[command(flatten)]
    report: PageFolder,
    #[command(flatten)]
    resume: Resume,
    /// Write what is there to the output every D, such as 10m, from which --resume goes on should the work end before
    /// its time
    #[arg(long, value_name = "D", value_parser = parse::duration)]
    checkpoint: Option<f64>,
    #[command(flatten)]
    memory: Memory,
}

impl From<DensityArgs> for DensitySettings {
    fn from(args: DensityArgs) -> Self {
        Self {
            capture: args.capture,
            output: args.output,
            region: args.region,
            refinement: args.refinement,
            transfer: args.transfer,
            init: args.init,
            solver: args.cost.solver,
            held_out: args.cost.held_out.into(),
            iterations: args.cost.iterations,
            smoothing: args.cost.smoothing,
            prior: args.prior,
            loss: args.loss,
            layer: args.layer.into(),
            grid: args.grid,
            report: args.report.into(),
            resume: args.resume.into(),
            checkpoint: args.checkpoint,
            limits: args.memory.limits(),
        }
    }
}

read_as!(DensitySettings, DensityArgs);
