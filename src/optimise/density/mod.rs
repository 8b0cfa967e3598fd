//! Density from absorption pictures: visual hull, levels from coarse to fine, and stopping criteria.

pub mod alternatives;
pub mod confidence;
pub mod descent;
mod held_out;
mod level;
pub mod matching;
pub mod through_transfer;
pub mod weiss2021;

use crate::cancel::Cancel;
use crate::error::{Error, Kind, Result};
use crate::math::{Aabb, Affine};
use crate::optimise::loss::prior::{VolumePrior, Weighted};
use crate::optimise::projection::observation::Observation;
use crate::optimise::region::lattice;
use crate::scene::bricks::Bricks;
use crate::scene::medium::Medium;
use level::Level;
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;
use std::time::Instant;

/// Inputs and limits of a density reconstruction.
#[derive(Debug, Clone)]
pub struct Request {
    /// Voxel lattice of the result, index to world.
    pub lattice: Affine,
    /// World box of the unknowns.
    pub bounds: Aabb,
    /// Medium: extinction and source by density.
    pub medium: Medium,
    /// Radiance behind the volume.
    pub background: [f32; 3],
    /// Rays along each edge of a pixel, whose value is the mean over the square of that number.
    pub rays_per_edge: usize,
    /// Indices of the held-out views, which are not fitted but decide when to stop.
    pub held_out: Vec<usize>,
    /// Iterations on the finest level, at most.
    pub iterations: u32,
    /// Blur passes of the smoothness prior; chosen by the held-out views if `None`.
    pub smoothing: Option<u32>,
    /// Prior on neighbouring voxels for descents, instead of their default; conjugate gradients have their own prior.
    pub prior: Option<Weighted<VolumePrior>>,
    /// True to bound the influence of outliers (Huber's loss).
    pub robust: bool,
    /// A volume to start from.
    pub init: Option<Bricks<f32>>,
    /// Bytes of memory that may be used.
    pub max_memory: u64,
    /// Polled inside every pass; once set, the reconstruction so far is the result.
    pub cancel: Cancel,
    /// Polled by the passes that only measure the result; a measurement that it stops is missing.
    pub closing: Cancel,
}

/// One iteration, for the progress display and the convergence plot.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct Step {
    /// Level, 0 the finest.
    pub level: u32,
    /// Iteration, all levels counted.
    pub iteration: u32,
    /// Seconds since the start.
    pub seconds: f64,
    /// Objective: the weighted RMS of the optical depths' residuals; for the recipe of Weiss & Westermann (2021), the
    /// mean absolute difference of the batch's pictures.
    pub loss: f64,
    /// PSNR of the held-out views' transmittance (peak 1), if there are any.
    pub held_out_psnr_db: Option<f64>,
}

/// A stage of the work and the wall time it took.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct Stage {
    /// Name of the stage.
    pub name: String,
    /// Wall time in seconds.
    pub seconds: f64,
}

/// Result of a density reconstruction.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The densities.
    pub field: Bricks<f32>,
    /// Every iteration.
    pub history: Vec<Step>,
    /// Time by stage.
    pub stages: Vec<Stage>,
    /// PSNR of the training views (peak 1): of their transmittance, or for descents of their colors; NaN if the work
    /// was stopped before it was measured.
    pub train_psnr_db: f64,
    /// PSNR of the held-out views, measured as for the training views; `None` without such views.
    pub held_out_psnr_db: Option<f64>,
    /// Number of unknown voxels on the finest level.
    pub unknowns: usize,
    /// True if the user stopped the work.
    pub stopped: bool,
}

/// Coarsest level: at least this many voxels along the longest edge.
const COARSEST: f64 = 24.0;
/// Iterations on each level but the finest.
const COARSE_ITERATIONS: u32 = 8;
/// Iterations after which a level ends if they gained less than [`GAIN`] dB on the held-out views; a smaller gain is
/// insignificant.
const PATIENCE: usize = 6;
const GAIN: f64 = 0.3;

/// Numbers of blur passes: the first that the coarsest level tries, that for clean pictures without held-out views, and
/// the largest that is tried.
const PASSES: u32 = 2;
const CLEAN_PASSES: u32 = 1;
const MOST_PASSES: u32 = 6;
/// Iterations after which two numbers of blur passes are compared.
const TRIAL: u32 = 4;
/// Iterations with one weight of the penalty on noise, and those on each level but the finest.
const NOISY_STEP: u32 = 4;
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
    let mut field = request.init.clone();
    let levels = levels(&request.lattice, &request.bounds, field.as_ref());
    let mut last = None;
    let blind = request.held_out.is_empty() && observation.clean;
    let usual = if observation.noisy() {
        NOISY_PASSES
    } else if blind {
        CLEAN_PASSES
    } else {
        PASSES
    };
    let mut passes = request.smoothing.unwrap_or(usual);
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
            work.projector.cancel = request.closing;
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
        return Err(Error::invalid("no level was solved").hint("give more --iterations, or a finer --resolution"));
    };
    Ok(Outcome { field, history, stages, train_psnr_db: train, held_out_psnr_db: held_out, unknowns, stopped })
}

/// Returns the largest number of iterations of a run, over all levels.
pub fn most_iterations(observation: &Observation, request: &Request) -> u64 {
    let levels = levels(&request.lattice, &request.bounds, request.init.as_ref());
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
