//! What pictures state of how they are made, and pictures that were stopped before they were done.

use super::accuracy::{Made, PictureError, REPLICATES, SAMPLES, SCENE, STOPPED, Streams};
use super::{RenderSettings, straight};
use crate::app::pictured::{self, PictureCamera};
use crate::app::pictures::PictureSettings;
use crate::app::pictures::renderer::SceneRenderer;
use crate::app::provenance::{self, Provenance};
use crate::error::Result;
use crate::formats::exr::{self, Attributes};
use crate::formats::protected;
use crate::formats::registry::EXR;
use crate::render::film::Replicates;
use crate::render::renderer::Renderer;
use crate::scene::camera::Camera;
use crate::scene::film::Film;
use crate::scene::scene::Scene;
use glam::DVec3;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Settings on which the expected values of a picture do not depend, or whose content is known otherwise: that of its
/// inputs by their bytes, that of its view by its camera and its number.
const APART: [&str; 31] = [
    "output",
    "overwrite",
    "png",
    "half",
    "compression",
    "exposure",
    "frames",
    "resume",
    "aov",
    "velocity",
    "fps",
    "target_error",
    "time",
    "replicates",
    "confidence",
    "input",
    "cameras",
    "holdout",
    "views",
    "from",
    "azimuth",
    "elevation",
    "distance",
    "eye",
    "target",
    "orthographic",
    "view",
    "frame",
    "samples",
    "seed",
    "max_memory",
];

/// A picture that is to be rendered.
#[derive(Clone, Copy)]
pub(super) struct Pictured<'p> {
    pub provenance: &'p Provenance,
    /// Settings, with what the frames of a sequence have settled.
    pub pictures: &'p PictureSettings,
    /// Number of the view or frame.
    pub number: usize,
    pub camera: &'p Camera,
    /// Subject of the picture.
    pub scene: &'p Scene,
    /// Position that the camera looks at, where there is anything.
    pub focus: Option<DVec3>,
}

impl Pictured<'_> {
    /// Returns the hash of what the picture shows: pictures of the same one have the same expected values.
    fn hash(&self, settings: &RenderSettings) -> String {
        let settings = RenderSettings { pictures: self.pictures.clone(), ..settings.clone() };
        let mut value = serde_json::to_value(&settings).unwrap_or_default();
        if let Value::Object(settings) = &mut value {
            settings.retain(|name, _| !APART.contains(&name.as_str()));
        }
        let mut inputs: Vec<&String> = self.provenance.inputs.values().collect();
        inputs.sort_unstable();
        let camera = format!("{:?}", self.camera);
        let whole = json!({ "settings": value, "inputs": inputs, "number": self.number, "camera": camera });
        provenance::hash_of_settings("picture", &whole, &[])
    }

    /// Adds the camera of the picture to its attributes.
    pub(super) fn camera_attributes(&self, whole: Option<[usize; 2]>, attributes: &mut Attributes) {
        self.pictured_camera(whole).describe(attributes);
    }

    /// Returns the camera of the picture; that of the whole picture, of which it may be a part in a file of its own.
    fn pictured_camera(&self, whole: Option<[usize; 2]>) -> PictureCamera {
        let camera = PictureCamera::new(self.camera, self.focus);
        match (whole, self.pictures.crop) {
            (Some(size), Some(part)) => camera.within(size, part.origin),
            _ => camera,
        }
    }

    /// Writes the picture and what goes with it as the names say, with its camera.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub(super) fn write(
        &self,
        settings: &RenderSettings,
        files: &[PathBuf],
        (film, mut attributes): (&Film, Attributes),
        whole: Option<[usize; 2]>,
    ) -> Result<()> {
        for file in files {
            // A PNG has no place for the whole picture.
            self.camera_attributes(whole.filter(|_| EXR.has_name(file)), &mut attributes);
            settings.write_picture(file, film, &attributes, whole)?;
        }
        Ok(())
    }

    /// Returns the attributes of the picture: where it comes from, and what it can be joined with and goes on from.
    pub(super) fn attributes(
        &self,
        settings: &RenderSettings,
        renderer: &SceneRenderer<'_>,
        (film, error): (&Film, Option<&PictureError>),
    ) -> Attributes {
        let mut all = self.provenance.attributes();
        pictured::describe_background(self.pictures.background, self.scene, &mut all);
        if !matches!(renderer.renderer, Renderer::Paths(_)) {
            straight::describe(renderer, film, settings.accuracy.target_error.is_some(), &mut all);
            return all;
        }
        all.insert(SCENE.into(), self.hash(settings));
        match error {
            Some(error) => error.describe(&settings.accuracy, &mut all),
            None => {
                let scattering = &settings.pictures.scattering;
                all.insert(REPLICATES.into(), Streams::one(scattering.seed.unwrap_or(0)).to_string());
                all.insert(SAMPLES.into(), scattering.samples().to_string());
            }
        }
        all
    }

    /// Returns the replicates of the picture that an earlier run of the same settings, which was stopped, has left at a
    /// path; `None` if there are none to go on from.
    pub(super) fn begun(&self, settings: &RenderSettings, path: &Path) -> Option<Made> {
        if !(settings.resume && settings.sums_tell_all() && is_stopped(path)) {
            return None;
        }
        let read = protected::unprotected(path, || Made::read(path, self.pictures.limits)).ok()?;
        if read.attributes.get(SCENE) != Some(&self.hash(settings)) {
            return None;
        }
        let Made { replicates: made, streams } = read.made;
        let replicates = Replicates::of_sums(made.size(), &settings.aov, made.sums().to_vec(), made.count()).ok()?;
        Some(Made { replicates, streams })
    }
}

/// True if a picture was stopped before it was done.
pub(super) fn is_stopped(path: &Path) -> bool {
    let stopped = || Ok(exr::header(path)?.attributes().contains_key(STOPPED));
    EXR.has_name(path) && protected::unprotected(path, || -> Result<bool> { stopped() }).unwrap_or(false)
}
