//! `cumulo validate`: what is wrong with a file, and what to do.

mod findings;
mod volume;

use super::memory::Memory;
use super::output::Output;
use crate::error::Result;
use crate::formats::{self, Format};
use crate::text::printable;
use findings::Findings;
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Say what is wrong with files and what to do; exit code 1 if anything is
#[derive(Debug, clap::Args)]
pub struct Validate {
    /// OpenVDB or OpenEXR files, and captures (a transforms.json or its folder) with their pictures
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    #[command(flatten)]
    pub(in crate::cli) memory: Memory,
}

#[derive(Debug, Serialize)]
struct Report {
    valid: bool,
    files: Vec<Checked>,
}

#[derive(Debug, Serialize)]
struct Checked {
    #[serde(serialize_with = "crate::cli::paths::text")]
    path: PathBuf,
    format: Format,
    valid: bool,
    findings: Findings,
}

impl Validate {
    /// Checks and reports.
    ///
    /// # Errors
    /// If a file cannot be read at all; what is wrong inside is the report.
    pub fn run(&self, output: &Output) -> Result<ExitCode> {
        let files = self.files.iter().map(|path| self.check(path)).collect::<Result<Vec<_>>>()?;
        let valid = files.iter().all(|f| f.valid);
        output.report(&Report { valid, files })?;
        Ok(if valid { ExitCode::SUCCESS } else { ExitCode::from(1) })
    }

    fn check(&self, path: &Path) -> Result<Checked> {
        let format = formats::sniff(path)?;
        let mut findings = Findings::default();
        match format {
            // NanoVDB too: its refusal says how to convert it.
            Format::Vdb | Format::NanoVdb => volume::check(path, self.memory.limits(), &mut findings)?,
            Format::Exr => findings.extend(formats::exr::problems_within(path, self.memory.limits())?),
            Format::Capture => findings.extend(formats::transforms::problems_within(path, self.memory.limits())?),
            Format::Unknown => findings.refusal(formats::unknown())?,
        }
        Ok(Checked { path: path.to_path_buf(), format, valid: findings.valid(), findings })
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for file in &self.files {
            let verdict = if file.valid { "valid" } else { "not valid" };
            write!(f, "{}: {verdict}\n{}", printable(&file.path.to_string_lossy()), file.findings)?;
        }
        Ok(())
    }
}
