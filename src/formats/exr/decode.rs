//! From chunks to planes over the display window.

use super::header::{Header, Reader};
use super::{SampleType, Window, dwa, fault};
use crate::error::{Error, Result};
use exr::block::UncompressedBlock;
use exr::block::reader::ChunksReader;
use exr::math::Vec2;
use rayon::prelude::*;
use std::collections::HashSet;
use std::path::Path;

/// A channel by its part and its place in the part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Source {
    pub part: usize,
    pub channel: usize,
}

/// Samples of a channel over the display window, row-major.
#[derive(Debug)]
pub(super) struct Plane {
    pub samples: Vec<f32>,
    /// NaN and infinite samples inside the display window.
    pub non_finite: usize,
}

/// Chunks decompressed at a time; enough for any number of cores, few enough to need little memory.
const BATCH: usize = 64;

/// Reads the channels named by `sources`, in their order.
pub(super) fn planes(path: &Path, reader: Reader, header: &Header, sources: &[Source]) -> Result<Vec<Plane>> {
    for s in sources {
        let channel = &header.parts[s.part].channels[s.channel];
        if channel.sampling != [1, 1] {
            return Err(Error::unsupported(format!(
                "channel '{}' is subsampled {}x{} (luminance and chroma)",
                channel.name, channel.sampling[0], channel.sampling[1]
            ))
            .hint("write it as R, G, B at full resolution")
            .at(path));
        }
        // One subsampled channel changes the layout of the whole part's chunks.
        if let Some(other) = header.parts[s.part].channels.iter().find(|c| c.sampling != [1, 1]) {
            return Err(Error::unsupported(format!("channel '{}' of the same part is subsampled", other.name))
                .hint("write it at full resolution")
                .at(path));
        }
    }
    let display = header.display_window;
    let mut planes: Vec<Plane> = sources
        .iter()
        .map(|_| Plane { samples: vec![0.0; display.size[0] * display.size[1]], non_finite: 0 })
        .collect();

    let wanted = |part: usize| sources.iter().any(|s| s.part == part);
    let mut chunks = fault::translated(path, || {
        reader.filter_chunks(false, |_, tile, block| tile.level_index == Vec2(0, 0) && wanted(block.layer))
    })?;
    let expected = chunks.expected_chunk_count();
    let meta = chunks.meta_data().clone();
    let mut seen = HashSet::with_capacity(expected);
    loop {
        let batch = fault::translated(path, || chunks.by_ref().take(BATCH).collect::<exr::error::Result<Vec<_>>>())?;
        if batch.is_empty() {
            break;
        }
        let blocks: Vec<UncompressedBlock> = batch
            .into_par_iter()
            .map(|chunk| {
                fault::translated(path, || {
                    if let Some(header) = meta.headers.get(chunk.layer_index) {
                        dwa::check(&chunk, header)?;
                    }
                    UncompressedBlock::decompress_chunk(chunk, &meta, false)
                })
            })
            .collect::<Result<_>>()?;
        for block in blocks {
            let at = (block.index.layer, block.index.pixel_position.0, block.index.pixel_position.1);
            if block.index.level != Vec2(0, 0) || !wanted(block.index.layer) || !seen.insert(at) {
                return Err(fault::damaged("its table of chunks points to the wrong places").at(path));
            }
            place(&block, header, sources, &meta, display, &mut planes);
        }
    }
    Ok(planes)
}

/// Copies what lies in the display window.
fn place(
    block: &UncompressedBlock,
    header: &Header,
    sources: &[Source],
    meta: &exr::meta::MetaData,
    display: Window,
    planes: &mut [Plane],
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
        let row = y as usize * display.size[0];
        for (source, plane) in sources.iter().zip(planes.iter_mut()) {
            if source.part != part || source.channel != line.location.channel {
                continue;
            }
            let target = &mut plane.samples[row + from as usize..row + to as usize];
            let kind = header.parts[part].channels[source.channel].sample_type;
            fill(target, kind, line.value, (from - x) as usize);
            plane.non_finite += target.iter().filter(|v| !v.is_finite()).count();
        }
    }
}

/// Converts samples (in the machine's byte order, as the crate hands them out) from number `first` on.
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
