//! NRRD, versions 1 to 5: `.nrrd` with its values, and `.nhdr` with values in other files.
//!
//! Fields and their defaults follow the format's definition (teem, `nrrd/format`).

use super::image::{Header, Image, Slices, Values};
use super::input::{self, Packing};
use super::options::Options;
use super::placement::{self, swap_lps_ras};
use super::stream::{self, Binary, Planar, Words};
use super::text::{self, wrong};
use crate::error::{Error, Result};
use crate::formats::sample::{Endian, Sample};
use crate::math::Affine;
use crate::text::printable;
use glam::{DMat4, DVec3};
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};

const AGAIN: &str = "correct the file's header, or write the file again where it was made";

/// Fields by their names in lower case.
struct Fields(BTreeMap<String, String>);

impl Fields {
    fn of(lines: &[String]) -> Result<Self> {
        let mut fields = BTreeMap::new();
        for line in lines.iter().skip(1).filter(|l| !l.is_empty() && !l.starts_with('#')) {
            // `key:=value` is the user's own, and says nothing of the format.
            match line.split_once(':') {
                Some((_, value)) if value.starts_with('=') => {}
                Some((name, value)) => {
                    fields.insert(name.trim().to_ascii_lowercase(), value.trim().to_owned());
                }
                None => {
                    return Err(
                        Error::invalid(format!("the header's line '{}' is no field", printable(line))).hint(AGAIN)
                    );
                }
            }
        }
        Ok(Self(fields))
    }

    /// Value of the first of several spellings.
    fn get(&self, names: &[&str]) -> Option<&str> {
        names.iter().find_map(|n| self.0.get(*n)).map(String::as_str)
    }

    fn need(&self, name: &str) -> Result<&str> {
        self.get(&[name]).ok_or_else(|| Error::invalid(format!("the header lacks the field '{name}'")).hint(AGAIN))
    }
}

/// How the axes of the array are understood.
struct Layout {
    /// Axes in space, fastest first.
    space: Vec<usize>,
    /// Axis of a voxel's components, first or last of all.
    components: Option<usize>,
    /// Axis of points in time or of independent volumes.
    list: Option<usize>,
    sizes: Vec<usize>,
}

impl Layout {
    fn of(fields: &Fields) -> Result<Self> {
        let sizes = text::counts("sizes", fields.need("sizes")?)?;
        let rank: usize = fields
            .need("dimension")?
            .parse()
            .map_err(|_| wrong("dimension", fields.need("dimension").unwrap_or("")))?;
        if sizes.len() != rank || sizes.contains(&0) {
            return Err(wrong("sizes", fields.need("sizes")?));
        }
        let kinds: Vec<String> = fields
            .get(&["kinds"])
            .map(|k| k.split_whitespace().map(str::to_ascii_lowercase).collect())
            .unwrap_or_default();
        let directions = fields.get(&["space directions"]).map(directions).transpose()?;
        let spatial = |axis: usize| match (&directions, kinds.get(axis).map(String::as_str)) {
            (Some(directions), _) => directions.get(axis).is_some_and(Option::is_some),
            (None, Some("space" | "domain")) => true,
            (None, None | Some("???" | "none")) => rank <= 3,
            (None, Some(_)) => false,
        };
        let space: Vec<usize> = (0..rank).filter(|a| spatial(*a)).collect();
        let others: Vec<usize> = (0..rank).filter(|a| !spatial(*a)).collect();
        let vector = |axis: usize| {
            let kind = kinds.get(axis).map_or("", String::as_str);
            sizes[axis] == 3 && !matches!(kind, "list" | "time" | "domain")
        };
        let (components, list) = match others[..] {
            [] => (None, None),
            [a] if sizes[a] > 1 && vector(a) => (Some(a), None),
            [a] => (None, Some(a)),
            [a, b] if vector(a) => (Some(a), Some(b)),
            [a, b] if vector(b) => (Some(b), Some(a)),
            _ => (Some(rank), None),
        };
        let ends = |axis: Option<usize>| axis.is_none_or(|a| a == 0 || a + 1 == rank || others.len() == 2);
        let contiguous = space.windows(2).all(|w| w[1] == w[0] + 1);
        if space.is_empty() || space.len() > 3 || components == Some(rank) || !ends(components) || !contiguous {
            return Err(Error::unsupported(format!(
                "{rank} axes of {sizes:?} entries, of which {} are in space; up to three are read, with components or points \
                 in time before or after them",
                space.len()
            ))
            .hint("set 'kinds' or 'space directions' so that the axes in space can be told, or write one volume of the file"));
        }
        Ok(Self { space, components, list, sizes })
    }

