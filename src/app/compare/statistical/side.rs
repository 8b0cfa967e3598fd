//! One side of a statistical comparison, read from its files with what is known of its noise.

use super::Which;
use crate::error::{Error, Result};
use crate::formats::exr::{self, Picture};
use crate::formats::limits::Limits;
use crate::metrics::statistical::{Estimate, Freedom};
use crate::wording::worded;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Layer that holds the number of samples of each pixel.
const SAMPLES: &str = "Debug Sample Count";
/// Layers of a picture's halves.
const HALVES: [&str; 2] = ["half_a", "half_b"];

/// Files of a side.
#[derive(Debug)]
pub(super) struct Side<'s> {
    pub which: Which,
    pub picture: &'s Path,
    pub repeats: &'s [PathBuf],
    pub noiseless: bool,
    pub layer: Option<&'s str>,
    pub variance_layer: Option<&'s str>,
}

/// Where a side's variances come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(super) enum Source {
    /// The side counts as free of noise.
    None,
    /// Several renders.
    Repeats,
    /// A layer with the variance of each pixel's mean.
    Variance,
    /// Two layers, each with the mean of one half of the samples.
    Halves,
}

/// Noise of a side.
#[derive(Debug, Clone, Serialize, schemars::JsonSchema)]
pub(super) struct Noise {
    pub source: Source,
    /// Number of pictures read.
    pub pictures: usize,
    /// Smallest degrees of freedom of a pixel's variance; `null` if they are unknown and count as infinite.
    pub freedom: Option<f64>,
    /// Reason to doubt the conclusion.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub remark: Option<String>,
}

/// A side that was read.
#[derive(Debug)]
pub(super) struct Read {
    pub estimate: Estimate,
    pub noise: Noise,
}

impl<'s> Side<'s> {
    /// Reads the side.
    ///
    /// # Errors
    /// If a picture cannot be read, repeated renders differ in size, variances are negative or all infinite, or nothing
    /// tells the noise.
    pub(crate) fn read(&self, limits: Limits) -> Result<Read> {
        if self.noiseless {
            let picture = exr::picture_within(self.picture, self.layer, limits)?;
            return Ok(self.done(picture, None, Freedom::All(f64::INFINITY), Source::None, None));
        }
        if !self.repeats.is_empty() {
            return self.repeated(limits);
        }
        // The layers beside the beauty tell its noise, not that of another layer.
        if self.layer.is_none() || self.variance_layer.is_some() {
            let name = self.variance_layer.unwrap_or("variance");
            if self.variance_layer.is_some() || self.has_layer(name)? {
                return self.with_variance(name, limits);
            }
            if self.has_layer(HALVES[0])? && self.has_layer(HALVES[1])? {
                return self.with_halves(limits);
            }
        }
        Err(Error::invalid("nothing tells the noise of this picture").at(self.picture).hint(format!(
            "give another render by another seed ({}), render with ⟨aov=variance⟩, or, if the picture has no noise, \
             say so with {}",
            self.which.repeat(),
            self.which.noiseless()
        )))
    }

    fn has_layer(&self, name: &str) -> Result<bool> {
        let matches = |layer: &str| layer.rsplit('.').next().is_some_and(|last| last.eq_ignore_ascii_case(name));
        Ok(exr::header(self.picture)?.layers().iter().any(|layer| matches(&layer.name)))
    }

    fn done(
        &self,
        picture: Picture,
        variance: Option<(Vec<[f32; 4]>, bool)>,
        freedom: Freedom,
        source: Source,
        remark: Option<String>,
    ) -> Read {
        let film = picture.film;
        let (variance, has_alpha) = variance.unwrap_or_else(|| (vec![[0.0; 4]; film.rgba.len()], true));
        let least = Some(freedom.smallest()).filter(|f| f.is_finite());
        let noise = Noise { source, pictures: 1 + self.repeats.len(), freedom: least, remark };
        let estimate =
            Estimate { width: film.width, height: film.height, mean: film.rgba, variance, freedom, has_alpha };
        Read { estimate, noise }
    }

