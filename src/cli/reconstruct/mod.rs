//! `cumulo reconstruct`: volumes and transfer functions from pictures.

mod color;
mod density;
mod tf;

use super::job::OrJob;
use crate::app::reconstruct::{ColorSettings, DensitySettings, TransferFunctionSettings};

/// Reconstruct from multi-view pictures
#[derive(Debug, clap::Subcommand)]
pub(crate) enum Reconstruct {
    /// Density from absorption or emission-absorption pictures.
    #[command(name = "density")]
    Density(Box<OrJob<DensitySettings>>),
    /// Pre-shaded volume: extinctions, and emissions in R, G and B.
    #[command(name = "color", alias = "colour")]
    Color(Box<OrJob<ColorSettings>>),
    /// Transfer function of a known volume.
    #[command(name = "tf")]
    Tf(Box<OrJob<TransferFunctionSettings>>),
}
