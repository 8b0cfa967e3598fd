//! Pixels packed by JPEG 2000.

use super::element::damaged;
use super::file::{File, Pixels};
use crate::error::Result;
use hayro_jpeg2000::{ComponentData, DecodeError, DecodeSettings, DecoderContext, Image};

/// First bytes of a codestream, of which DICOM has one for each frame.
const START: [u8; 4] = [0xff, 0x4f, 0xff, 0x51];
/// Position of the byte whose highest bit says that the values of the first component are signed.
const SIGN: usize = 42;
/// Positions of the width and the height of a tile.
const TILE: [usize; 2] = [24, 28];
/// Most tiles of a codestream, whose numbers have 16 bits.
const MOST_TILES: usize = 1 << 16;
/// Most bits of a value. The decoder computes in single precision, which holds the wavelets' coefficients of these
/// exactly.
const MOST_BITS: u32 = 16;

/// Unpacks a frame to the bytes of its pixels, least significant first.
///
/// # Errors
/// If the frame is damaged, or of another size or another type than the file says.
pub(crate) fn unpack(packed: &[u8], file: &File) -> Result<Vec<u8>> {
    let failed = |e: DecodeError| damaged(format!("the JPEG 2000 of a frame cannot be read: {e}"));
    let signed = packed.get(SIGN).filter(|_| packed.starts_with(&START)).map(|byte| byte & 0x80 != 0);
    let signed = signed.ok_or_else(|| damaged("a frame is no codestream of JPEG 2000"))?;
    let settings = DecodeSettings { strict: true, ..DecodeSettings::default() };
    let image = Image::new(packed, &settings).map_err(failed)?;
    if (image.width() as usize, image.height() as usize) != (file.columns, file.rows) {
        let [width, height] = [image.width(), image.height()];
        let what = format!("a JPEG 2000 of {width} x {height} pixels in a file of {} x {}", file.columns, file.rows);
        return Err(damaged(what));
    }
    let edge = |at: usize| packed.get(at..)?.first_chunk().map(|bytes| u32::from_be_bytes(*bytes).max(1) as usize);
    let tiles = edge(TILE[0]).zip(edge(TILE[1])).map(|(x, y)| file.columns.div_ceil(x) * file.rows.div_ceil(y));
    if tiles.is_none_or(|tiles| tiles > MOST_TILES) {
        return Err(damaged(format!("a JPEG 2000 of more than {MOST_TILES} tiles")));
    }
    if image.has_alpha() || image.color_space().num_channels() != 1 {
        return Err(damaged("a JPEG 2000 of several components for grey pixels"));
    }
    let bits = u32::from(image.original_bit_depth());
    let fits = match file.pixels {
        Pixels::Integer { allocated, signed: negative, .. } => bits <= allocated.min(MOST_BITS) && signed <= negative,
        Pixels::Float | Pixels::Double => false,
    };
    if !fits {
        let kind = if signed { "signed" } else { "unsigned" };
        return Err(damaged(format!("a JPEG 2000 of {kind} {bits}-bit values for pixels of {:?}", file.pixels)));
    }
    let mut context = DecoderContext::default();
    let decoded = image.decode(&mut context).map_err(failed)?;
    let samples = decoded.components().first().map_or(&[][..], ComponentData::samples);
    if samples.len() != file.rows * file.columns {
        let what = format!("a JPEG 2000 of {} values; {} are expected", samples.len(), file.rows * file.columns);
        return Err(damaged(what));
    }
    // Values come from 0 on, signed ones too.
    let (most, least) = (((1_u32 << bits) - 1) as f32, if signed { -(1_i32 << (bits - 1)) } else { 0 });
    let value = |sample: &f32| sample.round().clamp(0.0, most) as i32 + least;
    Ok(samples.iter().flat_map(|v| value(v).to_le_bytes().into_iter().take(file.pixels.bytes())).collect())
}
