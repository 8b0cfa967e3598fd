//! Comparison of two noisy pictures by tests of their expected values.

mod report;
mod side;

pub use report::StatisticalReport;

use super::{CompareSettings, traits};
use crate::app::Context;
use crate::app::outputs::{self, Content};
use crate::error::{Code, Error, Result};
use crate::formats::exr::deep;
use crate::formats::{exr, png};
use crate::metrics::heatmap;
use crate::metrics::statistical::{self, Estimate, PIXEL_BYTES, Question};
use crate::scene::film::Film;
use serde::{Deserialize, Serialize};
use side::{Read, Side};
use std::path::{Path, PathBuf};

/// Settings of the test whether two noisy pictures have the same expected values: pixel by pixel, in tiles, in the
/// mean, and by the spread of the differences.
///
/// The noise is known from renders by other seeds, else from a layer with the variance, else from the layers `half_a`
/// and `half_b`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct StatisticalSettings {
    /// True to test expected values, within [`CompareSettings::tolerance`], in the place of samples.
    pub statistical: bool,
    /// Other renders of the first picture by other seeds.
    #[serde(with = "crate::app::paths")]
    pub repeat_a: Vec<PathBuf>,
    /// Other renders of the second picture by other seeds.
    #[serde(with = "crate::app::paths")]
    pub repeat_b: Vec<PathBuf>,
    /// Pictures that are taken for free of noise, such as a closed form.
    pub noiseless: Vec<Which>,
    /// Layer with the variance of each pixel's mean; none for `variance`.
    pub variance_layer: Option<String>,
    /// Probability with which pictures of equal expected values may be called different, between 0 and 1.
    pub false_alarm: f64,
    /// Edge of a tile in pixels, 1 or more.
    pub tile: u32,
}

impl Default for StatisticalSettings {
    fn default() -> Self {
        Self {
            statistical: false,
            repeat_a: Vec::new(),
            repeat_b: Vec::new(),
            noiseless: Vec::new(),
            variance_layer: None,
            false_alarm: 1e-3,
            tile: 16,
        }
    }
}

/// One of the two pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Which {
    /// The first picture.
    A,
    /// The second picture.
    B,
}

impl Which {
    /// Setting of further renders of the picture, as texts name it.
    fn repeat(self) -> &'static str {
        match self {
            Self::A => "⟨repeat_a⟩",
            Self::B => "⟨repeat_b⟩",
        }
    }

    /// Setting that takes the picture for free of noise, as texts name it.
    fn noiseless(self) -> &'static str {
        match self {
            Self::A => "⟨noiseless=a⟩",
            Self::B => "⟨noiseless=b⟩",
        }
    }
}

impl StatisticalSettings {
    /// Returns the paths of the further renders.
    pub(super) fn repeats(&self) -> impl Iterator<Item = &PathBuf> {
        self.repeat_a.iter().chain(&self.repeat_b)
    }

    fn question(&self, tolerance: f64) -> Result<Question> {
        let false_alarm = self.false_alarm;
        if !(false_alarm > 0.0 && false_alarm < 1.0) {
            return Err(Error::invalid(format!("⟨false_alarm⟩ {false_alarm}: a number between 0 and 1 is expected"))
                .hint("0.001 lets one of a thousand comparisons of equal scenes fail"));
        }
        Ok(Question { false_alarm, tolerance, tile: self.tile as usize })
    }
}

impl CompareSettings {
    /// Tests the expected values of two pictures.
    ///
    /// # Errors
    /// If a picture cannot be read, the noise of a side is not known, the sizes differ, more memory is needed than is
    /// allowed, or the heat map cannot be written.
    pub(super) fn test(&self, context: &Context) -> Result<StatisticalReport> {
        let _stage = context.stage("testing");
        let question = self.statistical.question(self.tolerance)?;
        let mut pictures = [&self.a, &self.b].into_iter().chain(self.statistical.repeats());
        pictures.try_for_each(|path| deep::refuse(path))?;
        let sides = [self.side(Which::A)?, self.side(Which::B)?];
        if let Some(path) = &self.heatmap {
            outputs::file(path, Content::Png)?;
        }
        self.check_statistical_memory()?;
        self.check_headers()?;
        let [a, b] = sides.each_ref().map(|side| side.read(self.limits));
        let (a, b): (Read, Read) = (a?, b?);
        let named = |e: Error| e.part(format!("{} and {}", self.a.display(), self.b.display()));
        let verdict = statistical::test(&a.estimate, &b.estimate, question).map_err(named)?;
        let mut heatmap_scale = None;
        if let Some(path) = &self.heatmap {
            let [left, right] = [&a.estimate, &b.estimate].map(film);
            let (rgb, scale) = heatmap::difference_rgb8(&left, &right);
            png::write_rgb8(path, left.width, left.height, &rgb)?;
            heatmap_scale = Some(scale);
        }
        Ok(StatisticalReport::new(verdict, [a.noise, b.noise], heatmap_scale))
    }

    fn side(&self, which: Which) -> Result<Side<'_>> {
        let settings = &self.statistical;
        let (picture, repeats) = match which {
            Which::A => (&self.a, &settings.repeat_a),
            Which::B => (&self.b, &settings.repeat_b),
        };
        let noiseless = settings.noiseless.contains(&which);
        if noiseless && !repeats.is_empty() {
            let (noiseless, repeat) = (which.noiseless(), which.repeat());
            return Err(Error::invalid(format!("{noiseless} and {repeat} contradict each other"))
                .hint("renders of several seeds tell the noise; leave one of the two out"));
        }
        let layer = self.layer.as_deref();
        let variance_layer = settings.variance_layer.as_deref();
        Ok(Side { which, picture, repeats, noiseless, layer, variance_layer })
    }

    /// Refuses pictures whose samples do not mean the same.
    fn check_headers(&self) -> Result<()> {
        let [a, b] = [exr::header(&self.a)?, exr::header(&self.b)?];
        let mut differences = traits::of_headers(&a, &b);
        if !a.primaries().is_same(&b.primaries()) {
            differences.push(format!("primaries {} and {}", a.primaries(), b.primaries()));
        }
        if differences.is_empty() {
            return Ok(());
        }
        Err(Error::invalid(format!("the pictures differ in their headers: {}", differences.join("; ")))
            .part(format!("{} and {}", self.a.display(), self.b.display()))
            .hint("render both with the same camera and in the same color space"))
    }

    fn check_statistical_memory(&self) -> Result<()> {
        let pixels = |path: &Path| Ok(exr::header(path)?.display_window.pixels());
        let needed = pixels(&self.a)?.max(pixels(&self.b)?).saturating_mul(PIXEL_BYTES);
        let allowed = self.limits.max_memory;
        if needed <= allowed {
            return Ok(());
        }
        let mib = |bytes: u64| bytes.div_ceil(1 << 20);
        Err(Error::unsupported(format!("testing them needs {} MiB, {} MiB are allowed", mib(needed), mib(allowed)))
            .part(format!("{} and {}", self.a.display(), self.b.display()))
            .coded(Code::MemoryLimit)
            .hint("raise ⟨max_memory⟩, or compare smaller pictures"))
    }
}

/// Film of the means.
fn film(estimate: &Estimate) -> Film {
    Film::of(estimate.width, estimate.height, estimate.mean.clone())
}
