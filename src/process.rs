//! Memory limit and emergency exit of the whole process.

#![allow(unsafe_code)]

use crate::error::{Code, Error};
use crate::formats::{reading, temporary};
use crate::scratch::{self, LARGE};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, OnceLock};
use std::time::Duration;

/// Least limit in bytes that [`limit_memory`] sets: stacks and heaps of the libraries' threads take some tens of
/// mebibytes however small the work is.
const LEAST: u64 = 112 << 20;

/// Memory limit in bytes, for the error message; 0 before [`limit_memory`] was called.
static ALLOWED: AtomicU64 = AtomicU64::new(0);

/// Memory in bytes that work of any size takes beside what the process has when it begins.
const WORK: u64 = 48 << 20;

/// Advice to those whose work needs more memory than is allowed.
static REMEDY: OnceLock<&'static str> = OnceLock::new();

/// Returns the least limit in bytes that the process can keep to: stacks of its threads are part of what it has taken.
pub(crate) fn least_memory() -> u64 {
    LEAST.max(taken().saturating_add(WORK))
}

/// Limits the private memory of the whole process to about `bytes`, the native library included (`RLIMIT_DATA`).
/// An allocation beyond the limit fails: OpenVDB throws, and [`Allocator`] ends the program with an error message.
/// Systems without such a limit are left as they are. The message ends with `remedy`.
pub(crate) fn limit_memory(bytes: u64, remedy: &'static str) {
    let _ = REMEDY.set(remedy);
    if let Ok(mut reserve) = RESERVE.try_lock() {
        reserve.get_or_insert_with(|| vec![0; RESERVED]);
    }
    ALLOWED.store(bytes, Ordering::Relaxed);
    let before = getrlimit(Resource::Data);
    // Memory taken before the work began is added, up to an eighth of the limit.
    let wanted = bytes.saturating_add(taken().min(bytes / 8)).max(LEAST);
    let current = before.maximum.map_or(wanted, |most| wanted.min(most));
    let _ = setrlimit(Resource::Data, Rlimit { current: Some(current), maximum: before.maximum });
}

/// Private memory of the process in bytes; 0 where the system does not report it.
fn taken() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let kib = status.lines().find_map(|l| l.strip_prefix("VmData:")?.split_whitespace().next()?.parse::<u64>().ok());
    kib.unwrap_or(0) << 10
}

/// Bytes that are kept for the message of a process that runs out of memory.
const RESERVED: usize = 1 << 20;
static RESERVE: Mutex<Option<Vec<u8>>> = Mutex::new(None);

/// Time that the end of the process waits for files that are being renamed.
const PATIENCE: Duration = Duration::from_secs(10);
/// Time that it waits where memory has run out, possibly in the thread that was creating a file.
const SHORT_PATIENCE: Duration = Duration::from_millis(500);

/// Removes temporary files and ends the process with exit code `code`.
/// No destructor runs, because other threads may be in any state.
pub fn leave(code: u8) -> ! {
    leave_after(code, PATIENCE)
}

fn leave_after(code: u8, patience: Duration) -> ! {
    temporary::remove_all(patience);
    // SAFETY: `_exit` ends the process and may be called in any state.
    unsafe { libc::_exit(code.into()) }
}

/// The system's allocator, except that a failed allocation ends the program with an error message and exit code 2
/// instead of a signal, and that large arrays lie in files once the program was given a scratch folder. Meant as the
/// program's `#[global_allocator]`.
#[derive(Debug, Clone, Copy, Default)]
pub struct Allocator;

// SAFETY: every call is forwarded to the system's allocator, or answered by a mapping of at least the size, which is
// aligned to pages, zeroed, and ended by the call that frees it; a null pointer is never returned.
unsafe impl GlobalAlloc for Allocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if layout.size() >= LARGE
            && let Some(place) = scratch::place(layout)
        {
            return place;
        }
        // SAFETY: the caller upholds the contract of `alloc`.
        checked(unsafe { System.alloc(layout) }, layout.size())
    }
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        if layout.size() >= LARGE
            && let Some(place) = scratch::place(layout)
        {
            return place;
        }
        // SAFETY: the caller upholds the contract of `alloc_zeroed`.
        checked(unsafe { System.alloc_zeroed(layout) }, layout.size())
    }
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        if size.max(layout.size()) < LARGE || scratch::stays(pointer, layout.size(), size) {
            // SAFETY: the caller upholds the contract of `realloc`.
            return checked(unsafe { System.realloc(pointer, layout, size) }, size);
        }
        // SAFETY: the caller upholds the contract of `realloc`: both layouts are valid, the old one is the block's,
        // and blocks do not overlap.
        unsafe {
            let moved = self.alloc(Layout::from_size_align_unchecked(size, layout.align()));
            std::ptr::copy_nonoverlapping(pointer, moved, layout.size().min(size));
            self.dealloc(pointer, layout);
            moved
        }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        if layout.size() >= LARGE && scratch::release(pointer, layout.size()) {
            return;
        }
        // SAFETY: the caller upholds the contract of `dealloc`.
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

