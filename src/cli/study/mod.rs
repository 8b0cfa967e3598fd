//! `cumulo study`: error against time on the user's own inputs.

mod denoise;
mod gradient;
mod options;
mod reconstruct;
mod render;
