//! ParaView presets in XML, as versions before 5 wrote them and color map collections still do.

use super::color::Space;
use super::document::short;
use super::paraview::{self, Preset};
use super::{Loaded, Options, Source, entry_index, unknown};
use crate::error::{Error, Result};
use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};
use std::borrow::Cow;

const EXPORT: &str = "correct the XML there, or export the preset again from ParaView";

/// A `ColorMap` element while it is read.
struct Map {
    name: String,
    space: Option<String>,
    categories: bool,
    /// Density, red, green and blue of each point, and its opacity where that is stated.
    points: Vec<([f64; 4], Option<f64>)>,
}

pub(super) fn load(text: &str, options: &Options) -> Result<Loaded> {
    let (names, map) = read(text, options.preset.as_deref())?;
    if names.is_empty() {
        return Err(unknown("an XML document without a 'ColorMap'"));
    }
    let index = entry_index(&names, options.preset.as_deref())?;
    let map = map.ok_or_else(|| Error::invalid("the preset was not found again").hint(EXPORT))?;
    let preset = preset(map).map_err(|e| e.part(format!("preset '{}'", names[index])))?;
    paraview::loaded(preset, names, index, Source::ParaviewXml, options)
}

/// Names of all maps, and the first map named `wanted`, or the first of all if no name is wanted.
fn read(text: &str, wanted: Option<&str>) -> Result<(Vec<String>, Option<Map>)> {
    let mut reader = Reader::from_str(text);
    let (mut names, mut found) = (Vec::new(), None::<Map>);
    // Depth of the map that is open, and whether it is the one to keep.
    let mut open = None::<(usize, bool)>;
    let mut depth = 0_usize;
    loop {
        let place = |e: Error, reader: &Reader<&[u8]>| e.part(format!("byte {}", reader.buffer_position()));
        let event = reader.read_event().map_err(|e| place(no_xml(e), &reader))?;
        let (element, empty) = match &event {
            Event::Start(element) => (element, false),
            Event::Empty(element) => (element, true),
            Event::End(_) => {
                if open.is_some_and(|(at, _)| at == depth) {
                    open = None;
                }
                depth = depth.saturating_sub(1);
                continue;
            }
            Event::Eof if depth > 0 => {
                return Err(Error::invalid("no valid XML: the document ends within an element")
                    .hint("the file is cut off; copy it again"));
            }
            Event::Eof => return Ok((names, found)),
            _ => continue,
        };
        depth += 1;
        let done = match (element.name().as_ref(), open) {
            ("ColorMap", None) => begin(element, names.len()).map(|map| {
                let keep = found.is_none() && wanted.is_none_or(|w| w == map.name);
                names.push(map.name.clone());
                if keep {
                    found = Some(map);
                }
                open = Some((depth, keep));
            }),
            ("Point", Some((_, true))) => found.as_mut().map_or(Ok(()), |map| point(element, map)),
            _ => Ok(()),
        };
        done.map_err(|e| place(e, &reader))?;
        if empty {
            if open.is_some_and(|(at, _)| at == depth) {
                open = None;
            }
            depth -= 1;
        }
    }
}

fn begin(element: &BytesStart, earlier: usize) -> Result<Map> {
    let mut map = Map { name: format!("preset {}", earlier + 1), space: None, categories: false, points: Vec::new() };
    each(element, |key, value| {
        match key {
            "name" => map.name = value.into_owned(),
            "space" => map.space = Some(value.into_owned()),
            "indexedLookup" => map.categories = matches!(value.as_ref(), "1" | "true"),
            _ => {}
        }
        Ok(())
    })?;
    Ok(map)
}

fn point(element: &BytesStart, map: &mut Map) -> Result<()> {
    const KEYS: [&str; 5] = ["x", "r", "g", "b", "o"];
    let mut numbers = [None; 5];
    each(element, |key, value| {
        if let Some(i) = KEYS.iter().position(|k| *k == key) {
            let number = value.trim().parse().map_err(|_| {
                Error::invalid(format!("attribute '{key}' is \"{}\"; a number is expected", short(&value)))
                    .hint("a point is <Point x= o= r= g= b=/>, each a number")
            })?;
            numbers[i] = Some(number);
        }
        Ok(())
    })?;
    // Categories have no densities; they are refused as a whole.
    if map.categories {
        return Ok(());
    }
    let mut four = [0.0; 4];
    for (i, number) in four.iter_mut().enumerate() {
        *number = numbers[i].ok_or_else(|| {
            Error::invalid(format!("point {} has no attribute '{}'", map.points.len(), KEYS[i]))
                .hint("a point is <Point x= o= r= g= b=/>")
        })?;
    }
    map.points.push((four, numbers[4]));
    Ok(())
}

fn no_xml(error: impl std::fmt::Display) -> Error {
    Error::invalid(format!("no valid XML: {error}")).hint(EXPORT)
}

/// Hands each attribute of an element to `take`.
fn each<'a>(element: &'a BytesStart, mut take: impl FnMut(&str, Cow<'a, str>) -> Result<()>) -> Result<()> {
    for attribute in element.attributes() {
        let attribute = attribute.map_err(no_xml)?;
        let value = attribute.normalized_value(XmlVersion::Implicit1_0).map_err(no_xml)?;
        take(attribute.key.as_ref(), value)?;
    }
    Ok(())
}

fn preset(map: Map) -> Result<Preset> {
    if map.categories {
        return Err(Error::unsupported("the preset is for categories ('indexedLookup'), not for a range of densities")
            .hint("choose another preset: its name goes to ⟨preset⟩, or ⟨tf_preset⟩"));
    }
    let space = Space::named(map.space.as_deref().unwrap_or("RGB"), false)?;
    // ParaView writes 1 for each point whatever the opacities are, which states nothing.
    let stated = map.points.iter().any(|(_, o)| o.is_some_and(|o| o != 1.0));
    let opacities = stated.then(|| map.points.iter().map(|(p, o)| [p[0], o.unwrap_or(1.0), 0.5, 0.0]).collect());
    Ok(Preset { space, colors: map.points.iter().map(|(p, _)| *p).collect(), opacities, diverging: false })
}
