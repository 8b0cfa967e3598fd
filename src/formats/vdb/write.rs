//! Writing of VDB files, which appear whole or not at all.

use super::ffi;
use super::file::File;
use super::meta::Meta;
use super::native::NativeGrid;
use super::preflight;
use crate::error::{Error, Result};
use crate::formats::atomic::Draft;
use crate::formats::limits::Limits;
use crate::scene::grid::{Grid, MetaValue};
use std::collections::BTreeMap;
use std::os::fd::AsRawFd;
use std::path::Path;

/// Compression of the values. `ZIP` is left out, because OpenVDB drops it silently for the classes written here.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Codec {
    /// Blosc compression: fast, with smaller files.
    #[default]
    Blosc,
    /// No compression: active values as they are.
    None,
}

/// Writes native grids. Names that repeat get OpenVDB's suffixes. The file's metadata is that of `source`, if given,
/// overridden by `metadata`. The written file is checked before it replaces an older one.
///
/// # Errors
/// If OpenVDB or the operating system reports an error, or the written file does not read back. The error has the path
/// and, where space is short, the length needed. Nothing is left behind then, and an older file stays.
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
    let mut draft = Draft::begin(path)?;
    let (fd, mut length) = (draft.file().as_raw_fd(), 0);
    // SAFETY: the descriptor is open, `length` a valid place, and all handles outlive the call.
    let written =
        ffi::call(|s| unsafe { ffi::write(fd, handles.as_ptr(), handles.len(), meta.as_ptr(), codec, &mut length, s) });
    written.map_err(|e| match e.os_error() {
        Some(number) => draft.unwritten(std::io::Error::from_raw_os_error(number), length),
        None => e.at(path),
    })?;
    verify(&draft, grids.len()).map_err(|e| {
        Error::native(format!("what was written does not read back: {}", e.what()))
            .at(path)
            .hint("nothing was changed; check the disk and its free space, then try again")
    })?;
    draft.commit()
}

/// Checks the written file as any file that is read, before it replaces an older one.
fn verify(draft: &Draft, grids: usize) -> Result<()> {
    let found = preflight::check(draft.path(), &Limits { max_memory: u64::MAX })?.entries.len();
    if found == grids { Ok(()) } else { Err(Error::native(format!("{found} of {grids} grids are there"))) }
}

/// Writes scalar grids as 32-bit floats, or as 16-bit floats if `half` is set.
///
/// # Errors
/// The conditions are those of [`NativeGrid::from_grid`] and [`write_native`].
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
