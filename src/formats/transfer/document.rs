//! Cumulo's JSON format of transfer functions, read and written.

use super::{Function, Loaded, Options, Source, entry_index, refuse_opacity_options};
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::{atomic, input};
use crate::scene::albedo::AlbedoFunction;
use crate::scene::transfer::Transfer;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use serde_json::value::RawValue;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// Value of the key `format`.
pub const FORMAT: &str = "cumulo-transfer-function";
/// Values of the key `version`, of functions without an albedo of their own and of those with one; other versions are
/// refused.
const VERSIONS: [u32; 2] = [1, 2];

/// Advice on the entries of a transfer function.
pub(super) const ENTRIES: &str =
    "densities must ascend (two alike make a step), colors and extinctions be finite and not negative";

/// A JSON object whose values are parsed on access.
pub(super) type Object<'a> = BTreeMap<String, &'a RawValue>;

#[derive(Serialize)]
struct Document<'a> {
    format: &'static str,
    version: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    name: Option<&'a str>,
    transfer: &'a Transfer,
    #[serde(skip_serializing_if = "Option::is_none")]
    albedo: Option<Points>,
    #[serde(skip_serializing_if = "Option::is_none")]
    provenance: Option<&'a Value>,
}

/// Albedo of a document.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Points {
    /// Density, then red, green and blue.
    points: Vec<[f64; 4]>,
}

impl<'a> Document<'a> {
    /// Returns the document of a function without name and provenance.
    fn of(transfer: &'a Transfer, albedo: Option<&AlbedoFunction>) -> Self {
        let version = VERSIONS[usize::from(albedo.is_some())];
        let albedo = albedo.map(|albedo| Points { points: albedo.points() });
        Self { format: FORMAT, version, name: None, transfer, albedo, provenance: None }
    }
}

/// Writes a `.tf.json` from which [`load`](super::load()) returns the same bits.
///
/// # Errors
/// If the function cannot be used, or the file cannot be written.
pub fn save(path: &Path, transfer: &Transfer, name: Option<&str>, provenance: Option<&Value>) -> Result<()> {
    save_function(path, (transfer, None), name, provenance)
}

/// Writes a `.tf.json` as [`save`] does, with the albedo of the function if it has one of its own.
///
/// # Errors
/// As of [`save`].
pub fn save_function(
    path: &Path,
    (transfer, albedo): (&Transfer, Option<&AlbedoFunction>),
    name: Option<&str>,
    provenance: Option<&Value>,
) -> Result<()> {
    transfer.clone().checked().map_err(|e| e.at(path).hint(ENTRIES))?;
    let document = Document { name, provenance, ..Document::of(transfer, albedo) };
    let mut text = serde_json::to_string_pretty(&document)
        .map_err(|e| Error::invalid(format!("no JSON can be made of it: {e}")).at(path).hint("report this as a bug"))?;
    text.push('\n');
    atomic::write_bytes(path, text.as_bytes())
}

/// Document of a transfer function on one line, without name and provenance.
pub(super) fn compact(Function { transfer, albedo }: &Function) -> String {
    let document = Document::of(transfer, albedo.as_deref());
    // A document of numbers and fixed keys can always be written.
    serde_json::to_string(&document).unwrap_or_default()
}

pub(super) fn object(text: &str, limits: Limits) -> Result<Object<'_>> {
    input::check_json_memory(text.as_bytes(), limits)?;
    serde_json::from_str(text).map_err(|e| no_json(&e))
}

pub(super) fn objects(text: &str, limits: Limits) -> Result<Vec<Object<'_>>> {
    input::check_json_memory(text.as_bytes(), limits)?;
    let raw: Vec<&RawValue> = serde_json::from_str(text).map_err(|e| no_json(&e))?;
    raw.into_iter()
        .enumerate()
        .map(|(i, raw)| {
            serde_json::from_str(raw.get()).map_err(|_| {
                Error::invalid(format!("{} is not a JSON object", short(raw.get())))
                    .part(format!("preset {}", i + 1))
                    .hint("a list of presets holds objects: [{\"Name\": …, \"RGBPoints\": […]}]")
            })
        })
        .collect()
}

