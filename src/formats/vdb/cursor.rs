//! A bounds-checked reader of a file, or of a part of it in memory: nothing is read, skipped or allocated beyond its
//! end.

use crate::error::{Error, Result};
use crate::formats::input;
use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::{Path, PathBuf};

/// Reader of a VDB file's little-endian primitives, each checked against the end of what is there.
pub(super) struct Cursor<R = BufReader<File>> {
    reader: R,
    path: PathBuf,
    position: u64,
    /// One past the last byte that may be read.
    end: u64,
    /// Bytes of the whole file.
    length: u64,
}

impl Cursor {
    pub(super) fn open(path: &Path) -> Result<Self> {
        let file = input::open(path)?;
        let length = file.metadata().map_err(|e| Error::io(path, e))?.len();
        let reader = BufReader::with_capacity(1 << 18, file);
        Ok(Self { reader, path: path.to_path_buf(), position: 0, end: length, length })
    }

    /// The underlying file, at any position.
    pub(super) fn into_file(self) -> File {
        self.reader.into_inner()
    }
}

impl<'b> Cursor<std::io::Cursor<&'b [u8]>> {
    /// Reader of the bytes of a file of `length` bytes that were read at `from`. Positions are those in the file.
    pub(super) fn over(bytes: &'b [u8], from: u64, length: u64, path: &Path) -> Self {
        let (reader, end) = (std::io::Cursor::new(bytes), from + bytes.len() as u64);
        Self { reader, path: path.to_path_buf(), position: from, end, length }
    }
}

impl<R: Read + Seek> Cursor<R> {
    /// The error that the file is damaged at the current position.
    pub(super) fn damaged(&self, what: impl std::fmt::Display) -> Error {
        Error::invalid(format!("{what} (at byte {} of {})", self.position, self.length))
            .at(&self.path)
            .hint("the file is truncated or damaged; export it again or fetch a fresh copy")
    }

    pub(super) fn position(&self) -> u64 {
        self.position
    }

    pub(super) fn length(&self) -> u64 {
        self.length
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    fn claim(&mut self, bytes: u64, what: &str) -> Result<()> {
        let left = self.end - self.position;
        if bytes > left {
            return Err(self.damaged(format_args!("{what} needs {bytes} bytes, {left} are left")));
        }
        self.position += bytes;
        Ok(())
    }

    pub(super) fn skip(&mut self, bytes: u64, what: &str) -> Result<()> {
        self.claim(bytes, what)?;
        // A position within the file fits into i64; short skips stay inside the buffer.
        self.reader.seek_relative(bytes as i64).map_err(|e| Error::io(&self.path, e))
    }

    pub(super) fn seek(&mut self, position: u64) -> Result<()> {
        if position > self.end {
            return Err(self.damaged(format_args!("an offset points to byte {position}, past the end")));
        }
        // Positions within a file fit into i64.
        let way = position.cast_signed() - self.position.cast_signed();
        self.reader.seek_relative(way).map_err(|e| Error::io(&self.path, e))?;
        self.position = position;
        Ok(())
    }

    pub(super) fn fill(&mut self, out: &mut [u8], what: &str) -> Result<()> {
        self.claim(out.len() as u64, what)?;
        self.reader.read_exact(out).map_err(|e| Error::io(&self.path, e))
    }

    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N]> {
        let mut out = [0; N];
        self.fill(&mut out, what)?;
        Ok(out)
    }

    pub(super) fn u8(&mut self, what: &str) -> Result<u8> {
        Ok(self.array::<1>(what)?[0])
    }

    /// Reads a C++ `bool`; any byte but 0 and 1 would be undefined behaviour there.
    pub(super) fn bool(&mut self, what: &str) -> Result<bool> {
        match self.u8(what)? {
            0 => Ok(false),
            1 => Ok(true),
            n => Err(self.damaged(format_args!("{what} is {n}, 0 or 1 expected"))),
        }
    }

    pub(super) fn u32(&mut self, what: &str) -> Result<u32> {
        self.array(what).map(u32::from_le_bytes)
    }

    pub(super) fn i32(&mut self, what: &str) -> Result<i32> {
        self.array(what).map(i32::from_le_bytes)
    }

    pub(super) fn i64(&mut self, what: &str) -> Result<i64> {
        self.array(what).map(i64::from_le_bytes)
    }

    pub(super) fn f64(&mut self, what: &str) -> Result<f64> {
        self.array(what).map(f64::from_le_bytes)
    }

    pub(super) fn coord(&mut self, what: &str) -> Result<[i32; 3]> {
        Ok([self.i32(what)?, self.i32(what)?, self.i32(what)?])
    }

    /// Reads length-prefixed bytes; the length is checked before anything is allocated.
    pub(super) fn bytes(&mut self, what: &str) -> Result<Vec<u8>> {
        let length = u64::from(self.u32(what)?);
        let left = self.end - self.position;
        if length > left {
            return Err(self.damaged(format_args!("{what} claims {length} bytes, {left} are left")));
        }
        let mut out = vec![0; length as usize];
        self.fill(&mut out, what)?;
        Ok(out)
    }

    /// Reads a length-prefixed name of at most 4096 bytes without NUL.
    pub(super) fn name(&mut self, what: &str) -> Result<String> {
        let bytes = self.bytes(what)?;
        if bytes.len() > 4096 || bytes.contains(&0) {
            return Err(self.damaged(format_args!("{what} of {} bytes is not a name", bytes.len())));
        }
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }
}
