//! Denoising of sequences in time.
//!
//! A pixel's color is regressed on a feature that follows the motion: a history of colors, which needs no G-buffers.
//! From frame to frame the models move along, forget a little, and learn the new colors.
//!
//! - `wrls` is weighted recursive least squares as published (Iglesias-Guitian, Mane & Moon 2020): a model for each
//!   pixel, weights against outliers, and a blend of what the models around predict. `model` holds its numerics.
//! - `guided` carries it further, for files: models on a grid of blocks, and a feature whose noise is independent of
//!   the color's, from the frames before and, by a [`Lookahead`], from those that follow.
//! - `coherence` gives lines and edges back that were taken for noise, and `still` to a single picture whatever
//!   second differences show to be none.
//! - `cuts` finds where shots begin.
//! - `halves` tells the error of frames that are denoised in two independent halves, and `kept` gives back what such a
//!   frame has lost by that.
//! - `ema` and `svgf` are there to compare with.

mod ahead;
mod blocks;
mod carried;
mod coherence;
mod contradiction;
mod cuts;
mod denoiser;
mod detail;
mod difference;
pub(crate) mod ema;
mod estimate;
pub(crate) mod feature;
pub(crate) mod frame;
pub(crate) mod guided;
mod halves;
mod history;
mod illumination;
mod kept;
mod lanes;
mod layout;
mod learning;
mod lookahead;
mod minimum;
pub(crate) mod model;
mod noise;
mod outline;
mod packed;
mod reprojection;
mod residual;
mod ring;
mod settings;
mod signal;
mod smoothing;
mod spectrum;
mod still;
pub(crate) mod svgf;
mod vectors;
pub(crate) mod wrls;

pub use ahead::Ahead;
pub use contradiction::contradiction;
pub use cuts::CutDetector;
pub use denoiser::{Denoiser, Method};
pub use estimate::Estimate;
pub use frame::{Denoised, Frame};
pub use halves::{Halves, HalvesEstimate};
pub use kept::take_back;
pub use lookahead::Lookahead;
pub use settings::Settings;

/// Rows of pixels that a task takes, of a picture of so many rows. Neighbouring bands reproject some rows twice: they
/// are as large as leaves each thread a few. Results do not depend on it.
fn band_rows(height: usize) -> usize {
    const BANDS_A_THREAD: usize = 3;
    const LEAST: usize = 8 * blocks::BLOCK;
    height.div_ceil(BANDS_A_THREAD * rayon::current_num_threads()).max(LEAST).next_multiple_of(blocks::BLOCK)
}
