//! The header: a Python dictionary with the keys `descr`, `fortran_order` and `shape`.

use super::MAGIC;
use crate::error::{Error, Result};
use crate::text::printable;
use half::f16;
use std::io::Read;

/// Longest header that is read; those of plain arrays have some hundred bytes.
const LONGEST: usize = 1 << 16;
/// Largest number of axes in NumPy.
const MOST_AXES: usize = 64;
/// Advice on files that NumPy would not have written.
const AGAIN: &str = "write the array again with numpy.save";

/// Type of the values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Type {
    F16,
    F32,
    F64,
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
}

impl Type {
    fn parse(descr: &str) -> Option<Self> {
        Some(match descr {
            "<f2" => Self::F16,
            "<f4" => Self::F32,
            "<f8" => Self::F64,
            "|u1" | "|b1" => Self::U8,
            "|i1" => Self::I8,
            "<u2" => Self::U16,
            "<i2" => Self::I16,
            "<u4" => Self::U32,
            "<i4" => Self::I32,
            _ => return None,
        })
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::F16 => "float16",
            Self::F32 => "float32",
            Self::F64 => "float64",
            Self::U8 => "uint8",
            Self::I8 => "int8",
            Self::U16 => "uint16",
            Self::I16 => "int16",
            Self::U32 => "uint32",
            Self::I32 => "int32",
        }
    }

    pub(super) fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::F16 | Self::U16 | Self::I16 => 2,
            Self::F32 | Self::U32 | Self::I32 => 4,
            Self::F64 => 8,
        }
    }

    /// Value of as many bytes as the type has.
    pub(super) fn value(self, bytes: &[u8]) -> f32 {
        match (self, bytes) {
            (Self::U8, [a]) => f32::from(*a),
            (Self::I8, [a]) => f32::from(i8::from_le_bytes([*a])),
            (Self::F16, [a, b]) => f16::from_le_bytes([*a, *b]).to_f32(),
            (Self::U16, [a, b]) => f32::from(u16::from_le_bytes([*a, *b])),
            (Self::I16, [a, b]) => f32::from(i16::from_le_bytes([*a, *b])),
            (Self::F32, [a, b, c, d]) => f32::from_le_bytes([*a, *b, *c, *d]),
            (Self::U32, [a, b, c, d]) => u32::from_le_bytes([*a, *b, *c, *d]) as f32,
            (Self::I32, [a, b, c, d]) => i32::from_le_bytes([*a, *b, *c, *d]) as f32,
            (Self::F64, [a, b, c, d, e, f, g, h]) => f64::from_le_bytes([*a, *b, *c, *d, *e, *f, *g, *h]) as f32,
            _ => f32::NAN,
        }
    }
}

/// Type, order and shape of an array.
#[derive(Debug)]
pub(super) struct Header {
    pub kind: Type,
    /// True if the first axis is the fastest.
    pub fortran: bool,
    pub shape: Vec<usize>,
}

impl Header {
    /// Reads the header, and returns the number of its bytes, too.
    pub(super) fn read(reader: &mut impl Read) -> Result<(Self, u64)> {
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
        let kind = quoted.and_then(Type::parse).ok_or_else(|| {
            let found = quoted.map_or_else(|| "a structured type".into(), |q| format!("type '{}'", printable(q)));
            Error::unsupported(format!("values of {found}; floats and integers of up to 32 bits are read"))
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
        Ok(Self { kind, fortran, shape })
    }

    /// Number of values.
    pub(super) fn count(&self) -> Result<usize> {
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

/// Header of an array of single precision in C order, padded so that the values begin at a multiple of 64 bytes.
pub(super) fn written(shape: &[usize]) -> Vec<u8> {
    let axes: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let axes = if shape.len() > 1 { axes.trim_end_matches(", ") } else { axes.trim_end() };
    let mut text = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({axes}), }}");
    while !(text.len() + 11).is_multiple_of(64) {
        text.push(' ');
    }
    text.push('\n');
    [MAGIC, &[1, 0][..], &(text.len() as u16).to_le_bytes(), text.as_bytes()].concat()
}
