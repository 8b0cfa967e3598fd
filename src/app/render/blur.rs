//! Blur of pictures by the aperture of the camera, and by its motion while the shutter is open.

use crate::app::ranges;
use crate::error::{Error, Result};
use crate::scene::blur::{Aperture, Blur, Shutter};
use crate::scene::camera::Camera;
use glam::{DMat4, DVec3};
use serde::{Deserialize, Serialize};

/// Settings of the blur of pictures; where they are open, it is that of the cameras.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct BlurSettings {
    /// Radius of the camera's aperture in world units; 0 for sharp pictures.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub aperture: Option<f64>,
    /// Distance along the viewing axis to what is sharp, in world units; none for that of the camera, else the middle
    /// of the volumes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub focus: Option<f64>,
    /// Time in frames during which the shutter is open, half of it before the frame and half after, from 0 to 2; 0 for
    /// cameras at rest.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shutter: Option<f64>,
}

/// Way of a camera from one frame to the next: its motion at a share of it.
pub(super) type Between = fn(DMat4, DMat4, f64) -> DMat4;

/// Largest turn in degrees of a camera while its shutter is open: rays are those of two chords, which lie within one
/// per cent of the circle's radius of it.
const LARGEST_TURN: f64 = 30.0;

/// Rays along an edge of a pixel below which the blur of straight rays is grainy.
const FEW_RAYS: u32 = 4;

/// Returns what is to be said of blurred pictures of this many straight rays along an edge of a pixel.
pub(super) fn grain(camera: &Camera, paths: bool, supersample: u32) -> Option<String> {
    let grainy = !camera.blur.is_none() && !paths && supersample < FEW_RAYS;
    grainy.then(|| {
        format!(
            "a pixel has {} to show its blur, which is grainy: give ⟨supersample=8⟩, or ⟨aperture=0⟩ and ⟨shutter=0⟩ \
             for sharp pictures",
            if supersample == 1 { "one ray".to_owned() } else { format!("{} rays", supersample * supersample) }
        )
    })
}

impl BlurSettings {
    /// Refuses values out of their ranges.
    pub(super) fn check(&self, sequence: bool, orbit: Option<u32>) -> Result<()> {
        let radius = self.aperture.unwrap_or_default();
        ranges::require("aperture", radius, (0.0..=1e15).contains(&radius), "a radius from 0 in world units")?;
        ranges::positive("focus", self.focus)?;
        let shutter = self.shutter.unwrap_or_default();
        ranges::require("shutter", shutter, (0.0..=2.0).contains(&shutter), "a time from 0 to 2 frames")?;
        if shutter > 0.0 && !sequence {
            return Err(Error::invalid("⟨shutter⟩: views are no frames between which a camera moves")
                .hint("give ⟨frames⟩ to render a sequence, by ⟨orbit⟩ or the cameras of ⟨cameras⟩"));
        }
        let turn = orbit.map_or(0.0, |frames| 360.0 * shutter / f64::from(frames));
        if turn > LARGEST_TURN {
            let frames = (360.0 * shutter / LARGEST_TURN).ceil();
            return Err(Error::invalid(format!("⟨shutter⟩: the camera turns by {turn:.0} degrees while it is open"))
                .hint(format!("give ⟨orbit={frames}⟩ or more frames to a turn, or a shorter time")));
        }
        Ok(())
    }

    /// Returns the camera of a picture with its blur. `middle` returns the middle of the volumes, which are in focus
    /// unless a distance is stated.
    ///
    /// # Errors
    /// If no distance is known.
    pub(super) fn of_view(&self, camera: Camera, middle: impl Fn() -> Option<DVec3>) -> Result<Camera> {
        let Blur { aperture, shutter } = camera.blur;
        let stated = self.focus.or(aperture.map(|own| own.focus));
        let aperture = match (self.aperture.or(aperture.map(|own| own.radius)), self.focus) {
            (Some(0.0), _) | (None, None) => None,
            (None, Some(_)) => {
                return Err(Error::invalid("⟨focus⟩: the camera has no aperture, and all is sharp")
                    .hint("give the radius of one: ⟨aperture⟩"));
            }
            (Some(radius), _) => {
                let depth = |point: DVec3| (point - camera.position()).dot(camera.forward());
                let focus = stated.or_else(|| middle().map(depth).filter(|depth| *depth > 0.0)).ok_or_else(|| {
                    Error::invalid("⟨aperture⟩: it is not stated what is sharp")
                        .hint("give the distance along the viewing axis to it: ⟨focus⟩")
                })?;
                Some(Aperture { radius, focus, ..aperture.unwrap_or(Aperture::disc(radius, focus)) })
            }
        };
        let shutter = shutter.filter(|_| self.shutter != Some(0.0));
        Ok(Camera { blur: Blur { aperture, shutter }.checked()?, ..camera })
    }

    /// Returns the cameras of frames, each between those of the frames before and after, with their blur. `moves` is
    /// true of scenes in which more than the camera may move.
    ///
    /// # Errors
    /// If no distance of focus is known, since that of frames must not follow the volumes, or cameras mirror each
    /// other.
    pub(super) fn of_frames(
        &self,
        cameras: Vec<[Camera; 3]>,
        (between, moves): (Between, bool),
    ) -> Result<Vec<[Camera; 3]>> {
        let frame = |[before, camera, after]: [Camera; 3]| {
            let Camera { blur: Blur { aperture, shutter }, .. } = self.of_view(camera, || None)?;
            let towards = |beside: Camera, half: f64| {
                let [now, then] = [camera, beside].map(|camera| camera.camera_to_world);
                if now.determinant() * then.determinant() < 0.0 {
                    return Err(Error::invalid("⟨shutter⟩: the cameras of two frames mirror each other")
                        .hint("correct their axes, or give ⟨shutter=0⟩ for pictures without motion"));
                }
                Ok(between(now, then, half))
            };
            let at_rest = [before, after].iter().all(|beside| beside.camera_to_world == camera.camera_to_world);
            let shutter = match self.shutter {
                Some(time) if time == 0.0 || (at_rest && !moves) => None,
                Some(time) => {
                    let half = 0.5 * time;
                    let [start, end] = [towards(before, half)?, towards(after, half)?];
                    Some(Shutter { start, end, open: Some([-half, half]) })
                }
                None => shutter,
            };
            let blur = Blur { aperture, shutter };
            Ok([before, Camera { blur, ..camera }, after])
        };
        cameras.into_iter().map(frame).collect()
    }
}
