//! Keeps the `exr` crate's panics on damaged files inside, and its errors in this crate's words.

use crate::error::{Error, Result};
use std::path::Path;

/// Runs a call into the `exr` crate.
pub(super) fn contained<T>(path: &Path, call: impl FnOnce() -> exr::error::Result<T>) -> Result<T> {
    call().map_err(|e| translated(path, e))
}

/// The crate's error in ours.
pub(super) fn translated(path: &Path, error: exr::error::Error) -> Error {
    use exr::error::Error as Exr;
    match error {
        Exr::NotSupported(what) => Error::unsupported(format!("OpenEXR feature: {what}")).hint(
            "write it as flat scan lines with ZIP compression, e.g. `oiiotool in.exr --compression zip -o out.exr`",
        ),
        Exr::Io(e) => Error::io(path, e),
        Exr::Invalid(what) => damaged(&what),
        Exr::Aborted => Error::cancelled(),
    }
    .at(path)
}

/// The file contradicts its format.
pub(super) fn damaged(what: &str) -> Error {
    Error::invalid(format!("damaged or incomplete OpenEXR file: {what}")).hint("render or copy the file again")
}

/// More samples than memory should be asked for.
pub(super) fn too_large(window: super::Window, channels: usize) -> Error {
    Error::unsupported(format!("{channels} channels of {window} are too many to hold at once"))
        .hint("name the layer that is wanted")
}
