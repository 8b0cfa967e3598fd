//! Densities seen through a transfer function.
//!
//! Through a function that is not monotonic, descent from an arbitrary start ends in the nearest minimum. So the start
//! is found without descent (Weiss & Westermann 2021, sect. 5.3): a pre-shaded volume, whose parts are linear in the
//! pictures ([`color`]), then the densities that match its colors ([`matching`]). Descent then adds the detail that the
//! volume's resolution lost ([`fit`](crate::optimise::density::descent)).

use crate::error::{Error, Result};
use crate::optimise::color::{self, Shaded};
use crate::optimise::density::descent::{Fit, Scene, batches, squared, unknowns};
use crate::optimise::density::matching;
use crate::optimise::density::{Outcome, Request, Stage, Step};
use crate::optimise::gradient::pictures::Target;
use crate::optimise::loss::prior::{VolumePrior, Weighted};
use crate::optimise::projection::observation::{Observation, Photo};
use crate::render::quadrature::Quadrature;
use crate::scene::grid::LEAF_VOXELS;
use crate::scene::medium::{Medium, Source};
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
            .hint("give one with --tf, or in the capture"));
    };
    let start = Instant::now();
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
        .hint("give one with points at densities above 0, by --tf or in transforms.json"));
    }

    let (densities, mut history, mut stages, mut stopped) = match &request.init {
        Some(init) => (init.resampled(&topology, &lattice), Vec::new(), Vec::new(), false),
        None => {
            let asked =
                Request { medium: Medium::absorbing(1.0), iterations: EXTINCTION_ITERATIONS, ..request.clone() };
            let Shaded { volume, history, mut stages, stopped, .. } =
                color::reconstruct(photos, observation, &asked, None, &mut watch)?;
            let begun = Instant::now();
            let matched =
                matching::densities(&volume, table, request.medium.extinction, &topology, &unknown, request.cancel)?;
            stages.push(Stage { name: "densities of the colors".into(), seconds: begun.elapsed().as_secs_f64() });
            (matched.owned(), history, stages, stopped)
        }
    };

    let begun = Instant::now();
    let target =
        |p: &Photo| Target { camera: p.camera, rgba: p.film.rgba.clone(), rays_per_edge: request.rays_per_edge };
    let held = |i: &usize| request.held_out.contains(i);
    let train: Vec<Target> = (0..photos.len()).filter(|i| !held(i)).map(|i| target(&photos[i])).collect();
    let held_out: Vec<Target> = (0..photos.len()).filter(held).map(|i| target(&photos[i])).collect();
    let looked_at: Vec<&Target> = if held_out.is_empty() { train.iter().collect() } else { held_out.iter().collect() };
    let scene =
        Scene { medium: &request.medium, background: request.background, quadrature: Quadrature::PREINTEGRATED };

    let mut rate = RATE;
    let prior = request.prior.unwrap_or(PRIOR);
    let mut fit = Fit::new(topology, lattice, &unknown, &densities, range, rate);
    fit.cancel = request.cancel;
    let mut best = (fit.psnr(&looked_at, &scene)?, fit.field.clone());
    stopped |= request.cancel.requested();
    for epoch in 0..request.iterations {
        if stopped || rate < SLOWEST {
            break;
        }
        fit.rate(rate);
        let batches = batches(&train, BATCH, epoch);
        let mut now = best.0;
        for (number, batch) in batches.iter().enumerate() {
            let some: Vec<Target> = batch.iter().map(|t| thinned(t, epoch as usize + number)).collect();
            let loss = fit.step(&some.iter().collect::<Vec<_>>(), &scene, &squared, prior)?;
            let last = number + 1 == batches.len();
            if last {
                now = fit.psnr(&looked_at, &scene)?;
            }
            if request.cancel.requested() {
                stopped = true;
                break;
            }
            let step = Step {
                level: 0,
                iteration: history.len() as u32 + 1,
                seconds: start.elapsed().as_secs_f64(),
                loss,
                held_out_psnr_db: (last && !held_out.is_empty()).then_some(now),
            };
            history.push(step);
            stopped = watch(&step).is_break();
            if stopped {
                break;
            }
        }
        if now < best.0 + GAIN {
            rate *= SLOWER;
        }
        if now > best.0 {
            best = (now, fit.field.clone());
        }
    }
    fit.field = best.1;
    fit.cancel = request.closing;
    stages.push(Stage { name: "descent".into(), seconds: begun.elapsed().as_secs_f64() });
    Ok(Outcome {
        train_psnr_db: fit.psnr(&train.iter().collect::<Vec<_>>(), &scene)?,
        held_out_psnr_db: (!held_out.is_empty()).then_some(best.0),
        unknowns: fit.unknowns(),
        field: fit.field,
        history,
        stages,
        stopped,
    })
}

/// Iterations of the extinctions on their finest level.
const EXTINCTION_ITERATIONS: u32 = 24;

/// Returns the largest number of steps of a run with `views` training pictures.
pub fn most_iterations(request: &Request, views: usize) -> u64 {
    let colors = if request.init.is_some() { 0 } else { color::most_iterations(request) };
    colors + u64::from(request.iterations) * views.div_ceil(BATCH) as u64
}

/// Returns a target of which only every [`TURNS`]th pixel is finite, those of this turn.
fn thinned(target: &Target, turn: usize) -> Target {
    let width = target.camera.width as usize;
    // Neighbours have different turns.
    let asked = |i: usize| (i % width + 2 * (i / width) + turn).is_multiple_of(TURNS);
    let rgba = target.rgba.iter().enumerate().map(|(i, p)| if asked(i) { *p } else { [f32::NAN; 4] }).collect();
    Target { camera: target.camera, rgba, rays_per_edge: target.rays_per_edge }
}
