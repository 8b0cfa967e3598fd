//! Faults of files, with remedies.

mod capture;
mod findings;
mod image;
mod nano;
mod sequence;
mod traits;
mod volume;

use crate::app::Context;
use crate::app::failure::Failure;
use crate::app::scan::ScanSettings;
use crate::app::sequence::FrameSelection;
use crate::app::use_case::{Report, Status, use_case};
use crate::app::volume::format_of;
use crate::error::{Error, Kind, Result};
use crate::formats::exr::deep;
use crate::formats::format::FileKind;
use crate::formats::limits::Limits;
use crate::formats::picture::{self, Options};
use crate::formats::{exr, registry, usd};
use crate::scene::color_space::ColorSpace;
use crate::text::printable;
use findings::Findings;
use schemars::JsonSchema;
use sequence::CheckedSequence;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::{Path, PathBuf};
use traits::Traits;

/// Settings of the check of files for faults.
///
/// Of a sequence, each frame is checked, and so is the whole: frames that are missing, names, types of values and voxel
/// sizes that change, and frames whose largest value or sum leaps.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ValidateSettings {
    /// Files, captures or their folders; and patterns or folders of sequences.
    #[serde(with = "crate::app::paths")]
    pub files: Vec<PathBuf>,
    /// Frames of sequences to check.
    pub frames: FrameSelection,
    /// Parts of scans that are checked, and where their voxels lie.
    #[serde(flatten)]
    pub scan: ScanSettings,
    /// Memory that the work may take.
    #[serde(flatten)]
    pub limits: Limits,
}

/// Report of what is wrong with files, and what to do.
#[derive(Debug, Serialize, JsonSchema)]
pub struct ValidateReport {
    valid: bool,
    /// Files in the order in which they were given; those of sequences frame by frame.
    files: Vec<Checked>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    sequences: Vec<CheckedSequence>,
}

/// Findings of the check of a file.
#[derive(Debug, Serialize, JsonSchema)]
struct Checked {
    #[serde(serialize_with = "crate::app::paths::text")]
    path: PathBuf,
    /// Number of the frame, of a file of a sequence.
    #[serde(skip_serializing_if = "Option::is_none")]
    frame: Option<u32>,
    /// Sequence that the file belongs to, by its place among those of the report.
    #[serde(skip)]
    sequence: usize,
    /// Format of the file; none if it could not be read.
    format: Option<FileKind>,
    valid: bool,
    findings: Findings,
    /// Error that kept the file from being read.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<Failure>,
}

impl Checked {
    /// Returns the entry of a file that could not be read.
    fn failed(path: &Path, failure: Failure) -> Self {
        let findings = Findings::default();
        Self { path: path.into(), frame: None, sequence: 0, format: None, valid: false, findings, error: Some(failure) }
    }

    /// Returns what is wrong with the file, as the text of a report shows it.
    fn lines(&self) -> Vec<String> {
        match &self.error {
            Some(failure) => vec![failure.to_string().trim_end().to_owned()],
            None => self.findings.lines(),
        }
    }
}

impl ValidateReport {
    /// True if all files could be read, and none has a fault.
    pub(crate) fn valid(&self) -> bool {
        self.valid
    }

    /// True if all files, and all frames between the first and the last one of sequences, could be read.
    pub(crate) fn complete(&self) -> bool {
        // A frame that is missing is one that cannot be read.
        self.files.iter().all(|f| f.error.is_none()) && self.sequences.iter().all(|s| s.missing.is_empty())
    }
}

use_case!(ValidateSettings => ValidateReport, limits);

impl Report for ValidateReport {
    fn status(&self) -> Result<Status> {
        Ok(Status::of_check(self.complete(), !self.valid()))
    }
}

