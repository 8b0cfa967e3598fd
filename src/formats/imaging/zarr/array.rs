//! Metadata of an array: shape, chunks, type, fill value, codecs and the names of chunks.

use super::codec::Codec;
use super::document::{Document, wrong};
use crate::error::{Error, Result};
use crate::formats::imaging::text::excerpt;
use crate::formats::npy;
use crate::formats::sample::{Endian, Sample};
use serde_json::Value;
use std::path::PathBuf;

/// Most axes that an array may have.
const MOST_AXES: usize = 16;

/// Chunks of a shard, which lie in one file behind an index.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Shards {
    /// Lengths of a shard along each axis.
    pub shape: Vec<u64>,
    /// True if the index lies at the end of the file, false at its start.
    pub at_end: bool,
    /// True if the index is followed by a checksum of 4 bytes.
    pub checksum: bool,
}

/// An array as its metadata describes it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Array {
    /// Lengths of the axes.
    pub shape: Vec<u64>,
    /// Lengths of a chunk along each axis.
    pub chunk: Vec<u64>,
    /// Type of the values.
    pub sample: Sample,
    /// Order of their bytes.
    pub endian: Endian,
    /// Value of the chunks that are not there.
    pub fill: f64,
    /// Axes in the order in which chunks store them, the slowest first.
    pub order: Vec<usize>,
    /// Codecs in the order in which they are undone.
    pub codecs: Vec<Codec>,
    /// Shards that chunks lie in, if any.
    pub shards: Option<Shards>,
    /// Text before the numbers of a chunk's name.
    prefix: &'static str,
    /// Text between these numbers.
    separator: char,
}

/// Text between the numbers of a chunk's name, of which the specification knows two: others could lead out of the
/// folder.
fn separator(stated: Option<&Value>, usual: char) -> Result<char> {
    match stated.map(|value| (value, value.as_str())) {
        None | Some((Value::Null, _)) => Ok(usual),
        Some((_, Some("."))) => Ok('.'),
        Some((_, Some("/"))) => Ok('/'),
        Some((other, _)) => Err(wrong(format!(
            "the separator of the chunks' names is {}; '.' or '/' is expected",
            excerpt(&other.to_string())
        ))),
    }
}

/// Numbers of a JSON list.
pub(crate) fn numbers(value: Option<&Value>, what: &str) -> Result<Vec<u64>> {
    let list = value.and_then(Value::as_array).and_then(|l| l.iter().map(Value::as_u64).collect::<Option<Vec<_>>>());
    list.ok_or_else(|| wrong(format!("'{what}' is no list of numbers from 0 on")))
}

/// Text of a key.
pub(crate) fn text<'v>(value: &'v Value, key: &str) -> Option<&'v str> {
    value.get(key).and_then(Value::as_str)
}

impl Array {
    /// Reads the metadata of an array.
    ///
    /// # Errors
    /// If something is missing or contradicts the specification, or the type or a codec is not read.
    pub(crate) fn parse(document: &Document) -> Result<Self> {
        let array = if document.version == 3 { three(&document.metadata) } else { two(&document.metadata) }?;
        let axes = array.shape.len();
        if axes == 0 || axes > MOST_AXES || array.chunk.len() != axes || array.chunk.contains(&0) {
            let what = format!("chunks of {:?} in an array of {:?}", array.chunk, array.shape);
            return Err(wrong(format!("{what}: as many lengths are expected, none of a chunk 0")));
        }
        let mut sorted = array.order.clone();
        sorted.sort_unstable();
        if sorted != (0..axes).collect::<Vec<_>>() {
            return Err(wrong(format!("the axes {:?} are no order of {axes} axes", array.order)));
        }
        if let Some(shards) = &array.shards {
            let fits = |(shard, chunk): (&u64, &u64)| shard.is_multiple_of(*chunk);
            if shards.shape.len() != axes
                || shards.shape.contains(&0)
                || !shards.shape.iter().zip(&array.chunk).all(fits)
            {
                return Err(wrong(format!(
                    "shards of {:?} do not consist of chunks of {:?}",
                    shards.shape, array.chunk
                )));
            }
        }
        Ok(array)
    }

