//! How volumes move from frame to frame.

use crate::cli::parse;

/// Options of the motion of volumes.
#[derive(Debug, clap::Args)]
pub(in crate::cli) struct Velocity {
    /// Grid of the volume's velocities in world units per second; in render for --aov motion and --shutter
    #[arg(long, value_name = "GRID")]
    pub velocity: Option<String>,
    /// Frames per second; 1 for velocities in world units per frame
    #[arg(long, value_name = "F", default_value_t = 24.0, value_parser = parse::positive, requires = "velocity")]
    pub fps: f64,
}
