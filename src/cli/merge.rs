//! `cumulo merge`: pictures of one scene joined.

use super::args::read_as;
use super::args::single::{Confidence, Overwrite};
use super::memory::Memory;
use super::parse;
use crate::app::render::MergeSettings;
use std::path::PathBuf;

/// Join pictures of the same view: those of a farm's replicates or of other seeds, and the samples of deep ones
///
/// Pictures are weighted by their paths. Those of render --replicates A-B are joined to the bits of the picture that
/// one machine would have rendered, whatever their order; the error of the whole is stated, and the result can be
/// joined again.
///
/// Deep pictures become one with the samples of all, sorted by depth: parts that render --crop made, or several
/// elements of a shot.
#[derive(Debug, clap::Args)]
struct MergeArgs {
    /// Pictures by render: parts of --replicates A-B, of different --seed, or joined ones; with --target-error or
    /// --time those of --aov replicates
    #[arg(value_name = "PICTURE", required = true)]
    inputs: Vec<PathBuf>,
    /// OpenEXR of the joined picture
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Error that each block is to have at most, by the scale: where one is known to have more, the exit code is 1, and
    /// the report says which replicates are missing
    #[arg(long, value_name = "E", value_parser = parse::positive)]
    target_error: Option<f64>,
    #[command(flatten)]
    confidence: Confidence,
    #[command(flatten)]
    memory: Memory,
}

impl From<MergeArgs> for MergeSettings {
    fn from(args: MergeArgs) -> Self {
        Self {
            inputs: args.inputs,
            output: args.output,
            overwrite: args.overwrite.into(),
            target_error: args.target_error,
            confidence: args.confidence.into(),
            limits: args.memory.limits(),
        }
    }
}

read_as!(MergeSettings, MergeArgs);
