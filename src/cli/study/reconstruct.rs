//! `cumulo study reconstruct`: error against time of reconstructions.

use crate::app::study::StudyOptions;
use crate::app::study::reconstruct::{ReconstructKnob, ReconstructStudySettings};
use crate::cli::args::read_as;
use crate::cli::memory::Memory;
use std::path::PathBuf;

/// Measure the error of reconstructed densities against the time that they take, and recommend the options for them
///
/// Some views are kept apart, one of eight or more of few: errors are those of renders of the volume beside these
/// pictures. The folder of the page gets the captures of the other views, too, which the recommended command reads.
#[derive(Debug, clap::Args)]
struct ReconstructStudyArgs {
    /// transforms.json of the pictures, a model of COLMAP, or the folder of either
    capture: PathBuf,
    #[command(flatten)]
    study: StudyOptions,
    /// Settings to vary (default: views, resolution and iterations)
    #[arg(long, value_enum, value_name = "NAME,...", value_delimiter = ',')]
    knobs: Vec<ReconstructKnob>,
    /// Voxels along the longest edge of the region, where the resolution is not varied (default: 16, 32, 64 or 128, as
    /// --budget allows)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=65_536))]
    resolution: Option<u32>,
    #[command(flatten)]
    memory: Memory,
}

impl From<ReconstructStudyArgs> for ReconstructStudySettings {
    fn from(args: ReconstructStudyArgs) -> Self {
        let ReconstructStudyArgs { capture, study, knobs, resolution, memory } = args;
        Self { study, capture, knobs, resolution, limits: memory.limits() }
    }
}

read_as!(ReconstructStudySettings, ReconstructStudyArgs);
