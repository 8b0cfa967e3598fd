//! `cumulo reconstruct density`: a VDB from absorption or emission-absorption pictures.

use crate::app::reconstruct::density::{Choice, Loss};
use crate::app::reconstruct::{DensitySettings, RefinementSettings, RegionSettings};
use crate::app::transfer::TransferSettings;
use crate::cli::args::read_as;
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
    /// How the densities are found: auto is cg where the pictures depend on the optical depth alone, colors first
    /// where there is a transfer function, else weiss2021
    #[arg(long, value_enum, default_value_t = Choice::Auto)]
    solver: Choice,
    /// Number of views to hold out: these are not fitted, but decide when to stop (default: one of 8 or more)
    #[arg(long, value_name = "K")]
    held_out: Option<usize>,
    /// Iterations on the finest level, at most (default: 24, or 40 where the pictures have noise; with a transfer
    /// function, or weiss2021: 50 epochs)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    iterations: Option<u32>,
    /// Blur passes of the smoothness prior (default: as many as suit the held-out views, without these 1; where the
    /// pictures have noise, differences of neighbours are penalised instead, as suits these views)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=64))]
    smoothing: Option<u32>,
    /// Prior on neighbouring voxels of a descent (through a transfer function, or weiss2021): smooth=W, or tv=W for
    /// total variation, W the weight in units of the range of densities (default: smooth=0.001, weiss2021 smooth=0.5)
    #[arg(long, value_name = "NAME=W")]
    prior: Option<Weighted<VolumePrior>>,
    /// Loss that cg minimises: huber bounds the influence of outliers, l2 is plain least squares
    #[arg(long, value_enum, default_value_t = Loss::Huber)]
    loss: Loss,
    /// Layer of the pictures (default: the beauty)
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// Name of the grid
    #[arg(long, value_name = "NAME", default_value = "density")]
    grid: String,
    /// Write a page that shows how it went
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Go on from the output, if the same command has left one, however far it went
    #[arg(long, conflicts_with = "init")]
    resume: bool,
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
            solver: args.solver,
            held_out: args.held_out,
            iterations: args.iterations,
            smoothing: args.smoothing,
            prior: args.prior,
            loss: args.loss,
            layer: args.layer,
            grid: args.grid,
            report: args.report,
            resume: args.resume,
            checkpoint: args.checkpoint,
            limits: args.memory.limits(),
        }
    }
}

read_as!(DensitySettings, DensityArgs);
