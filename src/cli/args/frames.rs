//! `--frames` of the commands that take sequences.

use super::read_as;
use crate::app::sequence::FrameSelection;
use crate::formats::sequence::Frames;

/// `--frames` of the commands that take sequences.
#[derive(Debug, clap::Args)]
struct FrameArgs {
    /// Frames of sequences to work on: A, A-B or A-BxSTEP (default: those that the name tells, else all that are there)
    #[arg(long, value_name = "A-B")]
    frames: Option<Frames>,
}

impl From<FrameArgs> for FrameSelection {
    fn from(args: FrameArgs) -> Self {
        Self(args.frames)
    }
}

read_as!(FrameSelection, FrameArgs);
