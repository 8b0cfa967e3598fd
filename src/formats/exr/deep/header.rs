//! Headers of deep pictures, and where their chunks lie.

use super::unpack::most_unpacked;
use crate::error::{Code, Error, Result};
use crate::formats::exr::fault::{damaged, translated};
use crate::formats::exr::header::{ChannelInfo, Header, Part, check, described};
use crate::formats::input;
use crate::formats::limits::Limits;
use exr::io::PeekRead;
use exr::meta::attribute::{Compression, SampleType};
use exr::meta::{BlockDescription, MetaData, Requirements, magic_number};
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Bit of the version field that files with a deep part have.
const DEEP_BIT: u8 = 0x08;

/// True if a file says of itself that it is an OpenEXR file with deep samples.
pub fn is_deep(path: &Path) -> bool {
    let mut start = [0; 8];
    input::open(path).is_ok_and(|mut file| file.read_exact(&mut start).is_ok()) && states_deep(&start)
}

/// True for the first bytes of an OpenEXR file with deep samples.
pub(in crate::formats) fn states_deep(start: &[u8]) -> bool {
    start.starts_with(&magic_number::BYTES) && start.get(5).is_some_and(|flags| flags & DEEP_BIT != 0)
}

/// Place of a channel among the components of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Component {
    Z,
    ZBack,
    /// R, G, B or A by number.
    Rgba(usize),
    /// A channel that is not read.
    Other,
}

impl Component {
    fn named(name: &str) -> Self {
        match name {
            "Z" => Self::Z,
            "ZBack" => Self::ZBack,
            "R" => Self::Rgba(0),
            "G" => Self::Rgba(1),
            "B" => Self::Rgba(2),
            "A" => Self::Rgba(3),
            _ => Self::Other,
        }
    }
}

/// A channel in file order: what it is to a sample, and the type of its numbers.
pub(super) type Channel = (Component, SampleType);

/// Chunk of a deep part: the pixels that it holds and where its bytes lie.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    /// Columns and rows from the data window's first pixel.
    pub columns: [usize; 2],
    pub rows: [usize; 2],
    /// Place in the file of the packed table of counts, behind which the packed samples stand.
    pub at: u64,
    pub packed_table: usize,
    /// Bytes of a table that is not packed, which may be that of a whole tile also where the picture ends within it.
    pub whole_table: u64,
    pub packed_samples: usize,
    pub unpacked_samples: usize,
    /// Number of the chunk's samples.
    pub samples: u64,
}

impl Place {
    pub(super) fn pixels(&self) -> usize {
        (self.columns[1] - self.columns[0]) * (self.rows[1] - self.rows[0])
    }

    /// Bytes that the chunk takes while it is read: packed, unpacked and as samples.
    pub(super) fn working(&self) -> u64 {
        let bytes = 2 * (self.packed_table + self.packed_samples) as u64 + self.unpacked_samples as u64;
        bytes + 12 * self.pixels() as u64 + 2 * self.samples * size_of::<super::DeepSample>() as u64
    }
}

/// A deep picture that was opened: its header is checked, and the sizes of its chunks are known.
#[derive(Debug)]
pub(super) struct Source {
    pub path: PathBuf,
    pub file: BufReader<File>,
    pub header: Header,
    /// Number of the part that is read.
    pub part: usize,
    pub compression: Compression,
    pub channels: Vec<Channel>,
    /// Chunks from top to bottom, and from left to right in rows of tiles.
    pub places: Vec<Place>,
}

impl Source {
    pub(super) fn part(&self) -> &Part {
        &self.header.parts[self.part]
    }

    /// Number of samples in the file.
    pub(super) fn samples(&self) -> u64 {
        self.places.iter().map(|place| place.samples).sum()
    }

    /// Width and height of the data window.
    pub(super) fn size(&self) -> [usize; 2] {
        self.part().data_window.size
    }

    /// Channels of the header whose numbers are those of samples.
    pub(super) fn described_channels(&self) -> impl Iterator<Item = (&ChannelInfo, Component)> {
        self.part().channels.iter().zip(self.channels.iter().map(|channel| channel.0))
    }
}

/// Reads the header of a deep picture.
///
/// # Errors
/// The conditions are those of [`open`], but for those of chunks.
pub(in crate::formats::exr) fn header(path: &Path) -> Result<Header> {
    Ok(read(path)?.header)
}

