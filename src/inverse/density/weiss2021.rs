//! The density reconstruction of Weiss & Westermann (2021, sect. 5.3), as published: Adam with
//! learning rate 0.3 on batches of 8 views, L1 loss on the pictures plus λ = 0.5 times the mean
//! squared difference of neighbouring voxels, 32³ doubled every 10 epochs, 50 epochs at the end.
//!
//! Densities are in the unit in which the paper's volumes lie in 0..1: the last point of a transfer function, or else
//! taken from the pictures, the density that, over a quarter of the box, gives the largest optical depth seen.

use crate::differentiate::loss::prior::{VolumePrior, Weighted};
use crate::error::{Kind, Result};
use crate::inverse::density::descent::{Fit, ForwardModel, Views, absolute, batches, unknowns};
use crate::inverse::density::{Outcome, Request};
use crate::inverse::observation::Observation;
use crate::inverse::observation::depth_map::DepthMap;
use crate::inverse::observation::photo::Photo;
use crate::inverse::progress::{Progress, Step};
use crate::inverse::region::lattice;
use crate::render::quadrature::Quadrature;
use crate::scene::bricks::Bricks;
use crate::scene::grid::LEAF_VOXELS;
use crate::scene::medium::Source;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::Instant;

const RATE: f32 = 0.3;
const BATCH: usize = 8;
/// Prior as published.
const PRIOR: Weighted<VolumePrior> = Weighted { prior: VolumePrior::Smooth, weight: 0.5 };
const COARSEST: f64 = 32.0;
const COARSE_EPOCHS: u32 = 10;
const START: f32 = 0.1;

/// Reconstructs densities from colors, for any medium and without assuming linearity. One step per batch is reported;
/// `request.iterations` bounds the epochs on the finest level.
///
/// # Errors
/// If the pictures leave no unknown, the unknowns do not fit in memory, or the medium cannot be used.
pub fn reconstruct(
    photos: &[Photo],
    observation: &Observation,
    request: &Request,
    mut watch: impl FnMut(&Step) -> ControlFlow<()>,
) -> Result<Outcome> {
    let views = Views::new(photos, request);
    let (unit, quadrature) = match &request.medium.source {
        Source::Transfer(table) => (table.knots()[table.knots().len() - 1], Quadrature::COARSE),
        _ => {
            let longest = request.bounds.size().max_element();
            let deepest = |map: &DepthMap| map.depths().depth.iter().fold(0.0_f32, |a, b| a.max(*b));
            let deepest = observation.maps.iter().map(deepest).fold(0.0, f32::max);
            (f64::from(deepest) / (0.25 * longest * request.medium.extinction), Quadrature::Exact)
        }
    };
    let model = ForwardModel { medium: &request.medium, background: request.background, quadrature };

    let mut level = coarsest(request);
    let mut field = request.init.as_deref().cloned();
    let mut progress = Progress::new(&mut watch);
    let mut unknowns = None;
    loop {
        let begun = Instant::now();
        let mut fit = match begin(observation, request, level, field.as_ref(), unit) {
            // What the coarser levels found stands.
            Err(e)
                if e.kind() == Kind::Cancelled
                    && let (Some(field), Some(unknowns)) = (field.take(), unknowns) =>
            {
                return Ok(Outcome {
                    field,
                    train_psnr_db: f64::NAN,
                    held_out_psnr_db: progress.history.last().and_then(|step| step.held_out_psnr_db),
                    unknowns,
                    history: progress.history,
                    stages: progress.stages,
                    stopped: true,
                });
            }
            fit => fit?,
        };
        unknowns = Some(fit.unknowns());
        descend(&mut fit, level, &views, &model, request, &mut progress)?;
        progress.stage(format!("level {level}: Adam"), begun);
        if level == 0 || progress.stopped {
            fit.cancel = request.closing.clone();
            return Ok(Outcome {
                train_psnr_db: views.train_psnr(&fit, &model)?,
                held_out_psnr_db: views.held_out_psnr(&fit, &model)?,
                unknowns: fit.unknowns(),
                field: fit.field,
                history: progress.history,
                stages: progress.stages,
                stopped: progress.stopped,
            });
        }
        field = Some(fit.field);
        level -= 1;
    }
}

/// Runs the epochs of one level.
fn descend(
    fit: &mut Fit,
    level: u32,
    views: &Views,
    model: &ForwardModel<'_>,
    request: &Request,
    progress: &mut Progress<'_>,
) -> Result<()> {
    fit.cancel = request.cancel.clone();
    let epochs = if level == 0 { request.iterations } else { COARSE_EPOCHS.min(request.iterations) };
    for epoch in 0..epochs {
        for batch in batches(&views.train, BATCH, epoch) {
            let loss = fit.step(&batch, model, &absolute, request.prior.unwrap_or(PRIOR))?;
            let held_out_psnr_db = views.held_out_psnr(fit, model)?;
            if request.cancel.requested() {
                progress.stopped = true;
                return Ok(());
            }
            progress.step(level, loss, held_out_psnr_db);
            fit.offer(request);
            if progress.stopped {
                return Ok(());
            }
        }
    }
    Ok(())
}

/// Returns the level to begin on; a start is used on the finest.
fn coarsest(request: &Request) -> u32 {
    if request.init.is_some() {
        return 0;
    }
    lattice::coarser_levels(&request.lattice, &request.bounds, COARSEST)
}

/// Returns the largest number of steps of a run with `views` training pictures.
pub fn most_iterations(request: &Request, views: usize) -> u64 {
    let epochs = request.iterations + coarsest(request) * COARSE_EPOCHS.min(request.iterations);
    u64::from(epochs) * views.div_ceil(BATCH) as u64
}

/// Creates the fit of one level, in the paper's unit of density.
fn begin(
    observation: &Observation,
    request: &Request,
    level: u32,
    start: Option<&Bricks<f32>>,
    unit: f64,
) -> Result<Fit> {
    let lattice = lattice::coarser(&request.lattice, level)?;
    let limit = (request.max_memory / (LEAF_VOXELS * 64) as u64) as usize;
    let (topology, unknown) = unknowns(observation, request, &lattice, limit)?;
    let topology = Arc::new(topology);
    let start = match start {
        Some(field) => field.resampled(&topology, &lattice),
        None => vec![START * unit as f32; unknown.len()],
    };
    Ok(Fit::new(topology, lattice, &unknown, &start, unit as f32, RATE))
}
