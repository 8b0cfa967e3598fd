//! Checks of a VDB file's skeleton in Rust before OpenVDB reads it: magic, version, metadata, grid descriptors, offsets
//! and, for all standard value grids, every node and buffer length.
//!
//! OpenVDB trusts lengths and offsets: a truncated uncompressed file reads "successfully" as garbage, and a hostile
//! length is allocated first. A file that passes these checks is complete and bounded.

use super::cursor::Cursor;
use super::topology::{Topology, ValueType, Walk};
use super::up::UpMarks;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use std::collections::HashMap;
use std::io::{Read, Seek};
use std::path::Path;

const MAGIC: i64 = 0x5644_4220;
/// Newest file version that the linked library (10.0) reads.
pub(crate) const NEWEST_VERSION: u32 = 224;
/// Oldest file version whose trees are walked; before it they have another layout (OpenVDB 1.1, 2013).
const OLDEST_WALKED: u32 = 222;
/// Oldest file version that is read; for older ones OpenVDB's reader has special cases that can no longer be tested.
const OLDEST_VERSION: u32 = 219;

/// A grid as the file's directory describes it.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// Name, unique within the file: `density`, or `density[1]` where the name occurs again.
    pub name: String,
    /// Name without the suffix, as the grid itself states it.
    pub base_name: String,
    /// Type of the tree: `Tree_float_5_4_3`.
    pub grid_type: String,
    /// True if real values are stored as 16-bit floats.
    pub half: bool,
    /// Unique name of the grid whose tree this grid shares; `None` if it has its own.
    pub instance_of: Option<String>,
    /// Bytes that the grid occupies in the file.
    pub file_bytes: u64,
    /// Number of leaves and memory; `None` if the tree could not be walked.
    pub topology: Option<Topology>,
    /// True if every length in the grid was checked; otherwise a helper process tries to read it first.
    pub fully_checked: bool,
    /// Positions of the grid in the file.
    pub(super) span: Span,
    /// Positions of the leaves' buffers; `None` for grids that share a tree or were not checked completely.
    pub(super) layout: Option<Layout>,
}

/// Positions of a grid in the file, in bytes, as the directory states them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Span {
    /// First byte of the grid, where its compression flags lie.
    pub from: u64,
    /// First byte behind the topology; unset for grids that share a tree.
    pub block: u64,
    /// One past the last byte of the grid.
    pub end: u64,
}

/// Positions of a grid's leaves in the file, in bytes.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Layout {
    /// First byte of the leaves' buffers.
    pub buffers: u64,
    /// First byte of each run of [`RUN`](super::topology::RUN) leaves; the last run may be shorter.
    pub runs: Vec<u64>,
}

/// Version and directory of a file whose skeleton is complete.
#[derive(Debug, Clone, PartialEq)]
pub struct Preflight {
    /// Version of the file format.
    pub version: u32,
    /// Major and minor version of the library that wrote the file.
    pub library: (u32, u32),
    /// Grids in file order.
    pub entries: Vec<Entry>,
    /// One past the last byte of the file's metadata, where the number of grids lies.
    pub(super) head: u64,
    /// Marks of the up axis in the metadata of the file and its grids.
    pub(super) up: UpMarks,
}

/// Checks the skeleton of a whole file.
///
/// # Errors
/// `Invalid` where the file contradicts itself (truncated, damaged), `Unsupported` for other formats, other versions,
/// or trees above the limits; always with a remedy.
pub fn check(path: &Path, limits: &Limits) -> Result<Preflight> {
    open(path, limits).map(|(preflight, _)| preflight)
}

/// Checks a file as [`check`] does, and also returns the file that was checked.
pub(super) fn open(path: &Path, limits: &Limits) -> Result<(Preflight, std::fs::File)> {
    let mut cursor = Cursor::open(path)?;
    Ok((walk(&mut cursor, limits)?, cursor.into_file()))
}

