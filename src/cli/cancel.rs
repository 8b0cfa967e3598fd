//! Ctrl-C: the first asks to stop, the second ends the program.

use std::sync::atomic::{AtomicBool, Ordering};

static ASKED: AtomicBool = AtomicBool::new(false);

/// Listens from now on; the flag is set by the first Ctrl-C (or SIGTERM, SIGHUP).
pub fn listen() -> &'static AtomicBool {
    // Without a handler Ctrl-C ends the program at once, which loses nothing that is on disk.
    let _ = ctrlc::set_handler(|| {
        if ASKED.swap(true, Ordering::SeqCst) {
            std::process::exit(130);
        }
    });
    &ASKED
}
