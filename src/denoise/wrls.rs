//! The denoiser: a frame at a time.

use super::feature::{distance, follow, neighbourhood, weight};
use super::frame::{Denoised, Frame};
use super::model::{Coefficients, Model, predictor};
use super::reprojection::around;
use super::settings::Settings;
use crate::error::Result;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// State of a pixel between frames.
#[derive(Debug, Clone, Copy, Default)]
struct Pixel {
    /// Colors of this frame and those before, exponentially weighted: the feature.
    history: Vec3,
    model: Model,
}

/// Denoiser of a sequence by weighted recursive least squares.
#[derive(Debug, Clone)]
pub(crate) struct Wrls {
    settings: Settings,
    size: [usize; 2],
    pixels: Vec<Pixel>,
}

/// Pixels to each side whose models predict a pixel's color.
const REACH: usize = 2;

/// Weight below which a color is an outlier of which nothing is learned, and for which nothing is forgotten.
const OUTLIER: f32 = 1e-6;

impl Wrls {
    /// Creates a denoiser that has seen nothing.
    ///
    /// # Errors
    /// If a constant is out of its range.
    pub(crate) fn new(settings: Settings) -> Result<Self> {
        Ok(Self { settings: settings.checked()?, size: [0; 2], pixels: Vec::new() })
    }

    /// Forgets all, as at a cut.
    pub(crate) fn reset(&mut self) {
        self.pixels.clear();
    }

    /// Denoises the next frame. A frame of another size begins anew.
    ///
    /// # Errors
    /// If the frame does not have as many colors, or motions, as pixels.
    pub(crate) fn denoise(&mut self, frame: &Frame<'_>) -> Result<Denoised> {
        let [width, height] = frame.size;
        let count = width * height;
        frame.check()?;
        if self.size != frame.size {
            self.reset();
            self.size = frame.size;
        }
        let learned: Vec<(Pixel, Coefficients)> = (0..count)
            .into_par_iter()
            .with_min_len(1024)
            .map(|at| {
                let pixel = self.learned(frame, [at % width, at / width]);
                (pixel, pixel.model.solve())
            })
            .collect();
        let blended = (0..count).into_par_iter().with_min_len(1024);
        let blended = blended.map(|at| self.blended(&learned, [at % width, at / width]));
        let (color, confidence) = blended.unzip();
        self.pixels = learned.into_iter().map(|(pixel, _)| pixel).collect();
        Ok(Denoised { color, confidence, ..Denoised::default() })
    }

    /// Returns what a pixel was in the frame before, mixed from the four pixels around its place there; `None` if it
    /// was not seen.
    fn history(&self, frame: &Frame<'_>, [x, y]: [usize; 2]) -> Option<Pixel> {
        let [width, _] = self.size;
        if self.pixels.is_empty() {
            return None;
        }
        let motion = frame.motion.map_or(Vec2::ZERO, |motion| motion[y * width + x]);
        let found = around(self.size, Vec2::new(x as f32, y as f32) + motion)?;
        if found.share[0] == 1.0 {
            return Some(self.pixels[found.at[0]]);
        }
        let mut sum = Pixel::default();
        for (at, share) in found.at.into_iter().zip(found.share).filter(|(_, share)| *share > 0.0) {
            sum.history += share * self.pixels[at].history;
            sum.model.add(&self.pixels[at].model, share);
        }
        sum.history /= found.covered;
        // Where a part is missing, the models know as much less.
        Some(sum)
    }

    /// Returns a pixel after its color was learned.
    fn learned(&self, frame: &Frame<'_>, [x, y]: [usize; 2]) -> Pixel {
        let Settings { history: alpha, bandwidth, forgetting, .. } = self.settings;
        let history = self.history(frame, [x, y]);
        let color = frame.color[y * frame.size[0] + x];
        let range = neighbourhood(frame.color, frame.size, [x, y]);
        let Some(range) = range.filter(|_| color.is_finite()) else {
            // Nothing is learned of a missing color.
            let [low, high] = range.unwrap_or_default();
            let filled = Pixel { history: 0.5 * (low + high), ..Pixel::default() };
            return history.unwrap_or(filled);
        };
        let before = history.unwrap_or(Pixel { history: color, ..Pixel::default() });
        let mixed = follow(before.history, color, range, alpha);
        let mut model = before.model;
        let weight = weight(distance(color, mixed), bandwidth);
        if weight >= OUTLIER {
            model.learn(&predictor(mixed), color, weight, forgetting);
        }
        Pixel { history: mixed, model }
    }

    /// Returns a pixel's color as the models around it predict it from its feature, weighted by how near they are and
    /// how like their features, and the samples that it rests on.
    fn blended(&self, learned: &[(Pixel, Coefficients)], [x, y]: [usize; 2]) -> (Vec3, f32) {
        let [width, height] = self.size;
        let Settings { spread, likeness, .. } = self.settings;
        let own = learned[y * width + x].0.history;
        let p = predictor(own);
        let (mut sum, mut weights, mut samples) = (Vec3::ZERO, 0.0, 0.0);
        for row in y.saturating_sub(REACH)..(y + REACH + 1).min(height) {
            for column in x.saturating_sub(REACH)..(x + REACH + 1).min(width) {
                let (pixel, coefficients) = &learned[row * width + column];
                let apart = Vec2::new(column as f32 - x as f32, row as f32 - y as f32).length();
                let share =
                    weight(apart, spread * std::f32::consts::SQRT_2) * weight(distance(own, pixel.history), likeness);
                sum += share * coefficients.predict(&p);
                weights += share;
                samples += share * pixel.model.samples();
            }
        }
        // The pixel itself weighs 1.
        ((sum / weights).max(Vec3::ZERO), samples)
    }
}
