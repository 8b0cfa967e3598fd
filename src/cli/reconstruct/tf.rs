//! `cumulo reconstruct tf`: the transfer function that a known volume was rendered with.

use crate::app::reconstruct::TransferFunctionSettings;
use crate::app::reconstruct::transfer::Choice;
use crate::cli::args::read_as;
use crate::cli::args::single::{Layer, PageFolder, Resume, ScalarGrid};
use crate::cli::memory::Memory;
use crate::cli::parse;
use crate::render::quadrature::{Quadrature, rules};
use std::path::PathBuf;

/// Reconstruct the transfer function of a known volume from pictures of it
///
/// The pictures' density scale is divided out. How smooth the function is, the held-out view decides, unless --smooth
/// says so. Ctrl-C writes what is there (exit code 130); --resume goes on from it.
#[derive(Debug, clap::Args)]
struct TransferFunctionArgs {
    /// transforms.json of the pictures, a model of COLMAP, or the folder of either
    capture: PathBuf,
    /// The volume in the pictures
    #[arg(long, value_name = "V.vdb")]
    volume: PathBuf,
    /// Transfer function to write
    #[arg(long, short, value_name = "OUT.tf.json")]
    output: PathBuf,
    /// Texels of the function
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(2..=1024))]
    texels: u32,
    /// Densities that the texels cover (default: those of the volume, from 0)
    #[arg(long, value_name = "LOW,HIGH", value_parser = parse::ascending, allow_hyphen_values = true)]
    domain: Option<[f64; 2]>,
    /// How the function is found: auto is Gauss and Newton's least squares
    #[arg(long, value_enum, default_value_t = Choice::Auto)]
    solver: Choice,
    /// Weight of the smoothness prior beside the pictures (default: the best for the held-out view; weiss2021: 0.4)
    #[arg(long, value_name = "W", value_parser = parse::positive)]
    smooth: Option<f64>,
    /// Number of views to hold out: these are not fitted, but compared with (default: 1 if there are 3 or more)
    #[arg(long, value_name = "N")]
    held_out: Option<usize>,
    /// Pixels drawn from the pictures
    #[arg(
        long,
        value_name = "N",
        default_value_t = 32_768,
        value_parser = clap::value_parser!(u32).range(64..=16_777_216),
    )]
    rays: u32,
    /// Most refinements (default: 14, or one for each of the 7 weights that held-out views choose from; weiss2021: 200
    /// epochs)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    iterations: Option<u32>,
    #[arg(
        long,
        value_name = "Q",
        default_value = "midpoint:0.5",
        help = concat!("Integration along rays: ", rules!())
    )]
    quadrature: Quadrature,
    /// Start from this transfer function, whatever made it
    #[arg(long, value_name = "FILE")]
    init: Option<PathBuf>,
    #[command(flatten)]
    resume: Resume,
    #[command(flatten)]
    grid: ScalarGrid,
    #[command(flatten)]
    layer: Layer,
    #[command(flatten)]
    report: PageFolder,
    #[command(flatten)]
    memory: Memory,
}

impl From<TransferFunctionArgs> for TransferFunctionSettings {
    fn from(args: TransferFunctionArgs) -> Self {
        Self {
            capture: args.capture,
            volume: args.volume,
            output: args.output,
            texels: args.texels,
            domain: args.domain,
            solver: args.solver,
            smooth: args.smooth,
            held_out: args.held_out,
            rays: args.rays,
            iterations: args.iterations,
            quadrature: args.quadrature,
            init: args.init,
            resume: args.resume.into(),
            grid: args.grid.into(),
            layer: args.layer.into(),
            report: args.report.into(),
            limits: args.memory.limits(),
        }
    }
}

read_as!(TransferFunctionSettings, TransferFunctionArgs);
