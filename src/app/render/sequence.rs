//! A sequence at work, and the frame of it that is rendered.

use super::RenderSettings;
use super::accuracy::Deadline;
use super::deep::Tally;
use super::holdout::LastMesh;
use super::target::Target;
use super::visibility::Visibility;
use crate::app::pictures::PictureSettings;
use crate::app::pictures::colors::Colors;
use crate::app::pictures::scales::DensityScales;
use crate::app::provenance::Provenance;
use crate::app::up::ChosenUp;
use crate::cancel::Cancel;
use crate::error::Error;
use crate::formats::sequence::Pattern;
use crate::plan::Plan;
use crate::scene::camera::Camera;
use crate::scene::capture::Capture;
use crate::scene::scene::Scene;
use glam::DVec3;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::Arc;

/// Frame that is there: its place in the sequence, its number and its picture.
pub(super) type Done = (usize, u32, PathBuf);

/// Scene of a frame, planned.
pub(super) struct Shot {
    pub capture: Capture,
    pub scales: DensityScales,
    pub scene: Scene,
    /// Position that cameras look at, where there is anything.
    pub focus: Option<DVec3>,
    /// Meaning of the colors of the transfer function.
    pub colors: Option<Colors>,
    pub plan: Option<Plan>,
    pub provenance: Provenance,
    /// True if paths were asked for.
    pub paths: bool,
    /// Times at which the shutter opens and closes, in frames after that of the picture, if they are known.
    pub open: Option<[f64; 2]>,
    /// True if another frame shows other volumes.
    pub moving: bool,
}

/// Sequence at work.
pub(super) struct Sequence<'s> {
    pub render: &'s RenderSettings,
    pub target: Target<'s>,
    /// Numbers of the frames.
    pub numbers: Vec<u32>,
    /// Options, with what the first frame has settled.
    pub pictures: PictureSettings,
    pub pattern: Option<Pattern>,
    pub template: Option<Capture>,
    /// Cameras of the frames, or of all, each between those of the frames before and after.
    pub cameras: Vec<[Camera; 3]>,
    /// Up axis about which the camera was placed.
    pub up: Option<ChosenUp>,
    /// Provenance with the inputs of the cameras alone: the others differ from frame to frame.
    pub provenance: Provenance,
    /// Hashes of the inputs of the frames so far, by path.
    pub inputs: BTreeMap<String, String>,
    pub shot: Option<Arc<Shot>>,
    /// Whether anything is to be seen in the pictures so far.
    pub visibility: Visibility,
    /// Mesh that hides what is behind it.
    pub mesh: LastMesh,
    /// Samples of deep pictures.
    pub tally: Tally,
    /// Remarks that were made.
    pub remarks: BTreeSet<String>,
    pub cancel: Cancel,
    /// Error of a run that met, while it was at work, what one of other settings has written.
    pub refused: Option<Error>,
    /// When the frames are to be done.
    pub deadline: Deadline,
}
