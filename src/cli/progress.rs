//! Progress on standard error: bars and remarks for people, or events as lines of JSON.

use super::log::{self, Log};
use super::openjd::{self, Share};
use crate::app::progress::{Event, Progress, Unit};
use crate::error::Error;
use crate::text::{printable_json, printable_lines};
use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use serde_json::json;
use std::collections::HashMap;
use std::fmt::{self, Display};
use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// Form of the progress on standard error.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum Form {
    /// Bars on a terminal, and in a log a line every ten seconds
    #[default]
    Text,
    /// Events as lines of JSON
    Json,
    /// Progress in per cent, states and failures as Open Job Description's sessions read them
    Openjd,
}

/// Number of the form in which events are told.
static FORM: AtomicU8 = AtomicU8::new(Form::Text as u8);

/// Says which error ended the command: as a line of JSON where the other events are.
pub(super) fn tell(error: &Error) {
    let form = FORM.load(Ordering::Relaxed);
    if form == Form::Json as u8 {
        let mut line = json!(error.facts());
        line["event"] = "error".into();
        let _ = writeln!(std::io::stderr(), "{}", printable_json(&line.to_string()));
        return;
    }
    let _ = writeln!(std::io::stderr(), "cumulo: {error}");
    if form == Form::Openjd as u8 {
        openjd::failed(&error.to_string());
    }
}

/// Standard error as the receiver of a use case's progress.
#[derive(Debug)]
pub(crate) struct Terminal {
    form: Form,
    quiet: bool,
    verbose: bool,
    bars: Mutex<HashMap<u64, Bar>>,
    /// Share of the work that was told to a session of Open Job Description.
    share: Share,
}

/// Bar of a stage, with the parts that it counts of each of its steps.
#[derive(Debug)]
struct Bar {
    bar: ProgressBar,
    parts: u64,
}

impl Terminal {
    /// Creates progress of a form; if `quiet`, of frames that fail alone, and if `verbose` with details and the time
    /// that each stage took.
    pub(crate) fn new(form: Form, quiet: bool, verbose: bool) -> Self {
        log::begin();
        FORM.store(form as u8, Ordering::Relaxed);
        Self { form, quiet, verbose, bars: Mutex::default(), share: Share::default() }
    }

    fn show(&self, event: &Event<'_>) {
        let mut bars = self.bars.lock().unwrap_or_else(PoisonError::into_inner);
        match *event {
            Event::Began { stage, name, total, unit } if !self.quiet => {
                bars.insert(stage, Bar::new(name, total, unit));
            }
            Event::Advanced { stage, done, total, message } => {
                if let Some(bar) = bars.get(&stage) {
                    bar.advance(done, total, message);
                }
            }
            Event::Ended { stage, name, seconds } => {
                if let Some(Bar { bar, .. }) = bars.remove(&stage) {
                    bar.finish_and_clear();
                }
                if self.verbose {
                    let _ = writeln!(std::io::stderr().lock(), "{name}: {seconds:.3} s");
                }
            }
            Event::Remark { text } => self.say(text),
            Event::Detail { text } if self.verbose => self.say(text),
            Event::Warned { warning } => self.say(format_args!("warning: {}\n  {}", warning.what, warning.remedy)),
            // Said as errors that end a command, whatever `--quiet` silences.
            Event::Failed { frame, error, .. } => {
                let _ = writeln!(std::io::stderr().lock(), "cumulo: frame {frame}: {error}");
            }
            Event::Unread { error, .. } => {
                let _ = writeln!(std::io::stderr().lock(), "cumulo: {error}");
            }
            Event::Began { .. } | Event::Detail { .. } | Event::Stoppable | Event::Loading | Event::Working => {}
        }
    }

    fn say(&self, text: impl Display) {
        if !self.quiet {
            let _ = writeln!(std::io::stderr().lock(), "{}", printable_lines(&text.to_string()));
            log::sign();
        }
    }
}

impl Progress for Terminal {
    fn event(&self, event: &Event<'_>) {
        super::cancel::take(event);
        match self.form {
            Form::Text => self.show(event),
            Form::Openjd if self.share.tell(event) => {}
            Form::Openjd => self.show(event),
            Form::Json => {
                if let Ok(json) = serde_json::to_string(event) {
                    let _ = writeln!(std::io::stderr().lock(), "{}", printable_json(&json));
                }
            }
        }
    }
}

impl Bar {
    /// Parts of a picture that a bar of pictures counts.
    const PARTS: u64 = 10_000;

    /// Shows a bar with the remaining time, or of a stage of unknown length a spinner; where standard error is no
    /// terminal, a plain line at most every ten seconds.
    fn new(name: &str, total: Option<u64>, unit: Unit) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let (parts, done) = match unit {
            Unit::Pictures => (Self::PARTS, ["{pictures}"; 2]),
            Unit::Steps => (1, ["{pos}/{len}", "{pos} of {len}"]),
        };
        let template = match (total, terminal) {
            (Some(_), true) => format!("{{prefix}} [{{bar:30}}] {} {{spent}}{{eta}} {{msg}}", done[0]),
            (Some(_), false) => format!("{{prefix}}: {} after {{spent}}{{to_go}}; {{msg}}", done[1]),
            (None, true) => "{prefix} {spinner} {spent} {msg}".to_owned(),
            (None, false) => "{prefix}: {spent} so far {msg}".to_owned(),
        };
        let target = match terminal {
            true => ProgressDrawTarget::stderr(),
            false => ProgressDrawTarget::term_like(Box::new(Log::default())),
        };
        let bar = ProgressBar::with_draw_target(total.map(|total| total * parts), target);
        if let Ok(style) = ProgressStyle::with_template(&template) {
            let style = style.with_key("spent", spent).with_key("eta", eta).with_key("to_go", to_go);
            bar.set_style(style.with_key("pictures", pictures).progress_chars("=> "));
        }
        bar.set_prefix(name.to_owned());
        // A long step must not look like a hang.
        bar.enable_steady_tick(Duration::from_millis(500));
        Self { bar, parts }
    }

    fn advance(&self, done: f64, total: Option<u64>, message: &str) {
        let Self { bar, parts } = self;
        if let Some(total) = total.filter(|total| bar.length() != Some(total * parts)) {
            bar.set_length(total * parts);
        }
        // A spinner has no place, and its message states how far it is.
        if bar.length().is_some() {
            bar.set_position((done * *parts as f64).round() as u64);
        }
        if bar.message() != message {
            bar.set_message(message.to_owned());
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
    let _ = write!(out, "{} of {} ({} %)", done / Bar::PARTS, all / Bar::PARTS, 100 * done / all.max(1));
}

fn left(state: &ProgressState) -> Option<Duration> {
    remaining(state.pos(), state.len().unwrap_or(0), state.elapsed())
}

/// Returns the time that the steps left take at the mean pace so far. (An estimate by the pace of the last seconds
/// makes days of steps that take a minute each.) Before the first step nothing is known, and after the last one there
/// is nothing to say.
fn remaining(done: u64, all: u64, elapsed: Duration) -> Option<Duration> {
    let rest = all.checked_sub(done).filter(|rest| *rest > 0 && done > 0)?;
    // A decade is long enough.
    Duration::try_from_secs_f64((elapsed.as_secs_f64() * rest as f64 / done as f64).min(3e8)).ok()
}

/// Length of time in the units that matter, down to seconds.
struct Span(Duration);

impl Display for Span {
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
}
