//! Densities seen through a transfer function.
//!
//! Through a function that is not monotonic, descent from an arbitrary start ends in the nearest minimum. So the start
//! is found without descent (Weiss & Westermann 2021, sect. 5.3): a pre-shaded volume, whose parts are linear in the
//! pictures ([`color`]), then the densities that match its colors (`matching`). Descent then adds the detail that the
//! volume's resolution lost ([`fit`](crate::inverse::density::descent)).

pub mod alternatives;
pub(crate) mod matching;

use crate::differentiate::gradient::pictures::Target;
use crate::differentiate::loss::prior::{VolumePrior, Weighted};
use crate::error::{Error, Result};
use crate::inverse::color::{self, Shaded};
use crate::inverse::density::descent::{Fit, ForwardModel, Views, batches, squared, unknowns};
use crate::inverse::density::{Outcome, Request};
use crate::inverse::observation::Observation;
use crate::inverse::observation::photo::Photo;
use crate::inverse::progress::{Progress, Step};
use crate::render::quadrature::Quadrature;
use crate::scene::bricks::Bricks;
use crate::scene::grid::LEAF_VOXELS;
use crate::scene::medium::{Medium, Source};
use glam::Vec4;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::Instant;

/// Part named in errors about the transfer function.
pub const FUNCTION: &str = "transfer function";

/// Views per step.
const BATCH: usize = 8;
/// Divisor of the pixels of a view that a step uses; the others have their turn in later epochs.
const TURNS: usize = 4;
/// Learning rate in units of the function's range, and its factor after an epoch that gained less than [`GAIN`] dB.
const RATE: f32 = 0.02;
const SLOWER: f32 = 0.5;
const GAIN: f64 = 0.1;
/// Learning rate below which the descent ends.
const SLOWEST: f32 = 0.001;
/// Default prior of the descent.
const PRIOR: Weighted<VolumePrior> = Weighted { prior: VolumePrior::Smooth, weight: 1e-3 };

/// Reconstructs densities from colors; `request.medium` has the transfer function, and `request.iterations` bounds the
/// epochs of the descent. `watch` is called with every step and may stop the work; the result so far is returned then.
///
/// # Errors
/// If the medium has no transfer function or one that ends at density 0 or below, if the unknowns do not fit in memory,
/// and as [`color::reconstruct`].
pub fn reconstruct(
    photos: &[Photo],
    observation: &Observation,
    request: &Request,
    mut watch: impl FnMut(&Step) -> ControlFlow<()>,
) -> Result<Outcome> {
    let Source::Transfer(table) = &request.medium.source else {
        return Err(Error::invalid("there is no transfer function to look behind")
            .hint("give one with ⟨tf⟩, or in the capture"));
    };
    let mut progress = Progress::new(&mut watch);
    let lattice = request.lattice;
    let limit = (request.max_memory / (LEAF_VOXELS * 128) as u64) as usize;
    let (topology, unknown) = unknowns(observation, request, &lattice, limit)?;
    let topology = Arc::new(topology);
    // Densities are not negative: what the function does below zero is not looked for.
    let range = table.knots()[table.knots().len() - 1] as f32;
    if !(range.is_normal() && range > 0.0) {
        return Err(Error::invalid(format!(
            "the transfer function ends at density {range}: all above are the same to it"
        ))
        .part(FUNCTION)
        .hint("give one with points at densities above 0, by ⟨tf⟩ or in transforms.json"));
    }
    let densities = match &request.init {
        Some(init) => init.resampled(&topology, &lattice),
        None => {
            let volume = colors(photos, observation, request, &mut progress)?;
            let begun = Instant::now();
            let matched =
                matching::densities(&volume, table, request.medium.extinction, &topology, &unknown, &request.cancel)?;
            progress.stage("densities of the colors", begun);
            matched.owned()
        }
    };

    let begun = Instant::now();
    let views = Views::new(photos, request);
    let quadrature = Quadrature::COARSE;
    let model = ForwardModel { medium: &request.medium, background: request.background, quadrature };
    let mut fit = Fit::new(topology, lattice, &unknown, &densities, range, RATE);
    let best = descend(&mut fit, &views, &model, request, &mut progress)?;
    fit.cancel = request.closing.clone();
    progress.stage("descent", begun);
    Ok(Outcome {
        train_psnr_db: views.train_psnr(&fit, &model)?,
        held_out_psnr_db: (!views.held_out.is_empty()).then_some(best),
        unknowns: fit.unknowns(),
        field: fit.field,
        history: progress.history,
        stages: progress.stages,
        stopped: progress.stopped,
    })
}

