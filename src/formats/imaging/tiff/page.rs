//! Pages of a TIFF, decoded by the crate `tiff`.

use crate::error::{Code, Error, Result};
use crate::formats::imaging::text::excerpt;
use crate::formats::input;
use crate::formats::limits::Limits;
use std::fmt;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use tiff::decoder::ifd::Value;
use tiff::decoder::{Decoder, DecodingResult};
use tiff::tags::{PhotometricInterpretation, Tag};
use tiff::{ColorType, TiffError};

/// Largest number of pages.
const MOST_PAGES: usize = 100_000;
/// Memory that decoding may take at least: a page's tags and a strip.
const LEAST: usize = 1 << 20;

/// Size and type of a page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Kind {
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Number of values per pixel, 1 or 3.
    pub components: usize,
    /// True for integers.
    pub integer: bool,
    bits: u8,
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let values = if self.components == 3 { "colors" } else { "values" };
        write!(f, "{} x {} {values} of {} bits", self.width, self.height, self.bits)
    }
}

/// Pages of a file, one of which is current.
pub(crate) struct Pages {
    decoder: Decoder<BufReader<File>>,
}

/// Error of the decoder: not read, or damaged.
fn failed(error: TiffError) -> Error {
    match error {
        TiffError::UnsupportedError(e) => {
            Error::unsupported(format!("this kind of TIFF is not read: {}", excerpt(&e.to_string())))
                .hint("save it again without compression, as grey values of 8, 16 or 32 bits")
        }
        TiffError::LimitsExceeded => Error::unsupported("a page needs more memory than is allowed")
            .coded(Code::MemoryLimit)
            .hint("raise ⟨max_memory⟩ if the file is to be trusted"),
        TiffError::IoError(e) if e.kind() != std::io::ErrorKind::UnexpectedEof && e.raw_os_error().is_some() => {
            Error::system(e)
        }
        error => Error::invalid(format!("the TIFF is damaged: {}", excerpt(&error.to_string())))
            .hint("copy the file, or write it, again"),
    }
}

impl Pages {
    /// Opens a file at its first page.
    pub(crate) fn open(path: &Path, limits: Limits) -> Result<Self> {
        let mut bounds = tiff::decoder::Limits::default();
        let most = usize::try_from(limits.max_memory / 4).unwrap_or(usize::MAX).max(LEAST);
        (bounds.decoding_buffer_size, bounds.intermediate_buffer_size) = (most, most);
        bounds.ifd_value_size = most.min(64 << 20);
        let decoder = Decoder::new(BufReader::new(input::open(path)?)).map_err(failed)?;
        Ok(Self { decoder: decoder.with_limits(bounds) })
    }

    /// Size and type of the current page.
    pub(crate) fn kind(&mut self) -> Result<Kind> {
        let (width, height) = self.decoder.dimensions().map_err(failed)?;
        let color = self.decoder.colortype().map_err(failed)?;
        let (components, bits) = match color {
            ColorType::Gray(bits @ (8 | 16 | 32 | 64)) => (1, bits),
            ColorType::RGB(bits @ (8 | 16 | 32 | 64)) => (3, bits),
            other => {
                return Err(Error::unsupported(format!(
                    "pixels of the kind {other:?}; grey values and RGB of 8 to 64 bits are read"
                ))
                .hint("save the stack again as grey values of 8, 16 or 32 bits"));
            }
        };
        let formats = self.decoder.find_tag_unsigned_vec::<u16>(Tag::SampleFormat).map_err(failed)?;
        // 3 stands for floats; 1, which is the default, and 2 for integers.
        let integer = formats.is_none_or(|f| f.first() != Some(&3));
        Ok(Kind { width: width as usize, height: height as usize, components, integer, bits })
    }

    /// Number of pages.
    pub(crate) fn count(&mut self) -> Result<usize> {
        let mut count = 1;
        while self.decoder.more_images() && count <= MOST_PAGES {
            self.decoder.next_image().map_err(failed)?;
            count += 1;
        }
        if count > MOST_PAGES {
            return Err(Error::unsupported(format!("more than {MOST_PAGES} pages")).hint("save a part of the stack"));
        }
        self.go_to(0)?;
        Ok(count)
    }

    /// Makes a page the current one.
    pub(crate) fn go_to(&mut self, page: usize) -> Result<()> {
        self.decoder.seek_to_image(page).map_err(failed)
    }

    /// Description of the current page, empty if there is none.
    pub(crate) fn description(&mut self) -> String {
        self.decoder.get_tag_ascii_string(Tag::ImageDescription).unwrap_or_default()
    }

