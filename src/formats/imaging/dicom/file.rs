//! What a file says of its frames.

use super::element::{Elements, Head, Item, Source, Value, damaged};
use super::fields::{Fields, Frame};
use super::syntax::{self, META, Syntax};
use super::tags::{
    BITS_ALLOCATED, BITS_STORED, COLUMNS, DOSE_SCALING, DOUBLE_PIXELS, FLOAT_PIXELS, FRAME_GROUPS, FRAME_OFFSETS,
    FRAMES, HIGH_BIT, INSTANCE_NUMBER, MEDIA_CLASS, MODALITY, MODALITY_TABLE, PADDING, PHOTOMETRIC, PIXELS,
    REPRESENTATION, RESCALE_TYPE, ROWS, SAMPLES, SERIES, SERIES_DESCRIPTION, SHARED_GROUPS, TRANSFER_SYNTAX, WANTED,
};
use crate::error::{Code, Error, Result};
use crate::formats::input;
use crate::formats::limits::Limits;
use crate::formats::sample::Sample;
use glam::DVec3;
use std::fs::File as Handle;
use std::io::{BufReader, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Numbers of a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Pixels {
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
    pub(crate) fn bytes(self) -> usize {
        match self {
            Self::Integer { allocated, .. } => allocated as usize / 8,
            Self::Float => 4,
            Self::Double => 8,
        }
    }
    /// True for integers.
    pub(crate) fn is_integer(self) -> bool {
        matches!(self, Self::Integer { .. })
    }

    /// Type of the stored numbers.
    pub(crate) fn sample(self) -> Sample {
        match self {
            Self::Integer { allocated: 8, signed: false, .. } => Sample::U8,
            Self::Integer { allocated: 8, .. } => Sample::I8,
            Self::Integer { allocated: 16, signed: false, .. } => Sample::U16,
            Self::Integer { allocated: 16, .. } => Sample::I16,
            Self::Integer { signed: false, .. } => Sample::U32,
            Self::Integer { .. } => Sample::I32,
            Self::Float => Sample::F32,
            Self::Double => Sample::F64,
        }
    }
}

/// A file of a series.
#[derive(Debug, Clone)]
pub(crate) struct File {
    /// Path of the file.
    pub path: PathBuf,
    /// UID of the series.
    pub series: String,
    /// Modality and description of the series, for people.
    pub description: String,
    /// Unit of the values: the stated one, else Hounsfield units of scaled computed tomography.
    pub unit: Option<String>,
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
    /// True if a table, which is not applied, makes physical quantities of stored values.
    pub table: bool,
    /// True if 8-bit pixels of a big-endian file are stored in words.
    pub words: bool,
    /// Place and scale that all frames share.
    shared: Frame,
    /// Places and scales of single frames; empty if all share them.
    own: Vec<Frame>,
}

impl File {
    /// Place and scale of a frame.
    pub(crate) fn frame(&self, number: usize) -> &Frame {
        self.own.get(number).unwrap_or(&self.shared)
    }

    /// Bytes of an unpacked frame.
    pub(crate) fn frame_bytes(&self) -> usize {
        self.rows * self.columns * self.pixels.bytes()
    }

    /// Opens the data set.
    ///
    /// # Errors
    /// If the file cannot be opened.
    pub(crate) fn source(&self) -> Result<Box<dyn Source>> {
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

/// Reads the meta information, and where the data set begins.
fn meta(path: &Path) -> Result<(Item, u64)> {
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
            _ => return Ok((item, 132 + start)),
        }
    }
}

/// Kind of a DICOM file that cannot be read as an image.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Identity {
    /// It is one of the series of this UID.
    Series(String),
    /// It is the directory of a medium (DICOMDIR), which is of no series.
    Directory,
    /// It ends or is damaged before it says so.
    Unknown,
}

/// Class of the directories of media.
const DIRECTORY: &str = "1.2.840.10008.1.3.10";

