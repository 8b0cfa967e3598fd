//! Options of scattering media and their lights.

use super::lights::Lights;
use super::read_as;
use crate::app::pictures::scattering::{ScatteringSettings, Sky};
use crate::cli::parse;
use crate::cli::values::choice;
use crate::scene::albedo::TransferColor;
use std::str::FromStr;

impl FromStr for Sky {
    type Err = String;

    /// Text with a letter other than an exponent's is the name of a file.
    fn from_str(text: &str) -> Result<Self, String> {
        match text.chars().any(|c| c.is_alphabetic() && !"eE".contains(c)) {
            true => Ok(Self::File(text.into())),
            false => parse::color(text).map(Self::Color),
        }
    }
}

/// A medium that scatters light is rendered by path tracing.
#[derive(Debug, clap::Args)]
#[command(
    group = clap::ArgGroup::new("lit").args(["sun", "sun_color", "sun_angle", "sky"]).multiple(true).requires("albedo"),
)]
struct ScatteringArgs {
    /// Share of the extinction that is scattered, one number or r,g,b from 0 to 1; turns path tracing on
    #[arg(
        long,
        value_name = "A",
        value_parser = parse::albedo,
        conflicts_with_all = ["model", "quadrature", "early_stop", "supersample"],
    )]
    albedo: Option<[f32; 3]>,
    /// Whether the colors of a transfer function are the radiance that the medium emits, its albedo (times --albedo),
    /// or both (default: albedo if all of them lie within 0 to 1, else emission; both if the function states an albedo)
    #[arg(long, value_name = "MEANING", value_parser = choice::<TransferColor>(), requires = "albedo")]
    tf_color: Option<TransferColor>,
    /// Mean cosine of the scattering angle (Henyey-Greenstein), -0.999 to 0.999 (default: that of a stage, else 0)
    #[arg(long, value_name = "G", value_parser = parse::number, requires = "albedo", allow_negative_numbers = true)]
    anisotropy: Option<f64>,
    /// Scatter like a surface where the density changes much: half of the light at a change of G per world length
    #[arg(long, value_name = "G", value_parser = parse::positive, requires = "albedo")]
    gradient_shading: Option<f64>,
    /// Take the gradients of the surfaces of --gradient-shading or --shade through a filter of this standard deviation
    /// in voxels, so that the noise of a scan does not sparkle: 1 to 2
    #[arg(long, value_name = "VOXELS", default_value_t = 0.0, value_parser = parse::not_negative)]
    gradient_scale: f64,
    /// Share of the light that surfaces of --gradient-shading reflect at normal incidence, 0 to 1: 0.04 as plastic and
    /// tissue do (default: that of a stage, else 0)
    #[arg(long, value_name = "R", value_parser = parse::not_negative, requires = "albedo")]
    specular: Option<f64>,
    /// Roughness of this reflection, the α of GGX, 0.05 to 1 (default: that of a stage, else 0.3)
    #[arg(long, value_name = "A", value_parser = parse::positive, requires = "specular")]
    roughness: Option<f64>,
    /// Factors of the extinction in red, green and blue (default: those of a stage, else 1)
    #[arg(long, value_name = "R,G,B", value_parser = parse::color, requires = "albedo")]
    extinction_color: Option<[f32; 3]>,
    #[command(flatten)]
    lights: Lights,
    /// Paths per pixel (default: 64); twice as many halve the variance
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    samples: Option<u32>,
    /// Seed of the random numbers (default: 0); the same seed gives the same pictures
    #[arg(long, value_name = "S")]
    seed: Option<u64>,
    /// Leave out light that was scattered more often (default: no limit)
    #[arg(long, value_name = "B")]
    max_bounces: Option<u32>,
    /// Clamp the radiance that is scattered to a path: fewer bright dots in a picture that is too dark; the report
    /// tells how much is lost
    #[arg(long, value_name = "L", value_parser = parse::positive)]
    clamp: Option<f64>,
}

impl From<ScatteringArgs> for ScatteringSettings {
    fn from(args: ScatteringArgs) -> Self {
        Self {
            albedo: args.albedo,
            tf_color: args.tf_color,
            anisotropy: args.anisotropy,
            gradient_shading: args.gradient_shading,
            gradient_scale: args.gradient_scale,
            specular: args.specular,
            roughness: args.roughness,
            extinction_color: args.extinction_color,
            sun: args.lights.sun(),
            sun_color: args.lights.sun_color,
            sun_angle: args.lights.sun_angle,
            sky: args.lights.sky,
            samples: args.samples,
            seed: args.seed,
            max_bounces: args.max_bounces,
            clamp: args.clamp,
        }
    }
}

read_as!(ScatteringSettings, ScatteringArgs);
