//! `cumulo study gradient`: error against time of derivatives.

use crate::app::gradient::{GradientSettings, LossName, Wrt};
use crate::app::scan::ScanSettings;
use crate::app::study::StudyOptions;
use crate::app::study::gradient::{GradientKnob, GradientStudySettings};
use crate::app::transfer::TransferSettings;
use crate::app::up::UpChoice;
use crate::cli::args::read_as;
use crate::cli::memory::Memory;
use crate::cli::parse;
use crate::cli::values::choice;
use crate::render::quadrature::{Quadrature, rules};
use crate::scene::capture::{EmissionModel, Model};
use std::path::PathBuf;

/// Measure the error of derivatives against the time that they take, and recommend the options of gradient for them
///
/// Takes the options of gradient that say what is differentiated. The reference is exact quadrature in double
/// precision without early stop.
#[derive(Debug, clap::Args)]
struct GradientStudyArgs {
    /// VDB, NanoVDB or scan to differentiate at
    input: PathBuf,
    #[command(flatten)]
    study: StudyOptions,
    /// Settings to vary (default: all)
    #[arg(long, value_enum, value_name = "NAME,...", value_delimiter = ',')]
    knobs: Vec<GradientKnob>,
    /// Parameters to differentiate by, of one kind
    #[arg(long, value_enum, value_name = "WHAT", default_value = "density")]
    wrt: Wrt,
    /// Loss, a mean over pixels and views
    #[arg(long, value_enum, default_value = "mean")]
    loss: LossName,
    /// transforms.json of the pictures to compare with, or its folder; cameras and light model are taken from it
    #[arg(long, value_name = "CAPTURE")]
    target: Option<PathBuf>,
    /// Place this many cameras around the volume (default: 1 without --target)
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
    /// Model of the pictures, as in gradient
    #[arg(long, value_parser = choice::<Model>(), conflicts_with = "tf")]
    model: Option<Model>,
    /// Size of the pictures of --views in pixels (default: 64x64, or less where --budget asks for it)
    #[arg(long, value_name = "WxH", value_parser = parse::size, conflicts_with = "target")]
    size: Option<[u32; 2]>,
    /// Extinction per world unit at a density of 1 (default: that of --target, else 1)
    #[arg(long, value_name = "S", value_parser = parse::positive)]
    density_scale: Option<f64>,
    /// Radiance behind the volume, r,g,b, as in gradient
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
        help = concat!("Integration along rays, where it is not varied: ", rules!())
    )]
    quadrature: Quadrature,
    /// Grid to differentiate at (default: density, else the only scalar one)
    #[arg(long, value_name = "NAME")]
    grid: Option<String>,
    #[command(flatten)]
    scan: ScanSettings,
    #[command(flatten)]
    memory: Memory,
}

impl From<GradientStudyArgs> for GradientStudySettings {
    fn from(args: GradientStudyArgs) -> Self {
        let gradient = GradientSettings {
            input: args.input,
            wrt: vec![args.wrt],
            loss: args.loss,
            target: args.target,
            views: args.views,
            up: args.up,
            model: args.model,
            density_scale: args.density_scale,
            background: args.background,
            emission: args.emission,
            emission_model: args.emission_model,
            transfer: args.transfer,
            quadrature: args.quadrature,
            grid: args.grid,
            scan: args.scan,
            limits: args.memory.limits(),
            ..GradientSettings::default()
        };
        Self { study: args.study, knobs: args.knobs, size: args.size, gradient }
    }
}

read_as!(GradientStudySettings, GradientStudyArgs);
