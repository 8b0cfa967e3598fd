//! The capture that a reconstruction starts from.

use crate::cli::outputs;
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
    /// Loads the capture at `path` (its JSON file or folder) and makes sure that the `output` replaces neither the
    /// capture, nor its pictures, nor any of the command's `other_inputs`.
    ///
    /// # Errors
    /// If the capture cannot be read, or the output is one of the inputs.
    pub fn load<'p>(
        path: &Path,
        output: &Path,
        other_inputs: impl IntoIterator<Item = &'p PathBuf>,
        limits: Limits,
    ) -> Result<Self> {
        let json = captures::file(path);
        let capture = captures::load_within(&json, limits)?;
        let mut inputs = outputs::of_capture(path, &capture);
        inputs.extend(other_inputs.into_iter().cloned());
        outputs::spare([output], inputs.iter().map(PathBuf::as_path))?;
        Ok(Self { json, capture })
    }
}
