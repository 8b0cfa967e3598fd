//! The pictures of a converted capture: which are written anew, and how.

use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::picture::{self, Header};
use crate::formats::sequence::Pattern;
use crate::formats::temporary::TemporaryFolder;
use crate::formats::video;
use crate::formats::views::{LensAndMask, StatedCapture};
use crate::ordered;
use crate::scene::camera::Camera;
use crate::scene::capture::{Capture, Frame};
use crate::scene::color_space::ColorSpace;
use crate::scene::film::Film;
use crate::scene::lens::Lens;
use crate::scene::undistort::Distorted;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Use of the pixels under a mask.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Masked {
    /// They are used as if there were no mask.
    Used,
    /// They become the background of the capture, as if nothing were before it.
    Background,
}

/// Choices for the pictures of a capture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Choices<'c> {
    pub layer: Option<&'c str>,
    pub masked: Option<Masked>,
    pub limits: Limits,
}

/// Takes the pictures from elsewhere: those of a folder with the same names (of any suffix), of a pattern such as
/// `renders/view_####.exr`, whose files stand for the views in the order of their numbers, or the named files in the
/// order of the views.
///
/// # Errors
/// If a picture is not found, or there are fewer or more files than views.
pub(super) fn replace(capture: &mut Capture, from: &[PathBuf]) -> Result<()> {
    let views = capture.frames.len();
    let mut in_order = |files: Vec<PathBuf>, place: &Path| {
        if files.len() != views {
            return Err(Error::invalid(format!("{} pictures for {views} views", files.len()))
                .at(place)
                .hint("give one picture a view, in the order of the views"));
        }
        capture.frames.iter_mut().zip(files).for_each(|(frame, file)| frame.picture = file);
        Ok(())
    };
    let from = match from {
        [] => return Ok(()),
        [one] => match Pattern::parse(one) {
            Some(pattern) => {
                let files = pattern.numbers()?.into_iter().map(|number| pattern.path(number));
                return in_order(files.collect(), one);
            }
            None if one.is_dir() => one,
            None => return in_order(vec![one.clone()], one),
        },
        [first, ..] => return in_order(from.to_vec(), first),
    };
    let entries = std::fs::read_dir(from).map_err(|e| Error::io(from, e))?;
    let files: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|p| p.is_file()).collect();
    for frame in &mut capture.frames {
        let same =
            files.iter().filter(|file| file.file_stem() == frame.picture.file_stem() && picture::format(file).is_ok());
        let exact = same.clone().find(|file| file.file_name() == frame.picture.file_name());
        let found = exact.or_else(|| same.min()).ok_or_else(|| {
            let name = frame.picture.file_stem().unwrap_or_default().to_string_lossy();
            Error::invalid(format!("no picture '{name}.…' lies here"))
                .at(from)
                .hint("the pictures have the names that the capture states; for others give a pattern with ####")
        })?;
        frame.picture = found.clone();
    }
    Ok(())
}

/// Frames of videos, as pictures that are removed on drop.
#[derive(Debug)]
pub(super) struct VideoFrames {
    _folder: Option<TemporaryFolder>,
    /// Videos and the pictures of their frames.
    taken: Vec<[PathBuf; 2]>,
}

impl VideoFrames {
    /// Puts the frame `number` in the place of each picture that is a video, and keeps the pictures beside `output`.
    ///
    /// # Errors
    /// If a file cannot be read, or a video not be decoded.
    pub(crate) fn take(capture: &mut Capture, number: u32, output: &Path) -> Result<Self> {
        let videos = capture.frames.iter().map(|frame| video::is_video(&frame.picture)).collect::<Result<Vec<_>>>()?;
        if !videos.contains(&true) {
            return Ok(Self { _folder: None, taken: Vec::new() });
        }
        let beside = output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let folder = TemporaryFolder::new(beside)?;
        let take = |(i, (frame, is_video)): (usize, (&mut Frame, bool))| {
            if !is_video {
                return Ok(None);
            }
            let picture = folder.path().join(format!("{i}.png"));
            let video = std::mem::replace(&mut frame.picture, picture.clone());
            video::write_frame(&video, number, &picture)?;
            Ok(Some([video, picture]))
        };
        let taken = ordered::try_map(capture.frames.par_iter_mut().zip(videos).enumerate(), take)?;
        Ok(Self { _folder: Some(folder), taken: taken.into_iter().flatten().collect() })
    }

