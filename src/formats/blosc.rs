//! Blosc 1 frames, as NanoVDB's and Zarr's files have them: blocks of LZ4, zlib or Zstandard, shuffled by bytes or
//! bits.
//!
//! Source: the format's description in c-blosc (`README_CHUNK_FORMAT.rst`).

use crate::error::{Error, Result};
use ruzstd::decoding::FrameDecoder;

/// Bytes of a frame's header.
const HEADER: usize = 16;
/// Least number of elements of a block that Blosc compresses byte by byte ("splits").
const LEAST_SPLIT: usize = 128;
/// Largest element that Blosc splits, in bytes.
const MOST_SPLIT: usize = 16;

/// Flag of frames whose bytes are shuffled.
const BYTE_SHUFFLE: u8 = 0x01;
/// Flag of frames that are not compressed.
const PLAIN: u8 = 0x02;
/// Flag of frames whose bits are shuffled.
const BIT_SHUFFLE: u8 = 0x04;
/// Flag of frames whose blocks are not split.
const UNSPLIT: u8 = 0x10;

fn damaged(what: impl Into<String>) -> Error {
    Error::invalid(what).hint("the file is damaged or incomplete: copy it again, or write it again where it was made")
}

/// A frame's header.
struct Header {
    version: u8,
    flags: u8,
    /// Bytes of an element, which shuffling is by.
    element: usize,
    /// Unpacked bytes of the frame.
    bytes: usize,
    /// Unpacked bytes of a block but the last.
    block: usize,
}

/// Little-endian word at `at`; none if it lies outside.
fn word(bytes: &[u8], at: usize) -> Option<usize> {
    let found = bytes.get(at..)?.first_chunk::<4>()?;
    usize::try_from(u32::from_le_bytes(*found)).ok()
}

impl Header {
    fn read(frame: &[u8]) -> Result<Self> {
        let (Some(bytes), Some(block), true) = (word(frame, 4), word(frame, 8), frame.len() >= HEADER) else {
            return Err(damaged(format!("a Blosc frame of {} bytes, less than its header has", frame.len())));
        };
        if bytes > 0 && block == 0 {
            return Err(damaged("a Blosc frame with blocks of 0 bytes"));
        }
        Ok(Self { version: frame[0], flags: frame[2], element: usize::from(frame[3]).max(1), bytes, block })
    }

    fn has(&self, flag: u8) -> bool {
        self.flags & flag != 0
    }

    /// Number of streams that a block of `bytes` is split into.
    fn streams(&self, bytes: usize) -> usize {
        let whole = bytes == self.block && self.block.is_multiple_of(self.element);
        let large = self.element <= MOST_SPLIT && bytes / self.element >= LEAST_SPLIT;
        if whole && large && !self.has(UNSPLIT) { self.element } else { 1 }
    }
}

/// Unpacks a frame of at most `most` bytes and appends it to `out`.
///
/// # Errors
/// If the frame is damaged, unpacks to more than `most` bytes or to none, or is packed by another codec.
pub(crate) fn decompress(frame: &[u8], most: usize, out: &mut Vec<u8>) -> Result<()> {
    let header = Header::read(frame)?;
    if header.bytes == 0 || header.bytes > most {
        return Err(damaged(format!("a Blosc frame of {} bytes; 1 to {most} are expected", header.bytes)));
    }
    if header.has(PLAIN) {
        let plain = frame.get(HEADER..HEADER + header.bytes);
        out.extend_from_slice(plain.ok_or_else(|| damaged("a Blosc frame ends early"))?);
        return Ok(());
    }
    let mut shuffled = Vec::new();
    for block in 0..header.bytes.div_ceil(header.block) {
        let packed = word(frame, HEADER + 4 * block).and_then(|start| frame.get(start..));
        let packed = packed.ok_or_else(|| damaged(format!("block {block} of a Blosc frame lies outside of it")))?;
        let bytes = header.block.min(header.bytes - block * header.block);
        shuffled.clear();
        block_of(&header, packed, bytes, &mut shuffled)?;
        if header.element > 1 && header.has(BYTE_SHUFFLE) {
            unshuffle(&shuffled, header.element, out);
        } else if header.has(BIT_SHUFFLE) {
            unshuffle_bits(&shuffled, &header, out);
        } else {
            out.extend_from_slice(&shuffled);
        }
    }
    Ok(())
}

