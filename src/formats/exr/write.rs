//! Writing of pictures: one part of scan lines.

use super::{Header, encode, fault};
use crate::error::{Error, Result};
use crate::formats::atomic;
use crate::scene::film::Film;
use crate::text::serde_as_text;
use exr::image::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer};
use exr::math::Vec2;
use exr::meta::attribute::{AttributeValue, Compression, IntegerBounds, LineOrder, Text};
use exr::meta::header::{LayerAttributes, standard_names};
use exr::prelude::SmallVec;
use half::f16;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::Path;
use std::str::FromStr;

/// Text attributes of a header by name, such as provenance.
pub type Attributes = BTreeMap<String, String>;

/// Channels whose samples are written in 16 bits; others have 32.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Half {
    /// No channel.
    None,
    /// Colors and alpha. Planes beside them, such as depths, keep their digits.
    Colors,
    /// All channels.
    All,
}

/// How the samples of a picture are packed.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum Packing {
    /// ZIP of 16 rows, without loss.
    #[default]
    Zip,
    /// DWA of 32 rows with its level of loss, 45 unless another is wanted. Channels named R, G, B and Y of all layers
    /// lose digits and are as half floats; others keep theirs.
    Dwaa(f32),
    /// DWA of 256 rows with its level of loss, as [`Dwaa`](Self::Dwaa).
    Dwab(f32),
}

/// Level of DWA's loss unless another is wanted, that of OpenEXR.
const DWA_LEVEL: f32 = 45.0;

impl Packing {
    /// True if colors keep all digits.
    pub fn is_lossless(self) -> bool {
        self == Self::Zip
    }

    fn compression(self) -> Compression {
        match self {
            Self::Zip => Compression::ZIP16,
            Self::Dwaa(level) => Compression::DWAA(Some(level)),
            Self::Dwab(level) => Compression::DWAB(Some(level)),
        }
    }
}

impl fmt::Display for Packing {
    /// Writes the text that [`FromStr`] reads.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Zip => f.write_str("zip"),
            Self::Dwaa(level) => write!(f, "dwaa:{level}"),
            Self::Dwab(level) => write!(f, "dwab:{level}"),
        }
    }
}

impl FromStr for Packing {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let (name, level) = text.split_once(':').map_or((text, None), |(name, level)| (name, Some(level)));
        let level = level.map_or(Some(DWA_LEVEL), |level| level.parse().ok());
        match (name, level.filter(|level| (0.0..=MOST_DWA_LEVEL).contains(level))) {
            ("zip", _) if text == name => Ok(Self::Zip),
            ("dwaa", Some(level)) => Ok(Self::Dwaa(level)),
            ("dwab", Some(level)) => Ok(Self::Dwab(level)),
            _ => Err(format!(
                "'{text}' is not zip, dwaa or dwab, the latter two with a level of loss if it is not {DWA_LEVEL}, such \
                 as dwaa:20, from 0 to {MOST_DWA_LEVEL}"
            )),
        }
    }
}

serde_as_text!(Packing);

/// Greatest level of DWA's loss that is of use.
const MOST_DWA_LEVEL: f32 = 10_000.0;

/// How samples are stored.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Storage {
    /// Channels of 16 bits.
    pub half: Half,
    /// How they are packed.
    pub packing: Packing,
}

impl From<Half> for Storage {
    /// Packs without loss.
    fn from(half: Half) -> Self {
        Self { half, packing: Packing::Zip }
    }
}

impl Half {
    /// True if the samples of a channel have 16 bits: of a plane, or of colors and alpha.
    fn of(self, plane: bool) -> bool {
        self == Self::All || self == Self::Colors && !plane
    }
}

/// Writes channels R, G, B, A and the film's planes under their names, as scan lines, in 32-bit float or, as `storage`
/// says, 16-bit float, without loss or with that of DWA. The file appears whole or not at all, and equal input gives
/// equal bytes.
///
/// `attributes` become text attributes of the header, readable with `exrheader` or `oiiotool --info`; `software`,
/// `comments` and `owner` are the standard ones; `worldToCamera` and `worldToNDC` are matrices of sixteen numbers, row
/// by row.
///
/// # Errors
/// If the film is empty or its size contradicts its pixels, if a plane's name is not unique, not ASCII or not of 1 to
/// 255 bytes, if a plane has not one sample per pixel, if an attribute's name is empty, longer than 255 bytes or
/// reserved by OpenEXR, if a finite value does not fit into half floats, or if the operating system reports an error.
pub fn write_picture(path: &Path, film: &Film, attributes: &Attributes, storage: impl Into<Storage>) -> Result<()> {
    let bytes = encoded(path, film, attributes, storage.into(), Frame::Whole).map_err(|e| e.at(path))?;
    atomic::write_bytes(path, &bytes)
}

