//! The transmittances of one picture, and what it tells about its own noise.

use super::depth_map::{DepthMap, Limit};
use super::photo::Photo;
use super::plane::Plane;
use super::silhouette::{EmptyPixels, silhouette, widened, without_specks};
use crate::scene::camera::Camera;

/// Channels of a picture that tell the transmittance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Channels {
    /// The colors, and alpha where it is the more exact.
    Colors {
        /// Radiance behind the medium.
        background: [f32; 3],
        /// Radiance of the medium itself.
        source: [f32; 3],
    },
    /// Alpha alone, whatever the colors are.
    Alpha,
}

impl Channels {
    /// Radiance of the medium and how much more the background has, where these differ.
    fn contrast(self) -> Option<([f64; 3], [f64; 3])> {
        let Self::Colors { background, source } = self else { return None };
        let contrast: [f64; 3] = std::array::from_fn(|c| f64::from(background[c]) - f64::from(source[c]));
        let power: f64 = contrast.iter().map(|c| c * c).sum();
        (power >= 1e-12).then(|| (source.map(f64::from), contrast))
    }

    /// True if only alpha tells the transmittance.
    pub(super) fn need_alpha(self) -> bool {
        self.contrast().is_none()
    }
}

/// Optical depth below which a pixel is empty where some have the background's very color: a few roundings of `f32`
/// near 1.
pub(super) const EMPTY: f64 = 2e-6;
/// Noise in the transmittance from which on pictures count as noisy. Detail of a pixel's size responds to
/// the estimate too, up to half of this.
pub(super) const NOISY: f64 = 8e-3;
/// Noise in radiance below which channels count as equally exact, relative to the contrast.
const EXACT: f64 = 1e-3;

/// Transmittances of one picture with its own noise, before anything is known of other pictures.
#[derive(Debug, Clone)]
pub struct Transmittances {
    camera: Camera,
    width: usize,
    height: usize,
    /// Named in messages.
    pub(super) name: String,
    /// True for a picture of a real medium.
    pub(super) photograph: bool,
    /// One a pixel, row-major; those of a photograph without its black.
    pub(super) values: Vec<f32>,
    /// True if alpha is 1 in all pixels.
    pub(super) opaque: bool,
    /// Pixels that are not finite.
    pub(super) bad: usize,
    /// Pixels that show the background's very color.
    pub(super) untouched: usize,
    /// Opacities of the empty pixels; none where there are hardly any.
    pub(super) empty: Option<EmptyPixels>,
    /// Standard deviation of the noise in the transmittance of pixels that show something.
    pub(super) noise: Option<f64>,
    /// Opacities of the empty pixels, of a photograph those that its border shows, if they have noise.
    noisy: Option<EmptyPixels>,
    /// Pixels that show something, where noise or a photograph's border tells them.
    shown: Option<Vec<bool>>,
}

impl Transmittances {
    /// Reads the transmittances off a picture.
    pub fn new(photo: &Photo, channels: Channels) -> Self {
        let Photo { camera, film, name, photograph } = photo;
        let opaque = film.rgba.iter().all(|p| p[3] == 1.0);
        let reading = match channels.contrast() {
            Some((source, contrast)) => Reading::of_colors(photo, source, contrast, opaque),
            None => Reading::ALPHA,
        };
        let opacity: Vec<f32> = film.rgba.iter().map(|p| (1.0 - reading.transmittance(p)) as f32).collect();
        let plane = Plane { width: film.width, values: &opacity };
        let empty = EmptyPixels::from_opacity(&Plane { values: &plane.bounded(), ..plane });
        let dark = if *photograph { Dark::of(&plane) } else { None };
        let noisy = dark.as_ref().map(|dark| dark.black).or(empty).filter(|empty| empty.deviation > EMPTY);
        let shown = match (&dark, noisy) {
            (Some(dark), _) => Some(dark.silhouette(&plane)),
            (None, Some(pixels)) => Some(silhouette(&plane, pixels)),
            (None, None) => None,
        };
        // What a camera calls black is more than none.
        let black = dark.as_ref().map_or(0.0, |dark| dark.black.mean);
        Self {
            camera: *camera,
            width: film.width,
            height: film.height,
            name: name.clone(),
            photograph: *photograph,
            values: film.rgba.iter().map(|p| (reading.transmittance(p) + black) as f32).collect(),
            opaque,
            bad: opacity.iter().filter(|a| !a.is_finite()).count(),
            untouched: opacity.iter().filter(|a| f64::from(a.abs()) < EMPTY).count(),
            empty,
            noise: plane.deviation(|a| f64::from(a.abs()) > EMPTY),
            noisy,
            shown,
        }
    }

