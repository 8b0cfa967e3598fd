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

/// How values lie about the range of a function that they do not fit.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Misfit {
    /// None lies in it.
    Outside,
    /// They span this share of it.
    Narrow(f64),
    /// It covers this share of them.
    Wide(f64),
}

/// Returns a warning if the values of a field and the range of its function, in this unit, do not meet, or nearly so.
pub(crate) fn unmet(field: &Bricks<f32>, transfer: &Transfer, unit: &str) -> Option<Warning> {
    if transfer.is_of_labels() {
        return None;
    }
    let values = field.seen_range();
    let range @ [first, last] = transfer::range(transfer);
    let misfit = misfit(values, range)?;
    let widest = values[0].abs().max(values[1].abs());
    let [low, high] = values.map(|value| (value as f32).to_string());
    let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
    let values = format!("the volume's values, {low} to {high},");
    let function = format!("the transfer function's range, {first} to {last}{unit}");
    let what = match misfit {
        Misfit::Outside => format!("{values} lie outside of {function}"),
        Misfit::Narrow(share) => format!("{values} span {} of {function}", percent(share)),
        Misfit::Wide(share) => {
            format!("{function}, covers {} of that of {}", percent(share), values.trim_end_matches(','))
        }
    };
    // What is symmetric about 0 stays so.
    let [low, high] =
        if first == -last { [-widest, widest].map(|value| (value as f32).to_string()) } else { [low, high] };
    let remedy = format!("⟨tf_range={low},{high}⟩ moves the function to the values, unless both have one unit");
    Some(Warning::new(what, remedy))
}

fn percent(share: f64) -> String {
    if share < 0.001 { "less than 0.1 %".into() } else { format!("{:.1} %", 100.0 * share) }
}

fn misfit([low, high]: [f64; 2], [first, last]: [f64; 2]) -> Option<Misfit> {
    // One value, or one point, spans nothing of anything.
    if !(low < high && first < last) {
        return None;
    }
    let common = high.min(last) - low.max(first);
    let (of_function, of_values) = (common / (last - first), common / (high - low));
    match () {
        () if common <= 0.0 => Some(Misfit::Outside),
        () if of_function < LEAST_OF_FUNCTION => Some(Misfit::Narrow(of_function)),
        () if of_values < LEAST_OF_VALUES => Some(Misfit::Wide(of_values)),
        () => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_that_do_not_meet_are_told_in_both_directions() {
        let hounsfield = [-1024.0, 3071.0];
        assert!(matches!(misfit([0.0, 254.0], hounsfield), Some(Misfit::Narrow(share)) if percent(share) == "6.2 %"));
        assert!(
            matches!(misfit([0.0, 1.0], hounsfield), Some(Misfit::Narrow(share)) if percent(share).contains("less"))
        );
        assert!(matches!(misfit([-1000.0, 1900.0], [0.0, 1.0]), Some(Misfit::Wide(_))));
        assert_eq!(misfit([2.0, 3.0], [0.0, 1.0]), Some(Misfit::Outside));
        assert_eq!(misfit([-1000.0, 1900.0], hounsfield), None);
        assert_eq!(misfit([-1000.0, 1000.0], [200.0, 400.0]), None, "a window of the values");
        assert_eq!(misfit([0.0, 0.4], [0.0, 1.0]), None);
        assert_eq!(misfit([0.0, 0.0], [0.0, 1.0]), None);
    }
}
