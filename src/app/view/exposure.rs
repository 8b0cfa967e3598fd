//! The exposure of pictures.

use crate::report::sheet::Range;
use crate::scene::film::Film;

/// Share of the pixels that may be brighter than white.
const BRIGHTER: f64 = 0.01;

/// Returns the radiance that 99 % of the pixels of a film stay below, of the brightest of their channels; 0 if no pixel
/// has any.
pub(super) fn white_of(film: &Film) -> f64 {
    let brightest = film.rgba.iter().map(|[r, g, b, _]| r.max(*g).max(*b));
    Range::of(brightest, BRIGHTER).map_or(0.0, |range| range.high.max(0.0))
}

/// Returns the exposure in tenths of a stop that makes a radiance white; 0 for black.
pub(super) fn making_white(radiance: f64) -> f64 {
    let stops = -radiance.log2();
    if stops.is_finite() { (10.0 * stops).round() / 10.0 + 0.0 } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_brightest_hundredth_does_not_count() {
        let pixels = (0..1000).map(|i| [0.0, if i < 5 { 1e6 } else { 0.25 }, 0.1, 1.0]).collect();
        let white = white_of(&Film::of(100, 10, pixels));
        assert_eq!((white, making_white(white)), (0.25, 2.0));
        assert_eq!([1.0, 0.0, f64::NAN, 4.0].map(making_white), [0.0, 0.0, 0.0, -2.0]);
        assert_eq!(white_of(&Film::of(1, 1, vec![[f32::NAN; 4]])), 0.0);
    }
}
