//! The capture that a reconstruction starts from.

use crate::error::Result;
use crate::formats::captures;
use crate::formats::limits::Limits;
use crate::scene::capture::Capture;
use std::path::{Path, PathBuf};

/// A capture and the path of the file that its cameras were read from.
#[derive(Debug)]
pub(super) struct LoadedCapture {
    /// Path of the transforms.json, or of the images of COLMAP's model.
    pub json: PathBuf,
    /// Cameras, paths of the pictures, and the model that they show.
    pub capture: Capture,
}

impl LoadedCapture {
    /// Loads the capture at `path` (its JSON file or folder).
    ///
    /// # Errors
    /// If the capture cannot be read.
    pub fn load(path: &Path, limits: Limits) -> Result<Self> {
        let json = captures::file(path);
        let capture = captures::load_within(&json, limits)?;
        Ok(Self { json, capture })
    }
}
