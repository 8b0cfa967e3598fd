//! The directory of a file: segments with a header and the metadata of their grids, or bare grids one after another.

use super::bytes::{Bytes, DAMAGED};
use super::decode;
use super::layout::{self, Kind};
use super::texts::{self, terminated};
use super::unpack::{Codec, unpack};
use super::volume::{KEPT, Volume};
use crate::error::{Code, Error, Result};
use crate::formats::input;
use crate::formats::limits::Limits;
use crate::formats::reading::Reading;
use crate::formats::vdb::ValueKind;
use crate::scene::grid::GridClass;
use std::collections::BTreeMap;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// First bytes of a segment or of a bare grid, before NanoVDB 32.6.
const MAGIC: [u8; 8] = *b"NanoVDB0";
/// First bytes of a bare grid since.
const MAGIC_GRID: [u8; 8] = *b"NanoVDB1";
/// First bytes of a segment since.
const MAGIC_FILE: [u8; 8] = *b"NanoVDB2";
/// Major version of the layout that is read, which is the ABI of all files since 2021.
const MAJOR: u32 = 32;
/// Bytes of the metadata of a grid in a segment, before its name.
const METADATA: u64 = 176;
/// Longest name of a grid in bytes; a longer one is taken for damage.
const MOST_NAME: u32 = 1 << 16;

/// A grid of the file's directory.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// Name of the grid.
    pub name: String,
    /// Number of the type of the values.
    pub(super) kind: u32,
    /// Meaning of the values.
    pub class: GridClass,
    /// Number of active voxels, those of active tiles included, as the file states it.
    pub active_voxels: u64,
    /// Compression of the grid.
    pub codec: Codec,
    /// Bytes of the grid in memory.
    pub bytes: u64,
    /// Bytes of the grid in the file.
    pub stored_bytes: u64,
    /// Position of the grid in the file.
    pub(super) position: u64,
}

impl Entry {
    /// Type of the values of the grid of OpenVDB that it becomes; integers with a background other than 0 become
    /// floats.
    pub(crate) fn value_kind(&self) -> ValueKind {
        match Kind::of(self.kind) {
            Some(kind) if kind.components() == 3 => ValueKind::Vec3,
            Some(Kind::Int16 | Kind::Int32) => ValueKind::Int32,
            _ => ValueKind::Float,
        }
    }

    /// Name of the type of the values, as NanoVDB's tools print it.
    pub fn kind_name(&self) -> &'static str {
        layout::name(self.kind)
    }
}

/// A file that is open for reading.
#[derive(Debug)]
pub struct File {
    source: BufReader<std::fs::File>,
    path: PathBuf,
    length: u64,
    version: [u32; 3],
    entries: Vec<Entry>,
    limits: Limits,
}

/// Meaning of a grid's values by NanoVDB's number.
fn class(number: u32) -> GridClass {
    match number {
        1 => GridClass::LevelSet,
        2 => GridClass::FogVolume,
        3 => GridClass::Staggered,
        _ => GridClass::Unknown,
    }
}

/// Major, minor and patch version.
fn version(packed: u32) -> [u32; 3] {
    [packed >> 21, packed >> 10 & 0x7ff, packed & 0x3ff]
}

impl File {
    /// Reads the directory of a file.
    ///
    /// # Errors
    /// If the file cannot be read, is no NanoVDB file, has another ABI than 32, or its directory contradicts its
    /// length.
    pub fn open(path: &Path, limits: Limits) -> Result<Self> {
        let _reading = Reading::begin(path);
        let source = input::open(path)?;
        let length = source.metadata().map_err(|e| Error::io(path, e))?.len();
        let mut file = Self {
            source: BufReader::new(source),
            path: path.to_path_buf(),
            length,
            version: [0; 3],
            entries: Vec::new(),
            limits,
        };
        let mut at = 0;
        while at < length {
            at = file.part(at).map_err(|e| e.at(path))?;
        }
        if file.entries.is_empty() {
            return Err(Error::invalid("the file is empty; a NanoVDB file begins with 'NanoVDB'")
                .at(path)
                .hint(DAMAGED));
        }
        Ok(file)
    }

    /// Major, minor and patch version of the library that wrote the file.
    pub(crate) fn version(&self) -> [u32; 3] {
        self.version
    }

