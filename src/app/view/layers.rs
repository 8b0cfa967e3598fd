//! The sheet of a picture: its layers side by side.

use super::shown::{Content, Layer as ShownLayer, Picture};
use super::{ViewSettings, exposure, name_of};
use crate::error::Result;
use crate::formats::exr::{self, Channel, Image, Layer, deep};
use crate::formats::limits::Limits;
use crate::formats::picture::{self, Options};
use crate::formats::png::ToneMapping;
use crate::report::sheet::{Canvas, Range, Sheet, Tile, fitted, grey, signed};
use crate::report::short;
use crate::scene::color_space::ColorSpace;
use crate::scene::film::Film;
use std::path::Path;

/// Longer side of pictures in pixels.
const SIDE: usize = 320;
/// Most tiles of a sheet.
const MOST: usize = 60;
/// Share of a channel's pixels that may be darker than black, and brighter than white.
const OUTSIDE: f64 = 0.01;
/// Stops by which a layer may be brighter, and darker, than the common exposure suits; beyond, it would be burnt out or
/// black, and has an exposure of its own.
const BRIGHTER: f64 = 1.0;
const DARKER: f64 = 3.0;
/// Depths beyond this stand for no surface.
const FAR: f32 = 1e9;

/// A layer, or a channel of one, reduced to the size of its tile.
struct Plane {
    name: String,
    film: Film,
    kind: Kind,
}

enum Kind {
    /// Colors, with the radiance that 99 % of their pixels stay below.
    Colors { white: f64 },
    /// Vectors, whose components lie between minus and plus this.
    Vectors { most: f64 },
    /// Numbers.
    Numbers { range: Range },
}

/// Draws the sheet of an OpenEXR picture.
///
/// # Errors
/// If the file cannot be read, or its layers do not fit in memory.
pub(super) fn sheet(view: &ViewSettings, path: &Path) -> Result<(Sheet, Content)> {
    let side = view.side(SIDE, MOST).map_err(|e| e.at(path))?;
    // A layer is taken apart while all are held: one film, and the numbers of a channel in order.
    let apart = exr::header(path)?.display_window.pixels().saturating_mul((size_of::<[f32; 4]>() + 8) as u64);
    let limits = Limits { max_memory: view.limits.max_memory.saturating_sub(apart) };
    let image = deep::image_or_flattened(path, limits)?;
    let planes: Vec<Plane> = image.layers.iter().flat_map(|layer| planes(&image, layer, side)).collect();
    let resolution = [image.width, image.height];
    let channels: usize = image.layers.iter().map(|layer| layer.channels.len()).sum();
    let mut lines = vec![format!("{} x {} pixels, {channels} channels", image.width, image.height)];
    if deep::is_deep(path) {
        lines.push("deep samples, flattened".into());
    }
    if image.data_window != image.display_window {
        lines.push(format!("data window {}, display window {}", image.data_window, image.display_window));
    }
    drop(image.layers);
    Ok(arranged(view, path, planes, resolution, lines))
}

/// Draws the sheet of a picture of integer samples; `format` is the name of its format.
///
/// # Errors
/// If the file cannot be read.
pub(super) fn plain(view: &ViewSettings, path: &Path, format: &str) -> Result<(Sheet, Content)> {
    let header = picture::header(path)?;
    let color_space = header.color_space.or(Some(ColorSpace::Srgb));
    let film = picture::read(path, &Options { color_space, limits: view.limits, ..Options::default() })?.film;
    let bits = header.bits.map_or(String::new(), |bits| format!(", {bits} bits"));
    let lines = vec![format!("{} x {} pixels, {format}{bits}", film.width, film.height)];
    let resolution = [film.width, film.height];
    // It is shown as it is, unless an exposure is asked for.
    let plane =
        Plane { name: String::new(), film: fitted(&film, view.side(SIDE, 1)?), kind: Kind::Colors { white: 1.0 } };
    Ok(arranged(view, path, vec![plane], resolution, lines))
}

/// Arranges planes on a sheet, all colors with one exposure: that of the beauty, else of the first.
fn arranged(
    view: &ViewSettings,
    path: &Path,
    mut planes: Vec<Plane>,
    resolution: [usize; 2],
    mut lines: Vec<String>,
) -> (Sheet, Content) {
    let whites =
        || planes.iter().filter_map(|p| if let Kind::Colors { white } = p.kind { Some((p, white)) } else { None });
    let beauty = whites().find(|(p, _)| is_beauty(&p.name)).or_else(|| whites().next());
    let exposure = view.exposure.unwrap_or_else(|| beauty.map_or(0.0, |(_, white)| exposure::making_white(white)));
    if beauty.is_some() {
        lines.push(format!("colors: exposure {exposure:+.1} EV, clipped, sRGB"));
    }
    // What people look for comes first.
    planes.sort_by_key(|plane| match plane.kind {
        Kind::Colors { .. } => usize::from(!is_beauty(&plane.name)),
        Kind::Vectors { .. } => 2,
        Kind::Numbers { .. } => 3,
    });
    let left_out = planes.len().saturating_sub(MOST);
    planes.truncate(MOST);
    if left_out > 0 {
        lines.push(format!("{left_out} more layers and channels are left out"));
    }
    let own = view.exposure.is_none();
    let (tiles, layers): (Vec<Tile>, Vec<ShownLayer>) =
        planes.into_iter().map(|plane| plane.tile(exposure, own)).unzip();
    let columns = Sheet::columns_of(tiles.len());
    let sheet = Sheet { title: name_of(path), lines, lead: None, tiles, columns };
    (sheet, Content::Picture(Picture { resolution, exposure, layers, left_out }))
}

