//! PLY, Stanford's polygon file format: text, and binary in both orders of bytes, by `ply-rs-bw`.
//!
//! The library reads one element at a time, of which no more than [`ELEMENT`] bytes are handed to it: what it holds at
//! once is bounded, whatever counts a file states. Elements other than vertices and faces are passed over.

use super::builder::Builder;
use super::{Mesh, fits_single};
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::{atomic, input};
use glam::DVec3;
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType};
use std::fs::File;
use std::io::{BufRead, BufReader, BufWriter, ErrorKind, Read, Take, Write};
use std::path::Path;

/// Largest number of bytes of a header, and of one vertex or face.
const ELEMENT: u64 = 1 << 20;
const REMEDY: &str = "the file is damaged or cut off; export the mesh again where it was made";
/// Names under which programs list the corners of a face.
const CORNERS: [&str; 2] = ["vertex_indices", "vertex_index"];

/// A vertex or a face: the properties that matter.
#[derive(Default)]
struct Element {
    position: [Option<f64>; 3],
    corners: Option<Vec<u32>>,
    /// True if the corners were no whole numbers from 0 on.
    unusable: bool,
}

impl PropertyAccess for Element {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if let Some(axis) = ["x", "y", "z"].iter().position(|axis| *axis == name) {
            self.position[axis] = number(&property);
        } else if CORNERS.contains(&name) {
            self.corners = property.to_u32_list();
            self.unusable = self.corners.is_none();
        }
        PropertyAccessResult::Set
    }
}

fn number(property: &Property) -> Option<f64> {
    Some(match property {
        Property::Char(v) => f64::from(*v),
        Property::UChar(v) => f64::from(*v),
        Property::Short(v) => f64::from(*v),
        Property::UShort(v) => f64::from(*v),
        Property::Int(v) => f64::from(*v),
        Property::UInt(v) => f64::from(*v),
        Property::Float(v) => f64::from(*v),
        Property::Double(v) => *v,
        _ => return None,
    })
}

/// A file whose elements are read one by one.
struct Elements {
    source: Take<BufReader<File>>,
    parser: Parser<Element>,
    encoding: Encoding,
    line: Vec<u8>,
}

impl Elements {
    /// Reads the next element.
    fn next(&mut self, kind: &ElementDef) -> Result<Element, String> {
        let source = &mut self.source;
        source.set_limit(ELEMENT);
        let read = match self.encoding {
            Encoding::Ascii => return self.next_line(kind),
            Encoding::BinaryBigEndian => self.parser.read_big_endian_element(source, kind),
            Encoding::BinaryLittleEndian => self.parser.read_little_endian_element(source, kind),
        };
        read.map_err(|e| match e.kind() {
            _ if source.limit() == 0 => too_long(),
            ErrorKind::UnexpectedEof => "the file ends in it".into(),
            _ => first_line(&e),
        })
    }

    /// Reads the next element of a text.
    fn next_line(&mut self, kind: &ElementDef) -> Result<Element, String> {
        self.line.clear();
        let length = self.source.read_until(b'\n', &mut self.line).map_err(|e| e.to_string())?;
        if length == 0 {
            return Err("the file ends before it".into());
        }
        if self.source.limit() == 0 && !self.line.ends_with(b"\n") {
            return Err(too_long());
        }
        let line = String::from_utf8_lossy(&self.line);
        let line = line.trim();
        let words = || line.chars().take(60).collect::<String>();
        self.parser.read_ascii_element(line, kind).map_err(|_| format!("'{}' does not fit the header", words()))
    }
}

fn too_long() -> String {
    format!("it has more than {ELEMENT} bytes, too many for a polygon")
}

fn first_line(error: &ParseError) -> String {
    error.to_string().lines().next().unwrap_or_default().to_owned()
}

/// Reads a header, whose comments may be of any encoding.
fn header(source: &mut impl BufRead, parser: &Parser<Element>) -> Result<Header> {
    let (mut bytes, mut start) = (Vec::new(), 0);
    while source.read_until(b'\n', &mut bytes).map_err(Error::system)? > 0
        && bytes[start..].trim_ascii() != b"end_header"
    {
        start = bytes.len();
    }
    let text = String::from_utf8_lossy(&bytes);
    parser
        .read_header(&mut Reader::new(text.as_bytes()))
        .map_err(|e| Error::invalid(format!("the header of the PLY is not valid: {}", first_line(&e))).hint(REMEDY))
}

