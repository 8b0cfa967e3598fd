//! Comparison of two pictures.

use super::traits::{self, Matched};
use super::{CompareSettings, space};
use crate::app::outputs::{self, Content};
use crate::error::{Code, Error, Result};
use crate::formats::limits::Limits;
use crate::formats::{exr, png};
use crate::metrics::{self, Comparison, flip, heatmap};
use crate::text::printable;
use schemars::JsonSchema;
use serde::Serialize;
use std::fmt;
use std::path::Path;

/// Report of two pictures.
#[derive(Debug, Serialize, JsonSchema)]
pub struct PicturesReport {
    #[serde(flatten)]
    comparison: Comparison,
    layers: [String; 2],
    pub(super) differ: bool,
    /// Differences between the pictures beside their samples, in words.
    differences: Vec<String>,
    /// Conversion of the first picture's colors to the primaries of the second.
    #[serde(skip_serializing_if = "Option::is_none")]
    converted: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    flip: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    heatmap_scale: Option<f64>,
}

impl fmt::Display for PicturesReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let c = &self.comparison;
        writeln!(f, "size      {} x {}", c.size[0], c.size[1])?;
        if self.layers.iter().any(|l| !l.is_empty()) {
            writeln!(f, "layers    '{}' and '{}'", printable(&self.layers[0]), printable(&self.layers[1]))?;
        }
        writeln!(f, "psnr_db   {:.4} (peak {})", c.psnr_db, c.peak)?;
        writeln!(f, "ssim      {:.6}", c.ssim)?;
        writeln!(f, "rel_mse   {:.6e}", c.rel_mse)?;
        writeln!(f, "max_abs   {:.6e}", c.max_abs)?;
        writeln!(f, "rms       {:.6e}", c.rms)?;
        writeln!(f, "alpha     {:.6e} (largest difference)", c.alpha_max_abs)?;
        if let Some(flip) = self.flip {
            writeln!(f, "flip      {flip:.6}")?;
        }
        if c.non_finite_pixels > 0 {
            writeln!(
                f,
                "left out  {} pixels with NaN or infinite samples, {} of them different",
                c.non_finite_pixels, c.non_finite_differences
            )?;
        }
        if let Some(scale) = self.heatmap_scale {
            writeln!(f, "heatmap   brightest at {scale:.6e}")?;
        }
        if let Some(converted) = &self.converted {
            writeln!(f, "converted {converted}")?;
        }
        f.write_str(&traits::verdict("pictures", &self.differences))
    }
}

impl CompareSettings {
    /// Compares two pictures.
    ///
    /// # Errors
    /// If a picture cannot be read, the sizes differ, more memory is needed than is allowed, or the heat map cannot be
    /// written.
    pub(super) fn pictures(&self) -> Result<PicturesReport> {
        if let Some(path) = &self.heatmap {
            outputs::file(path, Content::Png)?;
        }
        let limits = self.limits;
        let films = self.check_memory([&self.a, &self.b], limits)?;
        let (reference, layer) = (exr::header(&self.b)?, self.layer.as_deref());
        let a = Matched::read(&self.a, &reference, layer, limits)?;
        let rest = Limits { max_memory: limits.max_memory.saturating_sub(films[0]) };
        let b = Matched::read(&self.b, &reference, layer, rest)?;
        let shown = [&a.film, &b.film].map(|film| self.space().of(film));
        let comparison = metrics::compare(&shown[0], &shown[1])
            .map_err(|e| e.part(format!("{} and {}", self.a.display(), self.b.display())))?;
        let mut heatmap_scale = None;
        if let Some(path) = &self.heatmap {
            let (rgb, scale) = heatmap::difference_rgb8(&shown[0], &shown[1]);
            png::write_rgb8(path, a.film.width, a.film.height, &rgb)?;
            heatmap_scale = Some(scale);
        }
        let flip = self.flip.then(|| space::flip([&a.film, &b.film]));
        let differences = [traits::of_samples(&comparison, self.tolerance), a.differences].concat();
        let (differ, layers) = (!differences.is_empty(), [a.layer, b.layer]);
        Ok(PicturesReport { comparison, layers, differ, differences, converted: a.converted, flip, heatmap_scale })
    }

    /// Returns the bytes of each film.
    ///
    /// # Errors
    /// If a picture cannot be read, or both films and the working memory of their comparison exceed the limits.
    pub(super) fn check_memory(&self, paths: [&Path; 2], limits: Limits) -> Result<[u64; 2]> {
        let (mut films, mut working) = ([0; 2], 0);
        for (film, path) in films.iter_mut().zip(paths) {
            let [width, height] = exr::header(path)?.display_window.size;
            *film = 16 * (width as u64).saturating_mul(height as u64);
            let flip = if self.flip { *film / 16 * flip::PIXEL_BYTES } else { 0 };
            // Display values are copies of both pictures.
            let copies = if self.display { 2 * *film } else { 0 };
            working = working.max(metrics::working_memory(width, height).saturating_add(flip).saturating_add(copies));
        }
        let needed = films[0].saturating_add(films[1]).saturating_add(working);
        if needed <= limits.max_memory {
            return Ok(films);
        }
        let mib = |bytes: u64| bytes.div_ceil(1 << 20);
        Err(Error::unsupported(format!(
            "comparing them needs {} MiB, {} MiB are allowed",
            mib(needed),
            mib(limits.max_memory)
        ))
        .part(format!("{} and {}", paths[0].display(), paths[1].display()))
        .coded(Code::MemoryLimit)
        .hint("raise ⟨max_memory⟩, or compare smaller pictures"))
    }
}
