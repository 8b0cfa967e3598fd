//! Density from absorption pictures: visual hull, levels from coarse to fine, and stopping criteria.

pub mod confidence;
pub mod descent;
pub mod matching;
pub mod through_transfer;
pub mod weiss2021;

use crate::cancel::Cancel;
use crate::error::{Error, Kind, Result};
use crate::math::{Aabb, Affine};
use crate::metrics::error::unit_psnr_db;
use crate::optimise::loss::prior::{VolumePrior, Weighted};
use crate::optimise::projection::depths::Depths;
use crate::optimise::projection::observation::{DepthMap, Observation};
use crate::optimise::projection::projector::{Projector, Sample, View};
use crate::optimise::region::hull::Hull;
use crate::optimise::region::lattice;
use crate::optimise::solver::conjugate::{Equations, Solver};
use crate::optimise::solver::smoother::Smoother;
use crate::scene::bricks::{BRICK, Bricks, Topology};
use crate::scene::grid::LEAF_VOXELS;
use crate::scene::medium::Medium;
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;
use std::sync::Arc;
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
    let mut passes = request.smoothing.unwrap_or(if blind { CLEAN_PASSES } else { PASSES });
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
            let limit = if level == 0 { request.iterations } else { COARSE_ITERATIONS.min(request.iterations) };
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
pub fn most_iterations(request: &Request) -> u64 {
    let levels = levels(&request.lattice, &request.bounds, request.init.as_ref());
    let coarse = u64::from(levels - 1) * u64::from(COARSE_ITERATIONS.min(request.iterations));
    // Each level tries one number of blur passes that it does not keep, or more.
    let trial = if request.smoothing.is_none() { u64::from(levels * TRIAL) } else { 0 };
    u64::from(request.iterations) + coarse + trial
}

/// Returns the number of levels, each of half the resolution, up to the finest. A start is used on the level of its own
/// resolution.
fn levels(lattice: &Affine, bounds: &Aabb, start: Option<&Bricks<f32>>) -> u32 {
    lattice::levels_from(start.map(|s| &s.transform), lattice, bounds, COARSEST) + 1
}

/// The problem on one level.
struct Level {
    topology: Arc<Topology>,
    lattice: Affine,
    unknown: Vec<bool>,
    train: Vec<View>,
    held_out: Vec<View>,
    projector: Projector,
    smoother: Smoother,
    start: Vec<f32>,
    robust: bool,
    finest: bool,
    /// True if the number of blur passes is to be chosen.
    explore: bool,
}

/// Result of solving one level.
struct Solved {
    voxels: Vec<f32>,
    /// PSNR of the held-out pictures.
    psnr: Option<f64>,
    /// True if the PSNR fell in later iterations.
    falling: bool,
    stopped: bool,
}

impl Level {
    fn new(
        observation: &Observation,
        request: &Request,
        level: u32,
        start: Option<&Bricks<f32>>,
        passes: u32,
    ) -> Result<Self> {
        let stride = 1_usize << level;
        let lattice = lattice::coarser(&request.lattice, level)?;
        let hull = Hull::new(observation).cancel(request.cancel);
        // Solver vectors, the field, its accumulators and the way back.
        let per_brick = (LEAF_VOXELS * 9 + BRICK * 4) * size_of::<f32>();
        let limit = (request.max_memory / per_brick as u64) as usize;
        let (topology, unknown) = hull.unknowns(&lattice, &request.bounds, limit)?;
        let topology = Arc::new(topology);
        // Pixels of coarser levels are means of many already; one ray is as good as their model gets.
        let rays = if level == 0 { request.rays_per_edge } else { 1 };
        let mut projector = Projector::new(topology.clone(), lattice, request.medium.extinction, rays);
        projector.cancel = request.cancel;
        let (held_out, train): (Vec<_>, Vec<_>) =
            observation.maps.iter().enumerate().partition(|(i, _)| request.held_out.contains(i));
        let mut views = |maps: Vec<(usize, &DepthMap)>| {
            projector.views(&maps.into_iter().map(|(_, m)| m).collect::<Vec<_>>(), stride, &unknown)
        };
        let (held_out, train) = (views(held_out), views(train));
        if request.cancel.requested() {
            return Err(Error::cancelled());
        }
        if train.iter().all(|v| v.samples.is_empty()) {
            return Err(
                Error::invalid("no ray of the pictures meets the region").hint("check --bounds and the cameras")
            );
        }
        let start = match start {
            Some(field) => field.resampled(&topology, &lattice),
            None => vec![0.0; unknown.len()],
        };
        let mut smoother = Smoother::new(&topology, passes, 0.2);
        smoother.cancel = request.cancel;
        Ok(Self {
            projector,
            smoother,
            robust: request.robust,
            finest: level == 0,
            explore: request.smoothing.is_none(),
            topology,
            lattice,
            unknown,
            train,
            held_out,
            start,
        })
    }

