//! `cumulo usd`: stages written and checked.

mod author;
mod lint;

use super::memory::Memory;
use super::output::Output;
use crate::app::usd::author::AuthorSettings;
use crate::app::usd::lint::LintSettings;
use crate::error::Result;
use clap::Subcommand;
use std::path::Path;
use std::process::ExitCode;

/// Write and check USD stages
#[derive(Debug, Subcommand)]
pub(crate) enum UsdCommand {
    /// Write a stage of volumes, with their media, lights and cameras
    Author(Box<AuthorSettings>),
    /// Say what is wrong with stages and what to do; exit code 1 if anything is
    Lint(LintSettings),
}

impl UsdCommand {
    /// Paths that the command reads.
    pub(in crate::cli) fn inputs(&self) -> Vec<&Path> {
        match self {
            Self::Author(s) => s.inputs(),
            Self::Lint(s) => s.inputs(),
        }
    }

    /// Memory that the command may take.
    pub(super) fn memory(&self) -> Memory {
        match self {
            Self::Author(s) => Memory::of(s.limits),
            Self::Lint(s) => Memory::of(s.limits),
        }
    }

    /// Runs the command.
    ///
    /// # Errors
    /// Those of the command.
    pub(crate) fn run(&self, output: &Output) -> Result<ExitCode> {
        match self {
            Self::Author(s) => author::run(s, output),
            Self::Lint(s) => lint::run(s, output),
        }
    }
}
