//! Pictures out: one part, scan lines, ZIP.

use super::fault;
use crate::error::{Error, Result};
use crate::formats::atomic;
use crate::render::film::Film;
use exr::image::write::WritableImage;
use exr::image::{Encoding, Image, Layer, SpecificChannels};
use exr::math::Vec2;
use exr::meta::attribute::{AttributeValue, Compression, LineOrder, Text};
use exr::meta::header::{LayerAttributes, standard_names};
use half::f16;
use std::collections::BTreeMap;
use std::path::Path;

/// Provenance: attribute names and their text.
pub type Attributes = BTreeMap<String, String>;

/// Writes channels R, G, B, A as scan lines with ZIP compression, 32-bit float or, if `half`, 16-bit
/// float. The file appears whole or not at all, and the same input gives the same bytes.
///
/// `attributes` become text attributes of the header, readable with `exrheader` or `oiiotool --info`;
/// `software`, `comments` and `owner` are the standard ones.
///
/// # Errors
/// If the film is empty or its size contradicts its pixels, an attribute's name is empty, longer
/// than 255 bytes or reserved by OpenEXR, a finite value does not fit into half floats, or the
/// operating system reports an error.
pub fn write_picture(path: &Path, film: &Film, attributes: &Attributes, half: bool) -> Result<()> {
    let bytes = encoded(path, film, attributes, half).map_err(|e| e.at(path))?;
    atomic::write_bytes(path, &bytes)
}

fn encoded(path: &Path, film: &Film, attributes: &Attributes, half: bool) -> Result<Vec<u8>> {
    let (width, height) = (film.width, film.height);
    if width == 0 || height == 0 || film.rgba.len() != width * height {
        return Err(Error::invalid(format!(
            "a film of {width}x{height} with {} pixels cannot be written",
            film.rgba.len()
        ))
        .hint("give the film at least one pixel, and one RGBA value for each"));
    }
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: exr::image::Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let own = layer_attributes(attributes)?;
    let at = |p: Vec2<usize>| film.rgba[p.1 * width + p.0];
    let mut bytes = std::io::Cursor::new(Vec::new());
    if half {
        let lost = film.rgba.iter().flatten().filter(|v| v.is_finite() && !f16::from_f32(**v).is_finite()).count();
        if lost > 0 {
            return Err(Error::invalid(format!("{lost} samples are beyond 65504, the largest half float"))
                .hint("write 32-bit floats"));
        }
        let channels = SpecificChannels::rgba(|p: Vec2<usize>| {
            let [r, g, b, a] = at(p).map(f16::from_f32);
            (r, g, b, a)
        });
        let image = Image::from_layer(Layer::new((width, height), own, encoding, channels));
        fault::translated(path, || image.write().to_buffered(&mut bytes))?;
    } else {
        let channels = SpecificChannels::rgba(|p: Vec2<usize>| {
            let [r, g, b, a] = at(p);
            (r, g, b, a)
        });
        let image = Image::from_layer(Layer::new((width, height), own, encoding, channels));
        fault::translated(path, || image.write().to_buffered(&mut bytes))?;
    }
    let mut bytes = bytes.into_inner();
    sort_attributes(&mut bytes);
    Ok(bytes)
}

fn layer_attributes(attributes: &Attributes) -> Result<LayerAttributes> {
    let mut own = LayerAttributes::default();
    for (name, value) in attributes {
        let text = Text::from_slice_unchecked(value.as_bytes());
        match name.as_str() {
            "software" => own.software_name = Some(text),
            "comments" => own.comments = Some(text),
            "owner" => own.owner = Some(text),
            _ => {
                let fits = (1..256).contains(&name.len()) && !name.contains('\0');
                if !fits || standard_names::ALL.contains(&name.as_bytes()) {
                    return Err(Error::invalid(format!("'{name}' cannot be the name of an attribute"))
                        .hint("give a name of 1 to 255 bytes that OpenEXR does not reserve"));
                }
                own.other.insert(Text::from_slice_unchecked(name.as_bytes()), AttributeValue::Text(text));
            }
        }
    }
    Ok(own)
}

/// The crate writes attributes in the order of a randomly seeded hash map. Sorting them in place
/// (their total length stays, so no offset changes) makes files reproducible.
fn sort_attributes(file: &mut [u8]) {
    const START: usize = 8; // magic number and version
    let mut entries: Vec<Vec<u8>> = Vec::new();
    let mut at = START;
    while let Some(length) = entry_length(&file[at..]) {
        entries.push(file[at..at + length].to_vec());
        at += length;
    }
    entries.sort();
    file[START..at].copy_from_slice(&entries.concat());
}

/// Bytes of the attribute that `bytes` begin with: name, type, size, value; `None` at the list's end.
fn entry_length(bytes: &[u8]) -> Option<usize> {
    let name = bytes.iter().position(|&b| b == 0).filter(|&n| n > 0)? + 1;
    let kind = bytes[name..].iter().position(|&b| b == 0)? + 1;
    let size = bytes.get(name + kind..name + kind + 4)?;
    let length = name + kind + 4 + u32::from_le_bytes(size.try_into().ok()?) as usize;
    (length <= bytes.len()).then_some(length)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_film_gives_the_same_bytes() {
        let film = Film { width: 3, height: 2, rgba: vec![[0.25, 1.5, -2.0, 1.0]; 6] };
        let attributes: Attributes = (0..9).map(|i| (format!("cumulo:{i}"), format!("väl{i}"))).collect();
        let path = Path::new("memory.exr");
        let first = encoded(path, &film, &attributes, false).unwrap();
        for _ in 0..4 {
            assert_eq!(first, encoded(path, &film, &attributes, false).unwrap());
        }
    }
}
