//! The denoiser: a frame at a time.

use super::feature::{distance, follow, neighbourhood, weight};
use super::model::{Coefficients, Model, predictor};
use crate::error::{Error, Result};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

/// Choice of the feature that models predict colors from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Feature {
    /// The history with the color mixed in, as published (the paper's equation 12). It shares noise with the color that is
    /// regressed on it: at rest, with α = 0.75, the slope tends to 1.75 in place of 0, and the noise of the feature passes.
    Mixed,
    /// The history before the color is mixed in, whose noise is independent of the color's.
    History,
}

/// Constants of the denoiser.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Choice of the feature.
    pub feature: Feature,
    /// Share of the history in the feature, α: 0 to below 1.
    pub history: f32,
    /// Bandwidth h of the distance between color and feature, above which colors count as outliers: smaller is steadier, and
    /// further off. Infinite to take every color as it is.
    pub bandwidth: f32,
    /// Share λ of what was learned that is kept from frame to frame: above 0 to below 1.
    pub forgetting: f32,
    /// Standard deviation in pixels of the weights of the models around a pixel.
    pub spread: f32,
    /// Bandwidth of the distance between the features of pixels whose models predict each other's colors.
    pub likeness: f32,
}

impl Default for Settings {
    /// The paper's constants; it gives neither spread nor likeness.
    fn default() -> Self {
        Self { feature: Feature::Mixed, history: 0.75, bandwidth: 0.75, forgetting: 0.998, spread: 1.5, likeness: 0.75 }
    }
}

impl Settings {
    /// Returns constants for colors whose means are right, such as those of unbiased path tracing: a feature that is independent
    /// of them, and no weights, which would shift the means.
    pub fn unbiased() -> Self {
        Self { feature: Feature::History, history: 0.9, bandwidth: f32::INFINITY, ..Self::default() }
    }

    /// Returns the settings if they can be used.
    ///
    /// # Errors
    /// If a constant is out of its range.
    pub fn checked(self) -> Result<Self> {
        let Self { history, bandwidth, forgetting, spread, likeness, .. } = self;
        let named = [
            ("history", history, (0.0..1.0).contains(&history)),
            ("bandwidth", bandwidth, bandwidth > 0.0),
            ("forgetting factor", forgetting, forgetting > 0.0 && forgetting < 1.0),
            ("spread", spread, spread > 0.0 && spread.is_finite()),
            ("likeness", likeness, likeness > 0.0),
        ];
        match named.iter().find(|(.., fits)| !fits) {
            Some((name, value, _)) => Err(Error::invalid(format!("a {name} of {value} cannot be used"))
                .hint("the history lies in [0, 1), the forgetting factor between 0 and 1, the others above 0")),
            None => Ok(self),
        }
    }
}

/// A frame.
#[derive(Debug, Clone, Copy)]
pub struct Frame<'f> {
    /// Columns and rows.
    pub size: [usize; 2],
    /// Scene-linear colors, row by row from the top. Pixels that are not finite are filled in.
    pub color: &'f [Vec3],
    /// For each pixel the place of what it shows in the frame before, minus its place here, in pixels to the right and
    /// downwards; not finite where it was not seen. `None` for a picture at rest.
    pub motion: Option<&'f [Vec2]>,
}

/// A denoised frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Denoised {
    /// Colors, row by row from the top.
    pub color: Vec<Vec3>,
    /// Number of samples that each color rests on, counted by their weights and ages.
    pub confidence: Vec<f32>,
}

/// State of a pixel between frames.
#[derive(Debug, Clone, Copy, Default)]
struct Pixel {
    /// Colors of this frame and those before, exponentially weighted.
    history: Vec3,
    /// Feature that the color was predicted from.
    feature: Vec3,
    model: Model,
}

/// Denoiser of a sequence.
#[derive(Debug, Clone)]
pub struct Denoiser {
    settings: Settings,
    size: [usize; 2],
    pixels: Vec<Pixel>,
}

/// Pixels to each side whose models predict a pixel's color.
const REACH: usize = 2;

/// Weight below which a color is an outlier of which nothing is learned, and for which nothing is forgotten.
const OUTLIER: f32 = 1e-6;

/// Least share of a pixel's surroundings in the frame before that must lie in the picture to be its history.
const LEAST_COVERED: f32 = 0.25;

impl Denoiser {
    /// Creates a denoiser that has seen nothing.
    ///
    /// # Errors
    /// If a constant is out of its range.
    pub fn new(settings: Settings) -> Result<Self> {
        Ok(Self { settings: settings.checked()?, size: [0; 2], pixels: Vec::new() })
    }

    /// Forgets all, as at a cut.
    pub fn reset(&mut self) {
        self.pixels.clear();
    }