/// Finds out what a file is that cannot be read as an image.
pub(crate) fn identity(path: &Path) -> Identity {
    let Ok((meta, start)) = meta(path) else { return Identity::Unknown };
    let meta = Fields { item: &meta, big: false };
    if meta.text(MEDIA_CLASS).as_deref() == Some(DIRECTORY) {
        return Identity::Directory;
    }
    // Codings that are not read concern the pixels alone.
    let syntax = meta.text(TRANSFER_SYNTAX).and_then(|uid| syntax::of_uid(&uid).ok()).unwrap_or(META);
    let mut item = Item::new();
    if let Ok(source) = source(path, start, syntax) {
        // What was read before damage or the end counts.
        let stops = [PIXELS, FLOAT_PIXELS, DOUBLE_PIXELS];
        let _ = Elements::new(source, syntax, 1 << 20).data_set(&[SERIES], &stops, &mut item);
    }
    Fields { item: &item, big: syntax.big }.text(SERIES).map_or(Identity::Unknown, Identity::Series)
}

/// Layout of the pixels.
fn layout(fields: &Fields, head: Head) -> Result<Pixels> {
    let samples = fields.u16(SAMPLES).unwrap_or(1);
    let photometric = fields.text(PHOTOMETRIC).unwrap_or_default();
    if samples != 1 || !(photometric.is_empty() || photometric.starts_with("MONOCHROME")) {
        return Err(Error::unsupported(format!("pixels of {samples} samples ({photometric}); one grey value is read"))
            .hint("choose a series of grey values with ⟨series⟩"));
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

/// Refuses a number of frames that the pixels or the memory do not have room for, before anything is allocated for
/// them.
fn room(frames: usize, frame_bytes: usize, head: Head, limits: Limits) -> Result<()> {
    let needed = (frames as u64).saturating_mul(frame_bytes as u64);
    if let Some(length) = head.length.filter(|length| u64::from(*length) < needed) {
        return Err(damaged(format!("{length} bytes of pixels for {frames} frames of {frame_bytes}")));
    }
    let descriptions = (frames as u64).saturating_mul(size_of::<Frame>() as u64);
    if descriptions > limits.max_memory / 4 {
        return Err(Error::unsupported(format!("the places of {frames} frames do not fit into the memory allowed"))
            .coded(Code::MemoryLimit)
            .hint("raise ⟨max_memory⟩ if the file is to be trusted"));
    }
    Ok(())
}

/// Frames of a file that states the position of the first one alone, along the normal: at the offsets of a radiation
/// dose, else in even steps of the thickness, if there is one. True for the latter.
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
pub(crate) fn read(path: &Path, limits: Limits) -> Result<File> {
    let (meta, start) = meta(path)?;
    let uid = Fields { item: &meta, big: false }.text(TRANSFER_SYNTAX);
    let syntax = syntax::of_uid(&uid.ok_or_else(|| damaged("the file does not state its transfer syntax"))?)?;
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
    room(frames, lengths[0] * lengths[1] * pixels.bytes(), head, limits)?;
    let none = Frame {
        position: None,
        orientation: None,
        spacing: None,
        thickness: None,
        rescale: (1.0, 0.0),
        rescaled: [false; 2],
    };
    let mut shared = fields.frame(&none)?;
    if let Some(scaling) = fields.number(DOSE_SCALING)? {
        (shared.rescale, shared.rescaled) = ((scaling, 0.0), [true; 2]);
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
    let hounsfield = name[0].as_deref() == Some("CT") && shared.rescaled != [false; 2];
    // "US" stands for a unit that is not specified.
    let stated = fields.text(RESCALE_TYPE).filter(|unit| !unit.is_empty() && unit != "US");
    let unit = stated.or_else(|| hounsfield.then(|| "HU".to_owned()));
    let signed = matches!(pixels, Pixels::Integer { signed: true, .. });
    let padding = |v: u16| if signed { i64::from(v.cast_signed()) } else { i64::from(v) };
    Ok(File {
        path: path.to_path_buf(),
        series: fields.text(SERIES).unwrap_or_default(),
        description: name.into_iter().flatten().collect::<Vec<_>>().join(", "),
        unit,
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
        table: !fields.items(MODALITY_TABLE).is_empty(),
        words: syntax.big && &head.vr == b"OW",
        shared,
        own,
    })
}
