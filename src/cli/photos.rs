//! The pictures of a capture, and which of them are held out.

use crate::error::{Error, Result};
use crate::formats::exr;
use crate::formats::limits::Limits;
use crate::optimise::projection::observation::Photo;
use crate::report::{MOST_VIEWS, choose};
use crate::scene::capture::{Capture, Frame};
use crate::scene::film::Film;
use rayon::prelude::*;
use std::path::Path;

/// Reads all pictures of a capture, on all threads; `tick` is called once a picture.
///
/// # Errors
/// If a picture cannot be read, has another size than its camera or holds no colors, or they do not fit in memory.
pub fn read(capture: &Capture, layer: Option<&str>, limits: Limits, tick: &(dyn Fn() + Sync)) -> Result<Vec<Photo>> {
    let pixels: u64 = capture.frames.iter().map(|f| u64::from(f.camera.width) * u64::from(f.camera.height)).sum();
    // Colors, depths and weights, and the rays that the solver walks.
    if pixels * 48 > limits.max_memory {
        return Err(Error::unsupported(format!("{pixels} pixels do not fit in memory"))
            .hint("use fewer or smaller pictures, or raise --max-memory"));
    }
    let read = |frame: &Frame| {
        let film = colors(&frame.picture, layer, limits)?;
        tick();
        let (w, h) = (frame.camera.width as usize, frame.camera.height as usize);
        if (film.width, film.height) != (w, h) {
            return Err(Error::invalid(format!(
                "the picture has {}x{} pixels, transforms.json says {w}x{h}",
                film.width, film.height
            ))
            .at(&frame.picture)
            .hint("correct 'w' and 'h' together with 'fl_x', 'fl_y', 'cx' and 'cy', or leave them out"));
        }
        Ok(Photo { camera: frame.camera, film, name: frame.picture.display().to_string() })
    };
    capture.frames.par_iter().map(read).collect()
}

/// Reads a picture, and refuses it if it holds no colors: a depth or an alpha alone would be taken for grey light.
fn colors(path: &Path, layer: Option<&str>, limits: Limits) -> Result<Film> {
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
        "name another layer with --layer, or render the view with colors (R, G, B)"
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
    exr::read_picture_within(path, layer, limits)
}

/// Returns the numbers of the held-out views, evenly spaced: `count` of them, or without it one if there are `enough`
/// views.
///
/// # Errors
/// If no view would be left.
pub fn held_out(count: Option<usize>, views: usize, enough: usize) -> Result<Vec<usize>> {
    let count = count.unwrap_or(usize::from(views >= enough));
    if count >= views {
        return Err(Error::invalid(format!("--held-out {count} leaves none of the {views} views"))
            .hint("hold out fewer views than there are"));
    }
    Ok((0..count).map(|i| (2 * i + 1) * views / (2 * count)).collect())
}

/// Returns the numbers of the views that a report shows: at most [`MOST_VIEWS`] of `views`, those held out first.
pub fn shown(views: usize, held_out: &[usize]) -> Vec<usize> {
    choose(&(0..views).map(|i| held_out.contains(&i)).collect::<Vec<_>>(), MOST_VIEWS)
}
