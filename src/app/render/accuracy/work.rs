//! Rendering of a picture until its error is as it is to be, or its time is over; or of some replicates of it.

use super::measured::{Expected, Known};
use super::{AccuracySettings, Made, Measured, Turn};
use crate::app::Context;
use crate::app::context::Picture;
use crate::app::render::RenderSettings;
use crate::cancel::Cancel;
use crate::render::accuracy::demand::{Deal, Goal, MOST};
use crate::render::accuracy::pilot::pilot;
use crate::render::film::{Aov, Blocks, FEWEST, Sampling, View};
use crate::render::path::PathTracer;
use crate::render::tiles::Watch;
use std::ops::Range;
use std::time::{Duration, Instant};

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

/// A picture at work.
struct Work<'w, 'a> {
    settings: &'w RenderSettings,
    tracer: &'w PathTracer<'a>,
    number: usize,
    view: View<'w>,
    turn: Turn,
    begun: Instant,
    watch: Watch<'w>,
}

/// Replicates that a picture is to have.
struct Course<'c> {
    numbers: Range<u32>,
    /// Returns the rays of each block in a replicate.
    rays: Box<dyn Fn(u32) -> Vec<Option<Sampling>> + 'c>,
    /// When the last of them is to be done.
    end: Option<Instant>,
    expected: Option<Expected>,
}

impl RenderSettings {
    /// Renders a picture of a number, a view's or a frame's: the replicates that are asked for, or until it is as its
    /// settings of accuracy say, or until its time is over. It goes on from `earlier` replicates. Returns `None` if it
    /// was stopped before anything is there.
    pub(in crate::app::render) fn measured(
        &self,
        tracer: &PathTracer<'_>,
        (number, view, earlier): (usize, View<'_>, Option<Made>),
        turn: Turn,
        (cancel, progress): (&Cancel, &Picture<'_>),
        context: &Context,
    ) -> Option<Measured> {
        let watch = Watch { cancel, done: None };
        let work = Work { settings: self, tracer, number, view, turn, begun: Instant::now(), watch };
        let mut made = earlier.unwrap_or_else(|| Made::new(work.size(), &self.aov));
        let course = match self.accuracy.replicates {
            Some([first, last]) => work.asked_for(first..last + 1),
            None => work.planned(context)?,
        };
        let done = work.add(&mut made, &course, progress);
        let keeps = self.accuracy.replicates.is_some() || self.aov.contains(&Aov::Replicates);
        let known = Known {
            picture: number,
            expected: course.expected,
            seconds: work.begun.elapsed().as_secs_f64(),
            stopped: !done,
            has_samples: self.aov.contains(&Aov::Samples),
            keeps_sums: keeps || !(done || self.half || !self.compression.is_lossless()) && self.sums_tell_all(),
        };
        (made.replicates.count() > 0).then(|| Measured::of(&made, &self.accuracy, known))
    }

    /// True if all planes of a picture follow from its sums over replicates, so that it can go on from them.
    pub(in crate::app::render) fn sums_tell_all(&self) -> bool {
        self.aov.iter().all(|aov| matches!(aov, Aov::Variance | Aov::Samples | Aov::Replicates))
    }
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
    fn size(&self) -> [usize; 2] {
        [self.view.camera.width as usize, self.view.camera.height as usize]
    }

    fn sampling(&self, paths: u32, stream: u64) -> Sampling {
        self.settings.pictures.replicate(self.number, paths, stream)
    }

    /// Returns replicates of as many paths as the settings say.
    fn asked_for(&self, numbers: Range<u32>) -> Course<'_> {
        let paths = self.settings.pictures.scattering.samples();
        let blocks = Blocks::new(self.size()).count();
        let rays = move |number: u32| vec![Some(self.sampling(paths, number.into())); blocks];
        Course { numbers, rays: Box::new(rays), end: None, expected: None }
    }

    /// Returns the replicates that an error or a time takes, by a pilot; `None` if it is stopped.
    fn planned(&self, context: &Context) -> Option<Course<'_>> {
        let AccuracySettings { target_error, confidence, .. } = self.settings.accuracy;
        let [width, height] = self.size();
        // What is left when the last pixel is there.
        let writing = (width * height * (8 + self.settings.aov.len() * 4) * 4) as f64 / WRITTEN;
        let left = self.turn.end.map(|end| end.saturating_duration_since(self.begun).as_secs_f64() - writing);
        let threads = rayon::current_num_threads() as f64;
        let goal = match (target_error, left) {
            (Some(error), _) => Goal::Error(error),
            (None, left) => Goal::Seconds(left.unwrap_or(0.0).max(0.0) * threads),
        };
        let part = left.map(|left| self.begun + Duration::from_secs_f64((PILOT * left).max(0.0)));
        let sampling = |paths, stream| self.sampling(paths, stream);
        let goal = (goal, confidence, part);
        let (demand, thread_seconds) = pilot(self.tracer, self.view, sampling, goal, self.watch)?;
        let spent = self.begun.elapsed().as_secs_f64();
        // Threads share their cores with whatever else runs.
        let wall = |seconds: f64| seconds * spent / thread_seconds.max(1e-9);
        let remaining = left.map(|left| (left - spent).max(0.0) / wall(1.0).max(1e-9));
        let (deal, expected) = match demand {
            Some(demand) => {
                let error = target_error.unwrap_or_else(|| demand.error_in(remaining.unwrap_or(0.0)));
                let deal = dealt(demand.paths(error), remaining.is_some());
                let seconds = spent + wall(demand.seconds(deal.paths()));
                (deal, Some(Expected { error, seconds }))
            }
            None => (dealt(vec![0; Blocks::new(self.size()).count()], true), None),
        };
        foresee((self.number, self.turn.first), &self.settings.accuracy, (expected, &deal), context);
        let end = left.map(|left| self.begun + Duration::from_secs_f64(left.max(0.0)));
        let numbers = 0..if end.is_some() { u32::MAX } else { deal.replicates() };
        let rays = move |number| deal.replicate(number, |paths| self.sampling(paths, u64::from(number)));
        Some(Course { numbers, rays: Box::new(rays), end, expected })
    }

    /// Adds the replicates of a picture that are not there yet: all, or as many as are done at the end. Returns false
    /// if it was stopped before.
    fn add(&self, made: &mut Made, course: &Course<'_>, progress: &Picture<'_>) -> bool {
        let Course { numbers, rays, end, .. } = course;
        let seed = self.settings.pictures.scattering.seed.unwrap_or(0);
        let begun = Instant::now();
        let first = numbers.start + made.replicates.count();
        for (number, count) in (first..numbers.end).zip(0..) {
            // What comes takes as long as what has been, half of which may be too much.
            let over = |end: &Instant| count > 0 && Instant::now() + begun.elapsed() / count / 2 > *end;
            if end.as_ref().is_some_and(over) {
                break;
            }
            if !made.replicates.add(self.tracer, self.view, &rays(number), self.watch) {
                return false;
            }
            made.streams.push(seed, number);
            match end {
                None => progress.reach((number + 1 - numbers.start).into(), numbers.len() as u64),
                Some(end) => {
                    let all = end.saturating_duration_since(begun).as_millis().max(1);
                    progress.reach(begun.elapsed().as_millis().min(all) as u64, all as u64);
                }
            }
            if self.settings.accuracy.has_goal() && made.replicates.are_alike() {
                break;
            }
        }
        true
    }
}
