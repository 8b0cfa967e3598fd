//! What was found in one file.

use crate::error::{Error, Result};
use crate::formats::problem::Problem;
use serde::Serialize;
use std::fmt;

/// How much a finding matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
enum Severity {
    /// Something is wrong: exit code 1.
    Problem,
    /// Worth knowing; the file is fine.
    Note,
}

#[derive(Debug, Serialize)]
struct Finding {
    severity: Severity,
    #[serde(flatten)]
    problem: Problem,
}

/// Findings in the order they were made.
#[derive(Debug, Default, Serialize)]
#[serde(transparent)]
pub(super) struct Findings(Vec<Finding>);

impl Findings {
    /// True if nothing is wrong.
    pub(super) fn valid(&self) -> bool {
        self.0.iter().all(|f| f.severity == Severity::Note)
    }
    /// Something is wrong with a grid, or with the file.
    pub(super) fn problem(&mut self, grid: Option<&str>, what: impl Into<String>, remedy: &str) {
        self.add(Severity::Problem, of_grid(grid, what, remedy));
    }
    /// Something is worth knowing of a grid, or of the file.
    pub(super) fn note(&mut self, grid: Option<&str>, what: impl Into<String>, remedy: &str) {
        self.add(Severity::Note, of_grid(grid, what, remedy));
    }
    /// The reader refused the file or a part of it.
    ///
    /// # Errors
    /// An error of the operating system is no finding and handed back.
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
