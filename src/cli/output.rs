//! Results on standard output, progress and remarks on standard error.

use super::Global;
use super::document::{self, Document, VERSION};
use super::log;
use super::progress::{Manner, Progress, Stage};
use crate::error::{Error, Result};
use crate::optimise::plausibility::Warning;
use crate::text::{printable_json, printable_lines};
use serde::Serialize;
use serde_json::value::RawValue;
use std::collections::HashSet;
use std::fmt::Display;
use std::io::Write;
use std::sync::{Arc, Mutex, PoisonError};

/// Standard output for a subcommand's report, standard error for its progress and remarks.
#[derive(Debug, Clone)]
pub struct Output {
    json: bool,
    quiet: bool,
    verbose: bool,
    /// Words of the subcommand.
    command: Arc<str>,
    /// Remarks that were made: each is made once, however many frames give rise to it.
    said: Arc<Mutex<HashSet<String>>>,
    /// Report that is kept in the place of being printed.
    kept: Option<Arc<Mutex<Option<Kept>>>>,
}

/// A report that was kept in the place of being printed.
#[derive(Debug, Clone, Serialize)]
#[serde(transparent)]
pub struct Kept {
    json: Box<RawValue>,
    /// The report for people.
    #[serde(skip)]
    pub text: String,
}

impl Output {
    /// Creates the output of a command, such as `reconstruct density`, that the global options request.
    pub fn new(global: &Global, command: &str) -> Self {
        log::begin();
        Self {
            json: global.json,
            quiet: global.quiet,
            verbose: global.verbose,
            command: command.into(),
            said: Arc::default(),
            kept: None,
        }
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
        let failed = |e: serde_json::Error| Error::invalid(e.to_string());
        if let Some(kept) = &self.kept {
            let json = serde_json::value::to_raw_value(report).map_err(failed)?;
            let text = printable_lines(&report.to_string()).trim_end().to_owned();
            *kept.lock().unwrap_or_else(PoisonError::into_inner) = Some(Kept { json, text });
            return Ok(());
        }
        if !self.json {
            return print(&printable_lines(&report.to_string()));
        }
        let document = Document { version: VERSION, command: &self.command, report };
        document::reported();
        print(&printable_json(&serde_json::to_string_pretty(&document).map_err(failed)?))
    }

    /// Prints what has a form of its own, with and without `--json`: a script of a shell, a schema.
    ///
    /// # Errors
    /// If standard output cannot be written.
    pub fn plain(&self, text: &str) -> Result<()> {
        print(text)
    }

    /// Runs a part of the work whose report is returned in the place of being printed, and which shows no progress of its
    /// own. Remarks are still made.
    ///
    /// # Errors
    /// Errors of the work are passed on.
    pub fn keep<T>(&self, work: impl FnOnce(&Self) -> Result<T>) -> Result<(T, Option<Kept>)> {
        let kept = Arc::default();
        let result = work(&Self { kept: Some(Arc::clone(&kept)), ..self.clone() })?;
        let kept = kept.lock().unwrap_or_else(PoisonError::into_inner).take();
        Ok((result, kept))
    }

    /// Prints a remark on standard error, unless `--quiet` is given or it was made before.
    pub fn note(&self, text: impl Display) {
        if self.quiet {
            return;
        }
        let text = text.to_string();
        if self.said.lock().unwrap_or_else(PoisonError::into_inner).insert(text.clone()) {
            let _ = writeln!(std::io::stderr().lock(), "{}", printable_lines(&text));
            log::sign();
        }
    }

    /// Prints a remark on standard error with `--verbose`, once.
    pub fn detail(&self, text: impl Display) {
        if self.verbose && self.kept.is_none() {
            self.note(text);
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
    pub fn progress(&self, length: u64, what: &'static str) -> Progress {
        Progress::new(length, what, self.manner())
    }

    /// Shows a progress bar of so many pictures, which counts the pixels of each.
    pub fn pictures(&self, count: u64, what: &'static str) -> Progress {
        Progress::of_pictures(count, what, self.manner())
    }

    /// Shows that a stage of unknown length goes on, until the returned value is dropped.
    pub fn stage(&self, what: &'static str) -> Stage {
        Stage::new(what, self.manner())
    }

    fn manner(&self) -> Manner {
        let part = self.kept.is_some();
        Manner { hidden: self.quiet || part, timed: self.verbose && !part }
    }
}

fn print(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    match writeln!(out, "{}", text.trim_end()).and_then(|()| out.flush()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => Err(Error::io("standard output", e)),
        _ => Ok(()),
    }
}
