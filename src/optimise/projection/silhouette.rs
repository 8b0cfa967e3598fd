//! The silhouette of the medium in a picture, judged against the picture's noise.
//!
//! A faint medium is no clearer than the noise in one pixel, but it is in the mean of many: means over squares of
//! several sizes are compared with the deviation that they have where nothing is. What lies below the background is
//! noise, since no density is negative, and tells that deviation whether the noise is white, correlated, or clipped at
//! the background.

use super::plane::{Plane, SummedAreaTable};

/// Edges of the squares in pixels.
const EDGES: [usize; 6] = [1, 3, 5, 9, 17, 33];
/// Shortest side of a picture over the largest edge.
const SIDES: usize = 8;
/// Standard deviations above the background from which on a mean shows something: one of three million is by chance.
const CLEAR: f64 = 5.0;
/// Pixels around what is clear that are not taken for empty: there it fades into the noise.
const MARGIN: usize = 3;
/// Opacity that a few roundings of `f32` leave of none.
const ROUNDING: f32 = 2e-6;
/// Least number of values that tell a deviation.
const FEWEST: usize = 32;

/// Statistics of the opacities of empty pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EmptyPixels {
    /// Mean.
    pub mean: f64,
    /// Standard deviation.
    pub deviation: f64,
}

impl EmptyPixels {
    /// Measures the pixels between two that are no more opaque than nothing; `None` where there are hardly any.
    pub fn of(opacity: &Plane<'_>) -> Option<Self> {
        let empty = |v: f32| v <= ROUNDING;
        // Two pixels apart the noise of one says nothing about that of the other, but for a filter's.
        let rows = opacity.values.chunks_exact(opacity.width.max(1));
        let triples = rows.flat_map(|row| row.windows(5).map(|w| [w[0], w[2], w[4]]));
        let between = triples.filter(|[a, b, c]| empty(*a) && empty(*c) && b.is_finite());
        let mut values: Vec<f32> = between.map(|[_, b, _]| b).collect();
        if values.len() < FEWEST || values.len() * 1000 < opacity.values.len() {
            return None;
        }
        // 84 % of a normal distribution lie below one standard deviation.
        let at = values.len() * 84 / 100;
        let (_, deviation, _) = values.select_nth_unstable_by(at, f32::total_cmp);
        let deviation = f64::from(deviation.max(0.0));
        let near: Vec<f64> = values.iter().map(|v| f64::from(*v)).filter(|v| v.abs() <= 3.0 * deviation).collect();
        let mean = near.iter().sum::<f64>() / near.len().max(1) as f64;
        Some(Self { mean, deviation })
    }
}

/// Returns true for each pixel that shows something, and for each that is not finite, since it says nothing.
///
/// Squares grow from one pixel on, and leave out what smaller ones have found: an edge would else be seen from afar.
pub fn silhouette(opacity: &Plane<'_>, empty: EmptyPixels) -> Vec<bool> {
    let mut left = opacity.bounded();
    let most = (opacity.width.min(opacity.height()) / SIDES).max(1);
    for edge in EDGES.into_iter().take_while(|edge| *edge <= most) {
        let sums = SummedAreaTable::new(&Plane { values: &left, ..*opacity });
        let above = |(mean, share): (f64, f64)| (mean - empty.mean, share);
        let means: Vec<(f64, f64)> = (0..left.len()).map(|i| above(sums.mean(i, edge / 2))).collect();
        let Some(deviation) = deviation(&means, empty.deviation, edge) else { continue };
        for (left, (mean, share)) in left.iter_mut().zip(&means) {
            if mean * share.sqrt() > CLEAR * deviation {
                *left = f32::NAN;
            }
        }
    }
    let found: Vec<f32> = left.iter().map(|v| f32::from(u8::from(!v.is_finite()))).collect();
    let sums = SummedAreaTable::new(&Plane { values: &found, ..*opacity });
    // The outermost pixels tell whether a picture shows all of the medium: no margin there.
    let (right, bottom) = (opacity.width.saturating_sub(1), opacity.height().saturating_sub(1));
    let inner = |i: usize| {
        let (x, y) = (i % opacity.width, i / opacity.width);
        x > 0 && x < right && y > 0 && y < bottom
    };
    (0..found.len()).map(|i| found[i] > 0.0 || inner(i) && sums.mean(i, MARGIN).0 > 0.0).collect()
}

/// Standard deviation of the means over squares of empty pixels: that of white noise at least. Half of the means below
/// the background lie within 0.6745 standard deviations of it.
fn deviation(means: &[(f64, f64)], pixel: f64, edge: usize) -> Option<f64> {
    let white = pixel / edge as f64;
    if edge == 1 {
        return Some(white);
    }
    let mut below: Vec<f64> = means.iter().filter(|(m, share)| *m < 0.0 && *share == 1.0).map(|(m, _)| -m).collect();
    if below.len() < FEWEST {
        return None;
    }
    let middle = below.len() / 2;
    let (_, median, _) = below.select_nth_unstable_by(middle, f64::total_cmp);
    Some((*median / 0.6745).max(white))
}
