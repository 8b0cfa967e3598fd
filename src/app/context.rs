//! What a use case runs in: who watches it, who may stop it, and whose name its outputs bear.

use super::failed::Failed;
use super::progress::{Event, Progress, Unit, Unwatched};
use crate::app::checks::Warning;
use crate::cancel::Cancel;
use crate::error::Error;
use crate::wording::worded;
use std::collections::HashSet;
use std::fmt::{self, Display};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// Surroundings of a use case. Copies share what was said and what stops the work.
///
/// ```
/// use cumulo::prelude::*;
///
/// let cancel = Cancel::new();
/// let context = Context::default().stopped_by(cancel.clone(), Cancel::NEVER).of("my pipeline, shot 7");
/// cancel.request();
/// # let folder = tempfile::tempdir()?;
/// # let output = folder.path().join("view.exr");
/// let pictures = PictureSettings { input: "fixtures/plume.vdb".into(), views: Some(1), ..PictureSettings::default() };
/// let render = RenderSettings { output: output.clone(), pictures, ..RenderSettings::default() };
/// assert_eq!(render.run(&context).unwrap_err().code(), Code::Cancelled);
/// assert!(!output.exists());
/// # Ok::<(), std::io::Error>(())
/// ```
#[derive(Clone)]
pub struct Context {
    progress: Arc<dyn Progress>,
    cancel: Cancel,
    closing: Cancel,
    origin: Arc<str>,
    shared: Arc<Shared>,
    /// True if stages and details are not shown: the work is a step of another one.
    silent: bool,
}

#[derive(Default)]
struct Shared {
    /// Remarks that were made: each is made once, however many frames give rise to it.
    said: Mutex<HashSet<String>>,
    stages: AtomicU64,
    stoppable: AtomicBool,
}

impl Default for Context {
    /// Work that nobody watches and that runs to its end; outputs bear the library's name.
    fn default() -> Self {
        Self::new(Unwatched)
    }
}

impl fmt::Debug for Context {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Context").field("origin", &self.origin).field("silent", &self.silent).finish_non_exhaustive()
    }
}

impl Context {
    /// Creates the context of work that `progress` is told of.
    pub fn new(progress: impl Progress + 'static) -> Self {
        Self {
            progress: Arc::new(progress),
            cancel: Cancel::NEVER,
            closing: Cancel::NEVER,
            origin: "cumulo (library)".into(),
            shared: Arc::default(),
            silent: false,
        }
    }

    /// Returns a context whose work stops once `cancel` is set. What only measures or shows the result of stopped work
    /// goes on until `closing` is set.
    #[must_use]
    pub fn stopped_by(self, cancel: Cancel, closing: Cancel) -> Self {
        Self { cancel, closing, ..self }
    }

    /// Returns a context whose outputs say that they come from `origin`, such as a command line.
    #[must_use]
    pub fn of(self, origin: &str) -> Self {
        Self { origin: origin.into(), ..self }
    }

    /// Returns a context for a step of this work: its stages and details are not shown, its remarks are made.
    #[must_use]
    pub(crate) fn silent(&self) -> Self {
        Self { silent: true, ..self.clone() }
    }

    /// Origin of the outputs, such as a command line.
    pub(crate) fn origin(&self) -> &str {
        &self.origin
    }

    /// Returns the cancellation that the work polls from now on.
    pub(crate) fn cancel(&self) -> Cancel {
        if !self.shared.stoppable.swap(true, Ordering::SeqCst) {
            self.progress.event(&Event::Stoppable);
        }
        self.cancel.clone()
    }

    /// Returns the cancellation that passes poll which only measure or show the result.
    pub(crate) fn closing(&self) -> Cancel {
        self.closing.clone()
    }

    /// Says that inputs of a long task are read, after which [`Self::work_begins`].
    pub(crate) fn loading(&self) {
        self.progress.event(&Event::Loading);
    }

    /// Says that work which is stopped from now on writes what it has.
    pub(crate) fn work_begins(&self) {
        self.progress.event(&Event::Working);
    }

