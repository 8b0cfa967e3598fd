//! The error of pictures, as their replicates tell it.

use super::{AccuracySettings, Made, STOPPED};
use crate::formats::exr::Attributes;
use crate::render::accuracy::interval::{Doubt, Intervals};
use crate::render::film::{Blocks, EDGE, FEWEST, PixelSums, Rendered, Replicates};
use crate::scene::film::Plane;
use serde::Serialize;
use std::fmt;

/// Error of a picture.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
pub(in crate::app::render) struct PictureError {
    /// Number of the view or frame.
    picture: usize,
    /// Largest error of a certified block, by the picture's scale; null without any.
    error: Option<f64>,
    /// Error that the pilot foresaw, or that was asked for; null where the time was too short for a pilot.
    expected_error: Option<f64>,
    /// Scale of the picture's radiance.
    scale: f64,
    /// Blocks of 8 x 8 pixels.
    blocks: usize,
    /// Blocks that are within the target with the confidence; without a target, those of which an error is stated.
    certified: usize,
    /// Other blocks, by the reason.
    doubtful: Vec<Doubtful>,
    /// Replicates that the target is expected to take in all; none without a target, and where it is reached.
    #[serde(skip)]
    needed: Option<u32>,
    /// Independent replicates.
    replicates: u32,
    /// Numbers of the replicates, by the seed of their random numbers.
    made_of: String,
    /// Paths of a pixel: fewest, mean and most.
    paths: [f64; 3],
    /// Seconds that it took to render.
    seconds: f64,
    /// Seconds that the pilot foresaw, its own among them; null where the time was too short for a pilot.
    expected_seconds: Option<f64>,
    /// True if the work was stopped before.
    stopped: bool,
}

/// Blocks that are not certified for one reason.
#[derive(Debug, Clone, Copy, Serialize, schemars::JsonSchema)]
struct Doubtful {
    reason: Doubt,
    blocks: usize,
}

/// Errors of all pictures.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
pub(in crate::app::render) struct AccuracyReport {
    target_error: Option<f64>,
    time: Option<f64>,
    confidence: f64,
    pictures: Vec<PictureError>,
}

impl AccuracyReport {
    /// Reports the errors of pictures; `None` without any.
    pub(in crate::app::render) fn of(settings: &AccuracySettings, pictures: Vec<PictureError>) -> Option<Self> {
        let AccuracySettings { target_error, time, confidence, .. } = *settings;
        (!pictures.is_empty()).then_some(Self { target_error, time, confidence, pictures })
    }

    /// True if a picture was stopped before it was done.
    pub(in crate::app::render) fn stopped(&self) -> bool {
        self.pictures.iter().any(|picture| picture.stopped)
    }
}

impl fmt::Display for AccuracyReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let worst = self.pictures.iter().filter_map(|picture| picture.error).reduce(f64::max);
        let sum = |of: fn(&PictureError) -> usize| self.pictures.iter().map(of).sum::<usize>();
        let (blocks, certified) = (sum(|p| p.blocks), sum(|p| p.certified));
        match worst {
            Some(0.0) if certified < blocks => {
                write!(f, "  no error is known but of {certified} of {blocks} blocks, which have no noise")?;
            }
            Some(worst) => write!(
                f,
                "  error {:.2} % of the scale at most, with confidence {} for each of {certified} of {blocks} blocks \
                 of 8x8 pixels",
                100.0 * worst,
                self.confidence
            )?,
            None => write!(f, "  no error is known of any of {blocks} blocks of 8x8 pixels")?,
        }
        for (doubt, words) in [
            (Doubt::Wide, "an error above the target"),
            (Doubt::RareEvents, "too few events that make the noise to be sure of it"),
            (Doubt::NoLight, "a medium in which no path found light"),
            (Doubt::FewReplicates, "fewer than 8 replicates"),
        ] {
            let all = self.pictures.iter().flat_map(|p| &p.doubtful).filter(|d| d.reason == doubt);
            let count: usize = all.map(|d| d.blocks).sum();
            if count > 0 {
                write!(f, "\n    blocks of {words}: {count}")?;
            }
        }
        if self.stopped() {
            write!(f, "\n  stopped before it was done")?;
        }
        Ok(())
    }
}

/// A picture with its error.
pub(in crate::app::render) struct Measured {
    pub rendered: Rendered,
    pub error: PictureError,
}

/// Facts of a picture beside its replicates.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::app::render) struct Known {
    /// Number of the view or frame.
    pub picture: usize,
    pub expected: Option<Expected>,
    /// Seconds that it took.
    pub seconds: f64,
    /// True if the work was stopped before its end.
    pub stopped: bool,
    /// True if the number of paths is one of the planes that were asked for.
    pub has_samples: bool,
    /// True to keep the sums over replicates.
    pub keeps_sums: bool,
}

/// Error and seconds that a picture is expected to have and to take.
#[derive(Debug, Clone, Copy)]
pub(in crate::app::render) struct Expected {
    /// Error that it is to have, or that its time allows; infinite where that is too short.
    pub error: f64,
    pub seconds: f64,
}