/// Opens a deep picture. Neither counts nor samples are read, but the sizes of all chunks.
///
/// # Errors
/// If the file cannot be read, is no OpenEXR file or damaged, has no deep part, or one with a compression that is none
/// of deep pictures or without the channels Z and A, or if its chunks do not fit into the file, or their places into
/// `limits`.
pub(super) fn open(path: &Path, limits: Limits) -> Result<Source> {
    let Opened { file, header, headers, several, part, tables, bytes } = read(path)?;
    let own = &headers[part];
    let channels: Vec<Channel> = header.parts[part]
        .channels
        .iter()
        .zip(&own.channels.list)
        .map(|(info, channel)| (Component::named(&info.name), channel.sample_type))
        .collect();
    check_channels(&header.parts[part]).map_err(|e| e.at(path))?;
    let needed = (own.chunk_count as u64).saturating_mul((size_of::<Place>() + size_of::<u64>()) as u64);
    if needed > limits.max_memory {
        return Err(too_large("the places of its chunks", needed, limits).at(path));
    }
    let compression = own.compression;
    let mut source = Source { path: path.to_path_buf(), file, header, part, compression, channels, places: Vec::new() };
    source.places = places(&mut source.file, own, part, (&tables[part], several, bytes)).map_err(|e| e.at(path))?;
    Ok(source)
}

/// The error that more memory is needed than allowed.
pub(super) fn too_large(what: &str, needed: u64, limits: Limits) -> Error {
    let mib = |bytes: u64| bytes.div_ceil(1 << 20);
    Error::unsupported(format!("{what} need {} MiB, {} MiB are allowed", mib(needed), mib(limits.max_memory)))
        .coded(Code::MemoryLimit)
        .hint("raise ⟨max_memory⟩ if the file is to be trusted, or crop the picture where it was made")
}

struct Opened {
    file: BufReader<File>,
    header: Header,
    headers: exr::meta::Headers,
    /// True if chunks state their part.
    several: bool,
    part: usize,
    tables: exr::meta::OffsetTables,
    bytes: u64,
}

fn read(path: &Path) -> Result<Opened> {
    let file = input::open(path)?;
    let bytes = file.metadata().map_err(|e| Error::io(path, e))?.len();
    let mut file = BufReader::new(file);
    let mut reader = PeekRead::new(&mut file);
    let (several, headers) = translated(path, || {
        magic_number::validate_exr(&mut reader)?;
        let requirements = Requirements::read(&mut reader)?;
        requirements.validate()?;
        let headers = exr::meta::header::Header::read_all(&mut reader, &requirements, true)?;
        Ok((requirements.has_multiple_layers, headers))
    })?;
    let part = headers.iter().position(|header| header.deep);
    let part = part.ok_or_else(|| damaged("no part has deep samples, which the file states to have").at(path))?;
    translated(path, || {
        // Older files do not state the version of deep data, of which there is one.
        let mut header = headers[part].clone();
        header.deep_data_version = header.deep_data_version.or(Some(1));
        header.validate(several, &mut false, false)
    })?;
    check(&headers, bytes).map_err(|e| e.at(path))?;
    let tables = translated(path, || MetaData::read_offset_tables(&mut reader, &headers))?;
    let header = described(&headers).ok_or_else(|| damaged("no part").at(path))?;
    Ok(Opened { file, header, headers, several, part, tables, bytes })
}

/// Refuses pictures without a depth or an opacity, which nothing can be composited by.
fn check_channels(part: &Part) -> Result<()> {
    let has = |name: &str| part.channels.iter().any(|channel| channel.name == name);
    let colors = ["R", "G", "B"].iter().filter(|name| has(name)).count();
    let lacking = match (has("Z"), has("A"), colors) {
        (false, ..) => "Z, the depth of samples",
        (_, false, _) => "A, the opacity of samples",
        (_, _, 1 | 2) => "one of R, G and B",
        _ => return Ok(()),
    };
    let names: Vec<&str> = part.channels.iter().map(|channel| channel.name.as_str()).collect();
    Err(Error::unsupported(format!("deep samples without the channel {lacking}; there are {}", names.join(", ")))
        .hint("write the channels Z and A, and R, G, B if there are colors, without a layer's name before them"))
}

