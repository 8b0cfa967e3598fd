//! `cumulo usd`: stages written and checked.

mod author;
mod lint;

use crate::app::usd::author::AuthorSettings;
use crate::app::usd::lint::LintSettings;
use clap::Subcommand;

/// Write and check USD stages
#[derive(Debug, Subcommand)]
pub(crate) enum UsdCommand {
    /// Write a stage of volumes, with their media, lights and cameras
    Author(Box<AuthorSettings>),
    /// Say what is wrong with stages and what to do; exit code 1 if anything is
    Lint(LintSettings),
}
