//! `cumulo schema`: JSON schemas of the files that Cumulo reads, and of the documents that it writes.

use super::output::Output;
use super::{compare, diff, document, validate};
use crate::error::{Error, Result};
use crate::formats::scene_file;
use std::process::ExitCode;

/// Print the JSON schema of a kind of file, or of what a command writes with --json
#[derive(Debug, clap::Args)]
pub struct Schema {
    /// Kind of file, or command
    #[arg(value_enum)]
    kind: Kind,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Kind {
    /// Scene files of `cumulo render`
    Scene,
    /// Reports of `cumulo compare --json`
    Compare,
    /// Reports of `cumulo diff --json`
    Diff,
    /// Reports of `cumulo validate --json`
    Validate,
}

impl Schema {
    /// Prints the schema on standard output, with and without `--json`.
    ///
    /// # Errors
    /// If standard output cannot be written to.
    pub fn run(&self, output: &Output) -> Result<ExitCode> {
        let schema = match self.kind {
            Kind::Scene => scene_file::schema(),
            Kind::Compare => document::schema::<compare::AnyReport>(),
            Kind::Diff => document::schema::<diff::AnyReport>(),
            Kind::Validate => document::schema::<validate::Report>(),
        };
        let text = serde_json::to_string_pretty(&schema).map_err(|e| Error::invalid(e.to_string()))?;
        output.plain(&text)?;
        Ok(ExitCode::SUCCESS)
    }
}
