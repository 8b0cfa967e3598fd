//! `cumulo usd`: stages written and checked.

mod author;

use super::memory::Memory;
use super::output::Output;
use crate::error::Result;
use clap::Subcommand;
use std::process::ExitCode;

/// Write and check USD stages
#[derive(Debug, Subcommand)]
pub enum UsdCommand {
    /// Write a stage of volumes, with their media, lights and cameras
    Author(Box<author::Author>),
}

impl UsdCommand {
    /// Memory that the command may take.
    pub(super) fn memory(&self) -> Memory {
        match self {
            Self::Author(c) => c.memory,
        }
    }

    /// Runs the command.
    ///
    /// # Errors
    /// Those of the command.
    pub fn run(&self, output: &Output) -> Result<ExitCode> {
        match self {
            Self::Author(c) => c.run(output),
        }
    }
}
