//! Cameras of stages as captures: a view for each frame of a camera.
//!
//! A stage does not say where pictures lie. Those of `shot.usda` are taken to be `shot.0001.exr` and so on beside it,
//! by their time codes, and `shot.exr` of a camera at rest.

use super::prim::Prim;
use super::stage::Stage;
use crate::error::{Error, Result};
use crate::formats::picture;
use crate::formats::sequence::MOST_FRAMES;
use crate::scene::capture::{Capture, Frame};
use std::path::PathBuf;

/// Width of pictures in pixels where nothing states it.
const WIDTH: u32 = 256;

/// Views that are taken of a stage.
#[derive(Debug, Clone, Default)]
pub struct Views<'v> {
    /// Path or name of the camera; `None` for the only one.
    pub camera: Option<&'v str>,
    /// Width and height of the pictures in pixels; `None` for the size of the pictures that lie beside the stage, else
    /// for `Stage::picture_size`.
    pub size: Option<[u32; 2]>,
    /// Numbers of the frames, which are time codes; `None` for all of a camera that moves, and the first of one at
    /// rest.
    pub frames: Option<Vec<u32>>,
}

impl Stage {
    /// Returns the views of a camera.
    ///
    /// # Errors
    /// If the stage lacks a layer that it names, no camera, or more than one, is meant, or the camera cannot be used;
    /// the error names the stage and the camera.
    pub fn capture(&self, views: &Views<'_>) -> Result<Capture> {
        self.whole()?;
        let camera = self.camera(views.camera)?;
        let first = self.first_time();
        let numbers = match &views.frames {
            Some(numbers) => numbers.clone(),
            None if self.camera_moves(camera) => self.numbers()?,
            None => Vec::new(),
        };
        let times: Vec<(f64, PathBuf)> = match &numbers[..] {
            [] => vec![(first, self.picture(None))],
            numbers => numbers.iter().map(|number| (f64::from(*number), self.picture(Some(*number)))).collect(),
        };
        let beside = || picture::header(&times.first()?.1).ok().map(|header| header.size.map(|side| side as u32));
        let size = match views.size.or_else(beside) {
            Some(size) => size,
            None => self.picture_size(camera, first, WIDTH)?,
        };
        let frame = |(time, picture): &(f64, PathBuf)| {
            Ok(Frame { camera: self.view(camera, *time, size)?, picture: picture.clone() })
        };
        let frames = times.iter().map(frame).collect::<Result<_>>()?;
        Ok(Capture { remarks: self.camera_remarks(camera, first), ..Capture::of_frames(frames) })
    }

    /// True if a camera's place or optics change over time.
    pub(crate) fn camera_moves(&self, camera: &Prim) -> bool {
        self.is_moving(camera) || camera.attributes.values().any(|a| a.is_animated())
    }

    /// Returns the path of the picture of a frame, beside the stage.
    fn picture(&self, number: Option<u32>) -> PathBuf {
        let stem = self.path.file_stem().unwrap_or_default().to_string_lossy();
        let number = number.map_or_else(String::new, |number| format!(".{number:04}"));
        self.path.with_file_name(format!("{stem}{number}.exr"))
    }

    /// Returns the whole time codes of the stage's range.
    ///
    /// # Errors
    /// If there are too many, or one is negative.
    fn numbers(&self) -> Result<Vec<u32>> {
        let (first, last) = (self.first_time().ceil(), self.last_time().floor());
        if first > last {
            return Ok(Vec::new());
        }
        if first < 0.0 || last > f64::from(u32::MAX) || last - first >= MOST_FRAMES as f64 {
            return Err(Error::unsupported(format!("time codes from {first} to {last} cannot all be frames"))
                .at(&self.path)
                .hint(format!("frames are numbers from 0 on, {MOST_FRAMES} at most: choose some with ⟨frames⟩")));
        }
        Ok((first as u32..=last as u32).collect())
    }
}
