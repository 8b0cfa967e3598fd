//! Options of the blur of pictures by the camera.

use super::read_as;
use crate::app::render::BlurSettings;
use crate::cli::parse;

/// Options of the blur of pictures by the camera.
#[derive(Debug, clap::Args)]
struct BlurArgs {
    /// Depth of field: radius of the camera's aperture in world units, 0 for sharp pictures (default: that of the
    /// camera in --cameras or in the stage)
    #[arg(long, value_name = "RADIUS", value_parser = parse::not_negative, allow_negative_numbers = true)]
    aperture: Option<f64>,
    /// Distance along the viewing axis to what is sharp, in world units (default: that of the camera; else the middle
    /// of the volume, but of frames it must be stated)
    #[arg(long, value_name = "D", value_parser = parse::positive, allow_negative_numbers = true)]
    focus: Option<f64>,
    /// Motion blur: time in frames during which the shutter is open, about the frame; 0.5 is film's 180 degrees, 0
    /// switches it off (default: that of the camera). The camera moves in it, and volumes that have velocities
    #[arg(long, value_name = "FRAMES", value_parser = parse::not_negative, allow_negative_numbers = true)]
    shutter: Option<f64>,
}

impl From<BlurArgs> for BlurSettings {
    fn from(args: BlurArgs) -> Self {
        Self { aperture: args.aperture, focus: args.focus, shutter: args.shutter }
    }
}

read_as!(BlurSettings, BlurArgs);
