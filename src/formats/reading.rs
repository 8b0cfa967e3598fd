//! Files that are being read, which the message about exhausted memory names.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Paths of the files that are being read, the latest last.
static READING: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Marks a file as being read for as long as the value lives.
#[derive(Debug)]
#[must_use]
pub struct Reading(PathBuf);

impl Reading {
    /// Marks a file as being read from now on.
    pub fn begin(path: &Path) -> Self {
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

/// The file whose reading began last and has not ended; `None` if there is none or the list is locked.
pub fn latest() -> Option<PathBuf> {
    READING.try_lock().ok()?.last().cloned()
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
