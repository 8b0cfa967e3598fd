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
/// Shorter side of a photograph over the width of the border that its background is measured in.
const BORDER: usize = 32;
/// Largest opacity and deviation that the background of a photograph may seem to have, and how few of its pixels may be
/// clearly less opaque than that: one of so many.
const DARKEST: f64 = 0.03;
const NOISIEST: f64 = 0.08;
const DARKER: usize = 100;
/// Share of all light of a picture that a speck has less than.
const SPECK: f64 = 1e-3;
/// Largest step of integer samples, relative to the background: those of 8 bits are 0.009 apart next to white, and 0.02
/// of it next to a background of 0.2.
const LARGEST_STEP: f64 = 0.025;
/// Distance from the median in such steps and in standard deviations up to which values of a border may be noise, that
/// in standard deviations of what is left beyond which they are clipped, and how often that is repeated.
const FARTHEST_STEPS: f64 = 24.0;
const FARTHEST: f64 = 6.0;
const CLIPPED: f64 = 3.0;
const CLIPPINGS: usize = 8;
/// Standard deviation of roundings, in steps of what is rounded.
const ROUNDED: f64 = 0.289;
/// Least number of values that tell a deviation.
const FEWEST: usize = 32;

/// Statistics of the opacities of empty pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct EmptyPixels {
    /// Mean.
    pub mean: f64,
    /// Standard deviation.
    pub deviation: f64,
}

