//! `cumulo study render`: error against time of pictures.

use crate::app::pictures::PictureSettings;
use crate::app::study::StudyOptions;
use crate::app::study::render::{Knob, RenderStudySettings};
use crate::cli::args::read_as;

/// Measure the error of pictures against the time that they take, and recommend the options of render for them
///
/// Takes the options of render. All combinations of the settings that are varied are rendered several times in a
/// shuffled order. The reference is exact quadrature without early stop and with 256 rays a pixel, where supersample is
/// varied, or many paths by 16 independent seeds; without --size, pictures are as large as --budget allows.
#[derive(Debug, clap::Args)]
struct RenderStudyArgs {
    #[command(flatten)]
    study: StudyOptions,
    /// Settings to vary (default: quadrature, step, early-stop and supersample; samples and max-bounces of paths)
    #[arg(long, value_enum, value_name = "NAME,...", value_delimiter = ',')]
    knobs: Vec<Knob>,
    /// Frame of a sequence (default: the first)
    #[arg(long, value_name = "N")]
    frame: Option<u32>,
    #[command(flatten)]
    pictures: PictureSettings,
}

impl From<RenderStudyArgs> for RenderStudySettings {
    fn from(args: RenderStudyArgs) -> Self {
        Self { study: args.study, knobs: args.knobs, frame: args.frame, pictures: args.pictures }
    }
}

read_as!(RenderStudySettings, RenderStudyArgs);
