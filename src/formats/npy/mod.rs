//! NumPy's `.npy` arrays, format versions 1 to 3 (NEP 1): a header that names type, order and shape, then the values.
//!
//! [`read`] gives `f32` from floats of 16, 32 and 64 bits and from integers, in either byte order; [`write()`] writes
//! little-endian `f32` in C order, the last axis fastest. Volumes pass through [`super::imaging`] instead.

mod header;

use crate::error::{Code, Error, Result};
use crate::formats::atomic;
use crate::formats::input;
use crate::formats::limits::Limits;
use crate::formats::reading::Reading;
use crate::formats::sample::{Endian, Sample};
pub(in crate::formats) use header::{Header, parse_type, written};
use std::io::{BufReader, Read};
use std::path::Path;

/// First bytes of every such file.
const MAGIC: &[u8; 6] = b"\x93NUMPY";
/// Bytes that are read or written at a time.
const CHUNK: usize = 1 << 16;

/// An array in C order: the last axis is the fastest.
#[derive(Debug, Clone, PartialEq)]
pub struct Array {
    /// Lengths of the axes.
    pub shape: Vec<usize>,
    /// Values, as many as the product of the lengths.
    pub values: Vec<f32>,
}

/// Reads an array. Its values as `f32` must fit into the limits.
///
/// # Errors
/// If the file cannot be read, is no `.npy`, holds another type than floats and integers, is shorter or
/// longer than its shape says, or does not fit.
pub fn read(path: &Path, limits: Limits) -> Result<Array> {
    let _reading = Reading::begin(path);
    let file = input::open(path)?;
    let length = file.metadata().map_err(|e| Error::io(path, e))?.len();
    let mut reader = BufReader::with_capacity(CHUNK, file);
    let (header, start) = Header::read(&mut reader).map_err(|e| e.at(path))?;
    let count = header.count().map_err(|e| e.at(path))?;
    // A column-major array is held twice while it is turned.
    let copies = if header.fortran { 2 } else { 1 };
    let needed = (count as u64).saturating_mul(4 * copies);
    if needed > limits.max_memory {
        let what =
            format!("an array of shape {:?} takes {needed} bytes, {} are allowed", header.shape, limits.max_memory);
        return Err(Error::unsupported(what)
            .at(path)
            .coded(Code::MemoryLimit)
            .hint("raise ⟨max_memory⟩ if the file is to be trusted"));
    }
    let expected = (count as u64).saturating_mul(header.sample.bytes() as u64).saturating_add(start);
    if length != expected {
        return Err(Error::invalid(format!(
            "{length} bytes, and an array of shape {:?} of {} has {expected}",
            header.shape,
            header.sample.name()
        ))
        .at(path)
        .hint("the file is damaged or incomplete: write it again with numpy.save"));
    }
    let values = values(&mut reader, count, (header.sample, header.endian)).map_err(|e| Error::io(path, e))?;
    let values = if header.fortran { row_major(&header.shape, &values) } else { values };
    Ok(Array { shape: header.shape, values })
}

fn values(reader: &mut impl Read, count: usize, (sample, endian): (Sample, Endian)) -> std::io::Result<Vec<f32>> {
    let mut values = Vec::with_capacity(count);
    let mut chunk = vec![0; CHUNK];
    let mut numbers = Vec::with_capacity(CHUNK);
    while values.len() < count {
        let bytes = (count - values.len()).saturating_mul(sample.bytes()).min(CHUNK);
        reader.read_exact(&mut chunk[..bytes])?;
        numbers.clear();
        sample.decode(endian, &chunk[..bytes], &mut numbers);
        values.extend(numbers.iter().map(|v| *v as f32));
    }
    Ok(values)
}

/// Turns values whose first axis is the fastest.
fn row_major(shape: &[usize], values: &[f32]) -> Vec<f32> {
    let mut strides = vec![1; shape.len()];
    for axis in 1..shape.len() {
        strides[axis] = strides[axis - 1] * shape[axis - 1];
    }
    let mut at = vec![0; shape.len()];
    let mut turned = Vec::with_capacity(values.len());
    for _ in 0..values.len() {
        turned.push(values[at.iter().zip(&strides).map(|(i, stride)| i * stride).sum::<usize>()]);
        for axis in (0..shape.len()).rev() {
            at[axis] += 1;
            if at[axis] < shape[axis] {
                break;
            }
            at[axis] = 0;
        }
    }
    turned
}