/// Checks a whole file that lies in memory.
pub(super) fn in_memory(bytes: &[u8], path: &Path, limits: &Limits) -> Result<Preflight> {
    walk(&mut Cursor::over(bytes, 0, bytes.len() as u64, path), limits)
}

fn walk<R: Read + Seek>(c: &mut Cursor<R>, limits: &Limits) -> Result<Preflight> {
    let version = magic_and_version(c)?;
    let library = (c.u32("library version")?, c.u32("library version")?);
    if !c.bool("offset flag")? {
        return Err(Error::unsupported("the file was streamed and has no grid offsets")
            .at(c.path())
            .hint("write it again with vdb_tool -read IN -write OUT, or from the program that made it"));
    }
    if (220..222).contains(&version) {
        c.bool("compression flag")?;
    }
    c.skip(36, "unique identifier")?;
    let mut up = UpMarks::default();
    metadata(c, &mut up)?;
    let head = c.position();
    let count = c.i32("grid count")?;
    if count < 0 {
        return Err(c.damaged(format_args!("the file claims {count} grids")));
    }
    let mut entries: Vec<Entry> = Vec::new();
    let mut numbers = HashMap::new();
    let mut expected = c.position();
    for _ in 0..count {
        let mut entry = descriptor(c)?;
        let span = entry.span;
        if span.from < expected || span.from != c.position() {
            return Err(c.damaged(format_args!("grid '{}' should start at {}", entry.name, span.from)));
        }
        if numbers.insert(entry.name.clone(), entries.len()).is_some() {
            return Err(c.damaged(format_args!("two grids have the unique name '{}'", entry.name)));
        }
        body(c, &mut entry, version, limits, &mut up).map_err(|e| e.part(format!("grid '{}'", entry.name)))?;
        c.seek(span.end)?;
        expected = span.end;
        entries.push(entry);
    }
    if expected != c.length() {
        return Err(c.damaged(format_args!("the last grid ends at {expected}, the file at {}", c.length())));
    }
    for i in 0..entries.len() {
        let Some(parent) = &entries[i].instance_of else { continue };
        let found = numbers.get(parent).map(|n| &entries[*n]).filter(|o| o.instance_of.is_none());
        let Some(found) = found.filter(|o| o.grid_type == entries[i].grid_type) else {
            let name = &entries[i].name;
            return Err(c.damaged(format_args!("grid '{name}' shares the tree of '{parent}'")));
        };
        // The library reads the parent's tree again, with any faults in it.
        entries[i].fully_checked = found.fully_checked;
    }
    Ok(Preflight { version, library, entries, head, up })
}

fn magic_and_version<R: Read + Seek>(c: &mut Cursor<R>) -> Result<u32> {
    let path = c.path().to_path_buf();
    let mut magic = [0; 8];
    c.fill(&mut magic, "magic number")?;
    if magic.starts_with(b"NanoVDB") {
        return Err(Error::unsupported("this is a NanoVDB file, and not an OpenVDB file")
            .at(path)
            .hint("convert it first: cumulo convert IN.nvdb OUT.vdb"));
    }
    if i64::from_le_bytes(magic) != MAGIC {
        return Err(Error::invalid("this is no OpenVDB file (its first bytes are not ' BDV')")
            .at(path)
            .hint("give a .vdb file as Houdini, Blender or OpenVDB's tools write it"));
    }
    let version = c.u32("file version")?;
    if version > NEWEST_VERSION {
        return Err(Error::unsupported(format!(
            "file version {version} is newer than this program reads ({NEWEST_VERSION})"
        ))
        .at(path)
        .hint(
            "write it with OpenVDB 12 or older (Blender 5.0, Houdini 20.5), or install a newer libopenvdb and rebuild",
        ));
    }
    if version < OLDEST_VERSION {
        return Err(Error::unsupported(format!("file version {version} predates OpenVDB 1.0 ({OLDEST_VERSION})"))
            .at(path)
            .hint("open it in an old Houdini and write it again"));
    }
    Ok(version)
}

