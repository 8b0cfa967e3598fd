//! Progress in a log: a plain line every ten seconds in the place of a bar.

use indicatif::TermLike;
use std::io::Write;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Longest silence of a log; with the display's ticks of half a second it stays below ten seconds.
const SILENCE: Duration = Duration::from_secs(9);

/// Time of the last line on standard error, shared by all stages: a log's silence may span several of them.
static LAST_SIGN: Mutex<Option<Instant>> = Mutex::new(None);

fn last_sign() -> MutexGuard<'static, Option<Instant>> {
    LAST_SIGN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Starts the clock by which the first line is due.
pub(crate) fn begin() {
    last_sign().get_or_insert_with(Instant::now);
}

/// Notes that a line was written: the next sign of life is due ten seconds from now.
pub(crate) fn sign() {
    *last_sign() = Some(Instant::now());
}

/// A log in the place of a terminal: it writes the current line every ten seconds and draws over nothing.
#[derive(Debug, Default)]
pub(crate) struct Log(Mutex<String>);

impl Log {
    fn line(&self) -> MutexGuard<'_, String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl TermLike for Log {
    fn width(&self) -> u16 {
        // Lines of a log are not cut.
        1000
    }

    fn move_cursor_up(&self, _: usize) -> std::io::Result<()> {
        Ok(())
    }

    fn move_cursor_down(&self, _: usize) -> std::io::Result<()> {
        Ok(())
    }

    fn move_cursor_right(&self, _: usize) -> std::io::Result<()> {
        Ok(())
    }

    fn move_cursor_left(&self, _: usize) -> std::io::Result<()> {
        Ok(())
    }

    fn write_line(&self, text: &str) -> std::io::Result<()> {
        self.write_str(text)
    }

    fn write_str(&self, text: &str) -> std::io::Result<()> {
        self.line().push_str(text);
        Ok(())
    }

    fn clear_line(&self) -> std::io::Result<()> {
        self.line().clear();
        Ok(())
    }

    fn flush(&self) -> std::io::Result<()> {
        let (mut line, mut last) = (self.line(), last_sign());
        let text = line.trim().trim_end_matches(';');
        if last.get_or_insert_with(Instant::now).elapsed() >= SILENCE && !text.is_empty() {
            let _ = writeln!(std::io::stderr().lock(), "{text}");
            *last = Some(Instant::now());
        }
        line.clear();
        Ok(())
    }
}
