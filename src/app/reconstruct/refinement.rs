//! Cameras that are found together with the volume.

use super::region::{Placed, RegionSettings};
use super::volume::{Pictures, VolumeTask};
use crate::app::checks::Warning;
use crate::app::outputs::{self, Content, RECORD};
use crate::app::run::{CameraMotion, RefinedCameras};
use crate::error::{Error, Result};
use crate::formats::transforms;
use crate::inverse::cost::{Cost, Method, PictureSizes};
use crate::inverse::density::Request;
use crate::inverse::observation::Observation;
use crate::inverse::refinement;
use crate::scene::camera::Camera;
use crate::scene::capture::Capture;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Settings of cameras that are only nearly known.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct RefinementSettings {
    /// Parameters that move to where all pictures agree on one volume; none for cameras that stay. The scene as a whole
    /// stays where the given cameras have it.
    pub refine_cameras: Option<Refined>,
    /// Capture (JSON) to write with the refined cameras, and the same pictures; none for the output's name with the
    /// ending cameras.json.
    #[serde(with = "crate::app::paths")]
    pub cameras: Option<PathBuf>,
}

/// Parameters of cameras that are refined.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Refined {
    /// Position and rotation of each camera.
    Pose,
    /// These, and a factor of the focal length that all cameras share.
    Focal,
}

/// Displacement in pixels from which on a camera counts as far off, if it is many times that of most.
const FAR: f64 = 1.0;
const MANY: f64 = 4.0;

impl RefinementSettings {
    /// Returns the path of the refined cameras, if they are to be refined, and checks that they can be written there;
    /// `volume` is the path of the volume.
    ///
    /// # Errors
    /// If the name or the folder does not suit a capture, the file is the report's record, or the pictures' paths
    /// cannot be stated in it.
    pub(super) fn output(&self, volume: &Path, report: Option<&Path>, capture: &Capture) -> Result<Option<PathBuf>> {
        if self.refine_cameras.is_none() {
            return Ok(None);
        }
        let path = self.cameras.clone().unwrap_or_else(|| volume.with_extension("cameras.json"));
        outputs::file(&path, Content::Capture)?;
        if report.is_some_and(|folder| path == folder.join(RECORD)) {
            return Err(Error::invalid("⟨report⟩ writes this file, too").at(&path).hint("give ⟨cameras⟩ another name"));
        }
        transforms::check_names(&path, capture)?;
        Ok(Some(path))
    }

    /// Moves the cameras of the pictures and of the task's capture, which will be written to `path`. `request` makes
    /// the request of a region.
    ///
    /// # Errors
    /// Those of [`refinement::refine`], and those of the region.
    pub(super) fn refine(
        &self,
        work: &mut VolumeTask<'_>,
        path: PathBuf,
        region: &RegionSettings,
        Pictures { photos, excerpts, observation }: &mut Pictures,
        request: impl FnOnce(&VolumeTask<'_>, &Observation, &Placed) -> Result<Request>,
    ) -> Result<()> {
        let (json, context) = (work.input.json.clone(), work.task.context.clone());
        let silhouettes = observation.widen_silhouettes();
        let unknowns = region.choose(&work.input.capture, observation, &context).map_err(|e| e.at(&json))?;
        let request = request(work, observation, &unknowns.placed)?;
        let (focal, pixels) = (self.refine_cameras == Some(Refined::Focal), work.input.capture.pixels());
        let sizes = PictureSizes::of(&work.input.capture);
        let mut cost = Cost::new(Method::Cg, &unknowns.placed.survey, sizes, 0.0);
        cost.memory_mb += COPIES * pixels as f64 / f64::from(1 << 20);
        cost.fits(request.max_memory).map_err(|e| e.at(&json))?;

        let bar = context.steps(refinement::most_rounds(&request), "cameras");
        let refined = refinement::refine(observation, &request, focal, |round| {
            bar.inc(1);
            bar.message(format!("level {}, moved by {:.3} pixels", round.level, round.pixels));
            work.task.flow()
        });
        drop(bar);
        let cameras = refined.map_err(|e| e.at(&json))?;

        let given: Vec<Camera> = excerpts.iter().map(|excerpt| excerpt.camera).collect();
        let names = work.input.capture.frames.iter().map(|frame| frame.picture.as_path());
        let points = request.bounds.inner_corners();
        let centre = request.bounds.centre();
        let motion = |((name, from), to): ((&Path, &Camera), &Camera)| CameraMotion {
            picture: name.file_name().unwrap_or(name.as_os_str()).to_string_lossy().into(),
            rotated_degrees: from.rotation_to(to).length().to_degrees(),
            moved_percent: 100.0 * from.position().distance(to.position())
                / from.position().distance(centre).max(f64::MIN_POSITIVE),
            displaced_pixels: from.displacement(to, &points).unwrap_or(0.0),
        };
        let motions: Vec<CameraMotion> = names.zip(&given).zip(&cameras).map(motion).collect();
        let warnings = far(&motions);
        context.warn(&warnings);
        let factor = given.first().zip(cameras.first()).map(|(a, b)| b.focal.x / a.focal.x);
        work.refined(RefinedCameras { capture: path, focal_factor: factor.filter(|_| focal), motions }, warnings);
        for (i, camera) in cameras.into_iter().enumerate() {
            (excerpts[i].camera, observation.maps[i].camera, work.input.capture.frames[i].camera) =
                (camera, camera, camera);
            photos.iter_mut().skip(i).take(1).for_each(|photo| photo.camera = camera);
        }
        observation.maps.iter_mut().zip(silhouettes).for_each(|(map, shown)| map.shown = shown);
        Ok(())
    }
}

/// Bytes a pixel of the pictures with moved cameras, and of the silhouettes as they were.
const COPIES: f64 = 8.0;

/// Warns of cameras that moved much farther than the others.
fn far(motions: &[CameraMotion]) -> Vec<Warning> {
    let mut all: Vec<f64> = motions.iter().map(|motion| motion.displaced_pixels).collect();
    all.sort_by(f64::total_cmp);
    let Some(median) = all.get(all.len() / 2) else { return Vec::new() };
    let far = motions.iter().filter(|motion| motion.displaced_pixels > FAR.max(MANY * median));
    let warning = |motion: &CameraMotion| {
        Warning::new(
            format!(
                "{}: its camera moved by {:.1} pixels, where half of them moved by {median:.1} or less",
                motion.picture, motion.displaced_pixels
            ),
            "look at this picture and its camera: one that is wrong by much more than others misleads these, too; \
             leave it out of the capture, and refine the others without it",
        )
    };
    far.map(warning).collect()
}