    /// Names the video in the place of its frame's picture.
    pub(crate) fn named(&self, error: Error) -> Error {
        self.taken.iter().fold(error, |error, [video, picture]| error.known_as(picture, video))
    }
}

/// A view to be converted.
pub(super) struct View<'v> {
    frame: &'v Frame,
    optics: &'v LensAndMask,
    header: Header,
    number: usize,
}

impl<'v> View<'v> {
    /// Reads the headers of all pictures, and returns their views.
    ///
    /// # Errors
    /// If a picture is not there or has another size than its camera, or it is masked and `masked` does not say what
    /// becomes of that.
    pub(crate) fn all(stated: &'v StatedCapture, choices: &Choices) -> Result<Vec<Self>> {
        let views = stated.capture.frames.iter().zip(&stated.optics).enumerate();
        let view = |(number, (frame, optics)): (usize, (&'v Frame, &'v LensAndMask))| {
            let header = picture::header(&frame.picture)?;
            let [w, h] = header.size;
            if [frame.camera.width as usize, frame.camera.height as usize] != header.size {
                return Err(Error::invalid(format!(
                    "the picture has {w}x{h} pixels, the capture says {}x{}",
                    frame.camera.width, frame.camera.height
                ))
                .at(&frame.picture)
                .hint(
                    "give the pictures that the cameras were calibrated with, or correct 'w', 'h' and the focal \
                       lengths",
                ));
            }
            if optics.mask.is_some() && choices.masked.is_none() {
                return Err(Error::invalid("the capture has masks ('mask_path')")
                    .part(format!("frame {number}"))
                    .hint("say what becomes of the pixels under them: ⟨masked=background⟩ or ⟨masked=used⟩"));
            }
            Ok(Self { frame, optics, header, number })
        };
        views.map(view).collect()
    }

    /// Returns true if the picture cannot be used as it lies there.
    pub(crate) fn changes(&self, choices: &Choices) -> bool {
        self.header.bits.is_some()
            || self.distorted()
            || choices.layer.is_some()
            || (self.optics.mask.is_some() && choices.masked == Some(Masked::Background))
    }

    /// Returns true if the picture is resampled.
    pub(crate) fn distorted(&self) -> bool {
        self.optics.lens != Lens::Pinhole
    }

    /// Bits of integer samples and their color space; none for EXRs.
    pub(crate) fn integer(&self, capture: &Capture) -> Option<(u8, ColorSpace)> {
        Some((self.header.bits?, capture.color_space.or(self.header.color_space)?))
    }

    /// Reads, masks and undistorts the picture.
    ///
    /// # Errors
    /// If the picture or its mask cannot be read or used.
    pub(crate) fn convert(&self, capture: &Capture, choices: &Choices) -> Result<(Camera, Film)> {
        let Frame { camera, picture } = self.frame;
        let place = |e: Error| e.at(picture).part(format!("frame {}", self.number));
        let Choices { layer, limits, .. } = *choices;
        let options =
            picture::Options { layer, color_space: capture.color_space, background: capture.background, limits };
        let mut film = picture::read(picture, &options).map_err(place)?.film;
        if let Some(mask) = self.optics.mask.as_deref().filter(|_| choices.masked == Some(Masked::Background)) {
            cover(&mut film, mask, capture.background, limits)?;
        }
        if !self.distorted() {
            return Ok((*camera, film));
        }
        let LensAndMask { lens, crop_radius, .. } = *self.optics;
        Distorted { camera: *camera, lens, crop_radius, film: &film }.undistort().map_err(place)
    }
}

/// Puts the background where a mask is black (below half).
fn cover(film: &mut Film, mask: &Path, background: [f32; 3], limits: Limits) -> Result<()> {
    let options = picture::Options { color_space: Some(ColorSpace::Linear), limits, ..picture::Options::default() };
    let mask_film = picture::read(mask, &options)?.film;
    if (mask_film.width, mask_film.height) != (film.width, film.height) {
        return Err(Error::invalid(format!(
            "the mask has {}x{} pixels, its picture {}x{}",
            mask_film.width, mask_film.height, film.width, film.height
        ))
        .at(mask)
        .hint("give a mask of the size of its picture"));
    }
    let [r, g, b] = background;
    let covered = film.rgba.iter_mut().zip(&mask_film.rgba).filter(|(_, mask)| mask[0] < 0.5);
    covered.for_each(|(pixel, _)| *pixel = [r, g, b, 0.0]);
    Ok(())
}
