//! `cumulo study gradient`: error against time of derivatives.

use crate::app::gradient::{GradientSettings, LossName, Wrt};
use crate::app::scan::ScanSettings;
use crate::app::study::StudyOptions;
use crate::app::study::gradient::{GradientKnob, GradientStudySettings};
use crate::cli::args::read_as;
use crate::cli::args::single::ScalarGrid;
use crate::cli::args::subject::GradientSubject;
use crate::cli::memory::Memory;

/// Measure the error of derivatives against the time that they take, and recommend the options of gradient for them
///
/// Takes the options of gradient that say what is differentiated. The reference is exact quadrature in double
/// precision without early stop.
#[derive(Debug, clap::Args)]
struct GradientStudyArgs {
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
    #[command(flatten)]
    subject: GradientSubject,
    #[command(flatten)]
    grid: ScalarGrid,
    #[command(flatten)]
    scan: ScanSettings,
    #[command(flatten)]
    memory: Memory,
}

impl From<GradientStudyArgs> for GradientStudySettings {
    fn from(args: GradientStudyArgs) -> Self {
        let GradientStudyArgs { study, knobs, wrt, loss, mut subject, grid, scan, memory } = args;
        // The study has the size: none lets it choose one.
        let size = subject.size.take();
        let gradient = GradientSettings {
            wrt: vec![wrt],
            loss,
            grid: grid.into(),
            scan,
            limits: memory.limits(),
            ..subject.into()
        };
        Self { study, knobs, size, gradient }
    }
}

read_as!(GradientStudySettings, GradientStudyArgs);
