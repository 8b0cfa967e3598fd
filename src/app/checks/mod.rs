//! Checks of data: contradictions among a capture, its pictures and cameras, found before any work is done, and those
//! of its model, told by what was reconstructed.
//!
//! A reconstruction explains whatever it is given: with a wrong background, emission or camera it ends in a volume that
//! nobody rendered, and its residuals may even be small. What pictures must satisfy whatever the volume is can be
//! checked in one pass over the pixels: radiance is not negative, a pixel without opacity shows the background, alpha
//! and color tell the same transmittance, and complete silhouettes surround one common point.

pub mod cameras;
pub(crate) mod displacement;
pub(crate) mod excerpt;
pub mod left_out;
pub mod pictures;
pub(crate) mod residuals;
pub(crate) mod values;

use crate::error::{Code, Error};
use crate::wording::worded;
use serde::{Deserialize, Serialize};

/// Emission that pictures are compared with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Emission {
    /// The one that the capture states.
    Stated,
    /// None: a reconstruction looks for it, and it may differ from point to point.
    Sought,
}

/// A remark on a result that the user should know of.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct Warning {
    /// Contradiction: the value found, and the value expected.
    pub what: String,
    /// Remedy: the setting that would fit.
    #[serde(rename = "do")]
    pub remedy: String,
}

impl Warning {
    /// Creates a warning with its remedy, whose settings are named by the words of the process's face.
    pub fn new(what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { what: worded(&what.into()).into(), remedy: worded(&remedy.into()).into() }
    }
}

/// A contradiction between a capture and its pictures.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// True if no volume could have been seen like that.
    pub certain: bool,
    /// File of the picture that shows it; none if all do.
    pub view: Option<String>,
    /// Contradiction and the setting that would fit.
    pub warning: Warning,
}

impl Finding {
    fn certain(view: Option<&str>, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { certain: true, view: view.map(Into::into), warning: Warning::new(what, remedy) }
    }

    fn doubtful(view: Option<&str>, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { certain: false, ..Self::certain(view, what, remedy) }
    }
}

/// Returns the warnings among findings, each with its picture.
///
/// # Errors
/// The first finding that is certain.
pub(crate) fn refuse(findings: Vec<Finding>) -> Result<Vec<Warning>, Error> {
    if let Some(Finding { view, warning, .. }) = findings.iter().find(|f| f.certain) {
        let error = Error::invalid(&warning.what).coded(Code::Contradiction).hint(&warning.remedy);
        return Err(match view {
            Some(view) => error.at(view),
            None => error,
        });
    }
    Ok(warnings(findings))
}

/// Returns all findings as warnings.
pub(crate) fn warnings(findings: Vec<Finding>) -> Vec<Warning> {
    let named = |f: Finding| match f.view {
        Some(view) => Warning::new(format!("{view}: {}", f.warning.what), f.warning.remedy),
        None => f.warning,
    };
    findings.into_iter().map(named).collect()
}