    /// Denoises the next frame. A frame of another size begins anew.
    ///
    /// # Errors
    /// If the frame does not have as many colors, or motions, as pixels.
    pub fn denoise(&mut self, frame: &Frame<'_>) -> Result<Denoised> {
        let [width, height] = frame.size;
        let count = width * height;
        if frame.color.len() != count || frame.motion.is_some_and(|motion| motion.len() != count) {
            return Err(Error::invalid(format!(
                "{} colors and {:?} motions for {width}x{height} pixels",
                frame.color.len(),
                frame.motion.map(<[Vec2]>::len)
            )));
        }
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
        Ok(Denoised { color, confidence })
    }

    /// Returns what a pixel was in the frame before, mixed from the four pixels around its place there; `None` if it was not
    /// seen.
    fn history(&self, frame: &Frame<'_>, [x, y]: [usize; 2]) -> Option<Pixel> {
        let [width, height] = self.size;
        if self.pixels.is_empty() {
            return None;
        }
        let motion = frame.motion.map_or(Vec2::ZERO, |motion| motion[y * width + x]);
        if motion == Vec2::ZERO {
            return Some(self.pixels[y * width + x]);
        }
        let place = Vec2::new(x as f32, y as f32) + motion;
        let whole = place.floor();
        // Neither huge nor missing numbers pass.
        let seen = whole.cmpge(Vec2::splat(-1.0)) & whole.cmple(Vec2::new(width as f32, height as f32));
        if !seen.all() {
            return None;
        }
        let part = place - whole;
        let (mut sum, mut covered) = (Pixel::default(), 0.0);
        for (column, row, share) in [
            (0, 0, (1.0 - part.x) * (1.0 - part.y)),
            (1, 0, part.x * (1.0 - part.y)),
            (0, 1, (1.0 - part.x) * part.y),
            (1, 1, part.x * part.y),
        ] {
            let (column, row) = (whole.x as isize + column, whole.y as isize + row);
            let inside = (0..width as isize).contains(&column) && (0..height as isize).contains(&row);
            if inside && share > 0.0 {
                let pixel = &self.pixels[row as usize * width + column as usize];
                sum.history += share * pixel.history;
                sum.model.add(&pixel.model, share);
                covered += share;
            }
        }
        sum.history /= covered;
        // Where a part is missing, the models know as much less.
        (covered >= LEAST_COVERED).then_some(sum)
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
            let pixel = history.unwrap_or(filled);
            return Pixel { feature: pixel.history, ..pixel };
        };
        let before = history.unwrap_or(Pixel { history: color, ..Pixel::default() });
        let mixed = follow(before.history, color, range, alpha);
        let feature = match self.settings.feature {
            Feature::Mixed => mixed,
            Feature::History => before.history,
        };
        let mut model = before.model;
        let weight = weight(distance(color, mixed), bandwidth);
        if weight >= OUTLIER {
            model.learn(&predictor(feature), color, weight, forgetting);
        }
        Pixel { history: mixed, feature, model }
    }

    /// Returns a pixel's color as the models around it predict it from its feature, weighted by how near they are and how like
    /// their features, and the samples that it rests on.
    fn blended(&self, learned: &[(Pixel, Coefficients)], [x, y]: [usize; 2]) -> (Vec3, f32) {
        let [width, height] = self.size;
        let Settings { spread, likeness, .. } = self.settings;
        let own = learned[y * width + x].0.feature;
        let p = predictor(own);
        let (mut sum, mut weights, mut samples) = (Vec3::ZERO, 0.0, 0.0);
        for row in y.saturating_sub(REACH)..(y + REACH + 1).min(height) {
            for column in x.saturating_sub(REACH)..(x + REACH + 1).min(width) {
                let (pixel, coefficients) = &learned[row * width + column];
                let apart = Vec2::new(column as f32 - x as f32, row as f32 - y as f32).length();
                let share =
                    weight(apart, spread * std::f32::consts::SQRT_2) * weight(distance(own, pixel.feature), likeness);
                sum += share * coefficients.predict(&p);
                weights += share;
                samples += share * pixel.model.samples();
            }
        }
        // The pixel itself weighs 1.
        ((sum / weights).max(Vec3::ZERO), samples)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [40, 30];

    fn noise(seed: u32) -> f32 {
        let h = (seed ^ 0x9E37_79B9).wrapping_mul(0x85EB_CA6B);
        let h = (h ^ (h >> 13)).wrapping_mul(0xC2B2_AE35);
        ((h ^ (h >> 16)) >> 8) as f32 / (1 << 24) as f32
    }

    /// A smooth picture that goes to the right by `shift` pixels.
    fn truth(shift: f32) -> Vec<Vec3> {
        let at = |i: usize| {
            let (x, y) = ((i % SIZE[0]) as f32 - shift, (i / SIZE[0]) as f32);
            let wave = 0.5 + 0.4 * (0.21 * x).sin() * (0.17 * y).cos();
            Vec3::new(wave, 0.6 * wave + 0.1, 0.3)
        };
        (0..SIZE[0] * SIZE[1]).map(at).collect()
    }

    /// Colors that are right on average: most are dark, a few bright.
    fn noisy(truth: &[Vec3], frame: u32) -> Vec<Vec3> {
        let of = |(i, color): (usize, &Vec3)| *color * 2.0 * noise(frame * 7919 + i as u32);
        truth.iter().enumerate().map(of).collect()
    }

    fn error(a: &[Vec3], b: &[Vec3]) -> f32 {
        a.iter().zip(b).map(|(a, b)| (*a - *b).length_squared()).sum::<f32>() / a.len() as f32
    }

    fn last(frames: u32, shift: f32, settings: Settings) -> (Vec<Vec3>, Denoised) {
        let mut denoiser = Denoiser::new(settings).unwrap();
        let motion = vec![Vec2::new(-shift, 0.0); SIZE[0] * SIZE[1]];
        let denoise = |frame: u32| {
            let color = noisy(&truth(shift * frame as f32), frame);
            denoiser.denoise(&Frame { size: SIZE, color: &color, motion: Some(&motion) }).unwrap()
        };
        let out = (0..frames).map(denoise).last().unwrap();
        (noisy(&truth(shift * (frames - 1) as f32), frames - 1), out)
    }

    /// Pictures at rest, and those that move by whole pixels and parts of them, lose most of their noise; as published some
    /// of it stays.
    #[test]
    fn noise_is_taken_away() {
        for (settings, left) in [(Settings::default(), 0.4), (Settings::unbiased(), 0.1)] {
            for shift in [0.0, 1.0, 0.4] {
                let frames = 40;
                let wanted = truth(shift * (frames - 1) as f32);
                let (input, out) = last(frames, shift, settings);
                let [before, after] = [error(&input, &wanted), error(&out.color, &wanted)];
                assert!(after < left * before, "{:?}, {shift}: {before} {after}", settings.feature);
                assert!(out.confidence.iter().all(|n| *n > 0.0 && n.is_finite()));
            }
        }
    }

    /// Missing pixels are filled in, spikes are not learned, and nothing that comes out is missing or negative.
    #[test]
    fn missing_pixels_and_spikes_do_no_harm() {
        let mut denoiser = Denoiser::new(Settings::default()).unwrap();
        let wanted = truth(0.0);
        let mut out = Vec::new();
        for frame in 0..40 {
            let mut color = noisy(&wanted, frame);
            color[frame as usize * 3] = Vec3::NAN;
            color[600 + frame as usize] = Vec3::splat(f32::INFINITY);
            color[50 + frame as usize * 5] = Vec3::splat(1e9);
            let motion: Vec<Vec2> =
                (0..color.len()).map(|i| if i % 97 == 0 { Vec2::splat(f32::NAN) } else { Vec2::ZERO }).collect();
            out = denoiser.denoise(&Frame { size: SIZE, color: &color, motion: Some(&motion) }).unwrap().color;
            assert!(out.iter().all(|c| c.is_finite() && c.min_element() >= 0.0), "{frame}");
        }
        let far = out.iter().zip(&wanted).filter(|(a, b)| (**a - **b).abs().max_element() > 0.5).count();
        assert!(far < 40, "{far} pixels are far off");
        let all_missing = vec![Vec3::NAN; wanted.len()];
        let filled = denoiser.denoise(&Frame { size: SIZE, color: &all_missing, motion: None }).unwrap().color;
        assert!(error(&filled, &out) < 1e-2);
        let mut fresh = Denoiser::new(Settings::default()).unwrap();
        let black = fresh.denoise(&Frame { size: SIZE, color: &all_missing, motion: None }).unwrap();
        assert!(black.color.iter().all(|c| *c == Vec3::ZERO) && black.confidence.iter().all(|n| *n == 0.0));
    }

    /// Frames are the same bit for bit with one thread and with several.
    #[test]
    fn threads_do_not_change_the_result() {
        let of = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| last(5, 0.4, Settings::default()).1)
        };
        assert_eq!(of(1), of(5));
    }

    /// A frame of another size begins anew; frames that do not fit, and constants out of range, are refused.
    #[test]
    fn frames_of_another_size_begin_anew() {
        let mut denoiser = Denoiser::new(Settings::default()).unwrap();
        denoiser.denoise(&Frame { size: SIZE, color: &truth(0.0), motion: None }).unwrap();
        let small = [Vec3::splat(0.25); 6];
        let out = denoiser.denoise(&Frame { size: [3, 2], color: &small, motion: None }).unwrap();
        assert!(out.color.iter().all(|c| c.abs_diff_eq(small[0], 1e-5)));
        assert!(denoiser.denoise(&Frame { size: [3, 3], color: &small, motion: None }).is_err());
        assert!(denoiser.denoise(&Frame { size: [3, 2], color: &small, motion: Some(&[Vec2::ZERO]) }).is_err());
        for settings in [
            Settings { history: 1.0, ..Settings::default() },
            Settings { forgetting: f32::NAN, ..Settings::default() },
            Settings { bandwidth: 0.0, ..Settings::default() },
            Settings { spread: -1.0, ..Settings::default() },
        ] {
            assert!(Denoiser::new(settings).is_err(), "{settings:?}");
        }
    }
}
