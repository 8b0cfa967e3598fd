//! Pictures of a wanted error, or as good as they become in a given time.

mod made;
mod measured;
mod streams;
mod work;

pub(super) use made::{Made, REPLICATES, Read, SAMPLES, SCENE, STOPPED};
pub(super) use measured::{AccuracyReport, Known, Measured, PictureError};
pub(super) use streams::Streams;

use crate::app::pictures::{EARLY_STOP, PictureSettings};
use crate::app::ranges;
use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};

/// Settings of pictures whose error is stated: of path-traced ones, in place of a number of paths; along straight rays,
/// in place of quadrature and early stop.
///
/// Errors are divided by the scale of the picture, [`scale`](crate::render::accuracy::interval::scale). Along straight
/// rays they are bounds for any channel of every pixel. Those of paths are half the width of an interval that holds the
/// expected mean radiance of a block of 8 x 8 pixels, the largest of red, green and blue. A dark block has the same
/// absolute error as a bright one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct AccuracySettings {
    /// Largest error of a pixel or a block, above 0; none for no target.
    pub target_error: Option<f64>,
    /// Seconds in which all is read, rendered and written, with the smallest error that they allow; none for no limit.
    pub time: Option<f64>,
    /// First and last of the replicates to render alone, each of as many paths as `samples` says; none for a picture
    /// that is no part of another.
    pub replicates: Option<[u32; 2]>,
    /// Probability with which a stated interval holds the truth, between 0 and 1.
    pub confidence: f64,
}

impl Default for AccuracySettings {
    fn default() -> Self {
        Self { target_error: None, time: None, replicates: None, confidence: 0.95 }
    }
}

impl AccuracySettings {
    /// True if errors are to be stated.
    pub fn on(&self) -> bool {
        self.target_error.is_some() || self.time.is_some() || self.replicates.is_some()
    }

    /// True if an error or a time decides when a picture is done.
    pub(super) fn has_goal(&self) -> bool {
        self.target_error.is_some() || self.time.is_some()
    }

    /// Refuses values out of their ranges, and settings that contradict others.
    pub(super) fn check(&self, pictures: &PictureSettings) -> Result<()> {
        let samples = pictures.scattering.samples;
        ranges::positive("target_error", self.target_error)?;
        ranges::positive("time", self.time)?;
        let confidence = self.confidence;
        ranges::probability("confidence", confidence)?;
        if self.target_error.is_some() && (pictures.quadrature.is_some() || pictures.early_stop != EARLY_STOP) {
            return Err(Error::invalid("⟨quadrature⟩ and ⟨early_stop⟩ follow from ⟨target_error⟩")
                .hint("leave them out; the report states what was chosen"));
        }
        if self.target_error.is_some() && pictures.shade.is_some() {
            return Err(Error::invalid("⟨target_error⟩: no bound is known of the error of shaded surfaces")
                .hint("leave out ⟨target_error⟩, and give ⟨quadrature=midpoint:STEP⟩ with a smaller step"));
        }
        if self.target_error.is_some() && self.time.is_some() {
            return Err(Error::invalid("⟨target_error⟩ and ⟨time⟩ both say when a picture is done")
                .hint("give one of them: ⟨time⟩ states the error that it has reached"));
        }
        if let Some([first, last]) = self.replicates {
            let holds = first <= last && last <= MOST_REPLICATES;
            ranges::require("replicates", [first, last], holds, "two ascending numbers up to 1048576")?;
            return match self.has_goal() {
                true => {
                    Err(Error::invalid("⟨replicates⟩ states what is rendered, which a wanted error or time decides")
                        .hint("leave ⟨target_error⟩ and ⟨time⟩ out; the report states the error that is reached"))
                }
                false => Ok(()),
            };
        }
        if !self.on() && confidence != Self::default().confidence {
            return Err(Error::invalid("⟨confidence⟩: no error is stated")
                .hint("give ⟨target_error⟩, ⟨time⟩ or ⟨replicates⟩, or leave ⟨confidence⟩ out"));
        }
        if self.on() && samples.is_some() {
            return Err(Error::invalid(
                "⟨samples⟩ states the number of paths, which follows from the wanted error or time",
            )
            .hint("leave ⟨samples⟩ out"));
        }
        Ok(())
    }

    /// Refuses settings of noise for pictures without paths.
    pub(super) fn check_paths(&self, paths: bool) -> Result<()> {
        let setting = if self.time.is_some() { "⟨time⟩" } else { "⟨replicates⟩" };
        if self.on() && self.target_error.is_none() && !paths {
            return Err(Error::invalid(format!(
                "{setting}: nothing is scattered, and pictures without paths have no noise"
            ))
            .hint("⟨target_error⟩ bounds the error of such pictures"));
        }
        Ok(())
    }
}

/// Bytes of memory a pixel that sums over replicates take, with those of a replicate; once more with other planes.
pub(super) const BYTES: u64 = 192;
/// Bytes that the sums of other planes take beside.
pub(super) const FEATURE_BYTES: u64 = 2 * 400;

/// Largest number of a replicate.
const MOST_REPLICATES: u32 = 1 << 20;

/// When the pictures of a run are to be done.
#[derive(Debug, Clone, Copy)]
pub(super) struct Deadline {
    end: Option<Instant>,
    /// Pictures that are left.
    left: usize,
    /// True once a picture has begun.
    begun: bool,
}

/// Time of a picture.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Turn {
    /// When it is to be done, if it is to be done by then.
    end: Option<Instant>,
    /// True for the first picture of a run.
    first: bool,
}

impl Deadline {
    /// Creates the deadline of a number of pictures that began at an instant.
    pub(super) fn new(begun: Instant, settings: &AccuracySettings, pictures: usize) -> Self {
        let end =
            settings.time.and_then(|time| Duration::try_from_secs_f64(time).ok()).and_then(|t| begun.checked_add(t));
        Self { end, left: pictures, begun: false }
    }

    /// Counts a picture that is there already.
    pub(super) fn skip(&mut self) {
        self.left = self.left.saturating_sub(1);
    }

    /// Returns the time of the next picture: an even part of what is left.
    pub(super) fn next(&mut self) -> Turn {
        let (now, left) = (Instant::now(), self.left.max(1) as u32);
        self.skip();
        let end = self.end.map(|end| now + end.saturating_duration_since(now) / left);
        Turn { end, first: !std::mem::replace(&mut self.begun, true) }
    }
}
