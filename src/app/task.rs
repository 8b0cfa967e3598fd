//! A long task: its inputs and its interruption.

use super::context::Context;
use super::earlier::{Beginning, InitialGuess};
use super::outputs::{self, Content};
use super::photos;
use super::provenance::Provenance;
use crate::app::checks::pictures::PictureFacts;
use crate::app::checks::{self, Emission, Warning};
use crate::cancel::Cancel;
use crate::error::{Error, Kind, Result};
use crate::formats::captures;
use crate::formats::limits::Limits;
use crate::formats::protected;
use crate::inverse::observation::photo::Photo;
use crate::ranks;
use crate::scene::capture::Capture;
use serde::Serialize;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

/// The pictures that a task reads.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Captured<'c> {
    /// File that the capture lies in.
    pub json: &'c Path,
    /// Cameras and paths of the pictures.
    pub capture: &'c Capture,
    /// Whether the pictures must show the emission that the capture states.
    pub emission: Emission,
    /// Layer of the pictures; none for the beauty.
    pub layer: Option<&'c str>,
}

/// Message about work that was stopped before it had a result.
pub(crate) const NOTHING_FOUND: &str = "stopped by the user before anything was found; nothing is written";

/// Returns the error of work that has no result yet, which says so if the work was stopped.
pub(crate) fn without_result(error: Error) -> Error {
    if error.kind() == Kind::Cancelled { Error::cancelled().saying(NOTHING_FOUND) } else { error }
}

/// A long task that has begun.
#[derive(Debug)]
pub(crate) struct Task {
    /// Provenance of the output: command line and inputs.
    pub provenance: Provenance,
    /// File that the search begins with; none to begin from nothing.
    pub initial_guess: Option<Beginning>,
    /// Memory that the task may take.
    pub limits: Limits,
    /// Who watches the task, and what stops it.
    pub context: Context,
}

impl Task {
    /// Begins a task, once its output and the folder of its page, if there is to be one, are known to have fitting
    /// names and to be writable.
    ///
    /// # Errors
    /// Those of [`outputs::file`] and [`outputs::report_folder`].
    pub(crate) fn begin(
        output: &Path,
        content: Content,
        page: Option<&Path>,
        limits: Limits,
        context: &Context,
    ) -> Result<Self> {
        context.loading();
        let provenance = Provenance::begin(context);
        outputs::file(output, content)?;
        page.map_or(Ok(()), outputs::report_folder)?;
        Ok(Self { provenance, initial_guess: None, limits, context: context.clone() })
    }

    /// Begins a task that writes nothing.
    pub(crate) fn planned(limits: Limits, context: &Context) -> Self {
        Self { provenance: Provenance::begin(context), initial_guess: None, limits, context: context.clone() }
    }

    /// States the settings of a search, and where it begins.
    ///
    /// # Errors
    /// Those of [`InitialGuess::beginning`].
    pub(crate) fn search(&mut self, use_case: &str, settings: &impl Serialize, guess: InitialGuess<'_>) -> Result<()> {
        self.provenance = self.provenance.clone().of_search(use_case, settings);
        self.initial_guess = guess.beginning(&self.provenance)?;
        Ok(())
    }

    /// Reads the file that the search begins with, if there is one, by `read`. The output may be replaced all the same.
    ///
    /// # Errors
    /// Those of `read`, and of [`Beginning::check`]: inputs are to be read before.
    pub(crate) fn read_initial_guess<T>(&self, read: impl FnOnce(&Path) -> Result<T>) -> Result<Option<T>> {
        let Some(beginning) = &self.initial_guess else { return Ok(None) };
        match beginning.check(&self.provenance) {
            Err(_) if beginning.or_anew => return Ok(None),
            checked => checked?,
        }
        protected::unprotected(&beginning.file, || read(&beginning.file)).map(Some)
    }

    /// Reads the pictures of a capture, and returns what `take` makes of each, of `bytes` a pixel, with warnings about
    /// doubtful ones.
    ///
    /// # Errors
    /// Those of [`photos::each`], and an error if pictures and capture contradict each other.
    pub(crate) fn pictures<T: Send>(
        &mut self,
        Captured { json, capture, emission, layer }: Captured<'_>,
        bytes: u64,
        take: impl Fn(Photo) -> T + Sync + Send,
    ) -> Result<(Vec<T>, Vec<Warning>)> {
        let bar = self.context.steps(capture.frames.len() as u64, "reading pictures");
        let read = |photo: Photo| (PictureFacts::new(&photo, capture, emission), take(photo));
        let (facts, taken): (Vec<_>, Vec<_>) =
            photos::each(capture, layer, self.limits, bytes, &|| bar.inc(1), read)?.into_iter().unzip();
        let pictures = capture.frames.iter().map(|f| f.picture.as_path());
        let files = captures::files(json);
        self.provenance.input(json, files.iter().map(PathBuf::as_path).chain(pictures))?;
        if !ranks::is_common(&self.provenance.hash_of_inputs()) {
            return Err(Error::invalid("this process reads other pictures than the first one")
                .at(json)
                .hint("give all processes the same files"));
        }
        let findings = checks::pictures::pictures(&facts, capture, emission);
        drop(bar);
        let mut warnings = checks::refuse(findings).map_err(|e| e.at(json))?;
        warnings.extend(photos::remarks(capture));
        self.context.warn(&warnings);
        Ok((taken, warnings))
    }

    /// Marks the beginning of the work: a task that is stopped from here on writes its result so far.
    pub(crate) fn work_begins(&self) {
        self.context.work_begins();
    }

    /// Returns the cancellation that passes of the work poll.
    pub(crate) fn stop(&self) -> Cancel {
        self.context.cancel()
    }

    /// Returns the cancellation that passes poll which only measure or show the result.
    pub(crate) fn closing(&self) -> Cancel {
        self.context.closing()
    }

    /// Returns `Break` once the work is to stop.
    pub(crate) fn flow(&self) -> ControlFlow<()> {
        if self.stop().requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    /// Says how to go on with a task that was stopped.
    pub(crate) fn tell_stopped(&self, stopped: bool) {
        if stopped {
            self.context.note("stopped; what was there by then is written, and ⟨resume⟩ goes on from it");
        }
    }
}
