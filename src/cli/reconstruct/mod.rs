//! `cumulo reconstruct`: volumes and transfer functions from pictures.

mod color;
mod density;
mod tf;

use super::cancel;
use super::output::Output;
use crate::app::reconstruct::{ColorSettings, DensitySettings, TransferFunctionSettings};
use crate::error::Result;
use crate::formats::limits::Limits;
use serde::Serialize;
use std::fmt::Display;
use std::path::Path;
use std::process::ExitCode;

/// Reconstruct from multi-view pictures
#[derive(Debug, clap::Subcommand)]
pub(crate) enum Reconstruct {
    /// Density from absorption or emission-absorption pictures.
    #[command(name = "density")]
    Density(Box<DensitySettings>),
    /// Pre-shaded volume: extinctions, and emissions in R, G and B.
    #[command(name = "color", alias = "colour")]
    Color(Box<ColorSettings>),
    /// Transfer function of a known volume.
    #[command(name = "tf")]
    Tf(Box<TransferFunctionSettings>),
}

impl Reconstruct {
    /// Paths that the command reads.
    pub(super) fn inputs(&self) -> Vec<&Path> {
        match self {
            Self::Density(s) => s.inputs(),
            Self::Color(s) => s.inputs(),
            Self::Tf(s) => s.inputs(),
        }
    }

    /// Limits of the chosen reconstruction.
    pub(super) fn limits(&self) -> Limits {
        match self {
            Self::Density(s) => s.limits,
            Self::Color(s) => s.limits,
            Self::Tf(s) => s.limits,
        }
    }

    /// Reconstructs and reports.
    ///
    /// # Errors
    /// Those of the chosen reconstruction.
    pub(crate) fn run(&self, output: &Output) -> Result<ExitCode> {
        match self {
            Self::Density(s) => s.run(output).and_then(|run| tell(output, &run, run.stopped)),
            Self::Color(s) => s.run(output).and_then(|run| tell(output, &run, run.stopped)),
            Self::Tf(s) => s.run(output).and_then(|run| tell(output, &run, run.stopped)),
        }
    }
}

fn tell(output: &Output, report: &(impl Serialize + Display), stopped: bool) -> Result<ExitCode> {
    output.report(report)?;
    Ok(cancel::exit_code(stopped))
}
