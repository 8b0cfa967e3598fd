//! File formats, read and written. No module here knows a renderer.

pub(crate) mod atomic;
pub(crate) mod blosc;
pub mod captures;
pub mod colmap;
pub mod exr;
pub mod imaging;
pub(crate) mod input;
pub mod limits;
pub mod nanovdb;
pub mod npy;
pub mod picture;
pub mod png;
pub(crate) mod problem;
pub(crate) mod protected;
pub(crate) mod reading;
pub mod sample;
pub mod scene_file;
pub mod sequence;
pub(crate) mod temporary;
pub mod transfer;
pub mod transforms;
pub mod usd;
pub mod vdb;
pub(crate) mod video;
pub mod views;

use crate::error::{Code, Error, Result};
use std::io::Read;
use std::path::Path;

/// Format of a file, detected by its first bytes, or that of a folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// An OpenVDB file.
    Vdb,
    /// A NanoVDB file, in memory layout or segmented.
    NanoVdb,
    /// An OpenEXR picture.
    Exr,
    /// A multi-view capture: a JSON object, a file of COLMAP's model, or a folder.
    Capture,
    /// A stage of Universal Scene Description: text, binary or a package.
    Usd,
    /// A file of none of the known formats.
    Unknown,
}

impl Format {
    /// Returns the format in words, with an article.
    pub fn name(self) -> &'static str {
        match self {
            Self::Vdb => "an OpenVDB file",
            Self::NanoVdb => "a NanoVDB file",
            Self::Exr => "an OpenEXR picture",
            Self::Capture => "a capture, a scene file or a folder",
            Self::Usd => "a USD stage",
            Self::Unknown => "a file of no known kind",
        }
    }
}

/// Detects the format by the first bytes; the name matters for COLMAP's models and USD's stages alone. A folder counts
/// as a capture, and its reader decides whether it holds one.
///
/// # Errors
/// If the path is no regular file (a device, a FIFO, a socket), or cannot be read.
pub fn sniff(path: &Path) -> Result<Format> {
    if path.is_dir() {
        return Ok(Format::Capture);
    }
    let file = input::open(path)?;
    // COLMAP's files have no magic number, but fixed names.
    if colmap::is_model_file(path) {
        return Ok(Format::Capture);
    }
    let mut start = Vec::with_capacity(64);
    file.take(64).read_to_end(&mut start).map_err(|e| Error::io(path, e))?;
    let text = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&start);
    Ok(if start.starts_with(b" BDV") {
        Format::Vdb
    } else if start.starts_with(b"NanoVDB") {
        Format::NanoVdb
    } else if start.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
        Format::Exr
    } else if start.starts_with(b"PXR-USDC") || text.starts_with(b"#usda") || usd::is_stage_name(path) {
        Format::Usd
    } else if text.iter().find(|b| !b.is_ascii_whitespace()).is_some_and(|b| *b == b'{') {
        Format::Capture
    } else {
        Format::Unknown
    })
}

/// Returns the error for a file of [`Format::Unknown`]: what it is, if a conversion leads on.
pub fn unknown(path: &Path) -> Error {
    match imaging::format::sniff(path) {
        Ok(Some(format)) => Error::unsupported(format!("this is {}, and this command reads OpenVDB", format.name()))
            .hint("convert it first: cumulo convert IN OUT.vdb; cumulo info lists what it holds"),
        _ => Error::unsupported("no file of a known kind").hint(
            "OpenVDB and OpenEXR files and USD stages are understood, and captures: a transforms.json, a model of \
             COLMAP, or the folder that holds one; grids of NIfTI, NRRD, MetaImage, TIFF, VTK and NumPy become an \
             OpenVDB file with cumulo convert",
        ),
    }
    .coded(Code::UnknownFormat)
    .at(path)
}
