//! Headers of files, and the limits that protect memory from damaged ones.

use super::{Window, attributes, deep, fault};
use crate::error::{Error, Kind, Result};
use crate::formats::input;
use crate::scene::primaries::Primaries;
use exr::meta::attribute::IntegerBounds;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

/// Largest number of pixels of a window (11585²): as four planes of 32 bits they fill 2 GiB.
const MAX_PIXELS: u64 = 1 << 27;

/// Type of a channel's samples in the file; all become `f32` in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum SampleType {
    /// 16-bit floating-point numbers.
    Half,
    /// 32-bit floating-point numbers.
    Float,
    /// 32-bit unsigned integers, such as identifiers; above 2²⁴ they lose digits as `f32`.
    Uint,
}

/// A channel of a part.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, schemars::JsonSchema)]
pub struct ChannelInfo {
    /// Name as in the file: `ViewLayer.Combined.R`.
    pub name: String,
    /// Layer of the channel: `ViewLayer.Combined`.
    pub layer: String,
    /// Name of the channel within its layer: `R`.
    pub component: String,
    /// Type of the samples in the file.
    pub sample_type: SampleType,
    /// Distance between samples in pixels, along x and y.
    pub sampling: [usize; 2],
}

/// A part of a file; most files have one.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Part {
    /// Name of the part, if it has one.
    pub name: Option<String>,
    /// Window of the stored pixels.
    pub data_window: Window,
    /// Compression as the `exr` crate names it.
    pub compression: String,
    /// True if the pixels are stored in tiles, false for scan lines.
    pub tiled: bool,
    /// Channels in file order (alphabetical).
    pub channels: Vec<ChannelInfo>,
    /// Attributes that do not describe the storage, as text.
    pub attributes: BTreeMap<String, String>,
}

/// A layer: channels of one part that share a prefix.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LayerInfo {
    /// Name of the layer; empty for channels without a prefix in a file of one part.
    pub name: String,
    /// Number of the layer's part.
    pub part: usize,
    /// Numbers of the layer's channels within the part.
    pub channels: Vec<usize>,
}

/// Header of a file: everything but the pixels.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Header {
    /// Window that the picture is meant to cover.
    pub display_window: Window,
    /// Smallest window around the data windows of all parts.
    pub data_window: Window,
    /// Width over height of a pixel.
    pub pixel_aspect: f32,
    /// Parts in file order.
    pub parts: Vec<Part>,
}

impl Header {
    /// Layers in file order.
    pub fn layers(&self) -> Vec<LayerInfo> {
        let mut layers: Vec<LayerInfo> = Vec::new();
        for (part, p) in self.parts.iter().enumerate() {
            for (index, channel) in p.channels.iter().enumerate() {
                match layers.iter_mut().rfind(|l| l.part == part && l.name == channel.layer) {
                    Some(layer) => layer.channels.push(index),
                    None => layers.push(LayerInfo { name: channel.layer.clone(), part, channels: vec![index] }),
                }
            }
        }
        layers
    }

    /// True if the unnamed layer has R, G, B and A as 32-bit floating-point numbers.
    pub(crate) fn is_of_floats(&self) -> bool {
        let channels = || self.parts.iter().flat_map(|part| &part.channels);
        let float = |name: &str| channels().any(|c| c.name == name && c.sample_type == SampleType::Float);
        ["R", "G", "B", "A"].into_iter().all(float)
    }

    /// Primaries of the colors: those of the attribute `chromaticities`, else Rec.709, which OpenEXR takes for granted.
    pub(crate) fn primaries(&self) -> Primaries {
        let stated = self.parts.iter().find_map(|part| part.attributes.get("chromaticities"));
        let numbers: Option<Vec<f64>> = stated.and_then(|text| text.split(' ').map(|v| v.parse().ok()).collect());
        numbers.and_then(|numbers| numbers.try_into().ok()).map_or(Primaries::REC_709, Primaries::of)
    }

    /// Attributes of all parts; where two parts differ, the first one's value.
    pub fn attributes(&self) -> BTreeMap<String, String> {
        let mut all = BTreeMap::new();
        for (name, value) in self.parts.iter().flat_map(|p| &p.attributes) {
            all.entry(name.clone()).or_insert_with(|| value.clone());
        }
        all
    }
}

