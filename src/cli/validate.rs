//! `cumulo validate`: what is wrong with a file, and what to do.

use super::info::statistics_of;
use super::memory::Memory;
use super::output::Output;
use crate::error::{Error, Kind, Result};
use crate::formats::vdb::{File, GridInfo, Limits, NativeGrid, Transform};
use crate::formats::{self, Format};
use crate::scene::grid::GridClass;
use crate::scene::statistics::Statistics;
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Say what is wrong with files and what to do; exit code 1 if anything is
#[derive(Debug, clap::Args)]
pub struct Validate {
    /// Files to check
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    #[command(flatten)]
    memory: Memory,
}

#[derive(Debug, Serialize)]
struct Report {
    valid: bool,
    files: Vec<Checked>,
}

#[derive(Debug, Serialize)]
struct Checked {
    path: PathBuf,
    format: Format,
    valid: bool,
    findings: Vec<Finding>,
}

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
    part: Option<String>,
    what: String,
    #[serde(rename = "do")]
    remedy: String,
}

impl Validate {
    /// Checks and reports.
    ///
    /// # Errors
    /// If a file cannot be read at all; what is wrong inside is the report.
    pub fn run(&self, output: &Output) -> Result<ExitCode> {
        let mut files = Vec::new();
        for path in &self.files {
            let format = formats::sniff(path)?;
            let mut findings = Findings::default();
            match format {
                Format::Exr | Format::Json => {
                    return Err(Error::unsupported(format!("{format:?} files cannot be checked"))
                        .at(path)
                        .hint("give .vdb files"));
                }
                // Whatever else it is, it is no sound volume, and the refusal says why.
                Format::Vdb | Format::NanoVdb | Format::Unknown => {
                    volume(path, self.memory.limits(), &mut findings)?;
                }
            }
            let valid = findings.0.iter().all(|f| f.severity == Severity::Note);
            files.push(Checked { path: path.clone(), format, valid, findings: findings.0 });
        }
        let valid = files.iter().all(|f| f.valid);
        output.report(&Report { valid, files })?;
        Ok(if valid { ExitCode::SUCCESS } else { ExitCode::from(1) })
    }
}

#[derive(Debug, Default)]
struct Findings(Vec<Finding>);

impl Findings {
    fn add(&mut self, severity: Severity, part: Option<&str>, what: impl Into<String>, remedy: &str) {
        let part = part.map(|name| format!("grid '{name}'"));
        self.0.push(Finding { severity, part, what: what.into(), remedy: remedy.to_owned() });
    }
    fn problem(&mut self, part: Option<&str>, what: impl Into<String>, remedy: &str) {
        self.add(Severity::Problem, part, what, remedy);
    }
    fn note(&mut self, part: Option<&str>, what: impl Into<String>, remedy: &str) {
        self.add(Severity::Note, part, what, remedy);
    }
    /// An error of the readers becomes a finding, one of the operating system stays an error.
    fn take(&mut self, part: Option<&str>, error: Error) -> Result<()> {
        if error.kind() == Kind::Io {
            return Err(error);
        }
        let text = error.to_string();
        let remedy = text.split_once("\n  ").map_or("export the file again", |(_, hint)| hint);
        self.problem(part, error.what(), remedy);
        Ok(())
    }
}

fn volume(path: &Path, limits: Limits, found: &mut Findings) -> Result<()> {
    let file = match File::open(path, limits) {
        Ok(file) => file,
        Err(error) => return found.take(None, error),
    };
    if file.entries().is_empty() {
        found.problem(None, "the file has no grids", "check the export settings of the program that made it");
    }
    for entry in file.entries() {
        let name = entry.name.as_str();
        if entry.name != entry.base_name && entry.name.ends_with("[0]") {
            found.note(Some(name), "several grids share this name", "name them as here, with their number, in --grid");
        }
        let native = match file.read(name) {
            Ok(native) => native,
            Err(error) => {
                found.take(Some(name), error)?;
                continue;
            }
        };
        match native.info() {
            Ok(info) => values(&native, &info, found)?,
            Err(error) => found.take(Some(name), error)?,
        }
    }
    Ok(())
}

fn values(native: &NativeGrid, info: &GridInfo, found: &mut Findings) -> Result<()> {
    let name = Some(info.name.as_str());
    if let Transform::Other(kind) = &info.transform {
        found.problem(name, format!("the transform is a {kind}, not affine"), "resample it onto a linear transform");
    }
    if info.active_voxels == 0 {
        found.problem(name, "the grid is empty", "check that the simulation or the export reached this frame");
    }
    if info.class == GridClass::LevelSet {
        found.note(
            name,
            "this is a level set: distances, no density",
            "for rendering as fog, convert it: vdb_tool -read IN.vdb -ls2fog -write OUT.vdb, or Houdini's Convert VDB",
        );
    }
    if info.components == 0 {
        found.note(name, format!("{} values are passed through, not looked at", info.value_type), "nothing");
        return Ok(());
    }
    let s = statistics_of(&native.to_raw()?);
    numbers(info, &s, found);
    if !info.background.iter().all(|b| b.is_finite()) {
        found.problem(name, format!("the background is {:?}", info.background), "cumulo convert --repair sets it to 0");
    } else if info.class == GridClass::FogVolume && info.background.iter().any(|b| *b != 0.0) {
        found.problem(
            name,
            format!("a fog volume with background {:?} is infinite", info.background),
            "set the background to 0 where it was made, or --crop it",
        );
    }
    Ok(())
}

fn numbers(info: &GridInfo, s: &Statistics, found: &mut Findings) {
    let name = Some(info.name.as_str());
    if s.nan > 0 {
        found.problem(name, format!("{} values are NaN", s.nan), "cumulo convert --repair sets them to 0");
    }
    if s.infinite > 0 && info.half {
        let what = format!("{} values are infinite, and the grid is stored as half: they exceeded 65504", s.infinite);
        found.problem(name, what, "write it again from the source without half, or scaled down");
    } else if s.infinite > 0 {
        found.problem(name, format!("{} values are infinite", s.infinite), "cumulo convert --repair sets them to 0");
    }
    if s.above_half > 0 && !info.half {
        let what = format!("{} values are above 65504", s.above_half);
        found.note(name, what, "do not store this grid as half: they would become infinite");
    }
    let scalar_density = info.components == 1 && info.class == GridClass::FogVolume;
    if scalar_density && s.negative > 0 {
        let what = format!("{} densities are negative (down to {})", s.negative, s.min.unwrap_or_default());
        found.problem(name, what, "cumulo convert --repair sets them to 0");
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for file in &self.files {
            let verdict = if file.valid { "valid" } else { "not valid" };
            writeln!(f, "{}: {verdict}", file.path.display())?;
            for finding in &file.findings {
                let kind = if finding.severity == Severity::Problem { "problem" } else { "note" };
                let part = finding.part.as_ref().map(|p| format!("{p}: ")).unwrap_or_default();
                writeln!(f, "  {kind}: {part}{}\n    {}", finding.what, finding.remedy)?;
            }
        }
        Ok(())
    }
}
