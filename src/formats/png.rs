//! 8-bit PNG pictures for display: heat maps and pictures in reports.

use super::{atomic, input};
use crate::error::{Error, Result};
use crate::scene::display;
use crate::scene::film::Film;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Writes `rgb[3 * (y * width + x) + channel]` as an sRGB PNG; the file appears whole or not at all.
///
/// # Errors
/// If [`encode_rgb8`] fails, or the file cannot be written.
pub(crate) fn write_rgb8(path: &Path, width: usize, height: usize, rgb: &[u8]) -> Result<()> {
    let bytes = encode_rgb8(width, height, rgb).map_err(|e| e.at(path))?;
    atomic::write_bytes(path, &bytes)
}

/// Encodes the pixels `rgb[3 * (y * width + x) + channel]` as the bytes of an sRGB PNG file.
///
/// # Errors
/// If a side is 0 or exceeds 32 bits, or `rgb` does not have three bytes per pixel.
pub(crate) fn encode_rgb8(width: usize, height: usize, rgb: &[u8]) -> Result<Vec<u8>> {
    encode_frames(width, height, &[rgb], 0)
}

/// Encodes the pixels `rgba[4 * (y * width + x) + channel]`, whose alpha is straight, as the bytes of an sRGB PNG file;
/// it has an alpha channel if a pixel lets anything through. `per_inch` is the density of the pixels, and `texts` are
/// chunks of text with their keywords.
///
/// # Errors
/// If a side is 0 or exceeds 32 bits, or `rgba` does not have four bytes per pixel.
pub(crate) fn encode_rgba8(
    [width, height]: [usize; 2],
    rgba: &[u8],
    per_inch: Option<f64>,
    texts: &[(String, String)],
) -> Result<Vec<u8>> {
    let fault = |what: String| {
        Error::invalid(format!("PNG of {width}x{height}: {what}")).hint("write at least one pixel, four bytes each")
    };
    let (Ok(w), Ok(h)) = (u32::try_from(width), u32::try_from(height)) else {
        return Err(fault("sides must fit 32 bits".into()));
    };
    let opaque = rgba.chunks_exact(4).all(|pixel| pixel[3] == 255);
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, w, h);
    encoder.set_color(if opaque { png::ColorType::Rgb } else { png::ColorType::Rgba });
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric);
    if let Some(per_inch) = per_inch {
        let per_meter = (per_inch / 0.0254).round() as u32;
        encoder.set_pixel_dims(Some(png::PixelDimensions { xppu: per_meter, yppu: per_meter, unit: png::Unit::Meter }));
    }
    for (keyword, text) in texts {
        encoder.add_itxt_chunk(keyword.clone(), text.clone()).map_err(|e| fault(e.to_string()))?;
    }
    let mut writer = encoder.write_header().map_err(|e| fault(e.to_string()))?;
    let written = match opaque {
        true => {
            let rgb: Vec<u8> = rgba.chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
            writer.write_image_data(&rgb)
        }
        false => writer.write_image_data(rgba),
    };
    written.map_err(|e| fault(e.to_string()))?;
    writer.finish().map_err(|e| fault(e.to_string()))?;
    Ok(bytes)
}

/// Encodes the levels `grey[y * width + x]` as the bytes of a grey 8-bit PNG file.
///
/// # Errors
/// If a side is 0 or exceeds 32 bits, or `grey` does not have one byte per pixel.
pub(crate) fn encode_grey8(width: usize, height: usize, grey: &[u8]) -> Result<Vec<u8>> {
    encode_levels(width, height, grey, None)
}

/// Encodes the pixels `levels[y * width + x]`, each a color of the palette `rgb[3 * level + channel]`, as the bytes of
/// an 8-bit PNG file.
///
/// # Errors
/// If a side is 0 or exceeds 32 bits, `levels` does not have one byte per pixel, or `rgb` not three bytes per color.
pub(crate) fn encode_palette8(width: usize, height: usize, levels: &[u8], rgb: &[u8]) -> Result<Vec<u8>> {
    encode_levels(width, height, levels, Some(rgb))
}

