//! Cubic polynomials on -1..1: extrema, and the argument of a given value. `[a, b, c, d]` is `a + b v + c v² + d
//! v³`.

/// Returns the value at `v`.
#[inline(always)]
pub(crate) fn at([a, b, c, d]: [f64; 4], v: f64) -> f64 {
    a + v * (b + v * (c + v * d))
}

/// Returns the ends of the intervals of -1..1 on which a cubic is monotone, ascending from -1; unused entries are 1.
pub(crate) fn turns([_, b, c, d]: [f64; 4]) -> [f64; 4] {
    let mut ends = [-1.0, 1.0, 1.0, 1.0];
    // Roots of b + 2 c v + 3 d v², without cancellation.
    let discriminant = c * c - 3.0 * b * d;
    if discriminant > 0.0 {
        let q = -(c + discriminant.sqrt().copysign(c));
        let (p, q) = (q / (3.0 * d), b / q);
        let mut next = 1;
        for root in [p.min(q), p.max(q)] {
            if -1.0 < root && root < 1.0 {
                ends[next] = root;
                next += 1;
            }
        }
    }
    ends
}

/// Returns the argument between `low` and `high` at which the cubic takes `value`. The cubic must be monotone there and
/// take the value. Newton's method, with bisection where a step leaves the bracket.
pub(crate) fn crossing(cubic: [f64; 4], value: f64, mut low: f64, mut high: f64) -> f64 {
    let [_, b, c, d] = cubic;
    let (at_low, at_high) = (at(cubic, low) - value, at(cubic, high) - value);
    if at_low == at_high {
        return low;
    }
    let rising = at_high > at_low;
    // The chord's crossing is a good guess.
    let mut v = low + (high - low) * (at_low / (at_low - at_high)).clamp(0.0, 1.0);
    for _ in 0..64 {
        let error = at(cubic, v) - value;
        if (error > 0.0) == rising {
            high = v;
        } else {
            low = v;
        }
        let newton = v - error / (b + v * (2.0 * c + v * 3.0 * d));
        let next = if low <= newton && newton <= high { newton } else { 0.5 * (low + high) };
        if (next - v).abs() <= 1e-14 {
            return next;
        }
        v = next;
    }
    v
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn stretches_are_monotone_and_crossings_are_found(
            cubic in prop::array::uniform4(-1.0..1.0_f64), sparse in prop::array::uniform4(any::<bool>()),
            f in 0.0..1.0_f64,
        ) {
            let cubic: [f64; 4] = std::array::from_fn(|k| if sparse[k] { 0.0 } else { cubic[k] });
            let ends = turns(cubic);
            prop_assert_eq!((ends[0], ends[3]), (-1.0, 1.0));
            for pair in ends.windows(2) {
                let (low, high) = (at(cubic, pair[0]), at(cubic, pair[1]));
                let mut last = low;
                for i in 1..=16 {
                    let value = at(cubic, pair[0] + (pair[1] - pair[0]) * f64::from(i) / 16.0);
                    prop_assert!((value - last) * (high - low).signum() > -1e-12);
                    last = value;
                }
                let value = low + f * (high - low);
                let v = crossing(cubic, value, pair[0], pair[1]);
                prop_assert!(pair[0] <= v && v <= pair[1]);
                prop_assert!((at(cubic, v) - value).abs() < 1e-12, "{cubic:?} {value}");
            }
        }
    }

    #[test]
    fn degenerate_cubics_have_no_turns() {
        for cubic in [[0.3, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 1.0, 0.0, 5.0], [0.0, 0.0, 0.0, 1.0]] {
            assert_eq!(turns(cubic), [-1.0, 1.0, 1.0, 1.0], "{cubic:?}");
        }
        assert_eq!(turns([0.0, 0.0, 1.0, 0.0]), [-1.0, 0.0, 1.0, 1.0]);
    }
}
