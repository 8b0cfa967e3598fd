//! Frames of a sequence that failed while the others went on.

use crate::error::Error;
use crate::text::ranges;
use serde::Serialize;
use std::fmt;
use std::io::Write;

/// A frame without a result.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
pub struct Failed {
    /// Number of the frame.
    pub frame: u32,
    /// The error with its remedy.
    pub error: String,
}

impl Failed {
    /// Keeps the error by which a frame failed.
    pub fn new(frame: u32, error: &Error) -> Self {
        Self { frame, error: error.to_string() }
    }
}

/// Says on standard error which frames failed and why, as is said of an error that ends a command. `--quiet` does not
/// silence it.
pub fn tell(failed: &[Failed]) {
    for Failed { frame, error } in failed {
        let _ = writeln!(std::io::stderr(), "cumulo: frame {frame}: {error}");
    }
}

/// Frames that failed, as the end of a report lists them; what happened to each was told before.
pub struct List<'f>(pub &'f [Failed]);

impl fmt::Display for List<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            [] => Ok(()),
            [one] => write!(f, "\n  frame {} failed", one.frame),
            many => {
                write!(f, "\n  {} frames failed: {}", many.len(), ranges(many.iter().map(|failed| failed.frame)))
            }
        }
    }
}
