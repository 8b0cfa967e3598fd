//! VDB files out: whole or not at all.

use super::ffi;
use super::file::File;
use super::meta::Meta;
use super::native::NativeGrid;
use crate::error::Result;
use crate::formats::atomic;
use crate::scene::grid::{Grid, MetaValue};
use std::collections::BTreeMap;
use std::path::Path;

/// How values are packed. (`ZIP` is left out: OpenVDB drops it silently for the classes we write.)
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Codec {
    /// Blosc: fast, smaller.
    #[default]
    Blosc,
    /// Active values as they are.
    None,
}

/// Writes native grids. Names that repeat get OpenVDB's suffixes. The file metadata is that of
/// `source`, if given, with `metadata` on top.
///
/// # Errors
/// OpenVDB's own words or the operating system's, with the path; nothing is left behind then.
pub fn write_native(
    path: &Path,
    grids: &[&NativeGrid],
    source: Option<&File>,
    metadata: &BTreeMap<String, MetaValue>,
    codec: Codec,
) -> Result<()> {
    let mut meta = match source {
        Some(file) => file.native_metadata()?,
        None => Meta::new()?,
    };
    for (name, value) in metadata {
        meta.set(name, value)?;
    }
    let handles: Vec<*const ffi::RawGrid> = grids.iter().map(|g| g.as_ptr().cast_const()).collect();
    let codec = i32::from(codec == Codec::Blosc);
    atomic::write(path, |temporary| {
        let name = ffi::c_path(temporary)?;
        // SAFETY: the path is NUL-terminated, and all handles outlive the call.
        ffi::call(|s| unsafe { ffi::write(name.as_ptr(), handles.as_ptr(), handles.len(), meta.as_ptr(), codec, s) })
    })
}

/// Writes scalar grids as float, or as half where `half` is set.
///
/// # Errors
/// As [`NativeGrid::from_grid`] and [`write_native`].
pub fn write_grids(
    path: &Path,
    grids: &[&Grid],
    metadata: &BTreeMap<String, MetaValue>,
    codec: Codec,
    half: bool,
) -> Result<()> {
    let mut native = Vec::with_capacity(grids.len());
    for grid in grids {
        let mut n = NativeGrid::from_grid(grid)?;
        n.set_half(half)?;
        native.push(n);
    }
    write_native(path, &native.iter().collect::<Vec<_>>(), None, metadata, codec)
}