    /// Grids in file order.
    pub fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// Reads a grid by its place in [`File::entries`].
    ///
    /// # Errors
    /// If there is no such grid, its type is not read, its memory or what becomes of it does not fit into the limits,
    /// or the file is damaged.
    pub fn read(&mut self, index: usize) -> Result<Volume> {
        self.read_beside(index, 0)
    }

    /// Reads a grid as [`File::read`] does, where `held` bytes of what the limits allow are taken already.
    ///
    /// # Errors
    /// As [`File::read`].
    pub(crate) fn read_beside(&mut self, index: usize, held: u64) -> Result<Volume> {
        let limits = Limits { max_memory: self.limits.max_memory.saturating_sub(held) };
        let _reading = Reading::begin(&self.path);
        let entry = self.entries.get(index).cloned().ok_or_else(|| {
            let count = self.entries.len();
            Error::invalid(format!("no grid of number {index}; the file has {count}"))
                .coded(Code::NoSuchGrid)
                .at(&self.path)
        })?;
        let path = self.path.clone();
        let place = |e: Error| e.part(format!("grid '{}'", entry.name)).at(&path);
        self.decode(&entry, limits).map_err(place)
    }

    /// Texts that stand beside a grid, by their names: those that a conversion keeps. What cannot be read has none;
    /// reading the grid says why.
    pub(crate) fn texts(&mut self, index: usize) -> BTreeMap<String, String> {
        let Some(entry) = self.entries.get(index).cloned() else { return BTreeMap::new() };
        if entry.bytes.saturating_add(entry.stored_bytes) > self.limits.max_memory {
            return BTreeMap::new();
        }
        let memory =
            self.bytes(entry.position, entry.stored_bytes).and_then(|stored| unpack(stored, entry.codec, entry.bytes));
        memory.and_then(|memory| texts::read(Bytes(&memory), &KEPT)).unwrap_or_default()
    }

    fn decode(&mut self, entry: &Entry, limits: Limits) -> Result<Volume> {
        let kind = Kind::of(entry.kind).ok_or_else(|| {
            let what = format!("values of type {} are not read", entry.kind_name());
            let index = matches!(entry.kind, 19..=23);
            Error::unsupported(what).hint(if index {
                "an index grid has its values elsewhere: write the grid that it was made from, as float or fp16"
            } else {
                "convert the grid to float or vec3f where it was made"
            })
        })?;
        // The memory of the grid, and its packed bytes beside it while they are unpacked.
        let packed = if entry.codec == Codec::None { 0 } else { entry.stored_bytes };
        let needed = entry.bytes.saturating_add(packed);
        if needed > limits.max_memory {
            let what = format!("the grid needs {needed} bytes, {} are left", limits.max_memory);
            return Err(Error::unsupported(what)
                .coded(Code::MemoryLimit)
                .hint("raise ⟨max_memory⟩ if the file is to be trusted"));
        }
        let stored = self.bytes(entry.position, entry.stored_bytes)?;
        let memory = unpack(stored, entry.codec, entry.bytes)?;
        decode::volume(Bytes(&memory), &entry.name, kind, entry.class, limits)
    }

    /// Reads bytes that [`File::open`] has seen to be in the file.
    fn bytes(&mut self, at: u64, count: u64) -> Result<Vec<u8>> {
        let inside = at.checked_add(count).is_some_and(|end| end <= self.length);
        let (true, Ok(count)) = (inside, usize::try_from(count)) else {
            return Err(
                Error::invalid(format!("{count} bytes at byte {at} exceed the file's {}", self.length)).hint(DAMAGED)
            );
        };
        self.source.seek(SeekFrom::Start(at)).map_err(Error::system)?;
        let mut bytes = vec![0; count];
        self.source.read_exact(&mut bytes).map_err(Error::system)?;
        Ok(bytes)
    }

