//! Decompression of a grid's memory.

use super::bytes::DAMAGED;
use crate::error::{Error, Result};
use crate::formats::blosc;

/// Compression of the grids of a segment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Codec {
    /// The grid's memory as it is.
    None,
    /// One zlib stream.
    Zip,
    /// Blosc frames of up to 1 GiB each.
    Blosc,
}

/// Largest ratio of zlib (1032) and of LZ4 (255), rounded up: a size beyond it is refused before it is allocated.
const MOST_RATIO: u64 = 1040;
/// Bytes of the length before each packed part.
const LENGTH: usize = 8;

/// Unpacks the `size` bytes of a grid. The caller has checked `size` against the limits.
///
/// # Errors
/// If the stream is damaged, or unpacks to another size.
pub(super) fn unpack(stored: Vec<u8>, codec: Codec, size: u64) -> Result<Vec<u8>> {
    let found = stored.len() as u64;
    let possible = match codec {
        Codec::None => found == size,
        Codec::Zip | Codec::Blosc => size / MOST_RATIO <= found,
    };
    let (true, Ok(count)) = (possible, usize::try_from(size)) else {
        return Err(Error::invalid(format!("{found} bytes in the file for a grid of {size} bytes")).hint(DAMAGED));
    };
    match codec {
        Codec::None => Ok(stored),
        Codec::Zip => {
            let mut memory = vec![0; count];
            let packed = part(&stored)?.0;
            let done = libdeflater::Decompressor::new().zlib_decompress(packed, &mut memory);
            if !matches!(done, Ok(n) if n == count) {
                return Err(
                    Error::invalid(format!("the zlib stream does not give {size} bytes ({done:?})")).hint(DAMAGED)
                );
            }
            Ok(memory)
        }
        Codec::Blosc => {
            let mut memory = Vec::with_capacity(count);
            let mut rest = &stored[..];
            while memory.len() < count {
                let (packed, next) = part(rest)?;
                blosc::decompress(packed, count - memory.len(), &mut memory)?;
                rest = next;
            }
            Ok(memory)
        }
    }
}

/// Splits off a part, whose length stands before it.
fn part(stored: &[u8]) -> Result<(&[u8], &[u8])> {
    let split = stored.split_first_chunk::<LENGTH>().and_then(|(length, rest)| {
        let length = usize::try_from(u64::from_le_bytes(*length)).ok()?;
        rest.split_at_checked(length).filter(|_| length > 0)
    });
    split.ok_or_else(|| Error::invalid("a packed part is longer than the grid in the file").hint(DAMAGED))
}
