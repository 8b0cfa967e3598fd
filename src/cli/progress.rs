//! Displays of work that goes on: a bar of steps, and a stage of unknown length.

use super::log::Log;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use std::fmt;
use std::io::IsTerminal;
use std::ops::Deref;
use std::sync::atomic::{AtomicU64, Ordering};
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
        Self(Shown::new(Some(length), &bar_of("{pos}/{len}", "{pos} of {len}"), what, manner))
    }

    /// Shows a bar of so many pictures, which counts the pixels of each: one picture may take hours.
    pub(super) fn of_pictures(count: u64, what: &'static str, manner: Manner) -> Self {
        Self(Shown::new(Some(count * PARTS), &bar_of("{pictures}", "{pictures}"), what, manner))
    }

    /// Begins a picture, of a bar of pictures.
    pub fn picture(&self) -> Picture<'_> {
        Picture { bar: &self.0.bar, done: AtomicU64::new(0), shown: AtomicU64::new(0) }
    }
}

/// Returns the template of a bar whose steps are shown so on a terminal and in a log.
fn bar_of(terminal: &str, log: &str) -> String {
    match std::io::stderr().is_terminal() {
        true => format!("{{prefix}} [{{bar:30}}] {terminal} {{spent}}{{eta}} {{msg}}"),
        false => format!("{{prefix}}: {log} after {{spent}}{{to_go}}; {{msg}}"),
    }
}

/// Parts of a picture that a bar of pictures counts.
const PARTS: u64 = 10_000;

/// Picture at work, of a bar of pictures.
#[derive(Debug)]
pub struct Picture<'p> {
    bar: &'p ProgressBar,
    /// Pixels that are done, and parts of the bar that show them.
    done: AtomicU64,
    shown: AtomicU64,
}

impl Picture<'_> {
    /// Counts pixels that are done, of all that the picture has.
    pub fn add(&self, pixels: u64, all: u64) {
        let done = self.done.fetch_add(pixels, Ordering::Relaxed) + pixels;
        self.show(PARTS * done.min(all) / all.max(1));
    }

    fn show(&self, parts: u64) {
        let before = self.shown.fetch_max(parts, Ordering::Relaxed);
        if parts > before {
            self.bar.inc(parts - before);
        }
    }
}

impl Drop for Picture<'_> {
    /// Counts the picture as done, whatever has become of it.
    fn drop(&mut self) {
        self.show(PARTS);
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
        let template = if terminal { "{prefix} {spinner} {spent} {msg}" } else { "{prefix}: {spent} so far {msg}" };
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
            let style = style.with_key("spent", spent).with_key("eta", eta).with_key("to_go", to_go);
            bar.set_style(style.with_key("pictures", pictures).progress_chars("=> "));
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

/// Writes the time since the work began.
fn spent(state: &ProgressState, out: &mut dyn fmt::Write) {
    let _ = write!(out, "{}", Span(state.elapsed()));
}

/// Writes the remaining time as a bar on a terminal shows it.
fn eta(state: &ProgressState, out: &mut dyn fmt::Write) {
    let _ = left(state).map_or(Ok(()), |time| write!(out, " (ETA {})", Span(time)));
}

/// Writes the remaining time as a log states it.
fn to_go(state: &ProgressState, out: &mut dyn fmt::Write) {
    let _ = left(state).map_or(Ok(()), |time| write!(out, ", {} to go", Span(time)));
}

/// Writes the pictures that are done, and the share of all pixels.
fn pictures(state: &ProgressState, out: &mut dyn fmt::Write) {
    let (done, all) = (state.pos(), state.len().unwrap_or(0));
    let _ = write!(out, "{} of {} ({} %)", done / PARTS, all / PARTS, 100 * done / all.max(1));
}

fn left(state: &ProgressState) -> Option<Duration> {
    remaining(state.pos(), state.len().unwrap_or(0), state.elapsed())
}

/// Returns the time that the steps left take at the mean pace so far. (An estimate by the pace of the last seconds makes
/// days of steps that take a minute each.) Before the first step nothing is known, and after the last one there is
/// nothing to say.
fn remaining(done: u64, all: u64, elapsed: Duration) -> Option<Duration> {
    let rest = all.checked_sub(done).filter(|rest| *rest > 0 && done > 0)?;
    // A decade is long enough.
    Duration::try_from_secs_f64((elapsed.as_secs_f64() * rest as f64 / done as f64).min(3e8)).ok()
}

/// Length of time in the units that matter, down to seconds.
struct Span(Duration);

impl fmt::Display for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let seconds = self.0.as_secs();
        let (days, hours, minutes) = (seconds / 86_400, seconds / 3600 % 24, seconds / 60 % 60);
        match (days, hours, minutes) {
            (0, 0, 0) => write!(f, "{seconds}s"),
            (0, 0, _) => write!(f, "{minutes}m {}s", seconds % 60),
            (0, ..) => write!(f, "{hours}h {minutes}m {}s", seconds % 60),
            _ => write!(f, "{days}d {hours}h {minutes}m"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_keep_their_seconds() {
        let text = |seconds| Span(Duration::from_secs(seconds)).to_string();
        assert_eq!([0, 59, 125, 7384].map(text), ["0s", "59s", "2m 5s", "2h 3m 4s"]);
        assert_eq!(text(2 * 86_400 + 3 * 3600 + 240), "2d 3h 4m");
    }

    #[test]
    fn the_remaining_time_is_that_of_the_pace_so_far() {
        let remaining = |done, all| remaining(done, all, Duration::from_secs(30));
        assert_eq!(remaining(3, 9), Some(Duration::from_secs(60)));
        assert_eq!([remaining(0, 9), remaining(9, 9), remaining(10, 9)], [None; 3]);
        assert_eq!(remaining(1, u64::MAX), Some(Duration::from_secs(300_000_000)));
    }

    /// A picture that takes hours is not "0 of 1" to its end.
    #[test]
    fn pixels_of_a_picture_count() {
        let hidden = Manner { hidden: true, timed: false };
        let bar = Progress::of_pictures(2, "render", hidden);
        {
            let picture = bar.picture();
            picture.add(75, 300);
            assert_eq!(bar.position(), PARTS / 4);
            picture.add(225, 300);
        }
        assert_eq!(bar.position(), PARTS);
        drop(bar.picture());
        assert_eq!(bar.position(), 2 * PARTS);
    }
}
