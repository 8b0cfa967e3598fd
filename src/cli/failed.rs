//! Frames of a sequence that failed while the others went on.

use serde::Serialize;

/// A frame without a result.
#[derive(Debug, Clone, Serialize)]
pub struct Failed {
    /// Number of the frame.
    pub frame: u32,
    /// The error with its remedy.
    pub error: String,
}
