//! A transfer function from pictures of a known volume (Weiss & Westermann 2021, sect. 5.2), by Gauss and
//! Newton instead of a thousand small steps.
//!
//! A few hundred unknowns stand against a hundred thousand pixels, and most of the problem is linear: the
//! logarithm of the transmittance is linear in the extinctions, and with these known the picture is linear in
//! the colors. So extinctions are taken from alpha first, colors from them, and then both are refined
//! together on the normal equations of rays drawn from all pictures. How smooth the function is, the
//! held-out views decide. The thousand steps are there to compare with ([`Solver::Weiss2021`]).

mod fit;
mod normal;
mod rays;
pub mod reconstruct;
mod rows;
mod weiss2021;

use crate::cancel::Cancel;
use crate::inverse::progress::Stage;
use crate::render::quadrature::Quadrature;
use crate::scene::transfer::Transfer;
use serde::{Deserialize, Serialize};

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
    /// Quadrature along rays.
    pub quadrature: Quadrature,
    /// Range of densities that the texels cover.
    pub domain: [f64; 2],
    /// Number of texels.
    pub texels: usize,
    /// Method by which the function is found.
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
/// Refinements with each weight.
const REFINEMENTS: u32 = 1;
