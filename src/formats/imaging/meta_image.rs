//! MetaImage of ITK: `.mha` with its values, and `.mhd` with values in other files.
//!
//! Its world is left, posterior, superior, as everywhere in ITK, and is brought to right, anterior, superior.
//! `TransformMatrix` lists the directions of the axes one after the other; the file's `CenterOfRotation` plays no part
//! in it.

use super::image::{About, Header, Image, Slices, Values};
use super::input::{self, Packing};
use super::placement::{self, swap_lps_ras};
use super::stream::{Binary, Words};
use super::text::{self, excerpt, wrong};
use crate::error::{Error, Result};
use crate::formats::sample::{Endian, Sample};
use crate::math::Affine;
use glam::DVec3;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const AGAIN: &str = "correct the file's header, or write the file again where it was made";

/// Says whether a file begins as MetaImage's headers do.
pub(crate) fn is_meta_image(start: &[u8]) -> bool {
    let text = String::from_utf8_lossy(start);
    let mut keys = text.lines().take(12).filter_map(|l| l.split_once('=')).map(|(key, _)| key.trim());
    let first = keys.next().is_some_and(|k| matches!(k, "ObjectType" | "NDims" | "Comment" | "ObjectSubType"));
    first && text.contains("NDims")
}

struct Fields(BTreeMap<String, String>);

impl Fields {
    fn get(&self, names: &[&str]) -> Option<&str> {
        names.iter().find_map(|n| self.0.get(*n)).map(String::as_str)
    }

    fn need(&self, name: &str) -> Result<&str> {
        self.get(&[name]).ok_or_else(|| Error::invalid(format!("the header lacks '{name}'")).hint(AGAIN))
    }

    /// Value of a flag, which ITK tells by the first character; none if it is not there.
    fn flag(&self, names: &[&str]) -> Option<bool> {
        self.get(names).map(|v| v.starts_with(['T', 't', '1']))
    }

    fn is_true(&self, names: &[&str]) -> bool {
        self.flag(names) == Some(true)
    }
}

fn sample(name: &str) -> Result<(Sample, usize)> {
    let (name, array) = match name.strip_suffix("_ARRAY") {
        Some(name) => (name, true),
        None => (name, false),
    };
    let sample = match name {
        "MET_CHAR" => Sample::I8,
        "MET_UCHAR" => Sample::U8,
        "MET_SHORT" => Sample::I16,
        "MET_USHORT" => Sample::U16,
        "MET_INT" | "MET_LONG" => Sample::I32,
        "MET_UINT" | "MET_ULONG" => Sample::U32,
        "MET_LONG_LONG" => Sample::I64,
        "MET_ULONG_LONG" => Sample::U64,
        "MET_FLOAT" => Sample::F32,
        "MET_DOUBLE" => Sample::F64,
        other => {
            return Err(Error::unsupported(format!(
                "values of type '{}'; integers and floats are read",
                excerpt(other)
            ))
            .hint("convert them to MET_FLOAT where the file was made"));
        }
    };
    Ok((sample, if array { 3 } else { 1 }))
}

/// Numbers of voxels. A third axis that is missing has one.
fn size(fields: &Fields) -> Result<[usize; 3]> {
    let sizes = text::counts("DimSize", fields.need("DimSize")?)?;
    let rank: usize = fields.need("NDims")?.parse().map_err(|_| wrong("NDims", fields.need("NDims").unwrap_or("")))?;
    if rank != sizes.len() || sizes.contains(&0) {
        return Err(wrong("DimSize", fields.need("DimSize")?));
    }
    match sizes[..] {
        [x, y] => Ok([x, y, 1]),
        [x, y, z] | [x, y, z, 1] => Ok([x, y, z]),
        _ => Err(Error::unsupported(format!("{rank} axes of {sizes:?} entries; two or three are read"))
            .hint("write one volume of the series to a file of its own first")),
    }
}

