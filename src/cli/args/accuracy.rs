//! Options of the error of pictures, and of the time that they may take.

use super::read_as;
use super::single::Confidence;
use crate::app::render::AccuracySettings;
use crate::cli::parse;

/// An error or a time in place of a number of paths.
#[derive(Debug, clap::Args)]
struct AccuracyArgs {
    /// Trace paths until the mean of each block of 8x8 pixels is within E times the picture's scale of the truth:
    /// 0.01 for one per cent; along straight rays, choose --quadrature and --early-stop by it, for every pixel. The
    /// scale is the mean of the square roots of radiance, weighted by itself, and squared; dark blocks have the same
    /// absolute error as bright ones
    #[arg(long, value_name = "E", value_parser = parse::positive, conflicts_with_all = ["time_limit", "samples"])]
    target_error: Option<f64>,
    /// Read, render and write all pictures in this time, with the smallest error that it allows: 90, 60s, 2m, 1h30m
    #[arg(long = "time", value_name = "D", value_parser = parse::duration, conflicts_with = "samples")]
    time_limit: Option<f64>,
    /// Render these of a picture's independent replicates alone, of --samples paths each: on a farm each machine has
    /// some of them, and `cumulo merge` joins what they render. They are numbered from 0
    #[arg(long, value_name = "A-B", value_parser = parse::range, conflicts_with_all = ["time_limit", "target_error"])]
    replicates: Option<[u32; 2]>,
    #[command(flatten)]
    confidence: Confidence,
}

impl From<AccuracyArgs> for AccuracySettings {
    fn from(args: AccuracyArgs) -> Self {
        let AccuracyArgs { target_error, time_limit: time, replicates, confidence } = args;
        Self { target_error, time, replicates, confidence: confidence.into() }
    }
}

read_as!(AccuracySettings, AccuracyArgs);
