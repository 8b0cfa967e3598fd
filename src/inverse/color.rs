//! A pre-shaded volume from emission-absorption pictures: extinctions from alpha, then emissions from the
//! colors.
//!
//! Alpha tells the optical depth, in which the extinctions are linear
//! ([`multilevel`]). With these the transmittance is known everywhere, and the
//! colors are linear in the emissions (`projection::emission`): both are least squares in
//! the metric of the smoothness prior, without learning rates, and without the noise that descending in both at
//! once leaves (Weiss & Westermann 2021, sect. 5.3).

use crate::error::{Code, Error, Result};
use crate::inverse::density::multilevel;
use crate::inverse::density::{Outcome, Request};
use crate::inverse::observation::Observation;
use crate::inverse::observation::photo::Photo;
use crate::inverse::progress::{Stage, Step};
use crate::inverse::projection::emission::{ColorView, Emission};
use crate::inverse::region::lattice;
use crate::inverse::solver::conjugate::{Equations, Solver};
use crate::inverse::solver::smoother::Smoother;
use crate::metrics::error::unit_psnr_db;
use crate::scene::bricks::{BRICK, Bricks, Topology};
use crate::scene::grid::LEAF_VOXELS;
use glam::{IVec3, Vec4};
use rayon::prelude::*;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::Instant;

/// Result of a color reconstruction.
#[derive(Debug, Clone)]
pub struct Shaded {
    /// Radiance emitted per world length in R, G and B, and extinction.
    pub volume: Bricks<Vec4>,
    /// Every iteration; those of the extinctions come first.
    pub history: Vec<Step>,
    /// Time by stage.
    pub stages: Vec<Stage>,
    /// PSNR of the colors of the training views (peak 1); NaN if the work was stopped before it was measured.
    pub train_psnr_db: f64,
    /// PSNR of the colors of the held-out views (peak 1); `None` without such views, NaN if the work was stopped before
    /// it was measured.
    pub held_out_psnr_db: Option<f64>,
    /// Number of voxels with a positive extinction.
    pub voxels: usize,
    /// True if the user stopped the work.
    pub stopped: bool,
}

/// Coarsest level: at least this many voxels along the longest edge.
const COARSEST: f64 = 32.0;
/// Iterations on each level but the finest, and on the finest.
const COARSE_ITERATIONS: u32 = 8;
const ITERATIONS: u32 = 12;
/// The finest level ends when this many iterations brought less than [`GAIN`] dB on the held-out views.
const PATIENCE: usize = 3;
const GAIN: f64 = 0.1;
/// Blur passes of the smoothness prior for clean pictures, and for noisy ones.
const CLEAN_PASSES: u32 = 1;
const NOISY_PASSES: u32 = 3;

