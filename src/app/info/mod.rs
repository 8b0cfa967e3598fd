//! The content of files.

mod image;
mod nano;
mod picture;
mod sequence;
mod volume;

use crate::app::Context;
use crate::app::failure::Failure;
use crate::app::scan::ScanSettings;
use crate::app::sequence::FrameSelection;
use crate::app::use_case::{Report, Status, use_case};
use crate::app::volume::format_of;
use crate::error::{Error, Kind, Result};
use crate::formats::captures::CaptureSummary;
use crate::formats::exr::ExrSummary;
use crate::formats::exr::deep::{self, DeepSummary};
use crate::formats::format::FileKind;
use crate::formats::limits::Limits;
use crate::formats::usd::StageSummary;
use crate::formats::{captures, exr, registry, usd};
use crate::text::printable;
use sequence::Summary;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::{Path, PathBuf};
use volume::Volume;

/// Settings of the description of files: grids of VDBs and NanoVDBs, layers of EXRs, cameras of captures, volumes of
/// USD stages, scans.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct InfoSettings {
    /// Files, captures or their folders; and patterns or folders of sequences.
    #[serde(with = "crate::app::paths")]
    pub files: Vec<PathBuf>,
    /// Frames of sequences to read.
    pub frames: FrameSelection,
    /// Parts of scans that are described, and where their voxels lie.
    #[serde(flatten)]
    pub scan: ScanSettings,
    /// Memory that the work may take.
    #[serde(flatten)]
    pub limits: Limits,
}

/// Report of what is in files.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct InfoReport {
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

/// Content of a file, tagged in JSON with its [`FileKind`].
#[derive(Debug, Serialize, schemars::JsonSchema)]
#[serde(tag = "format", rename_all = "lowercase")]
enum Content {
    Vdb(Volume),
    NanoVdb(nano::Summary),
    Exr(ExrSummary),
    DeepExr(DeepSummary),
    Capture(CaptureSummary),
    Usd(StageSummary),
    Picture(picture::Summary),
    Image(image::Summary),
}

impl InfoReport {
    /// True if all files, and all frames between the first and the last one of sequences, could be read.
    pub(crate) fn complete(&self) -> bool {
        // A frame that is missing is one that cannot be read.
        self.files.iter().all(|file| file.error.is_none()) && !self.sequences.iter().any(Summary::has_holes)
    }
}

use_case!(InfoSettings => InfoReport, limits);

impl Report for InfoReport {
    fn status(&self) -> Result<Status> {
        Ok(Status::complete(self.complete()))
    }
}

impl InfoSettings {
    /// Reads and describes the files; those that cannot be read are part of the report.
    ///
    /// # Errors
    /// If the only file cannot be read or is of an unknown format.
    pub fn run(&self, context: &Context) -> Result<InfoReport> {
        self.scan.check_files(self.files.iter().map(PathBuf::as_path), self.frames)?;
        let (mut files, mut sequences) = (Vec::new(), Vec::new());
        for path in &self.files {
            match self.sequences(path, context) {
                Ok(found) if !found.is_empty() => {
                    for (summary, frames) in found {
                        sequences.push(summary);
                        files.extend(frames);
                    }
                }
                Err(error) if error.kind() == Kind::Cancelled => return Err(error),
                found => files.push(self.file(path, found.err(), context)?),
            }
        }
        Ok(InfoReport { files, sequences })
    }

    /// Describes the sequences that a path names; none for the path of a file or a capture.
    fn sequences(&self, path: &Path, context: &Context) -> Result<Vec<(Summary, Vec<Described>)>> {
        self.frames.sequences(path)?.iter().map(|sequence| self.sequence(sequence, context)).collect()
    }

    /// Describes a file, or the `error` for which its path names none.
    ///
    /// # Errors
    /// If it cannot be read and is the only one.
    fn file(&self, path: &Path, error: Option<Error>, context: &Context) -> Result<Described> {
        let _stage = context.stage("reading");
        let result = match error {
            Some(error) => Err(error),
            None => self.frames.refuse(path).and_then(|()| self.content(path, self.limits)),
        };
        let (content, error) = match result {
            Ok(Content::Usd(stage)) => {
                let error = stage.error(path).map(|error| Failure::new(&error, context));
                (Some(Content::Usd(stage)), error)
            }
            Ok(content) => (Some(content), None),
            Err(error) if self.files.len() == 1 => return Err(error),
            Err(error) => (None, Some(Failure::new(&error, context))),
        };
        Ok(Described { path: path.to_path_buf(), frame: None, content, error })
    }
}

impl InfoSettings {
    fn content(&self, path: &Path, limits: Limits) -> Result<Content> {
        let format = format_of(path)?;
        match format.kind {
            FileKind::Vdb => volume::summary(path, limits).map(Content::Vdb),
            FileKind::NanoVdb => nano::summary(path, limits).map(Content::NanoVdb),
            FileKind::Exr => exr::summary_within(path, limits).map(Content::Exr),
            FileKind::DeepExr => deep::summary_within(path, limits).map(Content::DeepExr),
            FileKind::Picture(reader) => picture::summary(path, format.name, reader).map(Content::Picture),
            FileKind::Image(reader) => {
                image::summary(path, (format, reader), &self.scan.of(format), limits).map(Content::Image)
            }
            FileKind::Capture => captures::summary_within(path, limits).map(Content::Capture),
            FileKind::Usd => usd::summary(path, limits).map(Content::Usd),
            FileKind::Mesh(_) | FileKind::Unknown => Err(registry::unread(format, path)),
        }
    }
}

impl fmt::Display for InfoReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.files.iter().filter(|file| file.frame.is_none()).try_for_each(|file| write!(f, "{file}"))?;
        self.sequences.iter().try_for_each(|sequence| write!(f, "{sequence}"))
    }
}

impl fmt::Display for Content {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Vdb(volume) => volume.fmt(f),
            Self::NanoVdb(volume) => volume.fmt(f),
            Self::Exr(picture) => picture.fmt(f),
            Self::DeepExr(picture) => picture.fmt(f),
            Self::Capture(capture) => capture.fmt(f),
            Self::Usd(stage) => stage.fmt(f),
            Self::Picture(picture) => picture.fmt(f),
            Self::Image(image) => image.fmt(f),
        }
    }
}

impl fmt::Display for Described {
    /// Writes path and kind of the file on one line, and all else below it, indented.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = match (&self.content, &self.error) {
            (Some(content), _) => content.to_string(),
            (None, Some(failure)) => failure.to_string(),
            (None, None) => String::new(),
        };
        writeln!(f, "{}: {}", printable(&self.path.to_string_lossy()), text.trim_end().replace('\n', "\n  "))
    }
}
