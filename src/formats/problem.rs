//! What is wrong with a file, for `validate`.

use serde::Serialize;
use std::fmt;

/// A fault of a file and what to do about it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Problem {
    /// What was found, with its place in the file.
    pub what: String,
    /// What to do.
    pub hint: String,
}

impl Problem {
    /// A problem from its two texts.
    pub fn new(what: impl Into<String>, hint: impl Into<String>) -> Self {
        Self { what: what.into(), hint: hint.into() }
    }
}

/// An error that keeps a file from being read, as a problem.
impl From<crate::error::Error> for Problem {
    fn from(error: crate::error::Error) -> Self {
        let text = error.to_string();
        match text.split_once("\n  ") {
            Some((what, hint)) => Self::new(what, hint),
            None => Self::new(text, "write the file again"),
        }
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}\n  {}", self.what, self.hint)
    }
}
