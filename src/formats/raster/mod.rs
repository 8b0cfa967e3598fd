//! Pictures of one layer of integer samples: PNG and JPEG. They become scene-linear and premultiplied.

pub(crate) mod jpeg;
pub(crate) mod png;

use crate::error::{Code, Error, Result};
use crate::formats::exr::Attributes;
use crate::formats::limits::Limits;
use crate::formats::png::ToneMapping;
use crate::scene::color_space::ColorSpace;
use crate::scene::film::Film;
use std::path::Path;

/// Largest number of pixels of a picture (11585²), as for OpenEXR.
const MAX_PIXELS: u64 = 1 << 27;
/// Advice on integer pictures of an unknown transfer curve.
const STATE: &str = "add \"color_space\": \"sRGB\" to the capture (or \"linear\", \"gamma 2.2\") if the pictures were \
    encoded so, or give ⟨capture.convert.color_space⟩; of photographs and videos ⟨capture.convert.photographs⟩ \
    finds model and background, too; scene-linear EXRs need no such key";

/// Writes a film for display, with attributes as texts.
pub(crate) type WritePicture = fn(&Path, &Film, ToneMapping, &Attributes) -> Result<()>;

/// How pictures of a format are read and written.
#[derive(Debug)]
pub struct PictureFormat {
    /// Reads the header.
    pub header: fn(&Path) -> Result<Header>,
    /// Reads the picture.
    pub read: fn(&Path, &Options) -> Result<Film>,
    /// Writes a picture; none if such pictures are only read.
    pub(crate) write: Option<WritePicture>,
}

/// Size and encoding of a picture, from its header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Header {
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// Bits of integer samples; `None` for OpenEXR.
    pub bits: Option<u8>,
    /// Color space that the file itself states by a chunk of its own (`sRGB` of PNG).
    pub color_space: Option<ColorSpace>,
}

/// Choices for reading a picture.
#[derive(Debug, Clone, Copy)]
pub struct Options<'l> {
    /// Layer of an OpenEXR picture; `None` for its beauty.
    pub layer: Option<&'l str>,
    /// Color space of integer samples; `None` for what the file states.
    pub color_space: Option<ColorSpace>,
    /// Radiance over which pictures with straight alpha are composited. Black premultiplies alone.
    pub background: [f32; 3],
    /// Memory that the picture may take.
    pub limits: Limits,
}

impl Default for Options<'_> {
    /// The beauty layer, the file's own color space, black, and the default limits.
    fn default() -> Self {
        Self { layer: None, color_space: None, background: [0.0; 3], limits: Limits::default() }
    }
}

/// Integer samples of a picture, row by row from the top left.
struct Samples<'s> {
    header: Header,
    /// Samples per pixel: grey, grey and alpha, RGB, or RGBA.
    channels: usize,
    /// Bytes, of which 16-bit samples have two, the higher first.
    bytes: &'s [u8],
    /// Bits per sample: 8 or 16.
    depth: u8,
}

/// Checks that a picture of `size` fits into the limits beside `held` bytes for each pixel.
fn check_size([width, height]: [usize; 2], held: u64, limits: Limits) -> Result<()> {
    let pixels = width as u64 * height as u64;
    if pixels == 0 || pixels > MAX_PIXELS {
        return Err(Error::unsupported(format!("a picture of {width}x{height}: 1 to {MAX_PIXELS} pixels are allowed"))
            .hint("crop it or scale it down, and the camera with it"));
    }
    let needed = pixels * (size_of::<[f32; 4]>() as u64 + held);
    if needed > limits.max_memory {
        return Err(Error::unsupported(format!(
            "a picture of {width}x{height} takes {needed} bytes, {} are allowed",
            limits.max_memory
        ))
        .coded(Code::MemoryLimit)
        .hint("raise ⟨max_memory⟩ if the file is to be trusted"));
    }
    Ok(())
}

