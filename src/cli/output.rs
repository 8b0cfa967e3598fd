//! Results on standard output; progress and remarks go through the context to standard error.

use super::Global;
use super::cancel;
use super::document::{self, Document, VERSION};
use super::progress::Terminal;
use crate::app::Context;
use crate::error::{Error, Result};
use crate::text::{printable_json, printable_lines, shell_quoted};
use serde::Serialize;
use std::fmt::Display;
use std::io::Write;
use std::ops::Deref;
use std::sync::{Arc, Mutex, PoisonError};

/// Standard output for a subcommand's report, and the context that its work runs in.
#[derive(Debug, Clone)]
pub(crate) struct Output {
    json: bool,
    /// Words of the subcommand.
    command: Arc<str>,
    context: Context,
    /// Receives what would be printed, for a caller in this process.
    text: Option<Arc<Mutex<String>>>,
}

impl Deref for Output {
    type Target = Context;

    fn deref(&self) -> &Context {
        &self.context
    }
}

impl Output {
    /// Creates the output of a command, such as `reconstruct density`, that the global options request.
    pub(crate) fn new(global: &Global, command: &str) -> Self {
        let words = std::env::args_os().map(|word| shell_quoted(&word.to_string_lossy()).into_owned());
        let terminal = Terminal::new(global.progress, global.quiet, global.verbose);
        let context = Context::new(terminal).stopped_by(cancel::requested(), cancel::overdue());
        let context = context.of(&words.collect::<Vec<_>>().join(" "));
        Self { json: global.json, command: command.into(), context, text: None }
    }

    /// Creates the output of a command whose document is appended to `text`, and whose work runs in a context.
    pub(super) fn into_text(command: &str, context: Context, text: Arc<Mutex<String>>) -> Self {
        Self { json: true, command: command.into(), context, text: Some(text) }
    }

    /// Words of the subcommand, such as `reconstruct density`.
    pub(crate) fn command(&self) -> &str {
        &self.command
    }

    /// True if reports are printed as JSON.
    pub(crate) fn is_json(&self) -> bool {
        self.json
    }

    /// Prints a report: its `Display` form for people, or JSON.
    ///
    /// # Errors
    /// If standard output cannot be written. A closed pipe is no error: the reader has seen enough.
    pub(crate) fn report<T: Serialize + Display>(&self, report: &T) -> Result<()> {
        let failed = |e: serde_json::Error| Error::invalid(e.to_string());
        if !self.json {
            return print(&printable_lines(&report.to_string()));
        }
        let document = Document { version: VERSION, command: &self.command, report };
        if self.text.is_none() {
            document::reported();
        }
        self.plain(&printable_json(&serde_json::to_string_pretty(&document).map_err(failed)?))
    }

    /// Prints what has a form of its own, with and without `--json`: a script of a shell, a schema.
    ///
    /// # Errors
    /// If standard output cannot be written.
    pub(crate) fn plain(&self, text: &str) -> Result<()> {
        match &self.text {
            Some(kept) => kept.lock().unwrap_or_else(PoisonError::into_inner).push_str(text),
            None => print(text)?,
        }
        Ok(())
    }
}

fn print(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    match writeln!(out, "{}", text.trim_end()).and_then(|()| out.flush()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => Err(Error::io("standard output", e)),
        _ => Ok(()),
    }
}
