//! Image data in XML: values as text, as base64, or appended raw or as base64; plain or packed by zlib or LZ4.
//!
//! Layout: "VTK File Formats", section XML. Appended raw values are no XML, so that the file is read tag by tag.

use super::base64::Base64;
use super::blocks::{self, Blocks, Counts};
use super::tags::{Tag, Tags};
use super::{Array, Lattice, MOST_ARRAYS, images};
use crate::error::{Error, Result};
use crate::formats::imaging::image::{Image, Slices};
use crate::formats::imaging::input::{self, Packing};
use crate::formats::imaging::options::Options;
use crate::formats::imaging::placement;
use crate::formats::imaging::stream::{Binary, Words, failed};
use crate::formats::imaging::text::{self, excerpt, wrong};
use crate::formats::limits::Limits;
use crate::formats::sample::{Endian, Sample};
use glam::{DMat3, DVec3};
use std::io::Read;
use std::path::Path;

const AGAIN: &str = "the file is damaged: copy it, or write it, again";

/// Says whether a file begins as VTK's XML does.
pub(crate) fn is_xml(start: &[u8]) -> bool {
    let text = String::from_utf8_lossy(start);
    text.trim_start_matches('\u{feff}').trim_start().starts_with('<') && text.contains("<VTKFile")
}

/// Where the values of an array lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    /// As text from this byte on.
    Text(u64),
    /// As base64 from this byte on.
    Base64(u64),
    /// At this offset of the appended values.
    Appended(u64),
}

/// Content of the tags: layout of the values, geometry, and places of the arrays.
#[derive(Debug, Default)]
struct Document {
    endian: Endian,
    wide: bool,
    packing: Option<blocks::Packing>,
    whole: Option<[i64; 6]>,
    piece: Option<[i64; 6]>,
    pieces: usize,
    origin: DVec3,
    spacing: Option<DVec3>,
    directions: Option<DMat3>,
    arrays: Vec<Array<Place>>,
    left_out: Vec<String>,
    /// Place of the first appended value, and whether they are raw.
    appended: Option<(u64, bool)>,
}

fn extent(tag: &Tag, key: &str) -> Result<Option<[i64; 6]>> {
    let Some(text) = tag.get(key) else { return Ok(None) };
    let numbers: Option<Vec<i64>> = text.split_whitespace().map(|w| w.parse().ok()).collect();
    let extent = numbers.and_then(|n| <[i64; 6]>::try_from(n).ok()).ok_or_else(|| wrong(key, &text))?;
    let bounded = |e: &[i64]| e[0] <= e[1] && e.iter().all(|v| v.abs() < i64::from(i32::MAX));
    if extent.chunks(2).all(bounded) { Ok(Some(extent)) } else { Err(wrong(key, &text)) }
}

impl Document {
    fn read(path: &Path) -> Result<Self> {
        let mut document = Self::default();
        let mut tags = Tags::open(path)?;
        // Whether the arrays that follow are of points or of cells.
        let mut cells = None;
        while let Some(tag) = tags.next_tag()? {
            match (tag.name().as_str(), tag.ends) {
                ("VTKFile", false) => document.file(&tag)?,
                ("ImageData", false) => document.image(&tag)?,
                ("Piece", false) => {
                    document.pieces += 1;
                    document.piece = extent(&tag, "Extent")?;
                }
                ("PointData", false) => cells = Some(false),
                ("CellData", false) => cells = Some(true),
                ("PointData" | "CellData", true) => cells = None,
                ("DataArray" | "Array", false) => {
                    if let Some(cells) = cells {
                        document.add(&tag, cells)?;
                    }
                }
                ("AppendedData", false) => {
                    let raw = match tag.get("encoding").as_deref() {
                        Some("raw") => true,
                        Some("base64") | None => false,
                        Some(other) => return Err(wrong("encoding", other)),
                    };
                    document.appended = Some((tags.underscore()?, raw));
                    break;
                }
                _ => {}
            }
        }
        if document.whole.is_none() && document.piece.is_none() {
            return Err(Error::invalid("the file has no ImageData with an extent").hint(AGAIN));
        }
        if document.pieces > 1 {
            return Err(Error::unsupported(format!("{} pieces; files of one piece are read", document.pieces))
                .hint("write the image as one piece: vtkXMLImageDataWriter with SetNumberOfPieces(1)"));
        }
        Ok(document)
    }

    fn file(&mut self, tag: &Tag) -> Result<()> {
        let kind = tag.get("type").unwrap_or_default();
        if kind != "ImageData" {
            return Err(Error::unsupported(format!("a VTK file of {}; image data are read", excerpt(&kind)))
                .hint("resample it to an image first: ParaView's filter 'Resample To Image', then save as .vti"));
        }
        self.endian = match tag.get("byte_order").as_deref() {
            Some("BigEndian") => Endian::Big,
            _ => Endian::Little,
        };
        self.wide = tag.get("header_type").as_deref() == Some("UInt64");
        self.packing = match tag.get("compressor").as_deref() {
            None | Some("") => None,
            Some("vtkZLibDataCompressor") => Some(blocks::Packing::Zlib),
            Some("vtkLZ4DataCompressor") => Some(blocks::Packing::Lz4),
            Some(other) => {
                return Err(Error::unsupported(format!("values packed by {}; zlib and LZ4 are read", excerpt(other)))
                    .hint("save the file again with the compressor 'ZLib', or with none"));
            }
        };
        Ok(())
    }