    fn size(&self) -> [usize; 3] {
        std::array::from_fn(|i| self.space.get(i).map_or(1, |a| self.sizes[*a]))
    }

    /// Length of an axis, 1 if there is none.
    fn length(&self, axis: Option<usize>) -> usize {
        axis.map_or(1, |a| self.sizes[a])
    }

    /// Steps in the array, in numbers, between the entries of an axis.
    fn step(&self, axis: Option<usize>) -> u64 {
        axis.map_or(0, |a| self.sizes[..a].iter().fold(1, |p: u64, n| p.saturating_mul(*n as u64)))
    }
}

/// Directions of the axes; none for an axis that is not in space.
fn directions(text: &str) -> Result<Vec<Option<DVec3>>> {
    let mut found = Vec::new();
    let mut rest = text.trim();
    while !rest.is_empty() {
        if let Some(after) = rest.strip_prefix("none") {
            found.push(None);
            rest = after.trim_start();
        } else {
            let (vector, after) = bracketed("space directions", rest)?;
            found.push(Some(vector));
            rest = after;
        }
    }
    Ok(found)
}

/// Vector in brackets at the beginning of a text, and what follows it. Two numbers are a vector in the plane.
fn bracketed<'t>(field: &str, text: &'t str) -> Result<(DVec3, &'t str)> {
    let inner = text.trim_start().strip_prefix('(').and_then(|t| t.split_once(')'));
    let (inner, after) = inner.ok_or_else(|| wrong(field, text))?;
    let vector = match text::numbers(field, inner)?[..] {
        [x, y, z] => DVec3::new(x, y, z),
        [x, y] => DVec3::new(x, y, 0.0),
        _ => return Err(wrong(field, text)),
    };
    Ok((vector, after.trim_start()))
}

/// Map from indices to right, anterior, superior where the file names its space, else to the file's own axes.
fn placement(fields: &Fields, layout: &Layout, notes: &mut Vec<String>) -> Result<Affine> {
    let mut columns = [DVec3::X, DVec3::Y, DVec3::Z];
    let mut origin = DVec3::ZERO;
    if let Some(text) = fields.get(&["space directions"]) {
        let found = directions(text)?;
        for (column, axis) in columns.iter_mut().zip(&layout.space) {
            *column = found.get(*axis).copied().flatten().ok_or_else(|| wrong("space directions", text))?;
        }
        if layout.space.len() == 2 {
            columns[2] = columns[0].cross(columns[1]).normalize_or(DVec3::Z);
        }
        if let Some(text) = fields.get(&["space origin"]) {
            origin = bracketed("space origin", text)?.0;
        }
    } else {
        by_axis(fields, layout, &mut columns, &mut origin)?;
    }
    let map = placement::affine(columns, origin)?;
    let space = fields.get(&["space"]).unwrap_or("").to_ascii_lowercase();
    let mirrored = DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    match space.trim_end_matches("-time").trim_end_matches('t') {
        "right-anterior-superior" | "ras" => Ok(map),
        "left-posterior-superior" | "lps" => placement::checked(swap_lps_ras(map.matrix())),
        "left-anterior-superior" | "las" => placement::checked(mirrored * map.matrix()),
        "3d-left-handed" => {
            notes.push("the file's space is left-handed; its x axis was turned round".into());
            placement::checked(mirrored * map.matrix())
        }
        _ => Ok(map),
    }
}

