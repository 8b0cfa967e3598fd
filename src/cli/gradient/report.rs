//! The report of `cumulo gradient`.

use crate::app::checks::Warning;
use crate::app::provenance::Provenance;
use crate::app::run::write_warnings;
use crate::app::up::ChosenUp;
use crate::differentiate::study::parameter::Parameter;
use serde::Serialize;
use std::fmt;
use std::path::PathBuf;

/// A parameter with its derivative.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(in crate::cli) struct Row {
    pub name: String,
    #[serde(skip)]
    pub parameter: Parameter,
    /// Kind of the parameter: errors are relative to at least 1e-6 of the largest derivative of the same kind.
    #[serde(skip)]
    pub group: &'static str,
    pub value: f64,
    pub gradient: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub difference: Option<f64>,
    /// Error of the difference quotient that rounding of the loss alone may have made.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rounding: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relative_error: Option<f64>,
}

#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(in crate::cli) struct Report {
    #[serde(serialize_with = "crate::app::paths::text")]
    pub input: PathBuf,
    pub loss: String,
    pub value: f64,
    /// Number of parameters; of the voxels, only the largest derivatives are listed.
    pub parameters: usize,
    pub mode: &'static str,
    pub adjoint: Option<&'static str>,
    pub reason: String,
    pub precision: &'static str,
    pub quadrature: String,
    pub views: usize,
    /// Up axis about which cameras were placed; none where the target states them.
    pub up: Option<ChosenUp>,
    pub rows: Vec<Row>,
    /// Number of listed parameters that have a difference quotient; none without `--check`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub checked: Option<usize>,
    pub worst_relative_error: Option<f64>,
    /// Contradictions between the pictures and the model.
    pub warnings: Vec<Warning>,
    pub tolerance: Option<f64>,
    #[serde(serialize_with = "crate::app::paths::text")]
    pub output: Option<PathBuf>,
    /// Path of the page, if `--report` requests one.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[serde(serialize_with = "crate::app::paths::text")]
    pub report: Option<PathBuf>,
    pub seconds: f64,
    pub provenance: Option<Provenance>,
}

impl Report {
    /// Returns the AD mode, with the kind of adjoint in reverse mode.
    pub fn ad_mode(&self) -> String {
        self.adjoint.map_or_else(|| self.mode.to_owned(), |a| format!("{} ({a})", self.mode))
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { loss, value, views, quadrature, precision, .. } = self;
        writeln!(f, "{}: {loss} {value:.9e}, {views} views, {quadrature}, {precision}", self.input.display())?;
        writeln!(f, "  {}: {}", self.ad_mode(), self.reason)?;
        let wide = self.rows.iter().map(|r| r.name.len()).max().unwrap_or(0).max(9);
        write!(f, "  {:wide$} {:>16} {:>17}", "parameter", "value", "derivative")?;
        if self.tolerance.is_some() {
            write!(f, " {:>17} {:>9}", "difference", "error")?;
        }
        writeln!(f)?;
        for row in &self.rows {
            write!(f, "  {:wide$} {:>16.9e} {:>17.9e}", row.name, row.value, row.gradient)?;
            match (row.difference, row.relative_error) {
                (Some(difference), Some(error)) => writeln!(f, " {difference:>17.9e} {error:>9.1e}")?,
                _ => writeln!(f)?,
            }
        }
        if self.rows.len() < self.parameters {
            writeln!(f, "  {} of {} parameters, the largest derivatives by voxel", self.rows.len(), self.parameters)?;
        }
        if let Some(output) = &self.output {
            writeln!(f, "{}: written", output.display())?;
        }
        if let Some(page) = &self.report {
            writeln!(f, "{}: written", page.display())?;
        }
        write_warnings(f, &self.warnings)?;
        if let (Some(worst), Some(tolerance)) = (self.worst_relative_error, self.tolerance) {
            let verdict = if worst <= tolerance { "agree" } else { "do not agree" };
            if let Some(checked) = self.checked {
                let all = if checked < self.rows.len() { "; --all checks all that are listed" } else { "" };
                writeln!(f, "{checked} of {} parameters checked{all}", self.parameters)?;
            }
            writeln!(f, "derivatives and differences {verdict}: off by {worst:.1e} at most, {tolerance:e} allowed")?;
        }
        Ok(())
    }
}