/// Reads the header of an OpenEXR file, flat or [deep](super::deep).
///
/// # Errors
/// If the file cannot be read, is no OpenEXR file, is damaged or uses an unsupported feature, or if its windows are too
/// large for the file (damaged) or for memory.
pub fn header(path: &Path) -> Result<Header> {
    if deep::is_deep(path) { deep::header(path) } else { Ok(open(path)?.1) }
}

/// True if a file is empty, or begins as OpenEXR files do and has no header that can be read: what is left of a picture
/// whose writing or copying was cut short. Files of other formats and features that are not supported are no damage.
pub(crate) fn is_damaged(path: &Path) -> bool {
    is_cut_short(path).unwrap_or(false)
}

fn is_cut_short(path: &Path) -> Result<bool> {
    let mut file = input::open(path)?;
    let bytes = file.metadata().map_err(|e| Error::io(path, e))?.len();
    if bytes == 0 {
        return Ok(true);
    }
    let mut magic = [0_u8; 4];
    if file.read_exact(&mut magic).is_err() || magic != exr::meta::magic_number::BYTES {
        return Ok(false);
    }
    if deep::is_deep(path) {
        return Ok(deep::header(path).is_err_and(|e| e.kind() == Kind::Invalid));
    }
    std::io::Seek::rewind(&mut file).map_err(|e| Error::io(path, e))?;
    // A picture that is too large for this program may be whole.
    let large = |bounds: IntegerBounds| window(bounds).pixels() > MAX_PIXELS;
    let huge = |h: &exr::meta::header::Header| large(h.shared_attributes.display_window) || large(h.data_window());
    match fault::translated(path, || exr::block::read(BufReader::new(file), false)) {
        Ok(reader) if reader.headers().iter().any(huge) => Ok(false),
        Ok(reader) => Ok(check(reader.headers(), bytes).is_err()),
        Err(e) => Ok(e.kind() == Kind::Invalid),
    }
}

/// A file whose header has been read and checked, ready to read pixels.
pub(super) type Reader = exr::block::reader::Reader<BufReader<File>>;

/// Opens a file, and reads and checks its header.
pub(super) fn open(path: &Path) -> Result<(Reader, Header)> {
    let mut file = input::open(path)?;
    let bytes = file.metadata().map_err(|e| Error::io(path, e))?.len();
    let mut magic = [0_u8; 4];
    match file.read_exact(&mut magic) {
        Err(e) if e.kind() != std::io::ErrorKind::UnexpectedEof => return Err(Error::io(path, e)),
        Err(_) => {
            return Err(Error::invalid(format!("no OpenEXR file: it has only {bytes} bytes"))
                .hint("render or copy the file again")
                .at(path));
        }
        Ok(()) if magic == *b" BDV" => {
            return Err(Error::invalid("no OpenEXR file, but an OpenVDB file")
                .hint("give a picture; cumulo diff compares volumes, and cumulo render makes pictures of them")
                .at(path));
        }
        Ok(()) if magic != exr::meta::magic_number::BYTES => {
            return Err(Error::invalid(format!("no OpenEXR file (it begins with the bytes {magic:02x?})"))
                .hint("OpenEXR files begin with 76 2f 31 01; convert other pictures first: oiiotool IN -o OUT.exr")
                .at(path));
        }
        Ok(()) => {}
    }
    if deep::is_deep(path) {
        return Err(deep::refusal(path));
    }
    std::io::Seek::rewind(&mut file).map_err(|e| Error::io(path, e))?;
    let reader = fault::translated(path, || exr::block::read(BufReader::new(file), false))?;
    check(reader.headers(), bytes).map_err(|e| e.at(path))?;
    let header = described(reader.headers()).ok_or_else(|| fault::damaged("no part").at(path))?;
    Ok((reader, header))
}

