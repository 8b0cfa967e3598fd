//! Spatiotemporal variance-guided filtering (SVGF; Schied et al. 2017) without G-buffers, which volumes do not have:
//! colors and the moments of their luminance are averaged over frames along the motion, and a wavelet filter of growing
//! width blurs what differs less than its standard deviation. It serves for comparison.

use super::ema::reprojected;
use super::frame::{Denoised, Frame};
use crate::error::Result;
use glam::Vec3;
use rayon::prelude::*;

/// Least share of a new color in the average.
const NEW: f32 = 0.2;
/// Standard deviations of luminance that the filter blurs.
const DEVIATIONS: f32 = 4.0;
/// Levels of the filter.
const LEVELS: u32 = 5;
/// Frames from which on the variance follows from the moments over time.
const FRAMES: f32 = 4.0;
/// Weights of the filter by distance.
const KERNEL: [f32; 3] = [3.0 / 8.0, 1.0 / 4.0, 1.0 / 16.0];

/// Color, mean luminance, mean squared luminance, and the number of frames.
type Pixel = [f32; 6];

/// State between frames.
#[derive(Debug, Default)]
pub(crate) struct Svgf {
    size: [usize; 2],
    history: Vec<Pixel>,
}

fn luminance(color: Vec3) -> f32 {
    color.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

/// Returns the pixels within `radius` steps of one, with the steps.
fn within([width, height]: [usize; 2], at: usize, radius: i32, step: i32) -> impl Iterator<Item = (usize, [usize; 2])> {
    let (x, y) = ((at % width) as i32, (at / width) as i32);
    (-radius..=radius).flat_map(move |j| (-radius..=radius).map(move |i| (i, j))).filter_map(move |(i, j)| {
        let (column, row) = (x + i * step, y + j * step);
        let inside = (0..width as i32).contains(&column) && (0..height as i32).contains(&row);
        let steps = [i.unsigned_abs() as usize, j.unsigned_abs() as usize];
        inside.then(|| (row as usize * width + column as usize, steps))
    })
}

impl Svgf {
    /// Forgets all, as at a cut.
    pub(crate) fn reset(&mut self) {
        self.history.clear();
    }

    /// Denoises the next frame.
    ///
    /// # Errors
    /// If the frame does not have as many colors, or motions, as pixels.
    pub(crate) fn denoise(&mut self, frame: &Frame<'_>) -> Result<Denoised> {
        frame.check()?;
        if self.size != frame.size {
            self.history.clear();
            self.size = frame.size;
        }
        let all = |of: &(dyn Fn(usize) -> Pixel + Sync)| -> Vec<Pixel> {
            (0..frame.color.len()).into_par_iter().with_min_len(256).map(of).collect()
        };
        let followed = all(&|at| self.followed(frame, at));
        let mut filtered: Vec<[f32; 4]> = (0..followed.len())
            .into_par_iter()
            .with_min_len(256)
            .map(|at| {
                let [r, g, b, ..] = followed[at];
                [r, g, b, variance(frame.size, &followed, at)]
            })
            .collect();
        for level in 0..LEVELS {
            let pixels = (0..filtered.len()).into_par_iter().with_min_len(256);
            filtered = pixels.map(|at| blurred(frame.size, &filtered, at, 1 << level)).collect();
            if level == 0 {
                let first = followed.iter().zip(&filtered);
                self.history = first
                    .map(|([.., mean, square, count], [r, g, b, _])| [*r, *g, *b, *mean, *square, *count])
                    .collect();
            }
        }
        let color = filtered.iter().map(|[r, g, b, _]| Vec3::new(*r, *g, *b)).collect();
        Ok(Denoised { color, confidence: followed.iter().map(|pixel| pixel[5]).collect(), ..Denoised::default() })
    }

    /// Returns the averages of a pixel over the frames.
    fn followed(&self, frame: &Frame<'_>, at: usize) -> Pixel {
        let (color, history) = (frame.color[at], reprojected(frame, &self.history, at));
        if !color.is_finite() {
            return history.unwrap_or_default();
        }
        let light = luminance(color);
        let own = [color.x, color.y, color.z, light, light * light, 0.0];
        let before = history.unwrap_or(own);
        let count = before[5] + 1.0;
        let share = NEW.max(1.0 / count);
        let mut mixed: Pixel = std::array::from_fn(|i| (1.0 - share) * before[i] + share * own[i]);
        mixed[5] = count;
        mixed
    }
}

/// Returns the variance of a pixel's luminance: over frames, or over pixels around where there are few frames.
fn variance(size: [usize; 2], pixels: &[Pixel], at: usize) -> f32 {
    let [.., mean, square, count] = pixels[at];
    if count >= FRAMES {
        return (square - mean * mean).max(0.0);
    }
    let add = |[a, b, n]: [f32; 3], (place, _): (usize, _)| [a + pixels[place][3], b + pixels[place][4], n + 1.0];
    let [mean, square, n] = within(size, at, 3, 1).fold([0.0; 3], add);
    let (mean, square) = (mean / n, square / n);
    (square - mean * mean).max(0.0) * (FRAMES / count.max(1.0))
}

/// Returns a pixel's color and variance after a level of the filter.
fn blurred(size: [usize; 2], pixels: &[[f32; 4]], at: usize, step: i32) -> [f32; 4] {
    let light = |place: usize| luminance(Vec3::from_slice(&pixels[place]));
    // The variance is noisy itself.
    let near = within(size, at, 1, 1).fold([0.0; 2], |[sum, weights], (place, [i, j])| {
        let weight = [0.5, 0.25][i] * [0.5, 0.25][j];
        [sum + weight * pixels[place][3], weights + weight]
    });
    let scale = 1.0 / (DEVIATIONS * (near[0] / near[1]).sqrt() + 1e-8);
    let own = light(at);
    let (mut sum, mut spread, mut weights) = (Vec3::ZERO, 0.0, 0.0);
    for (place, [i, j]) in within(size, at, 2, step) {
        let weight = KERNEL[i] * KERNEL[j] * (-(light(place) - own).abs() * scale).exp();
        sum += weight * Vec3::from_slice(&pixels[place]);
        spread += weight * weight * pixels[place][3];
        weights += weight;
    }
    (sum / weights).extend(spread / (weights * weights)).to_array()
}