/// Writes a picture as [`write_picture`] does, with the display window and the pixels' shape of another one's header.
///
/// # Errors
/// The conditions are those of [`write_picture`].
pub(crate) fn write_like(path: &Path, film: &Film, attributes: &Attributes, half: Half, header: &Header) -> Result<()> {
    let bytes = encoded(path, film, attributes, half.into(), Frame::Like(header)).map_err(|e| e.at(path))?;
    atomic::write_bytes(path, &bytes)
}

/// Where the pixels of a film lie.
enum Frame<'a> {
    /// They are the whole picture.
    Whole,
    Part(Placement),
    /// They are the whole picture, whose window another header states.
    Like(&'a Header),
}

/// Place of a part within a whole picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Placement {
    /// Width and height of the whole picture in pixels: the display window.
    pub display: [usize; 2],
    /// Column and row of the part's first pixel: where the data window begins.
    pub origin: [usize; 2],
}

/// Writes a part of a picture as [`write_picture`] does, with the whole picture as its display window.
///
/// # Errors
/// The conditions are those of [`write_picture`]; also if the part is not within the whole.
pub(crate) fn write_part(
    path: &Path,
    film: &Film,
    attributes: &Attributes,
    storage: impl Into<Storage>,
    placement: Placement,
) -> Result<()> {
    let bytes = encoded(path, film, attributes, storage.into(), Frame::Part(placement)).map_err(|e| e.at(path))?;
    atomic::write_bytes(path, &bytes)
}

