//! The JSON documents of a Zarr node, in both versions.

use crate::error::{Error, Result};
use crate::formats::input;
use crate::formats::limits::Limits;
use serde_json::Value;
use std::path::Path;

/// Names of the documents.
pub(crate) const NAMES: [&str; 4] = ["zarr.json", ".zarray", ".zattrs", ".zgroup"];
/// Largest document in bytes; images with thousands of wells stay below.
const MOST: u64 = 64 << 20;

/// Metadata and attributes of a group or an array.
#[derive(Debug, Clone)]
pub(crate) struct Document {
    /// 2 or 3.
    pub version: u8,
    /// Metadata of the array; null for a group of version 2.
    pub metadata: Value,
    /// Attributes.
    pub attributes: Value,
}

/// Error about metadata that contradicts the specification.
pub(crate) fn wrong(what: impl Into<String>) -> Error {
    Error::invalid(what).hint("correct the metadata, or write the array again where it was made")
}

/// Reads a JSON document; null if it is not there.
fn json(folder: &Path, name: &str, limits: Limits) -> Result<Value> {
    let path = folder.join(name);
    if !path.is_file() {
        return Ok(Value::Null);
    }
    let bytes = input::bytes(&path, MOST, "metadata of Zarr")?;
    input::check_json_memory(&bytes, limits).map_err(|e| e.at(&path))?;
    serde_json::from_slice(&bytes)
        .map_err(|e| Error::invalid(format!("no valid JSON: {e}")).at(&path).hint(input::JSON_REMEDY))
}

impl Document {
    /// Reads the documents of a folder.
    ///
    /// # Errors
    /// If one cannot be read or is not valid JSON, or is of another version than 2 and 3.
    pub(crate) fn read(folder: &Path, limits: Limits) -> Result<Self> {
        let three = json(folder, NAMES[0], limits)?;
        if !three.is_null() {
            let attributes = three.get("attributes").cloned().unwrap_or_default();
            let document = Self { version: 3, metadata: three, attributes };
            return document.checked().map_err(|e| e.at(folder.join(NAMES[0])));
        }
        let metadata = json(folder, NAMES[1], limits)?;
        let attributes = json(folder, NAMES[2], limits)?;
        Self { version: 2, metadata, attributes }.checked().map_err(|e| e.at(folder.join(NAMES[1])))
    }

    fn checked(self) -> Result<Self> {
        let stated = self.metadata.get("zarr_format");
        if self.metadata.is_null() || stated.and_then(Value::as_u64) == Some(self.version.into()) {
            return Ok(self);
        }
        let stated = stated.map_or_else(|| "missing".to_owned(), Value::to_string);
        Err(wrong(format!("zarr_format is {stated}, {} is expected", self.version)))
    }

    /// True for an array, false for a group.
    pub(crate) fn is_array(&self) -> bool {
        match self.version {
            3 => self.metadata.get("node_type").and_then(Value::as_str) == Some("array"),
            _ => !self.metadata.is_null(),
        }
    }

    /// The list of multiscale images, which NGFF 0.5 puts under `ome`.
    pub(crate) fn multiscales(&self) -> Option<&Vec<Value>> {
        let of = self.attributes.get("ome").unwrap_or(&self.attributes);
        of.get("multiscales")?.as_array().filter(|list| !list.is_empty())
    }
}
