//! The densities on one level of resolution.
//!
//! Clean pictures need no more than the metric in which conjugate gradients look for the smallest change, and an early
//! stop: the number of blur passes of that metric is chosen by held-out views. Where there is noise, neighbours that
//! differ are penalised, strongly at first and less and less while held-out views gain by it. The solution of each
//! weight is the start of the next (continuation), so that what the pictures do not tell stays as smooth as it was.

use crate::error::{Error, Result};
use crate::inverse::checkpoint::Checkpoint;
use crate::inverse::density::Request;
use crate::inverse::density::held_out::Prediction;
use crate::inverse::observation::Observation;
use crate::inverse::observation::depth_map::DepthMap;
use crate::inverse::projection::depths::Depths;
use crate::inverse::projection::projector::{Projector, Sample, View, transmittance};
use crate::inverse::region::hull::Hull;
use crate::inverse::region::lattice;
use crate::inverse::solver::conjugate::{Equations, Solver};
use crate::inverse::solver::smoother::Smoother;
use crate::inverse::solver::tikhonov::Tikhonov;
use crate::math::Affine;
use crate::metrics::error::unit_psnr_db;
use crate::scene::bricks::{BRICK, Bricks, Topology};
use crate::scene::grid::LEAF_VOXELS;
use crate::scene::neighbours::Neighbours;
use std::ops::ControlFlow;
use std::sync::Arc;

/// Largest weight of the penalty, relative to the weight of the pictures in the differences of voxels that are
/// independent; what it is multiplied by from one to the next, at most; and what all steps together come to, at most.
const LARGEST_WEIGHT: f64 = 16.0;
const WEAKER: f64 = 0.25;
const WEAKEST: f64 = 1.0 / 1024.0;
/// Largest weight where a volume is given to start from, whose detail a larger one would blur.
const WEIGHT_FROM_START: f64 = 0.25;
/// Iterations after which a level ends if they gained less than [`GAIN`] dB on the held-out views; a smaller gain is
/// insignificant.
pub(super) const PATIENCE: usize = 6;
const GAIN: f64 = 0.3;
/// Largest number of blur passes that is tried, and iterations after which two numbers are compared.
const MOST_PASSES: u32 = 6;
pub(super) const TRIAL: u32 = 4;
/// Iterations with one weight of the penalty on noise.
pub(super) const NOISY_STEP: u32 = 4;
/// Views whose misfit tells whether noise is fitted already, where none are held out.
pub const MISFITS: usize = 8;

/// The problem on one level.
pub(super) struct Level {
    pub(super) topology: Arc<Topology>,
    pub(super) lattice: Affine,
    pub(super) unknown: Vec<bool>,
    pub(super) train: Vec<View>,
    held_out: Vec<View>,
    pub projector: Projector,
    pub smoother: Smoother,
    /// Largest weight of the penalty on differences of neighbours, where the pictures have noise.
    pub(super) penalty: Option<f64>,
    pub(super) start: Vec<f32>,
    pub(super) robust: bool,
    finest: bool,
    /// True if the number of blur passes is to be chosen.
    explore: bool,
    checkpoint: Option<Checkpoint>,
}

/// A voxel's own part of the penalty: two neighbours along each axis.
const PENALTY_DIAGONAL: f64 = 6.0;

/// Result of solving one level.
pub(super) struct Solved {
    pub voxels: Vec<f32>,
    /// Score of the held-out pictures in dB.
    score: Option<f64>,
    /// True if the score fell in later iterations.
    falling: bool,
    pub stopped: bool,
}

impl Level {
    pub(crate) fn new(
        observation: &Observation,
        request: &Request,
        level: u32,
        start: Option<&Bricks<f32>>,
        passes: u32,
    ) -> Result<Self> {
        let lattice = lattice::coarser(&request.lattice, level)?;
        let hull = Hull::new(observation).cancel(request.cancel.clone());
        let found = hull.unknowns(&lattice, &request.bounds, Self::most_bricks(request))?;
        Self::within(observation, request, level, found, start, passes)
    }

