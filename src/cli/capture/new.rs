//! `cumulo capture new`: cameras without pictures.

use crate::app::capture::NewCaptureSettings;
use crate::app::pictures::PictureSettings;
use crate::cli::args::read_as;
use crate::cli::args::single::Overwrite;
use std::path::PathBuf;

/// Write the cameras that a render would have, without pictures: for `cumulo render --cameras`
///
/// Cameras are placed and stated as `cumulo render` does, and numbered from 0. What a capture states of the medium is
/// written with them.
#[derive(Debug, clap::Args)]
struct NewArgs {
    /// Capture to write, name.json; or a folder for a transforms.json
    #[arg(long, short, value_name = "OUT.json|DIR")]
    output: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
    #[command(flatten)]
    pictures: PictureSettings,
}

impl From<NewArgs> for NewCaptureSettings {
    fn from(args: NewArgs) -> Self {
        Self { output: args.output, overwrite: args.overwrite.into(), pictures: args.pictures }
    }
}

read_as!(NewCaptureSettings, NewArgs);