/// Placement by spacings and by the ends of the axes, which count from the centres of voxels or from their outer faces.
fn by_axis(fields: &Fields, layout: &Layout, columns: &mut [DVec3; 3], origin: &mut DVec3) -> Result<()> {
    let list = |names: &[&str]| -> Result<Vec<f64>> {
        let Some(text) = fields.get(names) else { return Ok(Vec::new()) };
        // `nan` stands where nothing is known.
        text.split_whitespace().map(|w| w.parse().map_err(|_| wrong(names[0], text))).collect()
    };
    let (spacings, low, high) =
        (list(&["spacings"])?, list(&["axis mins", "axismins"])?, list(&["axis maxs", "axismaxs"])?);
    let centerings: Vec<&str> = fields.get(&["centers", "centerings"]).unwrap_or("").split_whitespace().collect();
    for (i, axis) in layout.space.iter().enumerate() {
        let known = |list: &[f64]| list.get(*axis).copied().filter(|v| v.is_finite());
        let cell = centerings.get(*axis) != Some(&"node");
        let count = layout.sizes[*axis] as f64 - if cell { 0.0 } else { 1.0 };
        let from_ends = known(&high).zip(known(&low)).map(|(h, l)| (h - l) / count.max(1.0));
        let spacing = known(&spacings).or(from_ends).unwrap_or(1.0);
        columns[i] *= spacing;
        origin[i] = known(&low).map_or(0.0, |low| if cell { low + 0.5 * spacing } else { low });
    }
    Ok(())
}

/// Type of the numbers.
fn sample(name: &str) -> Result<Sample> {
    Ok(match name.trim().to_ascii_lowercase().as_str() {
        "signed char" | "int8" | "int8_t" => Sample::I8,
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => Sample::U8,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => Sample::I16,
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => Sample::U16,
        "int" | "signed int" | "int32" | "int32_t" => Sample::I32,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => Sample::U32,
        "longlong"
        | "long long"
        | "long long int"
        | "signed long long"
        | "signed long long int"
        | "int64"
        | "int64_t" => Sample::I64,
        "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => Sample::U64,
        "float" => Sample::F32,
        "double" => Sample::F64,
        other => {
            return Err(Error::unsupported(format!(
                "values of type '{}'; integers and floats are read",
                printable(other)
            ))
            .hint("convert them to floats where the file was made"));
        }
    })
}

/// Where the values lie, and how they are written.
struct Data {
    files: Vec<PathBuf>,
    from: u64,
    encoding: Encoding,
    sample: Sample,
    endian: Endian,
    /// Bytes before the values, after unpacking; -1 for all that is more than the values.
    byte_skip: i64,
    line_skip: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Raw,
    Text,
    Gzip,
}

impl Data {
    fn of(fields: &Fields, path: &Path, length: u64, rest: &[String]) -> Result<Self> {
        let encoding = match fields.need("encoding")?.to_ascii_lowercase().as_str() {
            "raw" => Encoding::Raw,
            "gz" | "gzip" => Encoding::Gzip,
            "txt" | "text" | "ascii" => Encoding::Text,
            other => {
                return Err(Error::unsupported(format!(
                    "the encoding '{}'; raw, gzip and ascii are read",
                    printable(other)
                ))
                .hint("write the file again with one of these: unu save -f nrrd -e gzip -i IN -o OUT"));
            }
        };
        let sample = sample(fields.need("type")?)?;
        let endian = match fields.get(&["endian"]).map(str::to_ascii_lowercase).as_deref() {
            Some("big") => Endian::Big,
            Some("little") => Endian::Little,
            None if sample.bytes() == 1 || encoding == Encoding::Text => Endian::Little,
            other => return Err(wrong("endian", other.unwrap_or("not there"))),
        };
        let whole = |names: &[&str]| -> Result<i64> {
            fields.get(names).map_or(Ok(0), |text| text.parse().map_err(|_| wrong(names[0], text)))
        };
        let line_skip =
            u64::try_from(whole(&["line skip", "lineskip"])?).map_err(|_| wrong("line skip", "negative"))?;
        let byte_skip = whole(&["byte skip", "byteskip"])?;
        let (files, from) = match fields.get(&["data file", "datafile"]) {
            None => (vec![path.to_path_buf()], length),
            Some(text) => (data_files(text, path, rest)?, 0),
        };
        Ok(Self { files, from, encoding, sample, endian, byte_skip, line_skip })
    }

