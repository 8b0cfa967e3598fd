//! `cumulo usd lint`: faults of stages, with remedies, and a layer that removes those that are safe to remove.

use crate::app::usd::lint::LintSettings;
use crate::cli::args::read_as;
use crate::cli::args::single::Overwrite;
use crate::cli::memory::Memory;
use std::path::PathBuf;

/// Say what is wrong with stages and what to do; exit code 1 if anything is
///
/// Read are .usda, .usdc, .usd and .usdz with all that they reference, and the VDBs of their volumes. Notes do not
/// count.
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("fixed").args(["overwrite"]).requires("fix"))]
struct LintArgs {
    /// Stages
    #[arg(required = true, value_name = "STAGE")]
    stages: Vec<PathBuf>,
    /// Write a layer over the stage, a .usda, that removes the faults which have one remedy; the stage stays as it is
    #[arg(long, value_name = "LAYER")]
    fix: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
    #[command(flatten)]
    memory: Memory,
}

impl From<LintArgs> for LintSettings {
    fn from(args: LintArgs) -> Self {
        let LintArgs { stages, fix, overwrite, memory } = args;
        Self { stages, fix, overwrite: overwrite.into(), limits: memory.limits() }
    }
}

read_as!(LintSettings, LintArgs);
