//! Keeps the `exr` crate's panics on damaged files inside, and its errors in this crate's words.
//!
//! Measured with version 1.74.2: of damaged files with PIZ, B44, DWA or tiles, some panic in the crate's
//! decoders (slices out of range, `unwrap` on sizes). They are damaged files, so they are reported as such.

use crate::error::{Error, Result};
use std::cell::Cell;
use std::panic::AssertUnwindSafe;
use std::path::Path;
use std::sync::Once;

thread_local! {
    /// Set while a contained call runs on this thread: its panics are not printed.
    static CONTAINED: Cell<bool> = const { Cell::new(false) };
}

/// Runs a call into the `exr` crate; a panic becomes an error. What the call borrowed mutably must
/// be dropped after an error.
pub(super) fn contained<T>(path: &Path, call: impl FnOnce() -> exr::error::Result<T>) -> Result<T> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let earlier = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            if !CONTAINED.get() {
                earlier(info);
            }
        }));
    });
    let outer = CONTAINED.replace(true);
    let result = std::panic::catch_unwind(AssertUnwindSafe(call));
    CONTAINED.set(outer);
    match result {
        Ok(result) => result.map_err(|e| translated(path, e)),
        Err(_) => Err(damaged("its pixels cannot be decoded").at(path)),
    }
}

/// The crate's error in ours.
fn translated(path: &Path, error: exr::error::Error) -> Error {
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
