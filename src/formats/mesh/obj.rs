//! Wavefront OBJ: the statements `v` and `f`, which carry the surface. Normals, textures, materials and groups are
//! passed over.
//!
//! No library reads these here: those there are end the process at statements that they do not know (`obj-rs`), or say
//! no line, read single precision and take a hundred bytes a face (`tobj`).

use super::builder::Builder;
use super::{Mesh, fits_single};
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::{atomic, input};
use glam::DVec3;
use std::io::{BufRead, BufReader, BufWriter, Read, Write};
use std::path::Path;

/// Largest number of bytes of a line, with those that go on with it.
const LINE: usize = 1 << 20;
const REMEDY: &str = "correct that line, or export the mesh again where it was made";

/// Reads a mesh.
///
/// # Errors
/// If the file cannot be read, contradicts the format, or is too large.
pub(crate) fn read(path: &Path, limits: Limits) -> Result<Mesh> {
    let mut lines = Lines { source: BufReader::new(input::open(path)?), text: Vec::new(), at: 0 };
    let mut builder = Builder::new(limits);
    let mut corners = Vec::new();
    loop {
        let at = lines.at + 1;
        if !lines.next().map_err(|e| e.part(format!("line {at}")))? {
            return builder.finish();
        }
        // Names may be of any encoding.
        let text = String::from_utf8_lossy(&lines.text);
        // Windows' editors mark the beginning of a text.
        let text = text.trim_start_matches('\u{feff}');
        statement(text, &mut builder, &mut corners).map_err(|e| e.part(format!("line {at}")))?;
    }
}

/// The lines of a file; a backslash at the end of one goes on with the next.
struct Lines<R> {
    source: R,
    text: Vec<u8>,
    /// Number of lines that have been read.
    at: usize,
}

impl<R: BufRead> Lines<R> {
    /// Reads the next line, and returns false behind the last one.
    fn next(&mut self) -> Result<bool> {
        self.text.clear();
        loop {
            let room = (LINE + 1 - self.text.len()) as u64;
            let length = self.source.by_ref().take(room).read_until(b'\n', &mut self.text).map_err(Error::system)?;
            self.at += usize::from(length > 0);
            if self.text.len() > LINE {
                return Err(Error::invalid(format!("the line has more than {LINE} bytes, too many for a polygon"))
                    .hint("check that this is the file that was meant"));
            }
            let end = self.text.trim_ascii_end().len();
            if length == 0 || end == 0 || self.text[end - 1] != b'\\' {
                return Ok(length > 0 || end > 0);
            }
            self.text.truncate(end - 1);
            self.text.push(b' ');
        }
    }
}

fn statement(text: &str, builder: &mut Builder, corners: &mut Vec<u32>) -> Result<()> {
    let text = text.split('#').next().unwrap_or_default();
    let mut words = text.split_ascii_whitespace();
    match words.next() {
        Some("v") => {
            // Behind the position, a weight or a color may stand.
            let mut next = || words.next().and_then(|word| word.parse::<f64>().ok());
            match (next(), next(), next()) {
                (Some(x), Some(y), Some(z)) => builder.vertex(DVec3::new(x, y, z)),
                _ => {
                    Err(Error::invalid(format!("'{}' is no vertex; v x y z is expected", excerpt_of(text)))
                        .hint(REMEDY))
                }
            }
        }
        Some("f") => {
            corners.clear();
            for word in words {
                corners.push(corner(word, builder.vertices())?);
            }
            builder.polygon(corners)
        }
        _ => Ok(()),
    }
}

fn excerpt_of(text: &str) -> String {
    text.trim().chars().take(60).collect()
}

/// Number of a corner's vertex, from 0: `v`, `v/vt`, `v/vt/vn` or `v//vn`. Numbers count from 1, or backwards from the
/// latest vertex, -1.
fn corner(word: &str, count: usize) -> Result<u32> {
    let number: Option<i64> = word.split('/').next().and_then(|number| number.parse().ok());
    let index = number.and_then(|n| if n < 0 { n.checked_add(count as i64) } else { n.checked_sub(1) });
    // A vertex may stand behind the face that names it, but none before the first.
    match index.filter(|index| *index >= 0).map(u32::try_from) {
        Some(Ok(index)) => Ok(index),
        _ => Err(Error::invalid(format!(
            "the face names vertex '{}'; numbers from 1 on are expected, or from -1 back to -{count}",
            excerpt_of(word)
        ))
        .hint(REMEDY)),
    }
}

/// Writes a mesh.
///
/// # Errors
/// If the file cannot be written.
pub(crate) fn write(path: &Path, mesh: &Mesh) -> Result<()> {
    let single = fits_single(mesh);
    let put = |out: &mut dyn Write| -> std::io::Result<()> {
        writeln!(out, "# Cumulo")?;
        for v in &mesh.vertices {
            if single {
                let v = v.as_vec3();
                writeln!(out, "v {} {} {}", v.x, v.y, v.z)?;
            } else {
                writeln!(out, "v {} {} {}", v.x, v.y, v.z)?;
            }
        }
        for polygon in mesh.polygons() {
            out.write_all(b"f")?;
            polygon.iter().try_for_each(|corner| write!(out, " {}", u64::from(*corner) + 1))?;
            out.write_all(b"\n")?;
        }
        out.flush()
    };
    // About what a vertex and a corner take as text.
    let needed = (24 * mesh.vertices.len() + 8 * mesh.corners.len()) as u64;
    atomic::write(path, |draft| {
        let written = put(&mut BufWriter::new(draft.file()));
        written.map_err(|e| draft.unwritten(e, needed))
    })
}
