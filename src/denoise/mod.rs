//! Denoising of sequences in time: weighted recursive least squares (wRLS; Iglesias-Guitian, Mane & Moon 2020).
//!
//! Every pixel has a linear model of its color by a [feature](feature), a history of colors that needs no G-buffers. From
//! frame to frame the models follow the motion of what they show, forget a little, and learn the new color with a weight
//! that is small for outliers. A pixel's denoised color is what the models around it predict from its feature.
//!
//! [`Denoiser`] takes a frame at a time and keeps the state of one.

pub mod feature;
pub mod model;
mod wrls;

pub use wrls::{Denoised, Denoiser, Feature, Frame, Settings};
