//! `cumulo selftest`: the numerics of the program on this machine.

use super::args::read_as;
use super::memory::Memory;
use crate::app::selftest::SelftestSettings;

/// Check the numerics of the program on this machine; exit code 1 if a case fails
///
/// Each case runs the program's own code on input that a naive formula fails on, such as opaque samples, rays along the
/// faces of voxels, and volumes far from the origin, and compares it with double precision or a closed form. Beside its
/// error stand the largest that passes, and that of the naive formula. All cases take a few seconds.
#[derive(Debug, clap::Args)]
struct SelftestArgs {
    /// Cases or areas to run: dvr, transfer-function, path-tracing, denoising, reconstruction, geometry (default: all)
    #[arg(value_name = "CASE|AREA")]
    cases: Vec<String>,
    #[command(flatten)]
    memory: Memory,
}

impl From<SelftestArgs> for SelftestSettings {
    fn from(args: SelftestArgs) -> Self {
        Self { cases: args.cases, limits: args.memory.limits() }
    }
}

read_as!(SelftestSettings, SelftestArgs);
