//! Loading of a grid whose lengths were all checked; its leaves are decoded by all threads.

use super::ffi;
use super::native::NativeGrid;
use super::preflight::{Entry, Preflight};
use super::topology::RUN;
use crate::error::{Error, Result};
use rayon::prelude::*;
use std::fs::File;
use std::os::fd::AsRawFd;
use std::ptr::{NonNull, null_mut};

/// A grid while its leaves are loaded.
struct Loading(NonNull<ffi::RawLoading>);

// SAFETY: leaves are loaded through a shared handle, each by one thread.
unsafe impl Sync for Loading {}

impl Loading {
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

/// Loads the grid of an entry that has a layout.
///
/// # Errors
/// If OpenVDB reports an error, or the file cannot be read.
pub(super) fn grid(file: &File, preflight: &Preflight, entry: &Entry) -> Result<NativeGrid> {
    let layout = entry.layout.as_ref().ok_or_else(|| Error::native("the grid has no layout"))?;
    let leaves = entry.topology.map_or(0, |t| t.leaves);
    let grid_type = ffi::c_name(&entry.grid_type)?;
    let raw = ffi::RawLayout {
        fd: file.as_raw_fd(),
        half: entry.half.into(),
        grid_type: grid_type.as_ptr(),
        file_version: preflight.version,
        library: preflight.library.into(),
        from: layout.from,
        buffers: layout.buffers,
        leaf_count: leaves,
    };
    let mut loading = null_mut();
    // SAFETY: the file is open, the type NUL-terminated, and `loading` a valid place.
    ffi::call(|s| unsafe { ffi::load_begin(&raw, &mut loading, s) })?;
    let loading = Loading(NonNull::new(loading).ok_or_else(|| Error::native("no handle of a grid being loaded"))?);
    let handle = &loading;
    let run = |i: usize| {
        let (first, from) = (i * RUN, layout.runs[i]);
        let until = layout.runs.get(i + 1).copied().unwrap_or(layout.end);
        let count = RUN.min(leaves as usize - first);
        // SAFETY: the handle is alive, and no other run has these leaves.
        ffi::call(|s| unsafe { ffi::load_leaves(handle.0.as_ptr(), first, count, from, until, s) })
    };
    let runs: Vec<Result<()>> = (0..layout.runs.len()).into_par_iter().map(run).collect();
    // The first error in file order is returned, independently of the threads.
    runs.into_iter().collect::<Result<()>>()?;
    // SAFETY: fresh from the shim.
    unsafe { NativeGrid::own(loading.finish()?, entry.name.clone()) }
}
