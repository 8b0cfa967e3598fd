//! Figures of sequences against a reference.

use super::space::{Space, flip};
use crate::app::failed::{Failed, List};
use crate::error::Result;
use crate::metrics::error::psnr_db;
use crate::metrics::{self, Comparison, flicker};
use crate::scene::film::Film;
use crate::text::ranges;
use schemars::JsonSchema;
use serde::Serialize;
use std::borrow::Cow;
use std::fmt;
use std::path::PathBuf;

/// Figures of a frame.
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub(super) struct Figures {
    pub frame: u32,
    /// `null` for identical colors.
    pub psnr_db: Option<f64>,
    pub ssim: f64,
    pub rel_mse: f64,
    pub max_abs: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flip: Option<f64>,
    /// PSNR of the change from the frame before; `null` for the first, and without any error.
    pub flicker_psnr_db: Option<f64>,
}

/// Figures of a sequence against its reference.
#[derive(Debug, Serialize, JsonSchema)]
pub(super) struct Track {
    pub frames: Vec<Figures>,
    /// Of the mean squared error over all frames, for the largest peak.
    pub psnr_db: Option<f64>,
    /// Of the mean squared error of the changes from frame to frame.
    pub flicker_psnr_db: Option<f64>,
    /// Means over the frames.
    pub ssim: f64,
    pub rel_mse: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flip: Option<f64>,
    pub max_abs: f64,
    pub peak: f64,
}

/// Report of two sequences.
#[derive(Debug, Serialize, JsonSchema)]
pub struct SequencesReport {
    #[serde(flatten)]
    pub(super) all: Track,
    /// The sequence of `beside` against the same reference.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) beside: Option<Track>,
    /// Frames that not all of the sequences have.
    pub(super) left_out: Vec<u32>,
    /// Frames that could not be read or compared.
    pub(super) failed: Vec<Failed>,
    pub(super) differ: bool,
    /// Differences between the frames beside their samples, in words.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) differences: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none", serialize_with = "crate::app::paths::text")]
    pub(super) report: Option<PathBuf>,
}

/// A figure in decibels, or a dash.
struct Decibels(Option<f64>);

impl fmt::Display for Decibels {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(v) => f.pad(&format!("{v:.2}")),
            None => f.pad("-"),
        }
    }
}

impl fmt::Display for Track {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "   frame  psnr_db     ssim    rel_mse  flicker_psnr_db{}",
            if self.flip.is_some() { "    flip" } else { "" }
        )?;
        let end = |flip: Option<f64>| flip.map_or_else(String::new, |flip| format!("  {flip:.4}"));
        for g in &self.frames {
            let (psnr, flicker) = (Decibels(g.psnr_db), Decibels(g.flicker_psnr_db));
            writeln!(f, "{:8} {psnr:>8} {:8.5} {:10.3e} {flicker:>16}{}", g.frame, g.ssim, g.rel_mse, end(g.flip))?;
        }
        let (psnr, flicker) = (Decibels(self.psnr_db), Decibels(self.flicker_psnr_db));
        writeln!(f, "     all {psnr:>8} {:8.5} {:10.3e} {flicker:>16}{}", self.ssim, self.rel_mse, end(self.flip))
    }
}

impl fmt::Display for SequencesReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.all)?;
        if let Some(beside) = &self.beside {
            write!(f, "beside\n{beside}")?;
        }
        if !self.left_out.is_empty() {
            writeln!(
                f,
                "left out  {}: not all of the sequences have these frames",
                ranges(self.left_out.iter().copied())
            )?;
        }
        self.differences.iter().try_for_each(|what| writeln!(f, "{what}"))?;
        if let Some(report) = &self.report {
            writeln!(f, "report    {}", report.display())?;
        }
        let verdict = match (self.differ, self.failed.is_empty()) {
            (true, _) => "the sequences differ",
            (false, true) => "the sequences agree",
            (false, false) => "the sequences agree where they could be compared",
        };
        write!(f, "{verdict}{}", List(&self.failed))
    }
}

