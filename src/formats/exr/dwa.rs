//! Checks of DWA chunks before they are decompressed.
//! A chunk begins with eleven 64-bit counters, and the `exr` crate (1.74.2) allocates what they say: a damaged one asks
//! for petabytes, which aborts the process.

use exr::block::chunk::{Chunk, CompressedBlock};
use exr::compression::Compression;
use exr::error::{Error, Result};
use exr::meta::header::Header;

/// Numbers of the counters that determine allocations: uncompressed sizes of the unknown section, of the run-length
/// section after and before its runs, and the numbers of AC and DC coefficients.
const ALLOCATED: [usize; 5] = [1, 6, 7, 8, 9];

/// Refuses a DWA chunk that asks for more memory than its pixels can need.
pub(super) fn check(chunk: &Chunk, header: &Header) -> Result<()> {
    if !matches!(header.compression, Compression::DWAA(_) | Compression::DWAB(_)) {
        return Ok(());
    }
    let bytes = match &chunk.compressed_block {
        CompressedBlock::ScanLine(block) => &block.compressed_pixels_le,
        CompressedBlock::Tile(block) => &block.compressed_pixels_le,
        _ => return Err(Error::NotSupported("deep data".into())),
    };
    let size =
        header.get_absolute_block_pixel_coordinates(header.get_block_data_indices(&chunk.compressed_block)?)?.size;
    if bytes.len() == size.area().saturating_mul(header.channels.bytes_per_pixel) {
        return Ok(()); // stored raw, without counters
    }
    // A sample is 4 bytes at most, or a coefficient of 2 bytes in blocks padded to 8x8. Run-length coding lengthens
    // incompressible data by less than a half.
    let samples = (size.0 + 8).saturating_mul(size.1 + 8).saturating_mul(header.channels.list.len());
    let limit = samples.saturating_mul(6).saturating_add(64) as u64;
    let (counters, _) = bytes.as_chunks::<8>();
    let asked = ALLOCATED.iter().filter_map(|&i| counters.get(i)).map(|c| u64::from_le_bytes(*c)).max();
    match asked {
        Some(asked) if asked > limit => Err(Error::Invalid(format!("a DWA chunk of {asked} bytes").into())),
        _ => Ok(()),
    }
}
