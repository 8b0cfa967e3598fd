//! Faults of stages, with remedies, and a layer that removes those that are safe to remove.

use crate::app::Context;
use crate::app::failure::Failure;
use crate::app::inputs;
use crate::app::outputs::{self, Content};
use crate::app::use_case::{Report, Status, use_case};
use crate::error::{Error, Result};
use crate::formats::atomic;
use crate::formats::limits::Limits;
use crate::formats::usd::Stage;
use crate::formats::usd::lint::finding::{Finding, Severity};
use crate::formats::usd::lint::{findings, fix};
use crate::text::printable;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::{Path, PathBuf};

/// Settings of the check of stages.
///
/// Read are .usda, .usdc, .usd and .usdz with all that they reference, and the VDBs of their volumes.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LintSettings {
    /// Stages to check.
    #[serde(with = "crate::app::paths")]
    pub stages: Vec<PathBuf>,
    /// Layer over the stage to write, a .usda, that removes the faults which have one remedy; the stage stays as it is.
    #[serde(with = "crate::app::paths")]
    pub fix: Option<PathBuf>,
    /// True to replace a file that lies in the layer's place.
    pub overwrite: bool,
    /// Memory that the work may take.
    #[serde(flatten)]
    pub limits: Limits,
}

/// Report on stages. Notes do not count as problems.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct LintReport {
    /// True if no stage has a problem that is left.
    clean: bool,
    stages: Vec<Checked>,
    /// Layer that was written; none if nothing could be fixed.
    #[serde(serialize_with = "crate::app::paths::text")]
    layer: Option<PathBuf>,
}

/// Findings of the check of a stage.
#[derive(Debug, Serialize, schemars::JsonSchema)]
struct Checked {
    #[serde(serialize_with = "crate::app::paths::text")]
    path: PathBuf,
    findings: Vec<Told>,
    /// Error that kept the stage from being read.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<Failure>,
}

#[derive(Debug, Serialize, schemars::JsonSchema)]
struct Told {
    #[serde(flatten)]
    finding: Finding,
    /// True if the layer removes it.
    fixed: bool,
}

impl Told {
    fn counts(&self) -> bool {
        self.finding.severity == Severity::Problem && !self.fixed
    }
}

impl LintReport {
    /// True if no stage has a problem that is left.
    pub(crate) fn clean(&self) -> bool {
        self.clean
    }

    /// True if all stages could be read.
    pub(crate) fn complete(&self) -> bool {
        self.stages.iter().all(|stage| stage.error.is_none())
    }
}

use_case!(LintSettings => LintReport, limits);

impl Report for LintReport {
    fn status(&self) -> Result<Status> {
        Ok(Status::of_check(self.complete(), !self.clean()))
    }
}

impl LintSettings {
    /// Paths of the stages.
    pub(crate) fn inputs(&self) -> Vec<&Path> {
        self.stages.iter().map(PathBuf::as_path).collect()
    }

    /// Checks the stages and writes the layer. A stage that cannot be read does not keep the others from being
    /// reported.
    ///
    /// # Errors
    /// If the only stage cannot be read, or the layer cannot be written.
    pub fn run(&self, context: &Context) -> Result<LintReport> {
        let _inputs = inputs::protect(self.inputs(), self.limits);
        if let Some(layer) = &self.fix {
            self.check_layer(layer)?;
        }
        let mut stages = Vec::new();
        let mut layer = None;
        let bar = context.steps(self.stages.len() as u64, "checking");
        for path in &self.stages {
            let checked = self.check(path, &mut layer);
            stages.push(match checked {
                Ok(checked) => checked,
                Err(error) if self.stages.len() == 1 => return Err(error),
                Err(error) => {
                    Checked { path: path.clone(), findings: Vec::new(), error: Some(Failure::new(&error, context)) }
                }
            });
            bar.inc(1);
        }
        drop(bar);
        let failed = stages.iter().any(|stage| stage.error.is_some());
        let clean = !failed && !stages.iter().flat_map(|stage| &stage.findings).any(Told::counts);
        Ok(LintReport { clean, stages, layer })
    }

    fn check(&self, path: &Path, layer: &mut Option<PathBuf>) -> Result<Checked> {
        let stage = Stage::open(path, self.limits)?;
        let findings = findings(&stage, self.limits);
        let fixed = self.fix.is_some();
        if let Some(place) = &self.fix
            && findings.iter().any(|finding| finding.fix.is_some())
        {
            atomic::write_bytes(place, fix::layer(&stage, &findings, place)?.as_bytes())?;
            *layer = Some(place.clone());
        }
        let told = |finding: Finding| Told { fixed: fixed && finding.fix.is_some(), finding };
        Ok(Checked { path: path.to_path_buf(), findings: findings.into_iter().map(told).collect(), error: None })
    }

    fn check_layer(&self, layer: &Path) -> Result<()> {
        outputs::file(layer, Content::UsdText)?;
        if self.stages.len() > 1 {
            return Err(Error::invalid("⟨fix⟩ writes the layer of one stage, and several are given")
                .hint("give one stage after another"));
        }
        // Text such as a stage may be hand-made: nothing of it is replaced unasked.
        if layer.exists() && !self.overwrite {
            return Err(Error::invalid("a file lies here that would be replaced")
                .at(layer)
                .hint("give another name, or ⟨overwrite⟩ to replace it"));
        }
        Ok(())
    }
}

impl fmt::Display for LintReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for stage in &self.stages {
            let path = stage.path.to_string_lossy();
            let path = printable(&path);
            if let Some(failure) = &stage.error {
                writeln!(f, "{path}: {}", failure.to_string().trim_end().replace('\n', "\n  "))?;
                continue;
            }
            let problems = stage.findings.iter().filter(|told| told.counts()).count();
            let verdict = if problems == 0 { "clean".to_owned() } else { format!("{problems} problem(s)") };
            writeln!(f, "{path}: {verdict}")?;
            for Told { finding, fixed } in &stage.findings {
                let severity = match (finding.severity, fixed) {
                    (_, true) => "fixed",
                    (Severity::Problem, _) => "problem",
                    (Severity::Note, _) => "note",
                };
                let prim = finding.prim.as_ref().map(|prim| format!("{}: ", printable(prim))).unwrap_or_default();
                writeln!(f, "  {severity} [{}]: {prim}{}", finding.id, printable(&finding.what))?;
                writeln!(f, "    {}", printable(&finding.remedy))?;
            }
        }
        match &self.layer {
            Some(layer) => writeln!(f, "{}: written", printable(&layer.to_string_lossy())),
            None => Ok(()),
        }
    }
}
