//! Pictures of a wanted error, or as good as they become in a given time.

use super::RenderSettings;
use crate::app::Context;
use crate::app::context::Picture;
use crate::app::ranges;
use crate::cancel::Cancel;
use crate::error::{Error, Result};
use crate::formats::exr::Attributes;
use crate::render::accuracy::demand::{Deal, Goal, MOST};
use crate::render::accuracy::interval::{Doubt, Intervals};
use crate::render::accuracy::pilot::pilot;
use crate::render::film::{Aov, Blocks, EDGE, FEWEST, Rendered, Replicates, Sampling, View};
use crate::render::path::PathTracer;
use crate::render::tiles::Watch;
use crate::scene::film::Plane;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::time::{Duration, Instant};

/// Settings of pictures whose error is stated: of path-traced ones, in place of a number of paths.
///
/// An error is half the width of an interval that holds the expected mean radiance of a block of 8 x 8 pixels, the
/// largest of red, green and blue, divided by the scale of the picture,
/// [`scale`](crate::render::accuracy::interval::scale).
/// A dark block has the same absolute error as a bright one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct AccuracySettings {
    /// Largest error of a block, above 0; none for no target.
    pub target_error: Option<f64>,
    /// Seconds in which all is read, rendered and written, with the smallest error that they allow; none for no limit.
    pub time: Option<f64>,
    /// Probability with which a stated interval holds the truth, between 0 and 1.
    pub confidence: f64,
}

impl Default for AccuracySettings {
    fn default() -> Self {
        Self { target_error: None, time: None, confidence: 0.95 }
    }
}

impl AccuracySettings {
    /// True if errors are to be stated.
    pub fn on(&self) -> bool {
        self.target_error.is_some() || self.time.is_some()
    }

    /// Refuses values out of their ranges, and settings that contradict others.
    pub(super) fn check(&self, samples: Option<u32>) -> Result<()> {
        ranges::positive("target_error", self.target_error)?;
        ranges::positive("time", self.time)?;
        let confidence = self.confidence;
        let holds = confidence > 0.0 && confidence < 1.0;
        ranges::require("confidence", confidence, holds, "a probability above 0 and below 1")?;
        if self.target_error.is_some() && self.time.is_some() {
            return Err(Error::invalid("⟨target_error⟩ and ⟨time⟩ both say when a picture is done")
                .hint("give one of them: ⟨time⟩ states the error that it has reached"));
        }
        if !self.on() && confidence != Self::default().confidence {
            return Err(Error::invalid("⟨confidence⟩: no error is stated")
                .hint("give ⟨target_error⟩ or ⟨time⟩, or leave ⟨confidence⟩ out"));
        }
        if self.on() && samples.is_some() {
            return Err(Error::invalid(
                "⟨samples⟩ states the number of paths, which follows from the wanted error or time",
            )
            .hint("leave ⟨samples⟩ out"));
        }
        Ok(())
    }

    /// Refuses pictures without paths.
    pub(super) fn check_paths(&self, paths: bool) -> Result<()> {
        let setting = if self.time.is_some() { "⟨time⟩" } else { "⟨target_error⟩" };
        if self.on() && !paths {
            return Err(Error::invalid(format!(
                "{setting}: nothing is scattered, and pictures without paths have no noise"
            ))
            .hint("the report of such pictures states the bounds of their quadrature and their early stop"));
        }
        Ok(())
    }
}

/// Bytes of memory a pixel that sums over replicates take, with those of a replicate; once more with other planes.
pub(super) const BYTES: u64 = 192;
/// Bytes that the sums of other planes take beside.
pub(super) const FEATURE_BYTES: u64 = 2 * 400;

/// Replicates of a picture that has a target: enough that their spread is known, few enough that each covers pixels
/// evenly.
const OF_TARGET: u32 = 16;
/// Most replicates that the paths of a picture that has a time are dealt out to; it ends with one of them.
const OF_TIME: u32 = 32;
/// Paths of a replicate of a picture that has a time: fewer replicates where there are few paths.
const OF_REPLICATE: f64 = 4.0;
/// Part of its time that the pilot of a picture may take.
const PILOT: f64 = 0.25;

/// Bytes of a picture that are written in a second, at least.
const WRITTEN: f64 = 1e8;

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

/// Error of a picture.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
pub(super) struct PictureError {
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
    /// Independent replicates.
    replicates: u32,
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
pub(super) struct AccuracyReport {
    target_error: Option<f64>,
    time: Option<f64>,
    confidence: f64,
    pictures: Vec<PictureError>,
}

impl AccuracyReport {
    /// Reports the errors of pictures; `None` without any.
    pub(super) fn of(settings: &AccuracySettings, pictures: Vec<PictureError>) -> Option<Self> {
        let AccuracySettings { target_error, time, confidence } = *settings;
        (!pictures.is_empty()).then_some(Self { target_error, time, confidence, pictures })
    }

