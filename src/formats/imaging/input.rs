//! Files with values: opened at a place, unpacked, and measured before anything is read.

use super::text::excerpt;
use crate::error::{Code, Error, Result};
use crate::formats::input::{self, below};
use flate2::bufread::GzDecoder;
use flate2::{Decompress, FlushDecompress, Status};
use std::io::{BufRead, BufReader, ErrorKind, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Bytes that are read at a time.
const BUFFER: usize = 1 << 17;

/// How values are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Packing {
    /// As they are.
    Plain,
    /// A stream of gzip, with any number of members.
    Gzip,
    /// A stream of zlib.
    Zlib,
}

/// Opens the values of a file that begin at byte `from`, of which `skip` unpacked bytes are left out.
///
/// # Errors
/// If the file cannot be read, or ends before.
pub(crate) fn values(path: &Path, from: u64, packing: Packing, skip: u64) -> Result<Box<dyn Read>> {
    let mut file = input::open(path)?;
    let plain = packing == Packing::Plain;
    let start = if plain { from.saturating_add(skip) } else { from };
    file.seek(SeekFrom::Start(start)).map_err(|e| Error::io(path, e))?;
    let reader = BufReader::with_capacity(BUFFER, file);
    let mut unpacked: Box<dyn Read> = match packing {
        Packing::Plain => return Ok(Box::new(reader)),
        Packing::Gzip => Box::new(Members { member: Some(GzDecoder::new(reader)) }),
        Packing::Zlib => Box::new(Zlib::new(reader)),
    };
    let skipped = std::io::copy(&mut (&mut unpacked).take(skip), &mut std::io::sink());
    match skipped {
        Ok(n) if n == skip => Ok(unpacked),
        Ok(_) => Err(super::stream::failed(ErrorKind::UnexpectedEof.into(), 0).at(path)),
        Err(e) => Err(super::stream::failed(e, 0).at(path)),
    }
}

/// Values of `length` unpacked bytes that compare themselves with the checksum of their stream: once the last of them
/// is read, the stream is read to its end, where the checksum is. Values that are not packed have none.
pub(crate) fn whole(reader: Box<dyn Read>, packing: Packing, length: u64) -> Box<dyn Read> {
    match packing {
        Packing::Plain => reader,
        Packing::Gzip | Packing::Zlib => Box::new(Whole { reader, left: length }),
    }
}

/// Packed values that are read to the end of their stream.
struct Whole {
    reader: Box<dyn Read>,
    /// Bytes of values that are not read yet.
    left: u64,
}

impl Read for Whole {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let n = self.reader.read(out)?;
        let before = self.left;
        self.left = before.saturating_sub(n as u64);
        if before > 0 && self.left == 0 {
            // Readers of values stop before the checksum, so that nothing would compare it.
            std::io::copy(&mut self.reader, &mut std::io::sink()).map_err(|e| match e.kind() {
                ErrorKind::UnexpectedEof => {
                    std::io::Error::new(ErrorKind::InvalidData, "the stream ends before its checksum")
                }
                _ => e,
            })?;
        }
        Ok(n)
    }
}

/// Members of gzip one behind the other, each of which ends with its checksum and its length. As gzip itself does, what
/// follows the last of them and is no member is left out: tapes fill their blocks with zeros.
struct Members<R> {
    member: Option<GzDecoder<R>>,
}

impl<R: BufRead> Read for Members<R> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        loop {
            let Some(member) = &mut self.member else { return Ok(0) };
            let n = member.read(out)?;
            if n > 0 || out.is_empty() {
                return Ok(n);
            }
            let Some(ended) = self.member.take() else { return Ok(0) };
            let mut rest = ended.into_inner();
            if rest.fill_buf()?.first() == Some(&0x1f) {
                self.member = Some(GzDecoder::new(rest));
            }
        }
    }
}

/// A stream of zlib, which ends with its checksum. The decoder of the crate takes a stream that is cut off for one that
/// ends.
pub(crate) struct Zlib<R> {
    reader: R,
    state: Decompress,
    ended: bool,
}

impl<R: BufRead> Zlib<R> {
    /// Unpacks what `reader` gives, up to the end of the stream.
    pub(crate) fn new(reader: R) -> Self {
        Self { reader, state: Decompress::new(true), ended: false }
    }
}

impl<R: BufRead> Read for Zlib<R> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        while !self.ended && !out.is_empty() {
            let packed = self.reader.fill_buf()?;
            let (before_in, before_out) = (self.state.total_in(), self.state.total_out());
            let status = self.state.decompress(packed, out, FlushDecompress::None);
            let taken = (self.state.total_in() - before_in) as usize;
            let made = (self.state.total_out() - before_out) as usize;
            self.reader.consume(taken);
            match status {
                Ok(Status::StreamEnd) => self.ended = true,
                Ok(_) if taken == 0 && made == 0 => return Err(ErrorKind::UnexpectedEof.into()),
                Ok(_) => {}
                Err(_) => {
                    let what = "the zlib stream contradicts itself or its checksum";
                    return Err(std::io::Error::new(ErrorKind::InvalidData, what));
                }
            }
            if made > 0 {
                return Ok(made);
            }
        }
        Ok(0)
    }
}