fn placement(fields: &Fields, notes: &mut Vec<String>) -> Result<Affine> {
    let rank = text::counts("DimSize", fields.need("DimSize")?)?.len();
    let list = |names: &[&str], count: usize| -> Result<Option<Vec<f64>>> {
        let Some(text) = fields.get(names) else { return Ok(None) };
        let numbers = text::numbers(names[0], text)?;
        if numbers.len() == count { Ok(Some(numbers)) } else { Err(wrong(names[0], text)) }
    };
    let three = |list: Option<Vec<f64>>, missing: f64| {
        DVec3::from_array(std::array::from_fn(|i| list.as_ref().and_then(|l| l.get(i).copied()).unwrap_or(missing)))
    };
    let stated = list(&["ElementSpacing", "ElementSize"], rank)?;
    if stated.is_none() {
        notes.push("the file does not say how large its voxels are; 1 is taken, as its format says".into());
    }
    stated.iter().flatten().try_for_each(|edge| placement::edge("a number of ElementSpacing", *edge).map(drop))?;
    let spacing = three(stated, 1.0);
    let origin = three(list(&["Offset", "Position", "Origin"], rank)?, 0.0);
    let directions = list(&["TransformMatrix", "Orientation", "Rotation"], rank * rank)?;
    let column = |axis: usize| match &directions {
        None => DVec3::AXES[axis],
        Some(_) if axis >= rank => DVec3::AXES[axis],
        Some(d) => DVec3::from_array(std::array::from_fn(|i| if i < rank { d[axis * rank + i] } else { 0.0 })),
    };
    let map = placement::affine([0, 1, 2].map(|axis| column(axis) * spacing[axis]), origin)?;
    placement::checked(swap_lps_ras(map.matrix()))
}

/// Files of values, in order, and the byte in each at which they begin.
fn files(fields: &Fields, path: &Path, length: u64, rest: &[String], slices: usize) -> Result<(Vec<PathBuf>, u64)> {
    let name = fields.need("ElementDataFile")?;
    let words: Vec<&str> = name.split_whitespace().collect();
    let names: Vec<String> = match words[..] {
        ["LOCAL" | "Local" | "local"] => return Ok((vec![path.to_path_buf()], length)),
        ["LIST", ..] => rest.iter().map(|l| l.trim().to_owned()).filter(|l| !l.is_empty()).collect(),
        [pattern, first, ..] if pattern.contains('%') => {
            let number = |word: Option<&&str>, or: i64| {
                word.map_or(Ok(or), |w| w.parse().map_err(|_| wrong("ElementDataFile", name)))
            };
            let first = number(Some(&first), 0)?;
            let (last, step): (i64, i64) =
                (number(words.get(2), first.saturating_add(slices as i64 - 1))?, number(words.get(3), 1)?);
            if step <= 0 || last < first || last.abs_diff(first) > 100_000 {
                return Err(wrong("ElementDataFile", name));
            }
            input::numbered(pattern, (first..=last).step_by(step as usize))?
        }
        _ => vec![name.to_owned()],
    };
    Ok((names.iter().map(|name| input::present(path, name)).collect::<Result<_>>()?, 0))
}

/// Opens a header with its values.
///
/// # Errors
/// If a field is missing or cannot be understood, the values are of a kind that is not read, or a file is too short.
pub(crate) fn open(path: &Path) -> Result<Vec<Image>> {
    let key = |line: &str| line.split_once('=').map(|(key, value)| (key.trim().to_owned(), value.trim().to_owned()));
    let (lines, length) =
        text::lines(path, |line| key(line).is_some_and(|(k, v)| k == "ElementDataFile" && !v.starts_with("LIST")))?;
    let at = lines.iter().position(|l| key(l).is_some_and(|(k, _)| k == "ElementDataFile")).unwrap_or(lines.len());
    let fields = Fields(lines.iter().take(at + 1).filter_map(|l| key(l)).collect());
    let rest = lines.get(at + 1..).unwrap_or_default();
    let size = size(&fields)?;
    let (sample, implied) = sample(fields.need("ElementType")?)?;
    let components = match fields.get(&["ElementNumberOfChannels"]) {
        Some(text) => text.parse().ok().filter(|n| matches!(n, 1 | 3)).ok_or_else(|| {
            Error::unsupported(format!("{} values a voxel; 1 or 3 are read", excerpt(text)))
                .hint("write one channel, or a vector of three, to a file of its own first")
        })?,
        None => implied,
    };
    let (files, from) = files(&fields, path, length, rest, size[2])?;
    let slices = Data::of(&fields, files, from, sample)?.slices(size, components)?;
    let values = if sample.is_integer() { Values::Integer } else { Values::Real };
    let mut notes = Vec::new();
    let index_to_world = placement(&fields, &mut notes)?;
    notes.extend(placement::unturned(values, components));
    let about = About { sample: Some(sample), anatomical: true, ..About::default() };
    Ok(vec![Image { header: Header { name: None, size, components, values, index_to_world, about, notes }, slices }])
}

