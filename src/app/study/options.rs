//! Settings that all studies have.

use crate::app::ranges;
use crate::error::Result;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Settings that all studies have: where the page goes, how often settings are run, and what is recommended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct StudyOptions {
    /// Folder for the page, its table (CSV), its record (JSON) and the reference.
    #[serde(with = "crate::app::paths")]
    pub output: PathBuf,
    /// True to replace what another command has written into the folder.
    pub overwrite: bool,
    /// True to measure only what the record in the folder lacks.
    pub resume: bool,
    /// Most runs of each setting, from 1 to 1000.
    pub repeats: u32,
    /// Seconds that the study may take, above 0: pictures are so small that each setting runs three times within them,
    /// and no round of runs begins after them.
    pub budget: f64,
    /// Error for which a setting is recommended, above 0.
    pub wanted_error: f64,
    /// Seconds for which a setting is recommended, too; none for the error alone.
    pub wanted_seconds: Option<f64>,
}

impl Default for StudyOptions {
    fn default() -> Self {
        Self {
            output: PathBuf::new(),
            overwrite: false,
            resume: false,
            repeats: 5,
            budget: 150.0,
            wanted_error: 0.01,
            wanted_seconds: None,
        }
    }
}

/// Settings on which nothing that is measured depends.
pub(super) const MANNER: [&str; 6] = ["output", "overwrite", "resume", "wanted_error", "wanted_seconds", "max_memory"];

impl StudyOptions {
    /// Refuses values out of their ranges.
    ///
    /// # Errors
    /// If a value is none that its setting may have; the error names it.
    pub(super) fn check(&self) -> Result<()> {
        ranges::within("repeats", self.repeats, [1, 1000])?;
        ranges::positive("budget", self.budget)?;
        ranges::positive("wanted_error", self.wanted_error)?;
        ranges::positive("wanted_seconds", self.wanted_seconds)
    }
}
