//! Signals that ask the program to stop: SIGINT (Ctrl-C), SIGTERM and SIGHUP.

use super::document;
use crate::error::{Error, Result};
use crate::process;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
use signal_hook::iterator::Signals;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};

static STOP: AtomicBool = AtomicBool::new(false);
static LISTENING: AtomicBool = AtomicBool::new(false);
/// Exit code of work that was stopped: 128 plus the number of the signal, that of Ctrl-C at first.
static CODE: AtomicU8 = AtomicU8::new(128 + SIGINT as u8);

/// Handles the signals from now on. A signal ends the program at once, leaving nothing temporary behind, with the exit
/// code that shells expect (128 plus its number) and, with `--json`, a document that says so; if a command [`listen`]s, the
/// first one requests it to stop instead.
///
/// # Errors
/// If the operating system refuses the handlers or their thread.
pub fn install() -> Result<()> {
    let failed = |e| Error::system(e).part("signals").hint("the system may be out of threads or memory; try again");
    let mut signals = Signals::new([SIGINT, SIGTERM, SIGHUP]).map_err(failed)?;
    // A file that grows beyond the limit for files (ulimit -f) is an error of the write then, not the program's end.
    signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false))).map_err(failed)?;
    let wait = move || {
        for signal in signals.forever() {
            let code = 128_u8.saturating_add(signal as u8);
            CODE.store(code, Ordering::SeqCst);
            if !LISTENING.load(Ordering::SeqCst) || STOP.swap(true, Ordering::SeqCst) {
                document::error(&Error::cancelled());
                process::leave(code);
            }
        }
    };
    std::thread::Builder::new().name("signals".into()).spawn(wait).map_err(failed)?;
    Ok(())
}

/// Returns the flag that the first signal sets from now on; the second one ends the program.
pub fn listen() -> &'static AtomicBool {
    LISTENING.store(true, Ordering::SeqCst);
    &STOP
}

/// Returns the exit code of work that a signal stopped: 130 for Ctrl-C, 143 for SIGTERM.
pub fn code() -> u8 {
    CODE.load(Ordering::SeqCst)
}
