//! Displays of work that goes on: a bar of steps, and a stage of unknown length.

use super::log::Log;
use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use std::fmt;
use std::io::IsTerminal;
use std::ops::Deref;
use std::time::{Duration, Instant};

/// How progress is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Manner {
    /// True if nothing is shown.
    pub hidden: bool,
    /// True if the time that a stage took is written when it ends.
    pub timed: bool,
}

/// A progress bar, which is cleared when it is dropped.
#[derive(Debug)]
pub struct Progress(Shown);

impl Progress {
    /// Shows a bar of `length` steps with the remaining time; where standard error is no terminal, a plain line at most
    /// every ten seconds.
    pub(super) fn new(length: u64, what: &'static str, manner: Manner) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let template = if terminal {
            "{prefix} [{bar:30}] {pos}/{len} {elapsed} (ETA {left}) {msg}"
        } else {
            "{prefix}: {pos} of {len} after {elapsed}, {left} to go; {msg}"
        };
        Self(Shown::new(Some(length), template, what, manner))
    }
}

impl Deref for Progress {
    type Target = ProgressBar;

    fn deref(&self) -> &ProgressBar {
        &self.0.bar
    }
}

/// Progress display of a stage of unknown length.
#[derive(Debug)]
pub struct Stage(Shown);

impl Stage {
    /// Shows that a stage goes on, until the returned value is dropped.
    pub(super) fn new(what: &'static str, manner: Manner) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let template = if terminal { "{prefix} {spinner} {elapsed} {msg}" } else { "{prefix}: {elapsed} so far {msg}" };
        Self(Shown::new(None, template, what, manner))
    }

    /// Shows that `done` of `of` parts of the stage are done.
    pub fn at(&self, done: usize, of: usize) {
        self.0.bar.set_message(format!("({done} of {of})"));
    }
}

/// A display on standard error until it is dropped.
#[derive(Debug)]
struct Shown {
    bar: ProgressBar,
    what: &'static str,
    timed: bool,
    begun: Instant,
}

impl Shown {
    fn new(length: Option<u64>, template: &str, what: &'static str, manner: Manner) -> Self {
        let target = match (manner.hidden, std::io::stderr().is_terminal()) {
            (true, _) => ProgressDrawTarget::hidden(),
            (false, true) => ProgressDrawTarget::stderr(),
            (false, false) => ProgressDrawTarget::term_like(Box::new(Log::default())),
        };
        let bar = ProgressBar::with_draw_target(length, target);
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style.progress_chars("=> ").with_key("left", left));
        }
        bar.set_prefix(what);
        // A long step must not look like a hang.
        if !manner.hidden {
            bar.enable_steady_tick(Duration::from_millis(500));
        }
        Self { bar, what, timed: manner.timed, begun: Instant::now() }
    }
}

impl Drop for Shown {
    fn drop(&mut self) {
        use std::io::Write;
        self.bar.finish_and_clear();
        if self.timed {
            let seconds = self.begun.elapsed().as_secs_f64();
            let _ = writeln!(std::io::stderr().lock(), "{}: {seconds:.3} s", self.what);
        }
    }
}

/// Writes the time that the steps left take at the mean pace so far. (An estimate by the pace of the last seconds makes days of
/// steps that take a minute each.)
fn left(state: &ProgressState, out: &mut dyn fmt::Write) {
    let (done, rest) = (state.pos(), state.len().unwrap_or(0).saturating_sub(state.pos()));
    let seconds = state.elapsed().as_secs_f64() * rest as f64 / done as f64;
    // Before the first step nothing is known, and after the last one that was foreseen, others may follow; a decade is long
    // enough.
    let _ = match Duration::try_from_secs_f64(seconds.min(3e8)) {
        Ok(time) if done > 0 && rest > 0 => write!(out, "{:#}", HumanDuration(time)),
        _ => write!(out, "unknown time"),
    };
}
