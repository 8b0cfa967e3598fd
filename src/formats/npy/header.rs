//! The header: a Python dictionary with the keys `descr`, `fortran_order` and `shape`.

use super::MAGIC;
use crate::error::{Error, Result};
use crate::formats::sample::{Endian, Sample};
use crate::text::printable;
use std::io::Read;

/// Longest header that is read; those of plain arrays have some hundred bytes.
const LONGEST: usize = 1 << 16;
/// Largest number of axes in NumPy.
const MOST_AXES: usize = 64;
/// Advice on files that NumPy would not have written.
const AGAIN: &str = "write the array again with numpy.save";

/// Type of NumPy's name for it, such as `<u2`, with the order of the bytes.
pub(in crate::formats) fn parse_type(descr: &str) -> Option<(Sample, Endian)> {
    let (order, kind) = (descr.get(..1)?, descr.get(1..)?);
    let sample = match kind {
        "f2" => Sample::F16,
        "f4" => Sample::F32,
        "f8" => Sample::F64,
        "u1" | "b1" => Sample::U8,
        "i1" => Sample::I8,
        "u2" => Sample::U16,
        "i2" => Sample::I16,
        "u4" => Sample::U32,
        "i4" => Sample::I32,
        "u8" => Sample::U64,
        "i8" => Sample::I64,
        _ => return None,
    };
    match order {
        "<" | "|" | "=" => Some((sample, Endian::Little)),
        ">" => Some((sample, Endian::Big)),
        _ => None,
    }
}

/// NumPy's name of a type whose least significant byte comes first.
fn descr(sample: Sample) -> String {
    let kind = if sample.bytes() == 1 { "|" } else { "<" };
    let letter = if sample.is_integer() { &sample.name()[..1] } else { "f" };
    format!("{kind}{letter}{}", sample.bytes())
}

/// Type, order and shape of an array.
#[derive(Debug)]
pub(in crate::formats) struct Header {
    /// Type of the values.
    pub sample: Sample,
    /// Order of their bytes.
    pub endian: Endian,
    /// True if the first axis is the fastest.
    pub fortran: bool,
    /// Lengths of the axes.
    pub shape: Vec<usize>,
}

impl Header {
    /// Reads the header, and returns the number of its bytes, too.
    pub(in crate::formats) fn read(reader: &mut impl Read) -> Result<(Self, u64)> {
        let mut start = [0; 8];
        let begun = reader.read_exact(&mut start);
        if begun.is_err() || !start.starts_with(MAGIC) {
            return Err(Error::unsupported("this is no .npy array").hint("write one with numpy.save"));
        }
        let cut = |_| Error::invalid("the file ends within its header").hint(AGAIN);
        let (length, before) = if start[6] == 1 {
            let mut bytes = [0; 2];
            reader.read_exact(&mut bytes).map_err(cut)?;
            (usize::from(u16::from_le_bytes(bytes)), 10)
        } else {
            let mut bytes = [0; 4];
            reader.read_exact(&mut bytes).map_err(cut)?;
            (u32::from_le_bytes(bytes) as usize, 12)
        };
        if !(1..=3).contains(&start[6]) || length > LONGEST {
            return Err(Error::unsupported(format!("a header of version {} with {length} bytes", start[6])).hint(AGAIN));
        }
        let mut text = vec![0; length];
        reader.read_exact(&mut text).map_err(cut)?;
        Ok((Self::parse(&String::from_utf8_lossy(&text))?, before + length as u64))
    }

    fn parse(text: &str) -> Result<Self> {
        let descr = after(text, "descr")?;
        let quoted = descr.strip_prefix(['\'', '"']).and_then(|rest| rest.split(['\'', '"']).next());
        let (sample, endian) = quoted.and_then(parse_type).ok_or_else(|| {
            let found = quoted.map_or_else(|| "a structured type".into(), |q| format!("type '{}'", printable(q)));
            Error::unsupported(format!("values of {found}; floats and integers are read"))
                .hint("convert the array first: array.astype('<f4')")
        })?;
        let fortran = match after(text, "fortran_order")? {
            order if order.starts_with("True") => true,
            order if order.starts_with("False") => false,
            _ => return Err(wrong("fortran_order")),
        };
        let list = after(text, "shape")?.strip_prefix('(').and_then(|rest| rest.split_once(')')).map(|(list, _)| list);
        let parts = list.ok_or_else(|| wrong("shape"))?.split(',').map(str::trim).filter(|part| !part.is_empty());
        let shape: Vec<usize> = parts.map(|part| part.parse().map_err(|_| wrong("shape"))).collect::<Result<_>>()?;
        if shape.len() > MOST_AXES {
            return Err(wrong("shape"));
        }
        Ok(Self { sample, endian, fortran, shape })
    }

    /// Number of values.
    pub(in crate::formats) fn count(&self) -> Result<usize> {
        self.shape.iter().try_fold(1_usize, |product, n| product.checked_mul(*n)).ok_or_else(|| {
            Error::unsupported(format!("an array of shape {:?} is too large", self.shape)).hint("write a part of it")
        })
    }
}

fn wrong(key: &str) -> Error {
    Error::invalid(format!("the header's {key} cannot be understood")).hint(AGAIN)
}

/// Text of the value of a key.
fn after<'t>(text: &'t str, key: &str) -> Result<&'t str> {
    let rest = ['\'', '"'].iter().find_map(|q| text.split_once(&format!("{q}{key}{q}")).map(|(_, rest)| rest));
    let value = rest.and_then(|rest| rest.trim_start().strip_prefix(':'));
    value.map(str::trim_start).ok_or_else(|| wrong(key))
}

/// Header of an array in C order, padded so that the values begin at a multiple of 64 bytes.
pub(in crate::formats) fn written(sample: Sample, shape: &[usize]) -> Vec<u8> {
    let axes: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let axes = if shape.len() > 1 { axes.trim_end_matches(", ") } else { axes.trim_end() };
    let mut text = format!("{{'descr': '{}', 'fortran_order': False, 'shape': ({axes}), }}", descr(sample));
    while !(text.len() + 11).is_multiple_of(64) {
        text.push(' ');
    }
    text.push('\n');
    [MAGIC, &[1, 0][..], &(text.len() as u16).to_le_bytes(), text.as_bytes()].concat()
}
