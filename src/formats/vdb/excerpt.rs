//! Parts of a file as a file of their own in memory: its metadata, and one of its grids. OpenVDB's own reader decodes
//! what cannot be decoded leaf by leaf (points, shared trees, old files), and a helper process can try the very same
//! bytes.

use super::ffi;
use super::meta::Meta;
use super::native::NativeGrid;
use super::preflight::{self, Entry, Preflight, Span};
use super::source::{Source, changed};
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use std::path::Path;
use std::ptr::null_mut;

/// A file in memory, all of whose skeleton was checked there.
pub(super) struct Excerpt {
    pub(super) bytes: Vec<u8>,
}

impl Excerpt {
    /// Reads the head of a file, with its metadata, and grids of it, of which the last one may share the tree of
    /// another.
    ///
    /// # Errors
    /// If the parts do not fit into the limits, cannot be read, or are no longer what was checked.
    pub(super) fn read(source: &Source, from: &Preflight, grids: &[&Entry], limits: &Limits) -> Result<Self> {
        let bytes = |grid: &&Entry| grid.file_bytes.saturating_add(grid.topology.map_or(0, |t| t.memory));
        let needed = grids.iter().map(bytes).fold(from.head, u64::saturating_add);
        if needed > limits.max_memory {
            let what = format!("the grid needs {needed} bytes, packed and unpacked, {} are allowed", limits.max_memory);
            return Err(Error::unsupported(what).hint(
                "allow more memory if the file is to be trusted, or write less into one grid where it was made",
            ));
        }
        let mut bytes = source.range(0, from.head)?;
        bytes.extend((grids.len() as i32).to_le_bytes());
        for grid in grids {
            append(&mut bytes, source, grid, grids)?;
        }
        let found = preflight::in_memory(&bytes, &source.path, limits).map_err(|e| changed(&e.what()))?;
        let same = |(a, b): (&Entry, &&Entry)| a.topology == b.topology && a.fully_checked == b.fully_checked;
        if found.version != from.version || !found.entries.iter().zip(grids).all(same) {
            return Err(changed("the tree is another one"));
        }
        Ok(Self { bytes })
    }

    /// Decodes the metadata of the file as a whole.
    pub(super) fn metadata(&self) -> Result<Meta> {
        let mut raw = null_mut();
        // SAFETY: the bytes outlive the call, and `raw` is a valid place for the handle.
        ffi::call(|s| unsafe { ffi::file_meta(self.bytes.as_ptr(), self.bytes.len(), &mut raw, s) })?;
        // SAFETY: fresh from the shim.
        unsafe { Meta::own(raw) }.ok_or_else(|| Error::native("no metadata handle"))
    }

    /// Decodes the last grid, which `name` is the name of.
    pub(super) fn grid(&self, name: &str) -> Result<NativeGrid> {
        let mut raw = null_mut();
        // SAFETY: the bytes outlive the call, and `raw` is a valid place for the handle.
        ffi::call(|s| unsafe { ffi::file_grid(self.bytes.as_ptr(), self.bytes.len(), &mut raw, s) })?;
        // SAFETY: fresh from the shim.
        unsafe { NativeGrid::own(raw, name.to_owned()) }
    }
}

/// Appends the descriptor and the content of a grid, whose offsets follow from where it comes to lie.
fn append(bytes: &mut Vec<u8>, source: &Source, grid: &Entry, all: &[&Entry]) -> Result<()> {
    // Names are of no matter here: the number of the grid stands for its name.
    let named = |name: &str| all.iter().position(|e| e.name == name).map(|n| n.to_string()).unwrap_or_default();
    let half = if grid.half { "_HalfFloat" } else { "" };
    let parent = grid.instance_of.as_deref().map(named).unwrap_or_default();
    for text in [&named(&grid.name), &format!("{}{half}", grid.grid_type), &parent] {
        bytes.extend((text.len() as u32).to_le_bytes());
        bytes.extend(text.as_bytes());
    }
    let Span { from, block, end } = grid.span;
    let start = bytes.len() as u64 + 24;
    for position in [from, block.clamp(from, end), end] {
        bytes.extend((start + (position - from)).to_le_bytes());
    }
    source.append(bytes, from, end)
}

/// Reads a grid in a file's bytes to its last one and drops it. The helper process calls this function, see
/// [`helper`](super::helper).
///
/// # Errors
/// If the bytes are damaged, or OpenVDB reports an error; a damaged grid often ends the process instead.
pub(crate) fn try_grid(bytes: Vec<u8>, limits: Limits) -> Result<()> {
    preflight::in_memory(&bytes, Path::new(""), &limits)?;
    let grid = Excerpt { bytes }.grid("")?;
    // SAFETY: the grid is alive.
    ffi::call(|s| unsafe { ffi::touch(grid.as_ptr(), s) })
}
