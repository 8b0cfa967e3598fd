//! Large arrays in files of a scratch folder, for work that needs more memory than the process may take.
//!
//! [`Allocator`](crate::process::Allocator) asks here for arrays that exceed the heap's share of the memory. Each gets
//! a file without a name, which is mapped into the process: the system reads and writes its pages as they are used. A
//! watch drops pages from the process before all of it exceeds its memory; their content stays in the system's cache,
//! which the system writes to the file where it needs the room. The system maps pages faster than any watch sees, so
//! that they may exceed a small memory for milliseconds; it takes them back whenever it needs them. Programs need not
//! tell such arrays from others, and results do not depend on where they lie.

#![allow(unsafe_code)]

use crate::error::{Error, Result};
use crate::text;
use rustix::fs::{FallocateFlags, fallocate, fstatfs, fstatvfs};
use std::alloc::Layout;
use std::collections::BTreeMap;
use std::fs::File;
use std::os::fd::AsRawFd;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::ptr::null_mut;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;

/// Bytes from which on an array may lie in a file.
pub(crate) const LARGE: usize = 1 << 20;
/// Kinds of file systems whose files are in memory: tmpfs and ramfs, as Linux numbers them.
const IN_MEMORY: [i128; 2] = [0x0102_1994, 0x8584_58f6];
/// Bytes of the scratch folder's disk that are left to others.
const LEFT: u64 = 256 << 20;
/// Bytes whose pages are dropped together.
const PIECE: usize = 16 << 20;
/// Time between two looks at the process's memory.
const PAUSE: Duration = Duration::from_millis(1);
/// Bytes of pages that may come to use between two looks.
const BETWEEN: usize = 192 << 20;

/// The folder, and the memory of the process in bytes.
struct Scratch {
    folder: PathBuf,
    memory: usize,
}

static SCRATCH: OnceLock<Scratch> = OnceLock::new();
/// Bytes of the large arrays on the heap.
static HEAP: AtomicUsize = AtomicUsize::new(0);
/// True once a file could not be made or was refused its bytes.
static FULL: AtomicBool = AtomicBool::new(false);
/// Number of arrays in files.
static COUNT: AtomicUsize = AtomicUsize::new(0);
/// Lengths of the arrays in files by their addresses; a mapping keeps its file, which has no name, until it ends. The
/// nodes of a tree are small: to record an array takes no other large one.
static ARRAYS: Mutex<BTreeMap<usize, usize>> = Mutex::new(BTreeMap::new());

/// Has arrays that exceed half of `memory` bytes in files of a folder from now on, and returns the bytes that there is
/// room for. The whole process keeps to the memory as far as pages of such arrays can be dropped.
///
/// # Errors
/// If the folder is none, cannot be written, or lies on a file system that cannot reserve space.
pub(crate) fn begin(folder: &Path, memory: u64) -> Result<u64> {
    let refused = |e: std::io::Error| {
        Error::io(folder, e).hint("name a folder that can be written, on a local disk, for large arrays")
    };
    let file = tempfile::tempfile_in(folder).map_err(refused)?;
    fallocate(&file, FallocateFlags::empty(), 0, LARGE as u64).map_err(|e| refused(e.into()))?;
    let kind = fstatfs(&file).map_err(|e| refused(e.into()))?.f_type;
    if IN_MEMORY.iter().any(|of| i128::from(kind) == *of) {
        return Err(Error::invalid("the scratch folder lies in memory itself")
            .at(folder)
            .hint("name a folder on a disk, such as one in /var/tmp"));
    }
    let disk = fstatvfs(&file).map_err(|e| refused(e.into()))?;
    let room = disk.f_bavail.saturating_mul(disk.f_frsize).saturating_sub(LEFT);
    if room == 0 {
        return Err(Error::invalid(format!("the disk of the scratch folder has less than {} left", text::bytes(LEFT)))
            .at(folder)
            .hint("free some of it, or name a folder of another disk"));
    }
    let memory = usize::try_from(memory).unwrap_or(usize::MAX);
    if SCRATCH.set(Scratch { folder: folder.to_owned(), memory }).is_ok() {
        let watch = std::thread::Builder::new().name("scratch".into()).stack_size(1 << 17);
        watch.spawn(move || watch_memory(memory)).map_err(Error::system)?;
    }
    Ok(room)
}