impl ValidateSettings {
    /// Checks the files; faults, and files that cannot be read, are part of the report.
    ///
    /// # Errors
    /// If the only file cannot be read at all.
    pub fn run(&self, context: &Context) -> Result<ValidateReport> {
        self.scan.check_files(self.files.iter().map(PathBuf::as_path), self.frames)?;
        let (mut files, mut sequences) = (Vec::new(), Vec::new());
        for path in &self.files {
            match self.sequences(path, context) {
                Ok(found) if !found.is_empty() => {
                    for (checked, frames) in found {
                        let place = sequences.len();
                        files.extend(frames.into_iter().map(|file| Checked { sequence: place, ..file }));
                        sequences.push(checked);
                    }
                }
                Err(error) if error.kind() == Kind::Cancelled => return Err(error),
                found => files.push(self.file(path, found.err(), context)?),
            }
        }
        let valid = files.iter().all(|f| f.valid) && sequences.iter().all(|s| s.valid);
        Ok(ValidateReport { valid, files, sequences })
    }

    /// Checks the sequences that a path names; none for the path of a file or a capture.
    fn sequences(&self, path: &Path, context: &Context) -> Result<Vec<(CheckedSequence, Vec<Checked>)>> {
        self.frames.sequences(path)?.iter().map(|sequence| self.sequence(sequence, context)).collect()
    }

    /// Checks a file, or reports the `error` for which its path names none.
    ///
    /// # Errors
    /// If it cannot be read and is the only one.
    fn file(&self, path: &Path, error: Option<Error>, context: &Context) -> Result<Checked> {
        let _stage = context.stage("checking");
        let result = match error {
            Some(error) => Err(error),
            None => self.frames.refuse(path).and_then(|()| check(path, &self.scan, self.limits)),
        };
        match result {
            Ok((checked, _)) => Ok(checked),
            Err(error) if self.files.len() == 1 => Err(error),
            Err(error) => Ok(Checked::failed(path, Failure::new(&error, context))),
        }
    }
}

/// Checks a file, and returns what it is compared by if it is a frame of a sequence.
fn check(path: &Path, scan: &ScanSettings, limits: Limits) -> Result<(Checked, Traits)> {
    let format = format_of(path)?;
    let (mut findings, mut traits) = (Findings::default(), Traits::new());
    match format.kind {
        FileKind::Vdb => traits = volume::check(path, limits, &mut findings)?,
        FileKind::NanoVdb => traits = nano::check(path, limits, &mut findings)?,
        FileKind::Exr => findings.extend(exr::problems_within(path, limits)?),
        FileKind::DeepExr => deep::findings_within(path, limits)?.into_iter().for_each(|found| findings.deep(found)),
        FileKind::Capture => capture::check(path, limits, &mut findings)?,
        FileKind::Usd => findings.extend(usd::problems(path, limits)?),
        FileKind::Picture(_) => {
            let options = Options { color_space: Some(ColorSpace::Srgb), limits, ..Options::default() };
            picture::read(path, &options).map(drop).or_else(|error| findings.refusal(error))?;
        }
        FileKind::Image(reader) => {
            traits = image::check(path, (format, reader), (&scan.of(format), limits), &mut findings)?;
        }
        // What is of no kind at all may be a volume that was damaged.
        FileKind::Mesh(_) | FileKind::Unknown => findings.refusal(registry::unread(format, path))?,
    }
    let (path, valid) = (path.to_path_buf(), findings.valid());
    Ok((Checked { path, frame: None, sequence: 0, format: Some(format.kind), valid, findings, error: None }, traits))
}

impl fmt::Display for ValidateReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for file in self.files.iter().filter(|file| file.frame.is_none()) {
            if let Some(failure) = &file.error {
                let path = file.path.to_string_lossy();
                writeln!(f, "{}: {}", printable(&path), failure.to_string().trim_end().replace('\n', "\n  "))?;
                continue;
            }
            let verdict = if file.valid { "valid" } else { "not valid" };
            write!(f, "{}: {verdict}\n{}", printable(&file.path.to_string_lossy()), file.findings)?;
        }
        for (place, checked) in self.sequences.iter().enumerate() {
            let frames = self.files.iter().filter(|file| file.frame.is_some() && file.sequence == place);
            sequence::write(f, checked, &frames.collect::<Vec<_>>())?;
        }
        Ok(())
    }
}
