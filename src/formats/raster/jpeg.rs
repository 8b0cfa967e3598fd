//! Reading of JPEG pictures with the `zune-jpeg` crate.

use super::{Header, Options, Samples, check_size, color_space, film};
use crate::error::{Error, Result};
use crate::formats::input;
use crate::scene::film::Film;
use std::path::Path;
use zune_jpeg::JpegDecoder;
use zune_jpeg::errors::DecodeErrors;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace as Components;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Largest size of a file in bytes: four for each pixel allowed.
const MAX_BYTES: u64 = 4 * super::MAX_PIXELS;
/// Bytes for each pixel while a picture is decoded: samples, and the coefficients of a progressive file.
const HELD: u64 = 3 + 3 * 2;

/// Reads the header of a picture.
pub(crate) fn header(path: &Path) -> Result<Header> {
    let bytes = input::bytes(path, MAX_BYTES, "a JPEG")?;
    Ok(open(&bytes)?.1)
}

/// Reads a picture as a film.
pub(crate) fn read(path: &Path, options: &Options) -> Result<Film> {
    let bytes = input::bytes(path, MAX_BYTES.min(options.limits.max_memory), "a JPEG")?;
    let (mut decoder, header) = open(&bytes)?;
    color_space(&header, options)?;
    check_size(header.size, HELD, options.limits)?;
    let bytes = decoder.decode().map_err(fault)?;
    film(&Samples { header, channels: 3, bytes: &bytes, depth: 8 }, options)
}

/// Decodes the headers of a file. Grey is expanded to RGB; the four inks of print are refused.
fn open(bytes: &[u8]) -> Result<(JpegDecoder<ZCursor<&[u8]>>, Header)> {
    // Strict: what is missing from a truncated file would be grey otherwise.
    let options = DecoderOptions::default()
        .set_strict_mode(true)
        .set_max_width(usize::from(u16::MAX))
        .set_max_height(usize::from(u16::MAX))
        .jpeg_set_out_colorspace(Components::RGB);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(fault)?;
    if let Some(inks @ (Components::CMYK | Components::YCCK)) = decoder.input_colorspace() {
        return Err(
            Error::unsupported(format!("a JPEG of {inks:?} inks, which are no light")).hint("write the picture as RGB")
        );
    }
    let (width, height) = decoder.dimensions().ok_or_else(|| Error::invalid("a JPEG without a size"))?;
    Ok((decoder, Header { size: [width, height], bits: Some(8), color_space: None }))
}

fn fault(error: DecodeErrors) -> Error {
    Error::invalid(format!("the JPEG is damaged: {error:?}")).hint("copy or write the picture again")
}
