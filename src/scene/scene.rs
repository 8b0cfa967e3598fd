//! Scenes: all that pictures show, and from where.

use crate::error::Result;
use crate::scene::camera::Camera;
use crate::scene::capture::Capture;
use crate::scene::environment::Environment;
use crate::scene::light::Light;
use crate::scene::meshes::Meshes;
use crate::scene::motion::Motion;
use crate::scene::velocity::Velocity;
use crate::scene::volume::{Grids, Volume};
use std::sync::Arc;

/// Volumes and surfaces, the light around them, and cameras.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    /// Volumes, each with its medium.
    pub volumes: Vec<Volume>,
    /// Light behind and around the volumes.
    pub environment: Environment,
    /// Further lights.
    pub lights: Vec<Light>,
    /// Surfaces beside the volumes, if there are any.
    pub meshes: Option<Arc<Meshes>>,
    /// Velocities of volumes, by the volume's number.
    pub velocities: Vec<(usize, Velocity)>,
    /// Motions of volumes and meshes while the shutter is open.
    pub motions: Vec<Motion>,
    /// Cameras, one for each picture.
    pub cameras: Vec<Camera>,
    /// The scene at times that are evenly spread over that in which the shutter is open; none if it stands still. Its
    /// own volumes are those of the frame.
    pub moments: Vec<Scene>,
}

impl Scene {
    /// True if a volume is one of labels.
    pub fn has_labels(&self) -> bool {
        self.volumes.iter().filter_map(Volume::density).any(|(_, medium)| medium.labels().is_some())
    }

    /// Returns the scene that the pictures of a capture show, of a volume with these grids.
    ///
    /// # Errors
    /// If the capture's medium or density scale cannot be used.
    pub fn shown_by(capture: &Capture, grids: Grids) -> Result<Self> {
        Ok(Self {
            volumes: vec![grids.shown_by(capture)?],
            environment: Environment::constant(capture.background),
            lights: Vec::new(),
            meshes: None,
            velocities: Vec::new(),
            motions: Vec::new(),
            cameras: capture.frames.iter().map(|frame| frame.camera).collect(),
            moments: Vec::new(),
        })
    }
}