fn encode_levels(width: usize, height: usize, levels: &[u8], palette: Option<&[u8]>) -> Result<Vec<u8>> {
    let fault = |what: String| {
        Error::invalid(format!("PNG of {width}x{height}: {what}")).hint("write at least one pixel, one byte each")
    };
    let (Ok(w), Ok(h)) = (u32::try_from(width), u32::try_from(height)) else {
        return Err(fault("sides must fit 32 bits".into()));
    };
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, w, h);
    encoder.set_depth(png::BitDepth::Eight);
    match palette {
        None => encoder.set_color(png::ColorType::Grayscale),
        Some(rgb) => {
            encoder.set_color(png::ColorType::Indexed);
            encoder.set_palette(rgb.to_vec());
        }
    }
    let mut writer = encoder.write_header().map_err(|e| fault(e.to_string()))?;
    writer.write_image_data(levels).map_err(|e| fault(e.to_string()))?;
    writer.finish().map_err(|e| fault(e.to_string()))?;
    Ok(bytes)
}

/// How scene-linear radiance becomes the samples of a PNG: scaled, clipped to 0..1, and encoded by sRGB's curve (IEC
/// 61966-2-1).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, schemars::JsonSchema)]
pub struct ToneMapping {
    /// Exposure in stops: radiance is multiplied by two to this power.
    pub exposure: f64,
}

impl std::fmt::Display for ToneMapping {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "radiance * 2^{}, clipped to 0..1, sRGB (IEC 61966-2-1)", self.exposure)
    }
}

impl ToneMapping {
    /// Converts a film's colors over black: three bytes per pixel; NaN becomes 0.
    pub fn rgb8(self, film: &Film) -> Vec<u8> {
        let factor = self.exposure.exp2() as f32;
        film.rgba.iter().flat_map(|p| [p[0], p[1], p[2]].map(|v| srgb8(factor * v))).collect()
    }
}

/// Keyword of the text that tells the tone mapping of a PNG.
pub const TONE_MAPPING: &str = "Tone mapping";

/// Writes a film's colors as an sRGB PNG, whose text chunks state the tone mapping and the attributes, each under its
/// own name. The file appears whole or not at all.
///
/// # Errors
/// If the film has no pixels, an attribute's name is no keyword of 1 to 79 characters, or the file cannot be written.
pub(crate) fn write_film(
    path: &Path,
    film: &Film,
    tone: ToneMapping,
    attributes: &BTreeMap<String, String>,
) -> Result<()> {
    let mut texts = attributes.clone();
    texts.insert(TONE_MAPPING.into(), tone.to_string());
    let bytes = encode(film.width, film.height, &[&tone.rgb8(film)], 0, &texts).map_err(|e| e.at(path))?;
    atomic::write_bytes(path, &bytes)
}

/// Reads the texts of a PNG in UTF-8 (`iTXt`) that stand before its samples, by keyword.
///
/// # Errors
/// If the file cannot be read, or is no PNG.
pub fn texts(path: &Path) -> Result<BTreeMap<String, String>> {
    let file = std::io::BufReader::new(input::open(path)?);
    let fault = |e: png::DecodingError| Error::invalid(format!("no PNG: {e}")).at(path).hint("write the picture again");
    let reader = png::Decoder::new(file).read_info().map_err(fault)?;
    let texts = reader.info().utf8_text.iter();
    texts.map(|chunk| Ok((chunk.keyword.clone(), chunk.get_text().map_err(fault)?))).collect()
}

/// Encodes pictures of equal size as the bytes of an animated sRGB PNG file that repeats without end at `rate` frames a
/// second. Programs that know no animation show the first.
///
/// # Errors
/// If a side is 0 or exceeds 32 bits, there is no picture, or one does not have three bytes per pixel.
pub(crate) fn encode_frames(width: usize, height: usize, frames: &[&[u8]], rate: u16) -> Result<Vec<u8>> {
    encode(width, height, frames, rate, &BTreeMap::new())
}

