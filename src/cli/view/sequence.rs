//! The sheet of a sequence: its frames, with one exposure and one density scale for all.

use super::capture::evenly;
use super::shown::{Content, Sequence};
use super::subject::Subject;
use super::{View, camera, exposure, name_of, volume};
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::png::ToneMapping;
use crate::formats::sequence::Pattern;
use crate::formats::vdb::File;
use crate::formats::{self, Format, exr};
use crate::math::Aabb;
use crate::report::sheet::{Canvas, Sheet, Tile, fitted};
use crate::report::short;
use crate::scene::film::Film;
use crate::scene::up::Up;
use glam::DVec3;
use std::path::Path;

/// Longer side of a frame in pixels.
const SIDE: usize = 160;
/// Most frames of a sheet, unless they are chosen.
const MOST: usize = 24;
/// Most frames that can be chosen.
const MOST_CHOSEN: usize = 400;

/// Draws the sheet of a sequence.
///
/// # Errors
/// If there are no frames, or one of those shown cannot be read.
pub(super) fn sheet(view: &View, path: &Path, pattern: &Pattern, limits: Limits) -> Result<(Sheet, Content)> {
    let there = pattern.numbers()?;
    let numbers: Vec<u32> = match view.frames {
        Some(frames) => frames.numbers().collect(),
        None => evenly(there.len(), MOST).into_iter().map(|i| there[i]).collect(),
    };
    if numbers.len() > MOST_CHOSEN {
        return Err(Error::unsupported(format!("{} frames: {MOST_CHOSEN} fit on a sheet", numbers.len()))
            .at(path)
            .hint("choose fewer with --frames A-BxSTEP"));
    }
    let first = pattern.path(numbers[0]);
    let mut axis = None;
    let mut density_scale = None;
    let (films, exposure) = match formats::sniff(&first)? {
        Format::Vdb | Format::NanoVdb => {
            let up = view.up_of(&File::open(&first, limits)?);
            let volumes = volumes(view, pattern, &numbers, up, limits)?;
            axis = Some((up, volumes.light));
            density_scale = Some(volumes.scale);
            (volumes.films, view.exposure.unwrap_or(0.0))
        }
        Format::Exr => pictures(view, pattern, &numbers, limits)?,
        _ => {
            return Err(Error::unsupported("sequences of volumes (VDB) and of pictures (OpenEXR) can be shown")
                .at(first)
                .hint("view a single file, or convert the frames"));
        }
    };
    let tile = |(number, film): (&u32, &Film)| Tile {
        title: format!("frame {number}"),
        picture: Canvas::of(film.width, film.height, ToneMapping { exposure }.rgb8(film)),
        caption: Vec::new(),
    };
    let tiles: Vec<Tile> = numbers.iter().zip(&films).map(tile).collect();
    let mut lines =
        vec![format!("{} of {} frames, {} to {}", numbers.len(), there.len(), there[0], there[there.len() - 1])];
    lines.push(format!("exposure of all {exposure:+.1} EV, clipped, sRGB"));
    lines.extend(density_scale.zip(axis).map(|(scale, (up, light))| {
        let axis = up.name().to_ascii_lowercase();
        format!("density scale of all {}, {light}, {axis} is up", short(scale))
    }));
    let columns = Sheet::columns_of(tiles.len());
    let sheet = Sheet { title: name_of(path), lines, lead: None, tiles, columns };
    let exposure = Some(exposure);
    Ok((sheet, Content::Sequence(Sequence { count: there.len(), frames: numbers, exposure, density_scale })))
}

/// Pictures of volumes.
struct Volumes {
    films: Vec<Film>,
    /// Extinction per unit of density and length.
    scale: f64,
    /// How densities are shown, in words.
    light: &'static str,
}

/// Pictures of the frames' volumes by one camera and one density scale: the smallest of those that suit the frames, so
/// that none goes black.
fn volumes(view: &View, pattern: &Pattern, numbers: &[u32], up: Up, limits: Limits) -> Result<Volumes> {
    let side = view.side(SIDE, numbers.len())?;
    let subject = |number: u32| {
        let path = pattern.path(number);
        let file = File::open(&path, limits)?;
        let native = file.read(&volume::name(view, &file)?)?;
        let info = native.info().map_err(|e| e.at(&path))?;
        Subject::of(view, &native, &info, limits).map_err(|e| e.at(&path))
    };
    let (mut bounds, mut scale, mut light) = (Aabb::EMPTY, f64::INFINITY, "");
    for number in numbers {
        let subject = subject(*number)?;
        light = subject.light();
        let outline = subject.field.outline();
        if outline.is_empty() {
            continue;
        }
        bounds = outline.iter().fold(bounds, |b, p| b.including(*p));
        let own = subject.scale(view, &subject.framed(&camera::around(&outline, side, up), side));
        scale = scale.min(own.unwrap_or(f64::INFINITY));
    }
    // Where nothing is to be seen, any camera and any scale show that.
    let bounds = if bounds.is_empty() { Aabb { min: DVec3::NEG_ONE, max: DVec3::ONE } } else { bounds };
    let scale = if scale.is_finite() { scale } else { 1.0 };
    let camera = camera::around(&bounds.corners(), side, up);
    let films =
        numbers.iter().map(|number| subject(*number)?.picture(&camera, scale).map_err(|e| e.at(pattern.path(*number))));
    Ok(Volumes { films: films.collect::<Result<_>>()?, scale, light })
}

/// The frames' pictures, reduced, and the exposure at which none is burnt out.
fn pictures(view: &View, pattern: &Pattern, numbers: &[u32], limits: Limits) -> Result<(Vec<Film>, f64)> {
    let (mut white, side) = (0.0_f64, view.side(SIDE, numbers.len())?);
    let read = |number: &u32| {
        let film = exr::read_picture_within(&pattern.path(*number), None, limits)?;
        white = white.max(exposure::white_of(&film));
        Ok(fitted(&film, side))
    };
    let films = numbers.iter().map(read).collect::<Result<_>>()?;
    Ok((films, view.exposure.unwrap_or_else(|| exposure::making_white(white))))
}