/// True for names of layers that hold the finished picture.
fn is_beauty(name: &str) -> bool {
    let last = name.rsplit('.').next().unwrap_or(name).to_ascii_lowercase();
    ["", "rgba", "rgb", "combined", "beauty", "c"].contains(&last.as_str())
}

/// Takes a layer apart into what can be shown: colors or a vector, and each of its other channels, but for the alpha of
/// colors.
fn planes(image: &Image, layer: &Layer, side: usize) -> Vec<Plane> {
    let find = |names: [&str; 3]| {
        let of = |name: &str| layer.channels.iter().find(|c| c.name.eq_ignore_ascii_case(name));
        Some([of(names[0])?, of(names[1])?, of(names[2])?])
    };
    let film = |channels: [&Channel; 3]| {
        let [r, g, b] = channels.map(|c| &c.samples);
        let pixels = (0..image.width * image.height).map(|i| [r[i], g[i], b[i], 1.0]);
        Film::of(image.width, image.height, pixels.collect())
    };
    let prefix = if layer.name.is_empty() { String::new() } else { format!("{}.", layer.name) };
    let plane = |channel: &Channel| {
        let whole = film([channel; 3]);
        let near = channel.samples.iter().copied().filter(|v| v.abs() < FAR);
        let range = Range::of(near, OUTSIDE).unwrap_or(Range { low: 0.0, high: 1.0 });
        Plane { name: format!("{prefix}{}", channel.name), film: fitted(&whole, side), kind: Kind::Numbers { range } }
    };
    let others = |shown: &[&Channel; 3], left_out: &[&str]| -> Vec<Plane> {
        let is_other = |c: &&Channel| {
            let is_shown = shown.iter().any(|other| other.name == c.name);
            !is_shown && !left_out.iter().any(|name| name.eq_ignore_ascii_case(&c.name))
        };
        layer.channels.iter().filter(is_other).map(plane).collect()
    };
    if let Some(rgb) = find(["R", "G", "B"]).or_else(|| find(["red", "green", "blue"])) {
        let whole = film(rgb);
        let white = exposure::white_of(&whole);
        let colors = Plane { name: layer.name.clone(), film: fitted(&whole, side), kind: Kind::Colors { white } };
        return std::iter::once(colors).chain(others(&rgb, &["A", "alpha"])).collect();
    }
    if let Some(xyz) = find(["X", "Y", "Z"]) {
        let whole = film(xyz);
        let lengths = whole.rgba.iter().flat_map(|p| [p[0].abs(), p[1].abs(), p[2].abs()]);
        let most = Range::of(lengths, 0.001).map_or(0.0, |range| range.high);
        let vectors = Plane { name: layer.name.clone(), film: fitted(&whole, side), kind: Kind::Vectors { most } };
        return std::iter::once(vectors).chain(others(&xyz, &[])).collect();
    }
    layer.channels.iter().map(plane).collect()
}

impl Plane {
    /// Draws the tile of a layer, colors with the common exposure, or with their `own` where they need another one.
    fn tile(self, common: f64, own: bool) -> (Tile, ShownLayer) {
        let mut exposure = None;
        let (picture, kind, range, caption) = match self.kind {
            Kind::Colors { white } => {
                let suits = exposure::making_white(white);
                let other = own && white > 0.0 && !(-BRIGHTER..=DARKER).contains(&(suits - common));
                let stops = if other { suits } else { common };
                exposure = Some(stops);
                let rgb = ToneMapping { exposure: stops }.rgb8(&self.film);
                let words = if other { format!("exposure {stops:+.1} EV") } else { String::new() };
                (Canvas::of(self.film.width, self.film.height, rgb), "colors", None, words)
            }
            Kind::Vectors { most } => {
                let range = Range { low: -most, high: most };
                let words = format!("x, y, z in red, green, blue from {} to {}", short(-most), short(most));
                (signed(&self.film, most), "vectors", Some(range), words)
            }
            Kind::Numbers { range } => {
                let words = format!("black {}, white {}", short(range.low), short(range.high));
                (grey(&self.film, range), "numbers", Some(range), words)
            }
        };
        let title = if self.name.is_empty() { "colors".into() } else { self.name.clone() };
        let caption = Some(caption).filter(|words| !words.is_empty()).into_iter().collect();
        (Tile { title, picture, caption }, ShownLayer { name: self.name, kind, exposure, range })
    }
}
