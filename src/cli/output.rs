//! Results on standard output, progress on standard error.

use super::Global;
use crate::error::{Error, Result};
use crate::text::{printable_json, printable_lines};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;
use std::fmt::Display;
use std::io::Write;

/// Where a subcommand says what it found.
#[derive(Debug, Clone)]
pub struct Output {
    json: bool,
    quiet: bool,
}

impl Output {
    /// Output as the global options ask for it.
    pub fn new(global: &Global) -> Self {
        Self { json: global.json, quiet: global.quiet }
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

    /// A remark for people, on standard error.
    pub fn note(&self, text: impl Display) {
        if !self.quiet {
            let _ = writeln!(std::io::stderr().lock(), "{}", printable_lines(&text.to_string()));
        }
    }

    /// A bar of `length` steps with time to go. It draws on a terminal only.
    pub fn progress(&self, length: u64, what: &'static str) -> ProgressBar {
        let target = if self.quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let bar = ProgressBar::with_draw_target(Some(length), target);
        if let Ok(style) = ProgressStyle::with_template("{prefix} [{bar:30}] {pos}/{len} {elapsed} (ETA {eta}) {msg}") {
            bar.set_style(style.progress_chars("=> "));
        }
        bar.set_prefix(what);
        bar
    }
}
