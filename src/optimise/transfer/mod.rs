//! A transfer function from pictures of a known volume (Weiss & Westermann 2021, sect. 5.2), by Gauss and
//! Newton instead of a thousand small steps.
//!
//! A few hundred unknowns stand against a hundred thousand pixels, and most of the problem is linear: the
//! logarithm of the transmittance is linear in the extinctions, and with these known the picture is linear in
//! the colors. So extinctions are taken from alpha first, colors from them, and then both are refined
//! together on the normal equations of rays drawn from all pictures. How smooth the function is, the
//! held-out views decide. The thousand steps are there to compare with ([`Solver::Weiss2021`]).

mod normal;
mod rays;
mod rows;
mod weiss2021;

use crate::cancel::Cancel;
use crate::error::{Error, Result};
use crate::metrics::error::unit_psnr_db;
use crate::optimise::density::Stage;
use crate::optimise::projection::photo::Photo;
use crate::render::composited::Composited;
use crate::render::dvr::Dvr;
use crate::render::quadrature::Quadrature;
use crate::scene::bricks::Bricks;
use crate::scene::medium::{Medium, Source};
use crate::scene::table::Rgbs;
use crate::scene::transfer::Transfer;
use normal::Prior;
use rays::{Draw, Rays};
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::Instant;

/// How texels are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Solver {
    /// Gauss and Newton.
    Newton,
    /// Adam, as published (Weiss & Westermann 2021).
    #[serde(alias = "paper")]
    Weiss2021,
}

impl Solver {
    /// Returns the name of the solver's steps.
    pub fn steps(self) -> &'static str {
        match self {
            Self::Newton => "refinements",
            Self::Weiss2021 => "epochs",
        }
    }
}

/// Known properties of the pictures, and settings of the reconstruction.
#[derive(Debug, Clone)]
pub struct Request {
    /// Factor of the extinctions that the pictures were made with; it is divided out.
    pub extinction: f64,
    /// Radiance behind the volume.
    pub background: [f32; 3],
    /// How rays are integrated.
    pub quadrature: Quadrature,
    /// Range of densities that the texels cover.
    pub domain: [f64; 2],
    /// Number of texels.
    pub texels: usize,
    /// How it is found.
    pub solver: Solver,
    /// Weight of the smoothness prior: relative to the data's, chosen by the held-out views if `None`; the paper's λ,
    /// 0.4 if `None`.
    pub smooth: Option<f64>,
    /// Views that are not used.
    pub held_out: Vec<usize>,
    /// Rays drawn from the used views, about.
    pub rays: usize,
    /// Rays along each edge of a pixel.
    pub rays_per_edge: usize,
    /// Refinements of extinctions and colors together, or epochs, at most.
    pub iterations: u32,
    /// A function to begin with.
    pub init: Option<Transfer>,
    /// Polled inside every pass: what was found by then is the result.
    pub cancel: Cancel,
}

impl Request {
    /// Weights of the prior that are tried, strongest first.
    fn weights(&self) -> &[f64] {
        match (&self.smooth, self.held_out.is_empty()) {
            (Some(weight), _) => std::slice::from_ref(weight),
            (None, true) => &[USUAL],
            (None, false) => &PATH_WEIGHTS,
        }
    }

    /// Refinements or epochs that there will be at most.
    pub fn most_steps(&self) -> u32 {
        match (self.solver, self.weights().len()) {
            (Solver::Weiss2021, _) | (_, 1) => self.iterations,
            (Solver::Newton, weights) => self.iterations.min(weights as u32 * REFINEMENTS),
        }
    }
}

/// State after a refinement.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, schemars::JsonSchema)]
pub struct Step {
    /// Number, from 1.
    pub iteration: u32,
    /// Seconds since the start.
    pub seconds: f64,
    /// Weight of the prior.
    pub smooth: f64,
    /// Root mean square difference over the rays that were used.
    pub rms: f64,
    /// PSNR over rays of the held-out views, peak 1.
    pub held_out_psnr_db: Option<f64>,
}

/// Reconstructed transfer function, and how the work went.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The function, as a texture.
    pub transfer: Transfer,
    /// How much the pictures say about each texel's extinction and color, 0..1: the share of the
    /// curvature that is theirs, not the prior's. Empty after a descent, and where the work was stopped.
    pub confidence: Vec<[f64; 2]>,
    /// Weight of the prior that was chosen.
    pub smooth: f64,
    /// Every refinement.
    pub history: Vec<Step>,
    /// Time by stage.
    pub stages: Vec<Stage>,
    /// True if `watch` broke off.
    pub stopped: bool,
}

