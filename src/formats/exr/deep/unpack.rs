//! Compression of deep chunks.

use crate::error::{Error, Result};
use crate::formats::exr::fault;
use exr::meta::attribute::Compression;
use libdeflater::Decompressor;

/// Returns the most bytes that packed ones can become: Deflate makes at most 1032 of one, run lengths 128 of two.
pub(super) fn most_unpacked(compression: Compression, packed: u64) -> u64 {
    match compression {
        Compression::RLE => packed.saturating_mul(64),
        Compression::ZIP1 => packed.saturating_mul(1032),
        _ => packed,
    }
}

/// Unpacks bytes, which stand as they are if packing had not made them fewer.
///
/// # Errors
/// If the bytes do not become `length` bytes.
pub(super) fn unpacked(compression: Compression, packed: &[u8], length: usize) -> Result<Vec<u8>> {
    if packed.len() == length { Ok(packed.to_vec()) } else { decompressed(compression, packed, length) }
}

/// Unpacks a table of counts of `length` bytes. Where a picture ends within a tile, OpenEXR's C++ library packs the
/// part that is there only if that makes less than the `whole` table of a tile, and writes as many bytes as the latter
/// has otherwise; other writers compare with the part.
///
/// # Errors
/// If the bytes do not become `length` bytes.
pub(super) fn unpacked_table(
    compression: Compression,
    packed: &[u8],
    (length, whole): (usize, u64),
) -> Result<Vec<u8>> {
    match packed.get(..length) {
        Some(start) if packed.len() as u64 == whole => Ok(start.to_vec()),
        // Numbers of samples are no sound packed bytes of the same length.
        Some(start) if packed.len() == length => {
            decompressed(compression, packed, length).or_else(|_| Ok(start.to_vec()))
        }
        _ => decompressed(compression, packed, length),
    }
}

fn decompressed(compression: Compression, packed: &[u8], length: usize) -> Result<Vec<u8>> {
    let mut bytes = match compression {
        Compression::ZIP1 => inflated(packed, length)?,
        Compression::RLE => run_lengths(packed, length)?,
        _ => return Err(wrong(length)),
    };
    for i in 1..bytes.len() {
        bytes[i] = bytes[i].wrapping_add(bytes[i - 1]).wrapping_sub(128);
    }
    // The bytes at even places stand before those at odd ones.
    let (even, odd) = bytes.split_at(length.div_ceil(2));
    Ok((0..length).map(|i| if i % 2 == 0 { even[i / 2] } else { odd[i / 2] }).collect())
}

fn wrong(length: usize) -> Error {
    fault::damaged(&format!("a deep chunk does not unpack to the {length} bytes that it states"))
}

fn inflated(packed: &[u8], length: usize) -> Result<Vec<u8>> {
    let mut bytes = vec![0; length];
    match Decompressor::new().zlib_decompress(packed, &mut bytes) {
        Ok(written) if written == length => Ok(bytes),
        _ => Err(wrong(length)),
    }
}

/// Unpacks run lengths: a count below 0 stands before as many bytes, another before one that is repeated once more
/// than the count says.
fn run_lengths(packed: &[u8], length: usize) -> Result<Vec<u8>> {
    let mut bytes = Vec::with_capacity(length);
    let mut rest = packed;
    while let [count, behind @ ..] = rest {
        let count = i8::from_ne_bytes([*count]);
        let taken = if count < 0 { usize::from(count.unsigned_abs()) } else { 1 };
        let Some((run, behind)) = behind.split_at_checked(taken) else { return Err(wrong(length)) };
        match count {
            ..0 => bytes.extend_from_slice(run),
            _ => bytes.extend(std::iter::repeat_n(run[0], usize::from(count.unsigned_abs()) + 1)),
        }
        if bytes.len() > length {
            return Err(wrong(length));
        }
        rest = behind;
    }
    if bytes.len() == length { Ok(bytes) } else { Err(wrong(length)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_unpacked() {
        // Three bytes as they are, then one four times: sums of the differences from 128.
        let packed = [(-3_i8) as u8, 10, 129, 127, 3, 128];
        let bytes = unpacked(Compression::RLE, &packed, 7).unwrap();
        // 10, 11, 10, 10 at even places, 10, 10, 10 at odd ones.
        assert_eq!(bytes, [10, 10, 11, 10, 10, 10, 10]);
        for (packed, length) in [(&packed[..5], 7), (&packed[..], 5), (&packed[..], 8), (&[0xfd, 1][..], 3)] {
            assert!(unpacked(Compression::RLE, packed, length).is_err());
        }
    }
}
