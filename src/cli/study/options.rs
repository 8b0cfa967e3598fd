//! Options that all studies have.

use crate::app::study::StudyOptions;
use crate::cli::args::read_as;
use crate::cli::args::single::Overwrite;
use crate::cli::parse;
use std::path::PathBuf;

/// Where the page goes, how often settings are run, and what is recommended.
#[derive(Debug, clap::Args)]
struct StudyArgs {
    /// Folder for the page, its table, its record and the reference
    #[arg(long, short, value_name = "DIR")]
    output: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Measure only what the record in the folder lacks: that of a study that was stopped
    #[arg(long, conflicts_with = "overwrite")]
    resume: bool,
    /// Most runs of each setting; times are their medians
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeats: u32,
    /// Seconds that the study may take: where no size is given, it works on pictures for which these are enough
    #[arg(long, value_name = "SECONDS", default_value_t = 150.0, value_parser = parse::positive)]
    budget: f64,
    /// Recommend the fastest setting whose error is at most this, in units of the RMS of the reference
    #[arg(long, value_name = "E", default_value_t = 0.01, value_parser = parse::positive)]
    wanted_error: f64,
    /// Recommend the most accurate setting that takes at most these seconds instead
    #[arg(long, value_name = "SECONDS", value_parser = parse::positive, conflicts_with = "wanted_error")]
    wanted_seconds: Option<f64>,
}

impl From<StudyArgs> for StudyOptions {
    fn from(args: StudyArgs) -> Self {
        let StudyArgs { output, overwrite, resume, repeats, budget, wanted_error, wanted_seconds } = args;
        Self { output, overwrite: overwrite.into(), resume, repeats, budget, wanted_error, wanted_seconds }
    }
}

read_as!(StudyOptions, StudyArgs);
