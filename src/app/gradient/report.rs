//! The report of derivatives.

use crate::app::checks::Warning;
use crate::app::provenance::Provenance;
use crate::app::run::write_warnings;
use crate::app::up::ChosenUp;
use crate::differentiate::study::parameter::Parameter;
use crate::wording::worded;
use serde::Serialize;
use std::fmt;
use std::path::PathBuf;

/// A parameter with its derivative.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(super) struct Row {
    pub(super) name: String,
    #[serde(skip)]
    pub(super) parameter: Option<Parameter>,
    /// Kind of the parameter: errors are relative to at least 1e-6 of the largest derivative of the same kind.
    #[serde(skip)]
    pub(super) group: &'static str,
    pub(super) value: f64,
    pub(super) gradient: f64,
    /// Standard error of a derivative that is estimated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) standard_error: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) difference: Option<f64>,
    /// Error of the difference quotient that rounding of the loss alone may have made.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) rounding: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) relative_error: Option<f64>,
}

/// Report of derivatives, and of their check.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct GradientReport {
    #[serde(serialize_with = "crate::app::paths::text")]
    pub(super) input: PathBuf,
    pub(super) loss: String,
    pub(super) value: f64,
    /// Number of parameters; of the voxels, only the largest derivatives are listed.
    pub(super) parameters: usize,
    pub(super) mode: &'static str,
    pub(super) adjoint: Option<&'static str>,
    pub(super) reason: String,
    pub(super) precision: &'static str,
    pub(super) quadrature: String,
    pub(super) views: usize,
    /// Up axis about which cameras were placed; none where the target states them.
    pub(super) up: Option<ChosenUp>,
    pub(super) rows: Vec<Row>,
    /// Number of listed parameters that have a difference quotient; none if they are not checked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) checked: Option<usize>,
    pub(super) worst_relative_error: Option<f64>,
    /// Contradictions between the pictures and the model.
    pub(super) warnings: Vec<Warning>,
    pub(super) tolerance: Option<f64>,
    #[serde(serialize_with = "crate::app::paths::text")]
    pub(super) output: Option<PathBuf>,
    /// Path of the page; none if none was written.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[serde(serialize_with = "crate::app::paths::text")]
    pub(super) report: Option<PathBuf>,
    pub(super) seconds: f64,
    pub(super) provenance: Option<Provenance>,
}

impl GradientReport {
    /// True if no derivative that was checked is off by more than is allowed.
    pub(crate) fn agrees(&self) -> bool {
        self.worst_relative_error.zip(self.tolerance).is_none_or(|(worst, tolerance)| worst <= tolerance)
    }

    /// Returns the AD mode, with the kind of adjoint in reverse mode.
    pub(super) fn ad_mode(&self) -> String {
        self.adjoint.map_or_else(|| self.mode.to_owned(), |a| format!("{} ({a})", self.mode))
    }
}

impl fmt::Display for GradientReport {
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
            if let Some(error) = row.standard_error {
                write!(f, " ± {error:.1e}")?;
            }
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
            let verdict = if self.agrees() { "agree" } else { "do not agree" };
            if let Some(checked) = self.checked {
                let all = if checked < self.rows.len() {
                    worded("; ⟨all⟩ checks all that are listed")
                } else {
                    "".into()
                };
                writeln!(f, "{checked} of {} parameters checked{all}", self.parameters)?;
            }
            writeln!(f, "derivatives and differences {verdict}: off by {worst:.1e} at most, {tolerance:e} allowed")?;
        }
        Ok(())
    }
}
