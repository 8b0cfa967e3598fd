//! The pilot of a picture: few paths, thrown away, that tell how many the picture takes.

use super::demand::{Demand, Goal};
use crate::render::film::{FEWEST, Replicates, Sampling, View};
use crate::render::integrator::Integrator;
use crate::render::tiles::Watch;
use std::time::Instant;

/// Part of the paths of a picture that its pilot has at most, unless it has one path a replicate.
const PART: f64 = 1.0 / 16.0;

/// First number of the random numbers of pilots, which no replicate of a picture has.
const STREAM: u64 = 1 << 32;

/// Renders the pilot of a picture. `sampling` returns the rays of that many paths a pixel, with random numbers of their
/// own for each stream. Intervals are to hold with `confidence`. A pilot that is not done at its `end` has fewer
/// replicates, and no demand if there are fewer than two. Returns the demand and the seconds that all threads took
/// together; `None` if the watch stopped it.
pub fn pilot<I: Integrator>(
    integrator: &I,
    view: View<'_>,
    sampling: impl Fn(u32, u64) -> Sampling,
    (goal, confidence, end): (Goal, f64, Option<Instant>),
    watch: Watch<'_>,
) -> Option<(Option<Demand>, f64)> {
    let size = [view.camera.width as usize, view.camera.height as usize];
    let mut seconds = 0.0;
    let over = || end.is_some_and(|end| Instant::now() >= end);
    let mut run = |paths: u32, stream: u64| {
        let mut pilot = Replicates::new(size, &[]);
        for replicate in 0..u64::from(FEWEST) {
            let rays = vec![Some(sampling(paths, stream + replicate)); pilot.seconds().len()];
            if !pilot.add(integrator, view, &rays, watch) {
                return None;
            }
            if over() {
                break;
            }
        }
        seconds += pilot.seconds().iter().sum::<f64>();
        Some((pilot.count() > 1).then(|| Demand::of(&pilot, confidence)))
    };
    let first = run(1, STREAM)?;
    // One path a replicate does not show how evenly the paths of more of them fall: that takes a part of the picture.
    let paths = f64::from(FEWEST) * PART.recip();
    let more = first.as_ref().map_or(0, |first| (first.mean_paths(goal) / paths) as u32);
    let second = if more > 1 && !over() { run(Sampling::shared(more), 2 * STREAM)? } else { None };
    Some((second.or(first), seconds))
}
