//! OpenVDB files through OpenVDB's own library.
//!
//! ```text
//! preflight (Rust: every offset and length) ──▶ File ──▶ NativeGrid ──▶ scene::grid::Grid
//!                                               write ◀── edits ◀───────┘
//! ```
//! [`NativeGrid`] holds any grid type and passes it through untouched; [`Grid`] is the scalar copy
//! that the rest of the program works on.
//!
//! The C++ side is reached through `shim.h`, whose every entry stops exceptions. Opening never
//! defers loading: on damaged files OpenVDB's delayed reader ends in signals.

#![allow(unsafe_code)]

mod cursor;
mod ffi;
mod file;
mod load;
mod meta;
mod native;
pub mod preflight;
pub mod shaded;
mod topology;
mod write;

pub use file::{CONFIDENCE, File};
pub use native::{GridInfo, NativeGrid, RawGrid, RawLeaf, RawTile, Transform, writable};
pub use preflight::Limits;
pub use topology::Topology;
pub use write::{Codec, write_grids, write_native};

use crate::error::{Error, Result};
use crate::scene::grid::{Grid, GridClass};

/// Refuses grids that are no density: level sets hold distances, staggered grids velocities.
///
/// # Errors
/// Says what the grid is and how to turn it into fog.
pub fn require_fog(grid: &Grid) -> Result<()> {
    let (what, hint) = match grid.class {
        GridClass::FogVolume | GridClass::Unknown => return Ok(()),
        GridClass::LevelSet => (
            "a level set (signed distances)",
            "convert it first: vdb_tool -read IN.vdb -ls2fog -write OUT.vdb, or Houdini's Convert VDB to Fog VDB",
        ),
        GridClass::Staggered => {
            ("a staggered velocity grid", "name the density with --grid; cumulo info lists the grids")
        }
    };
    Err(Error::unsupported(format!("the grid is {what}, a fog volume is needed"))
        .part(format!("grid '{}'", grid.name))
        .hint(hint))
}
