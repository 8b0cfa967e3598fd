//! Transfer functions in the metadata of a VDB's grids.

use super::{Function, Loaded, MAX_BYTES, Options, Source, document, entry_index, refuse_opacity_options};
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::vdb::File;
use crate::scene::grid::MetaValue;
use crate::scene::transfer::Transfer;
use std::collections::BTreeMap;
use std::path::Path;

/// Metadata key of a grid's transfer function.
pub const METADATA_KEY: &str = "cumulo_transfer";

const ATTACH: &str = "⟨convert.tf=FILE⟩ attaches one";

/// Metadata value of a transfer function, to be stored under [`METADATA_KEY`].
pub(crate) fn to_metadata(function: &Function) -> MetaValue {
    MetaValue::Text(document::compact(function))
}

/// Transfer function in a grid's metadata, if there is one, without the albedo that it may state.
///
/// # Errors
/// If the entry exists, but is no transfer function that can be used.
pub fn from_metadata(metadata: &BTreeMap<String, MetaValue>) -> Result<Option<Transfer>> {
    function_from_metadata(metadata).map(|function| function.map(|function| function.transfer))
}

/// Transfer function in a grid's metadata, if there is one.
///
/// # Errors
/// If the entry exists, but is no transfer function that can be used.
pub(crate) fn function_from_metadata(metadata: &BTreeMap<String, MetaValue>) -> Result<Option<Function>> {
    let parsed =
        match metadata.get(METADATA_KEY) {
            None => return Ok(None),
            Some(MetaValue::Text(text)) => checked(text),
            Some(other) => Err(Error::invalid(format!("{other:?} is no text"))
                .hint("attach the function again with ⟨convert.tf=FILE⟩")),
        };
    // The remedies of the document reader are replaced: nobody edits the metadata of a VDB by hand.
    parsed.map(Some).map_err(|e| {
        e.inside(format!("metadata '{METADATA_KEY}'")).instead("⟨convert.tf=FILE⟩ replaces it with another function")
    })
}

fn checked(text: &str) -> Result<Function> {
    if text.len() as u64 > MAX_BYTES {
        return Err(Error::invalid(format!("a text of {} bytes is no transfer function", text.len())).hint(ATTACH));
    }
    document::function(&document::object(text, Limits::default())?)
}

pub(super) fn load(path: &Path, options: &Options) -> Result<Loaded> {
    refuse_opacity_options(options)?;
    let file = File::open(path, options.limits)?;
    let mut all = Vec::new();
    for entry in file.entries() {
        let metadata = file.read(&entry.name)?.metadata()?;
        if metadata.contains_key(METADATA_KEY) {
            all.push((entry.name.clone(), metadata));
        }
    }
    let presets: Vec<String> = all.iter().map(|(name, _)| name.clone()).collect();
    if presets.is_empty() {
        return Err(Error::invalid("none of the grids carries a transfer function").hint(ATTACH));
    }
    let (name, metadata) = all.swap_remove(entry_index(&presets, options.preset.as_deref())?);
    let Function { transfer, albedo } = function_from_metadata(&metadata)
        .map_err(|e| e.inside(format!("grid '{name}'")))?
        .ok_or_else(|| Error::invalid("no transfer function").part(format!("grid '{name}'")).hint(ATTACH))?;
    Ok(Loaded { transfer, albedo, source: Source::Vdb, name: Some(name), presets, notes: Vec::new() })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use crate::scene::albedo::AlbedoFunction;
    use std::sync::Arc;

    #[test]
    fn metadata_gives_back_the_same_bits() {
        let transfer =
            Transfer::Piecewise { points: vec![[0.1, 1.0 / 3.0, 0.0, 2e-17, 7.0], [0.7, 0.5, 1.0, 0.0, 0.0]] };
        let mut all = BTreeMap::new();
        assert_eq!(from_metadata(&all).unwrap(), None);
        all.insert(METADATA_KEY.into(), to_metadata(&transfer.clone().into()));
        assert!(matches!(&all[METADATA_KEY], MetaValue::Text(text) if text.contains("\"version\":1")), "{all:?}");
        assert_eq!(from_metadata(&all).unwrap(), Some(transfer.clone()));
        let albedo = AlbedoFunction::new(&[[0.1, 1.0 / 3.0, 0.0, 1.0], [0.7, 2e-17, 0.5, 0.25]]).unwrap();
        let function = Function { transfer, albedo: Some(Arc::new(albedo)) };
        all.insert(METADATA_KEY.into(), to_metadata(&function));
        assert_eq!(function_from_metadata(&all).unwrap(), Some(function));
    }

    #[test]
    fn unusable_metadata_is_refused_by_name() {
        for (value, word) in [
            (MetaValue::Int(3), "no text"),
            (MetaValue::Text("{".into()), "no valid JSON"),
            (MetaValue::Text(r#"{"format":"cumulo-transfer-function","version":3}"#.into()), "'version' is 3"),
        ] {
            let error = from_metadata(&[(METADATA_KEY.to_owned(), value)].into()).unwrap_err().to_string();
            assert!(error.contains(word) && error.contains("cumulo_transfer"), "{error}");
        }
    }
}
