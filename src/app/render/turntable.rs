//! Cameras of the frames of a sequence: that of its number in a capture, or one that turns about the volume.

use super::RenderSettings;
use super::sequence::Sequence;
use crate::app::pictures::PictureSettings;
use crate::app::ranges;
use crate::error::{Code, Error, Result};
use crate::scene::blur;
use crate::scene::camera::Camera;
use crate::scene::orbit::Layout;

impl RenderSettings {
    /// Refuses cameras of frames where there are none, and those that are stated twice.
    pub(super) fn check_cameras_of_frames(&self) -> Result<()> {
        ranges::within("orbit", self.orbit, [1, 100_000])?;
        let pictures = &self.pictures;
        if self.orbit.is_some() {
            if pictures.placed().is_some() || pictures.cameras.is_some() || !pictures.view.is_empty() {
                return Err(Error::invalid("⟨orbit⟩ beside cameras that are stated")
                    .coded(Code::Usage)
                    .hint("leave ⟨orbit⟩ out, or ⟨views⟩, ⟨view⟩, ⟨cameras⟩ and what places a camera"));
            }
            if !self.is_sequence() {
                return Err(Error::invalid("⟨orbit⟩: there are no frames in which the camera turns")
                    .hint("give ⟨frames⟩, such as 0-47 with ⟨orbit=48⟩, or ⟨views⟩ with ⟨layout=ring⟩"));
            }
        }
        if self.camera_offset != 0 && !(self.is_sequence() && pictures.cameras.is_some()) {
            return Err(Error::invalid("⟨camera_offset⟩: no frame takes its camera from a capture")
                .hint("give ⟨frames⟩ and ⟨cameras⟩"));
        }
        Ok(())
    }

    /// Returns the settings of the pictures with the cameras of a turn, where the camera turns.
    pub(super) fn turning(&self) -> PictureSettings {
        let pictures = self.pictures.clone();
        match self.orbit {
            Some(frames) => PictureSettings { views: Some(frames), layout: Layout::Ring, ..pictures },
            None => pictures,
        }
    }
}

impl Sequence<'_> {
    /// Returns the cameras of frames between those of the frames before and after, of cameras that are placed: the one
    /// at rest, or those of a turn. None if none is placed.
    ///
    /// # Errors
    /// If they have an aperture, and it is not stated what is sharp.
    pub(super) fn at_frames(&self, placed: &[Camera], numbers: &[u32]) -> Result<Vec<[Camera; 3]>> {
        let (Some(first), Some(turn)) = (placed.first(), self.render.orbit) else {
            let only = placed.first().map_or_else(Vec::new, |only| vec![[*only; 3]; numbers.len()]);
            return self.render.blur.of_frames(only, (blur::between, self.render.may_move()));
        };
        let at = |number: i64| placed.get(number.rem_euclid(i64::from(turn)) as usize).unwrap_or(first);
        let between = |number: &u32| [-1, 0, 1].map(|beside| *at(i64::from(*number) + beside));
        let cameras = numbers.iter().map(between).collect();
        self.render.blur.of_frames(cameras, (blur::between_on_arc, self.render.may_move()))
    }
}
