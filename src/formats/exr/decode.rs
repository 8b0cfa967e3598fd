//! Decoding of chunks into rows over the display window.

use super::header::{self, Header, Reader};
use super::{SampleType, Window, deep, dwa, fault};
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::ordered;
use exr::block::UncompressedBlock;
use exr::block::reader::ChunksReader;
use exr::math::Vec2;
use exr::meta::{BlockDescription, MetaData};
use rayon::prelude::*;
use std::collections::HashSet;
use std::path::Path;

/// A channel: the number of its part, and its number within the part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Source {
    pub part: usize,
    pub channel: usize,
}

/// Consecutive samples of a row of the display window.
#[derive(Debug)]
pub(super) struct Row<'a> {
    /// Number of the channel in the list of requested sources.
    pub source: usize,
    /// Column of the first sample, from the display window's left edge.
    pub x: usize,
    /// Row of the samples, from the display window's top.
    pub y: usize,
    /// Samples converted to `f32`.
    pub samples: &'a [f32],
}

/// Number of chunks per thread that are decompressed at a time: enough to keep all threads busy, few enough that
/// allocators retain little memory.
const CHUNKS_PER_THREAD: usize = 8;
/// Bytes of chunks that are decompressed at a time; a single chunk may be larger.
const BATCH_BYTES: u64 = 1 << 28;
/// Memory of a chunk while it is decoded, in units of its pixels' bytes: compressed, unpacked, reordered.
const CHUNK_COPIES: u64 = 3;
/// Bytes that are kept for each chunk of the file: its entry in the table, and the mark that it was seen.
const CHUNK_ENTRY: u64 = 64;

