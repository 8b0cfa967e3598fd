//! One layer of a file as an RGBA picture.

use super::decode::{self, Row, Source};
use super::header::{self, Header, LayerInfo};
use super::read::read_within;
use super::write::Placement;
use crate::error::{Code, Error, Result};
use crate::formats::limits::Limits;
use crate::formats::reading::Reading;
use crate::scene::film::{Film, Plane};
use std::path::Path;

/// A picture with the layer that it was read from.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Pixels over the display window.
    pub film: Film,
    /// Name of the layer that was read; empty for the unnamed one.
    pub layer: String,
    /// Number of NaN and infinite samples inside the display window. They are kept in `film`.
    pub non_finite: usize,
    /// Names, within the layer, of the channels that the film holds.
    pub channels: Vec<String>,
}

impl Picture {
    /// True if the film holds red, green and blue, which primaries make colors.
    pub(crate) fn is_color(&self) -> bool {
        self.channels.iter().any(|name| ["r", "red"].contains(&name.to_ascii_lowercase().as_str()))
    }
}

/// Reads one layer as a film; see [`picture`], which also reports the layer.
///
/// # Errors
/// The conditions are those of [`picture`].
pub fn read_picture(path: &Path, layer: Option<&str>) -> Result<Film> {
    read_picture_within(path, layer, Limits::default())
}

/// Reads one layer as a film within the memory that `limits` allow; see [`picture_within`].
///
/// # Errors
/// The conditions are those of [`picture_within`].
pub(crate) fn read_picture_within(path: &Path, layer: Option<&str>, limits: Limits) -> Result<Film> {
    Ok(picture_within(path, layer, limits)?.film)
}

/// Reads one layer as RGBA over the display window (transparent black outside the data window).
///
/// `layer` is compared with the layers' names exactly, then without regard to case, then with the last word of each
/// name (`Combined` for `ViewLayer.Combined`); the latter two must match one layer only. Without it, the layer is the
/// first that exists of: the unnamed layer if it has colors, `rgba`, `rgb`, `Composite.Combined`, `….Combined`,
/// `beauty`, `C`, the only layer with colors, the unnamed layer if it is grey, the only layer that is grey.
///
/// Colors are the channels R, G, B or red, green, blue, or X, Y, Z of a vector, in any case. A layer with one channel
/// beside alpha (Y, Z, anything) is grey: R = G = B. Without A or alpha, alpha is 1 inside the data window.
///
/// # Errors
/// If [`header`](super::header()) fails, if there is no such layer (the error lists all layers), or if it has no
/// colors, its chunks are missing, damaged or subsampled, or it takes more than half of the machine's memory.
pub fn picture(path: &Path, layer: Option<&str>) -> Result<Picture> {
    picture_within(path, layer, Limits::default())
}

/// Reads one layer as [`picture`] does. The film (16 bytes per pixel of the display window) and the chunks being
/// decoded must fit into `limits`; nothing is allocated before that is known.
///
/// # Errors
/// The conditions are those of [`picture`], with these limits.
pub fn picture_within(path: &Path, layer: Option<&str>, limits: Limits) -> Result<Picture> {
    let _reading = Reading::begin(path);
    let (reader, header) = header::open(path)?;
    let layers = header.layers();
    let chosen = match layer {
        Some(name) => named(&layers, name),
        None => default(&header, &layers),
    }
    .map_err(|e| e.at(path))?;
    let Some(channels) = colors(&header, chosen) else {
        return Err(Error::invalid(format!(
            "layer '{}' has the channels {}, which make no picture",
            chosen.name,
            components(&header, chosen).join(", ")
        ))
        .hint("a picture needs R, G, B (or X, Y, Z) or a single channel")
        .at(path));
    };
    let sources: Vec<Source> = channels.iter().map(|&channel| Source { part: chosen.part, channel }).collect();
    let display = header.display_window;
    let held = display.pixels().saturating_mul(size_of::<[f32; 4]>() as u64);
    let (mut film, mut non_finite) = (None, 0);
    // Components of a pixel that each source is written to.
    let targets: &[&[usize]] = match sources.len() {
        1 => &[&[0, 1, 2]],
        2 => &[&[0, 1, 2], &[3]],
        _ => &[&[0], &[1], &[2], &[3]],
    };
    let opaque = matches!(sources.len(), 1 | 3);
    let blank = || blank(&header, chosen.part, opaque);
    decode::rows(path, reader, &header, &sources, (held, limits), |Row { source, x, y, samples }| {
        let film: &mut Film = film.get_or_insert_with(blank);
        let start = y * film.width + x;
        for (pixel, sample) in film.rgba[start..start + samples.len()].iter_mut().zip(samples) {
            targets[source].iter().for_each(|&component| pixel[component] = *sample);
        }
        non_finite += samples.iter().filter(|v| !v.is_finite()).count();
    })?;
    let name = |&channel: &usize| header.parts[chosen.part].channels[channel].component.clone();
    let channels = channels.iter().map(name).collect();
    Ok(Picture { film: film.unwrap_or_else(blank), layer: chosen.name.clone(), non_finite, channels })
}

