//! The density reconstruction of Weiss & Westermann (2021, sect. 5.3), as published: Adam with
//! learning rate 0.3 on batches of 8 views, L1 loss on the pictures plus λ = 0.5 times the mean
//! squared difference of neighbouring voxels, 32³ doubled every 10 epochs, 50 epochs at the end.
//!
//! Densities are in the unit in which the paper's volumes lie in 0..1. It is taken from the pictures:
//! the density that, over a quarter of the box, gives the largest optical depth seen.

use crate::error::Result;
use crate::optimise::adam::Adam;
use crate::optimise::density::{Outcome, Request, Stage, Step};
use crate::optimise::hull::Hull;
use crate::optimise::lattice;
use crate::optimise::observation::{Observation, Photo};
use crate::optimise::pictures::{self, Accumulators, Gradients, Target};
use crate::render::dvr::{Adjoint, Dvr};
use crate::scene::bricks::{Bricks, Topology};
use crate::scene::grid::LEAF_VOXELS;
use glam::IVec3;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::Instant;

const RATE: f32 = 0.3;
const BATCH: usize = 8;
const PRIOR: f64 = 0.5;
const COARSEST: f64 = 32.0;
const COARSE_EPOCHS: u32 = 10;
const START: f32 = 0.1;

/// Reconstructs densities from colours: any medium, no assumption of linearity. One step a batch is
/// reported; `request.iterations` bounds the epochs on the finest level.
///
/// # Errors
/// As [`density::reconstruct`](crate::optimise::density::reconstruct).
pub fn reconstruct(
    photos: &[Photo],
    observation: &Observation,
    request: &Request,
    mut watch: impl FnMut(&Step) -> ControlFlow<()>,
) -> Result<Outcome> {
    let start = Instant::now();
    let target = |(_, p): (usize, &Photo)| Target {
        camera: p.camera,
        rgba: p.film.rgba.clone(),
        rays_per_edge: request.rays_per_edge,
    };
    let (held_out, train): (Vec<_>, Vec<_>) =
        photos.iter().enumerate().partition(|(i, _)| request.held_out.contains(i));
    let held_out: Vec<Target> = held_out.into_iter().map(target).collect();
    let train: Vec<Target> = train.into_iter().map(target).collect();
    let longest = request.bounds.size().max_element();
    let deepest = observation.maps.iter().flat_map(|m| m.depth.iter()).fold(0.0_f32, |a, b| a.max(*b));
    let unit = f64::from(deepest) / (0.25 * longest * request.medium.extinction);

    let mut level = coarsest(request);
    let mut field = request.init.clone();
    let (mut history, mut stages) = (Vec::new(), Vec::new());
    loop {
        let begun = Instant::now();
        let mut fit = Fit::new(observation, request, level, field.as_ref(), unit)?;
        let epochs = if level == 0 { request.iterations } else { COARSE_EPOCHS.min(request.iterations) };
        let mut stopped = false;
        'epochs: for epoch in 0..epochs {
            for batch in batches(&train, epoch) {
                let loss = fit.step(&batch, request)?;
                let held_out_psnr_db = if held_out.is_empty() {
                    None
                } else {
                    Some(fit.psnr(&held_out.iter().collect::<Vec<_>>(), request)?)
                };
                let step = Step {
                    level,
                    iteration: history.len() as u32 + 1,
                    seconds: start.elapsed().as_secs_f64(),
                    loss,
                    held_out_psnr_db,
                };
                history.push(step);
                if watch(&step).is_break() {
                    stopped = true;
                    break 'epochs;
                }
            }
        }
        stages.push(Stage { name: format!("level {level}: Adam"), seconds: begun.elapsed().as_secs_f64() });
        if level == 0 || stopped {
            return Ok(Outcome {
                train_psnr_db: fit.psnr(&train.iter().collect::<Vec<_>>(), request)?,
                held_out_psnr_db: match held_out.is_empty() {
                    true => None,
                    false => Some(fit.psnr(&held_out.iter().collect::<Vec<_>>(), request)?),
                },
                grid: fit.field.to_grid("density"),
                unknowns: fit.mask.iter().filter(|m| **m > 0.0).count(),
                history,
                stages,
                stopped,
            });
        }
        field = Some(fit.field);
        level -= 1;
    }
}

/// The level to begin on; a start is taken up on the finest.
fn coarsest(request: &Request) -> u32 {
    if request.init.is_some() {
        return 0;
    }
    lattice::coarser_levels(&request.lattice, &request.bounds, COARSEST)
}

/// Steps that a run takes at most, with `views` pictures that are used.
pub fn most_iterations(request: &Request, views: usize) -> u64 {
    let epochs = request.iterations + coarsest(request) * COARSE_EPOCHS.min(request.iterations);
    u64::from(epochs) * views.div_ceil(BATCH) as u64
}

