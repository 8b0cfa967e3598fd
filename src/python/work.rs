//! Work without Python's lock, on threads of its own, which Ctrl-C stops.

use crate::errors::exception;
use cumulo::cancel::Cancel;
use cumulo::error::{Error, Result};
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Time between two looks whether Python was interrupted.
const LOOK: Duration = Duration::from_millis(50);

/// Process and number of threads of a pool, and the pool: it does not work in forks of its process.
type PoolOfProcess = ((u32, usize), Arc<ThreadPool>);

/// Pools, those used last at the end.
static POOLS: Mutex<Vec<PoolOfProcess>> = Mutex::new(Vec::new());

/// Most pools that are kept: those of other numbers of threads end.
const MOST_POOLS: usize = 3;

/// Returns the pool of so many threads; 0 stands for `RAYON_NUM_THREADS`, else for all cores.
fn pool(threads: usize) -> Result<Arc<ThreadPool>> {
    let mut pools = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
    let key = (std::process::id(), threads);
    if let Some(at) = pools.iter().position(|(of, _)| *of == key) {
        let found = pools.remove(at);
        let pool = Arc::clone(&found.1);
        pools.push(found);
        return Ok(pool);
    }
    // The threads of a pool of another process are not here: it must not be ended, which would wait for them.
    let (mut own, others): (Vec<_>, Vec<_>) = pools.drain(..).partition(|((process, _), _)| *process == key.0);
    others.into_iter().for_each(std::mem::forget);
    own.drain(..own.len().saturating_sub(MOST_POOLS - 1));
    pools.extend(own);
    let built = ThreadPoolBuilder::new().num_threads(threads).thread_name(|i| format!("cumulo-{i}")).build();
    let pool = Arc::new(built.map_err(|e| {
        Error::invalid(format!("the threads cannot be started: {e}"))
            .hint("give fewer ⟨threads⟩, or raise the limit on processes (ulimit -u)")
    })?);
    pools.push((key, Arc::clone(&pool)));
    Ok(pool)
}

/// Does work on so many threads (0: the default) without Python's lock. An interrupt of Python (Ctrl-C) requests the
/// work to stop, and is raised once it has.
pub(crate) fn done<T: Send>(
    py: Python<'_>,
    threads: usize,
    cancel: &Cancel,
    work: impl FnOnce() -> Result<T> + Send,
) -> PyResult<T> {
    watched(py, threads, cancel, |_| (), work)
}

/// Does work as [`done`] does, and calls a function twenty times a second meanwhile.
pub(crate) fn watched<T: Send>(
    py: Python<'_>,
    threads: usize,
    cancel: &Cancel,
    look: impl Fn(Python<'_>) + Sync,
    work: impl FnOnce() -> Result<T> + Send,
) -> PyResult<T> {
    let pool = pool(threads).map_err(|e| exception(py, &e))?;
    let (result, interrupt) = py.detach(|| {
        std::thread::scope(|scope| {
            let (say, hear) = channel();
            scope.spawn(move || {
                // What is not caught here would end the process behind a thread that waits.
                let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| pool.install(work)));
                let _ = say.send(result);
            });
            let mut interrupt = None;
            loop {
                match hear.recv_timeout(LOOK) {
                    Ok(result) => return (Some(result), interrupt),
                    Err(RecvTimeoutError::Disconnected) => return (None, interrupt),
                    Err(RecvTimeoutError::Timeout) if interrupt.is_none() => {
                        interrupt = Python::attach(|py| {
                            look(py);
                            py.check_signals()
                        })
                        .err();
                        if interrupt.is_some() {
                            cancel.request();
                        }
                    }
                    Err(RecvTimeoutError::Timeout) => {}
                }
            }
        })
    });
    if let Some(interrupt) = interrupt {
        return Err(interrupt);
    }
    match result {
        Some(Ok(result)) => result.map_err(|e| exception(py, &e)),
        Some(Err(panic)) => std::panic::resume_unwind(panic),
        None => Err(exception(py, &Error::invalid("the work ended without a result"))),
    }
}
