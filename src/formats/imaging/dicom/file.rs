//! What a file says of its frames.

use super::element::{Elements, Head, Item, Source, Value, damaged};
use super::syntax::{self, META, Syntax};
use crate::error::{Error, Result};
use crate::formats::input;
use crate::formats::limits::Limits;
use glam::DVec3;
use std::fs::File as Handle;
use std::io::{BufReader, Seek, SeekFrom};
use std::path::{Path, PathBuf};

const TRANSFER_SYNTAX: u32 = 0x0002_0010;
const MODALITY: u32 = 0x0008_0060;
const SERIES_DESCRIPTION: u32 = 0x0008_103e;
const SLICE_THICKNESS: u32 = 0x0018_0050;
const SPACING_BETWEEN_SLICES: u32 = 0x0018_0088;
const SERIES: u32 = 0x0020_000e;
const INSTANCE_NUMBER: u32 = 0x0020_0013;
const POSITION: u32 = 0x0020_0032;
const ORIENTATION: u32 = 0x0020_0037;
const PLANE_POSITION: u32 = 0x0020_9113;
const PLANE_ORIENTATION: u32 = 0x0020_9116;
const SAMPLES: u32 = 0x0028_0002;
const PHOTOMETRIC: u32 = 0x0028_0004;
const FRAMES: u32 = 0x0028_0008;
const ROWS: u32 = 0x0028_0010;
const COLUMNS: u32 = 0x0028_0011;
const PIXEL_SPACING: u32 = 0x0028_0030;
const BITS_ALLOCATED: u32 = 0x0028_0100;
const BITS_STORED: u32 = 0x0028_0101;
const HIGH_BIT: u32 = 0x0028_0102;
const REPRESENTATION: u32 = 0x0028_0103;
const PADDING: u32 = 0x0028_0120;
const INTERCEPT: u32 = 0x0028_1052;
const SLOPE: u32 = 0x0028_1053;
const PIXEL_MEASURES: u32 = 0x0028_9110;
const VALUE_TRANSFORMATION: u32 = 0x0028_9145;
const FRAME_OFFSETS: u32 = 0x3004_000c;
const DOSE_SCALING: u32 = 0x3004_000e;
const SHARED_GROUPS: u32 = 0x5200_9229;
const FRAME_GROUPS: u32 = 0x5200_9230;
const FLOAT_PIXELS: u32 = 0x7fe0_0008;
const DOUBLE_PIXELS: u32 = 0x7fe0_0009;
const PIXELS: u32 = 0x7fe0_0010;

/// Sequences that are kept.
pub const SEQUENCES: [u32; 6] =
    [SHARED_GROUPS, FRAME_GROUPS, PLANE_POSITION, PLANE_ORIENTATION, PIXEL_MEASURES, VALUE_TRANSFORMATION];

/// Elements that are kept.
const WANTED: [u32; 29] = [
    MODALITY,
    SERIES_DESCRIPTION,
    SLICE_THICKNESS,
    SPACING_BETWEEN_SLICES,
    SERIES,
    INSTANCE_NUMBER,
    POSITION,
    ORIENTATION,
    PLANE_POSITION,
    PLANE_ORIENTATION,
    SAMPLES,
    PHOTOMETRIC,
    FRAMES,
    ROWS,
    COLUMNS,
    PIXEL_SPACING,
    BITS_ALLOCATED,
    BITS_STORED,
    HIGH_BIT,
    REPRESENTATION,
    PADDING,
    INTERCEPT,
    SLOPE,
    PIXEL_MEASURES,
    VALUE_TRANSFORMATION,
    FRAME_OFFSETS,
    DOSE_SCALING,
    SHARED_GROUPS,
    FRAME_GROUPS,
];

/// Numbers of a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pixels {
    /// Integers of `stored` bits in `allocated` bits, whose lowest is bit `shift`.
    Integer {
        /// 8, 16 or 32.
        allocated: u32,
        /// Bits of the value.
        stored: u32,
        /// Number of the value's lowest bit.
        shift: u32,
        /// True for two's complement.
        signed: bool,
    },
    /// 32-bit floats.
    Float,
    /// 64-bit floats.
    Double,
}

impl Pixels {
    /// Bytes of a pixel.
    pub fn bytes(self) -> usize {
        match self {
            Self::Integer { allocated, .. } => allocated as usize / 8,
            Self::Float => 4,
            Self::Double => 8,
        }
    }
    /// True for integers.
    pub fn is_integer(self) -> bool {
        matches!(self, Self::Integer { .. })
    }
}