/// Reconstructs extinctions and emissions, starting from `init` if it is given. `request.medium` is the medium that
/// absorbs. `watch` is called with every step and may stop the work; the result so far is returned then.
///
/// # Errors
/// If alpha is 0 everywhere, the pictures leave no unknown, or the unknowns do not fit in memory.
pub fn reconstruct(
    photos: &[Photo],
    observation: &Observation,
    request: &Request,
    init: Option<Bricks<Vec4>>,
    mut watch: impl FnMut(&Step) -> ControlFlow<()>,
) -> Result<Shaded> {
    let start = Instant::now();
    let extinction_request =
        Request { init: init.as_ref().map(|volume| Arc::new(volume.channel(3))), ..request.clone() };
    let Outcome { field, mut history, mut stages, mut stopped, .. } =
        multilevel::reconstruct(observation, &extinction_request, &mut watch)?;
    stages.iter_mut().for_each(|stage| stage.name.insert_str(0, "extinction, "));
    // Bricks of the hull that turned out empty need no colors.
    let extinctions = Bricks::from_grid(&field.to_grid("density"), request.max_memory)?;
    drop(field);
    if extinctions.values.iter().all(|s| *s == 0.0) {
        return Err(Error::invalid("alpha is 0 in all pictures: there is nothing to give a color to")
            .hint("render with alpha = 1 - transmittance, as `cumulo render` does"));
    }
    fits(extinctions.topology.len(), request.max_memory)?;

    // Of a run that was stopped the extinctions are coarser than what was asked for, and so may the start be.
    let init_lattice = init.as_ref().map(|volume| &volume.transform);
    let mut level = lattice::levels_from(init_lattice, &extinctions.transform, &request.bounds, COARSEST);
    let mut estimate = init;
    loop {
        let begun = Instant::now();
        let work = Level::new(photos, observation, request, level, &extinctions)?;
        let colors = match &estimate {
            Some(estimate) => (0..3).flat_map(|c| work.resampled(&estimate.channel(c))).collect(),
            None => work.tinted(mean_color(photos, request.background)),
        };
        let mut emission = Emission::new(&work.train, &work.extinctions, request.background, work.rays);
        emission.cancel = request.cancel.clone();
        let colors = work.solve(&mut emission, colors, |loss, held_out_psnr_db| {
            let iteration = history.len() as u32 + 1;
            let step = Step { level, iteration, seconds: start.elapsed().as_secs_f64(), loss, held_out_psnr_db };
            history.push(step);
            stopped |= watch(&step).is_break();
            if stopped { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        stopped |= request.cancel.requested();
        stages.push(Stage { name: format!("colors, level {level}"), seconds: begun.elapsed().as_secs_f64() });
        if level == 0 || stopped {
            emission.cancel = request.closing.clone();
            let mut psnr = |views: &[ColorView]| {
                let square = emission.error(&colors, views);
                if request.closing.requested() { f64::NAN } else { unit_psnr_db(square) }
            };
            return Ok(Shaded {
                train_psnr_db: psnr(&work.train),
                held_out_psnr_db: (!work.held_out.is_empty()).then(|| psnr(&work.held_out)),
                voxels: work.unknown.iter().filter(|u| **u).count(),
                volume: emission.volume(&colors),
                history,
                stages,
                stopped,
            });
        }
        estimate = Some(emission.volume(&colors));
        level -= 1;
    }
}

/// Returns the largest number of iterations of a run, over all levels of extinctions and colors.
pub fn most_iterations(observation: &Observation, request: &Request) -> u64 {
    let coarse = lattice::coarser_levels(&request.lattice, &request.bounds, COARSEST) * COARSE_ITERATIONS;
    multilevel::most_iterations(observation, request) + u64::from(coarse + ITERATIONS)
}

/// The problem of the colors on one level.
struct Level {
    extinctions: Bricks<f32>,
    unknown: Vec<bool>,
    train: Vec<ColorView>,
    held_out: Vec<ColorView>,
    rays: usize,
    passes: u32,
    iterations: u32,
    robust: bool,
}

impl Level {
    fn new(
        photos: &[Photo],
        observation: &Observation,
        request: &Request,
        level: u32,
        extinctions: &Bricks<f32>,
    ) -> Result<Self> {
        let extinctions = if level == 0 { extinctions.clone() } else { coarser(extinctions, level)? };
        let view = |(i, photo): (usize, &Photo)| {
            (request.held_out.contains(&i), ColorView::new(photo, 1 << level, &observation.maps[i].shown))
        };
        let (held_out, train): (Vec<_>, Vec<_>) =
            photos.par_iter().enumerate().map(view).collect::<Vec<_>>().into_iter().partition(|(held, _)| *held);
        let views = |all: Vec<(bool, ColorView)>| all.into_iter().map(|(_, view)| view).collect();
        Ok(Self {
            unknown: extinctions.owned().iter().map(|s| *s > 0.0).collect(),
            extinctions,
            train: views(train),
            held_out: views(held_out),
            rays: if level == 0 { request.rays_per_edge } else { 1 },
            passes: request.smoothing.unwrap_or(if observation.clean { CLEAN_PASSES } else { NOISY_PASSES }),
            iterations: if level == 0 { ITERATIONS } else { COARSE_ITERATIONS },
            robust: request.robust,
        })
    }

    fn resampled(&self, field: &Bricks<f32>) -> Vec<f32> {
        field.resampled(&self.extinctions.topology, &self.extinctions.transform)
    }

    /// Returns emissions of one color, proportional to the extinctions.
    fn tinted(&self, color: [f32; 3]) -> Vec<f32> {
        let extinctions = self.extinctions.owned();
        color.iter().flat_map(|c| extinctions.iter().map(move |s| c * s)).collect()
    }

    /// Returns the emissions with the best PSNR on the held-out views, or without such views the last ones.
    fn solve(
        &self,
        emission: &mut Emission<'_>,
        start: Vec<f32>,
        mut watch: impl FnMut(f64, Option<f64>) -> ControlFlow<()>,
    ) -> Vec<f32> {
        let mut smoother = Smoother::new(&self.extinctions.topology, self.passes, 0.2);
        smoother.cancel = emission.cancel.clone();
        let mut solver = Solver::new(emission, &mut smoother, &self.unknown, start).robust(self.robust);
        let mut trail: Vec<f64> = Vec::new();
        let mut best = None;
        for _ in 0..self.iterations {
            if !solver.iterate() {
                break;
            }
            let solution = solver.solution();
            let psnr =
                (!self.held_out.is_empty()).then(|| unit_psnr_db(solver.equations.error(&solution, &self.held_out)));
            if solver.equations.cancelled() {
                break;
            }
            let stopped = watch(solver.loss(), psnr).is_break();
            if let Some(now) = psnr {
                if trail.iter().all(|before| now > *before) {
                    best = Some(solution);
                }
                trail.push(now);
            }
            let before = trail.len().checked_sub(1 + PATIENCE).map(|k| trail[k]);
            if stopped || before.zip(trail.last()).is_some_and(|(before, now)| *now < before + GAIN) {
                break;
            }
        }
        best.unwrap_or_else(|| solver.solution())
    }
}

/// Checks that the volume, the accumulators and the solver's vectors fit in memory.
fn fits(bricks: usize, max_memory: u64) -> Result<()> {
    let accumulators = rayon::current_num_threads().max(2);
    let each = (1 + accumulators) * BRICK * size_of::<Vec4>() + 8 * 3 * LEAF_VOXELS * size_of::<f32>();
    if (bricks * each) as u64 > max_memory {
        return Err(Error::unsupported(format!("the colors of {bricks} blocks of 8³ voxels do not fit in memory"))
            .coded(Code::MemoryLimit)
            .hint("choose a larger ⟨voxel_size⟩ or a smaller ⟨resolution⟩, or raise ⟨max_memory⟩"));
    }
    Ok(())
}

/// Returns the mean color of the medium: light that is not the background's, over opacity.
fn mean_color(photos: &[Photo], background: [f32; 3]) -> [f32; 3] {
    let sum = |photo: &Photo| {
        photo.film.rgba.iter().filter(|p| p.iter().all(|v| v.is_finite())).fold([0.0_f64; 4], |sum, p| {
            let emitted = |c: usize| f64::from(p[c]) - f64::from(background[c]) * (1.0 - f64::from(p[3]));
            [sum[0] + emitted(0), sum[1] + emitted(1), sum[2] + emitted(2), sum[3] + f64::from(p[3])]
        })
    };
    let sums: Vec<[f64; 4]> = photos.par_iter().map(sum).collect();
    let total = |c: usize| sums.iter().map(|s| s[c]).sum::<f64>();
    [0, 1, 2].map(|c| (total(c) / total(3).max(1e-12)).max(0.0) as f32)
}

/// Resamples extinctions to voxels 2^`level` times as large.
fn coarser(extinctions: &Bricks<f32>, level: u32) -> Result<Bricks<f32>> {
    let lattice = lattice::coarser(&extinctions.transform, level)?;
    let corners = (0..8).map(|c| IVec3::new(c >> 2, c >> 1 & 1, c & 1));
    // Those that hold the voxels, and those below, into whose cells these reach.
    let bricks = extinctions.topology.bricks().iter().flat_map(|b| corners.clone().map(|c| b.map(|v| v >> level) - c));
    let topology = Arc::new(Topology::new(bricks)?);
    let owned = extinctions.resampled(&topology, &lattice);
    let mut field = Bricks::zeros(topology, lattice);
    field.topology.fill_apron(&owned, &mut field.values);
    Ok(field)
}
