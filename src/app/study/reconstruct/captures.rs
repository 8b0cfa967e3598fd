//! The pictures of a study of reconstructions: some are kept apart for the errors, of the others some are fitted.

use super::knobs::Variant;
use crate::app::photos;
use crate::error::{Error, Result};
use crate::formats::limits::Limits;
use crate::formats::transforms::{self, FILE_NAME};
use crate::formats::{captures, exr};
use crate::scene::capture::{Capture, Frame, Model};
use crate::scene::film::Film;
use serde_json::Map;
use sha2::{Digest, Sha256};
use std::cell::RefCell;
use std::collections::BTreeSet;
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

/// Every how many views one is kept apart.
const APART: usize = 8;
/// Fewest views of a capture that is studied.
const LEAST: usize = 6;
/// Folder in that of the page, of the captures that are fitted.
const FOLDER: &str = "captures";

/// Views of a capture.
pub(super) struct Views {
    /// Views that no reconstruction is fitted to.
    pub tests: Capture,
    /// Pictures of these views.
    pub films: Vec<Film>,
    /// Views that reconstructions are fitted to.
    pub fitted: Capture,
    folder: PathBuf,
    /// Captures that were written: once read they are protected.
    written: RefCell<BTreeSet<String>>,
    limits: Limits,
}

impl Views {
    /// Reads a capture and the pictures of the views that are kept apart. `page` is the folder of the page.
    ///
    /// # Errors
    /// If the capture or a picture cannot be read, or has too few views or another light than reconstructions explain.
    pub(super) fn read(path: &Path, page: &Path, limits: Limits) -> Result<Self> {
        let capture = captures::load(path)?;
        let count = capture.frames.len();
        if count < LEAST {
            return Err(Error::invalid(format!("the capture has {count} views, and {LEAST} are needed"))
                .at(path)
                .hint("some views are kept apart for the errors: take more pictures"));
        }
        if capture.model == Model::Scattering {
            return Err(Error::unsupported("the pictures show scattered light, of which the densities tell no errors")
                .at(path)
                .hint("study pictures of absorption, or of emission and absorption"));
        }
        let every = APART.min(count / 2);
        let of = |kept: bool| {
            let chosen = capture.frames.iter().enumerate().filter(|(at, _)| (at % every == every / 2) == kept);
            let absolute = |frame: &Frame| {
                let picture = std::path::absolute(&frame.picture).map_err(|e| Error::io(&frame.picture, e))?;
                Ok(Frame { picture, ..frame.clone() })
            };
            let frames = chosen.map(|(_, frame)| absolute(frame)).collect::<Result<Vec<_>>>()?;
            Ok::<_, Error>(Capture { frames, ..capture.clone() })
        };
        let (tests, fitted) = (of(true)?, of(false)?);
        let films = tests.frames.iter().map(|frame| photos::picture(&frame.picture, None, &tests, limits));
        let films = films.collect::<Result<Vec<_>>>()?;
        let folder = std::path::absolute(page.join(FOLDER)).map_err(|e| Error::io(page, e))?;
        Ok(Self { tests, films, fitted, folder, written: RefCell::default(), limits })
    }

    /// Writes the captures that the variants are found from, each once.
    ///
    /// # Errors
    /// If a picture cannot be read, or a file cannot be written.
    pub(super) fn write(&self, variants: &[Variant]) -> Result<()> {
        for variant in variants {
            let name = variant.capture();
            if !self.written.borrow().contains(&name) {
                self.write_one(variant, &self.folder.join(&name))?;
                self.written.borrow_mut().insert(name);
            }
        }
        Ok(())
    }

    fn write_one(&self, variant: &Variant, folder: &Path) -> Result<()> {
        std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
        let all = &self.fitted.frames;
        let chosen = (0..variant.views).map(|k| &all[k * all.len() / variant.views]);
        let frames = chosen.enumerate().map(|(at, frame)| {
            if variant.noise == 0.0 {
                return Ok(frame.clone());
            }
            let mut film = photos::picture(&frame.picture, None, &self.fitted, self.limits)?;
            add_noise(&mut film, variant.noise, at);
            let picture = folder.join(format!("view_{at:03}.exr"));
            exr::write_picture(&picture, &film, &exr::Attributes::new(), exr::Half::None)?;
            Ok(Frame { picture, ..frame.clone() })
        });
        let frames = frames.collect::<Result<Vec<_>>>()?;
        let capture = Capture { frames, color_space: None, ..self.fitted.clone() };
        let capture =
            if variant.noise == 0.0 { Capture { color_space: self.fitted.color_space, ..capture } } else { capture };
        transforms::save(&folder.join(FILE_NAME), &capture, &Map::new())
    }

    /// Returns the path of the capture that a variant is found from.
    pub(super) fn path(&self, variant: &Variant) -> PathBuf {
        self.folder.join(variant.capture())
    }
}

/// Adds noise of this standard deviation to the colors and the alpha of a picture, the same in each run.
fn add_noise(film: &mut Film, deviation: f64, view: usize) {
    for (at, pixel) in film.rgba.iter_mut().enumerate() {
        let digest = Sha256::digest(format!("{view} {at}"));
        let uniform = |k: usize| {
            let bytes = digest[4 * k..][..4].iter().fold(0_u32, |all, byte| all << 8 | u32::from(*byte));
            (f64::from(bytes) + 0.5) / 4_294_967_296.0
        };
        // Box and Muller (1958).
        for pair in 0..2 {
            let (radius, angle) = ((-2.0 * uniform(2 * pair).ln()).sqrt(), TAU * uniform(2 * pair + 1));
            pixel[2 * pair] += (deviation * radius * angle.cos()) as f32;
            pixel[2 * pair + 1] += (deviation * radius * angle.sin()) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_its_deviation_and_is_the_same_again() {
        let noisy = |view| {
            let mut film = Film::new(40, 40);
            add_noise(&mut film, 0.1, view);
            film
        };
        let film = noisy(1);
        let square: f64 = film.rgba.iter().flatten().map(|v| f64::from(*v).powi(2)).sum();
        // 6400 numbers: the deviation of their mean square is 0.01 √(2/6400).
        assert!((square / 6400.0 - 0.01).abs() < 5.0 * 0.01 * (2.0_f64 / 6400.0).sqrt(), "{square}");
        assert!(film == noisy(1) && film != noisy(2));
    }
}