fn descriptor<R: Read + Seek>(c: &mut Cursor<R>) -> Result<Entry> {
    let unique = c.name("grid name")?;
    let full_type = c.name("grid type")?;
    let parent = c.name("instance name")?;
    let [position, block, end] = std::array::from_fn(|_| c.i64("grid offset"));
    let (position, block, end) = (position?, block?, end?);
    let (base_name, name) = readable_name(&unique);
    let (grid_type, half) = match full_type.strip_suffix("_HalfFloat") {
        Some(t) => (t.to_owned(), true),
        None => (full_type, false),
    };
    let instance_of = (!parent.is_empty()).then(|| readable_name(&parent).1);
    // An instance has no tree of its own and leaves the block offset unset.
    let ordered = position > 0 && position < end && (instance_of.is_some() || (position <= block && block <= end));
    if !ordered || end as u64 > c.length() {
        return Err(c.damaged(format_args!(
            "grid '{name}' lies at {position}..{block}..{end}; ascending offsets up to {} expected",
            c.length()
        )));
    }
    Ok(Entry {
        name,
        base_name,
        grid_type,
        half,
        instance_of,
        file_bytes: (end - position) as u64,
        topology: None,
        fully_checked: false,
        span: Span { from: position as u64, block: block as u64, end: end as u64 },
        layout: None,
    })
}

/// Name without suffix and readable unique name. OpenVDB marks a repeated name with the control character 0x1e and a
/// number, shown as `[number]`.
fn readable_name(unique: &str) -> (String, String) {
    match unique.split_once('\u{1e}') {
        Some((base, number)) => (base.to_owned(), format!("{base}[{number}]")),
        None => (unique.to_owned(), unique.to_owned()),
    }
}

/// Walks a grid's metadata, transform and topology; `None` where only OpenVDB can read further.
pub(super) fn topology<R: Read + Seek>(
    c: &mut Cursor<R>,
    entry: &Entry,
    version: u32,
    limits: &Limits,
    up: &mut UpMarks,
) -> Result<Option<Walk>> {
    let compression = if version >= OLDEST_WALKED { c.u32("compression flags")? } else { 0 };
    metadata(c, up)?;
    transform(c)?;
    match ValueType::of(&entry.grid_type, entry.half) {
        Some(value) if version >= OLDEST_WALKED && entry.instance_of.is_none() => {
            Walk::topology(c, value, compression, *limits).map(Some)
        }
        _ => Ok(None),
    }
}

fn body<R: Read + Seek>(
    c: &mut Cursor<R>,
    entry: &mut Entry,
    version: u32,
    limits: &Limits,
    up: &mut UpMarks,
) -> Result<()> {
    let end = entry.span.end;
    let Some(walk) = topology(c, entry, version, limits, up)? else {
        return if entry.instance_of.is_some() { at(c, end, "the grid's end") } else { Ok(()) };
    };
    entry.topology = Some(walk.tree_size());
    if !walk.is_complete() {
        return at(c, entry.span.block, "the grid's buffers");
    }
    let runs = walk.buffers(c)?;
    entry.fully_checked = true;
    let buffers = runs.first().copied().unwrap_or(end);
    entry.layout = Some(Layout { buffers, runs });
    at(c, end, "the grid's end")
}

fn at<R: Read + Seek>(c: &Cursor<R>, expected: u64, what: &str) -> Result<()> {
    if c.position() == expected { Ok(()) } else { Err(c.damaged(format_args!("{what} should be at byte {expected}"))) }
}

/// Size in bytes of metadata values of a type that the library reads without regard to the stated size; `None` for
/// other types.
fn fixed_size(type_name: &str) -> Option<usize> {
    Some(match type_name {
        "bool" => 1,
        "int32" | "float" => 4,
        "int64" | "double" | "vec2i" | "vec2s" => 8,
        "vec3i" | "vec3s" => 12,
        "vec2d" | "vec4i" | "vec4s" => 16,
        "vec3d" => 24,
        "vec4d" => 32,
        "mat4s" => 64,
        "mat4d" => 128,
        _ => return None,
    })
}

