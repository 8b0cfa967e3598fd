//! Compression of blocks: ZIP by libdeflate, which takes a third of the time of the `exr` crate's; all else by the
//! crate.

use exr::block::UncompressedBlock;
use exr::block::chunk::{Chunk, CompressedBlock, CompressedScanLineBlock, CompressedTileBlock, TileCoordinates};
use exr::block::writer::ChunksWriter;
use exr::error::{Error, Result};
use exr::image::Image;
use exr::image::write::layers::{LayersWriter, WritableLayers};
use exr::meta::BlockDescription;
use exr::meta::attribute::Compression;
use exr::meta::header::Header;
use libdeflater::{CompressionLvl, Compressor};
use rayon::prelude::*;
use std::io::Cursor;

/// Level of the compression, from 1 to 12; that of OpenEXR.
const LEVEL: i32 = 4;

/// Number of blocks that are compressed side by side before they are written.
const BATCH: usize = 64;

/// Returns the file of an image.
///
/// # Errors
/// If the image cannot be a file, such as for names that are not unique.
pub(crate) fn file<'i, L: WritableLayers<'i>>(image: &'i Image<L>) -> Result<Vec<u8>> {
    let headers = image.layer_data.infer_headers(&image.attributes);
    let layers = image.layer_data.create_writer(&headers);
    let mut bytes = Cursor::new(Vec::new());
    exr::block::write(&mut bytes, headers, true, |meta, chunks| {
        let indices: Vec<_> = meta.enumerate_ordered_header_block_indices().collect();
        for batch in indices.chunks(BATCH) {
            let compressed = batch.par_iter().map_init(Packer::default, |packer, (at, index)| {
                let data = layers.extract_uncompressed_block(&meta.headers, *index);
                Ok((*at, packer.chunk(UncompressedBlock { index: *index, data }, &meta.headers)?))
            });
            for (at, chunk) in compressed.collect::<Result<Vec<_>>>()? {
                chunks.write_chunk(at, chunk)?;
            }
        }
        Ok(())
    })?;
    Ok(bytes.into_inner())
}

/// Compressor with its scratch.
#[derive(Default)]
pub(super) struct Packer {
    compressor: Option<Compressor>,
    /// Bytes of a block in the order of the format, and their differences.
    sorted: Vec<u8>,
    differences: Vec<u8>,
}

impl Packer {
    /// Returns a block as it stands in the file.
    fn chunk(&mut self, block: UncompressedBlock, headers: &[Header]) -> Result<Chunk> {
        let header = &headers[block.index.layer];
        let zip = matches!(header.compression, Compression::ZIP1 | Compression::ZIP16);
        // Bytes in the file are little-endian.
        if !zip || cfg!(target_endian = "big") {
            return block.compress_to_chunk(headers);
        }
        let UncompressedBlock { index, data } = block;
        let compressed_pixels_le = self.packed(data)?;
        let tile_index = index.pixel_position / header.max_block_pixel_size();
        let compressed_block = match header.blocks {
            BlockDescription::ScanLines => {
                let below =
                    i32::try_from(index.pixel_position.y()).map_err(|_| Error::Invalid("a row below 2³¹".into()))?;
                let y_coordinate = below + header.own_attributes.layer_position.y();
                CompressedBlock::ScanLine(CompressedScanLineBlock { y_coordinate, compressed_pixels_le })
            }
            BlockDescription::Tiles(_) => CompressedBlock::Tile(CompressedTileBlock {
                coordinates: TileCoordinates { tile_index, level_index: index.level },
                compressed_pixels_le,
            }),
        };
        Ok(Chunk { layer_index: index.layer, compressed_block })
    }

    /// Returns the bytes of a block in ZIP compression, or as they are if that is not shorter, as OpenEXR does.
    pub(super) fn packed(&mut self, data: Vec<u8>) -> Result<Vec<u8>> {
        differences(&data, &mut self.sorted, &mut self.differences);
        let level = CompressionLvl::new(LEVEL).unwrap_or_default();
        let compressor = self.compressor.get_or_insert_with(|| Compressor::new(level));
        let mut packed = vec![0; compressor.zlib_compress_bound(data.len())];
        let len = compressor.zlib_compress(&self.differences, &mut packed);
        packed.truncate(len.map_err(|_| Error::Invalid("a block that cannot be compressed".into()))?);
        Ok(if packed.len() < data.len() { packed } else { data })
    }
}

/// Writes the differences of consecutive bytes to `to`, after the bytes at even places were put before those at odd
/// ones (`sorted`): OpenEXR's preparation for ZIP.
fn differences(bytes: &[u8], sorted: &mut Vec<u8>, to: &mut Vec<u8>) {
    sorted.resize(bytes.len(), 0);
    let (even, odd) = sorted.split_at_mut(bytes.len().div_ceil(2));
    let (pairs, last) = bytes.as_chunks::<2>();
    for (([first, second], even), odd) in pairs.iter().zip(&mut *even).zip(odd) {
        (*even, *odd) = (*first, *second);
    }
    if let ([byte], Some(to)) = (last, even.last_mut()) {
        *to = *byte;
    }
    to.clear();
    to.extend(sorted.first());
    let pairs = sorted.iter().zip(sorted.iter().skip(1));
    to.extend(pairs.map(|(last, byte)| byte.wrapping_sub(*last).wrapping_add(128)));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_those_of_the_format() {
        let (mut sorted, mut to) = (Vec::new(), Vec::new());
        differences(&[10, 200, 11, 203, 9], &mut sorted, &mut to);
        assert_eq!(to, [10, 129, 126, (200_u8).wrapping_sub(9).wrapping_add(128), 131]);
        differences(&[], &mut sorted, &mut to);
        assert!(to.is_empty());
    }
}
