//! `cumulo reconstruct color`: a pre-shaded volume from emission-absorption pictures.

use crate::app::reconstruct::{ColorSettings, RegionSettings};
use crate::cli::args::read_as;
use crate::cli::args::single::{HeldOut, Layer, PageFolder, Resume};
use crate::cli::memory::Memory;
use std::path::PathBuf;

/// Reconstruct a pre-shaded volume from emission-absorption pictures: extinction and emitted color by voxel
///
/// Alpha tells the extinctions (grid 'density', per world length), the colors then tell what is emitted (grid
/// 'emission', vec3s, radiance per world length); grids of confidences, 0 to 1, say how much the pictures tell of
/// either in each voxel. `cumulo render --model pre-shaded` renders the result. Ctrl-C
/// writes what is there (exit code 130); --resume goes on from it.
#[derive(Debug, clap::Args)]
struct ColorArgs {
    /// transforms.json of the pictures, a model of COLMAP, or the folder of either
    capture: PathBuf,
    /// VDB to write
    #[arg(long, short, value_name = "OUT.vdb")]
    output: PathBuf,
    #[command(flatten)]
    region: RegionSettings,
    #[command(flatten)]
    held_out: HeldOut,
    /// Iterations of the extinctions on the finest level, at most
    #[arg(long, value_name = "N", default_value_t = 24, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    iterations: u32,
    /// Blur passes of the smoothness prior (default: as many as suit the held-out views and the pictures' noise)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=64))]
    smoothing: Option<u32>,
    #[command(flatten)]
    layer: Layer,
    #[command(flatten)]
    report: PageFolder,
    /// Start from this pre-shaded volume, whatever made it
    #[arg(long, value_name = "IN.vdb")]
    init: Option<PathBuf>,
    #[command(flatten)]
    resume: Resume,
    #[command(flatten)]
    memory: Memory,
}

impl From<ColorArgs> for ColorSettings {
    fn from(args: ColorArgs) -> Self {
        Self {
            capture: args.capture,
            output: args.output,
            region: args.region,
            held_out: args.held_out.into(),
            iterations: args.iterations,
            smoothing: args.smoothing,
            layer: args.layer.into(),
            report: args.report.into(),
            init: args.init,
            resume: args.resume.into(),
            limits: args.memory.limits(),
        }
    }
}

read_as!(ColorSettings, ColorArgs);
