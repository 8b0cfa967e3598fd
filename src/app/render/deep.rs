//! Deep pictures, into which other elements can be put afterwards.

use super::RenderSettings;
use super::accuracy::{REPLICATES, SCENE};
use super::begun::Pictured;
use super::target::Target;
use crate::app::context::Picture;
use crate::app::pictured::BACKGROUND;
use crate::app::pictures::renderer::SceneRenderer;
use crate::cancel::Cancel;
use crate::error::{Code, Error, Result};
use crate::formats::exr::Window;
use crate::formats::exr::deep::{self, Encoding, Layout};
use crate::formats::registry::EXR;
use crate::render::deep::{Deep, DeepRows};
use crate::render::film::{Rendered, View};
use crate::render::integrator::Counts;
use crate::render::tiles::Watch;
use crate::scene::film::Film;
use serde::Serialize;
use std::fmt;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

/// Range of the error: of less, depths in single precision tell little.
const ERRORS: [f64; 2] = [1e-4, 0.5];
/// Rows that are rendered before they are written.
const ROWS: usize = 64;

/// Samples of deep pictures.
#[derive(Debug, Clone, Copy, Default, Serialize, schemars::JsonSchema)]
pub(super) struct DeepReport {
    /// Largest error of color and opacity before any depth.
    error: f64,
    /// Pixels that show anything.
    pixels: u64,
    /// Samples of all of them together.
    samples: u64,
    /// Samples of the pixel that has most.
    most: u32,
}

impl DeepReport {
    fn plus(self, other: Self) -> Self {
        Self {
            error: self.error.max(other.error),
            pixels: self.pixels + other.pixels,
            samples: self.samples + other.samples,
            most: self.most.max(other.most),
        }
    }
}

impl fmt::Display for DeepReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { error, pixels, samples, most } = self;
        let mean = *samples as f64 / (*pixels).max(1) as f64;
        write!(
            f,
            "  deep, within {error} before any depth: {mean:.1} samples a pixel that shows anything, {most} at most"
        )
    }
}

/// Samples of the deep pictures so far.
#[derive(Debug, Default)]
pub(super) struct Tally(Mutex<Option<DeepReport>>);

impl Tally {
    fn add(&self, report: DeepReport) {
        let mut sum = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        *sum = Some(sum.unwrap_or_default().plus(report));
    }

    /// Returns the samples, if deep pictures were rendered.
    pub(super) fn report(&self) -> Option<DeepReport> {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl RenderSettings {
    /// Refuses settings that deep pictures do not go with.
    pub(super) fn check_deep(&self) -> Result<()> {
        let Some(error) = self.deep else { return Ok(()) };
        let [least, most] = ERRORS;
        if !(least..=most).contains(&error) {
            return Err(Error::invalid(format!("⟨deep={error:?}⟩: an error from {least:?} to {most:?} is expected"))
                .coded(Code::Usage)
                .hint("give ⟨deep=0.01⟩ for pictures whose error is hardly seen"));
        }
        let others = [
            ("⟨png⟩", self.png),
            ("⟨half⟩", self.half),
            ("⟨compression⟩", !self.compression.is_lossless()),
            ("⟨denoise⟩", self.denoise),
            ("⟨aov⟩", !self.aov.is_empty()),
            ("⟨holdout⟩", self.holdout.holdout.is_some()),
            ("⟨target_error⟩, ⟨time⟩ and ⟨replicates⟩", self.accuracy.on()),
        ];
        if let Some((name, _)) = others.iter().find(|(_, given)| *given) {
            return Err(Error::invalid(format!("{name}: flat pictures alone are rendered with it"))
                .coded(Code::Usage)
                .hint(
                    "leave it out, or leave out ⟨deep⟩; what a deep picture shows before a depth is known afterwards",
                ));
        }
        if self.pictures.shade.is_none()
            && let Some(quadrature) = self.pictures.quadrature.filter(|quadrature| quadrature.step().is_some())
        {
            return Err(Error::invalid(format!("⟨quadrature⟩: {quadrature} has no bound of its error"))
                .coded(Code::Usage)
                .hint("leave it out, or give exact or preintegrated: parts of rays are integrated apart"));
        }
        match Target::of(&self.output)? {
            Target::File(path) if !EXR.has_name(path) => {
                Err(Error::invalid("⟨deep⟩: a deep picture would be written, which is an OpenEXR file")
                    .coded(Code::OutputName)
                    .at(path)
                    .hint("let the name end in .exr"))
            }
            _ => Ok(()),
        }
    }

    /// Renders a deep view, or frame, of that number, and writes it to a path as it is made. Returns what its samples
    /// show together.
    ///
    /// # Errors
    /// If the file cannot be written, or the work is stopped.
    pub(super) fn deep_picture(
        &self,
        pictured: &Pictured<'_>,
        (renderer, view): (&SceneRenderer<'_>, View<'_>),
        (path, tally): (PathBuf, &Tally),
        whole: Option<[usize; 2]>,
        (cancel, progress): (&Cancel, &Picture<'_>),
    ) -> Result<Rendered> {
        let error = self.deep.unwrap_or_default();
        let [width, height] = [view.camera.width, view.camera.height].map(|side| side as usize);
        let sampling = self.pictures.sampling(renderer, pictured.number);
        let picture = Deep::new(view, sampling, error, pictured.scene);
        let mut film = Film { samples: sampling.samples(), ..Film::of(width, height, Vec::new()) };
        let mut attributes = pictured.attributes(self, renderer, (&film, None));
        // Samples have no background, and pictures of other seeds cannot be joined with them.
        [BACKGROUND, REPLICATES, SCENE].into_iter().for_each(|name| drop(attributes.remove(name)));
        attributes.insert("cumulo:deep_error".into(), error.to_string());
        if self.is_sequence() {
            attributes.insert("cumulo:frame".into(), pictured.number.to_string());
        }
        pictured.camera_attributes(whole, &mut attributes);
        let all = (width * height) as u64;
        let done = |pixels| progress.add(pixels, all);
        let (mut counts, mut sum) = (Counts::default(), DeepReport { error, ..DeepReport::default() });
        deep::write(&path, &self.deep_layout([width, height], whole), &attributes, Encoding::default(), |writer| {
            for first in (0..height).step_by(ROWS) {
                let rows = first..height.min(first + ROWS);
                let watch = Watch { cancel, done: Some(&done) };
                let made = renderer.renderer.deep(&picture, rows, watch).ok_or_else(Error::cancelled)?;
                let DeepRows { lines, rgba, counts: events } = made;
                film.rgba.extend(rgba);
                counts = counts.plus(events);
                for line in lines {
                    let shown = line.counts.iter().filter(|count| **count > 0);
                    sum.pixels += shown.count() as u64;
                    sum.samples += line.samples.len() as u64;
                    sum.most = line.counts.iter().copied().fold(sum.most, u32::max);
                    writer.push(line)?;
                }
            }
            Ok(())
        })?;
        tally.add(sum);
        Ok(Rendered { film, counts })
    }

    /// Returns size and place of a deep picture, which may be a part of a whole one.
    fn deep_layout(&self, size: [usize; 2], whole: Option<[usize; 2]>) -> Layout {
        match (whole, self.pictures.crop) {
            (Some(display), Some(part)) => Layout {
                display_window: Window { min: [0; 2], size: display },
                data_window: Window { min: part.origin.map(|v| v as i32), size },
                pixel_aspect: 1.0,
            },
            _ => Layout::whole(size[0], size[1]),
        }
    }
}
