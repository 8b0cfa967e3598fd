//! The frame of a long task: what it takes in, how it is stopped, how it ends.

use super::cancel;
use super::memory::Memory;
use super::output::Output;
use super::outputs::{self, Content};
use super::provenance::Provenance;
use super::run::Run;
use super::{photos, report};
use crate::error::Result;
use crate::formats::vdb::Limits;
use crate::optimise::observation::Photo;
use crate::scene::capture::Capture;
use std::ops::ControlFlow;
use std::path::Path;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

/// A task that has begun.
#[derive(Debug)]
pub struct Task<'t> {
    /// What goes into it.
    pub provenance: Provenance,
    /// Memory that it may take.
    pub limits: Limits,
    /// Set by Ctrl-C.
    pub cancel: &'static AtomicBool,
    report: Option<&'t Path>,
}

impl<'t> Task<'t> {
    /// Begins, if the output and the report's folder have fitting names and can be written to: before the work, not after
    /// it.
    ///
    /// # Errors
    /// As [`outputs::file`] and [`report::prepare`].
    pub fn begin(output: &Path, content: Content, report: Option<&'t Path>, memory: &Memory) -> Result<Self> {
        let (cancel, provenance) = (cancel::listen(), Provenance::begin());
        outputs::file(output, content)?;
        if let Some(dir) = report {
            report::prepare(dir)?;
        }
        Ok(Self { provenance, limits: memory.limits(), cancel, report })
    }

    /// The pictures of a capture, which lies at `json`.
    ///
    /// # Errors
    /// As [`photos::read`].
    pub fn photos(&mut self, json: &Path, capture: &Capture, layer: Option<&str>) -> Result<Vec<Photo>> {
        let photos = photos::read(capture, layer, self.limits)?;
        let pictures = capture.frames.iter().map(|f| f.picture.as_path());
        self.provenance.input(json, std::iter::once(json).chain(pictures))?;
        Ok(photos)
    }

    /// Whether to go on.
    pub fn flow(&self) -> ControlFlow<()> {
        if self.cancel.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    /// Ends the reconstruction of a volume: page, report, exit code.
    ///
    /// # Errors
    /// If the page cannot be made or the report not be printed.
    pub fn finish(&self, mut run: Run, output: &Output) -> Result<ExitCode> {
        if let Some(dir) = self.report {
            run.report = Some(report::write(dir, &run, self.limits)?);
        }
        output.report(&run)?;
        Ok(exit_code(run.stopped, output))
    }
}

/// That of a task which the user may have stopped, with a word on what then.
pub fn exit_code(stopped: bool, output: &Output) -> ExitCode {
    if stopped {
        output.note("stopped; what was there by then is written, and --resume goes on from it");
        return ExitCode::from(1);
    }
    ExitCode::SUCCESS
}
