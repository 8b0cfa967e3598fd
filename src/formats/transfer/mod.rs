//! Transfer functions in files: Cumulo's `.tf.json`, ParaView's presets, tables of labels, and the metadata of a VDB.
//!
//! Cumulo's format is `{"format": "cumulo-transfer-function", "version": 1, "name": …, "transfer": {"kind": …},
//! "provenance": {…}}`, where `transfer` is a serialised [`Transfer`]: densities, scene-linear radiances of the source,
//! extinction per world unit of length. `name` and `provenance` may be absent; other keys at the top are ignored.
//! Version 2 may have `"albedo": {"points": [[density, r, g, b], …]}` beside `transfer`: the albedo in a medium that
//! scatters light, from 0 to 1, linear between points of ascending density. Functions without one are version 1.
//!
//! ParaView's presets, in JSON (`RGBPoints`, `Points`, `ColorSpace`, `HSVWrap`, `Name`; one object or a list) and in
//! XML (`ColorMaps`, `ColorMap`, `Point`), become points:
//! - Colors there are display-referred sRGB, from 0 to 1, and are interpolated as such or in another space; they are
//!   sampled densely, and made scene-linear. Between the samples a color errs by at most 2e-4 (4e-3 where a mixture in
//!   Lab leaves the display's gamut).
//! - Opacity α is that of a layer one unit distance `u` thick: extinction is `-ln(1 - α) / u`. Since extinction must be
//!   finite, α above `MOST_OPACITY` counts as that.
//! - Without opacities, extinction rises linearly from 0 at the first color to [`Options::extinction`] at the last.
//!
//! Tables of labels as text are those of FreeSurfer, 3D Slicer and ITK-SNAP.
//!
//! Some functions are chosen by name, without a file: see `builtins`.
//!
//! A VDB grid carries a transfer function as the text of Cumulo's JSON under the key [`METADATA_KEY`].

mod builtin;
mod carried;
mod color;
mod document;
mod label_table;
mod opacity;
mod paraview;
mod paraview_json;
mod paraview_xml;
mod rescale;
mod summary;

pub(crate) use builtin::{Builtin, builtins, is_builtin};
pub use carried::{METADATA_KEY, from_metadata};
pub(crate) use carried::{function_from_metadata, to_metadata};
pub use document::{FORMAT, save, save_function};
pub(crate) use rescale::range;
pub(crate) use summary::TransferSummary;

use crate::error::{Error, Result};
use crate::formats::format::FileKind;
use crate::formats::limits::Limits;
use crate::formats::{input, registry};
use crate::scene::albedo::{AlbedoFunction, TransferColor};
use crate::scene::transfer::Transfer;
use serde::Serialize;
use std::path::Path;
use std::sync::Arc;

/// Largest size of a file in bytes; a transfer function with the largest number of points takes less.
const MAX_BYTES: u64 = 1 << 25;

/// Options for reading a transfer function.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Options {
    /// Name of the preset, or of the grid in a VDB; the first one unless given.
    pub preset: Option<String>,
    /// Densities to which the first and the last density of the file are mapped; unchanged unless given.
    pub range: Option<[f64; 2]>,
    /// World length to which the opacities of a preset refer; 1 unless given.
    pub unit_distance: Option<f64>,
    /// Extinction per world unit at the last color of a preset without opacities; 1 unless given.
    pub extinction: Option<f64>,
    /// Limits of the memory that the file's content may take.
    pub limits: Limits,
}

/// Kind of file that holds a transfer function.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, schemars::JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Source {
    /// Cumulo's `.tf.json`.
    Cumulo,
    /// ParaView presets in JSON.
    ParaviewJson,
    /// ParaView presets in XML.
    ParaviewXml,
    /// Table of labels and colors as text.
    LabelTable,
    /// Metadata of a grid in a VDB.
    Vdb,
    /// None: a function that is chosen by its name.
    Builtin,
}

/// A transfer function with the albedo that goes with it, if it states one.
#[derive(Debug, Clone, PartialEq)]
pub struct Function {
    /// Extinctions, and radiances of the source.
    pub transfer: Transfer,
    /// Albedo by density.
    pub albedo: Option<Arc<AlbedoFunction>>,
}

impl From<Transfer> for Function {
    fn from(transfer: Transfer) -> Self {
        Self { transfer, albedo: None }
    }
}

impl Function {
    /// Returns what the colors are taken for unless it is stated.
    ///
    /// # Errors
    /// The conditions are those of [`Transfer::table`].
    pub fn usual_color(&self) -> Result<TransferColor> {
        Ok(TransferColor::usual(&self.transfer.table()?, self.albedo.is_some()))
    }
}

/// A transfer function read from a file, with its origin.
#[derive(Debug, Clone, PartialEq)]
pub struct Loaded {
    /// Transfer function, with every number checked.
    pub transfer: Transfer,
    /// Albedo by density, if the file states one.
    pub albedo: Option<Arc<AlbedoFunction>>,
    /// Kind of file that held the function.
    pub source: Source,
    /// Name of the function, if it has one; in a VDB that of the grid.
    pub name: Option<String>,
    /// Names of all transfer functions in the file, in file order.
    pub presets: Vec<String>,
    /// Remarks for the user on assumptions that the file does not state.
    pub notes: Vec<String>,
}

impl Loaded {
    /// Returns the function without its origin.
    pub fn function(self) -> Function {
        Function { transfer: self.transfer, albedo: self.albedo }
    }
}