fn metadata<R: Read + Seek>(c: &mut Cursor<R>, up: &mut UpMarks) -> Result<()> {
    let count = c.i32("metadata count")?;
    if count < 0 {
        return Err(c.damaged(format_args!("metadata claims {count} entries")));
    }
    for _ in 0..count {
        let name = c.name("metadata name")?;
        let type_name = c.name("metadata type")?;
        let value = c.bytes("metadata value")?;
        if fixed_size(&type_name).is_some_and(|n| n != value.len()) {
            return Err(c.damaged(format_args!("metadata '{name}' of type {type_name} has {} bytes", value.len())));
        }
        if type_name == "__delayedload" && !delayed_load_fits(&value, c.length()) {
            return Err(c.damaged(format_args!("metadata '{name}' has sizes that do not fit")));
        }
        if type_name == "bool" && value[0] > 1 {
            return Err(c.damaged(format_args!("metadata '{name}' is a bool of {}", value[0])));
        }
        up.note(&name, &type_name, &value);
    }
    Ok(())
}

/// Checks OpenVDB's table for delayed loading: a leaf count, then a byte per leaf and eight bytes per leaf, each raw or
/// as a Blosc block. Even an eager reader parses it, without checks of lengths.
fn delayed_load_fits(value: &[u8], file_length: u64) -> bool {
    if value.is_empty() {
        return true;
    }
    let word = |at: usize| value.get(at..at + 4)?.try_into().ok().map(u32::from_le_bytes);
    let Some(count) = word(0).map(u64::from) else { return false };
    let mut at = 4;
    // A leaf takes at least its 64 bytes of mask.
    let mut section = |entry: u64| -> Option<()> {
        let bytes = word(at)?;
        at += 4;
        if bytes > 0 && bytes < u32::MAX {
            // OpenVDB pads short buffers to 128 bytes before it packs them.
            (u64::from(word(at + 4)?) == (count * entry).max(128) && word(at + 12)? == bytes).then_some(())?;
            at += bytes as usize;
        } else if bytes == 0 {
            at += (count * entry) as usize;
        }
        (at <= value.len()).then_some(())
    };
    count <= file_length / 64 && section(1).is_some() && section(8).is_some()
}

fn transform<R: Read + Seek>(c: &mut Cursor<R>) -> Result<()> {
    let name = c.name("transform type")?;
    if name != "NonlinearFrustumMap" {
        return linear_map(c, &name);
    }
    // A frustum is a box, a taper and a depth, followed by a linear map.
    c.skip(8 * 8, "frustum")?;
    match c.name("transform type")?.as_str() {
        "NonlinearFrustumMap" => Err(c.damaged("a frustum within a frustum")),
        second => linear_map(c, second),
    }
}

fn linear_map<R: Read + Seek>(c: &mut Cursor<R>, name: &str) -> Result<()> {
    match name {
        "AffineMap" | "UnitaryMap" => numbers_finite(c, 16),
        "ScaleMap" | "UniformScaleMap" => numbers_finite(c, 15),
        "TranslationMap" => numbers_finite(c, 3),
        "ScaleTranslateMap" | "UniformScaleTranslateMap" => numbers_finite(c, 18),
        _ => Err(c.damaged(format_args!("transform of unknown type '{name}'"))),
    }
}

/// Reads `count` numbers of a map. NaN and infinity are refused, because they reach every coordinate; no program writes
/// them on purpose.
fn numbers_finite<R: Read + Seek>(c: &mut Cursor<R>, count: usize) -> Result<()> {
    for _ in 0..count {
        if !c.f64("transform")?.is_finite() {
            return Err(c.damaged("the transform has entries that are not finite"));
        }
    }
    Ok(())
}
