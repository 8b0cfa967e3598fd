//! The frame of a long task: its inputs, its interruption and its end.

use super::cancel;
use super::document;
use super::memory::Memory;
use super::output::Output;
use super::outputs::{self, Content};
use super::provenance::Provenance;
use super::run::Run;
use super::{photos, report};
use crate::cancel::Cancel;
use crate::error::{Kind, Result};
use crate::formats::captures;
use crate::formats::limits::Limits;
use crate::optimise::plausibility::{self, Emission, PictureFacts, Warning};
use crate::optimise::projection::photo::Photo;
use crate::process;
use crate::scene::capture::Capture;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// The pictures that a task reads.
#[derive(Debug, Clone, Copy)]
pub struct Captured<'c> {
    /// File that the capture lies in.
    pub json: &'c Path,
    /// Cameras and paths of the pictures.
    pub capture: &'c Capture,
    /// Whether the pictures must show the emission that the capture states.
    pub emission: Emission,
    /// Layer of the pictures; none for the beauty.
    pub layer: Option<&'c str>,
}

/// A task that has begun.
#[derive(Debug)]
pub struct Task<'t> {
    /// Provenance of the output: command line and inputs.
    pub provenance: Provenance,
    /// Memory that the task may take.
    pub limits: Limits,
    /// Flag that Ctrl-C sets.
    pub cancel: &'static AtomicBool,
    report: Option<&'t Path>,
}

impl<'t> Task<'t> {
    /// Begins a task, once its output and the report's folder are known to have fitting names and to be writable.
    ///
    /// # Errors
    /// Those of [`outputs::file`] and [`report::prepare`].
    pub fn begin(output: &Path, content: Content, report: Option<&'t Path>, memory: &Memory) -> Result<Self> {
        let (cancel, provenance) = (cancel::listen(), Provenance::begin());
        watch(cancel);
        outputs::file(output, content)?;
        if let Some(dir) = report {
            report::prepare(dir)?;
        }
        Ok(Self { provenance, limits: memory.limits(), cancel, report })
    }

    /// Reads the pictures of a capture, and returns what `take` makes of each, of `bytes` a pixel, with warnings about
    /// doubtful ones.
    ///
    /// # Errors
    /// Those of [`photos::each`], and an error if pictures and capture contradict each other.
    pub fn pictures<T: Send>(
        &mut self,
        Captured { json, capture, emission, layer }: Captured<'_>,
        output: &Output,
        bytes: u64,
        take: impl Fn(Photo) -> T + Sync + Send,
    ) -> Result<(Vec<T>, Vec<Warning>)> {
        let bar = output.progress(capture.frames.len() as u64, "reading pictures");
        let read = |photo: Photo| (PictureFacts::new(&photo, capture, emission), take(photo));
        let (facts, taken): (Vec<_>, Vec<_>) =
            photos::each(capture, layer, self.limits, bytes, &|| bar.inc(1), read)?.into_iter().unzip();
        let pictures = capture.frames.iter().map(|f| f.picture.as_path());
        let files = captures::files(json);
        self.provenance.input(json, files.iter().map(PathBuf::as_path).chain(pictures))?;
        let findings = plausibility::pictures(&facts, capture, emission);
        bar.finish_and_clear();
        let mut warnings = plausibility::refuse(findings).map_err(|e| e.at(json))?;
        warnings.extend(photos::remarks(capture));
        output.warn(&warnings);
        Ok((taken, warnings))
    }

    /// Marks the beginning of the work: from here on a first Ctrl-C stops it, and its result so far is written; before, a
    /// Ctrl-C ends the program if reading takes longer than a second.
    pub fn work_begins(&self) {
        WORKING.store(true, Ordering::SeqCst);
    }

    /// Returns the cancellation that passes of the work poll: it is set by the first Ctrl-C.
    pub fn stop(&self) -> Cancel {
        Cancel::on(self.cancel)
    }

    /// Returns the cancellation that passes poll which only measure or show the result: it is set a second after the first
    /// Ctrl-C.
    pub fn closing(&self) -> Cancel {
        Cancel::on(&OVERDUE)
    }

    /// Returns `Break` once the first Ctrl-C has stopped the work.
    pub fn flow(&self) -> ControlFlow<()> {
        if self.cancel.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    /// Ends the reconstruction of a volume: makes its page, prints its report and returns the exit code.
    ///
    /// # Errors
    /// If the page cannot be made, or the report cannot be printed.
    pub fn finish(&self, mut run: Run, output: &Output) -> Result<ExitCode> {
        if let Some(dir) = self.report {
            let _stage = output.stage("report");
            run.report = Some(report::write(dir, &run, self.limits, self.closing())?);
        }
        output.report(&run)?;
        Ok(exit_code(run.stopped, output))
    }
}

/// True once the work has begun, whose result a stopped task writes.
static WORKING: AtomicBool = AtomicBool::new(false);
/// Set a second after the first Ctrl-C, once the work has begun.
static OVERDUE: AtomicBool = AtomicBool::new(false);

/// Watches for the first Ctrl-C: ends the program if the inputs are not read soon, and else gives the work a second to
/// measure and show its result.
fn watch(stop: &'static AtomicBool) {
    std::thread::spawn(move || {
        while !stop.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(50));
        }
        // What is nearly read may as well be begun: the work then ends with what it started from.
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

/// Prints that nothing was written, and returns the exit code of a program that Ctrl-C ended.
fn nothing_found() -> u8 {
    use std::io::Write;
    const WHAT: &str = "stopped by the user before anything was found; nothing is written";
    document::write(WHAT, None, None, None);
    let _ = writeln!(std::io::stderr(), "cumulo: {WHAT}");
    cancel::code()
}

/// Separates work that was stopped before it had a result, for which it returns an exit code, from results.
///
/// # Errors
/// All errors but that of being stopped.
pub fn ended<T>(result: Result<T>) -> Result<std::result::Result<T, ExitCode>> {
    match result {
        Ok(value) => Ok(Ok(value)),
        Err(e) if e.kind() == Kind::Cancelled => Ok(Err(ExitCode::from(nothing_found()))),
        Err(e) => Err(e),
    }
}

/// Returns the exit code of a finished task, 130 if Ctrl-C stopped it, and then prints a note on `--resume`.
pub fn exit_code(stopped: bool, output: &Output) -> ExitCode {
    if stopped {
        output.note("stopped; what was there by then is written, and --resume goes on from it");
        return ExitCode::from(cancel::code());
    }
    ExitCode::SUCCESS
}