/// Reads a mesh.
///
/// # Errors
/// If the file cannot be read, contradicts the format, or is too large.
pub(crate) fn read(path: &Path, limits: Limits) -> Result<Mesh> {
    let file = input::open(path)?;
    let parser = Parser::new();
    let mut source = BufReader::new(file).take(ELEMENT);
    let header = header(&mut source, &parser)?;
    let mut elements = Elements { source, parser, encoding: header.encoding, line: Vec::new() };
    let mut builder = Builder::new(limits);
    let mut faces = false;
    for (name, kind) in &header.elements {
        match name.as_str() {
            "vertex" => vertices(&mut elements, kind, &mut builder)?,
            "face" => {
                polygons(&mut elements, kind, &mut builder)?;
                faces = true;
            }
            // What stands behind the faces matters to nobody.
            _ if faces && builder.vertices() > 0 => break,
            _ => skip(&mut elements, kind)?,
        }
    }
    builder.finish()
}

fn place(kind: &ElementDef, number: usize, what: &str) -> Error {
    Error::invalid(format!("{} {number} of {}: {what}", kind.name, kind.count)).hint(REMEDY)
}

fn vertices(elements: &mut Elements, kind: &ElementDef, builder: &mut Builder) -> Result<()> {
    if let Some(axis) = ["x", "y", "z"].iter().find(|axis| !has(kind, axis, false)) {
        return Err(Error::invalid(format!("the vertices of the PLY have no number `{axis}`")).hint(REMEDY));
    }
    for number in 0..kind.count {
        let element = elements.next(kind).map_err(|what| place(kind, number, &what))?;
        let [x, y, z] = element.position.map(|v| v.unwrap_or(f64::NAN));
        builder.vertex(DVec3::new(x, y, z))?;
    }
    Ok(())
}

fn polygons(elements: &mut Elements, kind: &ElementDef, builder: &mut Builder) -> Result<()> {
    if kind.count > 0 && !CORNERS.iter().any(|name| has(kind, name, true)) {
        return Err(Error::invalid("the faces of the PLY have no list `vertex_indices`")
            .hint("export the mesh with faces, not as strips of triangles"));
    }
    for number in 0..kind.count {
        let element = elements.next(kind).map_err(|what| place(kind, number, &what))?;
        match element.corners {
            Some(corners) if !element.unusable => builder.polygon(&corners)?,
            _ => return Err(place(kind, number, "its corners are no whole numbers from 0 on")),
        }
    }
    Ok(())
}

/// Passes over elements of no meaning here.
fn skip(elements: &mut Elements, kind: &ElementDef) -> Result<()> {
    // Binary elements without properties have no bytes, whatever their count.
    let count = if kind.properties.is_empty() && elements.encoding != Encoding::Ascii { 0 } else { kind.count };
    (0..count).try_for_each(|number| elements.next(kind).map(drop).map_err(|what| place(kind, number, &what)))
}

fn has(kind: &ElementDef, name: &str, list: bool) -> bool {
    kind.properties.get(name).is_some_and(|p| matches!(p.data_type, PropertyType::List(..)) == list)
}

/// Writes a mesh in binary form, the least significant byte first: coordinates as `float`, or as `double` where single
/// precision would move vertices.
///
/// # Errors
/// If the file cannot be written.
pub(crate) fn write(path: &Path, mesh: &Mesh) -> Result<()> {
    let single = fits_single(mesh);
    let number = if single { "float" } else { "double" };
    // All programs know indices as signed numbers, and lengths of up to 255.
    let longest = mesh.polygons().map(<[u32]>::len).max().unwrap_or(0);
    let length = if longest < 256 { "uchar" } else { "uint" };
    let header = format!(
        "ply\nformat binary_little_endian 1.0\ncomment Cumulo\nelement vertex {}\nproperty {number} x\nproperty \
         {number} y\nproperty {number} z\nelement face {}\nproperty list {length} int vertex_indices\nend_header\n",
        mesh.vertices.len(),
        mesh.ends.len()
    );
    let put = |out: &mut dyn Write| -> std::io::Result<()> {
        out.write_all(header.as_bytes())?;
        for value in mesh.vertices.iter().flat_map(|v| v.to_array()) {
            if single { out.write_all(&(value as f32).to_le_bytes())? } else { out.write_all(&value.to_le_bytes())? }
        }
        for polygon in mesh.polygons() {
            let count = (polygon.len() as u32).to_le_bytes();
            out.write_all(if longest < 256 { &count[..1] } else { &count })?;
            polygon.iter().try_for_each(|corner| out.write_all(&corner.to_le_bytes()))?;
        }
        out.flush()
    };
    let vertices = mesh.vertices.len() * if single { 12 } else { 24 };
    let faces = 4 * mesh.corners.len() + mesh.ends.len() * if longest < 256 { 1 } else { 4 };
    atomic::write(path, |draft| {
        let written = put(&mut BufWriter::new(draft.file()));
        written.map_err(|e| draft.unwritten(e, (header.len() + vertices + faces) as u64))
    })
}
