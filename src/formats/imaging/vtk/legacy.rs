//! Structured points of the legacy format, as text or binary. Binary values have their most significant byte first.
//!
//! Layout: "VTK File Formats", section Simple Legacy Formats.

use super::{Array, Lattice, MOST_ARRAYS, images};
use crate::error::{Error, Result};
use crate::formats;
use crate::formats::imaging::image::{Image, Slices};
use crate::formats::imaging::input::{self, Packing};
use crate::formats::imaging::options::Options;
use crate::formats::imaging::placement;
use crate::formats::imaging::stream::{Binary, Words};
use crate::formats::imaging::text::{self, excerpt, wrong};
use crate::formats::sample::{Endian, Sample};
use glam::DVec3;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

const AGAIN: &str = "the file is damaged: copy it, or write it, again";
/// Longest line that says something; lines of values may be longer.
const LONGEST: u64 = 1 << 12;

/// Type of the values of an array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Type {
    Number(Sample),
    /// Eight in a byte, the first one in its highest bit. Such arrays are passed over.
    Bit,
}

/// A file that is gone through from line to line.
struct Scanner {
    reader: BufReader<File>,
    at: u64,
    length: u64,
    binary: bool,
}

impl Scanner {
    /// The next line that is not empty; none at the end.
    fn line(&mut self) -> Result<Option<String>> {
        loop {
            let mut line = Vec::new();
            let n = (&mut self.reader).take(LONGEST).read_until(b'\n', &mut line).map_err(Error::system)? as u64;
            self.at += n;
            if n == 0 {
                return Ok(None);
            }
            if n == LONGEST {
                return Err(
                    Error::invalid(format!("a line of more than {LONGEST} bytes at byte {}", self.at - n)).hint(AGAIN)
                );
            }
            let text = String::from_utf8_lossy(&line).trim().to_owned();
            if !text.is_empty() {
                return Ok(Some(text));
            }
        }
    }

    /// The next line, which must be there.
    fn need(&mut self, what: &str) -> Result<String> {
        self.line()?.ok_or_else(|| Error::invalid(format!("the file ends before {what}")).hint(AGAIN))
    }

    /// Passes over lines up to an empty one: names of components and the like.
    fn block(&mut self) -> Result<()> {
        loop {
            let mut line = Vec::new();
            let n = (&mut self.reader).take(LONGEST).read_until(b'\n', &mut line).map_err(Error::system)? as u64;
            self.at += n;
            if line.trim_ascii().is_empty() {
                return Ok(());
            }
        }
    }

    /// Passes over so many values.
    fn pass(&mut self, count: u64, kind: Type) -> Result<()> {
        if self.binary {
            let bytes = match kind {
                Type::Number(sample) => count.checked_mul(sample.bytes() as u64),
                Type::Bit => Some(count.div_ceil(8)),
            };
            let bytes = bytes.filter(|n| self.at.saturating_add(*n) <= self.length);
            let bytes =
                bytes.ok_or_else(|| Error::invalid(format!("the file ends within {count} values")).hint(AGAIN))?;
            self.at += bytes;
            return self.reader.seek_relative(bytes as i64).map_err(Error::system);
        }
        for done in 0..count {
            if !self.word()? {
                return Err(Error::invalid(format!("the file ends after {done} of {count} values")).hint(AGAIN));
            }
        }
        Ok(())
    }

    /// Passes over a word and the blanks before it; false if there is none.
    fn word(&mut self) -> Result<bool> {
        let mut begun = false;
        loop {
            let bytes = self.reader.fill_buf().map_err(Error::system)?;
            let Some(byte) = bytes.first() else { return Ok(begun) };
            if byte.is_ascii_whitespace() && begun {
                return Ok(true);
            }
            begun |= !byte.is_ascii_whitespace();
            self.reader.consume(1);
            self.at += 1;
        }
    }
}

/// Type of a name.
fn kind(name: &str) -> Result<Type> {
    let sample = match name.to_ascii_lowercase().as_str() {
        "bit" => return Ok(Type::Bit),
        "char" => Sample::I8,
        "unsigned_char" => Sample::U8,
        "short" => Sample::I16,
        "unsigned_short" => Sample::U16,
        // Numbers of points are written as such, whatever they are in memory.
        "int" | "vtkidtype" => Sample::I32,
        "unsigned_int" => Sample::U32,
        "long" | "vtktypeint64" => Sample::I64,
        "unsigned_long" | "vtktypeuint64" => Sample::U64,
        "float" => Sample::F32,
        "double" => Sample::F64,
        _ => return Err(wrong("data type", name)),
    };
    Ok(Type::Number(sample))
}

