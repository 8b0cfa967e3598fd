//! The sheet of a sequence: its frames, with one exposure and one density scale for all.

use super::capture::evenly;
use super::shown::{Content, Sequence};
use super::subject::Subject;
use super::{ViewSettings, camera, exposure, name_of, volume};
use crate::app::Context;
use crate::app::failed::Failed;
use crate::app::frame_loop::{FrameLoop, some};
use crate::app::sequence::numbers;
use crate::error::{Error, Result};
use crate::formats::exr::deep;
use crate::formats::format::FileKind;
use crate::formats::png::ToneMapping;
use crate::formats::registry;
use crate::formats::sequence::Pattern;
use crate::math::Aabb;
use crate::report::sheet::{Canvas, Sheet, Tile, fitted};
use crate::report::short;
use crate::scene::film::Film;
use crate::scene::up::Up;
use crate::text::ranges;
use glam::DVec3;
use std::path::Path;

/// Longer side of a frame in pixels.
const SIDE: usize = 160;
/// Most frames of a sheet, unless they are chosen.
const MOST: usize = 24;
/// Most frames that can be chosen.
const MOST_CHOSEN: usize = 400;

/// Draws the sheet of a sequence. Frames that are missing or cannot be read are left out, and named in its content.
///
/// # Errors
/// If none of the frames can be shown.
pub(super) fn sheet(
    view: &ViewSettings,
    path: &Path,
    pattern: &Pattern,
    context: &Context,
) -> Result<(Sheet, Content)> {
    let all = numbers(view.frames, pattern)?;
    if view.frames.is_some() && all.len() > MOST_CHOSEN {
        return Err(Error::unsupported(format!("{} frames: {MOST_CHOSEN} fit on a sheet", all.len()))
            .at(path)
            .hint("choose fewer with ⟨frames⟩ A-BxSTEP"));
    }
    let mut failed: Vec<Failed> = all.iter().filter_map(|number| missing(pattern, *number)).collect();
    let there: Vec<u32> =
        all.into_iter().filter(|number| failed.iter().all(|failed| failed.frame != *number)).collect();
    let chosen: Vec<u32> = match view.frames {
        Some(_) => there.clone(),
        None => evenly(there.len(), MOST).into_iter().map(|i| there[i]).collect(),
    };
    let mut axis = None;
    let mut density_scale = None;
    let (films, exposure) = match kind(pattern, &chosen)? {
        FileKind::Exr | FileKind::DeepExr => pictures(view, pattern, &chosen, &mut failed, context)?,
        _ => {
            let file = |number: &u32| view.open(&pattern.path(*number)).ok();
            let up = chosen.iter().find_map(file).map(|file| view.up_of(&file)).unwrap_or_default();
            let volumes = volumes(view, pattern, &chosen, &mut failed, up, context)?;
            axis = Some((up, volumes.light));
            density_scale = Some(volumes.scale);
            (volumes.films, view.exposure.unwrap_or(0.0))
        }
    };
    failed.sort_by_key(|failed| failed.frame);
    let tile = |(number, film): &(u32, Film)| Tile {
        title: format!("frame {number}"),
        picture: Canvas::of(film.width, film.height, ToneMapping { exposure }.rgb8(film)),
        caption: Vec::new(),
    };
    let tiles: Vec<Tile> = films.iter().map(tile).collect();
    let mut lines =
        vec![format!("{} of {} frames, {} to {}", films.len(), there.len(), there[0], there[there.len() - 1])];
    if !failed.is_empty() {
        lines.push(format!("not shown: {}", ranges(failed.iter().map(|failed| failed.frame))));
    }
    lines.push(format!("exposure of all {exposure:+.1} EV, clipped, sRGB"));
    lines.extend(density_scale.zip(axis).map(|(scale, (up, light))| {
        let axis = up.name().to_ascii_lowercase();
        format!("density scale of all {}, {light}, {axis} is up", short(scale))
    }));
    let columns = Sheet::columns_of(tiles.len());
    let sheet = Sheet { title: name_of(path), lines, lead: None, tiles, columns };
    let (exposure, frames) = (Some(exposure), films.iter().map(|(number, _)| *number).collect());
    Ok((sheet, Content::Sequence(Sequence { count: there.len(), frames, failed, exposure, density_scale })))
}

/// Returns the failure of a frame whose file is not there.
fn missing(pattern: &Pattern, number: u32) -> Option<Failed> {
    let path = pattern.path(number);
    std::fs::metadata(&path).err().map(|error| Failed::new(number, &Error::io(&path, error)))
}

