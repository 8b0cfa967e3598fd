//! `cumulo diff`: how far the grids of two VDB files are apart.

use super::args::read_as;
use super::memory::Memory;
use super::parse::positive;
use crate::app::diff::{DiffSettings, Voxels};
use crate::app::scan::ScanSettings;
use crate::app::sequence::FrameSelection;
use std::path::PathBuf;

/// Compare the grids of two volumes, or of two sequences of them; exit code 1 if they differ
#[derive(Debug, clap::Args)]
#[command(after_help = "PSNR is taken over the union of the two boxes of active voxels on A's lattice, with the \
    largest |A| as its peak; it is null in JSON for grids of equal values. Where the transforms differ, B \
    is sampled trilinearly at A's voxel centers, of which --voxels are compared, evenly spread, if there are more. \
    Differences are measured in 32-bit floats; values of wider types that agree in these alone are told. Grids are \
    paired by name; the only grids of both files are compared whatever their names, but names that differ are a \
    difference, unless the grid is chosen with --grid. Where scalars differ as they lie and agree after a turn by 90 \
    degrees about x, Y-up against Z-up, the report says so. Up axes and creators that differ are told; files that \
    state different up axes differ.")]
struct DiffArgs {
    /// The reference: VDB, NanoVDB or scan
    a: PathBuf,
    /// VDB, NanoVDB or scan to compare with the reference
    b: PathBuf,
    /// Compare only this grid
    #[arg(long, value_name = "NAME")]
    grid: Option<String>,
    #[command(flatten)]
    scan: ScanSettings,
    /// Largest absolute difference that counts as equal
    #[arg(long, value_name = "MAX_ABS", default_value_t = 0.0)]
    tolerance: f64,
    /// Voxels to compare where the transforms differ: a number such as 1e8, or all (default: 6.7e7)
    #[arg(long, value_name = "N|all", value_parser = voxels)]
    voxels: Option<Voxels>,
    #[command(flatten)]
    frames: FrameSelection,
    #[command(flatten)]
    memory: Memory,
}

impl From<DiffArgs> for DiffSettings {
    fn from(args: DiffArgs) -> Self {
        Self {
            a: args.a,
            b: args.b,
            grid: args.grid,
            scan: args.scan,
            tolerance: args.tolerance,
            voxels: args.voxels.unwrap_or_default(),
            frames: args.frames,
            limits: args.memory.limits(),
        }
    }
}

read_as!(DiffSettings, DiffArgs);

/// Parses a number of voxels, or `all`.
fn voxels(text: &str) -> Result<Voxels, String> {
    if text == "all" {
        return Ok(Voxels::All);
    }
    positive(text).map(|voxels| Voxels::About(voxels as u64))
}
