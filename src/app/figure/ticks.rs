//! Round numbers: ticks of an axis, and lengths of scale bars.

/// Returns the round numbers of a range: multiples of 1, 2 or 5 times a power of ten, about `wanted` of them.
pub(super) fn ticks([low, high]: [f64; 2], wanted: usize) -> Vec<f64> {
    let span = high - low;
    if !(span > 0.0 && span.is_finite()) {
        return vec![low];
    }
    let step = above(span / wanted.max(1) as f64);
    // Numbers that rounding has moved beyond an end are ticks, too.
    let slack = 1e-9 * span;
    let (first, last) = (((low - slack) / step).ceil(), ((high + slack) / step).floor());
    // Divided rather than multiplied where steps are below 1: 3 / 10 is 0.3, and 3 * 0.1 is not.
    let number = |i: f64| if step < 1.0 { i / (1.0 / step).round() } else { i * step };
    let count = (last - first) as usize;
    (0..=count).map(|i| number(first + i as f64) + 0.0).collect()
}

/// Smallest of 1, 2 and 5 times a power of ten that is not below a positive number.
fn above(value: f64) -> f64 {
    let power = 10_f64.powf(value.log10().floor());
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|v| *v >= value * (1.0 - 1e-9)).unwrap_or(10.0 * power)
}

/// Largest of 1, 2 and 5 times a power of ten that is not above a positive number.
pub(super) fn below(value: f64) -> f64 {
    let power = 10_f64.powf(value.log10().floor());
    [5.0, 2.0, 1.0].into_iter().map(|m| m * power).find(|v| *v <= value * (1.0 + 1e-9)).unwrap_or(power)
}

/// Writes a number as figures have it: without digits that say nothing, with a minus sign, and with a power of ten
/// where it is large or small.
pub(super) fn number(value: f64) -> String {
    let size = value.abs();
    let plain = |v: f64| format!("{v:.6}").trim_end_matches('0').trim_end_matches('.').to_owned();
    let text = if value == 0.0 {
        "0".to_owned()
    } else if (1e-3..1e5).contains(&size) {
        let digits = (5 - size.log10().floor() as i32).max(0) as usize;
        let text = format!("{value:.digits$}");
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
    } else {
        let exponent = size.log10().floor() as i32;
        let mantissa = plain(value / 10_f64.powi(exponent));
        let power = format!("10{}", superscript(exponent));
        if mantissa == "1" { power } else { format!("{mantissa}×{power}") }
    };
    text.replace('-', "\u{2212}")
}

fn superscript(exponent: i32) -> String {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let of = |c: char| c.to_digit(10).map_or('⁻', |digit| DIGITS[digit as usize]);
    exponent.to_string().chars().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_within_the_range() {
        assert_eq!(ticks([0.0, 1.0], 5), [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]);
        assert_eq!(ticks([-1024.0, 3071.0], 5), [-1000.0, 0.0, 1000.0, 2000.0, 3000.0]);
        assert_eq!(ticks([0.03, 0.34], 4), [0.1, 0.2, 0.3]);
        assert_eq!(ticks([-3e-7, 3e-7], 4).len(), 3);
        assert_eq!(ticks([2.0, 2.0], 4), [2.0]);
        for span in [1e-12, 0.7, 3.0, 98.0, 5e9] {
            let found = ticks([-0.3 * span, span], 5);
            assert!((2..=8).contains(&found.len()), "{span}: {found:?}");
        }
    }

    #[test]
    fn lengths_are_one_two_or_five() {
        let found = [1.0, 1.99, 2.0, 4.9, 73.0, 0.034, 1e-9].map(below);
        assert_eq!(found.map(|v| format!("{v:e}")), ["1e0", "1e0", "2e0", "2e0", "5e1", "2e-2", "1e-9"]);
    }

    #[test]
    fn numbers_are_short() {
        let shown = [0.0, -200.0, 0.1 + 0.2, 2.5, 1e5, -3e-7, 12_345.0, 2.5e6].map(number);
        assert_eq!(shown, ["0", "−200", "0.3", "2.5", "10⁵", "−3×10⁻⁷", "12345", "2.5×10⁶"]);
    }
}
