//! Options of the comparison of two noisy pictures.

use crate::app::compare::{StatisticalSettings, Which};
use crate::cli::args::read_as;
use std::path::PathBuf;

/// Options of the statistical comparison.
#[derive(Debug, clap::Args)]
struct StatisticalArgs {
    /// Test whether two noisy pictures have the same expected values, within --tolerance: pixel by pixel, in tiles, in
    /// the mean, and by the spread of the differences. The noise is known from --repeat-a and --repeat-b, else from the
    /// layer 'variance', else from the layers 'half_a' and 'half_b' (cumulo render --aov variance,halves)
    #[arg(long, conflicts_with_all = ["display", "flip", "report", "beside"])]
    statistical: bool,
    /// Another render of A by another seed (repeatable)
    #[arg(long, value_name = "A2.exr", requires = "statistical")]
    repeat_a: Vec<PathBuf>,
    /// Another render of B by another seed (repeatable)
    #[arg(long, value_name = "B2.exr", requires = "statistical")]
    repeat_b: Vec<PathBuf>,
    /// Take a picture for free of noise, such as a closed form (repeatable)
    #[arg(long, value_enum, value_name = "SIDE", requires = "statistical")]
    noiseless: Vec<Which>,
    /// Layer with the variance of each pixel's mean (default: 'variance')
    #[arg(long, value_name = "NAME", requires = "statistical")]
    variance_layer: Option<String>,
    /// Probability with which pictures of equal expected values may be called different (default: 0.001)
    #[arg(long, value_name = "P", requires = "statistical")]
    false_alarm: Option<f64>,
    /// Edge of a tile in pixels (default: 16)
    #[arg(long, value_name = "N", requires = "statistical", value_parser = clap::value_parser!(u32).range(1..))]
    tile: Option<u32>,
}

impl From<StatisticalArgs> for StatisticalSettings {
    fn from(args: StatisticalArgs) -> Self {
        let usual = Self::default();
        Self {
            statistical: args.statistical,
            repeat_a: args.repeat_a,
            repeat_b: args.repeat_b,
            noiseless: args.noiseless,
            variance_layer: args.variance_layer,
            false_alarm: args.false_alarm.unwrap_or(usual.false_alarm),
            tile: args.tile.unwrap_or(usual.tile),
        }
    }
}

read_as!(StatisticalSettings, StatisticalArgs);
