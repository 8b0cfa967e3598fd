//! Whether a volume's values and its transfer function go together: a function of Hounsfield units shows little of a
//! volume whose values run from 0 to 1, and one of densities from 0 to 1 shows a scan as one solid block.

use super::Warning;
use crate::formats::transfer;
use crate::scene::bricks::Bricks;
use crate::scene::transfer::Transfer;

/// Least share of a function's range that values are expected to span.
const LEAST_OF_FUNCTION: f64 = 0.1;
/// Least share of the values' range that a function is expected to cover.
const LEAST_OF_VALUES: f64 = 0.01;

/// Returns a warning if the values of a field and the range of its function, in this unit, do not meet, or nearly so.
pub(crate) fn unmet(field: &Bricks<f32>, transfer: &Transfer, unit: &str) -> Option<Warning> {
    let values = field.seen_range();
    let range = transfer::range(transfer);
    let words = found(values, range)?;
    let name = |value: f64| (value as f32).to_string();
    let ([low, high], [first, last]) = (values.map(name), range);
    let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
    let what =
        format!("the volume's values, {low} to {high}, {words} the transfer function's range, {first} to {last}{unit}");
    let moves = format!("⟨tf_range={low},{high}⟩ moves the function to the values; leave it if both have one unit");
    Some(Warning::new(what, moves))
}

/// Returns how values lie about a range that they do not fit.
fn found([low, high]: [f64; 2], [first, last]: [f64; 2]) -> Option<String> {
    // One value, or one point, spans nothing of anything.
    if !(low < high && first < last) {
        return None;
    }
    let common = high.min(last) - low.max(first);
    let (of_function, of_values) = (common / (last - first), common / (high - low));
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    match () {
        () if common <= 0.0 => Some("lie outside of".into()),
        () if of_function < LEAST_OF_FUNCTION => Some(format!("span {} of", percent(of_function))),
        () if of_values < LEAST_OF_VALUES => Some(format!("lie by {} alone within", percent(of_values))),
        () => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_that_do_not_meet_are_told_in_both_directions() {
        let hounsfield = [-1024.0, 3071.0];
        assert_eq!(found([0.0, 254.0], hounsfield).as_deref(), Some("span 6.2 % of"));
        assert_eq!(found([0.0, 1.0], hounsfield).as_deref(), Some("span 0.0 % of"));
        assert_eq!(found([-1000.0, 1900.0], [0.0, 1.0]).as_deref(), Some("lie by 0.0 % alone within"));
        assert_eq!(found([2.0, 3.0], [0.0, 1.0]).as_deref(), Some("lie outside of"));
        assert_eq!(found([-1000.0, 1900.0], hounsfield), None);
        assert_eq!(found([-1000.0, 1000.0], [200.0, 400.0]), None, "a window of the values");
        assert_eq!(found([0.0, 0.4], [0.0, 1.0]), None);
        assert_eq!(found([0.0, 0.0], [0.0, 1.0]), None);
    }
}
