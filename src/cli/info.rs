//! `cumulo info`: the content of files.

use super::args::read_as;
use super::memory::Memory;
use crate::app::info::InfoSettings;
use crate::app::scan::ScanSettings;
use crate::app::sequence::FrameSelection;
use std::path::PathBuf;

/// Show what is in files: grids of VDBs and NanoVDBs, layers of EXRs, cameras of captures, volumes of USD stages, scans
///
/// Of a sequence, 'smoke.####.vdb' or a folder of numbered files, each frame is shown in a line; --json has all of
/// each.
#[derive(Debug, clap::Args)]
struct InfoArgs {
    /// OpenVDB, NanoVDB or OpenEXR files, USD stages, captures (a transforms.json, a model of COLMAP, or the folder of
    /// either), scans and fields in the formats that `cumulo convert` reads, and sequences of files
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    #[command(flatten)]
    frames: FrameSelection,
    #[command(flatten)]
    scan: ScanSettings,
    #[command(flatten)]
    memory: Memory,
}

impl From<InfoArgs> for InfoSettings {
    fn from(args: InfoArgs) -> Self {
        Self { files: args.files, frames: args.frames, scan: args.scan, limits: args.memory.limits() }
    }
}

read_as!(InfoSettings, InfoArgs);
