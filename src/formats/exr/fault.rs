//! The `exr` crate's errors in this crate's words.
//!
//! Nothing here catches panics: version 1.74.2 did not panic once in 600 000 reads of 300 000 damaged
//! files of every compression (`tests/exr_damaged.rs` with more rounds). What did end the process, an
//! allocation of petabytes for DWA, is refused before (see `dwa`).

use crate::error::{Error, Result};
use std::path::Path;

/// Runs calls into the `exr` crate.
pub(super) fn translated<T>(path: &Path, calls: impl FnOnce() -> exr::error::Result<T>) -> Result<T> {
    calls().map_err(|e| in_words(path, e))
}

/// The crate's error in ours.
fn in_words(path: &Path, error: exr::error::Error) -> Error {
    use exr::error::Error as Exr;
    match error {
        Exr::NotSupported(what) => Error::unsupported(format!("OpenEXR feature: {what}")).hint(
            "write it as flat scan lines with ZIP compression, e.g. `oiiotool in.exr --compression zip -o out.exr`",
        ),
        // A chunk's offset beyond what the system can seek to: the file's fault, not the disk's.
        Exr::Io(e) if e.kind() == std::io::ErrorKind::InvalidInput => damaged("offset of a chunk out of range"),
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
