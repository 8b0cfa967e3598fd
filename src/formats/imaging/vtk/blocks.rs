//! Binary values of VTK's XML: a count of bytes before them, or blocks that are packed by zlib or LZ4.

use crate::formats::imaging::input::Zlib;
use crate::formats::sample::Endian;
use std::io::{BufReader, Error, ErrorKind, Read, Result};

/// How blocks are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Packing {
    /// A stream of zlib for each block.
    Zlib,
    /// A block of LZ4 for each block.
    Lz4,
}

/// Type of the counts: 32 or 64 bits, in the file's order of bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Counts {
    /// True for 64 bits.
    pub wide: bool,
    /// Order of the bytes.
    pub endian: Endian,
}

impl Counts {
    fn read(self, reader: &mut impl Read) -> Result<u64> {
        let mut bytes = [0; 8];
        let length = if self.wide { 8 } else { 4 };
        reader.read_exact(&mut bytes[..length])?;
        Ok(match self.endian {
            Endian::Little => u64::from_le_bytes(bytes),
            Endian::Big => u64::from_be_bytes(bytes) >> (64 - 8 * length),
        })
    }
}

fn wrong(what: String) -> Error {
    Error::new(ErrorKind::InvalidData, what)
}

/// Values behind their count of bytes, which must be `expected`.
pub(crate) fn plain<R: Read + 'static>(mut reader: R, counts: Counts, expected: u64) -> Result<Box<dyn Read>> {
    let length = counts.read(&mut reader)?;
    if length != expected {
        return Err(wrong(format!("{length} bytes are stated, {expected} are expected")));
    }
    Ok(Box::new(reader.take(length)))
}

/// Values in packed blocks.
pub(crate) struct Blocks<R> {
    reader: R,
    packing: Packing,
    /// Packed sizes of the blocks, the first one last.
    left: Vec<u64>,
    size: u64,
    last: u64,
    unpacked: Vec<u8>,
    at: usize,
}

impl<R: Read> Blocks<R> {
    /// Reads the table of blocks, which must unpack to `expected` bytes; a block has at most `most`.
    pub(crate) fn new(mut reader: R, packing: Packing, counts: Counts, expected: u64, most: u64) -> Result<Self> {
        let [count, size, partial] = [counts.read(&mut reader)?, counts.read(&mut reader)?, counts.read(&mut reader)?];
        let whole = if partial > 0 { count.saturating_sub(1) } else { count };
        let total = whole.checked_mul(size).and_then(|n| n.checked_add(partial));
        if total != Some(expected) {
            return Err(wrong(format!("{count} blocks of {size} bytes, and {partial}, are not {expected}")));
        }
        let last = if partial > 0 { partial } else { size };
        if size.max(last) > most {
            return Err(wrong(format!("blocks of {} bytes do not fit into memory", size.max(last))));
        }
        // The list grows with what is there, whatever the count says.
        let mut left = Vec::new();
        for _ in 0..count {
            left.push(counts.read(&mut reader)?);
        }
        left.reverse();
        Ok(Self { reader, packing, left, size, last, unpacked: Vec::new(), at: 0 })
    }

    fn next_block(&mut self) -> Result<()> {
        let Some(packed) = self.left.pop() else { return Ok(()) };
        let size = if self.left.is_empty() { self.last } else { self.size };
        self.unpacked.clear();
        self.at = 0;
        let mut block = (&mut self.reader).take(packed);
        match self.packing {
            Packing::Zlib => {
                let mut stream = Zlib::new(BufReader::new(&mut block));
                (&mut stream).take(size).read_to_end(&mut self.unpacked)?;
                // The checksum lies behind the last byte, and is compared when the end is read.
                if size > 0 && stream.read(&mut [0])? > 0 {
                    return Err(wrong(format!("a block has more than the {size} bytes that are expected")));
                }
            }
            Packing::Lz4 => {
                // What cannot be packed becomes larger by 1/255 and 16 bytes at most.
                let mut bytes = Vec::new();
                (&mut block).take(size + size / 255 + 16).read_to_end(&mut bytes)?;
                self.unpacked.resize(size as usize, 0);
                let count = lz4_flex::block::decompress_into(&bytes, &mut self.unpacked);
                self.unpacked.truncate(count.map_err(|e| wrong(format!("a block of LZ4 is damaged: {e}")))?);
            }
        }
        if self.unpacked.len() as u64 != size {
            return Err(wrong(format!("a block has {} bytes, {size} are expected", self.unpacked.len())));
        }
        std::io::copy(&mut block, &mut std::io::sink())?;
        Ok(())
    }
}

impl<R: Read> Read for Blocks<R> {
    fn read(&mut self, out: &mut [u8]) -> Result<usize> {
        if self.at == self.unpacked.len() {
            self.unpacked.clear();
            self.next_block()?;
        }
        let n = out.len().min(self.unpacked.len() - self.at);
        out[..n].copy_from_slice(&self.unpacked[self.at..self.at + n]);
        self.at += n;
        Ok(n)
    }
}
