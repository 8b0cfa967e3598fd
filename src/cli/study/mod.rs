//! `cumulo study`: error against time on the user's own inputs.

mod denoise;
mod gradient;
mod options;
mod reconstruct;
mod render;

use crate::app::study::denoise::DenoiseStudySettings;
use crate::app::study::gradient::GradientStudySettings;
use crate::app::study::reconstruct::ReconstructStudySettings;
use crate::app::study::render::RenderStudySettings;

/// Measure the error of settings against their time, on your own inputs, and recommend one
///
/// The reference is converged by Cumulo itself and has an uncertainty of its own. The folder of the page gets a table
/// (study.csv), a record (study.json) and the reference, too.
#[derive(Debug, clap::Subcommand)]
pub(crate) enum Study {
    Denoise(Box<DenoiseStudySettings>),
    Gradient(Box<GradientStudySettings>),
    Reconstruct(Box<ReconstructStudySettings>),
    Render(Box<RenderStudySettings>),
}
