//! `--refine-cameras`: cameras that are found together with the volume.

use super::read_as;
use crate::app::reconstruct::RefinementSettings;
use crate::app::reconstruct::refinement::Refined;
use std::path::PathBuf;

/// Options for cameras that are only nearly known.
#[derive(Debug, clap::Args)]
struct RefinementArgs {
    /// Move the cameras to where all pictures agree on one volume: their positions and rotations, with focal a factor
    /// of the focal length, too, that all share. The scene as a whole stays where the given cameras have it
    #[arg(
        long,
        value_enum,
        value_name = "WHAT",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "pose",
        conflicts_with_all = ["resume", "init"]
    )]
    refine_cameras: Option<Refined>,
    /// Capture (JSON) to write with the refined cameras, and the same pictures (default: OUT.cameras.json)
    #[arg(long, value_name = "OUT.json", requires = "refine_cameras")]
    cameras: Option<PathBuf>,
}

impl From<RefinementArgs> for RefinementSettings {
    fn from(args: RefinementArgs) -> Self {
        Self { refine_cameras: args.refine_cameras, cameras: args.cameras }
    }
}

read_as!(RefinementSettings, RefinementArgs);
