//! `cumulo info`: what is in a file.

mod volume;

pub(super) use volume::statistics_of;

use super::memory::Memory;
use super::output::Output;
use crate::error::Result;
use crate::formats::exr::ExrSummary;
use crate::formats::transforms::CaptureSummary;
use crate::formats::vdb::Limits;
use crate::formats::{self, Format};
use crate::text::printable;
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use volume::Volume;

/// Show what is in files: the grids of VDBs, the layers of EXRs, the cameras of captures
#[derive(Debug, clap::Args)]
pub struct Info {
    /// OpenVDB or OpenEXR files, and captures (a transforms.json or its folder)
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    #[command(flatten)]
    pub(in crate::cli) memory: Memory,
}

#[derive(Debug, Serialize)]
struct Report {
    files: Vec<Described>,
}

#[derive(Debug, Serialize)]
struct Described {
    #[serde(serialize_with = "crate::cli::paths::text")]
    path: PathBuf,
    #[serde(flatten)]
    content: Content,
}

/// The names of the variants are those of [`Format`].
#[derive(Debug, Serialize)]
#[serde(tag = "format", rename_all = "lowercase")]
enum Content {
    Vdb(Volume),
    Exr(ExrSummary),
    Capture(CaptureSummary),
}

impl Info {
    /// Reads and reports.
    ///
    /// # Errors
    /// If a file cannot be read or is of a kind that is not known.
    pub fn run(&self, output: &Output) -> Result<ExitCode> {
        let described =
            |path: &PathBuf| Ok(Described { path: path.clone(), content: content(path, self.memory.limits())? });
        let files = self.files.iter().map(described).collect::<Result<_>>()?;
        output.report(&Report { files })?;
        Ok(ExitCode::SUCCESS)
    }
}

fn content(path: &Path, limits: Limits) -> Result<Content> {
    match formats::sniff(path)? {
        // NanoVDB too: its refusal says how to convert it.
        Format::Vdb | Format::NanoVdb => volume::summary(path, limits).map(Content::Vdb),
        Format::Exr => formats::exr::summary_within(path, limits).map(Content::Exr),
        Format::Capture => formats::transforms::summary_within(path, limits).map(Content::Capture),
        Format::Unknown => Err(formats::unknown().at(path)),
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.files.iter().try_for_each(|file| write!(f, "{file}"))
    }
}

impl fmt::Display for Described {
    /// What the file is on the line of its path, all else below and indented.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = match &self.content {
            Content::Vdb(volume) => volume.to_string(),
            Content::Exr(picture) => picture.to_string(),
            Content::Capture(capture) => capture.to_string(),
        };
        writeln!(f, "{}: {}", printable(&self.path.to_string_lossy()), text.trim_end().replace('\n', "\n  "))
    }
}
