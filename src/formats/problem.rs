//! What is wrong with a file, for `validate`.

use crate::error::{Error, Kind, Result};
use crate::text::printable;
use serde::Serialize;
use std::fmt;

/// A fault of a file and what to do about it. The file itself is not named: whoever asked knows it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Problem {
    /// Where in the file: `grid 'density'`, `channel 'R'`, `frame 3`; none if it concerns all of it.
    pub part: Option<String>,
    /// What was found.
    pub what: String,
    /// What to do.
    #[serde(rename = "do")]
    pub remedy: String,
}

impl Problem {
    /// A problem of the whole file.
    pub fn new(what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { part: None, what: what.into(), remedy: remedy.into() }
    }

    /// Names the place in the file.
    #[must_use]
    pub fn part(self, part: impl Into<String>) -> Self {
        Self { part: Some(part.into()), ..self }
    }

    /// The problem that keeps a file from being read.
    ///
    /// # Errors
    /// An error of the operating system is handed back: it says nothing of the file's content.
    pub fn of(error: Error) -> Result<Self> {
        if error.kind() == Kind::Io {
            return Err(error);
        }
        let problem = Self::new(error.what(), error.remedy().unwrap_or("write or copy the file again"));
        Ok(Self { part: error.place().map(str::to_owned), ..problem })
    }
}

impl fmt::Display for Problem {
    /// Place and what was found on one line, what to do on the next; what would act on a terminal is escaped.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(part) = &self.part {
            write!(f, "{}: ", printable(part))?;
        }
        write!(f, "{}\n  {}", printable(&self.what), printable(&self.remedy))
    }
}