/// Reads the sizes of all chunks of a part.
fn places(
    file: &mut BufReader<File>,
    header: &exr::meta::header::Header,
    part: usize,
    (table, several, bytes): (&[u64], bool, u64),
) -> Result<Vec<Place>> {
    let [width, height] = [header.layer_size.0, header.layer_size.1];
    let (size, tiled) = match header.blocks {
        BlockDescription::ScanLines => ([width, 1], false),
        BlockDescription::Tiles(tiles) => ([tiles.tile_size.0, tiles.tile_size.1], true),
    };
    let across = width.div_ceil(size[0]);
    let count = across * height.div_ceil(size[1]);
    let first_row = header.own_attributes.layer_position.1;
    let sample_bytes = header.channels.list.iter().map(|c| c.sample_type.bytes_per_sample() as u64).sum::<u64>();
    let mut places = Vec::with_capacity(count.min(table.len()));
    // Smaller levels follow the full size, and are not read.
    for (number, &offset) in table.iter().enumerate().take(count) {
        let [column, row] = [number % across, number / across];
        let mut place = Place {
            columns: [column * size[0], width.min((column + 1) * size[0])],
            rows: [row * size[1], height.min((row + 1) * size[1])],
            at: 0,
            packed_table: 0,
            whole_table: (size[0] as u64).saturating_mul(4 * size[1] as u64),
            packed_samples: 0,
            unpacked_samples: 0,
            samples: 0,
        };
        let mut expected: Vec<i32> = several.then_some(part as i32).into_iter().collect();
        match tiled {
            true => expected.extend([column as i32, row as i32, 0, 0]),
            false => expected.push((i64::from(first_row) + row as i64) as i32),
        }
        let sizes = chunk_sizes(file, offset, &expected)?;
        place.at = offset.saturating_add(4 * expected.len() as u64 + 3 * 8);
        check_sizes(&mut place, sizes, header.compression, (sample_bytes, bytes))?;
        places.push(place);
    }
    if places.len() == count { Ok(places) } else { Err(damaged("its table of chunks is too short")) }
}

/// Reads the three sizes of a chunk, before which numbers stand that tell it.
fn chunk_sizes(file: &mut BufReader<File>, offset: u64, expected: &[i32]) -> Result<[u64; 3]> {
    let misplaced = || damaged("its table of chunks points to the wrong places");
    let mut start = [0; 5 * 4 + 3 * 8];
    let start = &mut start[..4 * expected.len() + 3 * 8];
    if offset == 0 || file.seek(SeekFrom::Start(offset)).is_err() {
        return Err(misplaced());
    }
    file.read_exact(start).map_err(|_| misplaced())?;
    let (told, sizes) = start.split_at(4 * expected.len());
    if !told.as_chunks::<4>().0.iter().map(|b| i32::from_le_bytes(*b)).eq(expected.iter().copied()) {
        return Err(misplaced());
    }
    let (sizes, _) = sizes.as_chunks::<8>();
    Ok([sizes[0], sizes[1], sizes[2]].map(u64::from_le_bytes))
}

/// Holds the sizes of a chunk against each other and the length of the file.
fn check_sizes(
    place: &mut Place,
    [table, samples, unpacked]: [u64; 3],
    compression: Compression,
    (sample_bytes, file_bytes): (u64, u64),
) -> Result<()> {
    let raw_table = 4 * place.pixels() as u64;
    let end = place.at.checked_add(table).and_then(|end| end.checked_add(samples));
    let sound = end.is_some_and(|end| end <= file_bytes)
        && table <= place.whole_table.max(raw_table)
        && raw_table <= most_unpacked(compression, table)
        && samples <= unpacked
        && unpacked <= most_unpacked(compression, samples)
        && unpacked % sample_bytes == 0;
    // All are at most 1032 times the length of a file.
    let sizes = [table, samples, unpacked].map(usize::try_from);
    let ([Ok(table), Ok(samples), Ok(bytes)], true) = (sizes, sound) else {
        let pixels = place.pixels();
        return Err(damaged(&format!(
            "a chunk of {pixels} pixels states {table} bytes of counts and {unpacked} of samples in {samples}, which \
             it cannot hold"
        )));
    };
    (place.packed_table, place.packed_samples, place.unpacked_samples) = (table, samples, bytes);
    place.samples = unpacked / sample_bytes;
    Ok(())
}
