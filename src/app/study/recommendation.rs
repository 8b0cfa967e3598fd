//! The setting for a wanted error or time.

use super::measurement::Measurement;
use crate::report::short;
use serde::{Deserialize, Serialize};
use std::fmt;

/// The setting that is recommended for an error or a time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct Recommendation {
    /// Error that is not to be exceeded, in units of the reference's root mean square.
    pub error_at_most: Option<f64>,
    /// Seconds that are not to be exceeded.
    pub seconds_at_most: Option<f64>,
    /// Options of the cheapest setting for that error, or the most accurate one for that time; none if no setting that
    /// was measured is as accurate or as fast.
    pub options: Option<String>,
    /// Command with these options.
    pub command: Option<String>,
    /// Error of the setting in words.
    pub error: Option<String>,
    /// Median of the seconds of the setting.
    pub seconds: Option<f64>,
}

impl Recommendation {
    /// Recommends the cheapest setting whose error does not exceed `error`, its interval included.
    pub(super) fn of_error(error: f64, all: &[Measurement]) -> Self {
        let reaches = |m: &&Measurement| m.seconds.is_some() && m.at_most().is_some_and(|most| most <= error);
        let time = |m: &Measurement| m.seconds.unwrap_or(f64::INFINITY);
        let best = all.iter().filter(reaches).min_by(|a, b| time(a).total_cmp(&time(b)));
        Self { error_at_most: Some(error), ..Self::of(best) }
    }

    /// Recommends the most accurate setting that takes no longer than `seconds`; of several, the fastest.
    pub(super) fn of_seconds(seconds: f64, all: &[Measurement]) -> Self {
        let within = all.iter().filter_map(|m| Some((m, m.point()?))).filter(|(_, (time, _))| *time <= seconds);
        let best = within.min_by(|(_, a), (_, b)| a.1.total_cmp(&b.1).then(a.0.total_cmp(&b.0)));
        Self { seconds_at_most: Some(seconds), ..Self::of(best.map(|(m, _)| m)) }
    }

    fn of(best: Option<&Measurement>) -> Self {
        Self {
            error_at_most: None,
            seconds_at_most: None,
            options: best.map(|m| m.options.clone()),
            command: best.map(|m| m.command.clone()),
            error: best.map(Measurement::error_in_words),
            seconds: best.and_then(|m| m.seconds),
        }
    }

    /// Wanted error or time, in words.
    pub(super) fn wanted(&self) -> String {
        match (self.error_at_most, self.seconds_at_most) {
            (Some(error), _) => format!("error at most {error}"),
            (None, seconds) => format!("at most {} s", seconds.unwrap_or_default()),
        }
    }

    /// Error and time that the setting reaches, in words.
    pub(super) fn reached(&self) -> String {
        match (&self.error, self.seconds) {
            (Some(error), Some(seconds)) => format!("error {error} in {} s", short(seconds)),
            _ => "no setting that was measured reaches it".into(),
        }
    }
}

impl fmt::Display for Recommendation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let options = self.options.as_deref().map(|options| format!("{options}, ")).unwrap_or_default();
        write!(f, "{}: {options}{}", self.wanted(), self.reached())
    }
}
