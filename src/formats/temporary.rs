//! Temporary files and folders that stand beside an output until it is complete.
//!
//! All of them are registered in one list. Code that ends the program from outside (a signal, exhausted memory) calls
//! [`remove_all`] first, so that none is left behind.

use crate::error::{Error, Result};
use std::collections::BTreeSet;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::{Duration, Instant};

/// Prefix of the names of all temporary files and folders.
pub(crate) const PREFIX: &str = ".cumulo-";

static LISTED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

fn listed() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    LISTED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// An entry in the list, which is removed on drop.
#[derive(Debug)]
struct Listed(PathBuf);

impl Drop for Listed {
    /// Removes the entry. The file itself has been renamed or removed by then.
    fn drop(&mut self) {
        listed().remove(&self.0);
    }
}

/// An open file under a temporary name, which is removed on drop unless it was renamed.
#[derive(Debug)]
pub(crate) struct TemporaryFile {
    /// Fields drop in order of declaration: first the file, then its entry in the list.
    inner: tempfile::NamedTempFile,
    place: Listed,
}

impl TemporaryFile {
    /// Creates a file in `folder`, with the mode that the user's umask gives to any new file. `extension` is the end of
    /// its name, dot included.
    ///
    /// # Errors
    /// If the operating system does not create the file.
    pub(crate) fn new(folder: &Path, extension: &str) -> std::io::Result<Self> {
        let mut options = std::fs::OpenOptions::new();
        options.read(true).write(true).create_new(true);
        // [`remove_all`] takes the list and never returns it, so that no file is created afterwards.
        let mut list = listed();
        let mut number = None;
        let create = |path: &Path| options.open(path).inspect_err(|e| number = e.raw_os_error());
        let made = tempfile::Builder::new().prefix(PREFIX).suffix(extension).make_in(folder, create);
        // The error leaves out the temporary name, which tells the user nothing.
        let inner = made.map_err(|e| number.map_or(e, std::io::Error::from_raw_os_error))?;
        list.insert(inner.path().to_path_buf());
        let place = Listed(inner.path().to_path_buf());
        Ok(Self { inner, place })
    }

    /// The open file, for reading and writing.
    pub(crate) fn file(&mut self) -> &mut File {
        self.inner.as_file_mut()
    }

    /// Temporary path of the file.
    pub(crate) fn path(&self) -> &Path {
        &self.place.0
    }

    /// Renames the file, over any file of that name.
    ///
    /// # Errors
    /// If the operating system refuses, in which case the temporary file is removed.
    pub(crate) fn rename(self, to: &Path) -> std::io::Result<()> {
        undisturbed(|| std::fs::rename(&self.place.0, to))?;
        // No file has the temporary name any more, so nothing is left to remove.
        let (_, path) = self.inner.into_parts();
        let _ = path.keep();
        Ok(())
    }
}

/// A folder under a temporary name, which is removed with its content on drop.
#[derive(Debug)]
pub(crate) struct TemporaryFolder {
    inner: tempfile::TempDir,
    _place: Listed,
}

impl TemporaryFolder {
    /// Creates a temporary folder in `folder`.
    ///
    /// # Errors
    /// If the operating system does not create it; the error names `folder`.
    pub(crate) fn new(folder: &Path) -> Result<Self> {
        let mut list = listed();
        let made = tempfile::Builder::new().prefix(PREFIX).tempdir_in(folder);
        let inner = made.map_err(|e| {
            let what = e.to_string();
            let what = what.split(" at path ").next().unwrap_or(&what).to_owned();
            Error::io(folder, e)
                .saying(what)
                .hint("the output's folder must exist, be writable, and have room for a folder beside it")
        })?;
        list.insert(inner.path().to_path_buf());
        let place = Listed(inner.path().to_path_buf());
        Ok(Self { inner, _place: place })
    }

    /// Temporary path of the folder.
    pub(crate) fn path(&self) -> &Path {
        self.inner.path()
    }
}

/// Renames files at a moment at which [`remove_all`] does not remove them: before it, or never.
pub(crate) fn undisturbed<T>(rename: impl FnOnce() -> T) -> T {
    let _list = listed();
    rename()
}

/// Removes all registered files and folders at the end of the program, once nothing temporary is being created or
/// renamed. Nothing temporary can be created or renamed afterwards: threads that try wait for ever. After `patience`
/// the files are left: the calling thread itself may be the one that was creating one.
pub(crate) fn remove_all(patience: Duration) {
    let begun = Instant::now();
    let list = loop {
        match LISTED.try_lock() {
            Ok(list) => break list,
            Err(TryLockError::Poisoned(poisoned)) => break poisoned.into_inner(),
            Err(TryLockError::WouldBlock) if begun.elapsed() > patience => return,
            Err(TryLockError::WouldBlock) => std::thread::sleep(Duration::from_millis(1)),
        }
    };
    list.iter().for_each(|path| remove(path));
    std::mem::forget(list);
}

/// Removes a file, or a folder in which other threads may still be creating files.
fn remove(path: &Path) {
    const ATTEMPTS: u32 = 1000;
    for _ in 0..ATTEMPTS {
        let removed = if path.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) };
        match removed {
            Err(e) if e.kind() == std::io::ErrorKind::DirectoryNotEmpty => std::thread::yield_now(),
            _ => return,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_dropped_is_gone_and_unlisted() {
        let dir = tempfile::tempdir().unwrap();
        let file = TemporaryFile::new(dir.path(), ".txt").unwrap();
        let folder = TemporaryFolder::new(dir.path()).unwrap();
        let paths = [file.path().to_path_buf(), folder.path().to_path_buf()];
        assert!(paths.iter().all(|p| p.exists() && listed().contains(p)));
        drop((file, folder));
        assert!(paths.iter().all(|p| !p.exists() && !listed().contains(p)));
    }

    #[test]
    fn what_is_renamed_stays() {
        let dir = tempfile::tempdir().unwrap();
        let file = TemporaryFile::new(dir.path(), "").unwrap();
        let temporary = file.path().to_path_buf();
        file.rename(&dir.path().join("kept")).unwrap();
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
        assert!(dir.path().join("kept").exists() && !listed().contains(&temporary));
    }
}