/// Hands the samples of the channels in `sources` to `take`, chunk by chunk in file order. Samples outside the display
/// window are left out.
///
/// `held` is the number of bytes that the caller has allocated for the samples, or will. Together with the chunks being
/// decoded it must stay below `limits`, which is checked first.
///
/// # Errors
/// If a part has subsampled channels, memory does not suffice, or the file is damaged or cannot be read.
pub(super) fn rows(
    path: &Path,
    reader: Reader,
    header: &Header,
    sources: &[Source],
    (held, limits): (u64, Limits),
    mut take: impl FnMut(Row<'_>),
) -> Result<()> {
    let display = header.display_window;
    let mut line = Vec::new();
    blocks(path, reader, header, sources, (held, limits), |block, meta| {
        cropped(block, header, sources, meta, display, &mut line, &mut take);
    })
}

/// Hands the blocks of the parts of `sources` to `take`, unpacked, in file order.
///
/// # Errors
/// The conditions are those of [`rows`].
pub(super) fn blocks(
    path: &Path,
    reader: Reader,
    header: &Header,
    sources: &[Source],
    (held, limits): (u64, Limits),
    mut take: impl FnMut(&UncompressedBlock, &MetaData),
) -> Result<()> {
    check_sampling(path, header, sources)?;
    let wanted = |part: usize| sources.iter().any(|s| s.part == part);
    let parts = || reader.headers().iter().enumerate().filter(|(i, _)| wanted(*i)).map(|(_, h)| h);
    let chunk = CHUNK_COPIES * parts().map(chunk_bytes).max().unwrap_or(0);
    let entries = CHUNK_ENTRY * reader.headers().iter().map(|h| h.chunk_count as u64).sum::<u64>();
    let working = chunk.saturating_add(entries);
    if held.saturating_add(working) > limits.max_memory {
        let error = fault::too_large(header.display_window, sources.len(), held, working, limits.max_memory);
        return Err(error.at(path));
    }
    let spare = (limits.max_memory - held - entries).min(BATCH_BYTES);
    let most = CHUNKS_PER_THREAD * rayon::current_num_threads();
    let batch = usize::try_from(spare / chunk.max(1)).unwrap_or(most).clamp(1, most);

    let mut chunks = fault::translated(path, || {
        reader.filter_chunks(false, |_, tile, block| tile.level_index == Vec2(0, 0) && wanted(block.layer))
    })?;
    let expected = chunks.expected_chunk_count();
    let meta = chunks.meta_data().clone();
    let mut seen = HashSet::with_capacity(expected);
    loop {
        let batch = fault::translated(path, || chunks.by_ref().take(batch).collect::<exr::error::Result<Vec<_>>>())?;
        if batch.is_empty() {
            break;
        }
        let blocks = ordered::try_map(batch.into_par_iter(), |chunk| {
            fault::translated(path, || {
                if let Some(header) = meta.headers.get(chunk.layer_index) {
                    dwa::check(&chunk, header)?;
                }
                UncompressedBlock::decompress_chunk(chunk, &meta, false)
            })
        })?;
        for block in blocks {
            let at = (block.index.layer, block.index.pixel_position.0, block.index.pixel_position.1);
            if block.index.level != Vec2(0, 0) || !wanted(block.index.layer) || !seen.insert(at) {
                return Err(fault::damaged("its table of chunks points to the wrong places").at(path));
            }
            take(&block, &meta);
        }
    }
    Ok(())
}

/// True if a file can be read as an OpenEXR file, and all of its chunks can be decoded: a crash may leave a file of the
/// right length that ends in zeros. Parts with subsampled channels, which are not decoded, do not count.
pub(crate) fn is_whole(path: &Path) -> bool {
    if deep::is_deep(path) {
        return deep::is_whole(path);
    }
    let whole = || {
        let (reader, header) = header::open(path)?;
        let parts = header.parts.iter().enumerate();
        let decoded = parts.filter(|(_, part)| part.channels.iter().all(|channel| channel.sampling == [1, 1]));
        let sources: Vec<Source> = decoded.map(|(part, _)| Source { part, channel: 0 }).collect();
        blocks(path, reader, &header, &sources, (0, Limits::default()), |_, _| ())
    };
    whole().is_ok()
}

/// Refuses sources whose parts have a subsampled channel.
fn check_sampling(path: &Path, header: &Header, sources: &[Source]) -> Result<()> {
    for s in sources {
        let channel = &header.parts[s.part].channels[s.channel];
        if channel.sampling != [1, 1] {
            return Err(Error::unsupported(format!(
                "channel '{}' is subsampled {}x{} (luminance and chroma)",
                channel.name, channel.sampling[0], channel.sampling[1]
            ))
            .hint(fault::SUBSAMPLED)
            .at(path));
        }
        // One subsampled channel changes the layout of the whole part's chunks.
        if let Some(other) = header.parts[s.part].channels.iter().find(|c| c.sampling != [1, 1]) {
            return Err(Error::unsupported(format!("channel '{}' of the same part is subsampled", other.name))
                .hint(fault::SUBSAMPLED)
                .at(path));
        }
    }
    Ok(())
}

/// Largest number of bytes of pixels in a chunk of a part.
fn chunk_bytes(header: &exr::meta::header::Header) -> u64 {
    let window = header.layer_size;
    let size = match header.blocks {
        BlockDescription::ScanLines => Vec2(window.0, header.compression.scan_lines_per_block()),
        BlockDescription::Tiles(tiles) => tiles.tile_size,
    };
    let pixels = size.0.min(window.0) as u64 * size.1.min(window.1) as u64;
    pixels.saturating_mul(header.channels.bytes_per_pixel as u64)
}

/// Hands those samples of a block to `take` that lie in the display window.
fn cropped(
    block: &UncompressedBlock,
    header: &Header,
    sources: &[Source],
    meta: &MetaData,
    display: Window,
    samples: &mut Vec<f32>,
    take: &mut impl FnMut(Row<'_>),
) {
    let part = block.index.layer;
    let data = header.parts[part].data_window;
    for line in block.lines(&meta.headers[part].channels) {
        let y = i64::from(data.min[1]) + line.location.position.1 as i64 - i64::from(display.min[1]);
        let x = i64::from(data.min[0]) + line.location.position.0 as i64 - i64::from(display.min[0]);
        let (from, to) = (x.max(0), (x + line.location.sample_count as i64).min(display.size[0] as i64));
        if y < 0 || y >= display.size[1] as i64 || from >= to {
            continue;
        }
        for (number, source) in sources.iter().enumerate() {
            if source.part != part || source.channel != line.location.channel {
                continue;
            }
            samples.resize((to - from) as usize, 0.0);
            let kind = header.parts[part].channels[source.channel].sample_type;
            fill(samples, kind, line.value, (from - x) as usize);
            take(Row { source: number, x: from as usize, y: y as usize, samples });
        }
    }
}

/// Converts samples to `f32` from number `first` on. The bytes are in the machine's order, as the `exr` crate delivers
/// them.
fn fill(target: &mut [f32], kind: SampleType, bytes: &[u8], first: usize) {
    match kind {
        SampleType::Half => {
            let (samples, _) = bytes.as_chunks::<2>();
            for (t, s) in target.iter_mut().zip(&samples[first..]) {
                *t = half::f16::from_ne_bytes(*s).to_f32();
            }
        }
        SampleType::Float => {
            let (samples, _) = bytes.as_chunks::<4>();
            for (t, s) in target.iter_mut().zip(&samples[first..]) {
                *t = f32::from_ne_bytes(*s);
            }
        }
        SampleType::Uint => {
            let (samples, _) = bytes.as_chunks::<4>();
            for (t, s) in target.iter_mut().zip(&samples[first..]) {
                *t = u32::from_ne_bytes(*s) as f32;
            }
        }
    }
}
