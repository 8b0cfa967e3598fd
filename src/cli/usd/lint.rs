//! `cumulo usd lint`: faults of stages, with remedies, and a layer that removes those that are safe to remove.

use crate::app::failure::Failure;
use crate::app::outputs::{self, Content};
use crate::cli::memory::Memory;
use crate::cli::output::Output;
use crate::error::{Error, Result};
use crate::formats::atomic;
use crate::formats::usd::Stage;
use crate::formats::usd::lint::finding::{Finding, Severity};
use crate::formats::usd::lint::{findings, fix};
use crate::text::printable;
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Say what is wrong with stages and what to do; exit code 1 if anything is
///
/// Read are .usda, .usdc, .usd and .usdz with all that they reference, and the VDBs of their volumes. Notes do not
/// count.
#[derive(Debug, clap::Args)]
pub struct Lint {
    /// Stages
    #[arg(required = true, value_name = "STAGE")]
    stages: Vec<PathBuf>,
    /// Write a layer over the stage, a .usda, that removes the faults which have one remedy; the stage stays as it is
    #[arg(long, value_name = "LAYER")]
    fix: Option<PathBuf>,
    /// Replace a file that lies at LAYER
    #[arg(long, requires = "fix")]
    overwrite: bool,
    #[command(flatten)]
    pub(in crate::cli) memory: Memory,
}

#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(in crate::cli) struct Report {
    /// True if no stage has a problem that is left.
    clean: bool,
    stages: Vec<Checked>,
    /// Layer that was written; none if nothing could be fixed.
    #[serde(serialize_with = "crate::app::paths::text")]
    layer: Option<PathBuf>,
}

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

impl Lint {
    /// Paths that the command reads.
    pub(super) fn inputs(&self) -> Vec<&Path> {
        self.stages.iter().map(PathBuf::as_path).collect()
    }

    /// Checks the stages, writes the layer and reports; a stage that cannot be read does not keep the others from being
    /// reported.
    ///
    /// # Errors
    /// If the only stage cannot be read, or the layer cannot be written.
    pub(super) fn run(&self, output: &Output) -> Result<ExitCode> {
        if let Some(layer) = &self.fix {
            self.check_layer(layer)?;
        }
        let mut stages = Vec::new();
        let mut layer = None;
        let bar = output.steps(self.stages.len() as u64, "checking");
        for path in &self.stages {
            let checked = self.check(path, &mut layer);
            stages.push(match checked {
                Ok(checked) => checked,
                Err(error) if self.stages.len() == 1 => return Err(error),
                Err(error) => {
                    Checked { path: path.clone(), findings: Vec::new(), error: Some(Failure::new(&error, output)) }
                }
            });
            bar.inc(1);
        }
        drop(bar);
        let failed = stages.iter().any(|stage| stage.error.is_some());
        let clean = !failed && !stages.iter().flat_map(|stage| &stage.findings).any(Told::counts);
        output.report(&Report { clean, stages, layer })?;
        Ok(ExitCode::from(if failed { 2 } else { u8::from(!clean) }))
    }

    fn check(&self, path: &Path, layer: &mut Option<PathBuf>) -> Result<Checked> {
        let limits = self.memory.limits();
        let stage = Stage::open(path, limits)?;
        let findings = findings(&stage, limits);
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
            return Err(Error::invalid("--fix writes the layer of one stage, and several are given")
                .hint("give one stage after another"));
        }
        // Text such as a stage may be hand-made: nothing of it is replaced unasked.
        if layer.exists() && !self.overwrite {
            return Err(Error::invalid("a file lies here that would be replaced")
                .at(layer)
                .hint("give another name, or --overwrite to replace it"));
        }
        Ok(())
    }
}

impl fmt::Display for Report {
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
