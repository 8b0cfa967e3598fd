//! Steps between the values of a file and those of a grid: scale and offset, a range that becomes 0 to 1, a threshold.

/// Steps that every value goes through, in this order. All are of scalars.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mapping {
    /// Factor of the value.
    pub scale: f64,
    /// Offset that is added afterwards.
    pub offset: f64,
    /// Values that become 0 and 1; what lies outside is clamped.
    pub range: Option<[f64; 2]>,
    /// Values at or below it become 0, the background.
    pub threshold: Option<f64>,
}

impl Default for Mapping {
    /// No step at all.
    fn default() -> Self {
        Self { scale: 1.0, offset: 0.0, range: None, threshold: None }
    }
}

/// Range of the values of a grid, and share of them that a threshold removed.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, schemars::JsonSchema)]
pub struct Tally {
    /// Smallest finite value, the background's 0 included if a voxel has it.
    pub least: Option<f64>,
    /// Largest finite value.
    pub greatest: Option<f64>,
    /// Number of values that are NaN or infinite.
    pub non_finite: u64,
    /// Number of values other than 0 that the threshold made background.
    pub removed: u64,
    /// Largest value that the threshold made background.
    pub removed_greatest: Option<f64>,
    /// Share of the sum of all magnitudes that the threshold removed.
    pub removed_share: f64,
    /// Number of whole numbers beyond 2²⁴ that the grid's 32-bit floats round.
    pub rounded: u64,
    /// Number of finite values that become infinite as 32-bit floats.
    pub overflowed: u64,
    /// Number of values other than 0 that become 0 as 32-bit floats.
    pub vanished: u64,
    #[serde(skip)]
    removed_sum: f64,
    #[serde(skip)]
    sum: f64,
}

impl Mapping {
    /// True if integers stay integers.
    pub(crate) fn keeps_integers(&self) -> bool {
        self.scale.fract() == 0.0 && self.offset.fract() == 0.0 && self.range.is_none()
    }

    /// True if values pass unchanged.
    pub(crate) fn is_identity(&self) -> bool {
        *self == Self::default()
    }

    /// Value after scale, offset and range. What is NaN stays so.
    pub fn mapped(&self, value: f64) -> f64 {
        let value = if self.scale == 1.0 && self.offset == 0.0 { value } else { value * self.scale + self.offset };
        match self.range {
            Some([low, high]) => ((value - low) / (high - low)).clamp(0.0, 1.0),
            None => value,
        }
    }

    /// Takes values through the steps, and counts them.
    pub fn apply(&self, values: &mut [f64], tally: &mut Tally) {
        for value in values {
            let found = self.mapped(*value);
            let removed = self.threshold.is_some_and(|t| found <= t);
            // No negative zero, which would stay apart from the background in a file.
            *value = if removed { 0.0 } else { found + 0.0 };
            tally.removed += u64::from(removed && found != 0.0);
            if found.is_finite() {
                tally.sum += found.abs();
                if removed && found != 0.0 {
                    tally.removed_sum += found.abs();
                    tally.removed_greatest = Some(tally.removed_greatest.map_or(found, |g| g.max(found)));
                }
            } else if !removed {
                tally.non_finite += 1;
                continue;
            }
            tally.least = Some(tally.least.map_or(*value, |l| l.min(*value)));
            tally.greatest = Some(tally.greatest.map_or(*value, |g| g.max(*value)));
        }
        tally.removed_share = if tally.sum > 0.0 { tally.removed_sum / tally.sum } else { 0.0 };
    }
}

/// Largest magnitude below which doubles hold every whole number; beyond it they are no counts or labels.
const MOST_WHOLE: f64 = 9_007_199_254_740_992.0;

impl Tally {
    /// Counts the values that a grid of 32-bit floats cannot hold. Fractions that are rounded are not counted: that is
    /// what such a grid is chosen for.
    pub(crate) fn count_singles(&mut self, values: &[f64]) {
        for value in values.iter().filter(|v| v.is_finite()) {
            let single = *value as f32;
            if f64::from(single) == *value {
                continue;
            }
            if single.is_infinite() {
                self.overflowed += 1;
            } else if single == 0.0 {
                self.vanished += 1;
            } else if value.fract() == 0.0 && value.abs() <= MOST_WHOLE {
                self.rounded += 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_follow_each_other_and_losses_are_counted() {
        let mapping = Mapping { scale: 2.0, offset: -1000.0, range: Some([-1000.0, 1000.0]), threshold: Some(0.25) };
        let mut values = [0.0, 200.0, 250.0, 500.0, 5000.0, -9.0, f64::NAN];
        let mut tally = Tally::default();
        mapping.apply(&mut values, &mut tally);
        assert_eq!(values[..6], [0.0, 0.0, 0.0, 0.5, 1.0, 0.0]);
        assert!(values[6].is_nan());
        assert_eq!((tally.least, tally.greatest, tally.non_finite), (Some(0.0), Some(1.0), 1));
        assert_eq!((tally.removed, tally.removed_greatest), (2, Some(0.25)));
        // 0.2 + 0.25 of 0.2 + 0.25 + 0.5 + 1; a sum of four terms errs by a few units in the last place.
        assert!((tally.removed_share - 0.45 / 1.95).abs() < 1e-15);
        assert!(Mapping { threshold: Some(1.0), ..Mapping::default() }.keeps_integers() && !mapping.keeps_integers());
        let mut same = [-0.0, 3.5];
        Mapping::default().apply(&mut same, &mut Tally::default());
        assert!(same[0].is_sign_positive() && same[1] == 3.5);
    }

    #[test]
    fn infinite_values_below_the_threshold_are_background_too() {
        let mut values = [f64::NEG_INFINITY, f64::INFINITY, 2.0, 1.0, f64::NAN];
        let mut tally = Tally::default();
        Mapping { threshold: Some(1.5), ..Mapping::default() }.apply(&mut values, &mut tally);
        assert_eq!(values[..4], [0.0, f64::INFINITY, 2.0, 0.0]);
        assert_eq!((tally.non_finite, tally.removed, tally.removed_greatest), (2, 2, Some(1.0)));
        assert_eq!((tally.least, tally.greatest), (Some(0.0), Some(2.0)));
        // 1 of 1 + 2: finite numbers alone have a sum.
        assert_eq!(tally.removed_share, 1.0 / 3.0);
    }

    #[test]
    fn what_single_precision_cannot_hold_is_counted() {
        let mut tally = Tally::default();
        tally.count_singles(&[
            0.1,
            16_777_216.0,
            16_777_217.0,
            -33_554_435.0,
            1e300,
            -1e-50,
            f64::NAN,
            f64::INFINITY,
            1e20,
        ]);
        assert_eq!((tally.rounded, tally.overflowed, tally.vanished), (2, 1, 1));
    }
}