    /// Mean of several renders, with the variance between them.
    fn repeated(&self, limits: Limits) -> Result<Read> {
        let mut first = exr::picture_within(self.picture, self.layer, limits)?;
        let mut mean: Vec<[f64; 4]> = first.film.rgba.iter().map(|p| p.map(f64::from)).collect();
        let mut squares = vec![[0.0_f64; 4]; mean.len()];
        for (index, path) in self.repeats.iter().enumerate() {
            let next = exr::picture_within(path, self.layer, limits)?.film;
            if (next.width, next.height) != (first.film.width, first.film.height) {
                let sizes = format!("{}x{} and {}x{}", first.film.width, first.film.height, next.width, next.height);
                return Err(Error::invalid(format!("renders of one scene in different sizes: {sizes}"))
                    .at(path)
                    .hint("give renders that differ in nothing but the seed"));
            }
            // Welford 1962.
            let count = (index + 2) as f64;
            for ((m, s), pixel) in mean.iter_mut().zip(&mut squares).zip(&next.rgba) {
                for c in 0..4 {
                    let before = f64::from(pixel[c]) - m[c];
                    m[c] += before / count;
                    s[c] += before * (f64::from(pixel[c]) - m[c]);
                }
            }
        }
        let freedom = self.repeats.len() as f64;
        let variance: Vec<[f32; 4]> =
            squares.iter().map(|s| s.map(|s| (s / (freedom * (freedom + 1.0))) as f32)).collect();
        first.film.rgba = mean.iter().map(|m| m.map(|m| m as f32)).collect();
        let same = variance.iter().flatten().all(|v| *v == 0.0);
        let remark = same.then(|| "all renders are identical and count as free of noise; did the seeds differ?".into());
        Ok(self.done(first, Some((variance, true)), Freedom::All(freedom), Source::Repeats, remark))
    }

    fn with_variance(&self, name: &str, limits: Limits) -> Result<Read> {
        let picture = exr::picture_within(self.picture, self.layer, limits)?;
        let variance = exr::picture_within(self.picture, Some(name), limits)?;
        let place = |e: Error| e.at(self.picture).part(format!("layer '{}'", variance.layer));
        let colors = || variance.film.rgba.iter().flat_map(|p| &p[..3]);
        if let Some(negative) = colors().find(|v| **v < 0.0) {
            return Err(place(Error::invalid(format!("a variance of {negative}")))
                .hint("variances are 0 or more: name the right layer with ⟨variance_layer⟩"));
        }
        if !colors().any(|v| v.is_finite()) {
            return Err(place(Error::invalid("no variance is finite"))
                .hint(format!("one sample a pixel tells no variance: take more samples, or {}", self.which.repeat())));
        }
        let has_alpha = variance.channels.iter().any(|c| ["a", "alpha"].contains(&c.to_ascii_lowercase().as_str()));
        let (freedom, remark) = if self.has_layer(SAMPLES)? {
            let counts = exr::picture_within(self.picture, Some(SAMPLES), limits)?.film.rgba;
            (Freedom::ByPixel(counts.iter().map(|p| (p[0] - 1.0).max(0.0)).collect()), None)
        } else {
            let remark = worded("the number of samples is unknown and counts as large (⟨aov=samples⟩ tells it)");
            (Freedom::All(f64::INFINITY), Some(remark.into()))
        };
        Ok(self.done(picture, Some((variance.film.rgba, has_alpha)), freedom, Source::Variance, remark))
    }

    /// The picture is the mean of its halves, so its variance is a quarter of their squared difference.
    fn with_halves(&self, limits: Limits) -> Result<Read> {
        let mut picture = exr::picture_within(self.picture, None, limits)?;
        let [a, b] = HALVES.map(|name| Ok(exr::picture_within(self.picture, Some(name), limits)?.film.rgba));
        let (a, b): (Vec<[f32; 4]>, Vec<[f32; 4]>) = (a?, b?);
        let mut variance = vec![[0.0; 4]; a.len()];
        for (i, (p, q)) in a.iter().zip(&b).enumerate() {
            for c in 0..3 {
                picture.film.rgba[i][c] = (0.5 * (f64::from(p[c]) + f64::from(q[c]))) as f32;
                variance[i][c] = (0.25 * (f64::from(p[c]) - f64::from(q[c])).powi(2)) as f32;
            }
        }
        Ok(self.done(picture, Some((variance, false)), Freedom::All(1.0), Source::Halves, None))
    }
}
