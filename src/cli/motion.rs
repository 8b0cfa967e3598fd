//! `cumulo motion`: how what pictures of a volume show moves from frame to frame.

use super::args::read_as;
use super::args::single::{Overwrite, ScalarGrid};
use super::args::velocity::Velocity;
use super::memory::Memory;
use super::parse;
use crate::app::motion::{MotionFormat, MotionSettings, SAMPLES};
use crate::app::scan::ScanSettings;
use crate::app::transfer::TransferSettings;
use crate::formats::sequence::Frames;
use std::path::PathBuf;

/// Write the motion of what pictures of a volume show, as a layer that denoisers follow
///
/// A pixel's motion is the mean over the first collisions of its rays with the volume, in pixels to the right and
/// upwards. `cumulo denoise --motion files:'motion.####.exr'` takes the layer `Vector`, and the alpha that is with it:
/// give the transfer function and the density scale that the pictures show. --format writes the layers of other
/// programs.
#[derive(Debug, clap::Args)]
struct MotionArgs {
    /// VDB, NanoVDB or scan of all frames, or of each: 'smoke.####.vdb'; or a scene file or USD stage
    input: PathBuf,
    /// Cameras of the frames, in a transforms.json whose pictures bear the frames' numbers; or the one of all
    #[arg(long, value_name = "CAPTURE")]
    cameras: PathBuf,
    /// Pictures of the motion, numbered as the frames are
    #[arg(long, short, value_name = "OUT.####.exr")]
    output: PathBuf,
    /// Frames: A, A-B or A-BxSTEP (default: those of the cameras, else of the volumes)
    #[arg(long, value_name = "A-B")]
    frames: Option<Frames>,
    #[command(flatten)]
    grid: ScalarGrid,
    #[command(flatten)]
    scan: ScanSettings,
    /// Extinction per world unit at a density of 1 (default: that of the cameras' capture)
    #[arg(long, value_name = "S", value_parser = parse::positive)]
    density_scale: Option<f64>,
    #[command(flatten)]
    transfer: TransferSettings,
    #[command(flatten)]
    velocity: Velocity,
    /// Layers of the motion
    #[arg(long, value_enum, default_value_t)]
    format: MotionFormat,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Rays per pixel
    #[arg(
        long,
        value_name = "N",
        default_value_t = SAMPLES,
        value_parser = clap::value_parser!(u32).range(1..=1 << 16),
    )]
    samples: u32,
    #[command(flatten)]
    memory: Memory,
}

impl From<MotionArgs> for MotionSettings {
    fn from(args: MotionArgs) -> Self {
        Self {
            input: args.input,
            cameras: args.cameras,
            output: args.output,
            frames: args.frames,
            grid: args.grid.into(),
            scan: args.scan,
            density_scale: args.density_scale,
            transfer: args.transfer,
            velocity: args.velocity.velocity,
            fps: args.velocity.fps,
            format: args.format,
            overwrite: args.overwrite.into(),
            samples: args.samples,
            limits: args.memory.limits(),
        }
    }
}

read_as!(MotionSettings, MotionArgs);