    fn solve(&mut self, limit: u32, mut watch: impl FnMut(f64, Option<f64>) -> ControlFlow<()>) -> Solved {
        let start = std::mem::take(&mut self.start);
        if !self.explore || self.held_out.is_empty() || limit <= TRIAL {
            return self.descend(start, limit, &mut watch);
        }
        let trial = self.compare(&start, &mut watch);
        if trial.stopped {
            return trial;
        }
        let done = self.descend(trial.voxels.clone(), limit - TRIAL, &mut watch);
        if done.psnr > trial.psnr { done } else { Solved { stopped: done.stopped, ..trial } }
    }

    /// Chooses the number of blur passes by the held-out views: the best depends on the smoothness of the volume, the
    /// number of pictures and their noise. Tries more passes for a few iterations each while they help, else, where
    /// that is cheap, fewer.
    fn compare(&mut self, start: &[f32], watch: &mut impl FnMut(f64, Option<f64>) -> ControlFlow<()>) -> Solved {
        let first = self.smoother.passes;
        let mut best = (first, self.descend(start.to_vec(), TRIAL, watch));
        let fewer = (0..first).rev().take(if self.finest { 0 } else { MOST_PASSES as usize }).collect::<Vec<_>>();
        for direction in [(first + 1..=MOST_PASSES).collect::<Vec<_>>(), fewer] {
            for passes in direction {
                if best.1.stopped {
                    break;
                }
                self.smoother.passes = passes;
                let next = self.descend(start.to_vec(), TRIAL, watch);
                // A smoother prior is ahead at first; it has to be clearly so, unless the other one has
                // begun to fit the noise.
                let ahead = if passes > best.0 && !best.1.falling { GAIN } else { 0.0 };
                if next.psnr.unwrap_or(0.0) <= best.1.psnr.unwrap_or(0.0) + ahead {
                    best.1.stopped = next.stopped;
                    break;
                }
                best = (passes, next);
            }
            if best.0 != first {
                break;
            }
        }
        self.smoother.passes = best.0;
        best.1
    }

    fn descend(
        &mut self,
        start: Vec<f32>,
        limit: u32,
        watch: &mut impl FnMut(f64, Option<f64>) -> ControlFlow<()>,
    ) -> Solved {
        let depths = Depths::new(&self.train, &mut self.projector);
        let mut solver = Solver::new(depths, &mut self.smoother, &self.unknown, start).robust(self.robust);
        let mut trail: Vec<f64> = Vec::new();
        let mut best: Option<(f64, Vec<f32>)> = None;
        let mut stopped = false;
        for _ in 0..limit {
            if !solver.iterate() {
                break;
            }
            let solution = solver.solution();
            let projector = &mut *solver.equations.projector;
            let measure = |v: &[View], f: fn(&Sample, &[f64]) -> f64| projector.measure(&solution, v, f);
            let psnr = (!self.held_out.is_empty()).then(|| picture_psnr(&self.held_out, measure));
            if solver.equations.cancelled() {
                break;
            }
            stopped = watch(solver.loss(), psnr).is_break();
            if let Some(now) = psnr {
                trail.push(now);
                if best.as_ref().is_none_or(|(b, _)| now > *b) {
                    best = Some((now, solution));
                }
                let stalled = trail.len() > PATIENCE && now < trail[trail.len() - 1 - PATIENCE] + GAIN;
                if stalled {
                    break;
                }
            }
            if stopped {
                break;
            }
        }
        let stopped = stopped || solver.equations.cancelled();
        let (psnr, voxels) = match best {
            Some((psnr, voxels)) => (Some(psnr), voxels),
            None => (None, solver.solution()),
        };
        Solved { voxels, psnr, falling: trail.last().copied() < psnr, stopped }
    }

    /// Returns the PSNR of the training and of the held-out pictures; NaN once the measurement is cancelled.
    fn psnr(&mut self, voxels: &[f32]) -> (f64, Option<f64>) {
        let projector = &mut self.projector;
        let mut of = |views: &[View]| {
            let psnr = picture_psnr(views, |v, f| projector.measure(voxels, v, f));
            if projector.cancel.requested() { f64::NAN } else { psnr }
        };
        (of(&self.train), (!self.held_out.is_empty()).then(|| of(&self.held_out)))
    }

    fn field(self, voxels: Vec<f32>) -> (Bricks<f32>, usize) {
        let mut field = Bricks::zeros(self.topology.clone(), self.lattice);
        self.topology.fill_apron(&voxels, &mut field.values);
        (field, self.unknown.iter().filter(|u| **u).count())
    }
}

/// Returns the PSNR of the transmittance over all pixels of the views, peak 1. Pixels without weight count as correct.
fn picture_psnr(views: &[View], mut measure: impl FnMut(&[View], fn(&Sample, &[f64]) -> f64) -> f64) -> f64 {
    let pixels: f64 = views.iter().map(|v| f64::from(v.camera.width) * f64::from(v.camera.height)).sum();
    let square = measure(views, |s, z| {
        let transmittance = z.iter().map(|z| (-z).exp()).sum::<f64>() / z.len() as f64;
        ((-f64::from(s.depth)).exp() - transmittance).powi(2)
    });
    unit_psnr_db(square / pixels)
}
