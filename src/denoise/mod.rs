//! Denoising of sequences in time.
//!
//! A pixel's color is regressed on a feature that follows the motion: a history of colors, which needs no G-buffers. From
//! frame to frame the models move along, forget a little, and learn the new colors.
//!
//! - [`wrls`] is weighted recursive least squares as published (Iglesias-Guitian, Mane & Moon 2020): a model for each pixel,
//!   weights against outliers, and a blend of what the models around predict. [`model`] holds its numerics.
//! - [`guided`] carries it further, for files: models on a grid of blocks, a feature whose noise is independent of the
//!   color's, forgetting that adapts, and [`fused`] results of both directions of time.
//! - [`ema`] and [`svgf`] are there to compare with.

mod blocks;
mod denoiser;
mod detail;
pub mod ema;
pub mod feature;
pub mod frame;
pub mod guided;
mod history;
mod lanes;
mod learning;
pub mod model;
mod outline;
mod settings;
pub mod svgf;
mod two_way;
mod vectors;
pub mod wrls;

pub use denoiser::{Denoiser, Method};
pub use frame::{Denoised, Frame};
pub use settings::Settings;
pub use two_way::fused;
