//! The frames of a study of denoising, in a folder of their own, and what they are to be.

use crate::app::Context;
use crate::app::denoise::DenoiseSettings;
use crate::app::denoise::names::Names;
use crate::app::study::Errors;
use crate::app::study::errors::scale;
use crate::app::study::noise;
use crate::app::study::reference::Reference;
use crate::error::{Error, Result};
use crate::formats::exr;
use crate::formats::limits::Limits;
use crate::scene::film::Film;
use crate::wording::worded;
use std::path::{Path, PathBuf};
use std::time::Instant;
use tempfile::TempDir;

/// Names of the pictures in the folder.
const NOISY: &str = "noisy.####.exr";
const QUIET: &str = "quiet.####.exr";

/// Noisy frames, linked into a folder in which they are denoised: some of a sequence count as all of it.
pub(super) struct Frames {
    folder: TempDir,
    input: PathBuf,
    numbers: Vec<u32>,
}

impl Frames {
    /// Links these frames of a sequence, or its one picture.
    ///
    /// # Errors
    /// If the folder cannot be made or written to.
    pub(super) fn of(names: &Names, numbers: &[u32]) -> Result<Self> {
        let folder = tempfile::tempdir().map_err(|e| Error::io(std::env::temp_dir(), e))?;
        let input = folder.path().join(if names.is_still() { "noisy.exr" } else { NOISY });
        let own = Names::of(&input)?;
        for number in numbers {
            let to = own.path(*number);
            let from = std::path::absolute(names.path(*number)).map_err(|e| Error::io(names.path(*number), e))?;
            std::os::unix::fs::symlink(from, &to).map_err(|e| Error::io(&to, e))?;
        }
        Ok(Self { folder, input, numbers: numbers.to_vec() })
    }

    /// Denoises the frames by these settings, and returns them with the seconds that it took.
    ///
    /// # Errors
    /// Those of denoising, also of one frame.
    pub(super) fn denoise(&self, settings: &DenoiseSettings, context: &Context) -> Result<(Vec<Film>, f64)> {
        let still = self.input.file_name().is_some_and(|name| name != NOISY);
        // Frames that were read are protected: none may take their place.
        let folder = tempfile::tempdir_in(self.folder.path()).map_err(|e| Error::io(self.folder.path(), e))?;
        let output = folder.path().join(if still { "quiet.exr" } else { QUIET });
        let (input, to) = (self.input.clone(), Names::of(&output)?);
        let own = DenoiseSettings { input, output, ..settings.clone() };
        let begun = Instant::now();
        own.run(&context.silent())?.check()?;
        let seconds = begun.elapsed().as_secs_f64();
        Ok((read(&self.numbers, settings.limits, |number| to.path(number))?, seconds))
    }
}

/// Reads the colors of frames.
///
/// # Errors
/// If one cannot be read.
pub(super) fn read(numbers: &[u32], limits: Limits, path: impl Fn(u32) -> PathBuf) -> Result<Vec<Film>> {
    numbers.iter().map(|number| exr::read_picture_within(&path(*number), None, limits)).collect()
}

/// Frames that the denoised ones are measured against.
pub(super) struct Truth {
    pub films: Vec<Film>,
    pub reference: Reference,
    /// Root mean square of the colors.
    pub scale: f64,
}

impl Truth {
    /// Reads the reference, whose noise its layer `variance` or its halves tell, and compares it with the noisy frames.
    ///
    /// # Errors
    /// If a frame cannot be read, all are black, or they have another size than the noisy ones.
    pub(super) fn read(names: &Names, noisy: &[Names], numbers: &[u32], limits: Limits) -> Result<Self> {
        let begun = Instant::now();
        let (mut films, mut variances) = (Vec::new(), Vec::new());
        for number in numbers {
            let mut film = exr::read_film_within(&names.path(*number), None, limits)?;
            variances.extend(noise::variance(&film));
            film.planes.clear();
            films.push(film);
        }
        let read = |names: &Names, numbers: &[u32]| read(numbers, limits, |number| names.path(number));
        let first = noisy.first().map_or(Ok(Vec::new()), |names| read(names, numbers))?;
        for names in noisy.iter().skip(1) {
            alike(&read(names, &numbers[..1])?, &films[..1], &names.path(numbers[0]))?;
        }
        alike(&first, &films, &names.path(numbers[0]))?;
        let scale = scale(&films)?;
        let known = variances.len() == films.len();
        let mean = variances.iter().sum::<f64>() / variances.len().max(1) as f64;
        let before = Errors::of_films(&first, &films, scale).rms;
        let method = match known {
            true => "noise of the reference by its own layers",
            false => "the reference has no layer variance, which ⟨render.aov=variance⟩ writes",
        };
        let reference = Reference {
            options: format!("{} frames, from which the noisy ones are off by {before:.2e}", films.len()),
            method: worded(method).into_owned(),
            uncertainty: if known { mean.sqrt() / scale } else { 0.0 },
            random: known,
            seconds: begun.elapsed().as_secs_f64(),
        };
        Ok(Self { films, reference, scale })
    }
}

/// Refuses pictures that have another size than those of the reference; `place` is that of one of them.
fn alike(films: &[Film], reference: &[Film], place: &Path) -> Result<()> {
    match films.iter().zip(reference).find(|(a, b)| (a.width, a.height) != (b.width, b.height)) {
        Some((a, b)) => {
            let what = format!("{}x{} pixels beside a reference of {}x{}", a.width, a.height, b.width, b.height);
            Err(Error::invalid(what).at(place).hint("render both alike"))
        }
        None => Ok(()),
    }
}
