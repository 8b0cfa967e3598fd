//! Two sequences of VDBs, frame by frame.

use super::DiffSettings;
use super::report::FilesReport;
use crate::app::Context;
use crate::app::failed::{Failed, List};
use crate::app::frame_loop::{FrameLoop, parted};
use crate::app::sequence::{Sequence, common};
use crate::error::{Error, Result};
use serde::Serialize;
use std::fmt;

/// Report of two sequences.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct SequencesReport {
    /// True if all frames are the same, and none failed or is in one sequence alone.
    pub(super) same: bool,
    frames: Vec<Frame>,
    /// Number of frames that differ.
    different: usize,
    /// Frames that only one of the sequences has.
    left_out: Vec<u32>,
    pub(super) failed: Vec<Failed>,
    /// Largest absolute difference of all frames and grids.
    max_abs: f64,
    /// Lowest PSNR of all frames and grids in dB; none if no frame has one.
    psnr_db: Option<f64>,
}

#[derive(Debug, Serialize, schemars::JsonSchema)]
struct Frame {
    frame: u32,
    #[serde(flatten)]
    report: FilesReport,
}

impl DiffSettings {
    /// Compares frames of equal number, several at a time. Frames that fail are part of the report.
    ///
    /// # Errors
    /// If the sequences have no frame in common.
    pub(super) fn sequences(&self, sequences: &[Sequence; 2], context: &Context) -> Result<SequencesReport> {
        let [a, b] = sequences;
        let (both, left_out) = common(&[a, b]);
        if both.is_empty() {
            return Err(Error::invalid("the sequences have no frame in common")
                .at(&self.a)
                .hint("frames are matched by their numbers"));
        }
        let work = |number: u32, limits| {
            let paths = [a.path(number), b.path(number)];
            // The bar is that of the sequence.
            self.files([&paths[0], &paths[1]], limits, &context.silent())
        };
        let frames = FrameLoop::steps(&both, "comparing", context).telling();
        let (done, failed) = parted(frames.parallel(self.limits, work)?);
        let grids = || done.iter().flat_map(|(_, report)| &report.grids).map(|grid| &grid.difference);
        let max_abs = grids().fold(0.0_f64, |most, d| most.max(d.max_abs));
        let psnr_db = grids().filter_map(|d| d.psnr_db).reduce(f64::min);
        let frames: Vec<Frame> = done.into_iter().map(|(frame, report)| Frame { frame, report }).collect();
        let different = frames.iter().filter(|frame| !frame.report.same).count();
        let same = different == 0 && failed.is_empty() && left_out.is_empty();
        Ok(SequencesReport { same, frames, different, left_out, failed, max_abs, psnr_db })
    }
}

impl fmt::Display for SequencesReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for Frame { frame, report } in &self.frames {
            writeln!(f, "frame {frame}: {}", report.to_string().trim_end().replace('\n', "\n  "))?;
        }
        if !self.left_out.is_empty() {
            let numbers: Vec<String> = self.left_out.iter().map(u32::to_string).collect();
            writeln!(f, "in one of the sequences alone: frames {}", numbers.join(", "))?;
        }
        let values = match self.psnr_db {
            Some(db) => format!("lowest psnr {db:.2} dB"),
            None if self.max_abs == 0.0 => "equal values".into(),
            None => "psnr undefined".into(),
        };
        write!(f, "{} frames, {} different, ", self.frames.len(), self.different)?;
        write!(f, "{values}, max abs {:.4e}{}", self.max_abs, List(&self.failed))?;
        write!(f, "\n{}", if self.same { "same" } else { "different" })
    }
}
