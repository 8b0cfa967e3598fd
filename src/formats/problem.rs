//! Problems of files, as `validate` reports them.

use crate::error::{Error, Kind, Result};
use crate::text::printable;
use crate::wording::worded;
use serde::Serialize;
use std::fmt;

/// A fault of a file with its remedy. The file is not named, because the caller knows it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, schemars::JsonSchema)]
pub struct Problem {
    /// Place in the file: `grid 'density'`, `channel 'R'`, `frame 3`; `None` if the fault concerns the whole file.
    pub part: Option<String>,
    /// Description of the fault.
    pub what: String,
    /// Advice to the user.
    #[serde(rename = "do")]
    pub remedy: String,
}

impl Problem {
    /// A problem of the whole file, whose settings are named by the words of the process's face.
    pub(crate) fn new(what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { part: None, what: worded(&what.into()).into(), remedy: worded(&remedy.into()).into() }
    }

    /// Names the place in the file.
    #[must_use]
    pub(crate) fn part(self, part: impl Into<String>) -> Self {
        Self { part: Some(part.into()), ..self }
    }

    /// Converts the error that keeps a file from being read to a problem of the file.
    ///
    /// # Errors
    /// An error of the operating system is handed back, because it says nothing of the file's content.
    pub(crate) fn of(error: Error) -> Result<Self> {
        if error.kind() == Kind::Io {
            return Err(error);
        }
        let problem = Self::new(error.what(), error.remedy().unwrap_or("write or copy the file again".into()));
        Ok(Self { part: error.place().map(str::to_owned), ..problem })
    }
}

impl fmt::Display for Problem {
    /// Writes place and description on one line and the remedy on the next; characters that act on a terminal are
    /// escaped.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(part) = &self.part {
            write!(f, "{}: ", printable(part))?;
        }
        write!(f, "{}\n  {}", printable(&self.what), printable(&self.remedy))
    }
}