    /// Bytes of an unpacked chunk; none if they overflow.
    pub(crate) fn chunk_bytes(&self) -> Option<u64> {
        self.chunk.iter().try_fold(self.sample.bytes() as u64, |product, n| product.checked_mul(*n))
    }

    /// Path of the file of a chunk, or of its shard, relative to the array's folder.
    pub(crate) fn file(&self, chunk: &[u64]) -> PathBuf {
        let number = |(axis, n): (usize, &u64)| match &self.shards {
            Some(shards) => (n * self.chunk[axis] / shards.shape[axis]).to_string(),
            None => n.to_string(),
        };
        let mut parts: Vec<String> = chunk.iter().enumerate().map(number).collect();
        if !self.prefix.is_empty() {
            parts.insert(0, self.prefix.to_owned());
        }
        PathBuf::from(parts.join(self.separator.encode_utf8(&mut [0; 4])))
    }
}

fn unread(kind: &str) -> Error {
    Error::unsupported(format!("values of type '{kind}' are not read"))
        .hint("real numbers of 16 to 64 bits and integers of 8 to 64 bits are: convert the array where it was made")
}

/// The value of chunks that are not there.
fn fill(value: Option<&Value>, sample: Sample) -> Result<f64> {
    let value = match value {
        None | Some(Value::Null | Value::Bool(false)) => return Ok(0.0),
        Some(Value::Bool(true)) => return Ok(1.0),
        Some(value) => value,
    };
    let text = match value {
        Value::String(text) => text.as_str(),
        other => {
            return other.as_f64().ok_or_else(|| wrong(format!("the fill value is {other}; a number is expected")));
        }
    };
    let bits = text.strip_prefix("0x").and_then(|hex| u64::from_str_radix(hex, 16).ok());
    let number = match (text, bits, sample) {
        ("NaN", ..) => f64::NAN,
        ("Infinity", ..) => f64::INFINITY,
        ("-Infinity", ..) => f64::NEG_INFINITY,
        (_, Some(bits), _) => {
            let mut out = Vec::new();
            sample.decode(Endian::Little, &bits.to_le_bytes()[..sample.bytes()], &mut out);
            out[0]
        }
        _ => text.parse().map_err(|_| wrong(format!("the fill value is '{text}'; a number is expected")))?,
    };
    Ok(number)
}

/// Metadata of Zarr 2.
fn two(metadata: &Value) -> Result<Array> {
    let kind = text(metadata, "dtype").ok_or_else(|| unread("of several fields"))?;
    // Zarr 2 has NumPy's names of types.
    let (sample, endian) = npy::parse_type(kind).ok_or_else(|| unread(kind))?;
    let shape = numbers(metadata.get("shape"), "shape")?;
    let axes = shape.len();
    let order = match text(metadata, "order") {
        Some("F") => (0..axes).rev().collect(),
        _ => (0..axes).collect(),
    };
    let filters = metadata.get("filters").and_then(Value::as_array);
    if let Some(filter) = filters.and_then(|list| list.first()) {
        let name = text(filter, "id").unwrap_or("unknown");
        return Err(Error::unsupported(format!("the filter '{name}' is not read"))
            .hint("write the array without filters where it was made"));
    }
    let codecs = match metadata.get("compressor") {
        None | Some(Value::Null) => Vec::new(),
        Some(compressor) => vec![Codec::parse(text(compressor, "id").unwrap_or("unknown"))?],
    };
    Ok(Array {
        shape,
        chunk: numbers(metadata.get("chunks"), "chunks")?,
        sample,
        endian,
        fill: fill(metadata.get("fill_value"), sample)?,
        order,
        codecs,
        shards: None,
        prefix: "",
        separator: separator(metadata.get("dimension_separator"), '.')?,
    })
}

