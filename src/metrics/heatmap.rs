//! Difference pictures in a color map of rising lightness.

use crate::scene::film::Film;

/// Stops of the color map in sRGB, evenly spaced, from near black through violet, magenta and orange to pale yellow.
/// Their CIE lightness rises evenly from 2 to 95, so that equal steps of error look equal.
const STOPS: [[f64; 3]; 9] = [
    [7.0, 7.0, 17.0],
    [42.0, 23.0, 79.0],
    [89.0, 28.0, 128.0],
    [147.0, 37.0, 142.0],
    [209.0, 50.0, 122.0],
    [255.0, 84.0, 87.0],
    [255.0, 150.0, 61.0],
    [255.0, 200.0, 84.0],
    [254.0, 242.0, 175.0],
];

/// Heat map of the largest absolute color difference of each pixel, and the difference that its brightest color stands
/// for.
/// The heat map has three bytes per pixel. Its brightest color stands for the largest finite difference (0 for
/// identical pictures) and marks pixels that are not finite. Both films must have equal size.
pub fn difference_rgb8(a: &Film, b: &Film) -> (Vec<u8>, f64) {
    let differences = differences(a, b);
    let scale = differences.iter().copied().filter(|d| d.is_finite()).fold(0.0, f64::max);
    (shade_rgb8(&differences, scale), scale)
}

/// Largest absolute color difference of each pixel; infinite where a difference is NaN. Both films must have equal
/// size.
pub fn differences(a: &Film, b: &Film) -> Vec<f64> {
    let difference = |(p, q): (&[f32; 4], &[f32; 4])| {
        let d = (0..3).map(|c| (f64::from(p[c]) - f64::from(q[c])).abs());
        if d.clone().any(f64::is_nan) { f64::INFINITY } else { d.fold(0.0, f64::max) }
    };
    a.rgba.iter().zip(&b.rgba).map(difference).collect()
}

/// Colors of differences, three bytes each; `scale` and all larger differences have the brightest color. Pictures
/// painted with one scale can be compared with each other.
pub fn shade_rgb8(differences: &[f64], scale: f64) -> Vec<u8> {
    let shade = |d: f64| {
        if d == f64::INFINITY {
            1.0
        } else if scale > 0.0 {
            d / scale
        } else {
            0.0
        }
    };
    differences.iter().flat_map(|d| color(shade(*d))).collect()
}

/// Color of the map at `t`, which is clamped to 0..1.
fn color(t: f64) -> [u8; 3] {
    let last = STOPS.len() - 1;
    let x = t.clamp(0.0, 1.0) * last as f64;
    let i = (x as usize).min(last - 1);
    std::array::from_fn(|c| {
        let (from, to) = (STOPS[i][c], STOPS[i + 1][c]);
        (from + (to - from) * (x - i as f64) + 0.5) as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// CIE L* of an sRGB color.
    fn lightness(rgb: [u8; 3]) -> f64 {
        let linear = rgb.map(|v| {
            let v = f64::from(v) / 255.0;
            if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
        });
        let y = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
        if y > 0.008_856 { 116.0 * y.cbrt() - 16.0 } else { 903.3 * y }
    }

    #[test]
    fn lightness_rises_evenly() {
        let steps: Vec<f64> = (0..9).map(|i| lightness(color(f64::from(i) / 8.0))).collect();
        for (i, pair) in steps.windows(2).enumerate() {
            // Even steps are 93/8; each stop is rounded to whole bytes, worth up to 0.5 each.
            assert!((pair[1] - pair[0] - 93.0 / 8.0).abs() < 1.0, "step {i}: {steps:?}");
        }
    }

    #[test]
    fn the_largest_difference_is_the_brightest() {
        let mut a = Film::new(4, 1);
        a.rgba[1] = [0.5, 0.0, 0.0, 0.0];
        a.rgba[2] = [0.0, -1.0, 0.0, 0.0];
        a.rgba[3] = [f32::NAN, 0.0, 0.0, 0.0];
        let (rgb, scale) = difference_rgb8(&a, &Film::new(4, 1));
        assert_eq!(scale, 1.0);
        assert_eq!(rgb[..3], [7, 7, 17]);
        assert_eq!(rgb[3..6], [209, 50, 122]);
        assert_eq!((&rgb[6..9], &rgb[9..]), (&[254, 242, 175][..], &[254, 242, 175][..]));
        assert_eq!(difference_rgb8(&a, &a).1, 0.0);
    }
}
