//! `cumulo study denoise`: error against time of denoising.

use crate::app::denoise::Motion;
use crate::app::study::StudyOptions;
use crate::app::study::denoise::{DenoiseKnob, DenoiseStudySettings};
use crate::cli::args::read_as;
use crate::cli::memory::Memory;
use crate::formats::sequence::Frames;
use std::path::PathBuf;

/// Measure the error of denoised frames against the time that they take, and recommend the options of denoise
///
/// Frames are compared with those of a sequence without noise, or with little: its uncertainty is told by its layer
/// variance (`cumulo render --aov variance`). Several noisy sequences, of more and fewer samples, may be compared.
#[derive(Debug, clap::Args)]
struct DenoiseStudyArgs {
    /// Noisy frames, 'in.####.exr' or in.%04d.exr, or one picture; several are sequences of other samples
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    /// Frames without noise, numbered as the noisy ones
    #[arg(long, value_name = "TRUE.####.exr")]
    reference: PathBuf,
    #[command(flatten)]
    study: StudyOptions,
    /// Settings to vary (default: all)
    #[arg(long, value_enum, value_name = "NAME,...", value_delimiter = ',')]
    knobs: Vec<DenoiseKnob>,
    /// Frames to denoise: A, A-B or A-BxSTEP (default: as many around the middle as --budget allows)
    #[arg(long, value_name = "A-B")]
    frames: Option<Frames>,
    /// Where motion comes from, as in denoise
    #[arg(long, value_name = "FROM", default_value = "auto")]
    motion: Motion,
    #[command(flatten)]
    memory: Memory,
}

impl From<DenoiseStudyArgs> for DenoiseStudySettings {
    fn from(args: DenoiseStudyArgs) -> Self {
        let DenoiseStudyArgs { inputs, reference, study, knobs, frames, motion, memory } = args;
        Self { study, inputs, reference, knobs, frames, motion, limits: memory.limits() }
    }
}

read_as!(DenoiseStudySettings, DenoiseStudyArgs);