    fn image(&mut self, tag: &Tag) -> Result<()> {
        self.whole = extent(tag, "WholeExtent")?;
        let vector = |key: &str| tag.get(key).map(|t| text::vector(key, &t)).transpose();
        self.origin = vector("Origin")?.unwrap_or(DVec3::ZERO);
        self.spacing = vector("Spacing")?.map(|edges| placement::edges("Spacing", edges)).transpose()?;
        if let Some(text) = tag.get("Direction") {
            let rows: [f64; 9] =
                text::numbers("Direction", &text)?.try_into().map_err(|_| wrong("Direction", &text))?;
            self.directions = Some(DMat3::from_cols_array(&rows).transpose());
        }
        Ok(())
    }

    /// Keeps an array that can be read, and the name of another.
    fn add(&mut self, tag: &Tag, cells: bool) -> Result<()> {
        let name = tag.get("Name").unwrap_or_default();
        let components =
            tag.get("NumberOfComponents").map_or(Ok(1), |t| t.parse().map_err(|_| wrong("NumberOfComponents", &t)))?;
        let kind = tag.get("type").unwrap_or_default();
        let sample = match kind.as_str() {
            "Int8" => Some(Sample::I8),
            "UInt8" => Some(Sample::U8),
            "Int16" => Some(Sample::I16),
            "UInt16" => Some(Sample::U16),
            "Int32" => Some(Sample::I32),
            "UInt32" => Some(Sample::U32),
            "Int64" => Some(Sample::I64),
            "UInt64" => Some(Sample::U64),
            "Float32" => Some(Sample::F32),
            "Float64" => Some(Sample::F64),
            _ => None,
        };
        let Some(sample) = sample.filter(|_| matches!(components, 1 | 3)) else {
            let what = format!("array '{}' of {components} {} values was left out", excerpt(&name), excerpt(&kind));
            self.left_out.push(what);
            return Ok(());
        };
        let format = tag.get("format").unwrap_or_else(|| "ascii".into());
        let place = match format.as_str() {
            "ascii" => Place::Text(tag.end),
            "binary" => Place::Base64(tag.end),
            "appended" => {
                let offset = tag.get("offset").unwrap_or_default();
                Place::Appended(offset.parse().map_err(|_| wrong("offset", &offset))?)
            }
            other => return Err(wrong("format", other)),
        };
        if self.arrays.len() == MOST_ARRAYS {
            return Err(
                Error::unsupported(format!("more than {MOST_ARRAYS} arrays")).hint("save those that are wanted")
            );
        }
        self.arrays.push(Array { name, sample, components, cells, place });
        Ok(())
    }

    fn lattice(&self) -> Result<Lattice> {
        let extent = self.piece.or(self.whole).unwrap_or_default();
        let low = DVec3::new(extent[0] as f64, extent[2] as f64, extent[4] as f64);
        let points = [0, 2, 4].map(|i| (extent[i + 1] - extent[i] + 1) as usize);
        let spacing = self.spacing.unwrap_or(DVec3::ONE);
        let d = self.directions.unwrap_or(DMat3::IDENTITY);
        let map = placement::affine([d.x_axis * spacing.x, d.y_axis * spacing.y, d.z_axis * spacing.z], self.origin)?;
        Ok(Lattice { points, to_world: placement::shifted(&map, low)? })
    }

    /// Values of an array.
    fn slices(&self, array: &Array<Place>, lattice: &Lattice, path: &Path, limits: Limits) -> Result<Box<dyn Slices>> {
        let size = lattice.size(array.cells);
        let bytes = input::byte_count(size, array.components, array.sample.bytes());
        let bytes = bytes.ok_or_else(|| Error::invalid(format!("{size:?} values are too many")).hint(AGAIN))?;
        let counts = Counts { wide: self.wide, endian: self.endian };
        let from = |at: u64| input::values(path, at, Packing::Plain, 0);
        let coded: Box<dyn Read> = match (array.place, self.appended) {
            (Place::Text(at), _) => return Ok(Box::new(Words::new(from(at)?, Some(b'<')))),
            (Place::Base64(at), _) => Box::new(Base64::new(from(at)?)),
            (Place::Appended(offset), Some((start, raw))) => {
                let reader = from(start.saturating_add(offset))?;
                if raw { reader } else { Box::new(Base64::new(reader)) }
            }
            (Place::Appended(_), None) => {
                return Err(Error::invalid("the appended values are missing").hint(AGAIN));
            }
        };
        let plain = match self.packing {
            Some(packing) => {
                Blocks::new(coded, packing, counts, bytes, limits.max_memory / 4).map(|b| Box::new(b) as Box<dyn Read>)
            }
            None => blocks::plain(coded, counts, bytes),
        };
        let reader = plain.map_err(|e| match e.kind() {
            std::io::ErrorKind::InvalidData => Error::invalid(e.to_string()).hint(AGAIN),
            _ => failed(e, 0),
        })?;
        Ok(Box::new(Binary::new(reader, array.sample, self.endian)))
    }
}

/// Opens the arrays of a file that have one or three values at each point or cell.
///
/// # Errors
/// If the file is damaged, no image of one piece, packed otherwise than by zlib or LZ4, or no array is left.
pub(crate) fn open(path: &Path, options: &Options, limits: Limits) -> Result<Vec<Image>> {
    let document = Document::read(path)?;
    let lattice = document.lattice()?;
    let slices = |array: &Array<Place>| document.slices(array, &lattice, path, limits);
    images(&document.arrays, &lattice, document.left_out.clone(), options, slices)
}
