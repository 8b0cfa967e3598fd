//! The process as a whole: the memory that it may take, and how it ends where nothing can go on.

#![allow(unsafe_code)]

use crate::formats::{reading, temporary};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Bytes that [`limit_memory`] leaves at least: the stacks of the libraries' threads and their heaps take some tens of
/// mebibytes, however small the work is.
const LEAST: u64 = 112 << 20;

/// What memory was limited to, for the message; 0 before.
static ALLOWED: AtomicU64 = AtomicU64::new(0);

/// Limits the private memory of the whole process, the native library's included (`RLIMIT_DATA`). Whoever asks for more is
/// refused: OpenVDB throws, and [`Allocator`] ends the program with words. Nothing happens where the system has no such limit.
pub fn limit_memory(bytes: u64) {
    ALLOWED.store(bytes, Ordering::Relaxed);
    let before = getrlimit(Resource::Data);
    // What the program took before its work comes on top, as far as it is small beside it.
    let wanted = bytes.saturating_add(taken().min(bytes / 8)).max(LEAST);
    let current = before.maximum.map_or(wanted, |most| wanted.min(most));
    let _ = setrlimit(Resource::Data, Rlimit { current: Some(current), maximum: before.maximum });
}

/// Bytes of private memory that the process has now; 0 where the system does not tell.
fn taken() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let kib = status.lines().find_map(|l| l.strip_prefix("VmData:")?.split_whitespace().next()?.parse::<u64>().ok());
    kib.unwrap_or(0) << 10
}

/// Removes what is temporary and ends the program. No destructor runs: other threads may be in the middle of anything.
pub fn leave(code: u8) -> ! {
    temporary::remove_all();
    // SAFETY: ends the process, whatever its state.
    unsafe { libc::_exit(code.into()) }
}

/// The system's allocator, which ends the program with an error and exit code 2 where there is no memory left, instead of
/// a signal. For the program's `#[global_allocator]`.
#[derive(Debug, Clone, Copy, Default)]
pub struct Allocator;

// SAFETY: all is handed on to the system's allocator; a null pointer never comes back.
unsafe impl GlobalAlloc for Allocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promise.
        checked(unsafe { System.alloc(layout) }, layout.size())
    }
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promise.
        checked(unsafe { System.alloc_zeroed(layout) }, layout.size())
    }
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: the caller's promise.
        checked(unsafe { System.realloc(pointer, layout, size) }, size)
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[inline(always)]
fn checked(pointer: *mut u8, size: usize) -> *mut u8 {
    if pointer.is_null() {
        exhausted(size);
    }
    pointer
}

/// Ends the program: `size` bytes are not to be had.
#[cold]
fn exhausted(size: usize) -> ! {
    end(|| {
        let allowed = match ALLOWED.load(Ordering::Relaxed) {
            0 => String::new(),
            bytes => format!(", {} MiB are allowed in all", bytes >> 20),
        };
        format!("out of memory: {size} bytes more are needed{allowed}\n  {SMALLER}")
    })
}

/// Ends the program with exit code 2: the native library has thrown where nothing can catch it.
pub fn abandon(what: &str) -> ! {
    let remedy = if what == "out of memory" { SMALLER } else { "the file may be damaged; export it again" };
    end(|| format!("OpenVDB: {what}\n  {remedy}"))
}

const SMALLER: &str = "raise --max-memory, or give smaller inputs: fewer or smaller pictures, a volume that was cropped or \
                       resampled";

/// Says what happened to the file that is being read, and leaves.
fn end(what: impl FnOnce() -> String) -> ! {
    static ENDING: AtomicBool = AtomicBool::new(false);
    if ENDING.swap(true, Ordering::SeqCst) {
        // Another thread is about to end all of them.
        loop {
            std::thread::park();
        }
    }
    // What is left to do needs some memory of its own.
    let before = getrlimit(Resource::Data);
    let _ = setrlimit(Resource::Data, Rlimit { current: before.maximum, maximum: before.maximum });
    let file = reading::latest().map(|path| format!("{}: ", path.display())).unwrap_or_default();
    let text = format!("cumulo: {file}{}\n", what());
    // Not through the standard library's stream: this very thread may hold its lock.
    let _ = rustix::io::write(rustix::stdio::stderr(), text.as_bytes());
    leave(2)
}