    /// Returns the depths of the picture. Without noise, less than `least_depth` is empty; `usual` is the noise of
    /// pictures that do not tell their own.
    pub(super) fn depth_map(self, least_depth: f64, usual: f64, clean: bool) -> DepthMap {
        let shown_noise = self.noise.unwrap_or(usual);
        let noise = match self.noisy {
            // Empty pixels have no detail that could be taken for noise.
            Some(pixels) if shown_noise < (2.0 * pixels.deviation).max(NOISY) => pixels.deviation,
            _ => shown_noise,
        };
        // Without empty pixels, less than that may be detail.
        let limit = match self.photograph {
            true => Limit::Light,
            false if clean || (self.noisy.is_none() && noise < NOISY) => Limit::Voxels,
            false => Limit::Noise,
        };
        let Self { camera, width, height, name, values: transmittance, .. } = self;
        let mut map =
            DepthMap { camera, width, height, transmittance, shown: Vec::new(), noise, limit, name, means: None };
        map.shown = self.shown.unwrap_or_else(|| {
            let depths = map.depths();
            let pixels = map.transmittance.iter().zip(&depths.depth);
            pixels.map(|(t, d)| !t.is_finite() || f64::from(*d) > least_depth).collect()
        });
        map
    }
}

/// The transmittance as a linear function of a pixel.
#[derive(Debug, Clone, Copy)]
struct Reading {
    offset: f64,
    gains: [f64; 4],
}

impl Reading {
    const ALPHA: Self = Self { offset: 1.0, gains: [0.0, 0.0, 0.0, -1.0] };

    /// Averages what the color channels tell, with weights by contrast and noise; with alpha, if that is more exact
    /// and agrees.
    fn of_colors(photo: &Photo, source: [f64; 3], contrast: [f64; 3], opaque: bool) -> Self {
        let floor = EXACT * contrast.iter().fold(0.0, |most, c| c.abs().max(most));
        let background = |c: usize| (source[c] + contrast[c]) as f32;
        let noises: [f64; 3] = std::array::from_fn(|c| {
            let values: Vec<f32> = photo.film.rgba.iter().map(|p| p[c]).collect();
            let shows = |v: f32| (v - background(c)).abs() > EMPTY as f32;
            let plane = Plane { width: photo.film.width, values: &values };
            plane.deviation(shows).unwrap_or(0.0).max(floor)
        });
        let weights: [f64; 3] = std::array::from_fn(|c| (contrast[c] * floor / noises[c]).powi(2));
        let power: f64 = weights.iter().sum();
        let share = |c: usize| if contrast[c] == 0.0 { 0.0 } else { weights[c] / (contrast[c] * power) };
        let gains = [share(0), share(1), share(2), 0.0];
        let colors = Self { offset: -(0..3).map(|c| source[c] * gains[c]).sum::<f64>(), gains };
        if opaque { colors } else { colors.with_alpha(photo, floor / power.sqrt()) }
    }

    /// This one, or its mean with alpha where the noise of alpha is less than `noise`, that of this one.
    fn with_alpha(self, photo: &Photo, noise: f64) -> Self {
        if noise <= 2.0 * EXACT {
            return self;
        }
        let values: Vec<f32> = photo.film.rgba.iter().map(|p| p[3]).collect();
        let plane = Plane { width: photo.film.width, values: &values };
        let alpha = plane.deviation(|v| v.abs() > EMPTY as f32).unwrap_or(0.0).max(EXACT);
        if alpha >= noise || !self.agrees(Self::ALPHA, photo, noise.hypot(alpha)) {
            return self;
        }
        let share = noise * noise / (noise * noise + alpha * alpha);
        let mean = |a: f64, b: f64| (1.0 - share) * a + share * b;
        Self {
            offset: mean(self.offset, Self::ALPHA.offset),
            gains: std::array::from_fn(|c| mean(self.gains[c], Self::ALPHA.gains[c])),
        }
    }

    /// True if means over squares of pixels are the same by both, but for that noise of a pixel.
    fn agrees(self, other: Self, photo: &Photo, noise: f64) -> bool {
        let (width, height) = (photo.film.width, photo.film.height);
        let (mut sum, mut count) = (0.0, 0.0);
        for y in (0..height / SQUARE).map(|y| y * SQUARE) {
            for x in (0..width / SQUARE).map(|x| x * SQUARE) {
                let pixels = (0..SQUARE * SQUARE).map(|i| photo.film.rgba[(y + i / SQUARE) * width + x + i % SQUARE]);
                let difference = pixels.map(|p| self.transmittance(&p) - other.transmittance(&p)).sum::<f64>();
                if difference.is_finite() {
                    sum += (difference / (SQUARE * SQUARE) as f64).powi(2);
                    count += 1.0;
                }
            }
        }
        count > 0.0 && sum / count <= 2.0 * (noise / SQUARE as f64).powi(2) + AGREED * AGREED
    }

