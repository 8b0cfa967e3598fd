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
use crate::scene::grid::{LEAF_VOXELS, Leaf};
use rayon::prelude::*;
use std::ops::Range;
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

    /// Decodes the leaves from `first` on, whose buffers are these bytes, and moves their values to these places: the
    /// grid has its leaves without values then.
    fn values(&self, first: usize, places: &mut [&mut Leaf], bytes: &[u8]) -> Result<()> {
        let place = |leaf: &mut &mut Leaf| ffi::RawPlaces {
            origin: &raw mut leaf.origin,
            values: &raw mut leaf.values,
            active: &raw mut leaf.active,
        };
        let raw: Vec<_> = places.iter_mut().map(place).collect();
        // SAFETY: the handle is alive, the bytes and the places outlive the call, each place is a leaf's and no other
        // call has it, and no other call has these leaves.
        ffi::call(|s| unsafe {
            ffi::load_values(self.0.as_ptr(), first, raw.len(), bytes.as_ptr(), bytes.len(), raw.as_ptr(), s)
        })
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

/// A grid of which all but the leaves' buffers is loaded.
struct Begun<'s> {
    source: &'s Source,
    entry: &'s Entry,
    layout: &'s Layout,
    walk: Walk,
    loading: Loading,
}

impl<'s> Begun<'s> {
    fn new(
        source: &'s Source,
        preflight: &Preflight,
        (entry, layout): (&'s Entry, &'s Layout),
        limits: &Limits,
    ) -> Result<Self> {
        let leaves = entry.topology.map_or(0, |t| t.leaves);
        let head = source.range(entry.span.from, layout.buffers)?;
        let walk = walk_topology(source, &head, preflight, entry, limits)?;
        let loading = Loading::begin(&head, preflight, entry, leaves)?;
        Ok(Self { source, entry, layout, walk, loading })
    }

    /// Returns the bytes of a run of leaves' buffers, which are what they were when the file was opened.
    fn run(&self, run: usize) -> Result<Vec<u8>> {
        let from = self.layout.runs[run];
        let until = self.layout.runs.get(run + 1).copied().unwrap_or(self.entry.span.end);
        let bytes = self.source.range(from, until)?;
        let mut c = self.source.cursor(&bytes, from);
        self.walk.run(&mut c, self.leaves(run)).map_err(|e| changed(&e.what()))?;
        if c.position() == until { Ok(bytes) } else { Err(changed("leaves end where they should not")) }
    }

    /// Returns the numbers of a run's leaves, in the order of the file.
    fn leaves(&self, run: usize) -> Range<usize> {
        run * RUN..self.walk.origins().len().min((run + 1) * RUN)
    }
}

/// Loads the grid of an entry that has a layout.
///
/// # Errors
/// If OpenVDB reports an error, or the file cannot be read or is no longer what was checked.
pub(super) fn grid(
    source: &Source,
    preflight: &Preflight,
    found: (&Entry, &Layout),
    limits: &Limits,
) -> Result<NativeGrid> {
    let begun = Begun::new(source, preflight, found, limits)?;
    let run = |i: usize| {
        let leaves = begun.leaves(i);
        begun.loading.leaves(leaves.start, leaves.len(), &begun.run(i)?)
    };
    first_error((0..begun.layout.runs.len()).into_par_iter().map(run))?;
    // SAFETY: fresh from the shim.
    unsafe { NativeGrid::own(begun.loading.finish()?, begun.entry.name.clone()) }
}

/// Loads the leaves of an entry of scalars that has a layout, in ascending order of origin, and the grid without the
/// values of its leaves. There is one copy of the values at any time.
///
/// # Errors
/// The conditions are those of [`grid`]; or if the entry holds vectors.
pub(super) fn scalars(
    source: &Source,
    preflight: &Preflight,
    found: (&Entry, &Layout),
    limits: &Limits,
) -> Result<(NativeGrid, Vec<Leaf>)> {
    let begun = Begun::new(source, preflight, found, limits)?;
    let origins = begun.walk.origins();
    let mut sorted: Vec<usize> = (0..origins.len()).collect();
    sorted.sort_unstable_by_key(|leaf| origins[*leaf].0);
    let empty = |_| Leaf { origin: [0; 3], values: [0.0; LEAF_VOXELS], active: [0; 8] };
    let mut leaves: Vec<Leaf> = (0..origins.len()).into_par_iter().map(empty).collect();
    // In the order of the file.
    let mut places: Vec<(usize, &mut Leaf)> = sorted.into_iter().zip(&mut leaves).collect();
    places.sort_unstable_by_key(|(leaf, _)| *leaf);
    let mut places: Vec<&mut Leaf> = places.into_iter().map(|(_, place)| place).collect();
    let run = |(i, places): (usize, &mut [&mut Leaf])| begun.loading.values(i * RUN, places, &begun.run(i)?);
    first_error(places.par_chunks_mut(RUN).enumerate().map(run))?;
    // SAFETY: fresh from the shim.
    let grid = unsafe { NativeGrid::own(begun.loading.finish()?, begun.entry.name.clone()) }?;
    Ok((grid, leaves))
}

/// Returns the first error in file order, independently of the threads.
fn first_error(runs: impl IndexedParallelIterator<Item = Result<()>>) -> Result<()> {
    let all: Vec<Result<()>> = runs.collect();
    all.into_iter().collect()
}
