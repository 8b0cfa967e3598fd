//! `cumulo gradient`: derivatives of a loss on pictures, parameter by parameter, for checking and teaching.

use super::args::read_as;
use super::args::single::{PageFolder, ScalarGrid};
use super::args::subject::GradientSubject;
use super::memory::Memory;
use super::parse;
use super::values::choice;
use crate::app::gradient::{GradientSettings, LossName, Wrt};
use crate::app::scan::ScanSettings;
use crate::differentiate::loss::prior::{Prior, Weighted};
use crate::differentiate::study::ad_mode::Mode;
use crate::render::differentiable::Adjoint;
use std::path::PathBuf;

/// Differentiate a loss on pictures of a volume, and check the derivatives
///
/// Pictures are those of --views cameras on a sphere, or are compared with a --target capture. --check sets a
/// difference quotient in double precision beside each derivative: exit code 1 if any is off by more than --tolerance.
/// Where rounding leaves a quotient fewer than four digits, the error is relative to what would have them.
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("subject").required(true).args(["target", "views"]))]
struct GradientArgs {
    /// Parameters to differentiate by, one kind or more
    #[arg(long, value_enum, value_delimiter = ',', required = true, value_name = "WHAT,...")]
    wrt: Vec<Wrt>,
    /// Loss, a mean over pixels and views
    #[arg(long, value_enum)]
    loss: LossName,
    /// Difference from which on huber grows no faster
    #[arg(long, value_name = "D", default_value_t = 0.1, value_parser = parse::positive)]
    huber_delta: f64,
    /// Transmittance below which log-transmittance asks for nothing
    #[arg(long, value_name = "T", default_value_t = 1e-4, value_parser = parse::positive)]
    transmittance_floor: f64,
    /// Added to the loss: smooth=W and tv=W (total variation) of the volume, tf=W and tf-rgb=W (smoothness) of the
    /// transfer function; W is the weight, in units of the largest density or extinction
    #[arg(long, value_name = "NAME=W")]
    prior: Vec<Weighted<Prior>>,
    #[command(flatten)]
    subject: GradientSubject,
    /// Forward or backward; auto goes by the number of parameters and the loss
    #[arg(long, value_parser = choice::<Mode>(), default_value = "auto")]
    mode: Mode,
    /// How the backward pass gets at its samples (default: tape, or replay for losses of whole pictures)
    #[arg(long, value_parser = choice::<Adjoint>())]
    adjoint: Option<Adjoint>,
    /// Set a difference quotient beside each derivative, both in double precision
    #[arg(long)]
    check: bool,
    /// Largest relative error that --check lets pass
    #[arg(long, value_name = "T", default_value_t = 1e-4, value_parser = parse::not_negative, requires = "check")]
    tolerance: f64,
    /// Let --check check every parameter that is listed, not only a sample of 24 of each kind
    #[arg(long, requires = "check")]
    all: bool,
    /// How many voxels to list, those of the largest derivatives
    #[arg(long, value_name = "K", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    largest: u32,
    /// Paths per pixel that --wrt albedo is estimated along (default: 64); four times as many halve the standard errors
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(8..=1 << 24))]
    samples: Option<u32>,
    /// Seed of the random numbers of --wrt albedo (default: 0)
    #[arg(long, value_name = "S")]
    seed: Option<u64>,
    /// Write the derivatives by voxel as a VDB (with --wrt density or emission)
    #[arg(long, short, value_name = "OUT.vdb")]
    output: Option<PathBuf>,
    #[command(flatten)]
    report: PageFolder,
    #[command(flatten)]
    grid: ScalarGrid,
    #[command(flatten)]
    scan: ScanSettings,
    #[command(flatten)]
    memory: Memory,
}

impl From<GradientArgs> for GradientSettings {
    fn from(args: GradientArgs) -> Self {
        Self {
            wrt: args.wrt,
            loss: args.loss,
            huber_delta: args.huber_delta,
            transmittance_floor: args.transmittance_floor,
            prior: args.prior,
            mode: args.mode,
            adjoint: args.adjoint,
            check: args.check,
            tolerance: args.tolerance,
            all: args.all,
            largest: args.largest,
            samples: args.samples,
            seed: args.seed,
            output: args.output,
            report: args.report.into(),
            grid: args.grid.into(),
            scan: args.scan,
            limits: args.memory.limits(),
            ..args.subject.into()
        }
    }
}

read_as!(GradientSettings, GradientArgs);