/// Weights of the prior, strongest first: each begins where the one before it ended.
const PATH_WEIGHTS: [f64; 7] = [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7];
/// Weight of the prior without held-out views.
const USUAL: f64 = 1e-4;
/// Factor of the least error up to which a refinement counts as good as the best.
const GOOD_ENOUGH: f64 = 1.02;
/// Texels of the first guess, at most.
const FIRST_TEXELS: usize = 64;
/// Least damping of the steps: far more than the rounding of the sums of derivatives.
const LEAST_DAMPING: f64 = 1e-6;
/// Refinements with each weight.
const REFINEMENTS: u32 = 1;

/// Finds the texels whose pictures of `field` are most like `photos`.
///
/// # Errors
/// If the request's numbers cannot be used, or no pixel of the used views is finite and meets the volume; if the work was stopped before anything was found.
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
        Solver::Weiss2021 => descend(fit, start, &mut watch),
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

/// The paper's recipe; of all epochs, and of the start if one was given, what suits the held-out views best, or without
/// these the pictures. Nothing is said about confidence: there are no normal equations.
fn descend(mut fit: Fit<'_>, start: Instant, watch: &mut dyn FnMut(&Step) -> ControlFlow<()>) -> Result<Outcome> {
    let request = fit.request;
    let smooth = request.smooth.unwrap_or(weiss2021::SMOOTH);
    let mut descent = weiss2021::Descent::new(&fit);
    let score = |fit: &Fit<'_>| fit.error(if fit.held_out.is_empty() { &fit.used } else { &fit.held_out });
    let init_error = if request.init.is_some() { score(&fit)? } else { None };
    let mut best = (init_error.unwrap_or(f64::INFINITY), fit.texels.clone());
    let (mut history, mut stopped) = (Vec::new(), false);
    for iteration in 1..=request.iterations {
        let rms = descent.step(&fit, smooth)?;
        fit.texels = descent.texels();
        let error = score(&fit)?.unwrap_or(f64::INFINITY);
        if request.cancel.requested() {
            stopped = true;
            break;
        }
        if error < best.0 {
            best = (error, fit.texels.clone());
        }
        let held_out_psnr_db = (!fit.held_out.is_empty()).then(|| unit_psnr_db(error));
        let step = Step { iteration, seconds: start.elapsed().as_secs_f64(), smooth, rms, held_out_psnr_db };
        history.push(step);
        stopped = watch(&step).is_break();
        if stopped {
            break;
        }
    }
    fit.texels = best.1;
    let stages = vec![Stage { name: "Adam".into(), seconds: start.elapsed().as_secs_f64() }];
    Ok(Outcome { confidence: Vec::new(), transfer: fit.transfer(), smooth, history, stages, stopped })
}

fn least(candidates: &[Candidate]) -> f64 {
    candidates.iter().fold(f64::INFINITY, |least, t| least.min(t.0))
}

/// A function at the centres of so many texels.
fn sampled(transfer: &Transfer, domain: [f64; 2], texels: usize) -> Result<Vec<Rgbs>> {
    let table = transfer.table()?;
    Ok(Transfer::centres(domain, texels).into_iter().map(|d| table.at(d)).collect())
}

/// Unknowns that a refinement changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Unknowns {
    Colors,
    All,
}

/// The texels, and the rays that they are to explain.
struct Fit<'a> {
    field: &'a Bricks<f32>,
    request: &'a Request,
    texels: Vec<Rgbs>,
    used: Rays,
    held_out: Rays,
    /// Damping of the steps (Levenberg & Marquardt).
    damping: f64,
}

impl<'a> Fit<'a> {
    fn new(field: &'a Bricks<f32>, photos: &[Photo], request: &'a Request) -> Result<Self> {
        let is_held_out = |i: usize| request.held_out.contains(&i);
        let mut used =
            Rays::draw(photos, |i| !is_held_out(i), Draw { count: request.rays, per_edge: request.rays_per_edge });
        let some = Draw { count: request.rays / 8, per_edge: request.rays_per_edge };
        let mut held_out = Rays::draw(photos, is_held_out, some);
        (used.cancel, held_out.cancel) = (request.cancel, request.cancel);
        if used.is_empty() {
            return Err(Error::invalid("no pixel of the used views has finite values")
                .hint("check the pictures with `cumulo validate`"));
        }
        let texels = match &request.init {
            Some(init) => sampled(init, request.domain, request.texels)?,
            None => vec![[0.5, 0.5, 0.5, 0.0]; request.texels],
        };
        let fit = Self { field, request, texels, used, held_out, damping: 1e-4 };
        fit.transfer().checked()?;
        Ok(fit)
    }

