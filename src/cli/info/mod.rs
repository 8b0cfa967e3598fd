//! `cumulo info`: the content of files.

mod image;
mod nano;
mod sequence;
mod volume;

pub(super) use volume::statistics_of;

use super::memory::Memory;
use super::output::Output;
use crate::app::sequence::FrameSelection;
use crate::error::{Error, Kind, Result};
use crate::formats::captures::CaptureSummary;
use crate::formats::exr::ExrSummary;
use crate::formats::imaging::format as imaging;
use crate::formats::limits::Limits;
use crate::formats::usd::StageSummary;
use crate::formats::{self, Format};
use crate::text::printable;
use sequence::Summary;
use serde::Serialize;
use std::borrow::Cow;
use std::fmt;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use volume::Volume;

/// Show what is in files: grids of VDBs and NanoVDBs, layers of EXRs, cameras of captures, volumes of USD stages, scans
///
/// Of a sequence, 'smoke.####.vdb' or a folder of numbered files, each frame is shown in a line; --json has all of
/// each.
#[derive(Debug, clap::Args)]
pub struct Info {
    /// OpenVDB, NanoVDB or OpenEXR files, USD stages, captures (a transforms.json, a model of COLMAP, or the folder of
    /// either), scans and fields in the formats that `cumulo convert` reads, and sequences of files
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    #[command(flatten)]
    frames: FrameSelection,
    #[command(flatten)]
    pub(in crate::cli) memory: Memory,
}

#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(in crate::cli) struct Report {
    /// Files in the order in which they were given; those of sequences frame by frame.
    files: Vec<Described>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    sequences: Vec<Summary>,
}

#[derive(Debug, Serialize, schemars::JsonSchema)]
struct Described {
    #[serde(serialize_with = "crate::app::paths::text")]
    path: PathBuf,
    /// Number of the frame, of a file of a sequence.
    #[serde(skip_serializing_if = "Option::is_none")]
    frame: Option<u32>,
    #[serde(flatten)]
    content: Option<Content>,
    /// Error that kept the file, or a layer of a stage, from being read.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<Failure>,
}

/// Error that kept one of several files from being read.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
pub(in crate::cli) struct Failure {
    /// Grid, layer or frame that the error concerns; none if it is the whole file.
    part: Option<String>,
    what: String,
    #[serde(rename = "do")]
    remedy: Option<String>,
}

impl Failure {
    /// Creates the report's entry for an error, and prints the error on standard error.
    pub(in crate::cli) fn new(error: &Error) -> Self {
        let _ = writeln!(std::io::stderr().lock(), "cumulo: {error}");
        let (part, remedy) = (error.place().map(str::to_owned), error.remedy().map(Cow::into_owned));
        Self { part, what: error.what().into_owned(), remedy }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("could not be read: ")?;
        self.part.iter().try_for_each(|part| write!(f, "{part}: "))?;
        writeln!(f, "{}", self.what)?;
        self.remedy.iter().try_for_each(|remedy| writeln!(f, "{remedy}"))
    }
}

/// Content of a file, tagged in JSON with the name of its [`Format`].
#[derive(Debug, Serialize, schemars::JsonSchema)]
#[serde(tag = "format", rename_all = "lowercase")]
enum Content {
    Vdb(Volume),
    NanoVdb(nano::Summary),
    Exr(ExrSummary),
    Capture(CaptureSummary),
    Usd(StageSummary),
    Image(image::Summary),
}