/// True if arrays lie in files.
pub(crate) fn is_used() -> bool {
    COUNT.load(Relaxed) > 0
}

/// True if arrays had no place in the scratch folder, because its disk is full.
pub(crate) fn is_full() -> bool {
    FULL.load(Relaxed)
}

/// Bytes that count of a block of so many.
fn counted(size: usize) -> usize {
    if size < LARGE { 0 } else { size }
}

/// Returns true if a block of the heap may get another size there, of which one at least is large; counts it then.
#[cold]
pub(crate) fn stays(pointer: *mut u8, before: usize, size: usize) -> bool {
    let grown = (HEAP.load(Relaxed) + counted(size)).saturating_sub(counted(before));
    let fits = size <= before || SCRATCH.get().is_none_or(|scratch| grown <= scratch.memory / 2);
    let stays = fits && (COUNT.load(Relaxed) == 0 || !arrays().contains_key(&(pointer as usize)));
    if stays {
        HEAP.fetch_add(counted(size), Relaxed);
        HEAP.fetch_sub(counted(before), Relaxed);
    }
    stays
}

/// Counts a large array of the heap, unless it exceeds the heap's share: returns a place in a file for it then, whose
/// bytes are 0.
#[cold]
pub(crate) fn place(layout: Layout) -> Option<*mut u8> {
    let size = layout.size();
    let heap = HEAP.fetch_add(size, Relaxed) + size;
    let scratch = SCRATCH.get().filter(|scratch| heap > scratch.memory / 2 && layout.align() <= 4096)?;
    let Ok(start) = map(&scratch.folder, size) else {
        FULL.store(true, Relaxed);
        return None;
    };
    HEAP.fetch_sub(size, Relaxed);
    arrays().insert(start as usize, size);
    COUNT.fetch_add(1, Relaxed);
    Some(start)
}

/// Ends a large array; returns false if it lies on the heap, whose it is to free then.
#[cold]
pub(crate) fn release(pointer: *mut u8, size: usize) -> bool {
    let found = COUNT.load(Relaxed) > 0 && arrays().remove(&(pointer as usize)).is_some();
    if !found {
        HEAP.fetch_sub(size, Relaxed);
        return false;
    }
    COUNT.fetch_sub(1, Relaxed);
    // SAFETY: the mapping is of this start and length, and its only owner gives it back.
    unsafe { libc::munmap(pointer.cast(), size) };
    true
}

fn arrays() -> MutexGuard<'static, BTreeMap<usize, usize>> {
    // Nothing panics while the list is held.
    ARRAYS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Maps a new file of so many bytes, whose space is reserved: a full disk is an error here, and no signal later.
fn map(folder: &Path, length: usize) -> std::io::Result<*mut u8> {
    let file = tempfile::tempfile_in(folder)?;
    fallocate(&file, FallocateFlags::empty(), 0, length as u64)?;
    let (access, shared) = (libc::PROT_READ | libc::PROT_WRITE, libc::MAP_SHARED);
    // SAFETY: a new mapping, at a place of the system's choice, of a file that nobody else has.
    let start = unsafe { libc::mmap(null_mut(), length, access, shared, file.as_raw_fd(), 0) };
    if start == libc::MAP_FAILED {
        return Err(std::io::Error::last_os_error());
    }
    Ok(start.cast())
}