impl Measured {
    /// Measures a picture by its replicates.
    pub(in crate::app::render) fn of(made: &Made, settings: &AccuracySettings, known: Known) -> Self {
        let Made { replicates: made, streams } = made;
        let intervals = Intervals::of(made, settings.confidence);
        let target = settings.target_error;
        let doubtful: Vec<Doubtful> =
            intervals.doubts(target).into_iter().map(|(reason, blocks)| Doubtful { reason, blocks }).collect();
        let paths = made.sums().iter().map(|sums| sums.paths as f64);
        let blocks = intervals.blocks.len();
        let error = PictureError {
            picture: known.picture,
            error: intervals.worst(target),
            expected_error: known.expected.map(|e| e.error).filter(|error| error.is_finite()),
            scale: intervals.scale,
            blocks,
            certified: blocks - doubtful.iter().map(|d| d.blocks).sum::<usize>(),
            doubtful,
            needed: target.and_then(|target| needed(&intervals, target, made.count())),
            replicates: made.count(),
            made_of: streams.to_string(),
            paths: [
                paths.clone().fold(f64::INFINITY, f64::min),
                paths.clone().sum::<f64>() / made.sums().len().max(1) as f64,
                paths.fold(0.0, f64::max),
            ],
            seconds: known.seconds,
            expected_seconds: known.expected.map(|e| e.seconds),
            stopped: known.stopped,
        };
        let mut film = made.film();
        film.planes.extend(planes(made, &intervals, target, known.has_samples));
        if known.keeps_sums {
            film.planes.extend(PixelSums::planes(made.sums()));
        }
        Self { rendered: Rendered { film, counts: made.counts() }, error }
    }
}

/// Returns the replicates that a target takes in all, as errors fall with the root of their number; `None` where it is
/// reached in all blocks whose error is known. Of rare events no number is known that would suffice.
fn needed(intervals: &Intervals, target: f64, count: u32) -> Option<u32> {
    let of_block = |block| {
        let times = match intervals.doubt(block, Some(target))? {
            Doubt::Wide => (intervals.relative(block) / target).powi(2),
            Doubt::FewReplicates => f64::from(FEWEST) / f64::from(count.max(1)),
            Doubt::RareEvents | Doubt::NoLight => return None,
        };
        Some((times * f64::from(count)).ceil().max(f64::from(count) + 1.0) as u32)
    };
    (0..intervals.blocks.len()).filter_map(of_block).max()
}

/// Returns the planes of a picture's error: `error.V`, the error of each pixel's block by the picture's scale, infinite
/// where none is known; `error.certified`, 1 where it is known with the confidence, and within the target; and the
/// number of paths, unless it is asked for.
fn planes(made: &Replicates, intervals: &Intervals, target: Option<f64>, has_samples: bool) -> Vec<Plane> {
    let grid = Blocks::new(made.size());
    let by_block = |name: &str, value: &dyn Fn(usize) -> f32| {
        let values: Vec<f32> = (0..grid.count()).map(value).collect();
        let width = made.size()[0].max(1);
        let samples = (0..made.sums().len()).map(|i| values[grid.of([i % width, i / width])]).collect();
        Plane { name: name.into(), samples }
    };
    let error = |block: usize| match intervals.blocks[block].doubt {
        Some(Doubt::FewReplicates | Doubt::NoLight) => f32::INFINITY,
        _ => intervals.relative(block) as f32,
    };
    let certified = |block: usize| f32::from(u8::from(intervals.doubt(block, target).is_none()));
    let samples = made.sums().iter().map(|sums| sums.paths as f32).collect();
    let samples = (!has_samples).then(|| Plane { name: "Debug Sample Count.X".into(), samples });
    samples.into_iter().chain([by_block("error.V", &error), by_block("error.certified", &certified)]).collect()
}

impl PictureError {
    /// Adds the error to the attributes of a picture.
    pub(in crate::app::render) fn describe(&self, settings: &AccuracySettings, attributes: &mut Attributes) {
        let mut add = |name: &str, value: String| attributes.insert(format!("cumulo:{name}"), value);
        add("error", self.error.map_or("unknown".into(), |error| error.to_string()));
        add("confidence", settings.confidence.to_string());
        add("scale", self.scale.to_string());
        add("certified", format!("{} of {} blocks of {EDGE}x{EDGE} pixels", self.certified, self.blocks));
        add("replicates", self.made_of.clone());
        add("paths", format!("{} to {} a pixel, {} on average", self.paths[0], self.paths[2], self.paths[1]));
        if self.stopped {
            attributes.insert(STOPPED.into(), "true".into());
        }
    }

    /// Returns the replicates that the target is expected to take beside those of the picture; `None` where it is
    /// reached, or there is none.
    pub(in crate::app::render) fn missing(&self) -> Option<u32> {
        self.needed.map(|needed| needed.saturating_sub(self.replicates).max(1))
    }

    /// True if the picture was stopped before it was done.
    pub(in crate::app::render) fn is_stopped(&self) -> bool {
        self.stopped
    }

    /// Returns the mean number of paths of a pixel.
    pub(in crate::app::render) fn mean_paths(&self) -> f64 {
        self.paths[1]
    }
}
