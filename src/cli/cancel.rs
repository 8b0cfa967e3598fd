//! Signals that ask the program to stop: SIGINT (Ctrl-C), SIGTERM and SIGHUP.

use super::{document, progress};
use crate::app::progress::Event;
use crate::app::task::NOTHING_FOUND;
use crate::cancel::Cancel;
use crate::error::{Error, Result};
use crate::process;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
use signal_hook::iterator::Signals;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::sync::{Arc, LazyLock};
use std::time::{Duration, Instant};

/// Set by the first signal to work that can be stopped.
static REQUESTED: LazyLock<Cancel> = LazyLock::new(Cancel::new);
/// Set a second after it to work that writes what it has.
static OVERDUE: LazyLock<Cancel> = LazyLock::new(Cancel::new);
/// True once the work asks whether it is to stop.
static STOPPABLE: AtomicBool = AtomicBool::new(false);
/// True once work that is stopped writes what it has.
static WORKING: AtomicBool = AtomicBool::new(false);
/// Exit code of work that was stopped: 128 plus the number of the signal, that of Ctrl-C at first.
static CODE: AtomicU8 = AtomicU8::new(128 + SIGINT as u8);

/// Handles the signals from now on. A signal ends the program at once, leaving nothing temporary behind, with the exit
/// code that shells expect (128 plus its number) and, with `--json`, a document that says so; if the work can be
/// stopped, the first one requests it to stop instead.
///
/// # Errors
/// If the operating system refuses the handlers or their thread.
pub(crate) fn install() -> Result<()> {
    let failed = |e| Error::system(e).part("signals").hint("the system may be out of threads or memory; try again");
    let mut signals = Signals::new([SIGINT, SIGTERM, SIGHUP]).map_err(failed)?;
    // A file that grows beyond the limit for files (ulimit -f) is an error of the write then, not the program's end.
    signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false))).map_err(failed)?;
    let wait = move || {
        for signal in signals.forever() {
            let code = 128_u8.saturating_add(signal as u8);
            CODE.store(code, Ordering::SeqCst);
            if !STOPPABLE.load(Ordering::SeqCst) || REQUESTED.request() {
                document::error(&Error::cancelled());
                process::leave(code);
            }
        }
    };
    std::thread::Builder::new().name("signals".into()).spawn(wait).map_err(failed)?;
    Ok(())
}

/// Takes note of how work goes on that a signal may stop.
pub(crate) fn take(event: &Event<'_>) {
    match event {
        Event::Stoppable => STOPPABLE.store(true, Ordering::SeqCst),
        Event::Loading => {
            STOPPABLE.store(true, Ordering::SeqCst);
            watch();
        }
        Event::Working => WORKING.store(true, Ordering::SeqCst),
        _ => {}
    }
}

/// Returns the cancellation that the first signal requests.
pub(crate) fn requested() -> Cancel {
    REQUESTED.clone()
}

/// Returns the cancellation that is requested a second after the first signal, once the work writes what it has.
pub(crate) fn overdue() -> Cancel {
    OVERDUE.clone()
}

/// Watches for the first signal to a long task: ends the program if the inputs are not read soon, and else gives the
/// work a second to measure and show its result.
fn watch() {
    std::thread::spawn(|| {
        while !REQUESTED.requested() {
            std::thread::sleep(Duration::from_millis(50));
        }
        // What is nearly read may as well be begun: the work then ends with what it started from.
        let patience = Instant::now();
        while !WORKING.load(Ordering::SeqCst) {
            if patience.elapsed() > Duration::from_millis(1200) {
                process::leave(nothing_found());
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        std::thread::sleep(Duration::from_secs(1));
        OVERDUE.request();
    });
}

/// Prints that nothing was written, and returns the exit code of a program that a signal ended.
pub(crate) fn nothing_found() -> u8 {
    let error = Error::cancelled().saying(NOTHING_FOUND);
    document::error(&error);
    progress::tell(&error);
    code()
}

/// Returns the exit code of work that a signal stopped: 130 for Ctrl-C, 143 for SIGTERM.
pub(crate) fn code() -> u8 {
    CODE.load(Ordering::SeqCst)
}
