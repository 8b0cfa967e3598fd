//! Files in and out. Nothing here knows a renderer.

pub mod atomic;
pub mod exr;
pub mod png;
pub mod problem;
pub mod transforms;
pub mod vdb;

use crate::error::{Error, Result};
use std::io::Read;
use std::path::Path;

/// What a file is, by its first bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// OpenVDB.
    Vdb,
    /// NanoVDB, in memory layout or segmented file.
    NanoVdb,
    /// OpenEXR.
    Exr,
    /// JSON: an object or an array.
    Json,
    /// None of these.
    Unknown,
}

/// Looks at the first bytes; the name's extension does not matter.
///
/// # Errors
/// If the file cannot be read.
pub fn sniff(path: &Path) -> Result<Format> {
    let mut start = Vec::with_capacity(64);
    let file = std::fs::File::open(path).map_err(|e| Error::io(path, e))?;
    file.take(64).read_to_end(&mut start).map_err(|e| Error::io(path, e))?;
    let text = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&start);
    Ok(if start.starts_with(b" BDV") {
        Format::Vdb
    } else if start.starts_with(b"NanoVDB") {
        Format::NanoVdb
    } else if start.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
        Format::Exr
    } else if text.iter().find(|b| !b.is_ascii_whitespace()).is_some_and(|b| b"{[".contains(b)) {
        Format::Json
    } else {
        Format::Unknown
    })
}
