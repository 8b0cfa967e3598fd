//! The frame of a long task: what it takes in, how it is stopped, how it ends.

use super::cancel;
use super::memory::Memory;
use super::output::Output;
use super::outputs::{self, Content};
use super::provenance::Provenance;
use super::run::Run;
use super::{photos, report};
use crate::cancel::Cancel;
use crate::error::{Kind, Result};
use crate::formats::limits::Limits;
use crate::optimise::plausibility::{self, Warning};
use crate::optimise::projection::observation::Photo;
use crate::process;
use crate::scene::capture::Capture;
use std::ops::ControlFlow;
use std::path::Path;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

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
        watch(cancel);
        outputs::file(output, content)?;
        if let Some(dir) = report {
            report::prepare(dir)?;
        }
        Ok(Self { provenance, limits: memory.limits(), cancel, report })
    }

    /// The pictures of a capture, which lies at `json`, and what about them is doubtful.
    ///
    /// # Errors
    /// As [`photos::read`], and if pictures and capture contradict each other.
    pub fn photos(
        &mut self,
        json: &Path,
        capture: &Capture,
        layer: Option<&str>,
        output: &Output,
    ) -> Result<(Vec<Photo>, Vec<Warning>)> {
        let bar = output.progress(capture.frames.len() as u64, "reading pictures");
        let photos = photos::read(capture, layer, self.limits, &|| bar.inc(1))?;
        let pictures = capture.frames.iter().map(|f| f.picture.as_path());
        self.provenance.input(json, std::iter::once(json).chain(pictures))?;
        let findings = plausibility::pictures(&photos, capture);
        bar.finish_and_clear();
        let warnings = plausibility::refuse(findings).map_err(|e| e.at(json))?;
        output.warn(&warnings);
        Ok((photos, warnings))
    }

    /// From here on a first Ctrl-C asks the work to stop, and what it has found is written; before, it ends the program
    /// if reading takes longer than a second.
    pub fn work_begins(&self) {
        WORKING.store(true, Ordering::SeqCst);
    }

    /// Polled by passes that search.
    pub fn stop(&self) -> Cancel {
        Cancel::on(self.cancel)
    }

    /// Polled by passes that only measure or show what was found: these have a second more.
    pub fn closing(&self) -> Cancel {
        Cancel::on(&OVERDUE)
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
            let _stage = output.stage("report");
            run.report = Some(report::write(dir, &run, self.limits, self.closing())?);
        }
        output.report(&run)?;
        Ok(exit_code(run.stopped, output))
    }
}

/// True once there is something that a stopped task could write.
static WORKING: AtomicBool = AtomicBool::new(false);
/// Set some time after the first Ctrl-C.
static OVERDUE: AtomicBool = AtomicBool::new(false);

/// Watches for the first Ctrl-C: ends the program where the inputs are not read soon, and else gives the work a second
/// for what only measures and shows its result.
fn watch(asked: &'static AtomicBool) {
    std::thread::spawn(move || {
        while !asked.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(50));
        }
        // What is nearly read may as well be begun: the work then ends with what it was given.
        let patience = Instant::now();
        while !WORKING.load(Ordering::SeqCst) {
            if patience.elapsed() > Duration::from_millis(1200) {
                process::leave(nothing_found());
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        std::thread::sleep(Duration::from_secs(1));
        OVERDUE.store(true, Ordering::Relaxed);
    });
}

/// Says that nothing was written; the exit code of a program that Ctrl-C ended.
fn nothing_found() -> u8 {
    use std::io::Write;
    let _ = writeln!(std::io::stderr(), "cumulo: stopped by the user before anything was found; nothing is written");
    130
}

/// The exit code of work that was stopped before it had a result; other errors are passed on.
///
/// # Errors
/// Those that are not about being stopped.
pub fn ended<T>(result: Result<T>) -> Result<std::result::Result<T, ExitCode>> {
    match result {
        Ok(value) => Ok(Ok(value)),
        Err(e) if e.kind() == Kind::Cancelled => Ok(Err(ExitCode::from(nothing_found()))),
        Err(e) => Err(e),
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
