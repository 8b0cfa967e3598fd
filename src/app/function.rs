//! A transfer function, shown or converted to .tf.json; those that suit a volume; and the list of those that are there
//! by name.

use super::context::Context;
use super::outputs::{self, Content};
use super::provenance::Provenance;
use super::scan::ScanSettings;
use super::suggestion::{self, Suggested};
use crate::app::inputs;
use crate::app::use_case::{Report, use_case};
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::transfer::{self, Builtin, Function, Loaded, Options, Source, TransferSummary};
use crate::text::printable;
use crate::wording::{all_worded, worded};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::{Path, PathBuf};

/// Settings of a transfer function that is shown, or converted to .tf.json; or of those that suit a volume.
///
/// Read are .tf.json, color map presets of ParaView (JSON and XML), and VDBs whose grids carry one; content tells
/// which. ParaView's display-referred colors become scene-linear, its opacities extinctions.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FunctionSettings {
    /// File of the transfer function, or a name such as viridis or ct-bone; none to list those that are there by name.
    #[serde(with = "crate::app::paths")]
    pub input: Option<PathBuf>,
    /// VDB, NanoVDB or scan to suggest functions for, in the place of the input; none to read one.
    #[serde(with = "crate::app::paths")]
    pub suggest: Option<PathBuf>,
    /// Number of the suggested function to write, from 1; none for the first: all boundaries together.
    pub candidate: Option<u32>,
    /// PNG to draw a sheet of all suggested functions to.
    #[serde(with = "crate::app::paths")]
    pub sheet: Option<PathBuf>,
    /// Grid to suggest functions for; none for density, else the only scalar one.
    pub grid: Option<String>,
    /// Part of a scan that functions are suggested for, and where its voxels lie.
    #[serde(flatten)]
    pub scan: ScanSettings,
    /// The .tf.json to write it to.
    #[serde(with = "crate::app::paths")]
    pub output: Option<PathBuf>,
    /// Which of several: the preset of this name, in a VDB that of this grid; none for the first.
    pub preset: Option<String>,
    /// Range that its densities are mapped to; none to leave them.
    pub range: Option<[f64; 2]>,
    /// World length that the opacities of a preset are for; none for 1.
    pub unit_distance: Option<f64>,
    /// Extinction per world unit at the upper end of a color map or preset without opacities; none for 1.
    pub extinction: Option<f64>,
    /// Memory that the work may take.
    #[serde(flatten)]
    pub limits: Limits,
}

/// Report of a function, or the list of those that are there by name.
#[derive(Debug, Serialize, schemars::JsonSchema)]
#[serde(untagged)]
pub enum FunctionReport {
    /// Report of a function.
    Function(Box<Described>),
    /// The functions that suit a volume.
    Suggested(Box<Suggested>),
    /// The functions that are there by name.
    List(List),
}

impl fmt::Display for FunctionReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Function(described) => described.fmt(f),
            Self::Suggested(suggested) => suggested.fmt(f),
            Self::List(list) => list.fmt(f),
        }
    }
}

/// The transfer functions that are there by name.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct List {
    functions: Vec<Builtin>,
}

impl fmt::Display for List {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for Builtin { name, range: [low, high], unit, colors, opacity, source } in &self.functions {
            let range = format!("{low} to {high} {unit}");
            writeln!(f, "{name:15} {range:18} {colors}")?;
            writeln!(f, "{:15} {opacity}\n{:15} {source}", "", "")?;
        }
        let moved =
            "⟨tf_range⟩ LOW,HIGH moves a range; opacities are for a layer of one world unit (⟨tf_unit_distance⟩)";
        writeln!(f, "{}", worded(moved))
    }
}

/// A transfer function that was read.
#[derive(Debug, Serialize, schemars::JsonSchema)]
pub struct Described {
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

use_case!(FunctionSettings => FunctionReport, limits);

impl Report for FunctionReport {}

impl FunctionSettings {
    /// Paths that the function is read from.
    pub(crate) fn inputs(&self) -> Vec<&Path> {
        self.input.iter().chain(&self.suggest).map(PathBuf::as_path).collect()
    }

    /// Reads the transfer function, or suggests one, and writes it if an output is stated; or lists those that are
    /// there by name.
    ///
    /// # Errors
    /// If the input is no transfer function or volume that can be used, or an output cannot be written.
    pub fn run(&self, context: &Context) -> Result<FunctionReport> {
        let _inputs = inputs::protect(self.inputs(), self.limits);
        self.check()?;
        match (&self.input, &self.suggest) {
            (_, Some(volume)) => suggestion::run(&self.suggestion(volume), context)
                .map(|found| FunctionReport::Suggested(Box::new(found))),
            (Some(input), None) => self.read(input, context).map(|found| FunctionReport::Function(Box::new(found))),
            (None, None) => Ok(FunctionReport::List(List { functions: transfer::builtins() })),
        }
    }

    fn suggestion<'s>(&'s self, volume: &'s Path) -> suggestion::Request<'s> {
        suggestion::Request {
            volume,
            output: self.output.as_deref(),
            sheet: self.sheet.as_deref(),
            candidate: self.candidate,
            grid: self.grid.as_deref(),
            scan: &self.scan,
            limits: self.limits,
        }
    }

    /// Refuses settings that have no effect on what is asked for.
    fn check(&self) -> Result<()> {
        let of_suggestion = [
            ("⟨candidate⟩", self.candidate.is_some()),
            ("⟨sheet⟩", self.sheet.is_some()),
            ("⟨grid⟩", self.grid.is_some()),
        ];
        let scan = self.scan.stated().map(|(name, given, _)| (name, given));
        let of_function = [
            ("the input", self.input.is_some()),
            ("⟨preset⟩", self.preset.is_some()),
            ("⟨range⟩", self.range.is_some()),
            ("⟨unit_distance⟩", self.unit_distance.is_some()),
            ("⟨extinction⟩", self.extinction.is_some()),
        ];
        let given = |all: &[(&'static str, bool)]| all.iter().find(|(_, given)| *given).map(|(name, _)| *name);
        match self.suggest {
            Some(_) => given(&of_function).map_or(Ok(()), |name| {
                Err(Error::invalid(format!("{name} has no effect on suggested functions"))
                    .hint("leave it out, or ⟨suggest⟩"))
            }),
            None => given(&of_suggestion).or(given(&scan)).map_or(Ok(()), |name| {
                Err(Error::invalid(format!("{name} has no effect without ⟨suggest⟩"))
                    .hint("name the volume with ⟨suggest⟩, or leave it out"))
            }),
        }
    }

    fn read(&self, input: &Path, context: &Context) -> Result<Described> {
        let mut provenance = Provenance::begin(context);
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
            let function = (&loaded.transfer, loaded.albedo.as_deref());
            transfer::save_function(path, function, loaded.name.as_deref(), Some(&provenance))?;
        }
        let Loaded { transfer, albedo, source, name, presets, notes } = loaded;
        Ok(Described {
            input: input.to_path_buf(),
            output: self.output.clone(),
            source,
            name,
            summary: TransferSummary::of(&Function { transfer, albedo })?,
            presets,
            notes: all_worded(notes),
        })
    }

    fn options(&self) -> Options {
        Options {
            preset: self.preset.clone(),
            range: self.range,
            unit_distance: self.unit_distance,
            extinction: self.extinction,
            limits: self.limits,
        }
    }
}

impl fmt::Display for Described {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let source = match self.source {
            Source::Cumulo => "transfer function",
            Source::ParaviewJson => "ParaView preset (JSON)",
            Source::ParaviewXml => "ParaView preset (XML)",
            Source::LabelTable => "table of labels",
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
