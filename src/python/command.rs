//! The program's commands.

use crate::work::watched;
use cumulo::app::Context;
use cumulo::app::progress::{Event, Progress};
use cumulo::cancel::Cancel;
use cumulo::cli::{self, embedded};
use cumulo::formats::vdb::helper;
use pyo3::prelude::*;
use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Longest time in which a function that hears of progress is not called, so that it can stop the work soon.
const SILENCE: Duration = Duration::from_millis(200);

/// Progress that a Python function is told of: events as texts of JSON.
#[derive(Clone)]
struct Told {
    hear: Arc<Py<PyAny>>,
    cancel: Cancel,
    /// First exception that the function raised, after which it is not called again.
    raised: Arc<Mutex<Option<PyErr>>>,
    /// When it was told last.
    last: Arc<Mutex<Instant>>,
}

impl Told {
    fn new(hear: Py<PyAny>, cancel: Cancel) -> Self {
        Self { hear: Arc::new(hear), cancel, raised: Arc::default(), last: Arc::new(Mutex::new(Instant::now())) }
    }

    fn tell(&self, py: Python<'_>, text: &str) {
        *self.last.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
        if self.raised.lock().unwrap_or_else(PoisonError::into_inner).is_some() {
            return;
        }
        if let Err(error) = self.hear.call1(py, (text,)) {
            self.raised.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
            self.cancel.request();
        }
    }

    /// Tells that the work goes on, if nothing was told for a while.
    fn tell_of_silence(&self, py: Python<'_>) {
        let silence = self.last.lock().unwrap_or_else(PoisonError::into_inner).elapsed();
        if silence >= SILENCE {
            self.tell(py, r#"{"event":"waiting"}"#);
        }
    }
}

impl Progress for Told {
    fn event(&self, event: &Event<'_>) {
        if let Ok(text) = serde_json::to_string(event) {
            Python::attach(|py| self.tell(py, &text));
        }
    }
}

/// Runs a command of the program in this process, and returns its document (JSON) and its exit code.
///
/// `words` are those of a command line behind the program's name; `progress` receives events as JSON texts, from any
/// thread, one at least in a fifth of a second; an exception that it raises stops the work and is raised here.
#[pyfunction]
#[pyo3(signature = (words, progress=None, threads=0))]
pub(crate) fn run(
    py: Python<'_>,
    words: Vec<OsString>,
    progress: Option<Py<PyAny>>,
    threads: usize,
) -> PyResult<(String, u8)> {
    let cancel = Cancel::new();
    let told = progress.map(|hear| Told::new(hear, cancel.clone()));
    let origin = words.iter().map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" ");
    let context = told.clone().map_or_else(Context::default, Context::new);
    let context = context.stopped_by(cancel.clone(), cancel.clone()).of(&format!("cumulo (Python) {origin}"));
    let look = |py: Python<'_>| {
        if let Some(told) = &told {
            told.tell_of_silence(py);
        }
    };
    let answer = watched(py, threads, &cancel, look, || embedded::run(words, context));
    let raised = told.as_ref().and_then(|told| told.raised.lock().unwrap_or_else(PoisonError::into_inner).take());
    if let Some(error) = raised {
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
