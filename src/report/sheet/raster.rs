//! Films and planes of numbers as rasters of a tile's size.

use super::Canvas;
use crate::report::picture;
use crate::scene::film::Film;

/// A range of numbers that greys stand for.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, schemars::JsonSchema)]
pub(crate) struct Range {
    /// Number that is black.
    pub low: f64,
    /// Number that is white.
    pub high: f64,
}

impl Range {
    /// Range from the `share`-th to the (1 - `share`)-th quantile of the finite numbers; `None` if there are none.
    pub(crate) fn of(values: impl Iterator<Item = f32>, share: f64) -> Option<Self> {
        let mut finite: Vec<f32> = values.filter(|v| v.is_finite()).collect();
        finite.sort_by(f32::total_cmp);
        let at = |share: f64| {
            let place = (share * finite.len().saturating_sub(1) as f64).round() as usize;
            finite.get(place).map(|v| f64::from(*v))
        };
        Some(Self { low: at(share)?, high: at(1.0 - share)? })
    }

    /// Place of a number in the range, from 0 to 1; 0 for NaN, and in a range of one number 1 for that number and
    /// above.
    pub(crate) fn share(self, value: f64) -> f64 {
        let width = self.high - self.low;
        match (value - self.low) / width {
            _ if width <= 0.0 => f64::from(u8::from(value >= self.low)),
            share if share > 0.0 => share.min(1.0),
            // Below the range, or NaN.
            _ => 0.0,
        }
    }
}

/// A film whose longer side has about `side` pixels: means over blocks of a larger one, and repeated pixels of a
/// smaller one.
pub(crate) fn fitted(film: &Film, side: usize) -> Film {
    let small = picture::reduced(film, side.max(1));
    let factor = side / small.width.max(small.height).max(1);
    if factor < 2 {
        return small;
    }
    let (width, height) = (factor * small.width, factor * small.height);
    let pixel = |i: usize| small.rgba[i / width / factor * small.width + i % width / factor];
    Film::of(width, height, (0..width * height).map(pixel).collect())
}

/// Greys of numbers (the first component of each pixel), from black at the low end of the range to white at the high
/// one.
pub(crate) fn grey(film: &Film, range: Range) -> Canvas {
    // `as` saturates and turns NaN into 0.
    let level = |v: f32| (255.0 * range.share(f64::from(v)) + 0.5) as u8;
    Canvas::of(film.width, film.height, film.rgba.iter().flat_map(|p| [level(p[0]); 3]).collect())
}

/// Colors of vectors: red, green and blue of a pixel rise with its first three components, from black at `-most`
/// through the middle at 0 to full at `most`.
pub(crate) fn signed(film: &Film, most: f64) -> Canvas {
    let range = Range { low: -most, high: most };
    let level = |v: f32| (255.0 * range.share(f64::from(v)) + 0.5) as u8;
    Canvas::of(film.width, film.height, film.rgba.iter().flat_map(|p| [p[0], p[1], p[2]].map(level)).collect())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    #[test]
    fn pictures_fit_their_tiles() {
        let film = |w: usize, h: usize| Film::of(w, h, (0..w * h).map(|i| [i as f32; 4]).collect());
        let sizes = [(1000, 10), (3, 2), (100, 160), (160, 1)].map(|(w, h)| {
            let fit = fitted(&film(w, h), 160);
            (fit.width, fit.height, fit.rgba.len() == fit.width * fit.height)
        });
        assert_eq!(sizes, [(143, 2, true), (159, 106, true), (100, 160, true), (160, 1, true)]);
        assert_eq!(fitted(&film(2, 2), 4).rgba[4 * 3 + 3][0], 3.0);
    }

    #[test]
    fn ranges_leave_outliers_out() {
        let values = (0..1000).map(|i| i as f32).chain([1e10, f32::NAN, f32::INFINITY]);
        let range = Range::of(values, 0.01).unwrap();
        assert_eq!((range.low, range.high), (10.0, 990.0));
        assert!(Range::of([f32::NAN].into_iter(), 0.0).is_none());
        assert_eq!([-5.0, 10.0, 500.0, 2e3, f64::NAN].map(|v| range.share(v)), [0.0, 0.0, 0.5, 1.0, 0.0]);
        let flat = Range { low: 2.0, high: 2.0 };
        assert_eq!([1.0, 2.0].map(|v| flat.share(v)), [0.0, 1.0]);
    }
}
