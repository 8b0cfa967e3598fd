//! Trial reads of grids that no walk of the file can check (points), in a process that may die of them: OpenVDB answers
//! damaged attributes with assertions and with exceptions in destructors, which nothing can catch.
//!
//! The process is a program that the caller names, started anew: a fork of a process with threads may only call what is
//! safe in a signal handler, and OpenVDB is not.

use super::ffi;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use std::ffi::OsString;
use std::io::{Read, Write};
use std::os::unix::process::ExitStatusExt;
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// Subcommand that the helper program understands: `try-grid BYTES`, with the most bytes of memory. It reads a file
/// from standard input and calls [`try_grid`](super::try_grid). On failure it describes the error on standard error and
/// exits with a code other than 0.
pub const SUBCOMMAND: &str = "try-grid";

/// Longest time that a trial in the helper process may take.
const PATIENCE: Duration = Duration::from_secs(120);

/// Largest number of bytes of the helper's message that are read.
const MOST_WORDS: u64 = 4096;

/// The helper program, and the words that come before [`SUBCOMMAND`].
static PROGRAM: OnceLock<(PathBuf, Vec<OsString>)> = OnceLock::new();

/// Names the helper program that tries grids of points, which is `cumulo` itself, wherever it is installed. Only the
/// first call counts. Without it such grids are refused.
pub fn set_program(path: PathBuf) {
    set_command(path, Vec::new());
}

/// Names the helper program as [`set_program`] does, with words that make it one, such as `-m cumulo` of Python.
pub fn set_command(path: PathBuf, words: Vec<OsString>) {
    let _ = PROGRAM.set((path, words));
}

/// Tries the last grid of a file, whose bytes these are, in the helper process.
///
/// # Errors
/// If no helper is named, it cannot be started, or it does not end with success; the error holds its message, or the
/// signal that ended it.
pub(super) fn rehearse(file: &[u8], limits: Limits) -> Result<()> {
    let Some((program, words)) = PROGRAM.get() else {
        return Err(Error::unsupported("grids of points are read by a helper process first, and none was named")
            .hint("call formats::vdb::helper::set_program with the path of the program cumulo"));
    };
    let started = Command::new(program)
        .args(words)
        .arg(SUBCOMMAND)
        .arg(limits.max_memory.to_string())
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn();
    let mut child = started.map_err(|e| Error::io(program, e).hint("the helper process could not be started"))?;
    let words = child.stderr.take();
    // The message is short. Whatever exceeds the limit is a damaged file's flood and is not waited for.
    let words = std::thread::spawn(move || {
        let mut text = Vec::new();
        if let Some(pipe) = words {
            let _ = pipe.take(MOST_WORDS).read_to_end(&mut text);
        }
        ffi::printable(&text)
    });
    if let Some(mut pipe) = child.stdin.take() {
        // A process that ended before it read all says why below.
        let _ = pipe.write_all(file);
    }
    let status = wait(&mut child)?;
    let damaged = |what: String| Err(Error::invalid(what).hint("the file may be damaged; export it again"));
    match status {
        None => damaged(format!("reading the grid's buffers took more than {} s and was stopped", PATIENCE.as_secs())),
        Some(status) if status.success() => Ok(()),
        Some(status) => match status.signal() {
            Some(signal) => {
                damaged(format!("reading the grid's buffers ends the library with signal {signal}; they are damaged"))
            }
            None => match words.join().unwrap_or_default().trim() {
                "" => damaged("the grid's buffers cannot be read".into()),
                words => damaged(words.into()),
            },
        },
    }
}

/// Waits for the process to end; `None` if it took too long and was killed.
fn wait(child: &mut Child) -> Result<Option<ExitStatus>> {
    let system = |e| Error::system(e).hint("the helper process was lost; try again");
    let (begun, mut pause) = (Instant::now(), Duration::from_micros(200));
    loop {
        if let Some(status) = child.try_wait().map_err(system)? {
            return Ok(Some(status));
        }
        if begun.elapsed() > PATIENCE {
            child.kill().map_err(system)?;
            child.wait().map_err(system)?;
            return Ok(None);
        }
        std::thread::sleep(pause);
        pause = (2 * pause).min(Duration::from_millis(20));
    }
}
