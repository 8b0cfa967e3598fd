//! The pictures of a capture, and which of them are held out.

use crate::app::checks::Warning;
use crate::error::{Code, Error, Result};
use crate::formats::exr;
use crate::formats::format::FileKind;
use crate::formats::limits::Limits;
use crate::formats::picture;
use crate::inverse::observation::photo::Photo;
use crate::ordered;
use crate::report::{MOST_VIEWS, choose};
use crate::scene::capture::{Capture, Frame, Pictures};
use crate::scene::film::Film;
use rayon::prelude::*;
use std::path::Path;

/// Bytes a pixel that a picture takes with its optical depths and weights and the rays that a solver walks.
pub(crate) const WHOLE: u64 = 48;
/// Bytes a pixel that its transmittance and the rays that a solver walks take.
pub(crate) const DEPTHS: u64 = 24;

/// Reads the pictures of a capture, on all threads, each only until `take` has made of it what is kept; `tick` is
/// called once a picture. What is kept has `bytes` a pixel.
///
/// # Errors
/// If a picture cannot be read, has another size than its camera or holds no colors, or what is kept does not fit in
/// memory.
pub(crate) fn each<T: Send>(
    capture: &Capture,
    layer: Option<&str>,
    limits: Limits,
    bytes: u64,
    tick: &(dyn Fn() + Sync),
    take: impl Fn(Photo) -> T + Sync + Send,
) -> Result<Vec<T>> {
    let pixels = capture.pixels();
    if pixels * bytes > limits.max_memory {
        return Err(Error::unsupported(format!("{pixels} pixels do not fit in memory"))
            .coded(Code::MemoryLimit)
            .hint("use fewer or smaller pictures, or raise ⟨max_memory⟩"));
    }
    some(capture, &(0..capture.frames.len()).collect::<Vec<_>>(), layer, limits, tick, take)
}

/// Reads the pictures of the frames of a capture that have these numbers, as [`each`] reads all.
///
/// # Errors
/// Those of [`each`], but for that of what does not fit.
pub(crate) fn some<T: Send>(
    capture: &Capture,
    numbers: &[usize],
    layer: Option<&str>,
    limits: Limits,
    tick: &(dyn Fn() + Sync),
    take: impl Fn(Photo) -> T + Sync + Send,
) -> Result<Vec<T>> {
    let read = |number: &usize| {
        let frame = &capture.frames[*number];
        let film = picture(&frame.picture, layer, capture, limits)?;
        tick();
        suits(frame, [film.width, film.height])?;
        let photograph = capture.pictures == Some(Pictures::Photographs);
        Ok(take(Photo { camera: frame.camera, film, name: frame.picture.display().to_string(), photograph }))
    };
    ordered::try_map(numbers.par_iter(), read)
}

/// Refuses a picture of so many pixels that has another size than its camera.
fn suits(frame: &Frame, [width, height]: [usize; 2]) -> Result<()> {
    let (w, h) = (frame.camera.width as usize, frame.camera.height as usize);
    if [width, height] == [w, h] {
        return Ok(());
    }
    Err(Error::invalid(format!("the picture has {width}x{height} pixels, the capture says {w}x{h}"))
        .at(&frame.picture)
        .hint("correct 'w' and 'h' together with 'fl_x', 'fl_y', 'cx' and 'cy', or leave them out"))
}

/// Reads the headers of all pictures of a capture, and refuses those that do not suit it.
///
/// # Errors
/// If a header cannot be read, has another size than its camera or names no colors.
pub(crate) fn headers(capture: &Capture, layer: Option<&str>) -> Result<()> {
    let check = |frame: &Frame| {
        if matches!(picture::format(&frame.picture)?.kind, FileKind::Exr) {
            check_colors(&frame.picture, layer)?;
        }
        suits(frame, picture::header(&frame.picture)?.size)
    };
    ordered::try_map(capture.frames.par_iter(), check).map(|_| ())
}

/// Reads a picture of a capture as the radiance that arrives.
///
/// # Errors
/// If it cannot be read, holds no colors, or has integer samples of an unknown color space.
pub(crate) fn picture(path: &Path, layer: Option<&str>, capture: &Capture, limits: Limits) -> Result<Film> {
    if matches!(picture::format(path)?.kind, FileKind::Exr) {
        check_colors(path, layer)?;
    }
    let options = picture::Options { layer, color_space: capture.color_space, background: capture.background, limits };
    Ok(picture::read(path, &options)?.film)
}