/// Unpacks the streams of a block.
fn block_of(header: &Header, mut packed: &[u8], bytes: usize, out: &mut Vec<u8>) -> Result<()> {
    let streams = header.streams(bytes);
    let size = bytes / streams;
    for _ in 0..streams {
        let length = word(packed, 0).filter(|n| *n > 0);
        let stream = length.and_then(|n| packed.get(4..4_usize.checked_add(n)?));
        let stream = stream.ok_or_else(|| damaged("a stream of a Blosc frame is longer than the frame"))?;
        packed = &packed[4 + stream.len()..];
        if stream.len() == size {
            out.extend_from_slice(stream);
        } else {
            unpack(header.flags >> 5, stream, size, out)?;
        }
    }
    Ok(())
}

/// Unpacks a stream of `size` bytes by the codec of that number.
fn unpack(codec: u8, stream: &[u8], size: usize, out: &mut Vec<u8>) -> Result<()> {
    let start = out.len();
    out.resize(start + size, 0);
    let into = &mut out[start..];
    let done = match codec {
        1 => lz4_flex::block::decompress_into(stream, into).map_err(|e| e.to_string()),
        3 => libdeflater::Decompressor::new().zlib_decompress(stream, into).map_err(|e| e.to_string()),
        4 => FrameDecoder::new().decode_all(stream, into).map_err(|e| e.to_string()),
        other => {
            let name = ["BloscLZ", "", "Snappy"].get(usize::from(other)).copied().unwrap_or("an unknown codec");
            return Err(Error::unsupported(format!("Blosc with {name} is not read"))
                .hint("write the file with Blosc's lz4, zlib or zstd"));
        }
    };
    match done {
        Ok(n) if n == size => Ok(()),
        Ok(n) => Err(damaged(format!("a stream of a Blosc frame has {n} bytes, {size} are expected"))),
        Err(e) => Err(damaged(format!("a stream of a Blosc frame is damaged: {e}"))),
    }
}

/// Brings the bytes of elements together, of which all first bytes come first, then all second ones, and so on. Bytes
/// behind the last whole element stay.
fn unshuffle(bytes: &[u8], element: usize, out: &mut Vec<u8>) {
    let count = bytes.len() / element;
    let start = out.len();
    out.resize(start + count * element, 0);
    let into = &mut out[start..];
    for (byte, plane) in bytes.chunks_exact(count.max(1)).take(element).enumerate() {
        plane.iter().enumerate().for_each(|(i, b)| into[i * element + byte] = *b);
    }
    out.extend_from_slice(&bytes[count * element..]);
}

