//! `cumulo validate`: faults of files, with remedies.

use super::args::read_as;
use super::memory::Memory;
use super::output::Output;
use crate::app::sequence::FrameSelection;
use crate::app::validate::ValidateSettings;
use crate::error::Result;
use std::path::PathBuf;
use std::process::ExitCode;

/// Say what is wrong with files and what to do; exit code 1 if anything is
///
/// Of a sequence, 'smoke.####.vdb' or a folder of numbered files, each frame is checked, and so is the whole: frames
/// that are missing, names, types of values and voxel sizes that change, and frames whose largest value or sum leaps.
/// Warnings, such as pixels that contradict what a capture states, do not change the exit code.
#[derive(Debug, clap::Args)]
struct ValidateArgs {
    /// OpenVDB, NanoVDB or OpenEXR files, USD stages, captures (a transforms.json, a model of COLMAP, or the folder of
    /// either) with their pictures, and sequences of files
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    #[command(flatten)]
    frames: FrameSelection,
    #[command(flatten)]
    memory: Memory,
}

impl From<ValidateArgs> for ValidateSettings {
    fn from(args: ValidateArgs) -> Self {
        Self { files: args.files, frames: args.frames, limits: args.memory.limits() }
    }
}

read_as!(ValidateSettings, ValidateArgs);

/// Checks and reports. The exit code is 1 if a fault was found, and 2 if a file or a frame could not be read.
///
/// # Errors
/// Those of [`ValidateSettings::run`].
pub(crate) fn run(settings: &ValidateSettings, output: &Output) -> Result<ExitCode> {
    let report = settings.run(output)?;
    output.report(&report)?;
    Ok(ExitCode::from(if report.complete() { u8::from(!report.valid()) } else { 2 }))
}