/// Largest ratio of bytes of pixels to bytes of file, so that a damaged window does not cause an allocation that the
/// file cannot fill.
/// Deflate packs at most 1032 to 1, PXR24 drops a byte of four before it, DWA deflates what was run-length coded (64 to
/// 1). PIZ's runs of 256 16-bit samples in 9 bits and RLE's of 128 bytes in two stay below deflate. HTJ2K is refused
/// later, by name.
fn expansion(compression: exr::compression::Compression) -> u64 {
    use exr::compression::Compression as C;
    match compression {
        C::Uncompressed => 1,
        C::PXR24 => 1032 * 4 / 3,
        C::DWAA(_) | C::DWAB(_) => 1032 * 64,
        C::HTJ2K32 | C::HTJ2K256 => u64::MAX,
        C::RLE | C::ZIP1 | C::ZIP16 | C::PIZ | C::B44 | C::B44A => 1032,
    }
}

/// Refuses headers whose pictures the file cannot hold, or memory.
pub(super) fn check(headers: &[exr::meta::header::Header], file_bytes: u64) -> Result<()> {
    for (index, header) in headers.iter().enumerate() {
        let part = format!("part {index}");
        let display = window(header.shared_attributes.display_window);
        let data = window(header.data_window());
        for (what, w) in [("display", display), ("data", data)] {
            if w.pixels() > MAX_PIXELS {
                return Err(Error::invalid(format!("{what} window {w} has more than {MAX_PIXELS} pixels"))
                    .hint("either the header is damaged or the picture is too large for memory")
                    .part(part));
            }
        }
        // Each chunk has 8 bytes in the table and at least 8 bytes of data.
        let chunks = header.chunk_count as u64;
        if chunks > file_bytes / 16 {
            return Err(
                fault::damaged(&format!("{chunks} chunks expected, but the file has {file_bytes} bytes")).part(part)
            );
        }
        // A pixel of a deep part has its number of samples at least.
        let bytes_per_pixel = if header.deep { size_of::<u32>() } else { header.channels.bytes_per_pixel };
        let pixel_bytes = data.pixels().saturating_mul(bytes_per_pixel as u64);
        if pixel_bytes / expansion(header.compression) > file_bytes {
            return Err(fault::damaged(&format!(
                "data window {data} needs {pixel_bytes} bytes of pixels, which {file_bytes} bytes of file cannot hold"
            ))
            .part(part));
        }
    }
    Ok(())
}

fn window(bounds: IntegerBounds) -> Window {
    Window { min: [bounds.position.0, bounds.position.1], size: [bounds.size.0, bounds.size.1] }
}

/// Describes the parts; none if there are none.
pub(super) fn described(headers: &[exr::meta::header::Header]) -> Option<Header> {
    let first = headers.first()?;
    let several = headers.len() > 1;
    let parts: Vec<Part> = headers
        .iter()
        .map(|header| {
            let name = header.own_attributes.layer_name.as_ref().map(|n| attributes::text(n.as_slice()));
            let prefix = if several { name.as_deref().unwrap_or("") } else { "" };
            Part {
                data_window: window(header.data_window()),
                compression: header.compression.to_string(),
                tiled: header.blocks.has_tiles(),
                channels: header.channels.list.iter().map(|c| channel(c, prefix)).collect(),
                attributes: attributes::all(header).collect(),
                name,
            }
        })
        .collect();
    let data_window = parts.iter().map(|p| p.data_window).reduce(|a, b| a.union(&b))?;
    Some(Header {
        display_window: window(first.shared_attributes.display_window),
        data_window,
        pixel_aspect: first.shared_attributes.pixel_aspect,
        parts,
    })
}

/// Describes a channel and names its layer. A prefix that repeats the part's name (Nuke, Blender) is not doubled.
fn channel(description: &exr::meta::attribute::ChannelDescription, part: &str) -> ChannelInfo {
    let name = attributes::text(description.name.as_slice());
    let (prefix, component) = name.rsplit_once('.').unwrap_or(("", &name));
    let repeats = prefix.strip_prefix(part).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'));
    let layer = match (part, prefix) {
        ("", _) => prefix.to_owned(),
        (_, "") => part.to_owned(),
        _ if repeats => prefix.to_owned(),
        _ => format!("{part}.{prefix}"),
    };
    use exr::meta::attribute::SampleType as Exr;
    ChannelInfo {
        layer,
        component: component.to_owned(),
        sample_type: match description.sample_type {
            Exr::F16 => SampleType::Half,
            Exr::F32 => SampleType::Float,
            Exr::U32 => SampleType::Uint,
        },
        sampling: [description.sampling.0, description.sampling.1],
        name,
    }
}
