//! Progress as the sessions of Open Job Description read it, from the lines of a task.

use crate::app::progress::Event;
use crate::text::printable;
use std::io::Write;
use std::sync::{Mutex, PoisonError};

/// Least difference of shares in per cent that is told.
const STEP: f64 = 1.0;

/// Share of a stage in per cent that was told last.
#[derive(Debug, Default)]
pub(super) struct Share(Mutex<Option<f64>>);

impl Share {
    /// Tells of a stage's begin and progress; returns false for other events.
    pub(super) fn tell(&self, event: &Event<'_>) -> bool {
        let mut told = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match *event {
            Event::Began { name, .. } => {
                *told = None;
                line("status", name);
            }
            Event::Advanced { done, total: Some(total), .. } => {
                let share = 100.0 * (done / total.max(1) as f64).clamp(0.0, 1.0);
                if told.is_none_or(|told| (share - told).abs() >= STEP || share == 100.0 && told < share) {
                    *told = Some(share);
                    line("progress", &format!("{share:.1}"));
                }
            }
            Event::Advanced { .. } | Event::Ended { .. } => {}
            _ => return false,
        }
        true
    }
}

/// Tells why a task failed.
pub(super) fn failed(error: &str) {
    let words: Vec<&str> = error.split_whitespace().collect();
    line("fail", &words.join(" "));
}

fn line(what: &str, text: &str) {
    let _ = writeln!(std::io::stderr().lock(), "openjd_{what}: {}", printable(text));
}