fn encoded(path: &Path, film: &Film, attributes: &Attributes, storage: Storage, frame: Frame<'_>) -> Result<Vec<u8>> {
    let (width, height) = (film.width, film.height);
    if width == 0 || height == 0 || film.rgba.len() != width * height {
        return Err(Error::invalid(format!(
            "a film of {width}x{height} with {} pixels cannot be written",
            film.rgba.len()
        ))
        .hint("give the film at least one pixel, and one RGBA value for each"));
    }
    let encoding = Encoding {
        compression: storage.packing.compression(),
        blocks: exr::image::Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let channels = channels(film, storage.half)?;
    let mut own = layer_attributes(attributes)?;
    let (mut display, mut pixel_aspect) = (None, 1.0);
    if let Frame::Like(Header { display_window, pixel_aspect: aspect, .. }) = frame {
        own.layer_position = Vec2(display_window.min[0], display_window.min[1]);
        display = Some(IntegerBounds::new(own.layer_position, (width, height)));
        pixel_aspect = *aspect;
    }
    if let Frame::Part(Placement { display: whole, origin }) = frame {
        let ends = [origin[0] + width, origin[1] + height];
        let [x, y] = origin.map(i32::try_from);
        let (Ok(x), Ok(y), true) = (x, y, ends[0] <= whole[0] && ends[1] <= whole[1]) else {
            return Err(Error::invalid(format!(
                "a part of {width}x{height} at {origin:?} is not within a picture of {}x{}",
                whole[0], whole[1]
            ))
            .hint("give a part that lies within the picture"));
        };
        own.layer_position = Vec2(x, y);
        display = Some(IntegerBounds::new((0, 0), (whole[0], whole[1])));
    }
    let mut image = Image::from_layer(Layer::new((width, height), own, encoding, channels));
    image.attributes.display_window = display.unwrap_or(image.attributes.display_window);
    image.attributes.pixel_aspect = pixel_aspect;
    let mut bytes = fault::translated(path, || encode::file(&image))?;
    sort_attributes(&mut bytes);
    Ok(bytes)
}

/// Channels R, G, B, A and those of the film's planes, sorted by name as OpenEXR requires.
fn channels(film: &Film, half: Half) -> Result<AnyChannels<FlatSamples>> {
    let pixels = film.width * film.height;
    let rgba = ["R", "G", "B", "A"].into_iter().enumerate();
    let rgba = rgba.map(|(c, name)| (name, film.rgba.iter().map(|p| p[c]).collect::<Vec<f32>>()));
    let planes = film.planes.iter().map(|plane| (plane.name.as_str(), plane.samples.clone()));
    let mut names = BTreeSet::new();
    let mut list = SmallVec::new();
    let channels = rgba.map(|channel| (channel, half.of(false))).chain(planes.map(|plane| (plane, half.of(true))));
    for ((name, samples), half) in channels {
        if !names.insert(name) || !(1..256).contains(&name.len()) || name.contains('\0') || !name.is_ascii() {
            return Err(Error::invalid(format!("'{name}' cannot be the name of a plane"))
                .hint("give each plane an ASCII name of its own of 1 to 255 bytes, other than R, G, B and A"));
        }
        if samples.len() != pixels {
            return Err(Error::invalid(format!("plane '{name}' has {} samples for {pixels} pixels", samples.len()))
                .hint("give one sample for each pixel"));
        }
        let lost = samples.iter().filter(|v| half && v.is_finite() && !f16::from_f32(**v).is_finite()).count();
        if lost > 0 {
            return Err(Error::invalid(format!("{lost} samples are beyond 65504, the largest half float"))
                .hint("write 32-bit floats"));
        }
        let samples = match half {
            true => FlatSamples::F16(samples.into_iter().map(f16::from_f32).collect()),
            false => FlatSamples::F32(samples),
        };
        list.push(AnyChannel::new(name, samples));
    }
    Ok(AnyChannels::sort(list))
}

/// Returns attributes of a part.
///
/// # Errors
/// If a name is empty, longer than 255 bytes or reserved by OpenEXR, or a matrix has not sixteen numbers.
pub(super) fn layer_attributes(attributes: &Attributes) -> Result<LayerAttributes> {
    let mut own = LayerAttributes::default();
    for (name, value) in attributes {
        let text = Text::from_slice_unchecked(value.as_bytes());
        match name.as_str() {
            "software" => own.software_name = Some(text),
            "comments" => own.comments = Some(text),
            "owner" => own.owner = Some(text),
            "worldToCamera" => own.world_to_camera = Some(matrix(name, value)?),
            "worldToNDC" => own.world_to_normalized_device = Some(matrix(name, value)?),
            _ => {
                let fits = (1..256).contains(&name.len()) && !name.contains('\0');
                if !fits || standard_names::ALL.contains(&name.as_bytes()) {
                    return Err(Error::invalid(format!("'{name}' cannot be the name of an attribute"))
                        .hint("give a name of 1 to 255 bytes that OpenEXR does not reserve"));
                }
                own.other.insert(Text::from_slice_unchecked(name.as_bytes()), AttributeValue::Text(text));
            }
        }
    }
    Ok(own)
}

/// Reads the sixteen numbers of a matrix, row by row.
fn matrix(name: &str, text: &str) -> Result<[f32; 16]> {
    let numbers = text.split_ascii_whitespace().map(str::parse).collect::<Result<Vec<f32>, _>>().ok();
    numbers.and_then(|numbers| numbers.try_into().ok()).ok_or_else(|| {
        Error::invalid(format!("the attribute '{name}' is '{text}', which is no matrix")).hint("give sixteen numbers")
    })
}

/// Sorts the attributes of a file in place, since the `exr` crate writes them in the order of a randomly seeded hash
/// map. Their total length stays, so no offset changes, and files become reproducible.
pub(super) fn sort_attributes(file: &mut [u8]) {
    let several = file.get(5).is_some_and(|flags| flags & 0x10 != 0);
    let mut start = 8; // magic number and version
    loop {
        let mut entries: Vec<Vec<u8>> = Vec::new();
        let mut at = start;
        while let Some(length) = entry_length(&file[at..]) {
            entries.push(file[at..at + length].to_vec());
            at += length;
        }
        if entries.is_empty() {
            return;
        }
        entries.sort();
        file[start..at].copy_from_slice(&entries.concat());
        // Each header ends with a zero, and in a file of several parts so does their list.
        start = at + 1;
        if !several {
            return;
        }
    }
}

/// Length in bytes of the attribute at the start of `bytes`: name, type, size, value. `None` at the end of the list.
pub(super) fn entry_length(bytes: &[u8]) -> Option<usize> {
    let name = bytes.iter().position(|&b| b == 0).filter(|&n| n > 0)? + 1;
    let kind = bytes[name..].iter().position(|&b| b == 0)? + 1;
    let size = bytes.get(name + kind..name + kind + 4)?;
    let length = name + kind + 4 + u32::from_le_bytes(size.try_into().ok()?) as usize;
    (length <= bytes.len()).then_some(length)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_film_gives_the_same_bytes() {
        let film = Film::of(3, 2, vec![[0.25, 1.5, -2.0, 1.0]; 6]);
        let attributes: Attributes = (0..9).map(|i| (format!("cumulo:{i}"), format!("väl{i}"))).collect();
        let path = Path::new("memory.exr");
        let first = encoded(path, &film, &attributes, Half::None.into(), Frame::Whole).unwrap();
        for _ in 0..4 {
            assert_eq!(first, encoded(path, &film, &attributes, Half::None.into(), Frame::Whole).unwrap());
        }
    }

    #[test]
    fn a_part_lies_in_its_whole() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("part.exr");
        // Rows beyond a block of 16, so that more than one chunk has a place of its own.
        let film = Film::of(2, 20, (0..40).map(|i| [i as f32, 0.5, 0.25, 1.0]).collect());
        let placement = Placement { display: [5, 30], origin: [3, 7] };
        write_part(&path, &film, &Attributes::new(), Half::None, placement).unwrap();
        let whole = super::super::read_picture(&path, None).unwrap();
        assert_eq!((whole.width, whole.height), (5, 30));
        for (i, pixel) in whole.rgba.iter().enumerate() {
            let [x, y] = [i % 5, i / 5];
            let inside = x >= 3 && (7..27).contains(&y);
            let expected = if inside { film.rgba[(y - 7) * 2 + x - 3] } else { [0.0; 4] };
            assert_eq!(*pixel, expected, "{x} {y}");
        }
        let outside = Placement { display: [5, 26], origin: [3, 7] };
        assert!(write_part(&path, &film, &Attributes::new(), Half::None, outside).is_err());
    }
}
