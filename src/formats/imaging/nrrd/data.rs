//! Values of an array: their type, encoding and files.

use super::fields::Fields;
use crate::error::{Error, Result};
use crate::formats::imaging::image::Slices;
use crate::formats::imaging::input::{self, Packing};
use crate::formats::imaging::stream::{self, Binary, Words};
use crate::formats::imaging::text::{excerpt, wrong};
use crate::formats::sample::{Endian, Sample};
use std::io::Read;
use std::path::{Path, PathBuf};

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
                excerpt(other)
            ))
            .hint("convert them to floats where the file was made"));
        }
    })
}

/// Where the values lie, and how they are written.
pub(crate) struct Data {
    /// Files, in order.
    pub files: Vec<PathBuf>,
    from: u64,
    encoding: Encoding,
    /// Type of the numbers.
    pub sample: Sample,
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
    pub(crate) fn of(fields: &Fields, path: &Path, length: u64, rest: &[String]) -> Result<Self> {
        let encoding = match fields.need("encoding")?.to_ascii_lowercase().as_str() {
            "raw" => Encoding::Raw,
            "gz" | "gzip" => Encoding::Gzip,
            "txt" | "text" | "ascii" => Encoding::Text,
            other => {
                return Err(Error::unsupported(format!(
                    "the encoding '{}'; raw, gzip and ascii are read",
                    excerpt(other)
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

    /// Slices of the volume of `count` numbers that begins at number `first` of those of a file, if each of its numbers
    /// follows the one before.
    pub(crate) fn slices(
        &self,
        file: &Path,
        (first, count): (u64, u64),
        total: Option<u64>,
    ) -> Result<Box<dyn Slices>> {
        let [bytes, own] = [first, count].map(|n| n.saturating_mul(self.sample.bytes() as u64));
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
                let reader = input::whole(reader, Packing::Gzip, own);
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
            let away = first < last && step < 0 || first > last && step > 0;
            if step == 0 || away || last.abs_diff(first) / step.unsigned_abs() > 100_000 {
                return Err(wrong("data file", text));
            }
            let count = last.abs_diff(first) / step.unsigned_abs();
            input::numbered(pattern, (0..=count as i64).map(|i| first + i * step))?
        }
        _ => vec![text.to_owned()],
    };
    names.iter().map(|name| input::present(path, name)).collect()
}

/// Slices of several files, each opened when it is its turn.
pub(crate) struct Files {
    data: Data,
    share: u64,
    per_file: usize,
    left: usize,
    next: usize,
    now: Option<Box<dyn Slices>>,
}

impl Files {
    /// Slices of all files of `data`, each of which has `share` bytes and `per_file` slices.
    pub(crate) fn new(data: &Data, share: u64, per_file: usize) -> Self {
        let data = Data { files: data.files.clone(), ..*data };
        Self { data, share, per_file, left: 0, next: 0, now: None }
    }
}

impl Slices for Files {
    fn next_slice(&mut self, values: &mut [f64]) -> Result<()> {
        if self.left == 0 {
            let file = self.data.files.get(self.next).ok_or_else(|| wrong("data file", "too few files"))?;
            let count = self.share / self.data.sample.bytes() as u64;
            self.now = Some(self.data.slices(file, (0, count), Some(self.share)).map_err(|e| e.at(file))?);
            (self.left, self.next) = (self.per_file, self.next + 1);
        }
        self.left -= 1;
        match &mut self.now {
            Some(slices) => slices.next_slice(values),
            None => Err(wrong("data file", "too few files")),
        }
    }
}