/// Place and scale of a frame. What is not stated is none.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Position of the centre of the first pixel in the patient's system, in millimetres.
    pub position: Option<DVec3>,
    /// Directions in which columns and rows are counted.
    pub orientation: Option<[DVec3; 2]>,
    /// Distances of neighboring rows and of neighboring columns.
    pub spacing: Option<[f64; 2]>,
    /// Distance of slices, or their thickness, if no positions tell it.
    pub thickness: Option<f64>,
    /// Slope and intercept that stored values are multiplied by and added to.
    pub rescale: (f64, f64),
}

/// A file of a series.
#[derive(Debug, Clone)]
pub struct File {
    /// Path of the file.
    pub path: PathBuf,
    /// UID of the series.
    pub series: String,
    /// Modality and description of the series, for people.
    pub description: String,
    /// Number of the image in its series.
    pub number: i64,
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub columns: usize,
    /// Numbers of a pixel.
    pub pixels: Pixels,
    /// True if low values are shown bright.
    pub inverted: bool,
    /// Stored value of what lies outside the image.
    pub padding: Option<i64>,
    /// Number of frames.
    pub frames: usize,
    /// Coding of the data set.
    pub syntax: Syntax,
    /// Position of the data set in the file.
    pub start: u64,
    /// Position of the pixels in the data set, and how they are introduced.
    pub pixel_data: (u64, Option<u32>),
    /// True if the frames are slices in even steps of their thickness, for want of their positions.
    pub even: bool,
    /// True if 8-bit pixels of a big-endian file are stored in words.
    pub words: bool,
    /// What all frames share.
    shared: Frame,
    /// What differs from frame to frame; empty if nothing does.
    own: Vec<Frame>,
}

impl File {
    /// Place and scale of a frame.
    pub fn frame(&self, number: usize) -> &Frame {
        self.own.get(number).unwrap_or(&self.shared)
    }

    /// Bytes of an unpacked frame.
    pub fn frame_bytes(&self) -> usize {
        self.rows * self.columns * self.pixels.bytes()
    }

    /// Opens the data set.
    ///
    /// # Errors
    /// If the file cannot be opened.
    pub fn source(&self) -> Result<Box<dyn Source>> {
        source(&self.path, self.start, self.syntax)
    }
}

/// Opens the data set that begins at byte `start`.
fn source(path: &Path, start: u64, syntax: Syntax) -> Result<Box<dyn Source>> {
    let mut file = input::open(path)?;
    file.seek(SeekFrom::Start(start)).map_err(Error::system)?;
    let reader = BufReader::with_capacity(1 << 16, file);
    Ok(if syntax.deflated { Box::new(flate2::read::DeflateDecoder::new(reader)) } else { Box::new(reader) })
}

/// An item with the byte order of its numbers.
struct Fields<'a> {
    item: &'a Item,
    big: bool,
}