impl EmptyPixels {
    /// Measures the pixels between two that are no more opaque than nothing; `None` where there are hardly any.
    pub(crate) fn from_opacity(opacity: &Plane<'_>) -> Option<Self> {
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

    /// Measures the border of a photograph, which shows what the camera and its coding make of the background; `None`
    /// where too much of the border shows more than that. Values far from the others are clipped until none is left.
    pub(crate) fn from_border(opacity: &Plane<'_>) -> Option<Self> {
        let (width, height) = (opacity.width, opacity.height());
        let edge = (width.min(height) / BORDER).max(1);
        let outer = |at: usize, end: usize| at < edge || at + edge >= end;
        let border = (0..width * height).filter(|i| outer(i % width, width) || outer(i / width, height));
        let mut values: Vec<f32> = border.map(|i| opacity.values[i]).filter(|v| v.is_finite()).collect();
        if values.len() < FEWEST {
            return None;
        }
        values.sort_unstable_by(f32::total_cmp);
        let at = |percent: usize| f64::from(values[values.len() * percent / 100]);
        let median = at(50);
        let apart = || values.iter().map(|v| (f64::from(*v) - median).abs());
        let step = apart().filter(|apart| (f64::from(ROUNDING)..LARGEST_STEP).contains(apart)).reduce(f64::min);
        let step = step.unwrap_or(0.0);
        // 34 % of a normal distribution lie within 0.44 standard deviations above or below its median.
        let spread = (median - at(33)).max(at(67) - median) / 0.44;
        let mut reach = (FARTHEST_STEPS * step).max(FARTHEST * spread);
        let mut of_rest = (0.0, 0.0);
        for _ in 0..CLIPPINGS {
            let (mut sum, mut square, mut count) = (0.0, 0.0, 0.0);
            for value in values.iter().map(|v| f64::from(*v) - median).filter(|v| v.abs() <= reach) {
                (sum, square, count) = (sum + value, square + value * value, count + 1.0);
            }
            // The median itself is never clipped.
            let mean = sum / f64::max(count, 1.0);
            of_rest = (mean, (square / f64::max(count, 1.0) - mean * mean).max(0.0).sqrt());
            reach = reach.min(CLIPPED * of_rest.1 + mean.abs());
        }
        let (mean, deviation) = (median + of_rest.0, of_rest.1.max(ROUNDED * step).max(f64::from(ROUNDING)));
        // What is less opaque than the background is noise: coding leaves more of it in some blocks than in others.
        let mut all: Vec<f32> = opacity.values.iter().copied().filter(|v| v.is_finite()).collect();
        let darker = all.len() / DARKER;
        let (_, least, _) = all.select_nth_unstable_by(darker, f32::total_cmp);
        let deviation = deviation.max((mean - f64::from(*least)) / CLEAR);
        (mean.abs() < DARKEST && deviation < NOISIEST).then_some(Self { mean, deviation })
    }
}

/// Takes the parts of a photograph's silhouette out that have hardly any of its light: clipping and coding of noise
/// leave specks, which would keep empty space around the medium. Pixels that are not finite stay.
pub(crate) fn without_specks(opacity: &Plane<'_>, shown: &[bool], background: f64) -> Vec<bool> {
    let light = |i: usize| (f64::from(opacity.values[i]) - background).max(0.0);
    let finite = |i: &usize| opacity.values[*i].is_finite();
    let total: f64 = (0..shown.len()).filter(|i| shown[*i]).filter(finite).map(light).sum();
    let mut kept = shown.to_vec();
    let mut seen: Vec<bool> = shown.iter().map(|shown| !shown).collect();
    let (width, height) = (opacity.width, opacity.height());
    for first in 0..shown.len() {
        if std::mem::replace(&mut seen[first], true) {
            continue;
        }
        let (mut part, mut next) = (vec![first], 0);
        while let Some(&i) = part.get(next) {
            next += 1;
            let (x, y) = (i % width, i / width);
            let rows = y.saturating_sub(1)..(y + 2).min(height);
            let around = rows.flat_map(|v| (x.saturating_sub(1)..(x + 2).min(width)).map(move |u| v * width + u));
            part.extend(around.filter(|k| !std::mem::replace(&mut seen[*k], true)));
        }
        if part.iter().copied().filter(finite).map(light).sum::<f64>() < SPECK * total {
            part.into_iter().filter(finite).for_each(|i| kept[i] = false);
        }
    }
    kept
}

/// Returns true for each pixel that shows something, and for each that is not finite, since it says nothing.
///
/// Squares grow from one pixel on, and leave out what smaller ones have found: an edge would else be seen from afar.
pub(crate) fn silhouette(opacity: &Plane<'_>, empty: EmptyPixels) -> Vec<bool> {
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
    widened(opacity, &left.iter().map(|v| !v.is_finite()).collect::<Vec<_>>())
}

/// Adds a margin of a few pixels to those that are found in a picture.
pub(crate) fn widened(opacity: &Plane<'_>, found: &[bool]) -> Vec<bool> {
    let found: Vec<f32> = found.iter().map(|found| f32::from(u8::from(*found))).collect();
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A dense disk whose edge fades, before a background of the given opacities.
    fn picture(background: impl Fn(usize) -> f32) -> Vec<f32> {
        let pixel = |i: usize| {
            let (x, y) = ((i % 64) as f32 - 32.0, (i / 64) as f32 - 32.0);
            background(i) + (1.0 - (x * x + y * y) / 400.0).max(0.0)
        };
        (0..64 * 64).map(pixel).collect()
    }

    fn from_border(values: &[f32]) -> Option<EmptyPixels> {
        EmptyPixels::from_border(&Plane { width: 64, values })
    }

    #[test]
    fn black_is_what_the_border_shows() {
        let level = 0.0003;
        // A level of black, and in a fifth of the pixels one more or less.
        let coded = picture(|i| level * [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 0.0][i * 7919 % 10]);
        let empty = from_border(&coded).unwrap_or(EmptyPixels { mean: 0.0, deviation: 0.0 });
        assert!((empty.mean - 0.0003).abs() < 1e-5 && (empty.deviation / 0.0003 - 0.447).abs() < 0.02, "{empty:?}");
        let shown = silhouette(&Plane { width: 64, values: &coded }, empty);
        let disk = picture(|_| 0.0);
        let wide = |i: usize| ((i % 64) as f32 - 32.0).hypot((i / 64) as f32 - 32.0) < 28.0;
        assert!((0..64 * 64).all(|i| (disk[i] <= 0.01 || shown[i]) && (!shown[i] || wide(i))));
        // One level all around has no deviation but roundings.
        let even = from_border(&picture(|_| 0.0003)).map(|e| (e.mean as f32, e.deviation as f32));
        assert_eq!(even, Some((0.0003, ROUNDING)));
    }

    #[test]
    fn specks_have_hardly_any_light() {
        let mut values = picture(|_| 0.0);
        // One is all but dark, one as bright as a hundredth of the disk, and one says nothing.
        values[3 * 64 + 3] = 0.2;
        (0..9).for_each(|i| values[(2 + i / 3) * 64 + 58 + i % 3] = 0.9);
        values[60 * 64 + 2] = f32::NAN;
        let plane = Plane { width: 64, values: &values };
        let shown: Vec<bool> = values.iter().map(|v| v.is_nan() || *v > 0.0).collect();
        let kept = without_specks(&plane, &shown, 0.0);
        let lost: Vec<usize> = (0..64 * 64).filter(|i| shown[*i] && !kept[*i]).collect();
        assert_eq!(lost, [3 * 64 + 3]);
    }

    #[test]
    fn a_border_that_shows_the_medium_tells_nothing() {
        assert_eq!(from_border(&picture(|i| (i % 64) as f32 / 64.0)), None);
        assert_eq!(from_border(&picture(|_| 0.5)), None, "an even haze is no black");
        // A frame that is lighter than what lies inside is no background.
        assert_eq!(from_border(&picture(|i| if (2..62).contains(&(i % 64)) { -0.5 } else { 0.001 })), None);
    }
}
