//! Deep pictures as flat ones.

use super::header::{open, too_large};
use super::held::{HeldOut, HeldRow};
use super::{DeepLine, TidyPixel, is_deep};
use crate::error::{Error, Result};
use crate::formats::exr::{Channel, Header, Image, Layer, Picture, SampleType, fault, picture_within, read_within};
use crate::formats::limits::Limits;
use crate::formats::reading::Reading;
use crate::scene::film::{Film, Plane};
use rayon::prelude::*;
use std::path::Path;

/// Depth of pixels in which nothing is seen, as Blender writes it.
const NOWHERE: f32 = 1e10;
/// Bytes that a sample takes at most while its pixel is made tidy: sorted thrice, with the intervals from its ends.
const TIDY_BYTES: u64 = 256;
/// Name of the plane of depths.
const DEPTH: &str = "Z";

/// A deep picture whose samples were composited.
#[derive(Debug)]
pub(crate) struct Flattened {
    pub header: Header,
    /// Pixels over the display window, with a plane Z: the depth of the nearest sample that is not fully transparent,
    /// 1e10 where there is none.
    pub film: Film,
}

/// Reads a deep picture and composites the samples of each pixel, once they are sorted and split where they overlap, as
/// far as they are seen where something holds them out. Rows are read as they are needed: the film (20 bytes per pixel
/// of the display window) and the chunks being unpacked must fit into `limits`.
///
/// # Errors
/// If the file is no deep OpenEXR picture, is damaged, has no channel Z or A, has samples whose depth is NaN, or takes
/// more memory than allowed; or if what holds it out is of another size.
pub(crate) fn flattened(path: &Path, held: Option<&HeldOut>, limits: Limits) -> Result<Flattened> {
    let _reading = Reading::begin(path);
    let mut source = open(path, limits)?;
    let (display, data) = (source.header.display_window, source.part().data_window);
    held.map_or(Ok(()), |held| held.check(display)).map_err(|e| e.at(path))?;
    let bytes = display.pixels().saturating_mul((size_of::<[f32; 4]>() + size_of::<f32>()) as u64);
    let mut flat: Option<(Film, Vec<f32>)> = None;
    let [width, height] = display.size;
    // Windows reach out of each other by less than 2³³.
    let from = [0, 1].map(|axis| i64::from(data.min[axis]) - i64::from(display.min[axis]));
    let blank = || (Film::new(width, height), vec![NOWHERE; width * height]);
    source.lines((bytes, limits), |row, line| {
        let needed = bytes.saturating_add(TIDY_BYTES * line.samples.len() as u64);
        if needed > limits.max_memory {
            let what = format!("row {row} of {} deep samples", line.samples.len());
            return Err(too_large(&what, needed, limits).at(path));
        }
        let y = from[1] + row as i64;
        let before = held.map(|held| (held.row(y), from[0]));
        let pixels = composited(&line, before.as_ref()).ok_or_else(|| undefined(row).at(path))?;
        if (0..height as i64).contains(&y) {
            let (film, depths) = flat.get_or_insert_with(blank);
            for (column, (rgba, depth)) in pixels.into_iter().enumerate() {
                let x = from[0] + column as i64;
                if (0..width as i64).contains(&x) {
                    let at = y as usize * width + x as usize;
                    (film.rgba[at], depths[at]) = (rgba, depth.unwrap_or(NOWHERE));
                }
            }
        }
        Ok(())
    })?;
    let (mut film, samples) = flat.unwrap_or_else(blank);
    film.planes.push(Plane { name: DEPTH.into(), samples });
    Ok(Flattened { header: source.header, film })
}

/// Returns color, opacity and depth of each pixel of a row, of which `held` holds out a part, with the column at which
/// the row begins in the display window; `None` if a depth is NaN.
fn composited(line: &DeepLine, held: Option<&(HeldRow<'_>, i64)>) -> Option<Vec<([f32; 4], Option<f32>)>> {
    if line.samples.iter().any(|sample| sample.z.is_nan() || sample.z_back.is_nan()) {
        return None;
    }
    let pixels: Vec<_> = line.pixels().collect();
    let one = |(column, samples): (usize, &&[_])| {
        let tidy = TidyPixel::new(samples);
        let rgba = match held {
            Some((row, from)) => tidy.rgba_held_out(&row.pixel(from + column as i64)),
            None => tidy.rgba(),
        };
        let seen = held.is_none() || rgba != [0.0; 4];
        (rgba.map(|v| v as f32), tidy.depth().filter(|_| seen).map(|z| z as f32))
    };
    Some(pixels.par_iter().enumerate().with_min_len(64).map(one).collect())
}

pub(super) fn undefined(row: usize) -> Error {
    Error::invalid(format!("a sample in row {row} has the depth NaN, by which it lies nowhere"))
        .hint("render it again; cumulo validate counts such samples")
}

/// Returns a deep picture as [`flattened`] does, as that of the unnamed layer.
pub(crate) fn flattened_picture(flattened: Film) -> Picture {
    let non_finite = flattened.rgba.iter().flatten().filter(|v| !v.is_finite()).count();
    let channels = ["R", "G", "B", "A"].map(str::to_owned).to_vec();
    Picture { film: Film { planes: Vec::new(), ..flattened }, layer: String::new(), non_finite, channels }
}

/// Reads a layer of a flat picture as [`picture_within`] does, or a deep picture composited, which has no layers.
///
/// # Errors
/// The conditions are those of [`picture_within`] and [`flattened`]; also if a layer is chosen of a deep picture.
pub(crate) fn picture_or_flattened(path: &Path, layer: Option<&str>, limits: Limits) -> Result<Picture> {
    if !is_deep(path) {
        return picture_within(path, layer, limits);
    }
    if let Some(name) = layer.filter(|name| !name.is_empty()) {
        return Err(fault::no_layers(name).at(path));
    }
    Ok(flattened_picture(flattened(path, None, limits)?.film))
}

/// Reads all layers of a flat picture as [`read_within`] does, or a deep picture composited, as channels R, G, B, A and
/// Z of the unnamed layer.
///
/// # Errors
/// The conditions are those of [`read_within`] and [`flattened`].
pub(crate) fn image_or_flattened(path: &Path, limits: Limits) -> Result<Image> {
    if !is_deep(path) {
        return read_within(path, limits);
    }
    // Planes are made of the pixels while these are held.
    let Flattened { header, film } = flattened(path, None, Limits { max_memory: limits.max_memory / 2 })?;
    let Film { width, height, rgba, planes, .. } = film;
    let channel = |name: &str, samples: Vec<f32>| {
        let non_finite = samples.iter().filter(|v| !v.is_finite()).count();
        Channel { name: name.into(), sample_type: SampleType::Float, samples, non_finite }
    };
    let of = |component: usize| rgba.iter().map(|pixel| pixel[component]).collect();
    let mut channels: Vec<Channel> =
        [("A", 3), ("B", 2), ("G", 1), ("R", 0)].map(|(name, component)| channel(name, of(component))).into();
    channels.extend(planes.into_iter().map(|plane| channel(&plane.name, plane.samples)));
    let (data_window, display_window) = (header.data_window, header.display_window);
    let layers = vec![Layer { name: String::new(), channels }];
    Ok(Image { width, height, data_window, display_window, layers, attributes: header.attributes() })
}
