//! The recipe of Weiss & Westermann (2021, sect. 5.2), as published: Adam with learning rate 0.8 on the sum of
//! absolute differences (eq. 12) plus λ times the mean squared difference of neighbouring texels, 200 epochs.
//!
//! As in their code colors are `1 / (1 + e^{-u})` of what descends and extinctions `ln(1 + e^u)`, these in units of
//! the one that, over a quarter of the volume, gives the largest optical depth seen. All begin at `u = 0`, where theirs
//! begin at noise; of the pixels, those are used that were drawn.

use super::fit::Fit;
use super::rays::Rays;
use super::rows::{PARTITIONS, render_pixel};
use super::{Outcome, Step};
use crate::differentiate::loss::prior::TransferPrior;
use crate::error::Result;
use crate::inverse::progress::Stage;
use crate::inverse::solver::adam::Adam;
use crate::inverse::solver::softplus;
use crate::metrics::error::unit_psnr_db;
use crate::render::composited::Composited;
use crate::render::differentiable::{Accumulators, Adjoint, ParameterGradient};
use crate::render::dvr::{Dvr, Tape};
use crate::render::tiles;
use crate::scene::table::{Rgbs, TableGradient};
use std::ops::ControlFlow;
use std::time::Instant;

const RATE: f32 = 0.8;
/// λ as published.
const SMOOTH: f64 = 0.4;
/// Alphas above this say that a ray is opaque, not how deep it is.
const OPAQUE: f32 = 0.999;
/// How close a color may come to 0 and 1, an extinction to 0, where a function is given to begin with.
const CLOSE: f64 = 1e-3;

/// Descends, and returns of all epochs, and of the start if one was given, the texels that suit the held-out views
/// best, or without such views the pictures. The confidence is empty: there are no normal equations.
pub(super) fn descend(
    mut fit: Fit<'_>,
    start: Instant,
    watch: &mut dyn FnMut(&Step) -> ControlFlow<()>,
) -> Result<Outcome> {
    let request = fit.request;
    let smooth = request.smooth.unwrap_or(SMOOTH);
    let mut descent = Descent::new(&fit);
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

/// State of the gradient descent of Weiss & Westermann (2021).
struct Descent {
    adam: Adam,
    u: Vec<f32>,
    unit: f64,
}

impl Descent {
    /// Begins with the texels of `fit` if these were given, else in the middle of everything.
    fn new(fit: &Fit<'_>) -> Self {
        let deepest = fit.used.targets.iter().fold(0.0_f32, |m, p| m.max(-(1.0 - p[3].clamp(0.0, OPAQUE)).ln()));
        let quarter = 0.25 * fit.field.world_bounds().size().max_element() * fit.request.extinction;
        let unit = if deepest > 0.0 { f64::from(deepest) / quarter } else { 1.0 / quarter };
        let of = |(c, v): (usize, &f64)| match c {
            3 => softplus::inverse((v / unit).max(CLOSE)),
            _ => {
                let v = v.clamp(CLOSE, 1.0 - CLOSE);
                (v / (1.0 - v)).ln()
            }
        };
        let u = match fit.request.init {
            Some(_) => fit.texels.iter().flat_map(|t| t.iter().enumerate().map(of)).map(|u| u as f32).collect(),
            None => vec![0.0; 4 * fit.texels.len()],
        };
        Self { adam: Adam::new(u.len(), RATE), u, unit }
    }

    /// The texels.
    fn texels(&self) -> Vec<Rgbs> {
        let of = |u: &[f32]| std::array::from_fn(|c| self.channel(c, f64::from(u[c])).0);
        self.u.chunks(4).map(of).collect()
    }

    /// Value of a channel, and its derivative.
    fn channel(&self, channel: usize, u: f64) -> (f64, f64) {
        let [value, share] = softplus::value(u);
        if channel == 3 {
            return (self.unit * value, self.unit * share);
        }
        (share, share * (1.0 - share))
    }

    /// Runs one epoch and returns the root mean square difference before it. Changes nothing once the work is to stop.
    fn step(&mut self, fit: &Fit<'_>, smooth: f64) -> Result<f64> {
        let texels = self.texels();
        let (square, by_texel) = absolute(&fit.renderer(&texels)?, &fit.used, texels.len());
        if fit.used.cancel.requested() {
            return Ok(f64::NAN);
        }
        let (_, prior) = TransferPrior::Smooth.evaluate(&texels, self.unit);
        let chain = |(i, u): (usize, &f32)| {
            let (texel, c) = (i / 4, i % 4);
            let (_, derivative) = self.channel(c, f64::from(*u));
            ((by_texel[texel][c] + smooth * prior[texel][c]) * derivative) as f32
        };
        let gradient: Vec<f32> = self.u.iter().enumerate().map(chain).collect();
        self.adam.step_free(&mut self.u, &gradient);
        Ok((square / (4 * fit.used.len()) as f64).sqrt())
    }
}

/// `Σ (rendered - target)²`, and the derivative by texel of the mean over pixels of `Σ_c |rendered - target|`.
fn absolute(dvr: &Composited<Dvr<'_, f32>>, rays: &Rays, texels: usize) -> (f64, Vec<Rgbs>) {
    let share = 1.0 / (rays.len() * rays.per_pixel) as f32;
    let parts = tiles::partitions(
        &mut vec![(Tape::default(), ParameterGradient::default()); PARTITIONS],
        &rays.cancel,
        |partition| (partition..rays.len()).step_by(PARTITIONS),
        |_| (0.0, TableGradient::of_knots(texels)),
        |(tape, shared), (square, table), pixel| {
            let rendered = render_pixel(dvr, rays, pixel, tape);
            let off: [f64; 4] = std::array::from_fn(|c| rendered[c] - f64::from(rays.targets[pixel][c]));
            *square += off.iter().map(|d| d * d).sum::<f64>();
            let cotangent = |d: f64| if d == 0.0 { 0.0 } else { share * d.signum() as f32 };
            let cotangent = off.map(cotangent);
            for ray in rays.of_pixel(pixel) {
                let to = Accumulators { voxels: None, table: Some(&mut *table), ray: None, shared: &mut *shared };
                dvr.vjp(ray, &mut |_| cotangent, Adjoint::Tape, to, tape);
            }
        },
    );
    // In order, whatever the number of threads.
    let mut total = (0.0, vec![[0.0; 4]; texels]);
    for (square, table) in parts {
        total.0 += square;
        total.1.iter_mut().flatten().zip(table.by_value().iter().flatten()).for_each(|(sum, by)| *sum += by);
    }
    total
}
