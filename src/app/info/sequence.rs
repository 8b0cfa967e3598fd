//! Sequences of files: what each frame holds, in a line.

use super::{Content, Described, InfoSettings};
use crate::app::Context;
use crate::app::failure::Failure;
use crate::app::frame_loop::FrameLoop;
use crate::app::sequence::{Present, Sequence};
use crate::error::Result;
use crate::text::{printable, ranges};
use serde::Serialize;
use std::fmt;
use std::path::PathBuf;

/// Summary of a sequence.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(super) struct Summary {
    /// Path with the number's digits written as `#`.
    #[serde(serialize_with = "crate::app::paths::text")]
    pattern: PathBuf,
    /// Number of frames that were read.
    frames: usize,
    first: Option<u32>,
    last: Option<u32>,
    /// Numbers between the first and the last whose files are not there.
    missing: Vec<u32>,
    /// Numbers of the frames that could not be read.
    failed: Vec<u32>,
    /// A line for each frame, as the text shows it.
    #[serde(skip)]
    lines: Vec<(u32, String)>,
}

impl Summary {
    /// True if frames are missing.
    pub(crate) fn has_holes(&self) -> bool {
        !self.missing.is_empty()
    }
}

impl InfoSettings {
    /// Describes the frames of a sequence.
    ///
    /// # Errors
    /// If no frame is there.
    pub(super) fn sequence(&self, sequence: &Sequence, context: &Context) -> Result<(Summary, Vec<Described>)> {
        let Present { numbers, first, last, missing } = sequence.present("read")?;
        let work = |number, limits| self.content(&sequence.path(number), limits);
        let results = FrameLoop::steps(&numbers, "reading", context).parallel(self.limits, work)?;
        let mut summary = Summary {
            pattern: sequence.pattern.name(),
            frames: 0,
            first: Some(first),
            last: Some(last),
            missing,
            failed: Vec::new(),
            lines: Vec::new(),
        };
        let mut files = Vec::new();
        for (number, result) in results {
            let (content, error) = match result {
                Ok(content) => (Some(content), None),
                Err(error) => (None, Some(Failure::new(&error, context))),
            };
            match &content {
                Some(content) => summary.lines.push((number, line(content))),
                None => summary.failed.push(number),
            }
            files.push(Described { path: sequence.path(number), frame: Some(number), content, error });
        }
        summary.frames = summary.lines.len();
        Ok((summary, files))
    }
}

/// Returns what a file holds, in a line.
fn line(content: &Content) -> String {
    match content {
        Content::Vdb(volume) => volume.line(),
        Content::Image(image) => image.line(),
        Content::Exr(picture) => {
            let [width, height] = picture.display_window.size;
            let layers: usize = picture.parts.iter().map(|part| part.layers.len()).sum();
            format!("{width} x {height} pixels, {layers} layers")
        }
        _ => content.to_string().lines().next().unwrap_or_default().to_owned(),
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = self.pattern.to_string_lossy();
        write!(f, "{}: {} frames", printable(&name), self.frames)?;
        if let (Some(first), Some(last)) = (self.first, self.last) {
            write!(f, ", {first} to {last}")?;
        }
        writeln!(f)?;
        self.lines.iter().try_for_each(|(number, line)| writeln!(f, "  {number:>6}  {line}"))?;
        for (numbers, what) in [(&self.missing, "missing"), (&self.failed, "could not be read")] {
            if !numbers.is_empty() {
                writeln!(f, "  {what}: {}", ranges(numbers.iter().copied()))?;
            }
        }
        Ok(())
    }
}
