//! `cumulo compare`: how far apart two pictures, or two sequences, are.

mod statistical;

use super::args::read_as;
use super::memory::Memory;
use crate::app::compare::{CompareSettings, StatisticalSettings};
use crate::app::sequence::FrameSelection;
use std::path::PathBuf;

/// Compare two EXR pictures, or two sequences of them
///
/// Exit code 0 if they agree, 1 if they differ, 2 if they cannot be compared. Figures are of the colors in
/// scene-linear values unless --display is given; psnr_db refers to white, or to the second picture's peak if that is
/// brighter. Colors of other primaries (the attribute chromaticities) are converted to those of the second picture;
/// another pixel aspect or display window is a difference. Of sequences,
/// 'a.####.exr' or a folder of numbered files, frames of equal number are compared; flicker_psnr_db is of the changes
/// from frame to frame.
#[derive(Debug, clap::Args)]
struct CompareArgs {
    /// Picture to compare
    a: PathBuf,
    /// Reference picture
    b: PathBuf,
    #[command(flatten)]
    frames: FrameSelection,
    /// Layer of both files (default: the beauty)
    #[arg(long, value_name = "NAME")]
    layer: Option<String>,
    /// Largest absolute difference that still counts as agreement
    #[arg(long, value_name = "T", default_value_t = 0.0)]
    tolerance: f64,
    /// Write the absolute difference of each pixel as a PNG in false colors
    #[arg(long, value_name = "OUT.png")]
    heatmap: Option<PathBuf>,
    /// Write a page with plots over the frames of two sequences, and both as a moving picture with their differences
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Another sequence to compare with the second and to show in the report, such as the noisy one
    #[arg(long, value_name = "C.####.exr")]
    beside: Option<PathBuf>,
    /// Compare display values (sRGB, clipped to 0..1) instead of scene-linear ones
    #[arg(long)]
    display: bool,
    /// Compute FLIP, too, a difference as people see it (0 to 1), of display values
    #[arg(long)]
    flip: bool,
    #[command(flatten)]
    statistical: StatisticalSettings,
    #[command(flatten)]
    memory: Memory,
}

impl From<CompareArgs> for CompareSettings {
    fn from(args: CompareArgs) -> Self {
        Self {
            a: args.a,
            b: args.b,
            frames: args.frames,
            layer: args.layer,
            tolerance: args.tolerance,
            heatmap: args.heatmap,
            report: args.report,
            beside: args.beside,
            display: args.display,
            flip: args.flip,
            statistical: args.statistical,
            limits: args.memory.limits(),
        }
    }
}

read_as!(CompareSettings, CompareArgs);
