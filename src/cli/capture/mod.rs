//! `cumulo capture`: captures of other programs.

mod convert;

use super::memory::Memory;
use super::output::Output;
use crate::app::capture::CaptureSettings;
use crate::error::Result;
use clap::Subcommand;
use std::path::Path;
use std::process::ExitCode;

/// Take over captures of other programs
#[derive(Debug, Subcommand)]
pub(crate) enum CaptureCommand {
    /// Write a capture that every command takes: cameras without lens distortion and scene-linear EXRs
    Convert(Box<CaptureSettings>),
}

impl CaptureCommand {
    /// Paths that the command reads.
    pub(in crate::cli) fn inputs(&self) -> Vec<&Path> {
        match self {
            Self::Convert(s) => s.inputs(),
        }
    }

    /// Memory that the command may take.
    pub(super) fn memory(&self) -> Memory {
        match self {
            Self::Convert(s) => Memory::of(s.limits),
        }
    }

    /// Runs the command.
    ///
    /// # Errors
    /// Those of the command.
    pub(crate) fn run(&self, output: &Output) -> Result<ExitCode> {
        match self {
            Self::Convert(s) => convert::run(s, output),
        }
    }
}
