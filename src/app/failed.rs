//! Frames of a sequence that failed while the others went on.

use crate::error::{Code, Error};
use crate::text::ranges;
use serde::Serialize;
use std::fmt;

/// A frame without a result.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
pub struct Failed {
    /// Number of the frame.
    pub frame: u32,
    /// Code of the error, for programs.
    pub code: Code,
    /// The error with its remedy.
    pub error: String,
}

impl Failed {
    /// Keeps the error by which a frame failed.
    pub fn new(frame: u32, error: &Error) -> Self {
        Self { frame, code: error.code(), error: error.to_string() }
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
