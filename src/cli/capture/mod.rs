//! `cumulo capture`: captures of other programs, and cameras without pictures.

mod convert;
mod new;

use crate::app::capture::{CaptureSettings, NewCaptureSettings};
use clap::Subcommand;

/// Take over captures of other programs, or place cameras
#[derive(Debug, Subcommand)]
pub(crate) enum CaptureCommand {
    /// Write a capture that every command takes: cameras without lens distortion and scene-linear EXRs
    Convert(Box<CaptureSettings>),
    /// Write the cameras that a render would have, without pictures
    New(Box<NewCaptureSettings>),
}