/// Content of a list of codecs of Zarr 3.
struct Pipeline {
    order: Option<Vec<usize>>,
    endian: Endian,
    codecs: Vec<Codec>,
    shards: Option<(Vec<u64>, Value)>,
}

fn pipeline(list: Option<&Value>) -> Result<Pipeline> {
    let list = list.and_then(Value::as_array).ok_or_else(|| wrong("'codecs' is no list"))?;
    let mut read = Pipeline { order: None, endian: Endian::Little, codecs: Vec::new(), shards: None };
    for codec in list {
        let name = codec.as_str().or_else(|| text(codec, "name")).unwrap_or("unknown");
        let configuration = codec.get("configuration").cloned().unwrap_or_default();
        match name {
            "bytes" if text(&configuration, "endian") == Some("big") => read.endian = Endian::Big,
            "bytes" => {}
            "transpose" => {
                if read.order.is_some() {
                    return Err(Error::unsupported("chunks that are transposed twice are not read")
                        .hint("write the array with one codec that transposes"));
                }
                let order = numbers(configuration.get("order"), "order")?;
                read.order = Some(order.iter().map(|n| usize::try_from(*n).unwrap_or(usize::MAX)).collect());
            }
            "sharding_indexed" => {
                let chunk = numbers(configuration.get("chunk_shape"), "chunk_shape")?;
                read.shards = Some((chunk, configuration));
            }
            other => read.codecs.insert(0, Codec::parse(other)?),
        }
    }
    Ok(read)
}

