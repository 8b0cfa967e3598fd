//! Opacity between two knots, with VTK's midpoint and sharpness (`vtkPiecewiseFunction`).

/// An opacity knot: density, opacity, and the midpoint and sharpness of the piece that begins there.
pub(super) type OpacityKnot = [f64; 4];

/// Opacity at `s`, from 0 to 1, between two knots. `middle` is the middle of the sub-piece being sampled; where the
/// curve jumps at its midpoint, it decides the side.
///
/// Half of the change is reached at the midpoint. Sharpness 0 (below 0.01) is linear on either side of it, 1 (above
/// 0.99) a step there; between them the curve is a Hermite curve over a power of `s`.
pub(super) fn between(s: f64, middle: f64, from: &OpacityKnot, to: &OpacityKnot) -> f64 {
    let [_, a, midpoint, sharpness] = *from;
    let b = to[1];
    let midpoint = clamped(midpoint);
    if sharpness > 0.99 {
        return if middle < midpoint { a } else { b };
    }
    // The ends are exact to the last bit, so that neighbouring pieces meet.
    if s <= 0.0 || a == b {
        return a;
    }
    if s >= 1.0 {
        return b;
    }
    let t = if s < midpoint { 0.5 * s / midpoint } else { 0.5 + 0.5 * (s - midpoint) / (1.0 - midpoint) };
    if sharpness < 0.01 {
        return (1.0 - t) * a + t * b;
    }
    let power = 1.0 + 10.0 * sharpness;
    let t = if t < 0.5 { 0.5 * (2.0 * t).powf(power) } else { 1.0 - 0.5 * (2.0 * (1.0 - t)).powf(power) };
    let (t2, t3) = (t * t, t * t * t);
    let rise = -2.0 * t3 + 3.0 * t2;
    let value = (1.0 - rise) * a + rise * b + (2.0 * t3 - 3.0 * t2 + t) * (1.0 - sharpness) * (b - a);
    value.clamp(a.min(b), a.max(b))
}

/// Position between two knots, from 0 to 1, of a kink or a step of the curve.
pub(super) fn kink(from: &OpacityKnot) -> Option<f64> {
    let [_, _, midpoint, sharpness] = *from;
    (midpoint != 0.5 || sharpness >= 0.01).then(|| clamped(midpoint))
}

/// Clamps a midpoint to the distance from the ends that VTK keeps.
fn clamped(midpoint: f64) -> f64 {
    midpoint.clamp(1e-5, 1.0 - 1e-5)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Expected values are those of VTK 9.7.2's `vtkPiecewiseFunction::GetValue`, rounded to seven digits.
    #[test]
    fn curves_are_those_of_vtk() {
        let at = [0.1, 0.25, 0.3, 0.5, 0.6, 0.9];
        for (midpoint, sharpness, expected) in [
            (0.5, 0.0, [0.18, 0.3, 0.34, 0.5, 0.58, 0.82]),
            (0.3, 0.0, [0.233_333_3, 0.433_333_3, 0.5, 0.614_285_7, 0.671_428_6, 0.842_857_1]),
            (0.5, 0.5, [0.100_012_8, 0.103_197_9, 0.109_974_1, 0.5, 0.828_756_8, 0.899_987_2]),
            (0.7, 0.2, [0.100_934, 0.114_822_5, 0.125_913_6, 0.230_619_3, 0.339_115, 0.887_985_6]),
        ] {
            for (s, expected) in at.iter().zip(expected) {
                let got = between(*s, *s, &[0.0, 0.1, midpoint, sharpness], &[1.0, 0.9, 0.5, 0.0]);
                assert!((got - expected).abs() < 1e-7, "{midpoint} {sharpness} at {s}: {got} {expected}");
            }
        }
    }

    #[test]
    fn full_sharpness_is_a_step_at_the_midpoint() {
        let (from, to) = ([0.0, 0.1, 0.25, 1.0], [1.0, 0.9, 0.5, 0.0]);
        assert_eq!(kink(&from), Some(0.25));
        assert_eq!(between(0.25, 0.1, &from, &to), 0.1, "the lower side");
        assert_eq!(between(0.25, 0.6, &from, &to), 0.9, "the upper side");
        assert_eq!(kink(&[0.0, 0.1, 0.5, 0.0]), None);
    }
}