/// Views in batches, in an order that changes from epoch to epoch (a stride coprime to their number).
fn batches(train: &[Target], epoch: u32) -> Vec<Vec<&Target>> {
    let n = train.len();
    let gcd = |mut a: usize, mut b: usize| {
        while b > 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    let stride = (1..).map(|k| k * 5 + 2 + epoch as usize * 4).find(|s| gcd(*s, n) == 1).unwrap_or(1);
    let order: Vec<&Target> = (0..n).map(|i| &train[(i * stride + epoch as usize) % n]).collect();
    order.chunks(BATCH).map(<[_]>::to_vec).collect()
}

/// The unknowns of one level.
struct Fit {
    field: Bricks<f32>,
    mask: Vec<f32>,
    /// Owned voxels in the paper's unit.
    x: Vec<f32>,
    unit: f32,
    adam: Adam,
    stored: Vec<f32>,
    accumulators: Accumulators,
    owned: Vec<f32>,
}

impl Fit {
    fn new(
        observation: &Observation,
        request: &Request,
        level: u32,
        start: Option<&Bricks<f32>>,
        unit: f64,
    ) -> Result<Self> {
        let lattice = lattice::coarser(&request.lattice, level)?;
        let limit = (request.max_memory / (LEAF_VOXELS * 64) as u64) as usize;
        let (topology, unknown) = Hull::new(observation).unknowns(&lattice, &request.bounds, limit)?;
        let topology: Arc<Topology> = Arc::new(topology);
        let mask: Vec<f32> = unknown.iter().map(|u| f32::from(u8::from(*u))).collect();
        let x = match start {
            Some(field) => {
                let known = field.resampled(&topology, &lattice);
                known.iter().zip(&mask).map(|(v, m)| m * v / unit as f32).collect()
            }
            None => mask.iter().map(|m| m * START).collect(),
        };
        let mut fit = Self {
            stored: vec![0.0; topology.len() * crate::scene::bricks::BRICK],
            accumulators: Accumulators::default(),
            owned: vec![0.0; mask.len()],
            adam: Adam::new(mask.len(), RATE),
            field: Bricks::zeros(topology, lattice),
            mask,
            x,
            unit: unit as f32,
        };
        fit.spread();
        Ok(fit)
    }

    fn spread(&mut self) {
        let scaled: Vec<f32> = self.x.iter().map(|v| v * self.unit).collect();
        self.field.topology.spread(&scaled, &mut self.field.values);
    }

    fn renderer(&self, request: &Request) -> Result<Dvr<'_, f32>> {
        Ok(Dvr::new(&self.field, request.medium.clone())?.background(request.background))
    }

    /// One step of Adam; returns the L1 loss before it.
    fn step(&mut self, batch: &[&Target], request: &Request) -> Result<f64> {
        let values: usize = batch.iter().map(|t| 4 * t.rgba.len()).sum();
        let share = 1.0 / values.max(1) as f32;
        let mut stored = std::mem::take(&mut self.stored);
        stored.fill(0.0);
        let l1 = |seen: &[f32; 4], wanted: &[f32; 4]| {
            let difference: [f32; 4] = std::array::from_fn(|c| seen[c] - wanted[c]);
            let value = difference.iter().map(|d| f64::from(d.abs())).sum();
            (value, difference.map(|d| if d == 0.0 { 0.0 } else { share * d.signum() }))
        };
        let mut accumulators = std::mem::take(&mut self.accumulators);
        let mut gradients = Gradients { voxels: Some(&mut stored), ..Gradients::default() };
        let dvr = self.renderer(request)?;
        let (sum, _) = pictures::gradient(&dvr, batch, &l1, Adjoint::Tape, &mut accumulators, &mut gradients);
        self.accumulators = accumulators;
        let mut owned = std::mem::take(&mut self.owned);
        self.field.topology.fold(&stored, &mut owned);
        for g in &mut owned {
            *g *= self.unit;
        }
        self.add_prior(&mut owned);
        self.adam.step(&mut self.x, &owned, &self.mask);
        (self.stored, self.owned) = (stored, owned);
        self.spread();
        Ok(sum * f64::from(share))
    }

    /// Adds the gradient of λ times the mean squared difference of neighbours.
    fn add_prior(&self, gradient: &mut [f32]) {
        let topology = &self.field.topology;
        let pairs = 3.0 * self.mask.iter().map(|m| f64::from(*m)).sum::<f64>().max(1.0);
        let factor = (2.0 * PRIOR / pairs) as f32;
        for (b, brick) in topology.bricks().iter().enumerate() {
            for i in 0..LEAF_VOXELS {
                let here = b * LEAF_VOXELS + i;
                for (axis, stride) in [(IVec3::X, 64), (IVec3::Y, 8), (IVec3::Z, 1)] {
                    let there = if (i / stride) & 7 < 7 {
                        here + stride
                    } else {
                        match topology.find(*brick + axis) {
                            crate::scene::bricks::NONE => continue,
                            n => n as usize * LEAF_VOXELS + i - 7 * stride,
                        }
                    };
                    let pull = factor * (self.x[there] - self.x[here]);
                    gradient[here] -= pull;
                    gradient[there] += pull;
                }
            }
        }
    }

    /// PSNR of the colours (peak 1).
    fn psnr(&self, targets: &[&Target], request: &Request) -> Result<f64> {
        let values: usize = targets.iter().map(|t| 3 * t.rgba.len()).sum();
        let square = pictures::error(&self.renderer(request)?, targets);
        Ok(-10.0 * (square / values.max(1) as f64).max(1e-20).log10())
    }
}