    /// Samples the current function at another number of texels.
    fn resample(&mut self, texels: usize) -> Result<()> {
        self.texels = sampled(&self.transfer(), self.request.domain, texels)?;
        Ok(())
    }

    fn transfer(&self) -> Transfer {
        Transfer::Texture { domain: self.request.domain, texels: self.texels.clone() }
    }

    fn renderer(&self, texels: &[Rgbs]) -> Result<Composited<Dvr<'a, f32>>> {
        let transfer = Transfer::Texture { domain: self.request.domain, texels: texels.to_vec() };
        let source = Source::Transfer(Arc::new(transfer.table()?));
        let medium = Medium::new(self.request.extinction, source);
        Ok(Dvr::new(self.field, medium)?.quadrature(self.request.quadrature).over(self.request.background))
    }

    /// Extinctions by Gauss and Newton on `T = e^{-H s}`: with nothing that absorbs, the derivative of alpha
    /// is H, and one walk finds it.
    fn extinctions_from_alpha(&mut self, smooth: f64) -> Result<()> {
        let non_absorbing: Vec<Rgbs> = self.texels.iter().map(|[r, g, b, _]| [*r, *g, *b, 0.0]).collect();
        let lengths = rows::lengths(&self.renderer(&non_absorbing)?, &self.used, self.texels.len());
        let extinctions = rows::extinctions(&lengths, &self.used, self.texels.len(), smooth);
        if self.request.cancel.requested() {
            return Ok(());
        }
        for (texel, extinction) in self.texels.iter_mut().zip(extinctions) {
            texel[3] = extinction;
        }
        Ok(())
    }

    /// One step; the root mean square difference before it. A step that makes things worse is taken back, and
    /// the next one is shorter.
    fn refine(&mut self, smooth: f64, unknowns: Unknowns) -> Result<f64> {
        let scale = self.scale();
        let normal = rows::normal(&self.renderer(&self.texels)?, &self.used, scale, self.texels.len());
        if self.request.cancel.requested() {
            return Ok(f64::NAN);
        }
        let before = normal.cost;
        let rms = (before / (4 * self.used.len()) as f64).sqrt();
        let prior = Prior { weight: smooth * normal.level(), scale };
        let penalty = |texels: &[Rgbs]| prior.cost(texels);
        let from = before + penalty(&self.texels);
        for _ in 0..6 {
            let Some(step) = normal.solve(&self.texels, &prior, self.damping, unknowns == Unknowns::All) else {
                self.damping *= 10.0;
                continue;
            };
            let cost = rows::cost(&self.renderer(&step)?, &self.used) + penalty(&step);
            if self.request.cancel.requested() {
                break;
            }
            if cost <= from {
                self.texels = step;
                self.damping = (0.2 * self.damping).max(LEAST_DAMPING);
                break;
            }
            self.damping = (10.0 * self.damping).max(1e-6);
        }
        Ok(rms)
    }

    /// Extinction that counts as much as a color of one.
    fn scale(&self) -> f64 {
        let largest = self.texels.iter().fold(0.0_f64, |m, t| m.max(t[3]));
        if largest > 0.0 { largest } else { 1.0 / self.field.world_bounds().size().max_element() }
    }

    /// Mean squared difference of the colors; `None` without rays.
    fn error(&self, rays: &Rays) -> Result<Option<f64>> {
        if rays.is_empty() {
            return Ok(None);
        }
        let square = rows::color_cost(&self.renderer(&self.texels)?, rays);
        Ok(Some(square / (3 * rays.len()) as f64))
    }

    fn confidence(&self, smooth: f64) -> Result<Vec<[f64; 2]>> {
        let scale = self.scale();
        let normal = rows::normal(&self.renderer(&self.texels)?, &self.used, scale, self.texels.len());
        let prior = Prior { weight: smooth * normal.level(), scale };
        Ok(normal.confidence(&prior))
    }
}
