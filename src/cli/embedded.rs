//! Commands for a caller in this process: their words are read as those of a command line, and their document is
//! returned. Nothing of the process is changed: no signals, no limit of its memory, no global threads.

use super::Arguments;
use super::output::Output;
use crate::app::Context;
use crate::error::{Code, Error, Result};
use clap::error::ErrorKind;
use std::ffi::OsString;
use std::sync::{Arc, Mutex, PoisonError};

/// What a command answered.
#[derive(Debug, Clone)]
pub struct Answer {
    /// What it would have printed with `--json`.
    pub document: String,
    /// Its exit code: 0 success, 1 a check found something, 2 parts of the work failed, 128 and more if it was stopped
    /// and wrote what it had.
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
            let mistake = super::mistake(&usage.render().to_string());
            return Err(Error::invalid(mistake).coded(Code::Usage));
        }
    };
    let kept = Arc::new(Mutex::new(String::new()));
    let output = Output::kept(&arguments.path, context, Arc::clone(&kept));
    let code = arguments.command.as_run().run(&output)?;
    let document = std::mem::take(&mut *kept.lock().unwrap_or_else(PoisonError::into_inner));
    Ok(Answer { document, code })
}