/// True for the kinds of files whose sequences have sheets.
pub(super) fn shows(kind: FileKind) -> bool {
    matches!(kind, FileKind::Vdb | FileKind::NanoVdb | FileKind::Image(_) | FileKind::Exr | FileKind::DeepExr)
}

/// Returns the kind of the frames: that of the first one that can be shown.
fn kind(pattern: &Pattern, numbers: &[u32]) -> Result<FileKind> {
    let Some(first) = numbers.first() else {
        return Err(Error::invalid("none of the frames is there")
            .at(pattern.name())
            .hint("check the numbers, or leave ⟨frames⟩ out to show those that are there"));
    };
    let kinds = numbers.iter().filter_map(|number| Some(registry::sniff(&pattern.path(*number)).ok()?.kind));
    kinds.into_iter().find(|kind| shows(*kind)).ok_or_else(|| {
        Error::unsupported("sequences of volumes (VDB, NanoVDB, scans) and of pictures (OpenEXR) can be shown")
            .at(pattern.path(*first))
            .hint("view a single file, or convert the frames")
    })
}

/// Works on one frame after the other, and tells of those that fail among `failed`.
///
/// # Errors
/// If all frames fail: that of the first one.
fn each<T>(
    numbers: &[u32],
    failed: &mut Vec<Failed>,
    context: &Context,
    mut work: impl FnMut(u32) -> Result<T>,
) -> Result<Vec<(u32, T)>> {
    let context = context.silent();
    let results = FrameLoop::steps(numbers, "frames", &context).in_order(|_, number, _| work(number));
    let (done, more) = some(results?)?;
    failed.extend(more);
    Ok(done)
}

/// Pictures of volumes.
struct Volumes {
    /// Pictures by the frame's number.
    films: Vec<(u32, Film)>,
    /// Extinction per unit of density and length.
    scale: f64,
    /// How densities are shown, in words.
    light: &'static str,
}

/// Pictures of the frames' volumes by one camera and one density scale: the smallest of those that suit the frames, so
/// that none goes black.
fn volumes(
    view: &ViewSettings,
    pattern: &Pattern,
    numbers: &[u32],
    failed: &mut Vec<Failed>,
    up: Up,
    context: &Context,
) -> Result<Volumes> {
    let side = view.side(SIDE, numbers.len())?;
    let subject = |number: u32| {
        let path = pattern.path(number);
        let file = view.open(&path)?;
        let native = file.read(&volume::name(view, &file)?)?;
        let info = native.info().map_err(|e| e.at(&path))?;
        Subject::of(view, &native, &info, context).map_err(|e| e.at(&path))
    };
    let (mut bounds, mut scale, mut light) = (Aabb::EMPTY, f64::INFINITY, "");
    let read = each(numbers, failed, context, |number| {
        let subject = subject(number)?;
        light = subject.light();
        let outline = subject.field.outline();
        if outline.is_empty() {
            return Ok(());
        }
        bounds = outline.iter().fold(bounds, |b, p| b.including(*p));
        let own = subject.scale(view, &subject.framed(&camera::around(&outline, side, up), side));
        scale = scale.min(own.unwrap_or(f64::INFINITY));
        Ok(())
    })?;
    // Where nothing is to be seen, any camera and any scale show that.
    let bounds = if bounds.is_empty() { Aabb { min: DVec3::NEG_ONE, max: DVec3::ONE } } else { bounds };
    let scale = if scale.is_finite() { scale } else { 1.0 };
    let camera = camera::around(&bounds.corners(), side, up);
    let numbers: Vec<u32> = read.into_iter().map(|(number, ())| number).collect();
    let picture =
        |number| subject(number)?.picture(&camera, scale, &context.cancel()).map_err(|e| e.at(pattern.path(number)));
    Ok(Volumes { films: each(&numbers, failed, context, picture)?, scale, light })
}

/// The frames' pictures, reduced, and the exposure at which none is burnt out.
fn pictures(
    view: &ViewSettings,
    pattern: &Pattern,
    numbers: &[u32],
    failed: &mut Vec<Failed>,
    context: &Context,
) -> Result<(Vec<(u32, Film)>, f64)> {
    let (mut white, side) = (0.0_f64, view.side(SIDE, numbers.len())?);
    let films = each(numbers, failed, context, |number| {
        let film = deep::picture_or_flattened(&pattern.path(number), None, view.limits)?.film;
        white = white.max(exposure::white_of(&film));
        Ok(fitted(&film, side))
    })?;
    Ok((films, view.exposure.unwrap_or_else(|| exposure::making_white(white))))
}
