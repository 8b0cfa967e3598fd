//! `cumulo capture`: captures of other programs.

mod convert;
mod photographs;
mod pictures;
mod placement;

pub(in crate::cli) use convert::Report;

use super::memory::Memory;
use super::output::Output;
use crate::error::Result;
use clap::Subcommand;
use std::path::Path;
use std::process::ExitCode;

/// Take over captures of other programs
#[derive(Debug, Subcommand)]
pub enum CaptureCommand {
    /// Write a capture that every command takes: cameras without lens distortion and scene-linear EXRs
    Convert(Box<convert::Convert>),
}

impl CaptureCommand {
    /// Paths that the command reads.
    pub(in crate::cli) fn inputs(&self) -> Vec<&Path> {
        match self {
            Self::Convert(c) => c.inputs(),
        }
    }

    /// Memory that the command may take.
    pub(super) fn memory(&self) -> Memory {
        match self {
            Self::Convert(c) => c.memory,
        }
    }

    /// Runs the command.
    ///
    /// # Errors
    /// Those of the command.
    pub fn run(&self, output: &Output) -> Result<ExitCode> {
        match self {
            Self::Convert(c) => c.run(output),
        }
    }
}
