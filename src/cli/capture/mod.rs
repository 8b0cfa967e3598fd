//! `cumulo capture`: captures of other programs.

mod convert;

use crate::app::capture::CaptureSettings;
use clap::Subcommand;

/// Take over captures of other programs
#[derive(Debug, Subcommand)]
pub(crate) enum CaptureCommand {
    /// Write a capture that every command takes: cameras without lens distortion and scene-linear EXRs
    Convert(Box<CaptureSettings>),
}