/// Comparison of a sequence with its reference, frame by frame.
#[derive(Debug)]
pub(super) struct Gauge {
    space: Space,
    with_flip: bool,
    frames: Vec<Figures>,
    errors: Vec<f64>,
    /// Of the change to each frame, where the one before is there.
    changes: Vec<Option<f64>>,
    peak: f64,
    before: Option<(u32, [Film; 2])>,
}

impl Gauge {
    /// Begins a comparison of values in a space, with FLIP or without.
    pub(super) fn new(space: Space, with_flip: bool) -> Self {
        Self { space, with_flip, frames: Vec::new(), errors: Vec::new(), changes: Vec::new(), peak: 0.0, before: None }
    }

    /// Compares the next frame.
    ///
    /// # Errors
    /// If the films have different sizes.
    pub(crate) fn add(&mut self, number: u32, linear: [&Film; 2]) -> Result<Comparison> {
        let films = linear.map(|film| self.space.of(film));
        let c = metrics::compare(&films[0], &films[1])?;
        let size = |film: &Film| [film.width, film.height];
        let is_next =
            |(last, old): &&(u32, [Film; 2])| last.checked_add(1) == Some(number) && size(&old[0]) == size(&films[0]);
        let follows = self.before.as_ref().filter(is_next);
        self.changes.push(follows.map(|(_, old)| flicker::error([&old[0], &films[0]], [&old[1], &films[1]])));
        self.errors.push(c.rms * c.rms);
        self.peak = self.peak.max(c.peak);
        self.frames.push(Figures {
            frame: number,
            psnr_db: Some(c.psnr_db).filter(|v| v.is_finite()),
            ssim: c.ssim,
            rel_mse: c.rel_mse,
            max_abs: c.max_abs,
            flip: self.with_flip.then(|| flip(linear)),
            flicker_psnr_db: None,
        });
        self.before = Some((number, films.map(Cow::into_owned)));
        Ok(c)
    }

    /// Closes with the figures over all frames.
    pub(crate) fn closed(self) -> Track {
        let Self { mut frames, errors, changes, peak, .. } = self;
        let decibel = |error: f64| Some(psnr_db(error, peak)).filter(|v| v.is_finite());
        for (figures, change) in frames.iter_mut().zip(&changes) {
            figures.flicker_psnr_db = change.and_then(decibel);
        }
        let average = |all: &[f64]| all.iter().sum::<f64>() / all.len().max(1) as f64;
        let mean = |of: &dyn Fn(&Figures) -> f64| average(&frames.iter().map(of).collect::<Vec<_>>());
        let flickers: Vec<f64> = changes.into_iter().flatten().collect();
        Track {
            psnr_db: decibel(average(&errors)),
            flicker_psnr_db: Some(average(&flickers)).filter(|_| !flickers.is_empty()).and_then(decibel),
            ssim: mean(&|g| g.ssim),
            rel_mse: mean(&|g| g.rel_mse),
            flip: frames.iter().any(|g| g.flip.is_some()).then(|| mean(&|g| g.flip.unwrap_or_default())),
            max_abs: frames.iter().map(|g| g.max_abs).fold(0.0, f64::max),
            peak,
            frames,
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    /// Pixels of pictures of other proportions are not the same places, even of equal width.
    #[test]
    fn a_change_of_size_is_no_flicker() {
        let film = |height: usize, v: f32| Film::of(4, height, vec![[v, v, v, 1.0]; 4 * height]);
        let mut gauge = Gauge::new(Space::Linear, false);
        for (number, height, value) in [(1, 4, 0.1), (2, 4, 0.2), (3, 8, 0.9), (4, 8, 0.7)] {
            gauge.add(number, [&film(height, value), &film(height, 0.0)]).unwrap();
        }
        let flickers = gauge.closed().frames.iter().map(|g| g.flicker_psnr_db.is_some()).collect::<Vec<_>>();
        assert_eq!(flickers, [false, true, false, true]);
    }
}