/// Reads one layer as RGBA, as [`picture_within`] does, and all channels of the file but those of that picture as
/// separate planes under their full names (`variance.R`). The samples of all channels must fit into `limits`.
///
/// # Errors
/// The conditions are those of [`picture_within`] and [`read_within`].
pub fn read_film_within(path: &Path, layer: Option<&str>, limits: Limits) -> Result<Film> {
    let Picture { mut film, layer: chosen, channels, .. } = picture_within(path, layer, limits)?;
    let held = size_of_val(&film.rgba[..]) as u64;
    let limits = Limits { max_memory: limits.max_memory.saturating_sub(held) };
    for layer in read_within(path, limits)?.layers {
        let prefix = if layer.name.is_empty() { String::new() } else { format!("{}.", layer.name) };
        let others = layer.channels.into_iter().filter(|c| layer.name != chosen || !channels.contains(&c.name));
        film.planes.extend(others.map(|c| Plane { name: format!("{prefix}{}", c.name), samples: c.samples }));
    }
    Ok(film)
}

/// Reads the part of a picture that its data window holds, as [`read_film_within`] does the whole.
///
/// # Errors
/// The conditions are those of [`read_film_within`].
pub(crate) fn read_part_within(path: &Path, limits: Limits) -> Result<(Film, Placement)> {
    let header = header::header(path)?;
    let (display, data) = (header.display_window, header.data_window);
    let film = read_film_within(path, None, limits)?;
    let side = |axis: usize| {
        let within = |at: i64| (at - i64::from(display.min[axis])).clamp(0, display.size[axis] as i64) as usize;
        within(data.min[axis].into())..within(data.end(axis))
    };
    let (columns, rows) = (side(0), side(1));
    let placement = Placement { display: display.size, origin: [columns.start, rows.start] };
    Ok((film.part([columns, rows]), placement))
}

/// Numbers, within the part, of the channels of a layer's picture: grey, grey and alpha, RGB, or RGBA. `None` if the
/// channels make no picture.
pub(super) fn colors(header: &Header, layer: &LayerInfo) -> Option<Vec<usize>> {
    let find = |names: [&str; 2]| {
        layer.channels.iter().copied().find(|&c| {
            let component = &header.parts[layer.part].channels[c].component;
            names.iter().any(|n| component.eq_ignore_ascii_case(n))
        })
    };
    let alpha = find(["A", "alpha"]);
    let rgb = [["R", "red"], ["G", "green"], ["B", "blue"]].map(find);
    let xyz = [["X", "X"], ["Y", "Y"], ["Z", "Z"]].map(find);
    let mut chosen = match (rgb, xyz) {
        ([Some(r), Some(g), Some(b)], _) => vec![r, g, b],
        (_, [Some(x), Some(y), Some(z)]) => vec![x, y, z],
        _ => {
            let mut rest = layer.channels.iter().copied().filter(|&c| Some(c) != alpha);
            let only = rest.next().or(alpha)?;
            if rest.next().is_some() {
                return None;
            }
            vec![only]
        }
    };
    chosen.extend(alpha.filter(|a| !chosen.contains(a)));
    Some(chosen)
}