/// Metadata of Zarr 3.
fn three(metadata: &Value) -> Result<Array> {
    let kind = text(metadata, "data_type").ok_or_else(|| unread("of an extension"))?;
    let sample = match kind {
        "bool" | "uint8" => Sample::U8,
        "int8" => Sample::I8,
        "uint16" => Sample::U16,
        "int16" => Sample::I16,
        "uint32" => Sample::U32,
        "int32" => Sample::I32,
        "uint64" => Sample::U64,
        "int64" => Sample::I64,
        "float16" => Sample::F16,
        "float32" => Sample::F32,
        "float64" => Sample::F64,
        _ => return Err(unread(kind)),
    };
    let shape = numbers(metadata.get("shape"), "shape")?;
    let grid = metadata.get("chunk_grid").cloned().unwrap_or_default();
    if text(&grid, "name") != Some("regular") {
        return Err(wrong("the grid of chunks is not 'regular'"));
    }
    let outer = numbers(grid.get("configuration").and_then(|c| c.get("chunk_shape")), "chunk_shape")?;
    let keys = metadata.get("chunk_key_encoding").cloned().unwrap_or_default();
    let two = text(&keys, "name") == Some("v2");
    let stated = keys.get("configuration").and_then(|c| c.get("separator"));
    let mut codecs = pipeline(metadata.get("codecs"))?;
    let mut chunk = outer.clone();
    let mut shards = None;
    if let Some((inner, configuration)) = codecs.shards.take() {
        if !codecs.codecs.is_empty() || codecs.order.is_some() {
            return Err(Error::unsupported("shards that are transposed or packed as a whole are not read")
                .hint("write the array without these codecs around the shards"));
        }
        codecs = pipeline(configuration.get("codecs"))?;
        let index = pipeline(configuration.get("index_codecs"))?;
        let checksum = index.codecs == [Codec::Crc32c];
        if codecs.shards.is_some() || index.endian == Endian::Big || !(checksum || index.codecs.is_empty()) {
            return Err(Error::unsupported("shards in shards, or with a packed index, are not read")
                .hint("write the array with the usual shards: an index of little-endian bytes and a crc32c"));
        }
        let at_end = text(&configuration, "index_location") != Some("start");
        shards = Some(Shards { shape: outer, at_end, checksum });
        chunk = inner;
    }
    Ok(Array {
        order: codecs.order.unwrap_or_else(|| (0..shape.len()).collect()),
        shape,
        chunk,
        sample,
        endian: codecs.endian,
        fill: fill(metadata.get("fill_value"), sample)?,
        codecs: codecs.codecs,
        shards,
        prefix: if two { "" } else { "c" },
        separator: separator(stated, if two { '.' } else { '/' })?,
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;
    use serde_json::json;

    fn parse(version: u8, metadata: Value) -> Result<Array> {
        Array::parse(&Document { version, metadata, attributes: Value::Null })
    }

    fn v2() -> Value {
        json!({"zarr_format": 2, "shape": [4, 6], "chunks": [2, 3], "dtype": ">i2", "fill_value": -7, "order": "F",
               "filters": null, "compressor": {"id": "blosc", "cname": "lz4"}, "dimension_separator": "/"})
    }

    fn v3() -> Value {
        json!({"zarr_format": 3, "node_type": "array", "shape": [8, 8], "data_type": "float32", "fill_value": "NaN",
               "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [4, 4]}},
               "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
               "codecs": [{"name": "bytes", "configuration": {"endian": "little"}}, {"name": "zstd"}]})
    }

    #[test]
    fn both_versions_say_the_same_things() {
        let two = parse(2, v2()).unwrap();
        assert_eq!((two.sample, two.endian, two.fill, two.order.clone()), (Sample::I16, Endian::Big, -7.0, vec![1, 0]));
        assert_eq!((two.codecs.clone(), two.chunk_bytes()), (vec![Codec::Blosc], Some(12)));
        assert_eq!(two.file(&[1, 2]), PathBuf::from("1/2"));
        let three = parse(3, v3()).unwrap();
        assert!(three.fill.is_nan() && three.codecs == [Codec::Zstd] && three.file(&[1, 0]).to_str() == Some("c/1/0"));
        let mut sharded = v3();
        sharded["codecs"] = json!([{"name": "sharding_indexed", "configuration": {"chunk_shape": [2, 2],
            "codecs": [{"name": "bytes"}, {"name": "gzip"}],
            "index_codecs": [{"name": "bytes"}, {"name": "crc32c"}]}}]);
        let sharded = parse(3, sharded).unwrap();
        assert_eq!((sharded.chunk.clone(), sharded.file(&[3, 1])), (vec![2, 2], PathBuf::from("c/1/0")));
        assert_eq!(sharded.shards, Some(Shards { shape: vec![4, 4], at_end: true, checksum: true }));
    }

    #[test]
    fn what_is_not_read_is_named() {
        let turned = json!({"name": "transpose", "configuration": {"order": [1, 0]}});
        let cases = [
            (2, "dtype", json!("<U4"), "'<U4'"),
            (2, "chunks", json!([0, 3]), "none of a chunk 0"),
            (2, "chunks", json!([2]), "as many lengths"),
            (2, "compressor", json!({"id": "lzma"}), "'lzma'"),
            (2, "filters", json!([{"id": "delta"}]), "'delta'"),
            (2, "shape", json!([-1, 2]), "'shape'"),
            (2, "fill_value", json!("many"), "'many'"),
            (2, "dimension_separator", json!("/../../"), "separator"),
            (2, "dimension_separator", json!(7), "separator"),
            (3, "chunk_key_encoding", json!({"name": "default", "configuration": {"separator": "/../"}}), "/../"),
            (3, "data_type", json!("complex64"), "'complex64'"),
            (3, "chunk_grid", json!({"name": "odd"}), "'regular'"),
            (3, "codecs", json!([{"name": "transpose", "configuration": {"order": [0, 0]}}]), "no order"),
            (3, "codecs", json!([{"name": "numcodecs.zfpy"}]), "'numcodecs.zfpy'"),
            (3, "codecs", json!([turned, turned]), "transposed twice"),
        ];
        for (version, key, value, words) in cases {
            let mut metadata = if version == 2 { v2() } else { v3() };
            metadata[key] = value;
            let error = parse(version, metadata).unwrap_err();
            assert!(error.to_string().contains(words) && error.remedy().is_some(), "{error} lacks {words}");
        }
        assert_eq!(fill(Some(&json!("0x3fc00000")), Sample::F32).unwrap(), 1.5);
    }
}
