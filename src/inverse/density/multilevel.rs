//! Densities by conjugate gradients, level by level from coarse to fine: each level starts from the one before it.

use crate::error::{Error, Kind, Result};
pub use crate::inverse::density::level::MISFITS;
use crate::inverse::density::level::{Level, NOISY_STEP, PATIENCE, TRIAL};
use crate::inverse::density::{Outcome, Request};
use crate::inverse::observation::Observation;
use crate::inverse::progress::{Stage, Step};
use crate::inverse::region::lattice;
use crate::math::{Aabb, Affine};
use crate::scene::bricks::Bricks;
use std::ops::ControlFlow;
use std::time::Instant;

/// Coarsest level: at least this many voxels along the longest edge.
const COARSEST: f64 = 24.0;
/// Iterations on each level but the finest.
const COARSE_ITERATIONS: u32 = 8;
/// Number of blur passes that the coarsest level tries first, and that for clean pictures without held-out views.
const USUAL_PASSES: u32 = 2;
const CLEAN_PASSES: u32 = 1;
/// Iterations with the penalty on noise on each level but the finest.
const NOISY_COARSE_ITERATIONS: u32 = 32;
/// Blur passes where that penalty smooths.
const NOISY_PASSES: u32 = 1;

/// Reconstructs the densities. `watch` is called with every step and may stop the work; the result so far is returned
/// then.
///
/// # Errors
/// If the pictures leave no unknown, or the unknowns do not fit in memory.
pub fn reconstruct(
    observation: &Observation,
    request: &Request,
    mut watch: impl FnMut(&Step) -> ControlFlow<()>,
) -> Result<Outcome> {
    let start = Instant::now();
    let mut stages = Vec::new();
    let mut history: Vec<Step> = Vec::new();
    let mut stopped = false;
    let mut field = request.init.as_deref().cloned();
    let levels = levels(&request.lattice, &request.bounds, field.as_ref());
    let mut last = None;
    let mut passes = usual_passes(observation, request);
    let coarse = coarse_iterations(observation, request);
    for level in (0..levels).rev() {
        let begun = Instant::now();
        let (result, psnr) = {
            let mut work = match Level::new(observation, request, level, field.as_ref(), passes) {
                // What the coarser levels found stands.
                Err(e) if e.kind() == Kind::Cancelled && last.is_some() => {
                    stopped = true;
                    break;
                }
                work => work?,
            };
            stages
                .push(Stage { name: format!("level {level}: hull and rays"), seconds: begun.elapsed().as_secs_f64() });
            let begun = Instant::now();
            let limit = if level == 0 { request.iterations } else { coarse };
            let done = work.solve(limit, |loss, held_out_psnr_db| {
                let step = Step {
                    level,
                    iteration: history.len() as u32 + 1,
                    seconds: start.elapsed().as_secs_f64(),
                    loss,
                    held_out_psnr_db,
                };
                history.push(step);
                watch(&step)
            });
            stages.push(Stage { name: format!("level {level}: solve"), seconds: begun.elapsed().as_secs_f64() });
            stopped = done.stopped;
            passes = work.smoother.passes;
            work.projector.cancel = request.closing.clone();
            let psnr = work.psnr(&done.voxels);
            (work.field(done.voxels), psnr)
        };
        last = Some((psnr, result.1));
        field = Some(result.0);
        if stopped {
            break;
        }
    }
    let (Some(field), Some(((train, held_out), unknowns))) = (field, last) else {
        return Err(Error::invalid("no level was solved").hint("give more ⟨iterations⟩, or a finer ⟨resolution⟩"));
    };
    Ok(Outcome { field, history, stages, train_psnr_db: train, held_out_psnr_db: held_out, unknowns, stopped })
}

/// Returns the number of blur passes that the coarsest level begins with.
pub(super) fn usual_passes(observation: &Observation, request: &Request) -> u32 {
    let blind = request.held_out.is_empty() && observation.clean;
    let usual = if observation.noisy() {
        NOISY_PASSES
    } else if blind {
        CLEAN_PASSES
    } else {
        USUAL_PASSES
    };
    request.smoothing.unwrap_or(usual)
}

/// Iterations that are expected on a level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LevelSteps {
    /// Level, 0 the finest.
    pub level: u32,
    /// Fewest, usual and largest number of iterations.
    pub iterations: [f64; 3],
    /// Iterations after which a cycle of the solver ends, which begins with one more pass over the rays.
    pub cycle: f64,
}

/// Returns the iterations that are expected on each level, the coarsest first. They are known where held-out views have
/// no say; else the usual number is what captures of smoke, tiles and photographs took.
pub fn expected_steps(observation: &Observation, request: &Request) -> Vec<LevelSteps> {
    let levels = levels(&request.lattice, &request.bounds, request.init.as_deref());
    let coarse = coarse_iterations(observation, request);
    let noisy = observation.noisy() && request.smoothing.is_none();
    let of_level = |level: u32| {
        let limit = f64::from(if level == 0 { request.iterations } else { coarse });
        let trial = f64::from(TRIAL);
        let iterations = match (noisy, request.held_out.is_empty(), request.smoothing.is_some()) {
            // Coarse levels and photographs hardly ever fit their noise before the end.
            (true, ..) if level > 0 || observation.photographs() => [trial, limit, limit],
            (true, ..) => [trial, (NOISY_USUAL * limit).round(), limit],
            // All of them, but for what is solved before.
            (false, true, _) => [limit; 3],
            (false, false, true) => [(PATIENCE + 1) as f64, limit, limit],
            (false, false, false) if limit <= trial => [limit; 3],
            (false, false, false) => {
                // Numbers of blur passes that are tried, of which one is gone on with.
                let trials = if level == 0 { [2.0, 2.5, 7.0] } else { [2.0, 3.5, 8.0] };
                let descents = [1.0, limit, limit];
                std::array::from_fn(|i| trial * trials[i] + descents[i].min(limit - trial))
            }
        };
        let [least, usual, most] = iterations;
        LevelSteps {
            level,
            iterations: [least.min(most), usual.clamp(least.min(most), most), most],
            cycle: if noisy { f64::from(NOISY_STEP) } else { CYCLE },
        }
    };
    (0..levels).rev().map(of_level).collect()
}

/// Usual part of the iterations that the finest level takes with the penalty on noise.
const NOISY_USUAL: f64 = 0.7;
/// Mean length of the solver's cycles over so many iterations.
const CYCLE: f64 = 6.0;

/// Returns the largest number of iterations of a run, over all levels.
pub fn most_iterations(observation: &Observation, request: &Request) -> u64 {
    let levels = levels(&request.lattice, &request.bounds, request.init.as_deref());
    let coarse = u64::from(levels - 1) * u64::from(coarse_iterations(observation, request));
    // Each level tries one number of blur passes that it does not keep, or more.
    let tries = request.smoothing.is_none() && !observation.noisy();
    u64::from(request.iterations) + coarse + if tries { u64::from(levels * TRIAL) } else { 0 }
}

/// Returns the largest number of iterations on each level but the finest.
fn coarse_iterations(observation: &Observation, request: &Request) -> u32 {
    let penalised = observation.noisy() && request.smoothing.is_none();
    if penalised { NOISY_COARSE_ITERATIONS } else { COARSE_ITERATIONS }.min(request.iterations)
}

/// Returns the number of levels, each of half the resolution, up to the finest. A start is used on the level of its own
/// resolution.
fn levels(lattice: &Affine, bounds: &Aabb, start: Option<&Bricks<f32>>) -> u32 {
    lattice::levels_from(start.map(|s| &s.transform), lattice, bounds, COARSEST) + 1
}