fn components(header: &Header, layer: &LayerInfo) -> Vec<String> {
    layer.channels.iter().map(|&c| header.parts[layer.part].channels[c].component.clone()).collect()
}

fn listed(layers: &[LayerInfo]) -> String {
    layers.iter().map(|l| format!("'{}'", l.name)).collect::<Vec<_>>().join(", ")
}

fn last_word(name: &str) -> &str {
    name.rsplit('.').next().unwrap_or(name)
}

pub(super) fn named<'a>(layers: &'a [LayerInfo], name: &str) -> Result<&'a LayerInfo> {
    let only = |matches: &dyn Fn(&LayerInfo) -> bool| {
        let mut found = layers.iter().filter(|l| matches(l));
        found.next().filter(|_| found.next().is_none())
    };
    layers
        .iter()
        .find(|l| l.name == name)
        .or_else(|| only(&|l| l.name.eq_ignore_ascii_case(name)))
        .or_else(|| only(&|l| last_word(&l.name).eq_ignore_ascii_case(name)))
        .ok_or_else(|| {
            Error::invalid(format!("no layer '{name}'; the file has {}", listed(layers)))
                .coded(Code::NoSuchLayer)
                .hint("give one of these names to ⟨layer⟩")
        })
}

pub(super) fn default<'a>(header: &Header, layers: &'a [LayerInfo]) -> Result<&'a LayerInfo> {
    let colored = |l: &&LayerInfo| colors(header, l).is_some_and(|c| c.len() >= 3);
    let grey = |l: &&LayerInfo| colors(header, l).is_some_and(|c| c.len() < 3);
    let called = |name: &str| layers.iter().filter(colored).find(|l| l.name.eq_ignore_ascii_case(name));
    let ending = |name: &str| layers.iter().filter(colored).find(|l| last_word(&l.name).eq_ignore_ascii_case(name));
    fn only<'a>(mut found: impl Iterator<Item = &'a LayerInfo>) -> Option<&'a LayerInfo> {
        found.next().filter(|_| found.next().is_none())
    }
    called("")
        .or_else(|| ending("rgba"))
        .or_else(|| ending("rgb"))
        .or_else(|| called("Composite.Combined"))
        .or_else(|| ending("Combined"))
        .or_else(|| ending("beauty"))
        .or_else(|| ending("C"))
        .or_else(|| only(layers.iter().filter(colored)))
        .or_else(|| only(layers.iter().filter(colored).filter(|l| header.view_of(l) == 0)))
        .or_else(|| layers.iter().filter(grey).find(|l| l.name.is_empty()))
        .or_else(|| only(layers.iter().filter(grey)))
        .ok_or_else(|| {
            Error::invalid(format!("none of the layers is plainly the picture: {}", listed(layers)))
                .hint("name the layer with ⟨layer⟩")
        })
}

/// A film of transparent black, or opaque black inside the data window if the picture has no alpha. Only rows and
/// columns of the data window are touched: a damaged display window costs address space, not memory.
fn blank(header: &Header, part: usize, opaque: bool) -> Film {
    let (display, data) = (header.display_window, header.parts[part].data_window);
    let mut film = Film::new(display.size[0], display.size[1]);
    if !opaque {
        return film;
    }
    let range = |axis: usize| {
        let start = i64::from(data.min[axis]) - i64::from(display.min[axis]);
        let end = (start + data.size[axis] as i64).clamp(0, display.size[axis] as i64);
        start.clamp(0, end) as usize..end as usize
    };
    for y in range(1) {
        for x in range(0) {
            film.rgba[y * film.width + x][3] = 1.0;
        }
    }
    film
}
