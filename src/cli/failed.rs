//! Frames of a sequence that failed while the others went on.

use crate::error::Error;
use serde::Serialize;
use std::fmt;

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

/// Frames that failed, each with its error, as the end of a report shows them.
pub struct List<'f>(pub &'f [Failed]);

impl fmt::Display for List<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for Failed { frame, error } in self.0 {
            write!(f, "\n  frame {frame} failed: {}", error.replace('\n', "\n  "))?;
        }
        Ok(())
    }
}