/// Name of an array, in which blanks and others stand as `%` and two hexadecimal digits.
fn decoded(name: &str) -> String {
    let mut bytes = Vec::with_capacity(name.len());
    let mut rest = name.as_bytes();
    while let Some((first, after)) = rest.split_first() {
        let code = after.get(..2).filter(|_| *first == b'%').and_then(|hex| std::str::from_utf8(hex).ok());
        match code.and_then(|hex| u8::from_str_radix(hex, 16).ok()) {
            Some(byte) => {
                bytes.push(byte);
                rest = &after[2..];
            }
            None => {
                bytes.push(*first);
                rest = after;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Header of an array of a field.
struct FieldArray {
    name: String,
    components: u64,
    tuples: u64,
    kind: Type,
}

/// Goes through the arrays of a field, whose line `line` ends in their number. `take` passes over the values of each.
fn field(
    scanner: &mut Scanner,
    line: &str,
    mut take: impl FnMut(&mut Scanner, FieldArray) -> Result<()>,
) -> Result<()> {
    let arrays: usize =
        line.rsplit(char::is_whitespace).next().and_then(|n| n.parse().ok()).ok_or_else(|| wrong("FIELD", line))?;
    for _ in 0..arrays {
        let mut header = scanner.need("an array of a field")?;
        // Names of components follow the array before.
        while header.eq_ignore_ascii_case("METADATA") {
            scanner.block()?;
            header = scanner.need("an array of a field")?;
        }
        let [name, components, tuples, of] = header.split_whitespace().collect::<Vec<_>>()[..] else {
            return Err(wrong("FIELD", &header));
        };
        let number = |text: &str| text.parse::<u64>().map_err(|_| wrong("FIELD", &header));
        let array = FieldArray {
            name: name.to_owned(),
            components: number(components)?,
            tuples: number(tuples)?,
            kind: kind(of)?,
        };
        take(scanner, array)?;
    }
    Ok(())
}

/// Geometry, arrays, and the names of what was left out.
struct Document {
    lattice: Lattice,
    arrays: Vec<Array<u64>>,
    left_out: Vec<String>,
}

/// Reads the geometry, whose fields come in any order before the data, and gives the line that begins these.
fn lattice(scanner: &mut Scanner) -> Result<(Lattice, Option<String>)> {
    let (mut points, mut spacing, mut origin) = (None, DVec3::ONE, DVec3::ZERO);
    let after = loop {
        let Some(line) = scanner.line()? else { break None };
        let (key, rest) = line.split_once(char::is_whitespace).unwrap_or((&line, ""));
        match key.to_ascii_uppercase().as_str() {
            "DIMENSIONS" => {
                let counts = text::counts("DIMENSIONS", rest)?;
                points = Some(<[usize; 3]>::try_from(counts).map_err(|_| wrong("DIMENSIONS", rest))?);
            }
            "SPACING" | "ASPECT_RATIO" => spacing = placement::edges("SPACING", text::vector("SPACING", rest)?)?,
            "ORIGIN" => origin = text::vector("ORIGIN", rest)?,
            // Values of the file as a whole, such as its time.
            "FIELD" => field(scanner, &line, |scanner, array| {
                scanner.pass(array.tuples.saturating_mul(array.components), array.kind)
            })?,
            "METADATA" => scanner.block()?,
            _ => break Some(line),
        }
    };
    let points = points.filter(|p| p.iter().all(|n| (1..i32::MAX as usize).contains(n)));
    let points = points.ok_or_else(|| Error::invalid("the file states no DIMENSIONS of its points").hint(AGAIN))?;
    let to_world = placement::affine([DVec3::X * spacing.x, DVec3::Y * spacing.y, DVec3::Z * spacing.z], origin)?;
    Ok((Lattice { points, to_world }, after))
}

impl Document {
    fn read(path: &Path) -> Result<(Self, bool)> {
        let file = formats::input::open(path)?;
        let length = file.metadata().map_err(|e| Error::io(path, e))?.len();
        let mut scanner = Scanner { reader: BufReader::new(file), at: 0, length, binary: false };
        scanner.need("its title")?;
        // The title is any text, and may be empty.
        let mut title = Vec::new();
        scanner.at += (&mut scanner.reader).take(LONGEST).read_until(b'\n', &mut title).map_err(Error::system)? as u64;
        scanner.binary = match scanner.need("its kind")?.to_ascii_uppercase().as_str() {
            "ASCII" => false,
            "BINARY" => true,
            other => return Err(wrong("ASCII or BINARY", other)),
        };
        let kind = scanner.need("its dataset")?;
        if !kind.to_ascii_uppercase().starts_with("DATASET STRUCTURED_POINTS") {
            return Err(Error::unsupported(format!("'{}'; structured points are read", excerpt(&kind)))
                .hint("resample it to an image first: ParaView's filter 'Resample To Image', then save as .vti"));
        }
        let (lattice, mut line) = lattice(&mut scanner)?;
        let mut document = Self { lattice, arrays: Vec::new(), left_out: Vec::new() };
        let mut cells = false;
        while let Some(text) = line {
            let words: Vec<&str> = text.split_whitespace().collect();
            match (words[0].to_ascii_uppercase().as_str(), &words[1..]) {
                (key @ ("POINT_DATA" | "CELL_DATA"), [count, ..]) => {
                    cells = key == "CELL_DATA";
                    let expected = document.count(cells);
                    if count.parse() != Ok(expected) {
                        return Err(
                            Error::invalid(format!("'{}', and the grid has {expected}", excerpt(&text))).hint(AGAIN)
                        );
                    }
                }
                (key, rest) => document.attribute(&mut scanner, key, rest, cells, &text)?,
            }
            line = scanner.line()?;
        }
        Ok((document, scanner.binary))
    }

    fn count(&self, cells: bool) -> u64 {
        self.lattice.size(cells).iter().fold(1, |p: u64, n| p.saturating_mul(*n as u64))
    }

    /// Reads one attribute, or passes over it.
    fn attribute(&mut self, scanner: &mut Scanner, key: &str, rest: &[&str], cells: bool, line: &str) -> Result<()> {
        let count = self.count(cells);
        match (key, rest) {
            ("SCALARS", [name, of, components @ ..]) => {
                let components = components.first().map_or(Ok(1), |t| t.parse().map_err(|_| wrong("SCALARS", line)))?;
                let table = scanner.need("a lookup table's name")?;
                if !table.to_ascii_uppercase().starts_with("LOOKUP_TABLE") {
                    return Err(wrong("LOOKUP_TABLE", &table));
                }
                self.add(scanner, (name, kind(of)?), components, (count, cells))
            }
            ("VECTORS" | "NORMALS", [name, of]) => self.add(scanner, (name, kind(of)?), 3, (count, cells)),
            ("TENSORS", [name, of]) => self.add(scanner, (name, kind(of)?), 9, (count, cells)),
            ("TEXTURE_COORDINATES", [name, components, of]) => {
                let components = components.parse().map_err(|_| wrong("TEXTURE_COORDINATES", line))?;
                self.add(scanner, (name, kind(of)?), components, (count, cells))
            }
            ("COLOR_SCALARS", [name, components]) => {
                let components: u64 = components.parse().map_err(|_| wrong("COLOR_SCALARS", line))?;
                self.left_out.push(format!("colors '{}' were left out", excerpt(name)));
                scanner.pass(count.saturating_mul(components), Type::Number(Sample::U8))
            }
            ("LOOKUP_TABLE", [_, entries]) => {
                let entries: u64 = entries.parse().map_err(|_| wrong("LOOKUP_TABLE", line))?;
                scanner.pass(entries.saturating_mul(4), Type::Number(Sample::U8))
            }
            ("FIELD", [_, _]) => field(scanner, line, |scanner, FieldArray { name, components, tuples, kind }| {
                self.add(scanner, (&name, kind), components, (tuples, cells))
            }),
            ("METADATA", _) => scanner.block(),
            _ => Err(Error::invalid(format!("'{}' at byte {} is no attribute", excerpt(line), scanner.at)).hint(AGAIN)),
        }
    }

    fn add(
        &mut self,
        scanner: &mut Scanner,
        (name, kind): (&str, Type),
        components: u64,
        (count, cells): (u64, bool),
    ) -> Result<()> {
        let (name, place) = (decoded(name), scanner.at);
        scanner.pass(count.saturating_mul(components), kind)?;
        let fits = matches!(components, 1 | 3) && count == self.count(cells) && self.arrays.len() < MOST_ARRAYS;
        match kind {
            Type::Number(sample) if fits => {
                self.arrays.push(Array { name, sample, components: components as usize, cells, place });
            }
            _ => {
                self.left_out.push(format!("array '{}' of {count} x {components} values was left out", excerpt(&name)));
            }
        }
        Ok(())
    }
}

/// Opens the arrays of a file that have one or three values at each point or cell.
///
/// # Errors
/// If the file is damaged, holds another dataset than structured points, or no array is left.
pub(crate) fn open(path: &Path, options: &Options) -> Result<Vec<Image>> {
    let (document, binary) = Document::read(path)?;
    let slices = |array: &Array<u64>| -> Result<Box<dyn Slices>> {
        let reader = input::values(path, array.place, Packing::Plain, 0)?;
        Ok(if binary {
            Box::new(Binary::new(reader, array.sample, Endian::Big))
        } else {
            Box::new(Words::new(reader, None))
        })
    };
    images(&document.arrays, &document.lattice, document.left_out, options, slices)
}
