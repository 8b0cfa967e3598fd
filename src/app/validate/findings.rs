//! Findings about one file.

use crate::app::checks::Warning;
use crate::error::{Error, Kind, Result};
use crate::formats::exr::deep;
use crate::formats::problem::Problem;
use serde::Serialize;
use std::fmt;

/// Severity of a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
enum Severity {
    /// A fault of the file: exit code 1.
    Problem,
    /// A contradiction that need not be a fault, but makes what is derived from the file doubtful.
    Warning,
    /// A remark that is worth knowing; the file is fine.
    Note,
}

#[derive(Debug, Serialize, schemars::JsonSchema)]
struct Finding {
    severity: Severity,
    #[serde(flatten)]
    problem: Problem,
}

/// Findings about a file, in the order in which they were made.
#[derive(Debug, Default, Serialize, schemars::JsonSchema)]
#[serde(transparent)]
pub(super) struct Findings {
    all: Vec<Finding>,
    /// True if something was refused that this program does not handle, or that exceeds its limits.
    #[serde(skip)]
    pub unsupported: bool,
}

impl Findings {
    /// Returns true if no finding is a problem.
    pub(super) fn valid(&self) -> bool {
        self.all.iter().all(|f| f.severity != Severity::Problem)
    }
    /// Adds a problem of a grid, or of the file.
    pub(super) fn problem(&mut self, grid: Option<&str>, what: impl Into<String>, remedy: &str) {
        self.add(Severity::Problem, of_grid(grid, what, remedy));
    }
    /// Adds a note on a grid, or on the file.
    pub(super) fn note(&mut self, grid: Option<&str>, what: impl Into<String>, remedy: &str) {
        self.add(Severity::Note, of_grid(grid, what, remedy));
    }
    /// Adds a problem of a part of the file, or a note on it if it need not be a fault.
    pub(super) fn of_part(&mut self, certain: bool, part: &str, what: String, remedy: &str) {
        let severity = if certain { Severity::Problem } else { Severity::Note };
        self.add(severity, Problem::new(what, remedy).part(part));
    }
    /// Returns the findings as the text of a report shows them.
    pub(super) fn lines(&self) -> Vec<String> {
        self.all.iter().map(ToString::to_string).collect()
    }
    /// Adds a warning about the file.
    pub(super) fn warning(&mut self, warning: Warning) {
        self.add(Severity::Warning, Problem::new(warning.what, warning.remedy));
    }
    /// Adds what was found in a deep picture: a problem, or a note if it need not be a fault.
    pub(super) fn deep(&mut self, finding: deep::Finding) {
        self.add(if finding.certain { Severity::Problem } else { Severity::Note }, finding.problem);
    }
    /// Adds the error by which a reader refused the file or a part of it.
    ///
    /// # Errors
    /// If the error is one of the operating system, which is no finding and is handed back.
    pub(super) fn refusal(&mut self, error: Error) -> Result<()> {
        self.unsupported |= error.kind() == Kind::Unsupported;
        self.add(Severity::Problem, Problem::of(error)?);
        Ok(())
    }
    fn add(&mut self, severity: Severity, problem: Problem) {
        self.all.push(Finding { severity, problem });
    }
}

impl Extend<Problem> for Findings {
    fn extend<T: IntoIterator<Item = Problem>>(&mut self, problems: T) {
        problems.into_iter().for_each(|p| self.add(Severity::Problem, p));
    }
}

fn of_grid(grid: Option<&str>, what: impl Into<String>, remedy: &str) -> Problem {
    let part = grid.map(|name| format!("grid '{name}'"));
    Problem { part, ..Problem::new(what, remedy) }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let severity = match self.severity {
            Severity::Problem => "problem",
            Severity::Warning => "warning",
            Severity::Note => "note",
        };
        write!(f, "{severity}: {}", self.problem)
    }
}

impl fmt::Display for Findings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.all.iter().try_for_each(|finding| writeln!(f, "  {}", finding.to_string().replace('\n', "\n  ")))
    }
}