fn no_json(error: &serde_json::Error) -> Error {
    Error::invalid(format!("no valid JSON: {error}")).hint(input::JSON_REMEDY)
}

/// Value of a key; `None` if the key is absent or its value is `null`. `expected` names the type for the error message.
pub(super) fn value<T: DeserializeOwned>(object: &Object, key: &str, expected: &str) -> Result<Option<T>> {
    let Some(raw) = object.get(key) else { return Ok(None) };
    serde_json::from_str(raw.get()).map_err(|_| {
        Error::invalid(format!("'{key}' is {}; {expected} is expected", short(raw.get())))
            .hint(format!("correct '{key}', or write the file again where it was made"))
    })
}

pub(super) fn is_ours(object: &Object) -> bool {
    object.contains_key("format") || object.contains_key("transfer")
}

pub(super) fn load(object: &Object, options: &Options) -> Result<Loaded> {
    refuse_opacity_options(options)?;
    let Function { transfer, albedo } = function(object)?;
    let name: Option<String> = value(object, "name", "a text")?;
    let presets: Vec<String> = name.iter().cloned().collect();
    if options.preset.is_some() && presets.is_empty() {
        return Err(Error::invalid("a name was asked for, but the one transfer function in this file has none")
            .hint("leave the name out"));
    }
    entry_index(&presets, options.preset.as_deref())?;
    Ok(Loaded { transfer, albedo, source: Source::Cumulo, name, presets, notes: Vec::new() })
}

/// Transfer function of a document, whose format and version must be [`FORMAT`] and one of [`VERSIONS`].
pub(super) fn function(object: &Object) -> Result<Function> {
    let format: Option<Value> = value(object, "format", "a text")?;
    if format != Some(FORMAT.into()) {
        let found = format.map_or_else(|| "missing".to_owned(), |v| short(&v.to_string()));
        return Err(Error::unsupported(format!("'format' is {found}; \"{FORMAT}\" is expected")).hint(format!(
            "write \"format\": \"{FORMAT}\" if the file is a .tf.json; `cumulo transfer` writes such files"
        )));
    }
    let version: Option<Value> = value(object, "version", "a whole number")?;
    let [plain, with_albedo] = VERSIONS;
    let Some(known) = VERSIONS.into_iter().find(|known| version == Some((*known).into())) else {
        let found = version.map_or_else(|| "missing".to_owned(), |v| short(&v.to_string()));
        return Err(Error::unsupported(format!("'version' is {found}; {plain} or {with_albedo} is expected")).hint(
            format!("write the file again as version {plain}; a newer version of this program may read it as it is"),
        ));
    };
    let raw = object.get("transfer").ok_or_else(|| {
        Error::invalid("no key 'transfer'").hint("it holds the function: {\"kind\": \"piecewise\", \"points\": …}")
    })?;
    let transfer: Transfer = serde_json::from_str(raw.get()).map_err(|e| {
        Error::invalid(format!("'transfer' cannot be used: {e}")).hint(
            "its 'kind' is texture (domain, texels), piecewise (points), gaussians (domain, lobes), identity (domain, \
             color) or labels (classes)",
        )
    })?;
    let transfer = transfer.checked().map_err(|e| e.part("'transfer'").hint(ENTRIES))?;
    let albedo = if known == with_albedo { albedo(object)? } else { None };
    Ok(Function { transfer, albedo })
}

/// Albedo of a document, if it states one.
fn albedo(object: &Object) -> Result<Option<Arc<AlbedoFunction>>> {
    let expected = "an object such as {\"points\": [[0, 0.8, 0.5, 0.4], [1, 0.9, 0.9, 0.9]]}";
    let Some(Points { points }) = value(object, "albedo", expected)? else { return Ok(None) };
    let advice = "densities must ascend (two alike make a step), and albedos lie between 0 and 1";
    AlbedoFunction::new(&points).map(|albedo| Some(Arc::new(albedo))).map_err(|e| e.part("'albedo'").instead(advice))
}

/// Text shortened for an error message.
pub(super) fn short(text: &str) -> String {
    if text.chars().count() <= 60 { text.to_owned() } else { text.chars().take(57).chain("...".chars()).collect() }
}
