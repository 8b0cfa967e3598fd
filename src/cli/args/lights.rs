//! Lights around a volume.

use crate::app::pictures::scattering::Sky;
use crate::cli::parse;
use glam::DVec3;

/// Options of the lights around a volume: a sun and a sky.
#[derive(Debug, clap::Args)]
pub(in crate::cli) struct Lights {
    /// Vector from the volume towards a sun
    #[arg(long, value_name = "X,Y,Z", value_parser = parse::vector, allow_hyphen_values = true)]
    sun: Option<DVec3>,
    /// Irradiance of the sun on a surface that faces it
    #[arg(long, value_name = "R,G,B", default_value = "1", value_parser = parse::color, requires = "sun")]
    pub sun_color: [f32; 3],
    /// Angle across the sun in degrees
    #[arg(long, value_name = "DEGREES", default_value_t = 0.53, value_parser = parse::not_negative, requires = "sun")]
    pub sun_angle: f64,
    /// Radiance from all around, one color or an equirectangular EXR; render shows it behind the volume, too, unless
    /// --background is given (default of render: black with a sun, else white)
    #[arg(long, value_name = "R,G,B|EXR")]
    pub sky: Option<Sky>,
}

impl Lights {
    /// Returns the vector from the volume towards the sun.
    pub(crate) fn sun(&self) -> Option<[f64; 3]> {
        self.sun.map(|direction| direction.to_array())
    }
}