/// Returns what a report of pictures says: remarks on the capture's file, and a warning of few levels of brightness.
pub(crate) fn remarks(capture: &Capture) -> Vec<Warning> {
    let remark = |remark: &String| Warning::new(remark, "nothing needs to be done if this is what was meant");
    let mut all: Vec<Warning> = capture.remarks.iter().map(remark).collect();
    let blurred = capture.frames.iter().filter(|frame| !frame.camera.blur.is_none()).count();
    if blurred > 0 {
        all.push(Warning::new(
            format!(
                "cameras of {blurred} views have an aperture or move while their shutter is open, and pictures are \
                 taken as sharp"
            ),
            "render them with ⟨aperture=0⟩ and ⟨shutter=0⟩, or see that the blur is below a pixel",
        ));
    }
    let bits = |frame: &Frame| {
        let header = picture::header(&frame.picture).ok()?;
        let space = capture.color_space.or(header.color_space)?;
        Some((header.bits?, space))
    };
    if capture.pictures == Some(Pictures::Photographs) {
        return all;
    }
    // The coarsest of the pictures: one of 8 bits among EXRs limits what they tell together.
    if let Some((bits, space)) = capture.frames.iter().filter_map(bits).min_by_key(|(bits, _)| *bits) {
        let percent = 100.0 * space.largest_step(bits);
        all.push(Warning::new(
            format!(
                "the pictures have integer samples of {bits} bits ({space}): the levels next to white are {percent:.2} \
                 % apart, which limits how well thin parts of the volume are known; what is brighter than white is cut"
            ),
            "render scene-linear EXRs (OpenEXR, float) where accuracy counts",
        ));
    }
    all
}

/// Refuses an EXR that holds no colors: a depth or an alpha alone would be taken for grey light.
fn check_colors(path: &Path, layer: Option<&str>) -> Result<()> {
    let header = exr::header(path)?;
    let chosen = |name: &str| {
        layer.is_none_or(|wanted| {
            name.eq_ignore_ascii_case(wanted)
                || name.rsplit('.').next().is_some_and(|last| last.eq_ignore_ascii_case(wanted))
        })
    };
    let layers: Vec<Vec<String>> = header
        .layers()
        .iter()
        .filter(|l| chosen(&l.name))
        .map(|l| l.channels.iter().map(|&c| header.parts[l.part].channels[c].component.clone()).collect())
        .collect();
    let is = |component: &String, names: &[&str]| names.iter().any(|n| component.eq_ignore_ascii_case(n));
    let alpha = |c: &String| is(c, &["A", "alpha"]);
    let depth = |c: &String| is(c, &["Z", "ZBack", "depth"]);
    let hint = if layer.is_some() {
        "name another layer with ⟨layer⟩, or render the view with colors (R, G, B)"
    } else {
        "render the view with colors (R, G, B), and alpha where it is known"
    };
    let odd = |channels: &Vec<String>| match channels.iter().filter(|c| !alpha(c)).collect::<Vec<_>>()[..] {
        [] => Some("alpha alone"),
        [one] if depth(one) => Some("a depth alone"),
        [_, _] => Some("two channels, which are no colors"),
        _ => None,
    };
    // Where there is something else, that is what is read.
    if !layers.is_empty() && layers.iter().all(|l| odd(l).is_some()) {
        let what = layers.iter().find_map(odd).unwrap_or_default();
        let names = layers.concat().join(", ");
        return Err(Error::invalid(format!("the picture holds {what} (channels {names}); colors are expected"))
            .at(path)
            .hint(hint));
    }
    Ok(())
}

/// Returns the numbers of the held-out views, evenly spaced: `count` of them, or without it one if there are `enough`
/// views.
///
/// # Errors
/// If no view would be left.
pub(crate) fn held_out(count: Option<usize>, views: usize, enough: usize) -> Result<Vec<usize>> {
    let count = count.unwrap_or(usize::from(views >= enough));
    if count >= views {
        return Err(Error::invalid(format!("⟨held_out={count}⟩ leaves none of the {views} views"))
            .hint("hold out fewer views than there are"));
    }
    Ok((0..count).map(|i| (2 * i + 1) * views / (2 * count)).collect())
}

/// Returns the numbers of the views that a report shows: at most [`MOST_VIEWS`] of `views`, those held out first.
pub(crate) fn report_views(views: usize, held_out: &[usize]) -> Vec<usize> {
    choose(&(0..views).map(|i| held_out.contains(&i)).collect::<Vec<_>>(), MOST_VIEWS)
}
