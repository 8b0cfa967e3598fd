//! What was measured of a setting.

use super::candidate::Candidate;
use super::errors::Errors;
use super::reference::Reference;
use super::run::Run;
use crate::metrics::interval;
use serde::{Deserialize, Serialize};

/// Measured error and time of a setting. Errors are in units of the reference's root mean square.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct Measurement {
    /// Options of the setting.
    pub options: String,
    /// Group of settings that it is one of, such as those of one quadrature.
    pub group: String,
    /// Command that does the work with this setting.
    pub command: String,
    /// True if runs have random numbers of their own: the error is a mean over the runs then.
    pub random: bool,
    /// Root mean square error; none where it is below the uncertainty of the reference, or nothing was measured yet.
    pub error: Option<f64>,
    /// Uncertainty of the reference, where the error is below it.
    pub error_below: Option<f64>,
    /// Interval of the error: of settings with random numbers that of the mean with 95 % confidence, else the error
    /// with the uncertainty of the reference on both sides.
    pub error_interval: Option<[f64; 2]>,
    /// Error that 99 % of the pixels or parameters stay below, the mean over the runs.
    pub percentile_99: Option<f64>,
    /// Largest error, the mean over the runs.
    pub largest: Option<f64>,
    /// Median of the seconds of the runs.
    pub seconds: Option<f64>,
    /// Fewest and most seconds of the runs.
    pub seconds_range: Option<[f64; 2]>,
    /// Quartiles of the seconds of the runs.
    pub seconds_quartiles: Option<[f64; 2]>,
    /// True if no other setting is as accurate in as little time.
    pub on_front: bool,
    /// Runs, in the order in which they were measured.
    pub runs: Vec<Run>,
}

impl Measurement {
    /// Returns a setting of which nothing was measured yet, but for the runs that an earlier study has left.
    pub(super) fn new(candidate: &Candidate<'_>, earlier: &[Self]) -> Self {
        let runs = earlier.iter().find(|other| other.options == candidate.options).map(|other| other.runs.clone());
        Self {
            options: candidate.options.clone(),
            group: candidate.group.clone(),
            command: candidate.command.clone(),
            random: candidate.random,
            error: None,
            error_below: None,
            error_interval: None,
            percentile_99: None,
            largest: None,
            seconds: None,
            seconds_range: None,
            seconds_quartiles: None,
            on_front: false,
            runs: runs.unwrap_or_default(),
        }
    }

    /// Computes the figures of the runs.
    pub(super) fn summarise(&mut self, reference: &Reference) {
        let mut seconds: Vec<f64> = self.runs.iter().map(|run| run.seconds).collect();
        seconds.sort_unstable_by(f64::total_cmp);
        let [Some(first), Some(last)] = [seconds.first(), seconds.last()] else { return };
        self.seconds_range = Some([*first, *last]);
        let n = seconds.len();
        self.seconds = Some(quantile(&seconds, 0.5));
        self.seconds_quartiles = Some([quantile(&seconds, 0.25), quantile(&seconds, 0.75)]);
        let uncertainty = reference.uncertainty;
        // The noise of the reference adds to that of a run, and is no error of the setting.
        let noise = if reference.random { uncertainty } else { 0.0 };
        let own = |run: &Run| (run.errors.rms.powi(2) - noise.powi(2)).max(0.0).sqrt();
        let errors: Vec<f64> = self.runs.iter().map(own).collect();
        let (mean, interval) = interval::of_mean(&errors);
        self.error_interval = match self.random {
            true => interval.map(|[low, high]| [low.max(0.0), high]),
            false => Some([(mean - uncertainty).max(0.0), mean + uncertainty]),
        };
        self.error = (mean >= uncertainty).then_some(mean);
        self.error_below = (mean < uncertainty).then_some(uncertainty);
        let mean = |of: fn(&Errors) -> f64| Some(self.runs.iter().map(|run| of(&run.errors)).sum::<f64>() / n as f64);
        self.percentile_99 = mean(|errors| errors.percentile_99);
        self.largest = mean(|errors| errors.largest);
    }

    /// Error that is certain not to be exceeded: the upper end of the interval, or the uncertainty of the reference
    /// where the error is below it; none where nothing was measured.
    pub(super) fn at_most(&self) -> Option<f64> {
        self.error_below.or(self.error_interval.map(|[_, high]| high)).or(self.error)
    }

    /// Time and error as a point of a plane; none where nothing was measured.
    pub(super) fn point(&self) -> Option<(f64, f64)> {
        Some((self.seconds?, self.error.or(self.error_below)?))
    }

    /// Error in words: a number, or what it is below.
    pub(super) fn error_in_words(&self) -> String {
        match (self.error, self.error_below) {
            (Some(error), _) => format!("{error:.2e}"),
            (None, Some(below)) => format!("below {below:.1e}"),
            (None, None) => "not measured".into(),
        }
    }
}

/// Returns the number below which this share of the sorted ones lies, between neighbours on the line that joins them.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let at = share * sorted.len().saturating_sub(1) as f64;
    let of = |i: f64| sorted.get(i as usize).copied().unwrap_or_default();
    of(at.floor()) + at.fract() * (of(at.ceil()) - of(at.floor()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured(random: bool, errors: &[f64], uncertainty: f64) -> Measurement {
        let run = |rms: &f64| Run { seconds: *rms, errors: Errors { rms: *rms, percentile_99: 1.0, largest: 2.0 } };
        let none = |_: u32, _: &crate::cancel::Cancel| Ok(None);
        let candidate =
            Candidate { options: "--a".into(), group: "g".into(), command: "c".into(), random, run: Box::new(none) };
        let mut measurement = Measurement::new(&candidate, &[]);
        measurement.runs = errors.iter().map(run).collect();
        let (options, method) = (String::new(), String::new());
        measurement.summarise(&Reference { options, method, uncertainty, random, seconds: 0.0 });
        measurement
    }

    #[test]
    fn errors_below_the_uncertainty_are_no_numbers() {
        let m = measured(false, &[0.5, 0.5, 0.5, 0.5], 0.1);
        assert_eq!((m.error, m.error_below, m.error_interval), (Some(0.5), None, Some([0.4, 0.6])));
        assert_eq!((m.at_most(), m.seconds, m.largest), (Some(0.6), Some(0.5), Some(2.0)));
        let m = measured(false, &[0.05], 0.1);
        assert_eq!((m.error, m.error_below, m.at_most()), (None, Some(0.1), Some(0.1)));
        assert_eq!(m.error_in_words(), "below 1.0e-1");
        assert_eq!(measured(false, &[], 0.1).at_most(), None);
    }

    #[test]
    fn quantiles_lie_between_neighbours() {
        let of = |share| quantile(&[1.0, 2.0, 3.0, 5.0], share);
        assert_eq!([0.0, 0.25, 0.5, 1.0].map(of), [1.0, 1.75, 2.5, 5.0]);
        assert_eq!(quantile(&[7.0], 0.25), 7.0);
    }

    #[test]
    fn the_noise_of_the_reference_is_no_error_of_a_setting() {
        let m = measured(true, &[0.5, 0.5], 0.3);
        assert!((m.error.unwrap_or_default() - 0.4).abs() < 1e-12, "{m:?}");
        assert_eq!(measured(true, &[0.3, 0.29], 0.3).error_below, Some(0.3));
    }
}
