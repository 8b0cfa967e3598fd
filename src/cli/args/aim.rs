//! Options of cameras by the names of sides, by angles or by positions.

use super::read_as;
use crate::app::pictures::AimSettings;
use crate::cli::parse;
use crate::cli::values::choice;
use crate::scene::aim::Side;

/// Options for cameras by the names of sides, by angles or by positions.
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("aim").args(["from", "azimuth", "elevation", "eye"]).multiple(true))]
struct AimArgs {
    /// Place a camera at each of these sides: anatomical names for scans, whose axes are right, anterior, superior,
    /// others relative to --up (with Z up, the front is -Y)
    #[arg(
        long,
        value_name = "SIDE,...",
        value_delimiter = ',',
        value_parser = choice::<Side>(),
        conflicts_with_all = ["views", "cameras", "camera", "layout", "azimuth", "elevation", "eye"],
    )]
    from: Vec<Side>,
    /// Place a camera at this angle about the up axis: 0 is the front, 90 the right (default with --elevation: 0)
    #[arg(
        long,
        value_name = "DEGREES",
        allow_negative_numbers = true,
        value_parser = azimuth,
        conflicts_with_all = ["views", "cameras", "camera", "layout", "eye"],
    )]
    azimuth: Option<f64>,
    /// Place a camera at this angle above the horizontal plane, -90 to 90 (default with --azimuth: 0)
    #[arg(
        long,
        value_name = "DEGREES",
        allow_negative_numbers = true,
        value_parser = elevation,
        conflicts_with_all = ["views", "cameras", "camera", "layout", "eye"],
    )]
    elevation: Option<f64>,
    /// Distance in world units from the middle of the volume to such a camera, which then sees --fov across the shorter
    /// side of its picture (default: the one at which the volume fills the picture)
    #[arg(long, value_name = "D", value_parser = parse::positive, requires = "aim", conflicts_with = "eye")]
    distance: Option<f64>,
    /// Place a camera at this position in the world, with --fov across the shorter side of its picture
    #[arg(
        long,
        value_name = "X,Y,Z",
        allow_hyphen_values = true,
        value_parser = parse::point,
        conflicts_with_all = ["views", "cameras", "camera", "layout"],
    )]
    eye: Option<[f64; 3]>,
    /// Position in the world that the camera at --eye looks at (default: the middle of the volume)
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse::point, requires = "eye")]
    target: Option<[f64; 3]>,
    /// Parallel rays in place of perspective for a camera by --from, --azimuth, --elevation or --eye; the volume fills
    /// the picture
    #[arg(long, requires = "aim")]
    orthographic: bool,
}

fn azimuth(text: &str) -> Result<f64, String> {
    let degrees = parse::number(text)?;
    if degrees.abs() <= 360.0 { Ok(degrees) } else { Err(format!("'{text}' must be from -360 to 360 degrees")) }
}

fn elevation(text: &str) -> Result<f64, String> {
    let degrees = parse::number(text)?;
    if degrees.abs() <= 90.0 { Ok(degrees) } else { Err(format!("'{text}' must be from -90 to 90 degrees")) }
}

impl From<AimArgs> for AimSettings {
    fn from(args: AimArgs) -> Self {
        Self {
            from: args.from,
            azimuth: args.azimuth,
            elevation: args.elevation,
            distance: args.distance,
            eye: args.eye,
            target: args.target,
            orthographic: args.orthographic,
        }
    }
}

read_as!(AimSettings, AimArgs);
