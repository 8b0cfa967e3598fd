//! Errors that kept one of several files from being read while the others went on.

use crate::error::Error;
use serde::Serialize;
use std::borrow::Cow;
use std::fmt;

/// Error that kept one of several files from being read.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
pub struct Failure {
    /// Grid, layer or frame that the error concerns; none if it is the whole file.
    part: Option<String>,
    what: String,
    #[serde(rename = "do")]
    remedy: Option<String>,
}

impl Failure {
    /// Keeps the error by which a file failed.
    pub fn of(error: &Error) -> Self {
        let (part, remedy) = (error.place().map(str::to_owned), error.remedy().map(Cow::into_owned));
        Self { part, what: error.what().into_owned(), remedy }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("could not be read: ")?;
        self.part.iter().try_for_each(|part| write!(f, "{part}: "))?;
        writeln!(f, "{}", self.what)?;
        self.remedy.iter().try_for_each(|remedy| writeln!(f, "{remedy}"))
    }
}
