//! What all use cases have in common, for whoever runs them.

use crate::app::Context;
use crate::error::Result;
use crate::formats::limits::Limits;
use schemars::JsonSchema;
use serde::Serialize;
use std::fmt::Display;

/// Settings that can be run.
pub trait UseCase {
    /// Report of the work.
    type Report: Report;

    /// Returns the limits of the work.
    fn limits(&self) -> Limits;

    /// Returns the limits of the work, to be changed.
    fn limits_mut(&mut self) -> &mut Limits;

    /// Does the work.
    ///
    /// # Errors
    /// If the work has no result.
    fn run(&self, context: &Context) -> Result<Self::Report>;
}

/// Report of a use case: a document for programs, and a text for people.
pub trait Report: Serialize + JsonSchema + Display {
    /// Returns how the work ended.
    ///
    /// # Errors
    /// If parts of it failed, and the report does not say why.
    fn status(&self) -> Result<Status> {
        Ok(Status::Success)
    }
}

/// How work ended that has a report.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// All was done, and nothing found that a check looks for.
    Success,
    /// A check found a difference or a problem.
    Found,
    /// Some files or frames failed, and the report names them.
    Incomplete,
    /// The work was stopped, and its result so far was written.
    Stopped,
}

impl Status {
    /// Returns the status of work that may have been stopped.
    pub(crate) fn stopped(stopped: bool) -> Self {
        if stopped { Self::Stopped } else { Self::Success }
    }

    /// Returns the status of files or frames that may have failed.
    pub(crate) fn complete(complete: bool) -> Self {
        if complete { Self::Success } else { Self::Incomplete }
    }

    /// Returns the status of a check that may have found something, if all files could be checked.
    pub(crate) fn of_check(complete: bool, found: bool) -> Self {
        match (complete, found) {
            (false, _) => Self::Incomplete,
            (true, true) => Self::Found,
            (true, false) => Self::Success,
        }
    }
}

/// Makes a use case of settings with a method `run`; `$limits` is the field of its limits.
macro_rules! use_case {
    ($settings:ty => $report:ty, $($limits:ident).+) => {
        impl crate::app::use_case::UseCase for $settings {
            type Report = $report;

            fn limits(&self) -> crate::formats::limits::Limits {
                self.$($limits).+
            }

            fn limits_mut(&mut self) -> &mut crate::formats::limits::Limits {
                &mut self.$($limits).+
            }

            fn run(&self, context: &crate::app::Context) -> crate::error::Result<$report> {
                <$settings>::run(self, context)
            }
        }
    };
}
pub(in crate::app) use use_case;
