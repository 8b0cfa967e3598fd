//! `cumulo usd`: stages written and checked.

mod author;
mod lint;

pub(in crate::cli) use author::Report as Authored;
pub(in crate::cli) use lint::Report as Linted;

use super::memory::Memory;
use super::output::Output;
use crate::error::Result;
use clap::Subcommand;
use std::path::Path;
use std::process::ExitCode;

/// Write and check USD stages
#[derive(Debug, Subcommand)]
pub enum UsdCommand {
    /// Write a stage of volumes, with their media, lights and cameras
    Author(Box<author::Author>),
    /// Say what is wrong with stages and what to do; exit code 1 if anything is
    Lint(lint::Lint),
}

impl UsdCommand {
    /// Paths that the command reads.
    pub(in crate::cli) fn inputs(&self) -> Vec<&Path> {
        match self {
            Self::Author(c) => c.inputs(),
            Self::Lint(c) => c.inputs(),
        }
    }

    /// Memory that the command may take.
    pub(super) fn memory(&self) -> Memory {
        match self {
            Self::Author(c) => c.memory,
            Self::Lint(c) => c.memory,
        }
    }

    /// Runs the command.
    ///
    /// # Errors
    /// Those of the command.
    pub fn run(&self, output: &Output) -> Result<ExitCode> {
        match self {
            Self::Author(c) => c.run(output),
            Self::Lint(c) => c.run(output),
        }
    }
}
