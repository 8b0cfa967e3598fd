//! `cumulo reconstruct color`: a pre-shaded volume from emission-absorption pictures.

use crate::app::reconstruct::{ColorSettings, RegionSettings};
use crate::cli::args::read_as;
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
    /// Number of views to hold out: these are not fitted, but decide when to stop (default: one of 8 or more)
    #[arg(long, value_name = "K")]
    held_out: Option<usize>,
    /// Iterations of the extinctions on the finest level, at most
    #[arg(long, value_name = "N", default_value_t = 24, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    iterations: u32,
    /// Blur passes of the smoothness prior (default: as many as suit the held-out views and the pictures' noise)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=64))]
    smoothing: Option<u32>,
    /// Layer of the pictures (default: the beauty)
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// Write a page that shows how it went
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Start from this pre-shaded volume, whatever made it
    #[arg(long, value_name = "IN.vdb")]
    init: Option<PathBuf>,
    /// Go on from the output, if the same command has left one, however far it went
    #[arg(long, conflicts_with = "init")]
    resume: bool,
    #[command(flatten)]
    memory: Memory,
}

impl From<ColorArgs> for ColorSettings {
    fn from(args: ColorArgs) -> Self {
        Self {
            capture: args.capture,
            output: args.output,
            region: args.region,
            held_out: args.held_out,
            iterations: args.iterations,
            smoothing: args.smoothing,
            layer: args.layer,
            report: args.report,
            init: args.init,
            resume: args.resume,
            limits: args.memory.limits(),
        }
    }
}

read_as!(ColorSettings, ColorArgs);