/// Reconstructs a pre-shaded volume from the photos.
fn colors(
    photos: &[Photo],
    observation: &Observation,
    request: &Request,
    progress: &mut Progress<'_>,
) -> Result<Bricks<Vec4>> {
    let request = Request { medium: Medium::absorbing(1.0), iterations: EXTINCTION_ITERATIONS, ..request.clone() };
    let Shaded { volume, history, stages, stopped, .. } =
        color::reconstruct(photos, observation, &request, None, |step| progress.watch(step))?;
    (progress.history, progress.stages, progress.stopped) = (history, stages, stopped);
    Ok(volume)
}

/// Descends from the densities of a fit, and leaves in it those of the epoch whose pictures are best; returns the PSNR
/// of these: of the held-out views, or without any of those that are fitted.
fn descend(
    fit: &mut Fit,
    views: &Views,
    model: &ForwardModel<'_>,
    request: &Request,
    progress: &mut Progress<'_>,
) -> Result<f64> {
    let compared: Vec<&Target> =
        if views.held_out.is_empty() { &views.train } else { &views.held_out }.iter().collect();
    let prior = request.prior.unwrap_or(PRIOR);
    let mut rate = RATE;
    fit.cancel = request.cancel.clone();
    let mut best = (fit.psnr(&compared, model)?, fit.field.clone());
    progress.stopped |= request.cancel.requested();
    for epoch in 0..request.iterations {
        if progress.stopped || rate < SLOWEST {
            break;
        }
        fit.rate(rate);
        let batches = batches(&views.train, BATCH, epoch);
        let mut psnr = best.0;
        for (number, batch) in batches.iter().enumerate() {
            let thin: Vec<Target> = batch.iter().map(|t| thinned(t, epoch as usize + number)).collect();
            let loss = fit.step(&thin.iter().collect::<Vec<_>>(), model, &squared, prior)?;
            let last = number + 1 == batches.len();
            if last {
                psnr = fit.psnr(&compared, model)?;
            }
            if request.cancel.requested() {
                progress.stopped = true;
                break;
            }
            progress.step(0, loss, (last && !views.held_out.is_empty()).then_some(psnr));
            fit.offer(request);
            if progress.stopped {
                break;
            }
        }
        if psnr < best.0 + GAIN {
            rate *= SLOWER;
        }
        if psnr > best.0 {
            best = (psnr, fit.field.clone());
        }
    }
    fit.field = best.1;
    Ok(best.0)
}

/// Iterations of the extinctions on their finest level.
const EXTINCTION_ITERATIONS: u32 = 24;

/// Returns the largest number of steps of a run with `views` training pictures.
pub fn most_iterations(observation: &Observation, request: &Request, views: usize) -> u64 {
    let colors = if request.init.is_some() { 0 } else { color::most_iterations(observation, request) };
    colors + u64::from(request.iterations) * views.div_ceil(BATCH) as u64
}

/// Returns a target of which only every [`TURNS`]th pixel is finite, those of this turn.
fn thinned(target: &Target, turn: usize) -> Target {
    let width = target.camera.width as usize;
    // Neighbours have different turns.
    let in_turn = |i: usize| (i % width + 2 * (i / width) + turn).is_multiple_of(TURNS);
    let rgba = target.rgba.iter().enumerate().map(|(i, p)| if in_turn(i) { *p } else { [f32::NAN; 4] }).collect();
    Target { camera: target.camera, rgba, rays_per_edge: target.rays_per_edge }
}