impl Fields<'_> {
    fn bytes(&self, tag: u32) -> Option<&[u8]> {
        match self.item.get(&tag)? {
            Value::Bytes(bytes) if !bytes.is_empty() => Some(bytes),
            _ => None,
        }
    }
    fn text(&self, tag: u32) -> Option<String> {
        let text = String::from_utf8_lossy(self.bytes(tag)?).trim_matches(['\0', ' ']).to_owned();
        (!text.is_empty()).then_some(text)
    }
    fn u16(&self, tag: u32) -> Option<u16> {
        let pair = *self.bytes(tag)?.first_chunk::<2>()?;
        Some(if self.big { u16::from_be_bytes(pair) } else { u16::from_le_bytes(pair) })
    }
    /// Decimal numbers, which backslashes part; none if one of them is no number.
    fn list(text: &str) -> Option<Vec<f64>> {
        text.split('\\').map(|part| part.trim().parse().ok().filter(|n: &f64| n.is_finite())).collect()
    }
    /// As many decimal numbers as the element must have.
    fn numbers<const N: usize>(&self, tag: u32) -> Result<Option<[f64; N]>> {
        let Some(text) = self.text(tag) else { return Ok(None) };
        let numbers = Self::list(&text).and_then(|n| <[f64; N]>::try_from(n).ok());
        numbers.map(Some).ok_or_else(|| {
            let shown: String = text.chars().take(40).collect();
            damaged(format!("element {} is '{shown}'; {N} numbers are expected", super::element::shown(tag)))
        })
    }
    fn number(&self, tag: u32) -> Result<Option<f64>> {
        Ok(self.numbers::<1>(tag)?.map(|[n]| n))
    }
    fn items(&self, tag: u32) -> &[Item] {
        match self.item.get(&tag) {
            Some(Value::Items(items)) => items,
            _ => &[],
        }
    }
    /// Fields of the only item of a sequence.
    fn inner(&self, tag: u32) -> Option<Fields<'_>> {
        self.items(tag).first().map(|item| Fields { item, big: self.big })
    }

    /// Fills what this item states, in itself or in the functional groups it holds.
    fn frame(&self, before: &Frame) -> Result<Frame> {
        let mut frame = before.clone();
        let in_group = |group: u32| self.inner(group);
        let vector = |[x, y, z]: [f64; 3]| DVec3::new(x, y, z);
        for fields in [Some(Fields { item: self.item, big: self.big }), in_group(PLANE_POSITION)].into_iter().flatten() {
            frame.position = fields.numbers(POSITION)?.map(vector).or(frame.position);
        }
        for fields in [Some(Fields { item: self.item, big: self.big }), in_group(PLANE_ORIENTATION)].into_iter().flatten() {
            if let Some([a, b, c, d, e, f]) = fields.numbers::<6>(ORIENTATION)? {
                frame.orientation = Some([DVec3::new(a, b, c), DVec3::new(d, e, f)]);
            }
        }
        for fields in [Some(Fields { item: self.item, big: self.big }), in_group(PIXEL_MEASURES)].into_iter().flatten() {
            frame.spacing = fields.numbers(PIXEL_SPACING)?.or(frame.spacing);
            let between = fields.number(SPACING_BETWEEN_SLICES)?.map(f64::abs);
            let thickness = between.or(fields.number(SLICE_THICKNESS)?).filter(|t| *t > 0.0);
            frame.thickness = thickness.or(frame.thickness);
        }
        for fields in [Some(Fields { item: self.item, big: self.big }), in_group(VALUE_TRANSFORMATION)].into_iter().flatten() {
            let (slope, intercept) = (fields.number(SLOPE)?, fields.number(INTERCEPT)?);
            frame.rescale = (slope.unwrap_or(frame.rescale.0), intercept.unwrap_or(frame.rescale.1));
        }
        Ok(frame)
    }
}

/// Reads the meta information: the transfer syntax, and where the data set begins.
fn meta(path: &Path) -> Result<(Syntax, u64)> {
    let mut file: Handle = input::open(path)?;
    file.seek(SeekFrom::Start(132)).map_err(Error::system)?;
    let mut elements = Elements::new(Box::new(BufReader::new(file)), META, 1 << 20);
    let mut item = Item::new();
    loop {
        let start = elements.position();
        // The data set may be coded in another way, so that its first element makes no sense here.
        let head = elements.head();
        match head {
            Ok(Some(head)) if head.tag >> 16 == 2 => {
                let value = elements.value(head)?;
                item.insert(head.tag, Value::Bytes(value));
            }
            _ => {
                let uid = Fields { item: &item, big: false }.text(TRANSFER_SYNTAX);
                let uid = uid.ok_or_else(|| damaged("the file does not state its transfer syntax"))?;
                return Ok((syntax::of_uid(&uid)?, 132 + start));
            }
        }
    }
}

/// Layout of the pixels.
fn layout(fields: &Fields, head: Head) -> Result<Pixels> {
    let samples = fields.u16(SAMPLES).unwrap_or(1);
    let photometric = fields.text(PHOTOMETRIC).unwrap_or_default();
    if samples != 1 || !(photometric.is_empty() || photometric.starts_with("MONOCHROME")) {
        return Err(Error::unsupported(format!("pixels of {samples} samples ({photometric}); one grey value is read"))
            .hint("choose a series of grey values with --series"));
    }
    match head.tag {
        FLOAT_PIXELS => return Ok(Pixels::Float),
        DOUBLE_PIXELS => return Ok(Pixels::Double),
        _ => {}
    }
    let allocated = u32::from(fields.u16(BITS_ALLOCATED).ok_or_else(|| damaged("the bits of a pixel are not stated"))?);
    if !matches!(allocated, 8 | 16 | 32) {
        return Err(Error::unsupported(format!("pixels of {allocated} bits; 8, 16 and 32 are read"))
            .hint("convert the series to 8 or 16 bits a pixel where it was made"));
    }
    let stored = fields.u16(BITS_STORED).map_or(allocated, u32::from);
    let high = fields.u16(HIGH_BIT).map_or(stored.saturating_sub(1), u32::from);
    if stored == 0 || stored > allocated || high >= allocated || high + 1 < stored {
        return Err(damaged(format!("{stored} bits up to bit {high} are no part of {allocated} bits")));
    }
    let signed = fields.u16(REPRESENTATION) == Some(1);
    Ok(Pixels::Integer { allocated, stored, shift: high + 1 - stored, signed })
}

