//! Values as displays show them: sRGB (IEC 61966-2-1).

use super::film::Film;

/// Returns the display value of a scene-linear one, without clipping.
pub fn value(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// Returns the display values of a film's colors over black, clipped to 0..1. Numbers that are not finite, alpha and
/// the other planes stay as they are.
pub fn film(linear: &Film) -> Film {
    let mut to = linear.clone();
    for [colors @ .., _] in &mut to.rgba {
        for color in colors.iter_mut().filter(|color| color.is_finite()) {
            *color = value(color.clamp(0.0, 1.0));
        }
    }
    to
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_clipped_and_curved() {
        // 0.214 041 14 is sRGB 0.5.
        let shown = film(&Film::of(2, 1, vec![[0.0, 1.0, 0.214_041_14, 0.3], [-3.0, 7.0, f32::NAN, 2.0]]));
        let [[black, white, half, alpha], [below, above, missing, more]] = shown.rgba[..] else { unreachable!() };
        assert_eq!((black, alpha, below, more), (0.0, 0.3, 0.0, 2.0));
        assert!((white - 1.0).abs() < 1e-6 && (above - 1.0).abs() < 1e-6 && (half - 0.5).abs() < 1e-6);
        assert!(missing.is_nan());
    }
}
