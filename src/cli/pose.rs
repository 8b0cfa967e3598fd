//! `cumulo pose`: cameras that agree with their pictures.

use super::args::read_as;
use super::args::single::{Layer, PageFolder, Resume, ScalarGrid};
use super::memory::Memory;
use crate::app::pose::PoseSettings;
use crate::app::transfer::TransferSettings;
use crate::render::quadrature::{Quadrature, rules};
use std::path::PathBuf;

/// Find where cameras stood, from their pictures and the volume in them
///
/// Cameras of the capture are where the search begins: a few degrees and a few percent of the distance off. Position
/// and rotation of each are moved until what it sees of the volume is its picture. A camera that finds no such place
/// nearby is named, and stays where it was if the search went far. Where the capture's model is pre-shaded, the volume
/// needs a grid 'emission' beside its extinctions. Ctrl-C writes what is there (exit code 130); --resume goes on from
/// it.
#[derive(Debug, clap::Args)]
struct PoseArgs {
    /// transforms.json of the pictures, a model of COLMAP, or the folder of either
    capture: PathBuf,
    /// Volume in the pictures
    #[arg(long, value_name = "IN.vdb")]
    volume: PathBuf,
    /// Capture (JSON) with the new cameras, and the same pictures
    #[arg(long, short, value_name = "OUT.json")]
    output: PathBuf,
    #[command(flatten)]
    transfer: TransferSettings,
    /// Find the focal length, too: one factor for all cameras
    #[arg(long)]
    solve_focal: bool,
    /// Steps on each size of pictures that the search goes through, at most
    #[arg(long, value_name = "N", default_value_t = 40, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    iterations: u32,
    #[arg(
        long,
        value_name = "Q",
        help = concat!(
            "Integration along rays: ",
            rules!(),
            "; by default exact; through functions of more than 32 points preintegrated for the search, and at its end \
             exact ",
            "for the pictures compared with",
        )
    )]
    quadrature: Option<Quadrature>,
    #[command(flatten)]
    layer: Layer,
    #[command(flatten)]
    grid: ScalarGrid,
    #[command(flatten)]
    report: PageFolder,
    /// Begin with the cameras of this capture of the same pictures, whatever made it
    #[arg(long, value_name = "IN.json")]
    init: Option<PathBuf>,
    #[command(flatten)]
    resume: Resume,
    #[command(flatten)]
    memory: Memory,
}

impl From<PoseArgs> for PoseSettings {
    fn from(args: PoseArgs) -> Self {
        Self {
            capture: args.capture,
            volume: args.volume,
            output: args.output,
            transfer: args.transfer,
            solve_focal: args.solve_focal,
            iterations: args.iterations,
            quadrature: args.quadrature,
            layer: args.layer.into(),
            grid: args.grid.into(),
            report: args.report.into(),
            init: args.init,
            resume: args.resume.into(),
            limits: args.memory.limits(),
        }
    }
}

read_as!(PoseSettings, PoseArgs);
