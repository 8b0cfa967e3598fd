//! Signals that ask the program to stop: SIGINT (Ctrl-C), SIGTERM and SIGHUP.

use crate::error::{Error, Result};
use crate::process;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
use signal_hook::iterator::Signals;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

static ASKED: AtomicBool = AtomicBool::new(false);
static LISTENING: AtomicBool = AtomicBool::new(false);

/// Takes the signals from now on. One of them ends the program at once, without anything temporary left behind, and with
/// the exit code that shells expect (128 and its number); unless a command [`listen`]s, which the first one asks to stop.
///
/// # Errors
/// The operating system's.
pub fn install() -> Result<()> {
    let failed = |e| Error::system(e).part("signals").hint("the system may be out of threads or memory; try again");
    let mut signals = Signals::new([SIGINT, SIGTERM, SIGHUP]).map_err(failed)?;
    // A file that grows beyond the limit for files (ulimit -f) is an error of the write then, not the program's end.
    signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false))).map_err(failed)?;
    let wait = move || {
        for signal in signals.forever() {
            if !LISTENING.load(Ordering::SeqCst) || ASKED.swap(true, Ordering::SeqCst) {
                process::leave(128_u8.saturating_add(signal as u8));
            }
        }
    };
    std::thread::Builder::new().name("signals".into()).spawn(wait).map_err(failed)?;
    Ok(())
}

/// Has the first signal ask for an end, by the flag that is returned; the second one ends the program.
pub fn listen() -> &'static AtomicBool {
    LISTENING.store(true, Ordering::SeqCst);
    &ASKED
}