    /// Slices of the volume that begins at number `first` of those of a file, if each of its numbers follows the one before.
    fn slices(&self, file: &Path, first: u64, total: Option<u64>) -> Result<Box<dyn Slices>> {
        let bytes = first.saturating_mul(self.sample.bytes() as u64);
        let mut from = self.from;
        if self.line_skip > 0 {
            let mut left = self.line_skip;
            let mut reader = input::values(file, from, Packing::Plain, 0)?;
            let mut byte = [0];
            while left > 0 && reader.read(&mut byte).map_err(|e| Error::io(file, e))? == 1 {
                from += 1;
                left -= u64::from(byte == [b'\n']);
            }
        }
        let skip = match (self.byte_skip, total) {
            (-1, Some(total)) if self.encoding == Encoding::Raw => {
                let length = std::fs::metadata(file).map_err(|e| Error::io(file, e))?.len();
                length.saturating_sub(total).saturating_sub(from)
            }
            (skip, _) => u64::try_from(skip).map_err(|_| wrong("byte skip", &skip.to_string()))?,
        };
        match self.encoding {
            Encoding::Raw => {
                input::has(file, from.saturating_add(skip), total)?;
                let reader = input::values(file, from.saturating_add(skip), Packing::Plain, bytes)?;
                Ok(Box::new(Binary::new(reader, self.sample, self.endian)))
            }
            Encoding::Gzip => {
                let reader = input::values(file, from, Packing::Gzip, skip.saturating_add(bytes))?;
                Ok(Box::new(Binary::new(reader, self.sample, self.endian)))
            }
            Encoding::Text => {
                let mut words = Words::new(input::values(file, from.saturating_add(skip), Packing::Plain, 0)?, None);
                stream::skip_values(&mut words, first)?;
                Ok(Box::new(words))
            }
        }
    }
}

/// Files of values that a header names: one, a list of lines, or a pattern with its numbers.
fn data_files(text: &str, path: &Path, rest: &[String]) -> Result<Vec<PathBuf>> {
    let words: Vec<&str> = text.split_whitespace().collect();
    let names = match words[..] {
        ["LIST", ..] => rest.iter().map(|l| l.trim().to_owned()).filter(|l| !l.is_empty()).collect(),
        [pattern, first, last, step, ..] if pattern.contains('%') => {
            let number = |word: &str| word.parse::<i64>().map_err(|_| wrong("data file", text));
            let (first, last, step) = (number(first)?, number(last)?, number(step)?);
            if step == 0 || last.abs_diff(first) / step.unsigned_abs() > 100_000 {
                return Err(wrong("data file", text));
            }
            let count = last.abs_diff(first) / step.unsigned_abs();
            input::numbered(pattern, (0..=count as i64).map(|i| first + i * step))?
        }
        _ => vec![text.to_owned()],
    };
    names.iter().map(|name| input::beside(path, name)).collect()
}