impl Info {
    /// Reads the files and reports; files that cannot be read do not keep others from being reported.
    ///
    /// # Errors
    /// If the only file cannot be read or is of an unknown format.
    pub fn run(&self, output: &Output) -> Result<ExitCode> {
        let (mut files, mut sequences) = (Vec::new(), Vec::new());
        for path in &self.files {
            match self.sequences(path, output) {
                Ok(found) if !found.is_empty() => {
                    for (summary, frames) in found {
                        sequences.push(summary);
                        files.extend(frames);
                    }
                }
                Err(error) if error.kind() == Kind::Cancelled => return Err(error),
                found => files.push(self.file(path, found.err(), output)?),
            }
        }
        // A frame that is missing is one that cannot be read.
        let failed = files.iter().any(|file| file.error.is_some()) || sequences.iter().any(Summary::has_holes);
        output.report(&Report { files, sequences })?;
        Ok(if failed { ExitCode::from(2) } else { ExitCode::SUCCESS })
    }

    /// Describes the sequences that a path names; none for the path of a file or a capture.
    fn sequences(&self, path: &Path, output: &Output) -> Result<Vec<(Summary, Vec<Described>)>> {
        self.frames.sequences(path)?.iter().map(|sequence| self.sequence(sequence, output)).collect()
    }

    /// Describes a file, or the `error` for which its path names none.
    ///
    /// # Errors
    /// If it cannot be read and is the only one.
    fn file(&self, path: &Path, error: Option<Error>, output: &Output) -> Result<Described> {
        let _stage = output.stage("reading");
        let result = match error {
            Some(error) => Err(error),
            None => self.frames.refuse(path).and_then(|()| content(path, self.memory.limits())),
        };
        let (content, error) = match result {
            Ok(Content::Usd(stage)) => {
                let error = stage.error(path).as_ref().map(Failure::new);
                (Some(Content::Usd(stage)), error)
            }
            Ok(content) => (Some(content), None),
            Err(error) if self.files.len() == 1 => return Err(error),
            Err(error) => (None, Some(Failure::new(&error))),
        };
        Ok(Described { path: path.to_path_buf(), frame: None, content, error })
    }
}

fn content(path: &Path, limits: Limits) -> Result<Content> {
    match formats::sniff(path)? {
        Format::Vdb => volume::summary(path, limits).map(Content::Vdb),
        Format::NanoVdb => nano::summary(path, limits).map(Content::NanoVdb),
        Format::Exr => formats::exr::summary_within(path, limits).map(Content::Exr),
        Format::Capture if path.is_dir() && !formats::captures::file(path).exists() => folder(path, limits),
        Format::Capture => formats::captures::summary_within(path, limits).map(Content::Capture),
        Format::Usd => formats::usd::summary(path, limits).map(Content::Usd),
        Format::Unknown => match imaging::sniff(path)? {
            Some(kind) => image::summary(path, kind, limits).map(Content::Image),
            None => Err(formats::unknown(path)),
        },
    }
}

/// Describes a folder that holds no capture: an image of several files, else what a capture lacks.
fn folder(path: &Path, limits: Limits) -> Result<Content> {
    match imaging::sniff(path)? {
        Some(kind) => image::summary(path, kind, limits).map(Content::Image),
        None => formats::captures::summary_within(path, limits).map(Content::Capture),
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.files.iter().filter(|file| file.frame.is_none()).try_for_each(|file| write!(f, "{file}"))?;
        self.sequences.iter().try_for_each(|sequence| write!(f, "{sequence}"))
    }
}

impl fmt::Display for Described {
    /// Writes path and kind of the file on one line, and all else below it, indented.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = match (&self.content, &self.error) {
            (Some(Content::Vdb(volume)), _) => volume.to_string(),
            (Some(Content::NanoVdb(summary)), _) => summary.to_string(),
            (Some(Content::Exr(picture)), _) => picture.to_string(),
            (Some(Content::Capture(capture)), _) => capture.to_string(),
            (Some(Content::Usd(stage)), _) => stage.to_string(),
            (Some(Content::Image(image)), _) => image.to_string(),
            (None, Some(failure)) => failure.to_string(),
            (None, None) => String::new(),
        };
        writeln!(f, "{}: {}", printable(&self.path.to_string_lossy()), text.trim_end().replace('\n', "\n  "))
    }
}
