//! Small pictures of all cameras.

use super::picture::{self, reduced};
use crate::error::Result;
use crate::formats::png;
use crate::scene::film::Film;
use maud::{Markup, html};

/// Largest number of thumbnails on a page, of at most [`MOST_PIXELS`] squared: 3.7 MB of pictures that do not compress.
pub(crate) const MOST_THUMBNAILS: usize = 100;
/// Longest side of a thumbnail in pixels.
const MOST_PIXELS: usize = 96;

/// A picture of a camera, reduced.
#[derive(Debug, Clone, PartialEq)]
pub struct Thumbnail {
    name: String,
    held_out: bool,
    film: Film,
    aspect: f64,
}

impl Thumbnail {
    /// Reduces a picture; `held_out` marks a view that served only for evaluation.
    pub fn new(name: impl Into<String>, film: &Film, held_out: bool) -> Self {
        let aspect = film.width as f64 / film.height.max(1) as f64;
        Self { name: name.into(), held_out, film: reduced(film, MOST_PIXELS), aspect }
    }
}

/// Grid of thumbnails; `total` is the number of all views.
///
/// # Errors
/// If a picture has no pixels.
pub(crate) fn grid(all: &[Thumbnail], total: usize) -> Result<Markup> {
    let shown = all.len().min(MOST_THUMBNAILS);
    let figure = |thumbnail: &Thumbnail| {
        let Thumbnail { name, held_out, film, aspect } = thumbnail;
        let rgb = png::display_rgb8(film);
        let picture = picture::rgb8(film.width, film.height, &rgb, *aspect, &format!("picture of view {name}"))?;
        Ok(html! {
            figure {
                (picture)
                figcaption.caption { bdi { (name) } @if *held_out { " " span.badge { "held out" } } }
            }
        })
    };
    let figures = all[..shown].iter().map(figure).collect::<Result<Vec<_>>>()?;
    Ok(html! {
        @if shown < total { p { (shown) " of " (total) " views, evenly spaced." } }
        div.thumbnails { @for figure in &figures { (figure) } }
    })
}
