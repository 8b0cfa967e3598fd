//! The report of a study, which is its record, too.

use super::front;
use super::measurement::Measurement;
use super::recommendation::Recommendation;
use super::reference::Reference;
use crate::app::provenance::Provenance;
use crate::app::use_case::{Report, Status};
use crate::error::Result;
use crate::report::short;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::PathBuf;

/// Report of a study: errors and times of its settings, and which of them to take.
#[derive(Debug, Clone, Serialize, Deserialize, schemars::JsonSchema)]
pub struct StudyReport {
    /// Name of the study, such as `render`.
    pub study: String,
    /// Input that it was studied on.
    #[serde(serialize_with = "crate::app::paths::text")]
    pub input: PathBuf,
    /// The page.
    #[serde(serialize_with = "crate::app::paths::text")]
    pub page: PathBuf,
    /// True if all settings were measured; false if the study was stopped before.
    pub complete: bool,
    /// Width and height in pixels of the first picture that was measured.
    pub size: Option<[u32; 2]>,
    /// Reference of the errors.
    pub reference: Reference,
    /// Setting for the error or the time that was asked for.
    pub recommended: Recommendation,
    /// Settings for errors and times by powers of ten.
    pub recommendations: Vec<Recommendation>,
    /// Settings.
    pub measurements: Vec<Measurement>,
    /// Seconds that the study took, those of earlier runs that it went on from included.
    pub seconds: f64,
    /// Where the report comes from.
    pub provenance: Provenance,
}

impl Report for StudyReport {
    fn status(&self) -> Result<Status> {
        Ok(Status::stopped(!self.complete))
    }
}

impl StudyReport {
    /// Fewest and most runs of a setting.
    pub(super) fn runs(&self) -> String {
        let runs = || self.measurements.iter().map(|m| m.runs.len());
        match (runs().min().unwrap_or(0), runs().max().unwrap_or(0)) {
            (least, most) if least == most => format!("{most} run{} each", if most == 1 { "" } else { "s" }),
            (least, most) => format!("{least} to {most} runs each"),
        }
    }
}

impl fmt::Display for StudyReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { page, reference, recommended, measurements, .. } = self;
        let stopped = if self.complete { "" } else { "; stopped before the end, so that this is incomplete" };
        let (count, runs) = (measurements.len(), self.runs());
        writeln!(f, "{}: {count} settings, {runs}, in {:.1} s{stopped}", page.display(), self.seconds)?;
        writeln!(f, "  reference: {reference}")?;
        writeln!(f, "  {:>12}{:>16}  settings that no other one beats", "seconds", "error")?;
        for m in front::of(measurements) {
            let seconds = short(m.seconds.unwrap_or_default());
            writeln!(f, "  {seconds:>12}{:>16}  {}", m.error_in_words(), m.options)?;
        }
        match &recommended.command {
            Some(command) => write!(f, "{}, {}:\n  {command}", recommended.wanted(), recommended.reached()),
            None => write!(f, "{recommended}"),
        }
    }
}
