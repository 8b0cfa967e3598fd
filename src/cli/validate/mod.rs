//! `cumulo validate`: faults of files, with remedies.

mod findings;
mod nano;
mod volume;

use super::info::Failure;
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
    /// OpenVDB, NanoVDB or OpenEXR files, USD stages, and captures (a transforms.json, a model of COLMAP, or the folder of either) with their
    /// pictures
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
    /// Format of the file; none if it could not be read.
    format: Option<Format>,
    valid: bool,
    findings: Findings,
    /// Error that kept the file from being read.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<Failure>,
}

impl Validate {
    /// Checks the files and reports; files that cannot be read do not keep others from being reported.
    ///
    /// # Errors
    /// If the only file cannot be read at all; faults of its content are part of the report.
    pub fn run(&self, output: &Output) -> Result<ExitCode> {
        let stage = output.stage("checking");
        let mut files = Vec::new();
        for path in &self.files {
            files.push(match self.check(path) {
                Ok(checked) => checked,
                Err(error) if self.files.len() == 1 => return Err(error),
                Err(error) => Checked {
                    path: path.clone(),
                    format: None,
                    valid: false,
                    findings: Findings::default(),
                    error: Some(Failure::new(&error)),
                },
            });
        }
        let valid = files.iter().all(|f| f.valid);
        let failed = files.iter().any(|f| f.error.is_some());
        drop(stage);
        output.report(&Report { valid, files })?;
        Ok(ExitCode::from(if failed { 2 } else { u8::from(!valid) }))
    }

    fn check(&self, path: &Path) -> Result<Checked> {
        let format = formats::sniff(path)?;
        let mut findings = Findings::default();
        match format {
            Format::Vdb => volume::check(path, self.memory.limits(), &mut findings)?,
            Format::NanoVdb => nano::check(path, self.memory.limits(), &mut findings)?,
            Format::Exr => findings.extend(formats::exr::problems_within(path, self.memory.limits())?),
            Format::Capture => findings.extend(formats::captures::problems_within(path, self.memory.limits())?),
            Format::Usd => findings.extend(formats::usd::problems(path, self.memory.limits())?),
            Format::Unknown => findings.refusal(formats::unknown())?,
        }
        let valid = findings.valid();
        Ok(Checked { path: path.to_path_buf(), format: Some(format), valid, findings, error: None })
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for file in &self.files {
            if let Some(failure) = &file.error {
                write!(f, "{}: {}", file.path.display(), failure.to_string().trim_end().replace('\n', "\n  "))?;
                writeln!(f)?;
                continue;
            }
            let verdict = if file.valid { "valid" } else { "not valid" };
            write!(f, "{}: {verdict}\n{}", printable(&file.path.to_string_lossy()), file.findings)?;
        }
        Ok(())
    }
}
