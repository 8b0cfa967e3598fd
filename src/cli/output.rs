//! Results on standard output, progress on standard error.

use super::Global;
use crate::error::{Error, Result};
use crate::optimise::plausibility::Warning;
use crate::text::{printable_json, printable_lines};
use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle, TermLike};
use serde::Serialize;
use std::fmt::Display;
use std::io::{IsTerminal, Write};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Standard output for a subcommand's report, standard error for its progress and remarks.
#[derive(Debug, Clone)]
pub struct Output {
    json: bool,
    quiet: bool,
}

impl Output {
    /// Creates the output that the global options request.
    pub fn new(global: &Global) -> Self {
        last_sign().get_or_insert_with(Instant::now);
        Self { json: global.json, quiet: global.quiet }
    }

    /// True if reports are printed as JSON.
    pub fn is_json(&self) -> bool {
        self.json
    }

    /// Prints a report: its `Display` form for people, or JSON.
    ///
    /// # Errors
    /// If standard output cannot be written. A closed pipe is no error: the reader has seen enough.
    pub fn report<T: Serialize + Display>(&self, report: &T) -> Result<()> {
        let text = if self.json {
            let json = serde_json::to_string_pretty(report).map_err(|e| Error::invalid(e.to_string()))?;
            printable_json(&json).into_owned()
        } else {
            printable_lines(&report.to_string()).into_owned()
        };
        let mut out = std::io::stdout().lock();
        match writeln!(out, "{}", text.trim_end()).and_then(|()| out.flush()) {
            Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => Err(Error::io("standard output", e)),
            _ => Ok(()),
        }
    }

    /// Prints a remark on standard error, unless `--quiet` is given.
    pub fn note(&self, text: impl Display) {
        if !self.quiet {
            let _ = writeln!(std::io::stderr().lock(), "{}", printable_lines(&text.to_string()));
            *last_sign() = Some(Instant::now());
        }
    }

    /// Prints warnings on standard error, unless `--quiet` is given; the report holds them, too.
    pub fn warn(&self, warnings: &[Warning]) {
        for Warning { what, remedy } in warnings {
            self.note(format!("warning: {what}\n  {remedy}"));
        }
    }

    /// Shows a progress bar of `length` steps with the remaining time; where standard error is no terminal, a plain line
    /// at most every ten seconds.
    pub fn progress(&self, length: u64, what: &'static str) -> ProgressBar {
        let terminal = std::io::stderr().is_terminal();
        let template = if terminal {
            "{prefix} [{bar:30}] {pos}/{len} {elapsed} (ETA {left}) {msg}"
        } else {
            "{prefix}: {pos} of {len} after {elapsed}, {left} to go; {msg}"
        };
        self.bar(ProgressBar::with_draw_target(Some(length), self.target(terminal)), template, what)
    }

    /// Shows that a stage of unknown length goes on, until the returned value is dropped.
    pub fn stage(&self, what: &'static str) -> Stage {
        let terminal = std::io::stderr().is_terminal();
        let template = if terminal { "{prefix} {spinner} {elapsed} {msg}" } else { "{prefix}: {elapsed} so far {msg}" };
        Stage(self.bar(ProgressBar::with_draw_target(None, self.target(terminal)), template, what))
    }

    fn target(&self, terminal: bool) -> ProgressDrawTarget {
        match (self.quiet, terminal) {
            (true, _) => ProgressDrawTarget::hidden(),
            (false, true) => ProgressDrawTarget::stderr(),
            (false, false) => ProgressDrawTarget::term_like(Box::new(Log::default())),
        }
    }

    fn bar(&self, bar: ProgressBar, template: &str, what: &'static str) -> ProgressBar {
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style.progress_chars("=> ").with_key("left", left));
        }
        bar.set_prefix(what);
        // A long step must not look like a hang.
        if !self.quiet {
            bar.enable_steady_tick(Duration::from_millis(500));
        }
        bar
    }
}

/// Writes the time that the steps left take at the mean pace so far. (An estimate by the pace of the last seconds makes days of
/// steps that take a minute each.)
fn left(state: &ProgressState, out: &mut dyn std::fmt::Write) {
    let (done, rest) = (state.pos(), state.len().unwrap_or(0).saturating_sub(state.pos()));
    let seconds = state.elapsed().as_secs_f64() * rest as f64 / done as f64;
    // Before the first step nothing is known; a decade is long enough.
    let _ = match Duration::try_from_secs_f64(seconds.min(3e8)) {
        Ok(time) if done > 0 => write!(out, "{:#}", HumanDuration(time)),
        _ => write!(out, "unknown time"),
    };
}

/// Progress display of a stage of unknown length.
#[derive(Debug)]
pub struct Stage(ProgressBar);

impl Stage {
    /// Shows that `done` of `of` parts of the stage are done.
    pub fn at(&self, done: usize, of: usize) {
        self.0.set_message(format!("({done} of {of})"));
    }
}

impl Drop for Stage {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

/// Longest silence of a log; with the display's ticks of half a second it stays below ten seconds.
const SILENCE: Duration = Duration::from_secs(9);

/// Time of the last line on standard error, shared by all stages: a log's silence may span several of them.
static LAST_SIGN: Mutex<Option<Instant>> = Mutex::new(None);

fn last_sign() -> MutexGuard<'static, Option<Instant>> {
    LAST_SIGN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A log in the place of a terminal: it writes the current line every ten seconds and draws over nothing.
#[derive(Debug, Default)]
struct Log(Mutex<String>);

impl Log {
    fn line(&self) -> MutexGuard<'_, String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl TermLike for Log {
    fn width(&self) -> u16 {
        // Lines of a log are not cut.
        1000
    }

    fn move_cursor_up(&self, _: usize) -> std::io::Result<()> {
        Ok(())
    }

    fn move_cursor_down(&self, _: usize) -> std::io::Result<()> {
        Ok(())
    }

    fn move_cursor_right(&self, _: usize) -> std::io::Result<()> {
        Ok(())
    }

    fn move_cursor_left(&self, _: usize) -> std::io::Result<()> {
        Ok(())
    }

    fn write_line(&self, text: &str) -> std::io::Result<()> {
        self.write_str(text)
    }

    fn write_str(&self, text: &str) -> std::io::Result<()> {
        self.line().push_str(text);
        Ok(())
    }

    fn clear_line(&self) -> std::io::Result<()> {
        self.line().clear();
        Ok(())
    }

    fn flush(&self) -> std::io::Result<()> {
        let (mut line, mut last) = (self.line(), last_sign());
        let text = line.trim().trim_end_matches(';');
        if last.get_or_insert_with(Instant::now).elapsed() >= SILENCE && !text.is_empty() {
            let _ = writeln!(std::io::stderr().lock(), "{text}");
            *last = Some(Instant::now());
        }
        line.clear();
        Ok(())
    }
}
