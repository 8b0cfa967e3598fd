//! Density from pictures: by conjugate gradients on optical depths from coarse to fine ([`multilevel`]), or by descent
//! on colors (`descent`, `weiss2021`); and how certain each voxel is ([`confidence`]).

pub mod confidence;
pub mod descent;
mod held_out;
mod level;
pub mod multilevel;
pub mod timing;
pub mod weiss2021;

use crate::cancel::Cancel;
use crate::differentiate::loss::prior::{VolumePrior, Weighted};
use crate::inverse::checkpoint::Checkpoint;
use crate::inverse::progress::{Stage, Step};
use crate::math::{Aabb, Affine};
use crate::scene::bricks::Bricks;
use crate::scene::medium::Medium;
use std::sync::Arc;

/// Inputs and limits of a density reconstruction.
#[derive(Debug, Clone)]
pub struct Request {
    /// Voxel lattice of the result, index to world.
    pub lattice: Affine,
    /// World box of the unknowns.
    pub bounds: Aabb,
    /// Medium: extinction and source by density.
    pub medium: Medium,
    /// Radiance behind the volume.
    pub background: [f32; 3],
    /// Rays along each edge of a pixel, whose value is the mean over the square of that number.
    pub rays_per_edge: usize,
    /// Indices of the held-out views, which are not fitted but decide when to stop.
    pub held_out: Vec<usize>,
    /// Iterations on the finest level, at most.
    pub iterations: u32,
    /// Blur passes of the smoothness prior; chosen by the held-out views if `None`.
    pub smoothing: Option<u32>,
    /// Prior on neighbouring voxels for descents, instead of their default; conjugate gradients have their own prior.
    pub prior: Option<Weighted<VolumePrior>>,
    /// True to bound the influence of outliers (Huber's loss).
    pub robust: bool,
    /// A volume to start from.
    pub init: Option<Arc<Bricks<f32>>>,
    /// Bytes of memory that may be used.
    pub max_memory: u64,
    /// Polled inside every pass; once set, the reconstruction so far is the result.
    pub cancel: Cancel,
    /// Receives the densities so far; `None` hands out the result alone.
    pub checkpoint: Option<Checkpoint>,
    /// Polled by the passes that only measure the result; a measurement that it stops is missing.
    pub closing: Cancel,
}

/// Result of a density reconstruction.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The densities.
    pub field: Bricks<f32>,
    /// Every iteration.
    pub history: Vec<Step>,
    /// Time by stage.
    pub stages: Vec<Stage>,
    /// PSNR of the training views (peak 1): of their transmittance, or for descents of their colors; NaN if the work
    /// was stopped before it was measured.
    pub train_psnr_db: f64,
    /// PSNR of the held-out views, measured as for the training views; `None` without such views.
    pub held_out_psnr_db: Option<f64>,
    /// Number of unknown voxels on the finest level.
    pub unknowns: usize,
    /// True if the user stopped the work.
    pub stopped: bool,
}
