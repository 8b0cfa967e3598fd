//! Commands for a caller in this process: their words are read as those of a command line, and their document is
//! returned. Nothing of the process is changed: no signals, no limit of its memory, no global threads.

use super::Arguments;
use super::output::Output;
use crate::app::Context;
use crate::error::{Code, Error, Result};
use clap::error::ErrorKind;
use std::ffi::OsString;
use std::sync::{Arc, Mutex, PoisonError};

/// The answer of a command.
#[derive(Debug, Clone)]
pub struct Answer {
    /// The document that the command prints with `--json`.
    pub document: String,
    /// The exit code of the command: 0 success, 1 a check found something, 2 parts of the work failed, 128 and more if
    /// it was stopped and wrote what it had.
    pub code: u8,
}

/// Runs the command that these words name, without the program's name, in a context. Options that concern the process,
/// such as `--threads` and `--quiet`, have no effect.
///
/// # Errors
/// If the words cannot be read (code `usage`), and those of the command.
pub fn run(words: impl IntoIterator<Item = OsString>, context: Context) -> Result<Answer> {
    let words = std::iter::once(OsString::from("cumulo")).chain(words);
    let arguments = match Arguments::read(words) {
        Ok(arguments) => arguments,
        Err(shown) if matches!(shown.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion) => {
            return Ok(Answer { document: shown.render().to_string(), code: 0 });
        }
        Err(usage) => {
            let text = usage.render().to_string();
            let error = Error::invalid(super::mistake(&text)).coded(Code::Usage);
            // The library of the command line knows arguments of similar names.
            let tip =
                text.lines().find_map(|line| line.trim().strip_prefix("tip: ")).filter(|tip| !tip.contains("'-- "));
            return Err(tip.into_iter().fold(error, |error, tip| error.hint(tip)));
        }
    };
    let kept = Arc::new(Mutex::new(String::new()));
    let output = Output::into_text(&arguments.path, context, Arc::clone(&kept));
    let code = arguments.command.run(&output)?;
    let document = std::mem::take(&mut *kept.lock().unwrap_or_else(PoisonError::into_inner));
    Ok(Answer { document, code })
}