/// Frames of a file that states the position of the first one alone, along the normal: at the offsets of a radiation dose,
/// else in even steps of the thickness, if there is one. True for the latter.
fn stepped(fields: &Fields, shared: &Frame, frames: usize, (first, normal): (DVec3, DVec3)) -> (Vec<Frame>, bool) {
    let stated = fields.text(FRAME_OFFSETS).and_then(|text| Fields::list(&text)).filter(|list| list.len() == frames);
    let even = stated.is_none();
    let steps = |thickness: f64| (0..frames).map(|k| k as f64 * thickness).collect();
    let Some(offsets) = stated.or_else(|| shared.thickness.map(steps)) else { return (Vec::new(), false) };
    let at = |offset: &f64| Frame { position: Some(first + normal * (offset - offsets[0])), ..shared.clone() };
    (offsets.iter().map(at).collect(), even)
}

/// Reads what a file says of its frames, without their pixels.
///
/// # Errors
/// If the file is no DICOM file with pixels, is damaged, or is coded in a way that is not read.
pub fn read(path: &Path, limits: Limits) -> Result<File> {
    let (syntax, start) = meta(path)?;
    let mut elements = Elements::new(source(path, start, syntax)?, syntax, limits.max_memory / 4);
    let mut item = Item::new();
    let stops = [PIXELS, FLOAT_PIXELS, DOUBLE_PIXELS];
    let head = elements.data_set(&WANTED, &stops, &mut item)?;
    let head = head.ok_or_else(|| {
        Error::invalid("the file has no pixels").hint("name a series of images; reports and structures have none")
    })?;
    let fields = Fields { item: &item, big: syntax.big };
    let pixels = layout(&fields, head)?;
    let lengths = [ROWS, COLUMNS].map(|tag| usize::from(fields.u16(tag).unwrap_or(0)));
    let stated = fields.number(FRAMES)?;
    // An explicit count that is no positive whole number is damage.
    let frames = stated.map_or(Some(1), |n| (n >= 1.0 && n.fract() == 0.0 && n < 1e9).then_some(n as usize));
    let (Some(frames), false) = (frames, lengths.contains(&0)) else {
        return Err(damaged(format!("images of {} rows, {} columns and {stated:?} frames", lengths[0], lengths[1])));
    };
    let none = Frame { position: None, orientation: None, spacing: None, thickness: None, rescale: (1.0, 0.0) };
    let mut shared = fields.frame(&none)?;
    if let Some(scaling) = fields.number(DOSE_SCALING)? {
        shared.rescale = (scaling, 0.0);
    }
    if let Some(group) = fields.inner(SHARED_GROUPS) {
        shared = group.frame(&shared)?;
    }
    let groups = fields.items(FRAME_GROUPS).iter().take(frames);
    let own = groups.map(|item| Fields { item, big: syntax.big }.frame(&shared)).collect::<Result<Vec<_>>>()?;
    if !own.is_empty() && own.len() != frames {
        return Err(damaged(format!("{} frames are described, {frames} are stated", own.len())));
    }
    let (own, even) = match shared.position.zip(shared.orientation) {
        Some((position, [row, column])) if own.is_empty() && frames > 1 => {
            stepped(&fields, &shared, frames, (position, row.cross(column)))
        }
        _ => (own, false),
    };
    let name = [fields.text(MODALITY), fields.text(SERIES_DESCRIPTION)];
    let signed = matches!(pixels, Pixels::Integer { signed: true, .. });
    let padding = |v: u16| if signed { i64::from(v.cast_signed()) } else { i64::from(v) };
    Ok(File {
        path: path.to_path_buf(),
        series: fields.text(SERIES).unwrap_or_default(),
        description: name.into_iter().flatten().collect::<Vec<_>>().join(", "),
        number: fields.number(INSTANCE_NUMBER).ok().flatten().map_or(0, |n| n as i64),
        rows: lengths[0],
        columns: lengths[1],
        pixels,
        inverted: fields.text(PHOTOMETRIC).as_deref() == Some("MONOCHROME1"),
        padding: fields.u16(PADDING).map(padding),
        frames,
        syntax,
        start,
        pixel_data: (elements.position(), head.length),
        even,
        words: syntax.big && &head.vr == b"OW",
        shared,
        own,
    })
}
