//! What is differentiated: a volume, its medium, and the cameras of pictures of it.

use crate::app::gradient::GradientSettings;
use crate::app::transfer::TransferSettings;
use crate::app::up::UpChoice;
use crate::cli::parse;
use crate::cli::values::choice;
use crate::render::quadrature::{Quadrature, rules};
use crate::scene::capture::{EmissionModel, Model};
use std::path::PathBuf;

/// Options of what is differentiated, beside the parameters and the loss.
#[derive(Debug, clap::Args)]
pub(in crate::cli) struct GradientSubject {
    /// VDB, NanoVDB or scan to differentiate at
    input: PathBuf,
    /// transforms.json of the pictures to compare with, or its folder; cameras and light model are taken from it
    #[arg(long, value_name = "CAPTURE")]
    target: Option<PathBuf>,
    /// Place this many cameras around the volume (default of a study without --target: 1)
    #[arg(
        long,
        value_name = "N",
        conflicts_with = "target",
        value_parser = clap::value_parser!(u32).range(1..=100_000),
    )]
    views: Option<u32>,
    /// Axis that points upwards, about which --views are placed
    #[arg(long, value_enum, value_name = "AXIS", default_value_t = UpChoice::Auto, conflicts_with = "target")]
    up: UpChoice,
    /// Model of the pictures (default: that of --target, emission-absorption with a transfer function or --emission,
    /// else absorption)
    #[arg(long, value_parser = choice::<Model>(), conflicts_with = "tf")]
    model: Option<Model>,
    /// Size of the pictures of --views in pixels (default: 64x64; of a study less where --budget asks for it)
    #[arg(long, value_name = "WxH", value_parser = parse::size, conflicts_with = "target")]
    pub size: Option<[u32; 2]>,
    /// Extinction per world unit at a density of 1 (default: that of --target, else 1)
    #[arg(long, value_name = "S", value_parser = parse::positive)]
    density_scale: Option<f64>,
    /// Radiance behind the volume, r,g,b (default: that of --target, else white for absorption, black for
    /// emission-absorption)
    #[arg(long, value_name = "R,G,B", value_parser = parse::color)]
    background: Option<[f32; 3]>,
    /// Radiance of the source, r,g,b (default: that of --target, else none)
    #[arg(long, value_name = "R,G,B", value_parser = parse::color, conflicts_with = "tf")]
    emission: Option<[f32; 3]>,
    /// How that radiance follows the density (default: that of --target, else grey: not at all)
    #[arg(long, value_parser = choice::<EmissionModel>(), conflicts_with = "tf", requires = "emission")]
    emission_model: Option<EmissionModel>,
    #[command(flatten)]
    transfer: TransferSettings,
    #[arg(
        long,
        value_name = "Q",
        default_value = "exact",
        help = concat!(
            "Integration along rays: ",
            rules!(),
            "; pre-shaded volumes have one of their own, and studies may vary it",
        )
    )]
    quadrature: Quadrature,
}

impl From<GradientSubject> for GradientSettings {
    fn from(subject: GradientSubject) -> Self {
        let settings = Self::default();
        Self {
            input: subject.input,
            target: subject.target,
            views: subject.views,
            up: subject.up,
            model: subject.model,
            size: subject.size.unwrap_or(settings.size),
            density_scale: subject.density_scale,
            background: subject.background,
            emission: subject.emission,
            emission_model: subject.emission_model,
            transfer: subject.transfer,
            quadrature: subject.quadrature,
            ..settings
        }
    }
}
