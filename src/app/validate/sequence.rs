//! Faults of sequences: frames that are missing, and frames that do not fit the others.

use super::findings::Findings;
use super::traits::{Deviation, Trait, Traits, deviations};
use super::{Checked, ValidateSettings, check};
use crate::app::Context;
use crate::app::failure::Failure;
use crate::app::frame_loop::FrameLoop;
use crate::app::sequence::{Present, Sequence};
use crate::error::{Error, Result};
use crate::formats::exr::{self, ExrSummary};
use crate::formats::format::FileKind;
use crate::formats::limits::Limits;
use crate::text::{printable, ranges};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

/// A sequence that was checked.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(super) struct CheckedSequence {
    /// Path with the number's digits written as `#`.
    #[serde(serialize_with = "crate::app::paths::text")]
    pattern: PathBuf,
    /// Number of frames that were checked.
    frames: usize,
    first: Option<u32>,
    last: Option<u32>,
    /// Numbers between the first and the last whose files are not there.
    pub missing: Vec<u32>,
    /// True if neither the sequence nor any of its frames has a fault.
    pub valid: bool,
    /// Faults of the sequence as a whole.
    findings: Findings,
}

impl ValidateSettings {
    /// Checks the frames of a sequence, each by itself and all together.
    ///
    /// # Errors
    /// If no frame is there.
    pub(super) fn sequence(&self, sequence: &Sequence, context: &Context) -> Result<(CheckedSequence, Vec<Checked>)> {
        let Present { numbers, first, last, missing } = sequence.present("check")?;
        let full = self.limits;
        let results = FrameLoop::steps(&numbers, "checking", context).parallel(full, |number, limits| {
            let path = sequence.path(number);
            let (checked, mut traits) = check(&path, &self.scan, limits)?;
            if matches!(checked.format, Some(FileKind::Exr)) {
                // Faults that keep a picture from being read are among its findings.
                traits = of_picture(&path, limits).unwrap_or_default();
            }
            // Alone it may fit in memory.
            if checked.findings.unsupported && limits != full {
                return Err(Error::unsupported("more memory is needed"));
            }
            Ok((checked, traits))
        })?;
        let (mut files, mut traits) = (Vec::new(), Vec::new());
        for (number, result) in results {
            let checked = match result {
                Ok((checked, of)) => {
                    traits.push((number, of));
                    checked
                }
                Err(error) => Checked::failed(&sequence.path(number), Failure::new(&error, context)),
            };
            files.push(Checked { frame: Some(number), ..checked });
        }
        let mut findings = Findings::default();
        if !missing.is_empty() {
            let what = format!("frames are missing: {}", ranges(missing.iter().copied()));
            findings.problem(None, what, "write them, or name the frames that are meant with ⟨frames⟩");
        }
        // Frames without anything were refused, and are told of by themselves.
        traits.retain(|(_, of)| !of.is_empty());
        for Deviation { certain, part, what, remedy } in deviations(&traits) {
            findings.of_part(certain, &part, what, remedy);
        }
        let valid = findings.valid() && files.iter().all(|f| f.valid);
        let (first, last) = (Some(first), Some(last));
        let pattern = sequence.pattern.name();
        Ok((CheckedSequence { pattern, frames: files.len(), first, last, missing, valid, findings }, files))
    }
}

/// Returns what a picture is compared by with those of other frames.
///
/// # Errors
/// If it cannot be read.
fn of_picture(path: &Path, limits: Limits) -> Result<Traits> {
    let ExrSummary { display_window, parts, .. } = exr::summary_within(path, limits)?;
    let [width, height] = display_window.size;
    let mut traits = Traits::new();
    for layer in parts.iter().flat_map(|part| &part.layers) {
        let names: Vec<&str> = layer.channels.iter().map(|c| c.info.component.as_str()).collect();
        let values = layer.channels.iter().filter_map(|c| Some([f64::from(c.max?), c.mean?]));
        let figures = values.reduce(|a, b| [a[0].max(b[0]), a[1] + b[1]]);
        let kind = format!("{width} x {height} pixels of {}", names.join(", "));
        traits.insert(format!("layer '{}'", layer.name), Trait { kind, place: None, figures });
    }
    Ok(traits)
}

/// Writes a sequence, and what was found in its frames: each finding once, with the frames that have it.
pub(super) fn write(f: &mut fmt::Formatter<'_>, sequence: &CheckedSequence, files: &[&Checked]) -> fmt::Result {
    let verdict = if sequence.valid { "valid" } else { "not valid" };
    let name = sequence.pattern.to_string_lossy();
    writeln!(f, "{}: {} frames, {verdict}", printable(&name), sequence.frames)?;
    write!(f, "{}", sequence.findings)?;
    let mut groups: BTreeMap<String, Vec<u32>> = BTreeMap::new();
    for file in files {
        let number = file.frame.unwrap_or_default();
        file.lines().into_iter().for_each(|line| groups.entry(line).or_default().push(number));
    }
    let mut sorted: Vec<_> = groups.into_iter().collect();
    sorted.sort_by(|a, b| a.1.cmp(&b.1));
    for (text, frames) in sorted {
        writeln!(f, "  frames {}: {}", ranges(frames), text.replace('\n', "\n  "))?;
    }
    Ok(())
}
