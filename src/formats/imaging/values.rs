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
    #[serde(skip)]
    removed_sum: f64,
    #[serde(skip)]
    sum: f64,
}

impl Mapping {
    /// True if integers stay integers.
    pub fn keeps_integers(&self) -> bool {
        self.scale.fract() == 0.0 && self.offset.fract() == 0.0 && self.range.is_none()
    }

    /// True if values pass unchanged.
    pub fn is_identity(&self) -> bool {
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
            if !found.is_finite() {
                tally.non_finite += 1;
                *value = found;
                continue;
            }
            tally.sum += found.abs();
            let removed = self.threshold.is_some_and(|t| found <= t);
            if removed && found != 0.0 {
                tally.removed += 1;
                tally.removed_sum += found.abs();
                tally.removed_greatest = Some(tally.removed_greatest.map_or(found, |g| g.max(found)));
            }
            // No negative zero, which would stay apart from the background in a file.
            *value = if removed { 0.0 } else { found + 0.0 };
            tally.least = Some(tally.least.map_or(*value, |l| l.min(*value)));
            tally.greatest = Some(tally.greatest.map_or(*value, |g| g.max(*value)));
        }
        tally.removed_share = if tally.sum > 0.0 { tally.removed_sum / tally.sum } else { 0.0 };
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
}
