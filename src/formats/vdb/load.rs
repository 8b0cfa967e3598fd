//! Loading of a grid whose lengths can all be checked; its leaves are decoded by all threads.
//!
//! The file was walked when it was opened, which tells where each part lies. Every part is read once more, checked in
//! memory and decoded from the same memory, so that a file that changes meanwhile cannot mislead OpenVDB.

use super::ffi;
use super::native::NativeGrid;
use super::preflight::{self, Entry, Layout, Preflight};
use super::source::{Source, changed};
use super::topology::{RUN, Walk};
use super::up::UpMarks;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use rayon::prelude::*;
use std::ptr::{NonNull, null_mut};

/// A grid while its leaves are loaded.
struct Loading(NonNull<ffi::RawLoading>);

// SAFETY: leaves are loaded through a shared handle, each by one thread.
unsafe impl Sync for Loading {}

impl Loading {
    /// Decodes all of a grid but its leaves' buffers.
    fn begin(bytes: &[u8], preflight: &Preflight, entry: &Entry, leaf_count: u64) -> Result<Self> {
        let grid_type = ffi::c_name(&entry.grid_type)?;
        let raw = ffi::RawLayout {
            bytes: bytes.as_ptr(),
            length: bytes.len(),
            half: entry.half.into(),
            grid_type: grid_type.as_ptr(),
            file_version: preflight.version,
            library: preflight.library.into(),
            leaf_count,
        };
        let mut loading = null_mut();
        // SAFETY: the bytes outlive the call, the type is NUL-terminated, and `loading` a valid place.
        ffi::call(|s| unsafe { ffi::load_begin(&raw, &mut loading, s) })?;
        NonNull::new(loading).map(Self).ok_or_else(|| Error::native("no handle of a grid being loaded"))
    }

    /// Decodes the leaves from `first` on, whose buffers are these bytes.
    fn leaves(&self, first: usize, count: usize, bytes: &[u8]) -> Result<()> {
        // SAFETY: the handle is alive, the bytes outlive the call, and no other call has these leaves.
        ffi::call(|s| unsafe { ffi::load_leaves(self.0.as_ptr(), first, count, bytes.as_ptr(), bytes.len(), s) })
    }

    fn finish(self) -> Result<*mut ffi::RawGrid> {
        let mut grid = null_mut();
        // SAFETY: owned, and ended once: the drop does not run.
        let ended = ffi::call(|s| unsafe { ffi::load_end(self.0.as_ptr(), &mut grid, s) });
        std::mem::forget(self);
        ended.map(|()| grid)
    }
}

impl Drop for Loading {
    /// Drops the unfinished grid with the handle.
    fn drop(&mut self) {
        // SAFETY: owned, and ended once. Without a place for the grid nothing can fail.
        let _ = ffi::call(|s| unsafe { ffi::load_end(self.0.as_ptr(), null_mut(), s) });
    }
}

/// Walks the part of a grid before its buffers, which must be what it was when the file was opened.
fn walk_topology(source: &Source, head: &[u8], preflight: &Preflight, entry: &Entry, limits: &Limits) -> Result<Walk> {
    let mut c = source.cursor(head, entry.span.from);
    let walk = preflight::topology(&mut c, entry, preflight.version, limits, &mut UpMarks::default());
    let walk = walk.map_err(|e| changed(&e.what()))?;
    let whole = c.position() == entry.span.from + head.len() as u64;
    walk.filter(|walk| whole && Some(walk.tree_size()) == entry.topology)
        .ok_or_else(|| changed("the tree is another one"))
}

/// Loads the grid of an entry that has a layout.
///
/// # Errors
/// If OpenVDB reports an error, or the file cannot be read or is no longer what was checked.
pub(super) fn grid(
    source: &Source,
    preflight: &Preflight,
    (entry, layout): (&Entry, &Layout),
    limits: &Limits,
) -> Result<NativeGrid> {
    let leaves = entry.topology.map_or(0, |t| t.leaves);
    let head = source.range(entry.span.from, layout.buffers)?;
    let walk = walk_topology(source, &head, preflight, entry, limits)?;
    let loading = Loading::begin(&head, preflight, entry, leaves)?;
    drop(head);
    let run = |i: usize| {
        let (first, from) = (i * RUN, layout.runs[i]);
        let until = layout.runs.get(i + 1).copied().unwrap_or(entry.span.end);
        let count = RUN.min(leaves as usize - first);
        let bytes = source.range(from, until)?;
        let mut c = source.cursor(&bytes, from);
        walk.run(&mut c, first..first + count).map_err(|e| changed(&e.what()))?;
        if c.position() != until {
            return Err(changed("leaves end where they should not"));
        }
        loading.leaves(first, count, &bytes)
    };
    let runs: Vec<Result<()>> = (0..layout.runs.len()).into_par_iter().map(run).collect();
    // The first error in file order is returned, independently of the threads.
    runs.into_iter().collect::<Result<()>>()?;
    // SAFETY: fresh from the shim.
    unsafe { NativeGrid::own(loading.finish()?, entry.name.clone()) }
}
