//! Values that are compared.

use crate::formats::png;
use crate::metrics;
use crate::scene::display;
use crate::scene::film::Film;
use std::borrow::Cow;

/// Space of the values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Space {
    /// Scene-linear values.
    Linear,
    /// Display values: sRGB, clipped to 0..1.
    Display,
}

impl Space {
    /// Returns what the values are, in words.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Linear => "scene-linear values",
            Self::Display => "display values (sRGB)",
        }
    }

    /// Returns the values of a scene-linear film.
    pub(crate) fn of(self, film: &Film) -> Cow<'_, Film> {
        match self {
            Self::Linear => Cow::Borrowed(film),
            Self::Display => Cow::Owned(display::film(film)),
        }
    }
}

/// Returns the mean FLIP of a scene-linear picture against a reference of equal size.
pub(crate) fn flip(films: [&Film; 2]) -> f64 {
    let [a, b] = films.map(png::display_rgb8);
    metrics::flip::mean(&a, &b, [films[0].width as u32, films[0].height as u32])
}