    /// Makes a remark, unless it was made before.
    pub(crate) fn note(&self, text: impl Display) {
        self.once(&worded(&text.to_string()), |text| self.progress.event(&Event::Remark { text }));
    }

    /// Tells a detail of how the work is done, unless it was told before.
    pub(crate) fn detail(&self, text: impl Display) {
        if !self.silent {
            self.once(&worded(&text.to_string()), |text| self.progress.event(&Event::Detail { text }));
        }
    }

    /// Makes warnings, each once; the report holds them, too.
    pub(crate) fn warn(&self, warnings: &[Warning]) {
        for warning in warnings {
            let text = format!("{}\n{}", warning.what, warning.remedy);
            self.once(&text, |_| self.progress.event(&Event::Warned { warning }));
        }
    }

    /// Says which frames failed, and why.
    pub(crate) fn failed(&self, failed: &[Failed]) {
        for Failed { frame, code, error } in failed {
            self.progress.event(&Event::Failed { frame: *frame, code: *code, error });
        }
    }

    /// Says why one of several files could not be read.
    pub(crate) fn unread(&self, error: &Error) {
        self.progress.event(&Event::Unread { code: error.code(), error: &error.to_string() });
    }

    fn once(&self, text: &str, tell: impl FnOnce(&str)) {
        if self.shared.said.lock().unwrap_or_else(PoisonError::into_inner).insert(text.to_owned()) {
            tell(text);
        }
    }

    /// Begins a stage of unknown length, which ends when the returned value is dropped.
    pub(crate) fn stage(&self, name: &'static str) -> Stage {
        Stage::begin(self, name, None, Unit::Steps)
    }

    /// Begins a stage of `total` steps.
    pub(crate) fn steps(&self, total: u64, name: &'static str) -> Stage {
        Stage::begin(self, name, Some(total), Unit::Steps)
    }

    /// Begins a stage of so many pictures, of which the pixels count.
    pub(crate) fn pictures(&self, count: u64, name: &'static str) -> Stage {
        Stage::begin(self, name, Some(count), Unit::Pictures)
    }
}

/// A stage of the work, which ends when it is dropped.
pub struct Stage {
    /// None for a stage that is not shown.
    progress: Option<Arc<dyn Progress>>,
    number: u64,
    name: &'static str,
    begun: Instant,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    /// Thousandths of steps that are done: whole numbers, which add up.
    parts: u64,
    total: Option<u64>,
    message: String,
}

impl fmt::Debug for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Stage").field("name", &self.name).finish_non_exhaustive()
    }
}

impl Stage {
    fn begin(context: &Context, name: &'static str, total: Option<u64>, unit: Unit) -> Self {
        let number = context.shared.stages.fetch_add(1, Ordering::Relaxed);
        let progress = (!context.silent).then(|| Arc::clone(&context.progress));
        if let Some(progress) = &progress {
            progress.event(&Event::Began { stage: number, name, total, unit });
        }
        Self { progress, number, name, begun: Instant::now(), state: Mutex::new(State { total, ..State::default() }) }
    }

    fn change(&self, change: impl FnOnce(&mut State)) {
        let Some(progress) = &self.progress else { return };
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        change(&mut state);
        // Told while the state is held, so that events come in the order of the changes.
        let State { parts, total, message } = &*state;
        let done = *parts as f64 / PARTS as f64;
        progress.event(&Event::Advanced { stage: self.number, done, total: *total, message });
    }

    /// Counts steps that are done.
    pub(crate) fn inc(&self, steps: u64) {
        self.change(|state| state.parts += PARTS * steps);
    }

    /// States that `done` of `of` parts are done, of a stage whose steps are not counted.
    pub(crate) fn at(&self, done: usize, of: usize) {
        self.message(format!("({done} of {of})"));
    }

    /// States that `done` steps are done of `total`, and how the work stands in words.
    pub(crate) fn set(&self, done: u64, total: u64, message: impl Into<String>) {
        self.change(|state| *state = State { parts: PARTS * done, total: Some(total), message: message.into() });
    }