    /// Reads the segment or the bare grid at `at`, and returns where the next part begins.
    fn part(&mut self, at: u64) -> Result<u64> {
        let start = self.bytes(at, 24.min(self.length - at))?;
        let word = |from: usize| start.get(from..from + 4).map_or(0, |b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        let magic = start.get(..8).unwrap_or_default();
        if magic == MAGIC.iter().rev().copied().collect::<Vec<u8>>() {
            return Err(Error::unsupported("the file was written by a big-endian machine")
                .hint("write it again on a little-endian one"));
        }
        let known = [MAGIC, MAGIC_GRID, MAGIC_FILE].iter().any(|m| magic == m);
        if !known || start.len() < 24 {
            let what = format!(
                "byte {at} begins with {:02x?}; 'NanoVDB' and a digit are expected",
                &start[..start.len().min(8)]
            );
            return Err(Error::invalid(what).hint(DAMAGED));
        }
        // Both parts began with the same word before 32.6, and differ in where the version is.
        let segment = magic == MAGIC_FILE || magic == MAGIC && version(word(8))[0] == MAJOR && word(12) >> 16 <= 2;
        let found = version(if segment { word(8) } else { word(16) });
        if found[0] != MAJOR {
            return Err(Error::unsupported(format!(
                "version {}.{}.{} of NanoVDB, 32 is read",
                found[0], found[1], found[2]
            ))
            .hint("write the file again with a NanoVDB of OpenVDB 9 or later (nanovdb_convert)"));
        }
        self.version = found;
        if segment { self.segment(at, word(12)) } else { self.bare(at) }
    }

    fn segment(&mut self, at: u64, counts: u32) -> Result<u64> {
        let (grids, codec) = (counts & 0xffff, counts >> 16);
        let codec = match codec {
            0 => Codec::None,
            1 => Codec::Zip,
            2 => Codec::Blosc,
            other => {
                return Err(Error::unsupported(format!(
                    "compression {other}; none (0), zip (1) and blosc (2) are read"
                ))
                .hint(DAMAGED));
            }
        };
        let mut at = at + 16;
        let first = self.entries.len();
        for _ in 0..grids {
            let bytes = self.bytes(at, METADATA)?;
            let metadata = Bytes(&bytes);
            let name_bytes = metadata.u32(136, "the length of the name")?;
            if name_bytes > MOST_NAME {
                return Err(Error::invalid(format!("a grid's name of {name_bytes} bytes")).hint(DAMAGED));
            }
            let name = terminated(&self.bytes(at + METADATA, name_bytes.into())?);
            at += METADATA + u64::from(name_bytes);
            self.entries.push(Entry {
                name,
                kind: metadata.u32(32, "the type")?,
                class: class(metadata.u32(36, "the class")?),
                active_voxels: metadata.u64(24, "the number of voxels")?,
                codec,
                bytes: metadata.u64(0, "the size")?,
                stored_bytes: metadata.u64(8, "the size in the file")?,
                position: 0,
            });
        }
        for entry in &mut self.entries[first..] {
            entry.position = at;
            let end = at.checked_add(entry.stored_bytes).filter(|end| *end <= self.length);
            at = end.ok_or_else(|| {
                let what =
                    format!("the grid has {} bytes from byte {at} on, the file {}", entry.stored_bytes, self.length);
                Error::invalid(what).part(format!("grid '{}'", entry.name)).hint(DAMAGED)
            })?;
        }
        Ok(at)
    }

    fn bare(&mut self, at: u64) -> Result<u64> {
        let bytes = self.bytes(at, (layout::GRID + layout::TREE) as u64)?;
        let header = Bytes(&bytes);
        let size = header.u64(layout::GRID_SIZE, "the size")?;
        let name = terminated(header.slice(layout::GRID_NAME, layout::GRID_NAME_BYTES, "the name")?);
        let least = (layout::GRID + layout::TREE) as u64;
        let end = at.checked_add(size).filter(|end| *end <= self.length && size >= least).ok_or_else(|| {
            let what = format!("the grid has {size} bytes from byte {at} on, the file {}", self.length);
            Error::invalid(what).part(format!("grid '{name}'")).hint(DAMAGED)
        })?;
        self.entries.push(Entry {
            name,
            kind: header.u32(layout::GRID_KIND, "the type")?,
            class: class(header.u32(layout::GRID_CLASS, "the class")?),
            active_voxels: header.u64(layout::GRID as u64 + layout::TREE_VOXELS, "the number of voxels")?,
            codec: Codec::None,
            bytes: size,
            stored_bytes: size,
            position: at,
        });
        Ok(end)
    }
}