/// Receives the error that ended the program.
pub(crate) type OnEnd = fn(&Error);

static ON_END: OnceLock<OnEnd> = OnceLock::new();

/// Has a function called before the program ends for want of memory, or because the native library gave up.
pub(crate) fn on_end(hook: OnEnd) {
    let _ = ON_END.set(hook);
}

/// Ends the program after an allocation of `size` bytes failed.
#[cold]
fn exhausted(size: usize) -> ! {
    end(Code::MemoryLimit, smaller(), || {
        let allowed = match ALLOWED.load(Ordering::Relaxed) {
            0 => String::new(),
            bytes => format!(", {} MiB are allowed in all", bytes >> 20),
        };
        let disk = if scratch::is_full() { ", and the disk of the scratch folder is full" } else { "" };
        format!("out of memory: {size} bytes more are needed{allowed}{disk}")
    })
}

/// Ends the program with exit code 2 after the native library has thrown where no exception can be caught.
pub(crate) fn abandon(what: &str) -> ! {
    // A thread whose stack finds no room wants memory, too.
    let memory = what == "out of memory" || what.contains("pthread_create");
    let (code, remedy) = match memory {
        true => (Code::MemoryLimit, smaller()),
        false => (Code::OpenVdb, "the file may be damaged; export it again"),
    };
    end(code, remedy, || format!("OpenVDB: {what}"))
}

/// Returns the advice to those whose work needs more memory than is allowed. It is no text with settings to be named:
/// naming them takes memory, and may be what failed.
fn smaller() -> &'static str {
    REMEDY.get().copied().unwrap_or("give smaller inputs: fewer or smaller pictures, a volume that was cropped")
}

/// Prints an error message that names the file being read, and ends the program with exit code 2.
fn end(code: Code, remedy: &'static str, what: impl FnOnce() -> String) -> ! {
    /// Thread that ends the process; 0 before.
    static ENDING: AtomicUsize = AtomicUsize::new(0);
    // SAFETY: it returns what this thread is known by, and does nothing else.
    let own = unsafe { libc::pthread_self() } as usize;
    match ENDING.compare_exchange(0, own, Ordering::SeqCst, Ordering::SeqCst) {
        Ok(_) => {}
        Err(other) if other == own => {
            // What is said below takes memory, which a limit from outside may deny as well.
            let _ = rustix::io::write(rustix::stdio::stderr(), b"cumulo: out of memory\n");
            // SAFETY: `_exit` ends the process and may be called in any state.
            unsafe { libc::_exit(2) }
        }
        Err(_) => loop {
            std::thread::park();
        },
    }
    // The message and the clean-up need memory of their own: what was kept for them, and the limit is lifted.
    if let Ok(mut reserve) = RESERVE.try_lock() {
        drop(reserve.take());
    }
    let before = getrlimit(Resource::Data);
    let _ = setrlimit(Resource::Data, Rlimit { current: before.maximum, maximum: before.maximum });
    let error = Error::native(what()).coded(code).hint(remedy);
    let error = reading::latest().into_iter().fold(error, Error::at);
    if let Some(hook) = ON_END.get() {
        hook(&error);
    }
    let text = format!("cumulo: {error}\n");
    // The standard library's stream is avoided because this thread may hold its lock.
    let _ = rustix::io::write(rustix::stdio::stderr(), text.as_bytes());
    leave_after(2, SHORT_PATIENCE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;

    /// The message about a lack of memory may fail for the same lack: the process must not wait for its own end.
    #[test]
    fn a_lack_of_memory_while_the_process_ends_is_no_wait() {
        const WITHIN: &str = "CUMULO_TEST_EXHAUSTED";
        if std::env::var_os(WITHIN).is_some() {
            on_end(|_| exhausted(1));
            exhausted(1);
        }
        let name = "process::tests::a_lack_of_memory_while_the_process_ends_is_no_wait";
        let mut child = Command::new(std::env::current_exe().unwrap());
        child.args(["--exact", name, "--nocapture"]).env(WITHIN, "1");
        let mut child = child.stderr(std::process::Stdio::piped()).spawn().unwrap();
        let deadline = std::time::Instant::now() + Duration::from_secs(30);
        let code = loop {
            match child.try_wait().unwrap() {
                Some(status) => break status.code(),
                None if std::time::Instant::now() > deadline => {
                    child.kill().unwrap();
                    break child.wait().unwrap().code();
                }
                None => std::thread::sleep(Duration::from_millis(10)),
            }
        };
        assert_eq!(code, Some(2));
    }
}
