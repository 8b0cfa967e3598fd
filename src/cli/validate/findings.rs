//! Findings about one file.

use crate::error::{Error, Result};
use crate::formats::problem::Problem;
use serde::Serialize;
use std::fmt;

/// Severity of a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
enum Severity {
    /// A fault of the file: exit code 1.
    Problem,
    /// A remark that is worth knowing; the file is fine.
    Note,
}

#[derive(Debug, Serialize)]
struct Finding {
    severity: Severity,
    #[serde(flatten)]
    problem: Problem,
}

/// Findings about a file, in the order in which they were made.
#[derive(Debug, Default, Serialize)]
#[serde(transparent)]
pub(super) struct Findings(Vec<Finding>);

impl Findings {
    /// Returns true if no finding is a problem.
    pub(super) fn valid(&self) -> bool {
        self.0.iter().all(|f| f.severity == Severity::Note)
    }
    /// Adds a problem of a grid, or of the file.
    pub(super) fn problem(&mut self, grid: Option<&str>, what: impl Into<String>, remedy: &str) {
        self.add(Severity::Problem, of_grid(grid, what, remedy));
    }
    /// Adds a note on a grid, or on the file.
    pub(super) fn note(&mut self, grid: Option<&str>, what: impl Into<String>, remedy: &str) {
        self.add(Severity::Note, of_grid(grid, what, remedy));
    }
    /// Adds the error by which a reader refused the file or a part of it.
    ///
    /// # Errors
    /// If the error is one of the operating system, which is no finding and is handed back.
    pub(super) fn refusal(&mut self, error: Error) -> Result<()> {
        self.add(Severity::Problem, Problem::of(error)?);
        Ok(())
    }
    fn add(&mut self, severity: Severity, problem: Problem) {
        self.0.push(Finding { severity, problem });
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

impl fmt::Display for Findings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for Finding { severity, problem } in &self.0 {
            let severity = if *severity == Severity::Problem { "problem" } else { "note" };
            writeln!(f, "  {severity}: {}", problem.to_string().replace('\n', "\n  "))?;
        }
        Ok(())
    }
}