    /// Resolution of the current page along x and y, in pixels per unit.
    pub(crate) fn resolution(&mut self) -> Option<[f64; 2]> {
        let mut along = |tag| match self.decoder.find_tag(tag) {
            Ok(Some(Value::Rational(n, d))) => Some(f64::from(n) / f64::from(d)),
            Ok(Some(value)) => value.into_f64().ok(),
            _ => None,
        };
        let x = along(Tag::XResolution)?;
        Some([x, along(Tag::YResolution).unwrap_or(x)])
    }

    /// True if displays show low values of the current page bright.
    pub(crate) fn is_inverted(&mut self) -> Result<bool> {
        let stated = self.decoder.find_tag_unsigned::<u16>(Tag::PhotometricInterpretation).map_err(failed)?;
        Ok(stated == Some(PhotometricInterpretation::WhiteIsZero.to_u16()))
    }

    /// Makes sure that the strips or tiles of the current page are there, for which the decoder would take other bytes.
    fn check_parts(&mut self) -> Result<()> {
        let mut list = |tags: [Tag; 2]| -> Result<Option<Vec<u64>>> {
            for tag in tags {
                if let Some(found) = self.decoder.find_tag_unsigned_vec::<u64>(tag).map_err(failed)? {
                    return Ok(Some(found));
                }
            }
            Ok(None)
        };
        let offsets = list([Tag::StripOffsets, Tag::TileOffsets])?;
        let counts = list([Tag::StripByteCounts, Tag::TileByteCounts])?;
        let lost = |what: String| {
            Err(Error::invalid(what).hint("copy the file again, or save the stack again with all of its pixels"))
        };
        // Offsets of 0 and parts of no bytes are what some programs leave out (sparse files), or have not written yet.
        if let Some(part) = [&offsets, &counts].into_iter().flatten().find_map(|l| l.iter().position(|n| *n == 0)) {
            return lost(format!("the values of part {part} of a page are not in the file"));
        }
        let plain = self.decoder.find_tag_unsigned::<u16>(Tag::Compression).map_err(failed)?.is_none_or(|c| c == 1);
        let kind = self.kind()?;
        let needed =
            (kind.width as u64 * kind.height as u64).saturating_mul(kind.components as u64 * u64::from(kind.bits / 8));
        let stored = counts.map(|counts| counts.iter().fold(0_u64, |sum, n| sum.saturating_add(*n)));
        match stored.filter(|stored| plain && *stored < needed) {
            Some(stored) => lost(format!("a page has {stored} bytes of values, {needed} are needed")),
            None => Ok(()),
        }
    }

    /// Reads the values of the current page as they are stored, row by row, the components of a pixel together.
    pub(crate) fn read(&mut self, values: &mut [f64]) -> Result<()> {
        self.check_parts()?;
        // The decoder subtracts such values from the largest one, which is undone for integers; from floats it is 1,
        // which rounds.
        let inverted = self.is_inverted()?;
        if inverted && !self.kind()?.integer {
            return Err(Error::unsupported("floats whose low values are shown bright (MinIsWhite) are not read")
                .hint("save the stack again with low values dark (MinIsBlack)"));
        }
        let whole = |v: f64, most: f64| if inverted { most - v } else { v };
        macro_rules! copied {
            ($found:expr, $to:expr) => {{
                let found = $found;
                if found.len() != values.len() {
                    let what = format!("a page has {} values, {} are expected", found.len(), values.len());
                    return Err(Error::unsupported(what).hint("save it again with the components of a pixel together"));
                }
                values.iter_mut().zip(found).for_each(|(to, from)| *to = $to(from));
            }};
        }
        match self.decoder.read_image().map_err(failed)? {
            DecodingResult::U8(v) => copied!(v, |n: u8| whole(n.into(), u8::MAX.into())),
            DecodingResult::U16(v) => copied!(v, |n: u16| whole(n.into(), u16::MAX.into())),
            DecodingResult::U32(v) => copied!(v, |n: u32| whole(n.into(), u32::MAX.into())),
            DecodingResult::U64(v) => copied!(v, |n: u64| (if inverted { u64::MAX - n } else { n }) as f64),
            DecodingResult::I8(v) => copied!(v, f64::from),
            DecodingResult::I16(v) => copied!(v, f64::from),
            DecodingResult::I32(v) => copied!(v, f64::from),
            DecodingResult::I64(v) => copied!(v, |n| n as f64),
            DecodingResult::F16(v) => copied!(v, f64::from),
            DecodingResult::F32(v) => copied!(v, f64::from),
            DecodingResult::F64(v) => copied!(v, |n| n),
        }
        Ok(())
    }
}