    /// Returns the largest number of bricks whose solver fits in memory.
    pub(super) fn most_bricks(request: &Request) -> usize {
        // Solver vectors, the penalty's differences, the field, its accumulators and the way back.
        let per_brick = (LEAF_VOXELS * 10 + BRICK * 4) * size_of::<f32>();
        (request.max_memory / per_brick as u64) as usize
    }

    /// Creates the problem on bricks that are found already, with the flags of their unknown voxels.
    pub(super) fn within(
        observation: &Observation,
        request: &Request,
        level: u32,
        (topology, unknown): (Topology, Vec<bool>),
        start: Option<&Bricks<f32>>,
        passes: u32,
    ) -> Result<Self> {
        let stride = 1_usize << level;
        let lattice = lattice::coarser(&request.lattice, level)?;
        let topology = Arc::new(topology);
        // Pixels of coarser levels are means of many already; one ray is as good as their model gets.
        let rays = if level == 0 { request.rays_per_edge } else { 1 };
        let mut projector = Projector::new(topology.clone(), lattice, request.medium.extinction, rays);
        projector.cancel = request.cancel.clone();
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
                Error::invalid("no ray of the pictures meets the region").hint("check ⟨bounds⟩ and the cameras")
            );
        }
        let start = match start {
            Some(field) => field.resampled(&topology, &lattice),
            None => vec![0.0; unknown.len()],
        };
        let mut smoother = Smoother::new(&topology, passes, 0.2);
        smoother.cancel = request.cancel.clone();
        Ok(Self {
            projector,
            smoother,
            robust: request.robust,
            finest: level == 0,
            explore: request.smoothing.is_none(),
            checkpoint: request.checkpoint.clone(),
            penalty: (observation.noisy() && request.smoothing.is_none()).then_some(if request.init.is_some() {
                WEIGHT_FROM_START
            } else {
                LARGEST_WEIGHT
            }),
            topology,
            lattice,
            unknown,
            train,
            held_out,
            start,
        })
    }

    pub(crate) fn solve(&mut self, limit: u32, mut watch: impl FnMut(f64, Option<f64>) -> ControlFlow<()>) -> Solved {
        let start = std::mem::take(&mut self.start);
        if let Some(penalty) = self.penalty {
            return self.descend_regularized(start, penalty, limit, &mut watch);
        }
        if !self.explore || self.held_out.is_empty() || limit <= TRIAL {
            return self.descend(start, limit, &mut watch);
        }
        let trial = self.compare(&start, &mut watch);
        if trial.stopped {
            return trial;
        }
        let done = self.descend(trial.voxels.clone(), limit - TRIAL, &mut watch);
        if done.score > trial.score { done } else { Solved { stopped: done.stopped, ..trial } }
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
                if next.score.unwrap_or(0.0) <= best.1.score.unwrap_or(0.0) + ahead {
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

    /// Weakens the penalty step by step while held-out views gain by it, or, without such views, while the misfit of
    /// the pictures is larger than their noise (Morozov's discrepancy principle).
    fn descend_regularized(
        &mut self,
        start: Vec<f32>,
        penalty: f64,
        limit: u32,
        watch: &mut impl FnMut(f64, Option<f64>) -> ControlFlow<()>,
    ) -> Solved {
        let unit = self.data_weight();
        let neighbours = Neighbours::new(&self.topology);
        let depths = Depths::new(&self.train, &mut self.projector);
        let regularized = Tikhonov::new(depths, &neighbours, penalty * unit);
        let mut solver = Solver::new(regularized, &mut self.smoother, &self.unknown, start).robust(self.robust);
        let blind = &self.train[..self.train.len().min(MISFITS)];
        let validation = if self.held_out.is_empty() { blind } else { &self.held_out };
        let weaker = WEAKEST.powf(1.0 / f64::from((limit / NOISY_STEP).max(2) - 1)).min(WEAKER);
        let mut best: Option<(f64, Vec<f32>)> = None;
        let mut stopped = false;
        for iteration in 1..=limit {
            if !solver.iterate() {
                break;
            }
            let ends = iteration % NOISY_STEP == 0 || iteration == limit;
            let solution = solver.solution();
            let prediction = Prediction::new(solver.equations.equations.projector, &solution, validation);
            let Some(now) = prediction.filter(|_| !solver.equations.cancelled()) else { break };
            offer(&self.checkpoint, (&self.topology, &self.lattice), &solution);
            stopped = watch(solver.loss(), (!self.held_out.is_empty()).then_some(now.psnr_db)).is_break();
            if stopped || ends {
                let fitted = self.held_out.is_empty() && now.square <= now.noise;
                if best.as_ref().is_some_and(|(score, _)| now.score_db <= *score) {
                    break;
                }
                best = Some((now.score_db, solution));
                if stopped || fitted {
                    break;
                }
                solver.equations.weight *= weaker;
                solver.begin_anew(NOISY_STEP);
            }
        }
        let stopped = stopped || solver.equations.cancelled();
        let (score, voxels) = match best {
            Some((score, voxels)) => (Some(score), voxels),
            None => (None, solver.solution()),
        };
        Solved { voxels, score, falling: false, stopped }
    }

    /// Weight of the pictures in the difference of a voxel that is independent of its neighbours: the mean of the
    /// diagonal of `AᵀWA` over that of the penalty, by one probe of random signs (Hutchinson 1990).
    fn data_weight(&mut self) -> f64 {
        let sign = |i: usize| if (i as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 63 == 0 { 1.0 } else { -1.0 };
        let probe: Vec<f32> = self.unknown.iter().enumerate().map(|(i, u)| if *u { sign(i) } else { 0.0 }).collect();
        let unknowns = self.unknown.iter().filter(|u| **u).count();
        let mut image = vec![0.0; probe.len()];
        let curvature = Depths::new(&self.train, &mut self.projector).normal(&probe, &mut image);
        curvature / (PENALTY_DIAGONAL * unknowns as f64)
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
            let prediction = Prediction::new(solver.equations.projector, &solution, &self.held_out);
            if solver.equations.cancelled() {
                break;
            }
            offer(&self.checkpoint, (&self.topology, &self.lattice), &solution);
            stopped = watch(solver.loss(), prediction.map(|p| p.psnr_db)).is_break();
            if let Some(now) = prediction.map(|p| p.score_db) {
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
        let (score, voxels) = match best {
            Some((score, voxels)) => (Some(score), voxels),
            None => (None, solver.solution()),
        };
        Solved { voxels, score, falling: trail.last().copied() < score, stopped }
    }

    /// Returns the PSNR of the training and of the held-out pictures; NaN once the measurement is cancelled.
    pub(crate) fn psnr(&mut self, voxels: &[f32]) -> (f64, Option<f64>) {
        let projector = &mut self.projector;
        let mut of = |views: &[View]| {
            let psnr = unit_psnr_db(mean_square(views, |v, f| projector.measure(voxels, v, f)));
            if projector.cancel.requested() { f64::NAN } else { psnr }
        };
        (of(&self.train), (!self.held_out.is_empty()).then(|| of(&self.held_out)))
    }

    pub(crate) fn field(self, voxels: Vec<f32>) -> (Bricks<f32>, usize) {
        let field = field((&self.topology, &self.lattice), &voxels);
        (field, self.unknown.iter().filter(|u| **u).count())
    }
}

/// Returns the densities of all voxels, 512 a brick, as a field.
fn field((topology, lattice): (&Arc<Topology>, &Affine), voxels: &[f32]) -> Bricks<f32> {
    let mut field = Bricks::zeros(topology.clone(), *lattice);
    topology.fill_apron(voxels, &mut field.values);
    field
}

/// Hands out the densities so far.
fn offer(checkpoint: &Option<Checkpoint>, lattice: (&Arc<Topology>, &Affine), voxels: &[f32]) {
    if let Some(checkpoint) = checkpoint {
        checkpoint.offer(|| field(lattice, voxels));
    }
}

/// Returns the mean square of the transmittance's error over all pixels of the views. Pixels without weight count as
/// correct.
fn mean_square(views: &[View], mut measure: impl FnMut(&[View], fn(&Sample, &[f64]) -> f64) -> f64) -> f64 {
    let pixels: f64 = views.iter().map(|v| f64::from(v.camera.width) * f64::from(v.camera.height)).sum();
    measure(views, |s, z| (f64::from(s.transmittance) - transmittance(z)).powi(2)) / pixels
}
