//! Flicker: how far a sequence changes from frame to frame otherwise than its reference does.

use crate::scene::film::Film;

/// Returns the mean squared error of the change from one frame to the next, over pixels and color channels:
/// `(a₁ - a₀) - (b₁ - b₀)` for the sequence a and its reference b. Pixels that are not finite in one of the four are
/// left out.
pub fn error([a0, a1]: [&Film; 2], [b0, b1]: [&Film; 2]) -> f64 {
    let pixels = a0.rgba.iter().zip(&a1.rgba).zip(b0.rgba.iter().zip(&b1.rgba));
    let (mut sum, mut count) = (0.0, 0_u64);
    for ((p, q), (r, s)) in pixels {
        let change = |c: usize| (f64::from(q[c]) - f64::from(p[c])) - (f64::from(s[c]) - f64::from(r[c]));
        let square = (0..3).map(change).map(|v| v * v).sum::<f64>();
        if square.is_finite() {
            sum += square;
            count += 3;
        }
    }
    sum / count.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(value: f32) -> Film {
        Film::of(4, 2, vec![[value, value, value, 1.0]; 8])
    }

    #[test]
    fn only_changes_that_the_reference_does_not_make_count() {
        let films = [0.0, 0.25, 0.5, 0.75].map(grey);
        let [a, b, c, d] = &films;
        assert_eq!(error([a, b], [c, d]), 0.0);
        assert_eq!(error([a, c], [a, b]), 0.0625);
        let mut missing = grey(0.5);
        missing.rgba[3][1] = f32::NAN;
        assert_eq!(error([a, &missing], [a, b]), 0.0625);
    }
}
