//! Inputs of work that is under way, which no output replaces.
//!
//! While someone [`watch`]es, every file is protected that readers open, whichever setting, capture, scene or stage
//! named it, beside those that [`add`] names before they are read. [`atomic`](super::atomic) puts no output in the
//! place of a protected file. Files are told by device and inode, so that links and other spellings of a path lead to
//! the same file. Work that goes on at once in a process protects its inputs together.

use crate::error::{Code, Error, Result};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::Metadata;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Device and inode.
type Identity = (u64, u64);

static STATE: Mutex<State> =
    Mutex::new(State { watches: 0, files: BTreeMap::new(), earlier: Vec::new(), records: Vec::new() });

struct State {
    /// Number of those who watch.
    watches: usize,
    /// Protected files by the path that led to them first.
    files: BTreeMap<Identity, PathBuf>,
    /// Outputs of earlier runs that are being read, each as often as it is.
    earlier: Vec<PathBuf>,
    /// Files that were opened since each recording began.
    records: Vec<(u64, BTreeSet<PathBuf>)>,
}

fn state() -> MutexGuard<'static, State> {
    STATE.lock().unwrap_or_else(PoisonError::into_inner)
}

fn identity(metadata: &Metadata) -> Identity {
    (metadata.dev(), metadata.ino())
}

/// A watch over what is opened: with the last one all protection ends.
#[derive(Debug)]
#[must_use = "files are protected as long as it is held"]
pub(crate) struct Watch(());

impl Drop for Watch {
    fn drop(&mut self) {
        let mut state = state();
        state.watches -= 1;
        if state.watches == 0 {
            state.files.clear();
        }
    }
}

/// Protects every file that is opened from now on.
pub(crate) fn watch() -> Watch {
    state().watches += 1;
    Watch(())
}

/// Protects a file as long as someone watches. A path at which no file lies protects nothing.
pub(crate) fn add(path: &Path) {
    if let Ok(metadata) = std::fs::metadata(path) {
        state().protect(path, &metadata);
    }
}

impl State {
    fn protect(&mut self, path: &Path, metadata: &Metadata) {
        if self.watches > 0 {
            self.files.entry(identity(metadata)).or_insert_with(|| path.to_path_buf());
        }
    }
}

/// Protects a file that a reader has opened, if someone watches.
pub(super) fn opened(path: &Path, metadata: &Metadata) {
    let mut state = state();
    for (_, record) in &mut state.records {
        record.insert(path.to_path_buf());
    }
    if !state.earlier.iter().any(|earlier| earlier == path) {
        state.protect(path, metadata);
    }
}

/// Returns what `work` returns, and the files in or below `folder` that were opened meanwhile.
pub(crate) fn recorded<T>(folder: &Path, work: impl FnOnce() -> T) -> (T, BTreeSet<PathBuf>) {
    let number = {
        let mut state = state();
        let number = state.records.last().map_or(0, |(last, _)| last + 1);
        state.records.push((number, BTreeSet::new()));
        number
    };
    let result = work();
    let mut state = state();
    let at = state.records.iter().position(|(other, _)| *other == number);
    let files = at.map(|at| state.records.remove(at).1).unwrap_or_default();
    // Other work of the process may have opened files elsewhere.
    (result, files.into_iter().filter(|file| file.starts_with(folder)).collect())
}

/// Reads a file that is an output of an earlier run: `read` opens it by this very path, which protects nothing.
///
/// The path tells, not the inode: another thread or process may put a new file in its place meanwhile.
pub(crate) fn unprotected<T>(path: &Path, read: impl FnOnce() -> T) -> T {
    struct Earlier<'p>(&'p Path);
    impl Drop for Earlier<'_> {
        fn drop(&mut self) {
            let earlier = &mut state().earlier;
            if let Some(at) = earlier.iter().position(|path| path == self.0) {
                earlier.swap_remove(at);
            }
        }
    }
    state().earlier.push(path.to_path_buf());
    let _earlier = Earlier(path);
    read()
}

/// Makes sure that no input lies at a path.
///
/// # Errors
/// If one does; the error names both.
pub(crate) fn check(output: &Path) -> Result<()> {
    std::fs::metadata(output).map_or(Ok(()), |metadata| refuse(output, &metadata))
}

/// Makes sure that the file that stands at the place of `output` is no input.
pub(super) fn refuse(output: &Path, standing: &Metadata) -> Result<()> {
    let Some(input) = state().files.get(&identity(standing)).cloned() else { return Ok(()) };
    // The system gives the inode of a file that is gone to another one.
    if std::fs::metadata(&input).is_ok_and(|metadata| identity(&metadata) == identity(standing)) {
        return Err(Error::invalid(format!("the output is an input of this command: {}", input.display()))
            .coded(Code::OutputIsInput)
            .at(output)
            .hint("inputs are never replaced: give the output another name"));
    }
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn inputs_are_known_by_whatever_name() {
        let dir = tempfile::tempdir().unwrap();
        let [a, hard, soft, other] = ["a", "hard", "soft", "other"].map(|name| dir.path().join(name));
        [&a, &other].into_iter().for_each(|path| std::fs::write(path, "a").unwrap());
        std::fs::hard_link(&a, &hard).unwrap();
        std::os::unix::fs::symlink("a", &soft).unwrap();
        std::fs::create_dir(dir.path().join("x")).unwrap();
        let watch = watch();
        let open = |path: &Path| drop(crate::formats::input::open(path).unwrap());
        open(&a);
        for path in [&a, &hard, &soft, &dir.path().join("x/../a")] {
            let error = check(path).unwrap_err().to_string();
            assert!(error.contains("is an input") && error.contains("/a"), "{error}");
        }
        assert!(check(&other).is_ok() && check(&dir.path().join("none")).is_ok());
        // What was an input before it was looked at as an output stays one.
        unprotected(&a, || open(&a));
        assert!(check(&a).is_err());
        // Neither a file that takes the place of an earlier output while it is read is an input, nor that output
        // where two threads read it at once.
        unprotected(&other, || {
            let new = dir.path().join("new");
            std::fs::write(&new, "b").unwrap();
            std::fs::rename(&new, &other).unwrap();
            unprotected(&other, || open(&other));
            open(&other);
        });
        assert!(check(&other).is_ok());
        open(&other);
        assert!(check(&other).is_err());
        std::fs::rename(&other, dir.path().join("input")).unwrap();
        std::fs::write(&other, "c").unwrap();
        // A file that was put in the place of an input is none.
        std::fs::remove_file(&hard).unwrap();
        std::fs::rename(&other, &a).unwrap();
        assert!(check(&a).is_ok());
        drop(watch);
    }
}
