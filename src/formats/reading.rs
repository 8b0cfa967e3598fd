//! Files that are being read, which the message about exhausted memory names.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Paths of the files that are being read, the latest last.
static READING: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Marks a file as being read for as long as the value lives.
#[derive(Debug)]
#[must_use]
pub(crate) struct Reading(PathBuf);

impl Reading {
    /// Marks a file as being read from now on.
    pub(crate) fn begin(path: &Path) -> Self {
        if let Ok(mut all) = READING.lock() {
            all.push(path.to_path_buf());
        }
        Self(path.to_path_buf())
    }
}

impl Drop for Reading {
    fn drop(&mut self) {
        if let Ok(mut all) = READING.lock()
            && let Some(at) = all.iter().rposition(|path| *path == self.0)
        {
            all.remove(at);
        }
    }
}

/// Places of files that are read from elsewhere than the user knows, and the names that the user knows.
static NAMES: Mutex<Vec<(PathBuf, PathBuf)>> = Mutex::new(Vec::new());

/// Gives a file another name in messages for as long as the value lives.
#[derive(Debug)]
#[must_use]
pub(crate) struct KnownAs(PathBuf);

impl KnownAs {
    /// Has the file `place` named `shown` from now on.
    pub(crate) fn begin(place: &Path, shown: &Path) -> Self {
        if let Ok(mut all) = NAMES.lock() {
            all.push((place.to_path_buf(), shown.to_path_buf()));
        }
        Self(place.to_path_buf())
    }
}

impl Drop for KnownAs {
    fn drop(&mut self) {
        if let Ok(mut all) = NAMES.lock() {
            all.retain(|(place, _)| *place != self.0);
        }
    }
}

/// The file whose reading began last and has not ended, by the name that the user knows; `None` if there is none or the
/// list is locked.
pub(crate) fn latest() -> Option<PathBuf> {
    let latest = READING.try_lock().ok()?.last().cloned()?;
    let names = NAMES.try_lock().ok()?;
    let known = names.iter().find(|(place, _)| *place == latest).map(|(_, shown)| shown.clone());
    Some(known.unwrap_or(latest))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_latest_is_told_until_it_ends() {
        let (a, b) = (Path::new("reading-a"), Path::new("reading-b"));
        let first = Reading::begin(a);
        let second = Reading::begin(b);
        drop(second);
        let listed = READING.lock().unwrap().clone();
        assert!(listed.iter().any(|p| p == a) && !listed.iter().any(|p| p == b));
        drop(first);
        assert!(!READING.lock().unwrap().iter().any(|p| p == a));
    }
}