/// Color space of a picture's samples: that of the options, else that of the file.
fn color_space(header: &Header, options: &Options) -> Result<ColorSpace> {
    options.color_space.or(header.color_space).ok_or_else(|| {
        let bits = header.bits.unwrap_or(8);
        Error::invalid(format!("samples of {bits} bits, and neither capture nor picture states their transfer curve"))
            .hint(STATE)
    })
}

/// Converts samples to a scene-linear film.
fn film(samples: &Samples, options: &Options) -> Result<Film> {
    let Samples { header, channels, bytes, depth } = *samples;
    let table = color_space(&header, options)?.table(depth);
    let most = f32::from(if depth == 16 { u16::MAX } else { 255 });
    let width = usize::from(depth / 8);
    let sample = |bytes: &[u8]| match bytes {
        [high, low] => usize::from(u16::from_be_bytes([*high, *low])),
        [byte] => usize::from(*byte),
        _ => 0,
    };
    let [w, h] = header.size;
    let pixels = bytes.chunks_exact(channels * width).map(|pixel| {
        let at = |c: usize| sample(&pixel[c * width..(c + 1) * width]);
        let colors = if channels < 3 { [0; 3] } else { [0, 1, 2] }.map(|c| table[at(c)]);
        let alpha = if channels.is_multiple_of(2) { at(channels - 1) as f32 / most } else { 1.0 };
        let [r, g, b] = [0, 1, 2].map(|c| alpha * colors[c] + (1.0 - alpha) * options.background[c]);
        [r, g, b, alpha]
    });
    let rgba: Vec<[f32; 4]> = pixels.take(w * h).collect();
    if rgba.len() != w * h {
        return Err(Error::invalid(format!("{} of {} pixels are there", rgba.len(), w * h))
            .hint("the picture is incomplete: copy or write it again"));
    }
    Ok(Film::of(w, h, rgba))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    fn samples(bytes: &[u8], channels: usize, depth: u8, size: [usize; 2]) -> Samples<'_> {
        let header = Header { size, bits: Some(depth), color_space: None };
        Samples { header, channels, bytes, depth }
    }

    #[test]
    fn straight_alpha_is_composited() {
        let options =
            Options { color_space: Some(ColorSpace::Linear), background: [1.0, 0.5, 0.0], ..Options::default() };
        // Half red over the background, and grey with an alpha of 1/5 (51 of 255).
        let rgba = film(&samples(&[255, 0, 0, 51], 4, 8, [1, 1]), &options).unwrap().rgba[0];
        let expected = [0.2 + 0.8, 0.8 * 0.5, 0.0, 0.2];
        assert!(rgba.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{rgba:?}");
        let grey = film(&samples(&[255, 51], 2, 8, [1, 1]), &Options { background: [0.0; 3], ..options }).unwrap();
        assert_eq!(grey.rgba[0], [51.0 / 255.0; 4]);
    }

    #[test]
    fn samples_of_16_bits_have_their_high_byte_first() {
        let options = Options { color_space: Some(ColorSpace::Linear), ..Options::default() };
        let film = film(&samples(&[0x80, 0x01, 0xff, 0xff], 1, 16, [2, 1]), &options).unwrap();
        assert_eq!(film.rgba[0], [32769.0 / 65535.0, 32769.0 / 65535.0, 32769.0 / 65535.0, 1.0]);
        assert_eq!(film.rgba[1], [1.0; 4]);
    }

    #[test]
    fn unknown_curves_and_too_few_samples_are_refused() {
        let unknown = film(&samples(&[0], 1, 8, [1, 1]), &Options::default()).unwrap_err().to_string();
        assert!(unknown.contains("transfer curve") && unknown.contains("color_space"), "{unknown}");
        let options = Options { color_space: Some(ColorSpace::Srgb), ..Options::default() };
        assert!(film(&samples(&[0; 5], 1, 8, [3, 2]), &options).is_err());
        assert!(check_size([1 << 16, 1 << 16], 0, Limits::default()).is_err());
        assert!(check_size([100, 100], 4, Limits { max_memory: 10 * 100 * 100 }).is_err());
    }
}
