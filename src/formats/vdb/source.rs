//! A file on disk, of which others may write while it is read: what was checked is not what a later read finds. Bytes
//! are therefore read once into memory, checked there, and decoded from there.

use super::cursor::Cursor;
use crate::error::{Error, Result};
use std::fs::File;
use std::io::ErrorKind;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

/// A file that was opened for reading.
#[derive(Debug)]
pub(super) struct Source {
    /// A file that is put in its place under its name meanwhile is another one.
    file: File,
    pub(super) path: PathBuf,
    length: u64,
}

impl Source {
    /// Takes over an open file.
    ///
    /// # Errors
    /// If its length cannot be found out.
    pub(super) fn new(file: File, path: &Path) -> Result<Self> {
        let length = file.metadata().map_err(|e| Error::io(path, e))?.len();
        Ok(Self { file, path: path.to_path_buf(), length })
    }

    /// Reads the bytes from `from` up to `until`, both of which a check has found inside the file.
    ///
    /// # Errors
    /// If they cannot be read, be it that the file has become shorter.
    pub(super) fn range(&self, from: u64, until: u64) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        self.append(&mut bytes, from, until)?;
        Ok(bytes)
    }

    /// Appends the bytes from `from` up to `until` to others.
    ///
    /// # Errors
    /// The conditions are those of [`Source::range`].
    pub(super) fn append(&self, bytes: &mut Vec<u8>, from: u64, until: u64) -> Result<()> {
        let (start, count) = (bytes.len(), until.saturating_sub(from) as usize);
        bytes.reserve_exact(count);
        bytes.resize(start + count, 0);
        self.file.read_exact_at(&mut bytes[start..], from).map_err(|e| match e.kind() {
            ErrorKind::UnexpectedEof => changed("it became shorter").at(&self.path),
            _ => Error::io(&self.path, e),
        })
    }

    /// Reader of bytes that were read at `from`.
    pub(super) fn cursor<'b>(&self, bytes: &'b [u8], from: u64) -> Cursor<std::io::Cursor<&'b [u8]>> {
        Cursor::over(bytes, from, self.length, &self.path)
    }
}

/// The error that the bytes in memory are not those that were checked before; `found` is what contradicts them.
pub(super) fn changed(found: &str) -> Error {
    Error::invalid(format!("the file changed while it was read: {found}"))
        .hint("wait until the program that writes it is done, then try again")
}