/// Drops pages of arrays in files whenever the process comes near its memory.
fn watch_memory(memory: usize) {
    let most = memory.saturating_sub(BETWEEN.max(memory / 4)).max(memory / 2);
    let least = most - memory / 8;
    let Ok(statistics) = File::open("/proc/self/statm") else { return };
    let mut next = 0;
    loop {
        std::thread::sleep(PAUSE);
        if COUNT.load(Relaxed) > 0 && resident(&statistics) > most {
            drop_pages(&mut next, || resident(&statistics) <= least);
        }
    }
}

/// Drops pages of all arrays in turn, from piece number `next` on, until that is enough.
fn drop_pages(next: &mut usize, enough: impl Fn() -> bool) {
    let arrays = arrays();
    let pieces = |length: usize| length.div_ceil(PIECE);
    let count: usize = arrays.values().map(|length| pieces(*length)).sum();
    for _ in 0..count {
        let mut piece = *next % count;
        *next = piece + 1;
        for (start, length) in &*arrays {
            if piece < pieces(*length) {
                let from = piece * PIECE;
                // SAFETY: the piece is of a mapping that is there as long as the list is held. Pages of shared mappings
                // of files keep their content when they are dropped.
                unsafe { libc::madvise((start + from) as *mut _, PIECE.min(length - from), libc::MADV_DONTNEED) };
                break;
            }
            piece -= pieces(*length);
        }
        if enough() {
            return;
        }
    }
}

/// Resident memory of the process in bytes; 0 where the system does not tell. It takes no memory itself.
fn resident(statistics: &File) -> usize {
    let mut text = [0; 128];
    let count = statistics.read_at(&mut text, 0).unwrap_or(0);
    let mut words = text[..count].split(|byte| *byte == b' ');
    let digits = words.nth(1).unwrap_or_default();
    let pages = digits.iter().fold(0_usize, |n, digit| 10 * n + usize::from(digit.wrapping_sub(b'0').min(9)));
    // SAFETY: it returns a number, and does nothing else.
    let bytes = unsafe { libc::sysconf(libc::_SC_PAGESIZE) };
    pages * usize::try_from(bytes).unwrap_or(4096)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    /// Pages that are dropped keep what was written to them, and are no longer the process's.
    #[test]
    fn pages_are_dropped_and_keep_their_content() {
        let folder = tempfile::tempdir().unwrap();
        let length = 3 * PIECE + 12_345;
        let start = map(folder.path(), length).unwrap();
        // SAFETY: the mapping is of this length, and nobody else's.
        let bytes = unsafe { std::slice::from_raw_parts_mut(start, length) };
        assert!(bytes.iter().all(|byte| *byte == 0));
        bytes.iter_mut().enumerate().for_each(|(i, byte)| *byte = (i % 251) as u8);
        arrays().insert(start as usize, length);
        COUNT.fetch_add(1, Relaxed);
        let statistics = File::open("/proc/self/statm").unwrap();
        let before = resident(&statistics);
        let (mut next, mut looks) = (2, std::cell::Cell::new(0));
        drop_pages(&mut next, || looks.replace(looks.get() + 1) > 100);
        // All four pieces, from number 2 on.
        assert_eq!((*looks.get_mut(), next), (4, 2));
        assert!(resident(&statistics) + 2 * PIECE < before, "{before} {}", resident(&statistics));
        assert!(bytes.iter().enumerate().all(|(i, byte)| *byte == (i % 251) as u8));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "the files have no names");
        assert!(release(start, length));
    }

    #[test]
    fn a_folder_that_is_none_or_in_memory_is_refused() {
        if let Ok(folder) = tempfile::tempdir_in("/dev/shm") {
            assert!(begin(folder.path(), 1 << 30).unwrap_err().to_string().contains("/var/tmp"));
        }
        let error = begin(Path::new("/nowhere/at/all"), 1 << 30).unwrap_err().to_string();
        assert!(error.starts_with("/nowhere/at/all") && error.contains("local disk"), "{error}");
    }
}