/// Writes an array of single precision, whole or not at all.
///
/// # Errors
/// If the number of values is not the product of the lengths, or the operating system reports an error.
pub fn write(path: &Path, shape: &[usize], values: &[f32]) -> Result<()> {
    if shape.iter().product::<usize>() != values.len() {
        return Err(Error::invalid(format!("{} values do not fill an array of shape {shape:?}", values.len())).at(path));
    }
    atomic::write(path, |draft| {
        draft.write(&written(Sample::F32, shape))?;
        for chunk in values.chunks(CHUNK / 4) {
            draft.write(&chunk.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>())?;
        }
        Ok(())
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    fn file(descr: &str, fortran: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let mut text = format!("{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': {shape}, }}");
        while !(text.len() + 11).is_multiple_of(64) {
            text.push(' ');
        }
        text.push('\n');
        [MAGIC, &[1, 0][..], &(text.len() as u16).to_le_bytes(), text.as_bytes(), data].concat()
    }

    fn read_bytes(bytes: &[u8], limits: Limits) -> Result<Array> {
        let path = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(path.path(), bytes).unwrap();
        read(path.path(), limits)
    }

    #[test]
    fn what_is_written_is_read() {
        let dir = tempfile::tempdir().unwrap();
        for shape in [vec![], vec![1], vec![7], vec![2, 3], vec![2, 1, 3], vec![40, 50, 11]] {
            let values: Vec<f32> = (0..shape.iter().product()).map(|i| i as f32 / 3.0 - 1.0).collect();
            let path = dir.path().join("a.npy");
            write(&path, &shape, &values).unwrap();
            assert_eq!(read(&path, Limits::default()).unwrap(), Array { shape, values });
        }
    }

    #[test]
    fn types_and_orders_are_converted() {
        let halves: Vec<u8> = [0x3c00_u16, 0xc000].iter().flat_map(|h| h.to_le_bytes()).collect();
        assert_eq!(read_bytes(&file("<f2", "False", "(2,)", &halves), Limits::default()).unwrap().values, [1.0, -2.0]);
        let doubles: Vec<u8> = [0.1_f64, 4.0].iter().flat_map(|h| h.to_le_bytes()).collect();
        assert_eq!(read_bytes(&file("<f8", "False", "(2,)", &doubles), Limits::default()).unwrap().values, [0.1, 4.0]);
        for (descr, bytes, value) in [("|u1", vec![200], 200.0), ("<i2", vec![0xfe, 0xff], -2.0), ("|b1", vec![1], 1.0)]
        {
            let found = read_bytes(&file(descr, "False", "(1, 1)", &bytes), Limits::default()).unwrap();
            assert_eq!((found.shape, found.values), (vec![1, 1], vec![value]), "{descr}");
        }
        // Column-major: [[0, 1, 2], [3, 4, 5]] is stored as 0 3 1 4 2 5.
        let columns = file("|u1", "True", "(2, 3)", &[0, 3, 1, 4, 2, 5]);
        let found = read_bytes(&columns, Limits::default()).unwrap();
        assert_eq!(found.values, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
    }

    #[test]
    fn damaged_and_foreign_files_are_refused() {
        let good = file("|u1", "False", "(4,)", &[1, 2, 3, 4]);
        let cases: [(Vec<u8>, &str); 9] = [
            (good[..good.len() - 1].to_vec(), "shape [4]"),
            ([&good[..], &[0]].concat(), "shape [4]"),
            (good[..20].to_vec(), "header"),
            (b"no array".to_vec(), "no .npy"),
            (file("<c8", "False", "(1,)", &[0; 8]), "'<c8'"),
            (file("~f4", "False", "(1,)", &[0; 4]), "'~f4'"),
            (file("|u1", "Maybe", "(4,)", &[0; 4]), "fortran_order"),
            (file("|u1", "False", "(4, x)", &[0; 4]), "shape"),
            (file("|u1", "False", "(18446744073709551615, 2)", &[0; 4]), "too large"),
        ];
        for (bytes, words) in cases {
            let error = read_bytes(&bytes, Limits::default()).unwrap_err();
            assert!(error.to_string().contains(words) && error.remedy().is_some(), "{error} lacks {words}");
        }
        assert!(read_bytes(&good, Limits { max_memory: 15 }).unwrap_err().to_string().contains("allowed"));
        // Every truncation of a file is an error, none a panic.
        (0..good.len()).for_each(|n| assert!(read_bytes(&good[..n], Limits::default()).is_err()));
    }
}
