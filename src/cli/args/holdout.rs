//! Options of objects that hide what is behind them.

use super::read_as;
use crate::app::render::HoldoutSettings;
use crate::cli::values::choice;
use crate::scene::holdout::DepthMeasure;
use std::path::PathBuf;

/// Options of objects that hide what is behind them.
#[derive(Debug, clap::Args)]
struct HoldoutArgs {
    /// Hold the volume out behind the objects of this depth picture, name.exr, or of this mesh in world space, name.ply
    /// or name.obj; of frames, depth.####.exr: what is behind is not seen, the background included, and alpha is that
    /// of what is before. Lights pass the objects. Rims are smooth if the depth picture has a multiple of the pixels,
    /// without --albedo with as much --supersample
    #[arg(long, value_name = "EXR|MESH")]
    holdout: Option<PathBuf>,
    /// Layer of the depth picture that has the depths (default: the only one named Depth or Z)
    #[arg(long, value_name = "NAME", requires = "holdout")]
    holdout_layer: Option<String>,
    /// Distance in world units that depths are: along the viewing axis, as in passes of Blender, or along the ray
    #[arg(long, value_parser = choice::<DepthMeasure>(), default_value = "axis", requires = "holdout")]
    holdout_depth: DepthMeasure,
}

impl From<HoldoutArgs> for HoldoutSettings {
    fn from(args: HoldoutArgs) -> Self {
        Self { holdout: args.holdout, holdout_layer: args.holdout_layer, holdout_depth: args.holdout_depth }
    }
}

read_as!(HoldoutSettings, HoldoutArgs);