    /// True if a picture was stopped before it was done.
    pub(super) fn stopped(&self) -> bool {
        self.pictures.iter().any(|picture| picture.stopped)
    }
}

impl fmt::Display for AccuracyReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let worst = self.pictures.iter().filter_map(|picture| picture.error).reduce(f64::max);
        let sum = |of: fn(&PictureError) -> usize| self.pictures.iter().map(of).sum::<usize>();
        let (blocks, certified) = (sum(|p| p.blocks), sum(|p| p.certified));
        match worst {
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
pub(super) struct Measured {
    pub rendered: Rendered,
    pub error: PictureError,
}

/// A picture at work.
struct Work<'w, 'a> {
    settings: &'w AccuracySettings,
    tracer: &'w PathTracer<'a>,
    view: View<'w>,
    size: [usize; 2],
    begun: Instant,
    watch: Watch<'w>,
}

impl RenderSettings {
    /// Renders a picture of a number, a view's or a frame's, until it is as its settings of accuracy say, or until its
    /// time is over. Returns `None` if it was stopped before anything is there.
    pub(super) fn measured(
        &self,
        tracer: &PathTracer<'_>,
        (number, view): (usize, View<'_>),
        turn: Turn,
        (cancel, progress): (&Cancel, &Picture<'_>),
        context: &Context,
    ) -> Option<Measured> {
        let size = [view.camera.width as usize, view.camera.height as usize];
        let work = Work {
            settings: &self.accuracy,
            tracer,
            view,
            size,
            begun: Instant::now(),
            watch: Watch { cancel, done: None },
        };
        let sampling = |paths, stream| self.pictures.replicate(number, paths, stream);
        // What is left when the last pixel is there.
        let writing = (size[0] * size[1] * (8 + self.aov.len() * 4) * 4) as f64 / WRITTEN;
        let left = turn.end.map(|end| end.saturating_duration_since(work.begun).as_secs_f64() - writing);
        let threads = rayon::current_num_threads() as f64;
        let goal = match (self.accuracy.target_error, left) {
            (Some(error), _) => Goal::Error(error),
            (None, left) => Goal::Seconds(left.unwrap_or(0.0).max(0.0) * threads),
        };
        let part = left.map(|left| work.begun + Duration::from_secs_f64((PILOT * left).max(0.0)));
        let goal = (goal, self.accuracy.confidence, part);
        let (demand, thread_seconds) = pilot(tracer, view, sampling, goal, work.watch)?;
        let spent = work.begun.elapsed().as_secs_f64();
        // Threads share their cores with whatever else runs.
        let wall = |seconds: f64| seconds * spent / thread_seconds.max(1e-9);
        let remaining = left.map(|left| (left - spent).max(0.0) / wall(1.0).max(1e-9));
        let (deal, expected) = match demand {
            Some(demand) => {
                let error = self.accuracy.target_error.unwrap_or_else(|| demand.error_in(remaining.unwrap_or(0.0)));
                let deal = dealt(demand.paths(error), remaining.is_some());
                let seconds = spent + wall(demand.seconds(deal.paths()));
                (deal, Some(Expected { error, seconds }))
            }
            None => (dealt(vec![0; Blocks::new(size).count()], true), None),
        };
        foresee((number, turn.first), &self.accuracy, (expected, &deal), context);
        let end = left.map(|left| work.begun + Duration::from_secs_f64(left.max(0.0)));
        let made = work.replicates(&self.aov, &deal, end, sampling, progress)?;
        Some(work.measured(number, &made, expected, self.aov.contains(&Aov::Samples)))
    }
}

/// What a picture is expected to take.
#[derive(Debug, Clone, Copy)]
struct Expected {
    /// Error that it is to have, or that its time allows; infinite where that is too short.
    error: f64,
    seconds: f64,
}

/// Deals out paths to the replicates of a picture. One that has a time may end before the last of them.
fn dealt(paths: Vec<u32>, timed: bool) -> Deal {
    if !timed {
        return Deal::new(paths, OF_TARGET);
    }
    let mean = paths.iter().map(|paths| f64::from(*paths)).sum::<f64>() / paths.len().max(1) as f64;
    let replicates = ((mean / OF_REPLICATE) as u32).clamp(FEWEST, OF_TIME);
    // Every replicate has a path of every pixel, as the time may be over after eight of them.
    Deal::new(paths.into_iter().map(|paths| paths.max(replicates)).collect(), replicates)
}

/// Says what a picture will take before it begins; of those after the first, as a detail.
fn foresee(
    (number, first): (usize, bool),
    settings: &AccuracySettings,
    (expected, deal): (Option<Expected>, &Deal),
    context: &Context,
) {
    let capped = deal.paths().iter().filter(|paths| **paths == MOST).count();
    let text = match (settings.target_error, expected) {
        (Some(target), Some(Expected { seconds, .. })) => {
            let all = match capped {
                0 => String::new(),
                blocks => format!("; {blocks} blocks have the most paths, {MOST}, and may not reach it"),
            };
            format!("picture {number}: an error of {:.3} % is expected to take {seconds:.1} s{all}", 100.0 * target)
        }
        (None, Some(Expected { error, .. })) if error.is_finite() => {
            format!("picture {number}: an error of {:.3} % is expected by then", 100.0 * error)
        }
        _ => format!("picture {number}: the time is too short to expect an error"),
    };
    if first { context.note(text) } else { context.detail(text) }
}

impl Work<'_, '_> {
    /// Renders the replicates of a picture: all that are dealt out, or as many as are done at the `end`. Returns `None`
    /// if it is stopped before the first is there.
    fn replicates(
        &self,
        aov: &[Aov],
        deal: &Deal,
        end: Option<Instant>,
        sampling: impl Fn(u32, u64) -> Sampling,
        progress: &Picture<'_>,
    ) -> Option<Replicates> {
        let mut made = Replicates::new(self.size, aov);
        let begun = Instant::now();
        for number in 0.. {
            let done = match end {
                None => number == deal.replicates(),
                // What comes takes as long as what has been, half of which may be too much.
                Some(end) => number > 0 && Instant::now() + begun.elapsed() / number / 2 > end,
            };
            if done {
                break;
            }
            let rays = deal.replicate(number, |paths| sampling(paths, number.into()));
            if !made.add(self.tracer, self.view, &rays, self.watch) {
                break;
            }
            let (done, all) = match end {
                None => (u64::from(number) + 1, deal.replicates().into()),
                Some(end) => {
                    let all = end.saturating_duration_since(begun).as_millis().max(1);
                    (begun.elapsed().as_millis().min(all) as u64, all as u64)
                }
            };
            progress.reach(done, all);
            if made.are_alike() {
                break;
            }
        }
        (made.count() > 0).then_some(made)
    }

    /// Measures a picture by its replicates.
    fn measured(&self, number: usize, made: &Replicates, expected: Option<Expected>, has_samples: bool) -> Measured {
        let intervals = Intervals::of(made, self.settings.confidence);
        let target = self.settings.target_error;
        let doubtful: Vec<Doubtful> =
            intervals.doubts(target).into_iter().map(|(reason, blocks)| Doubtful { reason, blocks }).collect();
        let paths = made.sums().iter().map(|sums| sums.paths as f64);
        let blocks = intervals.blocks.len();
        let error = PictureError {
            picture: number,
            error: intervals.worst(target),
            expected_error: expected.map(|e| e.error).filter(|error| error.is_finite()),
            scale: intervals.scale,
            blocks,
            certified: blocks - doubtful.iter().map(|d| d.blocks).sum::<usize>(),
            doubtful,
            replicates: made.count(),
            paths: [
                paths.clone().fold(f64::INFINITY, f64::min),
                paths.clone().sum::<f64>() / made.sums().len().max(1) as f64,
                paths.fold(0.0, f64::max),
            ],
            seconds: self.begun.elapsed().as_secs_f64(),
            expected_seconds: expected.map(|e| e.seconds),
            stopped: self.watch.cancel.requested(),
        };
        let mut film = made.film();
        film.planes.extend(planes(made, &intervals, target, has_samples));
        Measured { rendered: Rendered { film, counts: made.counts() }, error }
    }
}

/// Returns the planes of a picture's error: `error.V`, the error of each pixel's block by the picture's scale, infinite
/// where none is known; `error.certified`, 1 where it is known with the confidence, and within the target; and the number of
/// paths, unless it is asked for.
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
    pub(super) fn describe(&self, settings: &AccuracySettings, attributes: &mut Attributes) {
        let mut add = |name: &str, value: String| attributes.insert(format!("cumulo:{name}"), value);
        add("error", self.error.map_or("unknown".into(), |error| error.to_string()));
        add("confidence", settings.confidence.to_string());
        add("scale", self.scale.to_string());
        add("certified", format!("{} of {} blocks of {EDGE}x{EDGE} pixels", self.certified, self.blocks));
        add("replicates", self.replicates.to_string());
        add("paths", format!("{} to {} a pixel, {} on average", self.paths[0], self.paths[2], self.paths[1]));
    }

    /// True if the picture was stopped before it was done.
    pub(super) fn is_stopped(&self) -> bool {
        self.stopped
    }

    /// Returns the mean number of paths of a pixel.
    pub(super) fn mean_paths(&self) -> f64 {
        self.paths[1]
    }
}