    fn transmittance(self, pixel: &[f32; 4]) -> f64 {
        self.offset + (0..4).filter(|c| self.gains[*c] != 0.0).map(|c| self.gains[c] * f64::from(pixel[c])).sum::<f64>()
    }
}

/// Edge of the squares over which alpha and colors are compared, and the difference of transmittances that they may
/// have.
const SQUARE: usize = 8;
const AGREED: f64 = 0.01;

/// The background of a photograph.
#[derive(Debug, Clone)]
struct Dark {
    /// Opacity that it seems to have.
    black: EmptyPixels,
    /// Medians of all opacities, and the part of the background in them.
    medians: Vec<f32>,
    of_medians: EmptyPixels,
}

/// Opacity, and standard deviations of the background, that a pixel must have to be shown by itself: medians do not
/// show what is thinner than three.
const STRONG: f64 = 0.02;
const STRONG_DEVIATIONS: f64 = 20.0;

impl Dark {
    /// Returns true for each pixel of a photograph that shows something: by its medians, which noise and coding hardly
    /// change, and where something is thin and strong, by its pixels; and for each that is not finite.
    fn silhouette(&self, opacity: &Plane<'_>) -> Vec<bool> {
        let Self { black, medians, of_medians } = self;
        let medians = Plane { values: medians, ..*opacity };
        let smooth = without_specks(&medians, &silhouette(&medians, *of_medians), of_medians.mean);
        let bounded = opacity.bounded();
        let pixels = Plane { values: &bounded, ..*opacity };
        let least = (black.mean + STRONG.max(STRONG_DEVIATIONS * black.deviation)) as f32;
        let strong: Vec<bool> = bounded.iter().map(|v| *v > least).collect();
        let thin = widened(&pixels, &without_specks(&pixels, &strong, black.mean));
        let shown = smooth.into_iter().zip(thin).zip(opacity.values);
        shown.map(|((smooth, thin), value)| smooth || thin || !value.is_finite()).collect()
    }

    fn of(opacity: &Plane<'_>) -> Option<Self> {
        let black = EmptyPixels::from_border(opacity)?;
        let medians = opacity.medians();
        let of_medians = EmptyPixels::from_border(&Plane { values: &medians, ..*opacity })?;
        Some(Self { black, medians, of_medians })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::blur::Blur;
    use crate::scene::camera::Projection;
    use crate::scene::film::Film;
    use glam::{DMat4, DVec2};

    /// Medians of 5 × 5 pixels do not show a line of two pixels; a speck as bright as noise is none of the medium.
    #[test]
    fn photographs_show_what_is_thin() {
        const SIDE: usize = 64;
        let level = |i: usize| [0.0, 0.0, 0.0003, 0.0, 0.0006][i * 7919 % 5];
        let value = |i: usize| {
            let (x, y) = (i % SIDE, i / SIDE);
            let disk = (1.0 - ((x as f32 - 24.0).powi(2) + (y as f32 - 32.0).powi(2)) / 200.0).max(0.0);
            let line = if (48..50).contains(&x) && (12..52).contains(&y) { 0.1 } else { 0.0 };
            let speck = if (56..58).contains(&x) && (4..6).contains(&y) { 0.002 } else { 0.0 };
            let hole = if i == 60 * SIDE + 60 { f32::NAN } else { 0.0 };
            level(i) + disk + line + speck + hole
        };
        let rgba = (0..SIDE * SIDE).map(|i| [value(i), value(i), value(i), 1.0]).collect();
        let camera = Camera {
            camera_to_world: DMat4::IDENTITY,
            projection: Projection::Perspective,
            focal: DVec2::splat(SIDE as f64),
            centre: DVec2::splat(0.5 * SIDE as f64),
            width: SIDE as u32,
            height: SIDE as u32,
            near: 0.0,
            blur: Blur::default(),
        };
        let photo = Photo { camera, film: Film::of(SIDE, SIDE, rgba), name: "view".into(), photograph: true };
        let channels = Channels::Colors { background: [0.0; 3], source: [1.0; 3] };
        let shown = Transmittances::new(&photo, channels).shown.unwrap_or_default();
        assert!((12..52).all(|y| shown[y * SIDE + 48] && shown[y * SIDE + 49]));
        assert!(shown[60 * SIDE + 60], "a pixel that says nothing is not empty");
        assert!(shown[32 * SIDE + 24] && !shown[4 * SIDE + 56] && !shown[32 * SIDE + 60]);
    }
}
