//! `cumulo transfer`: transfer functions in, `.tf.json` out; and `--tf` of the commands that use one.

use super::memory::Memory;
use super::output::Output;
use super::parse::{ascending, positive};
use crate::app::outputs::{self, Content};
use crate::app::provenance::Provenance;
use crate::error::{Error, Result};
use crate::formats::transfer::{self, Builtin, Options, Source, TransferSummary};
use crate::text::printable;
use crate::wording::all_worded;
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Show a transfer function, or convert it to .tf.json
///
/// Read are .tf.json, color map presets of ParaView (JSON and XML), and VDBs whose grids carry one; content tells
/// which. ParaView's display-referred colors become scene-linear, its opacities extinctions. Color maps and medical
/// presets are there by name: see --list.
#[derive(Debug, clap::Args)]
pub struct TransferCommand {
    /// Transfer function to read: a file, or a name such as viridis or ct-bone
    #[arg(required_unless_present = "list")]
    input: Option<PathBuf>,
    /// List the transfer functions that are there by name, with their ranges
    #[arg(long, conflicts_with_all = ["input", "output", "preset", "range", "unit_distance", "extinction"])]
    list: bool,
    /// Write it to this .tf.json
    #[arg(long, short, value_name = "OUT")]
    output: Option<PathBuf>,
    /// Which of several: the preset of this name, in a VDB that of this grid (default: the first)
    #[arg(long, value_name = "NAME")]
    preset: Option<String>,
    /// Map its densities to this range
    #[arg(long, value_name = "LOW,HIGH", value_parser = ascending, allow_hyphen_values = true)]
    range: Option<[f64; 2]>,
    /// World length that the opacities of a preset are for (default: 1)
    #[arg(long, value_name = "U", value_parser = positive)]
    unit_distance: Option<f64>,
    /// Extinction per world unit at the upper end of a color map or preset without opacities (default: 1)
    #[arg(long, value_name = "S", value_parser = positive)]
    extinction: Option<f64>,
    #[command(flatten)]
    pub(in crate::cli) memory: Memory,
}

/// Report of a function, or the list of those that are there by name.
#[derive(schemars::JsonSchema)]
#[serde(untagged)]
#[allow(dead_code, reason = "it describes documents, and none is made of it")]
pub(in crate::cli) enum AnyReport {
    Function(Report),
    List(List),
}

/// The transfer functions that are there by name.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(in crate::cli) struct List {
    functions: Vec<Builtin>,
}

impl fmt::Display for List {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for Builtin { name, range: [low, high], unit, colors, opacity, source } in &self.functions {
            let range = format!("{low} to {high} {unit}");
            writeln!(f, "{name:15} {range:18} {colors}")?;
            writeln!(f, "{:15} {opacity}\n{:15} {source}", "", "")?;
        }
        writeln!(
            f,
            "--tf-range LOW,HIGH moves a range; opacities are for a layer of one world unit (--tf-unit-distance)"
        )
    }
}

#[derive(Debug, Serialize, schemars::JsonSchema)]
pub(in crate::cli) struct Report {
    #[serde(serialize_with = "crate::app::paths::text")]
    input: PathBuf,
    #[serde(serialize_with = "crate::app::paths::text")]
    output: Option<PathBuf>,
    source: Source,
    name: Option<String>,
    #[serde(flatten)]
    summary: TransferSummary,
    presets: Vec<String>,
    notes: Vec<String>,
}

impl TransferCommand {
    /// Paths that the command reads.
    pub(in crate::cli) fn inputs(&self) -> Vec<&Path> {
        self.input.iter().map(PathBuf::as_path).collect()
    }

    /// Reads the transfer function, writes it if `--output` is given, and reports.
    ///
    /// # Errors
    /// If the input is no transfer function that can be used, or the output cannot be written.
    pub fn run(&self, output: &Output) -> Result<ExitCode> {
        let Some(input) = &self.input else {
            output.report(&List { functions: transfer::builtins() })?;
            return Ok(ExitCode::SUCCESS);
        };
        let mut provenance = Provenance::begin(output);
        if let Some(path) = &self.output {
            outputs::file(path, Content::TransferFunction)?;
        }
        let loaded = transfer::load(input, &self.options())?;
        if let Some(path) = &self.output {
            if let Some(file) = transfer::file(input) {
                provenance.input(file, [file])?;
            }
            provenance.lap();
            let provenance = serde_json::to_value(&provenance)
                .map_err(|e| Error::invalid(e.to_string()).at(path).hint("report this as a bug"))?;
            transfer::save(path, &loaded.transfer, loaded.name.as_deref(), Some(&provenance))?;
        }
        output.report(&Report {
            input: input.clone(),
            output: self.output.clone(),
            source: loaded.source,
            name: loaded.name,
            summary: TransferSummary::of(&loaded.transfer)?,
            presets: loaded.presets,
            notes: all_worded(loaded.notes),
        })?;
        Ok(ExitCode::SUCCESS)
    }

    fn options(&self) -> Options {
        Options {
            preset: self.preset.clone(),
            range: self.range,
            unit_distance: self.unit_distance,
            extinction: self.extinction,
            limits: self.memory.limits(),
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let source = match self.source {
            Source::Cumulo => "transfer function",
            Source::ParaviewJson => "ParaView preset (JSON)",
            Source::ParaviewXml => "ParaView preset (XML)",
            Source::Vdb => "transfer function of a VDB's grid",
            Source::Builtin => "transfer function by name",
        };
        write!(f, "{}: {source}", printable(&self.input.to_string_lossy()))?;
        if let Some(name) = &self.name {
            write!(f, " '{}'", printable(name))?;
        }
        writeln!(f, "\n  {}", self.summary)?;
        let [r, g, b] = self.summary.peak_color;
        writeln!(f, "  peak radiance {r} {g} {b}")?;
        for note in &self.notes {
            writeln!(f, "  {}", printable(note))?;
        }
        if self.presets.len() > 1 {
            writeln!(f, "  the file has: {}", printable(&self.presets.join(", ")))?;
        }
        if let Some(output) = &self.output {
            writeln!(f, "{}: written", printable(&output.to_string_lossy()))?;
        }
        Ok(())
    }
}
