//! Reading of PNG pictures with the `png` crate.

use super::{Header, Options, Samples, check_size, color_space, film};
use crate::error::{Error, Result};
use crate::formats::input;
use crate::formats::limits::Limits;
use crate::scene::color_space::ColorSpace;
use crate::scene::film::Film;
use png::{BitDepth, ColorType, Decoder, DecodingError, Reader, Transformations};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Largest number of bytes that the decoder may take beside the picture, for text and color profiles.
const CHUNKS: usize = 1 << 26;

/// Reads the header of a picture.
pub(crate) fn header(path: &Path) -> Result<Header> {
    Ok(of(&open(path)?))
}

/// Reads a picture as a film; palettes and fewer than 8 bits are expanded.
pub(crate) fn read(path: &Path, options: &Options) -> Result<Film> {
    let mut reader = open(path)?;
    let header = of(&reader);
    color_space(&header, options)?;
    let (color, depth) = reader.output_color_type();
    let depth = if depth == BitDepth::Sixteen { 16 } else { 8 };
    let channels = color.samples();
    check_size(header.size, (channels * usize::from(depth / 8)) as u64, options.limits)?;
    let size = reader.output_buffer_size().ok_or_else(|| Error::unsupported("a picture beyond the address space"))?;
    let mut bytes = vec![0; size];
    reader.next_frame(&mut bytes).map_err(fault)?;
    film(&Samples { header, channels, bytes: &bytes, depth }, options)
}

fn open(path: &Path) -> Result<Reader<BufReader<File>>> {
    let limits = png::Limits { bytes: CHUNKS.min(usize::try_from(Limits::default().max_memory).unwrap_or(CHUNKS)) };
    let mut decoder = Decoder::new_with_limits(BufReader::new(input::open(path)?), limits);
    decoder.set_ignore_text_chunk(true);
    decoder.set_transformations(Transformations::EXPAND);
    decoder.read_info().map_err(fault)
}

fn of(reader: &Reader<BufReader<File>>) -> Header {
    let info = reader.info();
    let bits = match (info.color_type, info.bit_depth) {
        // An index has fewer bits than the colors of the palette.
        (ColorType::Indexed, _) => 8,
        (_, depth) => depth as u8,
    };
    Header {
        size: [info.width as usize, info.height as usize],
        bits: Some(bits),
        color_space: info.srgb.map(|_| ColorSpace::Srgb),
    }
}

fn fault(error: DecodingError) -> Error {
    match error {
        DecodingError::IoError(e) if e.kind() != std::io::ErrorKind::UnexpectedEof => Error::system(e),
        DecodingError::LimitsExceeded => Error::unsupported("the PNG takes more memory than a picture needs")
            .hint("write it again without text and color profiles"),
        other => Error::invalid(format!("the PNG is damaged: {other}")).hint("copy or write the picture again"),
    }
}
