//! `cumulo validate`: faults of files, with remedies.

use super::args::read_as;
use super::memory::Memory;
use crate::app::scan::ScanSettings;
use crate::app::sequence::FrameSelection;
use crate::app::validate::ValidateSettings;
use std::path::PathBuf;

/// Say what is wrong with files and what to do; exit code 1 if anything is
///
/// Of a sequence, 'smoke.####.vdb' or a folder of numbered files, each frame is checked, and so is the whole: frames
/// that are missing, names, types of values and voxel sizes that change, and frames whose largest value or sum leaps.
/// Warnings, such as pixels that contradict what a capture states, do not change the exit code.
#[derive(Debug, clap::Args)]
struct ValidateArgs {
    /// OpenVDB, NanoVDB or OpenEXR files, USD stages, captures (a transforms.json, a model of COLMAP, or the folder of
    /// either) with their pictures, scans and arrays in the formats that `cumulo convert` reads, and sequences of files
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    #[command(flatten)]
    frames: FrameSelection,
    #[command(flatten)]
    scan: ScanSettings,
    #[command(flatten)]
    memory: Memory,
}

impl From<ValidateArgs> for ValidateSettings {
    fn from(args: ValidateArgs) -> Self {
        Self { files: args.files, frames: args.frames, scan: args.scan, limits: args.memory.limits() }
    }
}

read_as!(ValidateSettings, ValidateArgs);
