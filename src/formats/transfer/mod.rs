//! Transfer functions in files: our own `.tf.json`, ParaView's presets, and the metadata of a VDB.
//!
//! Ours: `{"format": "cumulo-transfer-function", "version": 1, "name": …, "transfer": {"kind": …}, "provenance": {…}}`,
//! `transfer` being [`Transfer`] as it stands: densities, scene-linear radiances of the source, extinction per
//! world unit of length. `name` and `provenance` may be absent; other keys at the top are ignored.
//!
//! ParaView's presets, in JSON (`RGBPoints`, `Points`, `ColorSpace`, `HSVWrap`, `Name`; one object or a list) and
//! in XML (`ColorMaps`, `ColorMap`, `Point`), become points:
//! - Colors there are display-referred sRGB, from 0 to 1, and are interpolated as such or in another space;
//!   they are sampled densely, and made scene-linear. Between the samples a color is off by 2e-4 at most (4e-3
//!   where a mixture in Lab leaves what a display can show).
//! - Opacity α is that of a layer one unit distance `u` thick: extinction is `-ln(1 - α) / u`. As no extinction is
//!   infinite, α above [`MOST_OPACITY`] counts as that.
//! - Without opacities, extinction rises linearly from 0 at the first color to [`Options::extinction`] at the last.
//!
//! A VDB grid carries a transfer function as the text of our JSON under the key [`METADATA_KEY`].

mod carried;
mod color;
mod document;
mod opacity;
mod paraview;
mod paraview_json;
mod paraview_xml;
mod rescale;
mod summary;

pub use carried::{METADATA_KEY, from_metadata, to_metadata};
pub use document::{FORMAT, VERSION, save};
pub use paraview::MOST_OPACITY;
pub use summary::TransferSummary;

use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::{Format, input, sniff};
use crate::scene::transfer::Transfer;
use serde::Serialize;
use std::path::Path;

/// Larger files are no transfer functions: one with as many points as there can be takes less.
const MAX_BYTES: u64 = 1 << 25;

/// What to make of a file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Options {
    /// Which of several: the preset of that name, in a VDB the grid's; the first unless given.
    pub preset: Option<String>,
    /// Densities that the first and last of the file's are mapped to; its own unless given.
    pub range: Option<[f64; 2]>,
    /// World length that the opacities of a preset are for; 1 unless given.
    pub unit_distance: Option<f64>,
    /// Extinction at the end of a preset without opacities, per world unit; 1 unless given.
    pub extinction: Option<f64>,
    /// Memory that the file's content may take.
    pub limits: Limits,
}

/// What a file was.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Source {
    /// Our `.tf.json`.
    Cumulo,
    /// Presets of ParaView in JSON.
    ParaviewJson,
    /// Presets of ParaView in XML.
    ParaviewXml,
    /// Metadata of a VDB's grid.
    Vdb,
}

/// A transfer function from a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Loaded {
    /// The function, checked.
    pub transfer: Transfer,
    /// What kind of file it came from.
    pub source: Source,
    /// Its own name, where it has one; in a VDB the grid's.
    pub name: Option<String>,
    /// Names of all that the file holds, in its order.
    pub presets: Vec<String>,
    /// What was done that the file does not say, for people.
    pub notes: Vec<String>,
}

/// Reads a transfer function. What the file is, its content tells, not its name.
///
/// # Errors
/// Names the file, the preset and the point that cannot be used, what was expected, and options that
/// do not apply to such a file.
pub fn load(path: &Path, options: &Options) -> Result<Loaded> {
    let loaded = match sniff(path)? {
        Format::Vdb | Format::NanoVdb => carried::load(path, options),
        Format::Exr => Err(unknown("an OpenEXR picture")),
        _ if path.is_dir() => Err(unknown("a folder")),
        _ => input::bytes(path, MAX_BYTES, "a transfer function").and_then(|bytes| parse(&bytes, options)),
    };
    let loaded = loaded.map_err(|e| e.at(path))?;
    let Some(range) = options.range else { return Ok(loaded) };
    let transfer = rescale::to_range(&loaded.transfer, range).map_err(|e| e.at(path))?;
    Ok(Loaded { transfer, ..loaded })
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
        Some(_) => Err(unknown("neither JSON nor XML nor a VDB")),
        None => Err(unknown("empty")),
    }
}

fn unknown(what: &str) -> Error {
    Error::unsupported(format!("no transfer function: it is {what}"))
        .hint("a .tf.json, a color map preset of ParaView (JSON or XML), or a VDB that carries one is expected")
}

/// Refuses options that speak of opacities where the file states extinctions.
fn refuse_opacity_options(options: &Options) -> Result<()> {
    for (given, what) in [(options.unit_distance, "a unit distance"), (options.extinction, "an extinction")] {
        if let Some(value) = given {
            return Err(Error::invalid(format!("{what} of {value} was given, but this file states extinctions"))
                .hint("leave it out: it is for presets of ParaView"));
        }
    }
    Ok(())
}

/// Number of the one that is wanted: that of the name, or the first.
fn chosen(names: &[String], wanted: Option<&str>) -> Result<usize> {
    /// More names than these would fill the terminal.
    const SHOWN: usize = 20;
    let Some(wanted) = wanted else { return Ok(0) };
    names.iter().position(|n| n == wanted).ok_or_else(|| {
        let listed: Vec<String> = names.iter().take(SHOWN).map(|n| format!("'{n}'")).collect();
        let more = if names.len() > SHOWN { format!(" and {} more", names.len() - SHOWN) } else { String::new() };
        Error::invalid(format!("no '{wanted}'; the file has {}{more}", listed.join(", ")))
            .hint("give one of these names, or none for the first")
    })
}