/// Brings the bits of elements together: bit b of byte B of all elements is a row of bits, and rows are in ascending
/// order of B, then of b. Elements behind the last group of eight stay; before version 3, a block with such elements is
/// not shuffled at all.
fn unshuffle_bits(bytes: &[u8], header: &Header, out: &mut Vec<u8>) {
    let element = header.element;
    let count = bytes.len() / element;
    let groups = if count.is_multiple_of(8) || header.version > 2 { count / 8 } else { 0 };
    let start = out.len();
    out.resize(start + groups * 8 * element, 0);
    let into = &mut out[start..];
    for (row, bits) in bytes.chunks_exact(groups.max(1)).take(if groups > 0 { 8 * element } else { 0 }).enumerate() {
        let (byte, bit) = (row / 8, row % 8);
        for (group, packed) in bits.iter().enumerate() {
            for i in 0..8 {
                into[(group * 8 + i) * element + byte] |= (packed >> i & 1) << bit;
            }
        }
    }
    out.extend_from_slice(&bytes[groups * 8 * element..]);
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    /// A frame of one block per `block` bytes, each one stream, already packed.
    fn frame(flags: u8, element: u8, bytes: usize, block: usize, packed: &[Vec<u8>]) -> Vec<u8> {
        let mut frame = vec![2, 1, flags | UNSPLIT, element];
        frame.extend((bytes as u32).to_le_bytes());
        frame.extend((block as u32).to_le_bytes());
        frame.extend([0; 4]);
        let mut at = HEADER + 4 * packed.len();
        for part in packed {
            frame.extend((at as u32).to_le_bytes());
            at += 4 + part.len();
        }
        for part in packed {
            frame.extend((part.len() as u32).to_le_bytes());
            frame.extend(part);
        }
        frame
    }

    fn unpacked(frame: &[u8]) -> Result<Vec<u8>> {
        let mut out = Vec::new();
        decompress(frame, 1 << 20, &mut out).map(|()| out)
    }

    /// Shuffled as c-blosc does, by its definition: byte B of element i goes to B * count + i.
    #[test]
    fn bytes_of_elements_come_together() {
        let values: Vec<u8> = (0..12 * 100).map(|i| (i * 7 % 251) as u8).collect();
        let count = values.len() / 4;
        let shuffled: Vec<u8> = (0..values.len()).map(|i| values[i % count * 4 + i / count]).collect();
        let packed = lz4_flex::block::compress(&shuffled);
        let frame = frame(1 << 5 | BYTE_SHUFFLE, 4, values.len(), values.len(), &[packed]);
        assert_eq!(unpacked(&frame).unwrap(), values);
    }

    #[test]
    fn bits_of_elements_come_together_and_a_rest_stays() {
        // Two elements groups of eight 16-bit elements; row (byte, bit) holds that bit of all elements.
        let values: Vec<u8> = (0..2 * 16).map(|i| (i * 37 + 5) as u8).collect();
        let mut shuffled = vec![0; values.len()];
        for (i, element) in values.chunks(2).enumerate() {
            for bit in 0..16 {
                shuffled[bit * 2 + i / 8] |= (element[bit / 8] >> (bit % 8) & 1) << (i % 8);
            }
        }
        let mut deflater = libdeflater::Compressor::new(libdeflater::CompressionLvl::default());
        let mut packed = vec![0; 100];
        let n = deflater.zlib_compress(&shuffled, &mut packed).unwrap();
        packed.truncate(n);
        assert_eq!(unpacked(&frame(3 << 5 | BIT_SHUFFLE, 2, 32, 32, &[packed])).unwrap(), values);
        // Nine elements are not shuffled by version 2.
        let odd: Vec<u8> = (0..18).collect();
        assert_eq!(unpacked(&frame(BIT_SHUFFLE, 2, 18, 18, std::slice::from_ref(&odd))).unwrap(), odd);
    }

    #[test]
    fn blocks_follow_each_other_and_damage_is_named() {
        let values: Vec<u8> = (0..300_u32).map(|i| (i / 9) as u8).collect();
        let packed: Vec<Vec<u8>> = values.chunks(128).map(lz4_flex::block::compress).collect();
        let whole = frame(1 << 5, 1, 300, 128, &packed);
        assert_eq!(unpacked(&whole).unwrap(), values);
        assert!(decompress(&whole, 299, &mut Vec::new()).unwrap_err().to_string().contains("1 to 299"));
        (0..whole.len()).for_each(|n| assert!(unpacked(&whole[..n]).is_err(), "{n}"));
        for at in 0..HEADER + 12 {
            for value in [0, 0x7f, 0xff] {
                let mut damaged = whole.clone();
                damaged[at] = value;
                let _ = unpacked(&damaged);
            }
        }
        assert!(unpacked(&frame(2 << 5, 1, 4, 4, &[vec![1]])).unwrap_err().to_string().contains("Snappy"));
    }
}
