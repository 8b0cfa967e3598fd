//! Errors of some of the files that a use case is given, while it goes on with the others.

use crate::app::Context;
use crate::error::{Code, Error};
use serde::Serialize;
use std::borrow::Cow;
use std::fmt;

/// Error that kept one of several files from being read.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
pub struct Failure {
    /// Grid, layer or frame that the error concerns; none if it is the whole file.
    part: Option<String>,
    /// Code of the error, for programs.
    code: Code,
    what: String,
    #[serde(rename = "do")]
    remedy: Option<String>,
}

impl Failure {
    /// Creates the report's entry for an error, and tells it to whoever watches the work.
    pub fn new(error: &Error, context: &Context) -> Self {
        context.unread(error);
        let (part, remedy) = (error.place().map(str::to_owned), error.remedy().map(Cow::into_owned));
        Self { part, code: error.code(), what: error.what().into_owned(), remedy }
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
