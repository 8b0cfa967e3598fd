//! `cumulo reconstruct`: volumes and transfer functions from pictures.

mod capture;
mod color;
mod confidence;
mod density;
mod forecast;
mod refinement;
mod region;
mod stages;
mod tf;
mod volume;

use super::memory::Memory;
use super::output::Output;
use crate::error::Result;
use std::path::Path;
use std::process::ExitCode;

/// Reconstruct from multi-view pictures
#[derive(Debug, clap::Subcommand)]
pub enum Reconstruct {
    /// Density from absorption or emission-absorption pictures.
    #[command(name = "density")]
    Density(Box<density::Density>),
    /// Pre-shaded volume: extinctions, and emissions in R, G and B.
    #[command(name = "color", alias = "colour")]
    Color(Box<color::Color>),
    /// Transfer function of a known volume.
    #[command(name = "tf")]
    Tf(Box<tf::Tf>),
}

impl Reconstruct {
    /// Paths that the command reads.
    pub(in crate::cli) fn inputs(&self) -> Vec<&Path> {
        match self {
            Self::Density(c) => c.inputs(),
            Self::Color(c) => c.inputs(),
            Self::Tf(c) => c.inputs(),
        }
    }

    /// Returns the `--max-memory` of the chosen reconstruction.
    pub(super) fn memory(&self) -> Memory {
        match self {
            Self::Density(c) => c.memory,
            Self::Color(c) => c.memory,
            Self::Tf(c) => c.memory,
        }
    }

    /// Runs the chosen reconstruction.
    ///
    /// # Errors
    /// Those of the chosen reconstruction.
    pub fn run(&self, output: &Output) -> Result<ExitCode> {
        match self {
            Self::Density(c) => c.run(output),
            Self::Color(c) => c.run(output),
            Self::Tf(c) => c.run(output),
        }
    }
}
