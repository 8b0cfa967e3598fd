//! Sequences: every frame is converted as a file of its own.

use super::{ConvertSettings, FileReport};
use crate::app::Context;
use crate::app::failed::{Failed, List};
use crate::app::frame_loop::{FrameLoop, parted};
use crate::app::sequence::{FrameSelection, Sequence, pattern};
use crate::error::{Error, Result};
use crate::formats::atomic::Batch;
use crate::formats::ending::ends_in;
use crate::formats::format::FileKind;
use crate::formats::protected;
use crate::formats::registry::{self, VDB};
use crate::formats::sequence::Pattern;
use serde::Serialize;
use std::fmt;
use std::path::PathBuf;

/// Report of a sequence.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct Frames {
    #[serde(serialize_with = "crate::app::paths::text")]
    input: PathBuf,
    #[serde(serialize_with = "crate::app::paths::text")]
    output: PathBuf,
    /// Number of frames that were converted.
    converted: usize,
    /// Bytes of all files that were written.
    bytes: u64,
    frames: Vec<Frame>,
    failed: Vec<Failed>,
}

/// A frame that was converted.
#[derive(Debug, Serialize, schemars::JsonSchema)]
struct Frame {
    frame: u32,
    /// Report of the conversion of the frame's file.
    report: FileReport,
    #[serde(skip)]
    bytes: u64,
}

impl ConvertSettings {
    /// Returns the sequence to be converted and the names of its results; none for a file.
    ///
    /// # Errors
    /// If the output names no sequence, or the input is none.
    pub(super) fn sequences(&self) -> Result<Option<(Sequence, Pattern)>> {
        // Slices of other formats make up one volume.
        let mut endings = registry::frame_endings(|kind| !matches!(kind, FileKind::Usd));
        if !self.input.is_dir() {
            // In a folder they lie beside the volumes that they were made of, or that were made of them.
            endings.extend(registry::endings(|kind| matches!(kind, FileKind::Mesh(_))));
        }
        let of_files = endings.iter().any(|ending| ends_in(&self.input, ending)) || self.input.is_dir();
        let Some(sequence) = self.frames.sequence(&self.input, &endings)?.filter(|_| of_files) else {
            return self.frames.refuse(&self.input).map(|()| None);
        };
        let to = match Pattern::parse(&self.output) {
            Some(pattern) => pattern,
            None if self.output.is_dir() || self.output.extension().is_none() => sequence.pattern.moved(&self.output),
            None => {
                return Err(Error::invalid("a sequence becomes a sequence, and this is the name of one file")
                    .at(&self.output)
                    .hint("give a name with the number's place, in quotes, such as 'out.####.vdb', or a folder"));
            }
        };
        Ok(Some((sequence, to)))
    }

    /// Converts the frames, several at a time. Those that fail are part of the report.
    ///
    /// # Errors
    /// If the results would replace the sequence itself, or their folder cannot be made.
    pub(super) fn convert_frames(&self, sequence: &Sequence, to: &Pattern, context: &Context) -> Result<Frames> {
        sequence.numbers.iter().try_for_each(|number| protected::check(&to.path(*number)))?;
        let further = self.further(sequence)?;
        // A folder that stays empty is removed again.
        let mut batch = Batch::new();
        if let Some(folder) = to.path(0).parent().filter(|folder| !folder.as_os_str().is_empty()) {
            batch.make_folder(folder)?;
        }
        let work = |number: u32, limits| {
            let (input, path) = (sequence.path(number), to.path(number));
            let frames = FrameSelection::default();
            let more = further.iter().map(|sequence| sequence.path(number)).collect();
            let of_frame = |path: &PathBuf| pattern(path).map_or_else(|| path.clone(), |pattern| pattern.path(number));
            let holdout = self.holdout.as_ref().map(of_frame);
            let one = Self { input, more, output: path.clone(), frames, limits, holdout, ..self.clone() };
            let report = one.convert_file(&context.silent())?;
            let bytes = std::fs::metadata(&path).map_or(0, |data| data.len());
            Ok(Frame { frame: number, report, bytes })
        };
        let frames = FrameLoop::steps(&sequence.numbers, "converting", context).telling();
        let (done, failed) = parted(frames.parallel(self.limits, work)?);
        if !done.is_empty() {
            batch.commit()?;
        }
        let frames: Vec<Frame> = done.into_iter().map(|(_, frame)| frame).collect();
        Ok(Frames {
            input: sequence.pattern.name(),
            output: to.name(),
            converted: frames.len(),
            bytes: frames.iter().map(|frame| frame.bytes).sum(),
            frames,
            failed,
        })
    }
}

impl ConvertSettings {
    /// Sequences whose frames are joined with those of the first one, which has a frame of each number.
    fn further(&self, first: &Sequence) -> Result<Vec<Sequence>> {
        let sequence = |path: &PathBuf| {
            let found = self.frames.sequence(path, VDB.endings)?.ok_or_else(|| {
                Error::invalid("this is no sequence, and the first input is one")
                    .at(path)
                    .hint("give sequences such as 'a.####.vdb' and 'b.####.vdb', or files")
            })?;
            match first.numbers.iter().find(|number| !found.numbers.contains(number)) {
                Some(number) => {
                    Err(Error::invalid(format!("the sequence has no frame {number}, which the first one has"))
                        .at(path)
                        .hint("choose the frames that all sequences have: ⟨frames=1-48⟩"))
                }
                None => Ok(found),
            }
        };
        self.more.iter().map(sequence).collect()
    }
}

impl Frames {
    /// True if no frame failed.
    pub(super) fn complete(&self) -> bool {
        self.failed.is_empty()
    }
}

impl fmt::Display for Frames {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for Frame { report, .. } in &self.frames {
            writeln!(f, "{}", report.to_string().trim_end())?;
        }
        let bytes = crate::text::bytes(self.bytes);
        write!(f, "{}: {} frames, {bytes} in all{}", self.output.display(), self.converted, List(&self.failed))
    }
}
