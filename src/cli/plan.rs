//! `cumulo plan`: which effects of a scene are simulated, at what cost, and what is left out.

use super::args::read_as;
use crate::app::pictures::PictureSettings;
use crate::app::plan::PlanSettings;

/// Tell which effects `render` would simulate, what they cost, and how much radiance is left out at most
///
/// Takes the options of render. Effects that a scene does not call for are off and cost nothing; with --max-omitted,
/// more of them are left out as long as the sum of their bounds stays below that radiance, or of the limits of what
/// they contribute to the pictures, measured now on a few paths of each block of 8 x 8 pixels. Costs are those of small
/// pictures, rendered now.
#[derive(Debug, clap::Args)]
struct PlanArgs {
    /// Frame of a sequence (default: the first)
    #[arg(long, value_name = "N")]
    frame: Option<u32>,
    #[command(flatten)]
    pictures: PictureSettings,
}

impl From<PlanArgs> for PlanSettings {
    fn from(args: PlanArgs) -> Self {
        Self { frame: args.frame, pictures: args.pictures }
    }
}

read_as!(PlanSettings, PlanArgs);
