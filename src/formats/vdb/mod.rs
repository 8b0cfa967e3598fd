//! OpenVDB files, read and written with OpenVDB's own library.
//!
//! ```text
//! preflight (Rust: every offset and length) ──▶ File ──▶ NativeGrid ──▶ scene::grid::Grid
//!                                               write ◀── edits ◀───────┘
//! ```
//! OpenVDB reads no file: it decodes bytes in memory that were checked there, so that a file that others write to
//! meanwhile cannot mislead it.
//!
//! [`NativeGrid`] holds any grid type and passes it through untouched; [`Grid`] is the scalar copy
//! that the rest of the program works on.
//!
//! The C++ side is reached through `shim.h`, none of whose functions lets an exception through. Opening never defers
//! loading, because OpenVDB's delayed reader ends in signals on damaged files.

#![allow(unsafe_code)]

mod cursor;
mod dense;
mod edit;
mod excerpt;
mod ffi;
mod file;
pub mod helper;
mod load;
pub(crate) mod made;
mod meta;
mod native;
pub mod preflight;
pub mod shaded;
mod source;
mod surface;
mod topology;
pub(crate) mod up;
pub(crate) mod vector_kind;
pub(crate) mod velocity;
mod write;

pub use dense::{DenseBox, ValueKind};
pub(crate) use edit::{HALF_WIDTH, ResampleFilter};
pub(crate) use excerpt::try_grid;
pub(crate) use file::CONFIDENCE;
pub use file::File;
pub(crate) use native::{GridInfo, RawGrid, Transform};
pub use native::{NativeGrid, RawLeaf, RawTile, writable};
pub use write::{Codec, write_grids, write_native};

use crate::error::{Error, Result};
use crate::scene::grid::{Grid, GridClass};
use std::ffi::CStr;
use std::sync::OnceLock;

static END: OnceLock<fn(&str) -> !> = OnceLock::new();

/// Calls `end` with a description instead of aborting where OpenVDB throws and nobody can catch it: in destructors and
/// on its own threads. Only the first call counts.
pub(crate) fn on_terminate(end: fn(&str) -> !) {
    extern "C" fn called(what: *const std::ffi::c_char) {
        // SAFETY: the shim hands over a NUL-terminated text that lives until this returns, which it does not.
        let what = if what.is_null() { Vec::new() } else { unsafe { CStr::from_ptr(what) }.to_bytes().to_vec() };
        if let Some(end) = END.get() {
            end(&ffi::printable(&what));
        }
    }
    let _ = END.set(end);
    // SAFETY: the handler is a function, which lives as long as the program.
    unsafe { ffi::on_terminate(Some(called)) }
}

/// Returns the version of OpenVDB, such as `10.0.1`.
pub(crate) fn version() -> String {
    // SAFETY: the shim returns a NUL-terminated constant.
    let version = unsafe { CStr::from_ptr(ffi::version()) };
    ffi::printable(version.to_bytes())
}

/// Refuses grids that are no density: level sets hold distances, staggered grids velocities.
///
/// # Errors
/// If the grid is one of these; the error says which, and how to obtain a fog volume.
pub(crate) fn require_fog(grid: &Grid) -> Result<()> {
    let (what, hint) = match grid.class {
        GridClass::FogVolume | GridClass::Unknown => return Ok(()),
        GridClass::LevelSet => {
            ("a level set (signed distances)", "convert it to a fog volume first with ⟨convert.to=fog⟩")
        }
        GridClass::Staggered => {
            ("a staggered velocity grid", "name the density with ⟨grid⟩; cumulo info lists the grids")
        }
    };
    Err(Error::unsupported(format!("the grid is {what}, a fog volume is needed"))
        .part(format!("grid '{}'", grid.name))
        .hint(hint))
}