    /// States that `done` steps are done, of as many as before or more, and how the work stands in words.
    pub(crate) fn reach(&self, done: u64, message: impl Into<String>) {
        self.change(|state| {
            let total = state.total.map(|total| total.max(done));
            *state = State { parts: PARTS * done, total, message: message.into() };
        });
    }

    /// States how the work stands in words.
    pub(crate) fn message(&self, message: impl Into<String>) {
        self.change(|state| state.message = message.into());
    }

    /// Begins a picture, of a stage of pictures.
    pub(crate) fn picture(&self) -> Picture<'_> {
        Picture { stage: self, done: AtomicU64::new(0), shown: AtomicU64::new(0) }
    }
}

impl Drop for Stage {
    fn drop(&mut self) {
        if let Some(progress) = &self.progress {
            let seconds = self.begun.elapsed().as_secs_f64();
            progress.event(&Event::Ended { stage: self.number, name: self.name, seconds });
        }
    }
}

/// Parts of a step that are told of.
const PARTS: u64 = 1000;

/// Picture at work, of a stage of pictures.
#[derive(Debug)]
pub struct Picture<'s> {
    stage: &'s Stage,
    /// Pixels that are done, and parts of the picture that were told of.
    done: AtomicU64,
    shown: AtomicU64,
}

impl Picture<'_> {
    /// Counts pixels that are done, of all that the picture has.
    pub(crate) fn add(&self, pixels: u64, all: u64) {
        let done = self.done.fetch_add(pixels, Ordering::Relaxed) + pixels;
        self.show(PARTS * done.min(all) / all.max(1));
    }

    /// Tells how much is done of all.
    pub(crate) fn reach(&self, done: u64, all: u64) {
        self.show(PARTS * done.min(all) / all.max(1));
    }

    fn show(&self, parts: u64) {
        let before = self.shown.fetch_max(parts, Ordering::Relaxed);
        if parts > before {
            self.stage.change(|state| state.parts += parts - before);
        }
    }
}

impl Drop for Picture<'_> {
    /// Counts the picture as done, whatever has become of it.
    fn drop(&mut self) {
        self.show(PARTS);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Default)]
    struct Log(Mutex<Vec<String>>);

    impl Progress for Arc<Log> {
        fn event(&self, event: &Event<'_>) {
            let text = serde_json::to_string(event).unwrap_or_default();
            self.0.lock().unwrap_or_else(PoisonError::into_inner).push(text);
        }
    }

    fn watched() -> (Arc<Log>, Context) {
        let log = Arc::<Log>::default();
        (Arc::clone(&log), Context::new(log))
    }

    impl Log {
        fn take(&self) -> Vec<String> {
            std::mem::take(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
        }
    }

    /// A picture that takes hours is not "0 of 1" to its end.
    #[test]
    fn pixels_of_a_picture_count() {
        let (log, context) = watched();
        let stage = context.pictures(2, "render");
        let done = |log: &Log| {
            let last: serde_json::Value =
                serde_json::from_str(&log.take().pop().unwrap_or_default()).unwrap_or_default();
            last["done"].as_f64()
        };
        {
            let picture = stage.picture();
            picture.add(75, 300);
            assert_eq!(done(&log), Some(0.25));
            picture.add(225, 300);
        }
        assert_eq!(done(&log), Some(1.0));
        drop(stage.picture());
        assert_eq!(done(&log), Some(2.0));
    }

    #[test]
    fn remarks_are_made_once_and_steps_of_other_work_show_nothing() {
        let (log, context) = watched();
        context.note("⟨frames⟩");
        context.silent().note("⟨frames⟩");
        context.silent().note("b");
        context.silent().detail("c");
        drop(context.silent().steps(3, "none"));
        assert_eq!(log.take(), [r#"{"event":"remark","text":"`frames`"}"#, r#"{"event":"remark","text":"b"}"#]);
        context.cancel();
        context.silent().cancel();
        assert_eq!(log.take(), [r#"{"event":"stoppable"}"#], "said once");
    }
}
