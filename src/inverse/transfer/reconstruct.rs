//! The reconstruction of texels: extinctions, colors, then both along a path of ever less smoothing.

use super::fit::{Fit, Unknowns};
use super::{Outcome, PATH_WEIGHTS, REFINEMENTS, Request, Solver, Step, USUAL, weiss2021};
use crate::error::{Error, Result};
use crate::inverse::observation::photo::Photo;
use crate::inverse::progress::Stage;
use crate::metrics::error::unit_psnr_db;
use crate::scene::bricks::Bricks;
use crate::scene::table::Rgbs;
use std::ops::ControlFlow;
use std::time::Instant;

/// Factor of the least error up to which a refinement counts as good as the best.
const GOOD_ENOUGH: f64 = 1.02;
/// Texels of the first guess, at most.
const FIRST_TEXELS: usize = 64;

/// Finds the texels whose pictures of `field` are most like `photos`.
///
/// # Errors
/// If the request's numbers cannot be used, or no pixel of the used views is finite and meets the volume; if the work
/// was stopped before anything was found.
pub fn reconstruct(
    field: &Bricks<f32>,
    photos: &[Photo],
    request: &Request,
    mut watch: impl FnMut(&Step) -> ControlFlow<()>,
) -> Result<Outcome> {
    let start = Instant::now();
    let fit = Fit::new(field, photos, request)?;
    match request.solver {
        Solver::Newton => newton(fit, start, &mut watch),
        Solver::Weiss2021 => weiss2021::descend(fit, start, &mut watch),
    }
}

/// Extinctions from alpha, colors, then both; smoothness by the held-out views.
fn newton(mut fit: Fit<'_>, start: Instant, watch: &mut dyn FnMut(&Step) -> ControlFlow<()>) -> Result<Outcome> {
    let request = fit.request;
    let mut stages = Vec::new();
    let first = request.smooth.unwrap_or(PATH_WEIGHTS[0]);
    if request.init.is_none() {
        first_guess(&mut fit, first, &mut stages)?;
    }
    let begun = Instant::now();
    let (history, candidates, mut stopped) = regularisation_path(&mut fit, start, watch)?;
    stopped |= request.cancel.requested();
    stages.push(Stage { name: "extinctions and colors".into(), seconds: begun.elapsed().as_secs_f64() });
    // The smoothest of those that are as good as the best.
    let enough = GOOD_ENOUGH * least(&candidates);
    let mut smooth = first;
    if let Some((_, texels, weight)) = candidates.into_iter().find(|t| t.0 <= enough) {
        (fit.texels, smooth) = (texels, weight);
    }
    let confidence = if stopped { Vec::new() } else { fit.confidence(smooth)? };
    // The confidence may have been stopped, too: it is left out then.
    let late = request.cancel.requested();
    Ok(Outcome {
        confidence: if late { Vec::new() } else { confidence },
        transfer: fit.transfer(),
        smooth,
        history,
        stages,
        stopped: stopped || late,
    })
}

/// Finds extinctions from alpha, then colors, of few texels.
fn first_guess(fit: &mut Fit<'_>, smooth: f64, stages: &mut Vec<Stage>) -> Result<()> {
    let request = fit.request;
    let begun = Instant::now();
    // What is refined afterwards need not be fine.
    fit.resample(request.texels.min(FIRST_TEXELS))?;
    fit.extinctions_from_alpha(smooth)?;
    if request.cancel.requested() {
        return Err(Error::cancelled());
    }
    stages.push(Stage { name: "extinctions from alpha".into(), seconds: begun.elapsed().as_secs_f64() });
    let begun = Instant::now();
    fit.refine(smooth, Unknowns::Colors)?;
    fit.resample(request.texels)?;
    stages.push(Stage { name: "colors".into(), seconds: begun.elapsed().as_secs_f64() });
    Ok(())
}

/// A refinement: its error, its texels, and the weight of the smoothness prior.
type Candidate = (f64, Vec<Rgbs>, f64);

/// Refines extinctions and colors with the weights of the prior in turn, strongest first; returns all steps and
/// refinements, and whether `watch` stopped the work.
fn regularisation_path(
    fit: &mut Fit<'_>,
    start: Instant,
    watch: &mut dyn FnMut(&Step) -> ControlFlow<()>,
) -> Result<(Vec<Step>, Vec<Candidate>, bool)> {
    let request = fit.request;
    // Held-out views without a pixel that is finite choose nothing.
    let weights = if fit.held_out.is_empty() && request.smooth.is_none() { &[USUAL] } else { request.weights() };
    let refinements = if weights.len() > 1 { REFINEMENTS } else { request.iterations };
    let (mut history, mut candidates): (Vec<Step>, Vec<Candidate>) = (Vec::new(), Vec::new());
    for &smooth in weights {
        for _ in 0..refinements {
            if history.len() as u32 >= request.iterations {
                return Ok((history, candidates, false));
            }
            let rms = fit.refine(smooth, Unknowns::All)?;
            let error = fit.error(&fit.held_out)?;
            if request.cancel.requested() {
                return Ok((history, candidates, false));
            }
            let step = Step {
                iteration: history.len() as u32 + 1,
                seconds: start.elapsed().as_secs_f64(),
                smooth,
                rms,
                held_out_psnr_db: error.map(unit_psnr_db),
            };
            history.push(step);
            candidates.push((error.unwrap_or(rms * rms), fit.texels.clone(), smooth));
            if watch(&step).is_break() {
                return Ok((history, candidates, true));
            }
        }
        // Past the best weight less smoothing follows the noise.
        if weights.len() > 1 && candidates.last().is_some_and(|last| last.0 > 1.5 * least(&candidates)) {
            break;
        }
    }
    Ok((history, candidates, false))
}

fn least(candidates: &[Candidate]) -> f64 {
    candidates.iter().fold(f64::INFINITY, |least, t| least.min(t.0))
}