fn encode(
    width: usize,
    height: usize,
    frames: &[&[u8]],
    rate: u16,
    texts: &BTreeMap<String, String>,
) -> Result<Vec<u8>> {
    let fault = |what: String| {
        Error::invalid(format!("PNG of {width}x{height}: {what}")).hint("write at least one pixel, three bytes each")
    };
    let (Ok(w), Ok(h)) = (u32::try_from(width), u32::try_from(height)) else {
        return Err(fault("sides must fit 32 bits".into()));
    };
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, w, h);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric);
    for (keyword, text) in texts {
        encoder.add_itxt_chunk(keyword.clone(), text.clone()).map_err(|e| fault(e.to_string()))?;
    }
    if frames.len() != 1 {
        let count = u32::try_from(frames.len()).map_err(|e| fault(e.to_string()))?;
        encoder.set_animated(count, 0).map_err(|e| fault(e.to_string()))?;
        encoder.set_frame_delay(1, rate).map_err(|e| fault(e.to_string()))?;
    }
    let mut writer = encoder.write_header().map_err(|e| fault(e.to_string()))?;
    for rgb in frames {
        writer.write_image_data(rgb).map_err(|e| fault(e.to_string()))?;
    }
    writer.finish().map_err(|e| fault(e.to_string()))?;
    Ok(bytes)
}

/// Converts a film for display: premultiplied color over black, clipped to 0..1, sRGB transfer (IEC 61966-2-1). The
/// result has three bytes per pixel; NaN becomes 0.
pub(crate) fn display_rgb8(film: &Film) -> Vec<u8> {
    film.rgba.iter().flat_map(|p| [p[0], p[1], p[2]].map(srgb8)).collect()
}

fn srgb8(linear: f32) -> u8 {
    // `as` saturates and turns NaN into 0.
    (255.0 * display::value(linear) + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn display_values_follow_srgb() {
        // 0.214 041 14 is sRGB 0.5, so 127.5 rounds to 128.
        let film = Film::of(2, 1, vec![[0.0, 1.0, 0.214_041_14, 1.0], [-3.0, 7.0, f32::NAN, 0.0]]);
        assert_eq!(display_rgb8(&film), [0, 255, 128, 0, 255, 0]);
    }

    #[test]
    fn levels_decode_to_the_same() {
        let levels: Vec<u8> = (0..15).map(|i| i * 17).collect();
        let palette: Vec<u8> = (0..256).flat_map(|i| [i as u8, 255 - i as u8, 7]).collect();
        for (bytes, kind) in [
            (encode_grey8(5, 3, &levels).unwrap(), png::ColorType::Grayscale),
            (encode_palette8(5, 3, &levels, &palette).unwrap(), png::ColorType::Indexed),
        ] {
            let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
            assert_eq!(reader.info().color_type, kind);
            let mut back = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut back).unwrap();
            assert_eq!(back, levels);
        }
        assert!(encode_grey8(5, 3, &levels[1..]).is_err() && encode_grey8(0, 3, &[]).is_err());
    }

    #[test]
    fn films_carry_what_was_done_to_them() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        let film = Film::of(1, 1, vec![[0.107_020_57, 1.0, 0.0, 1.0]]);
        let attributes = BTreeMap::from([("cumulo:command".to_owned(), "cumulo render wölke.vdb".to_owned())]);
        write_film(&path, &film, ToneMapping { exposure: 1.0 }, &attributes).unwrap();
        let texts = texts(&path).unwrap();
        assert_eq!(texts["cumulo:command"], "cumulo render wölke.vdb");
        assert!(texts[TONE_MAPPING].contains("2^1,"), "{texts:?}");
        // Twice 0.107 is sRGB 0.5.
        assert_eq!(ToneMapping { exposure: 1.0 }.rgb8(&film), [128, 255, 0]);
    }

    #[test]
    fn what_is_encoded_decodes_to_the_same() {
        let rgb: Vec<u8> = (0..5 * 3 * 3).map(|i| (i * 37 % 256) as u8).collect();
        let bytes = encode_rgb8(5, 3, &rgb).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut back = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut back).unwrap();
        assert_eq!((info.width, info.height, &back), (5, 3, &rgb));
        assert!(encode_rgb8(5, 3, &[0; 44]).is_err());
        let moving = encode_frames(5, 3, &[&rgb, &[0; 45]], 24).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(moving)).read_info().unwrap();
        assert_eq!(reader.info().animation_control().unwrap().num_frames, 2);
        reader.next_frame(&mut back).unwrap();
        assert_eq!(back, rgb);
        reader.next_frame(&mut back).unwrap();
        assert_eq!(back, [0; 45]);
        assert!(encode_frames(5, 3, &[], 24).is_err());
        assert!(encode_rgb8(0, 3, &[]).is_err());
    }
}