/// Opens a header with its values.
///
/// # Errors
/// If a field is missing or cannot be understood, the values are of a kind that is not read, or a file is too short.
pub fn open(path: &Path, options: &Options) -> Result<Vec<Image>> {
    let mut listing = false;
    let (mut lines, length) = text::lines(path, |line| {
        listing |= line.to_ascii_lowercase().replace(' ', "").starts_with("datafile:list");
        // After a list come the names of files, up to the end.
        line.is_empty() && !listing
    })?;
    let split = lines.iter().position(|l| l.to_ascii_lowercase().replace(' ', "").starts_with("datafile:list"));
    let rest = split.map_or_else(Vec::new, |at| lines.split_off(at + 1));
    let fields = Fields::of(&lines)?;
    let data = Data::of(&fields, path, length, &rest)?;
    let layout = Layout::of(&fields)?;
    let mut notes = Vec::new();
    let index_to_world = placement(&fields, &layout, &mut notes)?;
    let time = options.choose_time(layout.length(layout.list), &mut notes)?;
    let slices = slices(&data, &layout, time)?;
    let values = if data.sample.is_integer() { Values::Integer } else { Values::Real };
    let components = layout.length(layout.components);
    Ok(vec![Image {
        header: Header { name: None, size: layout.size(), components, values, index_to_world, notes },
        slices,
    }])
}

fn slices(data: &Data, layout: &Layout, time: usize) -> Result<Box<dyn Slices>> {
    let total = layout.sizes.iter().try_fold(data.sample.bytes() as u64, |p, n| p.checked_mul(*n as u64));
    let too_many = || Error::invalid(format!("{:?} values are too many", layout.sizes)).hint(AGAIN);
    let total = total.ok_or_else(too_many)?;
    let list = layout.step(layout.list);
    // What varies faster than space, other than a voxel's components, would have to be left out value by value.
    let before: usize = layout.sizes[..layout.space[0]].iter().product();
    let together =
        if layout.components.is_some_and(|a| a < layout.space[0]) { layout.length(layout.components) } else { 1 };
    if before != together {
        return Err(Error::unsupported("the points in time are the fastest axis")
            .hint("write the file with the axis of time last: unu permute"));
    }
    if data.files.len() > 1 {
        return files(data, layout, total, time);
    }
    let file = data.files.first().ok_or_else(|| wrong("data file", "an empty list"))?;
    let first = time as u64 * list;
    match layout.components.filter(|a| *a > layout.space[0]) {
        None => data.slices(file, first, Some(total)),
        Some(axis) => {
            let step = layout.step(Some(axis));
            let part = |c: usize| data.slices(file, first + c as u64 * step, Some(total));
            Ok(Box::new(Planar::new((0..layout.sizes[axis]).map(part).collect::<Result<_>>()?)))
        }
    }
}

/// Slices in files of equal shares of the slowest axis, one after the other.
fn files(data: &Data, layout: &Layout, total: u64, time: usize) -> Result<Box<dyn Slices>> {
    let count = data.files.len();
    let slowest = layout.sizes.last().copied().unwrap_or(1);
    let last = layout.space.last() == Some(&(layout.sizes.len() - 1));
    if total % count as u64 != 0
        || (last && slowest % count != 0)
        || !last && (layout.list.is_none() || slowest != count)
    {
        return Err(Error::unsupported(format!("{count} files for {:?} values", layout.sizes))
            .hint("each file must hold as many slices as every other, or one point in time"));
    }
    let share = total / count as u64;
    if !last {
        return data.slices(&data.files[time], 0, Some(share));
    }
    Ok(Box::new(Files { data: data.clone_layout(), share, per_file: slowest / count, left: 0, next: 0, now: None }))
}

impl Data {
    fn clone_layout(&self) -> Self {
        Self { files: self.files.clone(), ..*self }
    }
}

/// Slices of several files, each opened when it is its turn.
struct Files {
    data: Data,
    share: u64,
    per_file: usize,
    left: usize,
    next: usize,
    now: Option<Box<dyn Slices>>,
}

impl Slices for Files {
    fn next_slice(&mut self, values: &mut [f64]) -> Result<()> {
        if self.left == 0 {
            let file = self.data.files.get(self.next).ok_or_else(|| wrong("data file", "too few files"))?;
            self.now = Some(self.data.slices(file, 0, Some(self.share)).map_err(|e| e.at(file))?);
            (self.left, self.next) = (self.per_file, self.next + 1);
        }
        self.left -= 1;
        match &mut self.now {
            Some(slices) => slices.next_slice(values),
            None => Err(wrong("data file", "too few files")),
        }
    }
}