/// Values in one or several files.
struct Data {
    files: Vec<PathBuf>,
    from: u64,
    /// Bytes before the values of a file; -1 for all that is more than the values.
    header: i64,
    packing: Packing,
    text: bool,
    sample: Sample,
    endian: Endian,
    /// Bytes of values in each file.
    share: u64,
    per_file: usize,
    next: usize,
    left: usize,
    now: Option<Box<dyn Slices>>,
}

impl Data {
    fn of(fields: &Fields, files: Vec<PathBuf>, from: u64, sample: Sample) -> Result<Self> {
        let header = fields.get(&["HeaderSize"]).map_or(Ok(0), |t| t.parse().map_err(|_| wrong("HeaderSize", t)))?;
        let packing = if fields.is_true(&["CompressedData"]) { Packing::Zlib } else { Packing::Plain };
        let big = fields.is_true(&["BinaryDataByteOrderMSB", "ElementByteOrderMSB"]);
        let text = fields.flag(&["BinaryData"]) == Some(false);
        let endian = if big { Endian::Big } else { Endian::Little };
        Ok(Self {
            files,
            from,
            header,
            packing,
            text,
            sample,
            endian,
            share: 0,
            per_file: 0,
            next: 0,
            left: 0,
            now: None,
        })
    }

    fn slices(mut self, size: [usize; 3], components: usize) -> Result<Box<dyn Slices>> {
        let count = self.files.len();
        if count == 0 || !size[2].is_multiple_of(count) {
            return Err(Error::invalid(format!("{count} files for {} slices", size[2])).hint(AGAIN));
        }
        let total = input::byte_count(size, components, self.sample.bytes());
        let total = total.ok_or_else(|| Error::invalid(format!("{size:?} voxels are too many")).hint(AGAIN))?;
        (self.share, self.per_file) = (total / count as u64, size[2] / count);
        // A file that is not there or too short is found before anything else happens.
        self.advance()?;
        Ok(Box::new(self))
    }

    fn advance(&mut self) -> Result<()> {
        let file = self.files.get(self.next).ok_or_else(|| wrong("ElementDataFile", "too few files"))?;
        let length = crate::formats::input::open(file)?.metadata().map_err(|e| Error::io(file, e))?.len();
        let skip = match self.header {
            -1 => length.saturating_sub(self.share).saturating_sub(self.from),
            n => u64::try_from(n).map_err(|_| wrong("HeaderSize", &n.to_string()))?,
        };
        let from = self.from.saturating_add(skip);
        let mut reader = input::values(file, from, self.packing, 0)?;
        if !self.text {
            reader = input::whole(reader, self.packing, self.share);
        }
        if self.packing == Packing::Plain && !self.text {
            input::has(file, from, Some(self.share))?;
        }
        self.now = Some(if self.text {
            Box::new(Words::new(reader, None))
        } else {
            Box::new(Binary::new(reader, self.sample, self.endian))
        });
        (self.left, self.next) = (self.per_file, self.next + 1);
        Ok(())
    }
}

impl Slices for Data {
    fn next_slice(&mut self, values: &mut [f64]) -> Result<()> {
        if self.left == 0 {
            self.advance()?;
        }
        self.left -= 1;
        match &mut self.now {
            Some(slices) => slices.next_slice(values),
            None => Err(wrong("ElementDataFile", "too few files")),
        }
    }
}