/// Makes sure that a file has `needed` bytes from byte `from` on.
///
/// # Errors
/// If it is shorter; the error has both lengths.
pub(crate) fn has(path: &Path, from: u64, needed: Option<u64>) -> Result<()> {
    let length = input::open(path)?.metadata().map_err(|e| Error::io(path, e))?.len();
    let end = needed.and_then(|n| n.checked_add(from));
    if end.is_some_and(|end| end <= length) {
        return Ok(());
    }
    let end = end.map_or_else(|| "more than 2⁶⁴".to_owned(), |end| end.to_string());
    Err(Error::invalid(format!("the file has {length} bytes; by its header its values end at byte {end}"))
        .at(path)
        .hint("the file is incomplete, or its header damaged: copy it, or write it, again"))
}

/// Number of bytes of so many numbers; none if that overflows.
pub(crate) fn byte_count(size: [usize; 3], components: usize, bytes: usize) -> Option<u64> {
    let count = size.iter().try_fold(components as u64, |product, n| product.checked_mul(*n as u64))?;
    count.checked_mul(bytes as u64)
}

/// True if a file begins as streams of gzip do.
pub(crate) fn is_gzip(start: &[u8]) -> bool {
    start.starts_with(&[0x1f, 0x8b])
}

/// First bytes of a file, at most `most`.
///
/// # Errors
/// If it is no regular file, or cannot be read.
pub(crate) fn start(path: &Path, most: u64) -> Result<Vec<u8>> {
    let mut start = Vec::new();
    input::open(path)?.take(most).read_to_end(&mut start).map_err(|e| Error::io(path, e))?;
    Ok(start)
}

/// Path of a file that a header names, in the header's folder or below it. What a header names elsewhere is not read: a
/// file from somebody else could make others of the machine part of a volume that is passed on.
///
/// # Errors
/// If the name is empty, or leads out of the folder.
pub(crate) fn companion(header: &Path, name: &str) -> Result<PathBuf> {
    if name.is_empty() {
        return Err(Error::invalid("the header names no file of values")
            .hint("write the name of the file with the values into the header"));
    }
    below(header.parent().unwrap_or(Path::new("")), name).ok_or_else(|| {
        Error::invalid(format!(
            "the header names the file '{}', which does not lie in the header's folder",
            excerpt(name)
        ))
        .hint("move the file beside the header, and write its name without a folder into the header")
    })
}

/// Path of a file that a header names, as [`companion`] returns it, which is there.
///
/// # Errors
/// The conditions are those of [`companion`]; also if there is no such file.
pub(crate) fn present(header: &Path, name: &str) -> Result<PathBuf> {
    let path = companion(header, name)?;
    if path.exists() {
        return Ok(path);
    }
    Err(Error::invalid(format!("the header names the file '{}', which is not there", excerpt(name)))
        .coded(Code::NotFound)
        .hint("put the file beside the header, or correct its name in the header"))
}

/// Lists the files that a pattern of one number stands for, such as `slice_%03d.raw`, from `first` to `last` by `step`.
///
/// # Errors
/// If the pattern has no such number.
pub(crate) fn numbered(pattern: &str, numbers: impl Iterator<Item = i64>) -> Result<Vec<String>> {
    let split = pattern.split_once('%').and_then(|(head, rest)| {
        let end = rest.find('d')?;
        let digits = &rest[..end];
        let width: usize = if digits.is_empty() { 0 } else { digits.parse().ok().filter(|w| *w < 64)? };
        Some((head, digits.starts_with('0'), width, &rest[end + 1..]))
    });
    let (head, zeros, width, tail) = split.ok_or_else(|| {
        Error::invalid(format!("'{}' is no pattern of numbered files", excerpt(pattern)))
            .hint("a pattern has a number such as %03d")
    })?;
    Ok(numbers
        .map(|n| if zeros { format!("{head}{n:0width$}{tail}") } else { format!("{head}{n:width$}{tail}") })
        .collect())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn names_stay_in_their_folder() {
        let folder = Path::new("/data/scan");
        for (name, path) in [("a.raw", "a.raw"), ("./b/a.raw", "b/a.raw"), ("/data/scan/b/a.raw", "b/a.raw")] {
            assert_eq!(below(folder, name).unwrap().components().collect::<PathBuf>(), folder.join(path));
        }
        for name in ["../a.raw", "b/../../a.raw", "/etc/passwd", "/data/scan/../a.raw", "/data/scanner/a.raw"] {
            assert_eq!(below(folder, name), None, "{name}");
            let error = companion(&folder.join("a.mhd"), name).unwrap_err();
            assert!(error.to_string().contains(name) && error.remedy().is_some(), "{error}");
        }
        let here = std::path::absolute("a.raw").unwrap();
        assert_eq!(companion(Path::new("a.mhd"), here.to_str().unwrap()).unwrap(), Path::new("a.raw"));
        assert_eq!(companion(Path::new("a.mhd"), "a.raw").unwrap(), Path::new("a.raw"));
    }
}
