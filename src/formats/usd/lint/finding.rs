//! Findings about a stage.

use crate::formats::usd::write::text::Property;
use serde::Serialize;

/// Severity of a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Severity {
    /// A fault of the stage.
    Problem,
    /// A remark that is worth knowing; the stage is fine.
    Note,
}

/// An opinion of a stronger layer that removes a problem.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Fix {
    /// Metadata of the stage: its name and its value as text.
    Metadata(&'static str, String),
    /// A property of a prim.
    Property(String, Property),
    /// Files of an attribute of a prim by time code, a single one without, and `None` at times that have none; they are
    /// written relative to the new layer.
    Files(String, Vec<(Option<f64>, Option<std::path::PathBuf>)>),
}

/// A finding about a stage.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub(crate) struct Finding {
    /// Kind of finding, which stays the same from release to release.
    pub id: &'static str,
    /// Severity.
    pub severity: Severity,
    /// Path of the prim; `None` if the finding concerns the whole stage.
    pub prim: Option<String>,
    /// Description of the fault: what was found, and what was expected.
    pub what: String,
    /// Advice to the user.
    #[serde(rename = "do")]
    pub remedy: String,
    /// Remedy that is safe, if there is one.
    #[serde(skip)]
    pub fix: Option<Fix>,
}

impl Finding {
    /// Creates a problem.
    pub(crate) fn problem(
        id: &'static str,
        prim: Option<&str>,
        what: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        let (what, remedy) = (what.into(), remedy.into());
        Self { id, severity: Severity::Problem, prim: prim.map(str::to_owned), what, remedy, fix: None }
    }

    /// Creates a note.
    pub(crate) fn note(
        id: &'static str,
        prim: Option<&str>,
        what: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Self { severity: Severity::Note, ..Self::problem(id, prim, what, remedy) }
    }

    /// Adds a remedy that is safe.
    #[must_use]
    pub(crate) fn fixed_by(self, fix: Option<Fix>) -> Self {
        Self { fix, ..self }
    }
}