/// Reads a transfer function: a file, whose kind is detected by its content, or where there is no file of that name,
/// the one of `builtins` that the path names.
///
/// # Errors
/// If the file, a preset or a point cannot be used, or an option does not apply to this kind of file. The error names
/// it and the expected value.
pub fn load(path: &Path, options: &Options) -> Result<Loaded> {
    if let Some(name) = name_of(path) {
        let loaded = builtin::load(name, options).unwrap_or_else(|| Err(unnamed(path, name)));
        return loaded.and_then(|loaded| in_range(loaded, options)).map_err(|e| e.at(path));
    }
    let format = registry::sniff(path)?;
    let loaded = match format.kind {
        FileKind::Vdb | FileKind::NanoVdb => carried::load(path, options),
        FileKind::Exr | FileKind::DeepExr | FileKind::Picture(_) | FileKind::Image(_) | FileKind::Mesh(_) => {
            Err(unknown(format.phrase))
        }
        _ if path.is_dir() => Err(unknown("a folder")),
        _ => input::bytes(path, MAX_BYTES, "a transfer function").and_then(|bytes| parse(&bytes, options)),
    };
    loaded.and_then(|loaded| in_range(loaded, options)).map_err(|e| e.at(path))
}

/// Maps a function to the range of the options.
fn in_range(loaded: Loaded, options: &Options) -> Result<Loaded> {
    let Some(range) = options.range else { return Ok(loaded) };
    let moved = |albedo: &Arc<AlbedoFunction>| rescale::albedo_to_range(albedo, &loaded.transfer, range).map(Arc::new);
    let albedo = loaded.albedo.as_ref().map(moved).transpose()?;
    Ok(Loaded { transfer: rescale::to_range(&loaded.transfer, range)?, albedo, ..loaded })
}

/// Returns the path if a function is read from a file there; `None` if it names one of `builtins`.
pub fn file(path: &Path) -> Option<&Path> {
    (!name_of(path).is_some_and(is_builtin)).then_some(path)
}

/// Returns the unit of the densities of the function that a path names; none for a file.
pub(crate) fn unit(path: &Path) -> Option<&'static str> {
    name_of(path).and_then(builtin::unit)
}

/// Returns the word that a path consists of, if it may be a function's name: nothing is there, and it has neither
/// folder nor extension.
fn name_of(path: &Path) -> Option<&str> {
    let name = path.to_str()?;
    let plain = !name.is_empty() && name.chars().all(|c| c.is_alphanumeric() || c == '-' || c == '_');
    (plain && !path.exists()).then_some(name)
}

/// The error for a word that is neither a file nor a function's name.
fn unnamed(path: &Path, name: &str) -> Error {
    let error = Error::io(path, std::io::ErrorKind::NotFound.into())
        .saying(format!("there is neither a file nor a transfer function '{name}'"));
    match &builtin::nearest(name)[..] {
        [] => error.hint("⟨transfer.list⟩ shows the names; check the spelling of a file's path"),
        near => {
            let near: Vec<String> = near.iter().map(|name| format!("'{name}'")).collect();
            error.hint(format!("did you mean {}? ⟨transfer.list⟩ shows all names", near.join(" or ")))
        }
    }
}

fn parse(bytes: &[u8], options: &Options) -> Result<Loaded> {
    // Windows editors put a byte order mark before the text.
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let text = std::str::from_utf8(bytes).map_err(|_| unknown("no text in UTF-8"))?;
    match text.trim_start().as_bytes().first() {
        Some(b'{') => {
            let object = document::object(text, options.limits)?;
            if document::is_ours(&object) {
                document::load(&object, options)
            } else if paraview_json::is_preset(&object) {
                paraview_json::load(vec![object], options)
            } else {
                Err(unknown("a JSON object without 'format' and without 'RGBPoints'"))
            }
        }
        Some(b'[') => paraview_json::load(document::objects(text, options.limits)?, options),
        Some(b'<') => paraview_xml::load(text, options),
        Some(_) if label_table::is_table(text) => label_table::load(text, options),
        Some(_) => Err(unknown("neither JSON nor XML nor a VDB")),
        None => Err(unknown("empty")),
    }
}

fn unknown(what: &str) -> Error {
    Error::unsupported(format!("no transfer function: it is {what}")).hint(
        "a .tf.json, a color map preset of ParaView (JSON or XML), a table of labels (FreeSurfer, 3D Slicer, \
         ITK-SNAP), or a VDB that carries one is expected",
    )
}

/// Refuses options about opacities for files that state extinctions.
fn refuse_opacity_options(options: &Options) -> Result<()> {
    for (given, what) in [(options.unit_distance, "a unit distance"), (options.extinction, "an extinction")] {
        if let Some(value) = given {
            return Err(Error::invalid(format!("{what} of {value} was given, but this file states extinctions"))
                .hint("leave it out: it is for presets of ParaView"));
        }
    }
    Ok(())
}

/// Number of the entry named `wanted`, or of the first if none is wanted.
fn entry_index(names: &[String], wanted: Option<&str>) -> Result<usize> {
    /// Largest number of names that the error message lists.
    const SHOWN: usize = 20;
    let Some(wanted) = wanted else { return Ok(0) };
    names.iter().position(|n| n == wanted).ok_or_else(|| {
        let listed: Vec<String> = names.iter().take(SHOWN).map(|n| format!("'{n}'")).collect();
        let more = if names.len() > SHOWN { format!(" and {} more", names.len() - SHOWN) } else { String::new() };
        Error::invalid(format!("no '{wanted}'; the file has {}{more}", listed.join(", ")))
            .hint("give one of these names, or none for the first")
    })
}
