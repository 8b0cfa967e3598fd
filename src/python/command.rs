//! The program's commands.

use crate::work::done;
use cumulo::app::Context;
use cumulo::app::progress::{Event, Progress};
use cumulo::cancel::Cancel;
use cumulo::cli::{self, embedded};
use cumulo::formats::vdb::helper;
use pyo3::prelude::*;
use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

/// Progress that a Python function is told of: events as texts of JSON.
struct Told {
    hear: Py<PyAny>,
    cancel: Cancel,
    /// First exception that the function raised, after which it is not called again.
    raised: Arc<Mutex<Option<PyErr>>>,
}

impl Progress for Told {
    fn event(&self, event: &Event<'_>) {
        let Ok(text) = serde_json::to_string(event) else { return };
        if self.raised.lock().unwrap_or_else(PoisonError::into_inner).is_some() {
            return;
        }
        if let Err(error) = Python::attach(|py| self.hear.call1(py, (text,)).map(drop)) {
            self.raised.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
            self.cancel.request();
        }
    }
}

/// Runs a command of the program in this process, and returns its document (JSON) and its exit code.
///
/// `words` are those of a command line behind the program's name; `progress` receives events as JSON texts, from any
/// thread; an exception that it raises stops the work and is raised here.
#[pyfunction]
#[pyo3(signature = (words, progress=None, threads=0))]
pub(crate) fn run(
    py: Python<'_>,
    words: Vec<OsString>,
    progress: Option<Py<PyAny>>,
    threads: usize,
) -> PyResult<(String, u8)> {
    let (cancel, raised) = (Cancel::new(), Arc::new(Mutex::new(None)));
    let origin = words.iter().map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" ");
    let context = match progress {
        Some(hear) => Context::new(Told { hear, cancel: cancel.clone(), raised: Arc::clone(&raised) }),
        None => Context::default(),
    };
    let context = context.stopped_by(cancel.clone(), cancel.clone()).of(&format!("cumulo (Python) {origin}"));
    let answer = done(py, threads, &cancel, || embedded::run(words, context));
    if let Some(error) = raised.lock().unwrap_or_else(PoisonError::into_inner).take() {
        return Err(error);
    }
    answer.map(|answer| (answer.document, answer.code))
}

/// Runs the program on a command line, the program's name first, and returns its exit code. It takes over signals,
/// threads and standard streams of the process, which is to end then.
#[pyfunction]
pub(crate) fn main(py: Python<'_>, words: Vec<OsString>) -> u8 {
    py.detach(|| cli::main(words, option_env!("CUMULO_COMMIT")))
}

/// Names the interpreter that grids of points are tried in, before they are read in this process.
#[pyfunction]
pub(crate) fn set_helper(program: PathBuf, words: Vec<OsString>) {
    helper::set_command(program, words);
}
