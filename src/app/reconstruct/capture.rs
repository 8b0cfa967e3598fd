//! The capture that a reconstruction starts from.

use crate::app::provenance::Provenance;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::{captures, transforms};
use crate::scene::capture::{Capture, Model};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// A capture and the path of the file that its cameras were read from.
#[derive(Debug)]
pub(super) struct LoadedCapture {
    /// Path of the transforms.json, or of the images of COLMAP's model.
    pub json: PathBuf,
    /// Cameras, paths of the pictures, and the model that they show.
    pub capture: Capture,
    /// The capture as its file states it, whatever a reconstruction makes of `capture`.
    stated: Capture,
}

impl LoadedCapture {
    /// Loads the capture at `path` (its JSON file or folder).
    ///
    /// # Errors
    /// If the capture cannot be read.
    pub(crate) fn load(path: &Path, limits: Limits) -> Result<Self> {
        let json = captures::file(path);
        let capture = captures::load_within(&json, limits)?;
        Ok(Self { json, stated: capture.clone(), capture })
    }

    /// Writes the capture as its file states it to `path`, but with the cameras that `capture` has by now.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(crate) fn save_cameras(&self, path: &Path, provenance: &Provenance) -> Result<()> {
        let mut capture = self.stated.clone();
        capture.frames.iter_mut().zip(&self.capture.frames).for_each(|(frame, own)| frame.camera = own.camera);
        let extra = Map::from_iter([("provenance".into(), json!(provenance))]);
        transforms::save(path, &capture, &extra)
    }

    /// Refuses scattered light where a transfer function is to explain the pictures.
    ///
    /// # Errors
    /// If the pictures show scattered light.
    pub(crate) fn suits_function(&self) -> Result<()> {
        if self.capture.model != Model::Scattering {
            return Ok(());
        }
        Err(Error::unsupported(
            "the pictures show scattered light, and a transfer function tells emission and absorption alone",
        )
        .at(&self.json)
        .hint(
            "render the volume without scattering; of these pictures, `cumulo reconstruct density` without ⟨tf⟩ finds \
             the densities by alpha, and `cumulo reconstruct color` the light as emission",
        ))
    }

    /// Refuses scattered light whose alpha tells no density: that of a medium whose extinction differs by channel.
    ///
    /// # Errors
    /// If the file of the capture states such a medium.
    pub(crate) fn suits_alpha(&self, limits: Limits) -> Result<()> {
        if self.capture.model != Model::Scattering || !is_chromatic(&self.json, limits) {
            return Ok(());
        }
        Err(Error::unsupported(
            "the extinction of the medium in the pictures differs by channel: alpha is the mean of three \
             transmittances then, and tells no density",
        )
        .at(&self.json)
        .hint(
            "render the pictures with one extinction for all channels: without ⟨extinction_color⟩, or with an \
             'extinction_color' of three equal numbers in the scene file",
        ))
    }
}

/// True if the record that `cumulo render` leaves in a capture's JSON states an extinction that differs by channel.
fn is_chromatic(json: &Path, limits: Limits) -> bool {
    let Ok(root) = transforms::read_object(json, limits).map(Value::Object) else { return false };
    let measured = root.pointer("/plan/measured/chromatic").and_then(Value::as_bool);
    let factors = root.pointer("/scattering/extinction_color").and_then(Value::as_array);
    let differ = factors.is_some_and(|all| all.windows(2).any(|pair| pair[0] != pair[1]));
    measured.unwrap_or(false) || differ
}
