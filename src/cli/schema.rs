//! `cumulo schema`: JSON schemas of the files that Cumulo reads.

use super::output::Output;
use crate::error::Result;
use crate::formats::scene_file;
use serde::Serialize;
use std::fmt;
use std::process::ExitCode;

/// Print the JSON schema of a kind of file
#[derive(Debug, clap::Args)]
pub struct Schema {
    /// Kind of file
    #[arg(value_enum)]
    kind: Kind,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Kind {
    /// Scene files of `cumulo render`
    Scene,
}

/// A schema, which is JSON with and without `--json`.
#[derive(Debug, Serialize)]
#[serde(transparent)]
struct Report(schemars::Schema);

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&serde_json::to_string_pretty(&self.0).map_err(|_| fmt::Error)?)
    }
}

impl Schema {
    /// Prints the schema on standard output.
    ///
    /// # Errors
    /// If standard output cannot be written to.
    pub fn run(&self, output: &Output) -> Result<ExitCode> {
        output.report(&Report(match self.kind {
            Kind::Scene => scene_file::schema(),
        }))?;
        Ok(ExitCode::SUCCESS)
    }
}
