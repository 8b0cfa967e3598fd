//! Pictures as measurements: optical depths with weights.
//!
//! A grey medium shows `L = c (1 - T) + T b` in each channel, so the transmittance, and with it the
//! optical depth, follows from the picture alone: `T = Σ (L - c)(b - c) / Σ (b - c)²`. Absorption is
//! `c = 0`. Reconstruction is then linear in the unknown densities.

use super::plane::{Plane, SummedAreaTable};
use super::silhouette::{EmptyPixels, silhouette, without_specks};
use crate::error::{Error, Result};
use crate::scene::camera::Camera;
use crate::scene::film::Film;
use rayon::prelude::*;

/// A camera and its picture.
#[derive(Debug, Clone)]
pub struct Photo {
    /// Camera of the picture.
    pub camera: Camera,
    /// Pixels of the picture.
    pub film: Film,
    /// Named in messages: the file.
    pub name: String,
    /// True for a picture of a real medium: its black is measured, and its light need not be exactly that of the
    /// medium's model.
    pub photograph: bool,
}

/// Optical depth of every pixel of a view.
#[derive(Debug, Clone)]
pub struct DepthMap {
    /// Camera of the picture.
    pub camera: Camera,
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Transmittance, row-major; noise may make it negative, and it is NaN where nothing was measured.
    pub transmittance: Vec<f32>,
    /// Optical depth; noise may make it negative.
    pub depth: Vec<f32>,
    /// Weight of a squared residual in optical depth, 0..1; 0 where nothing was measured.
    pub weight: Vec<f32>,
    /// True for pixels that show something, and for those that have measured nothing.
    pub shown: Vec<bool>,
    /// Standard deviation of the noise in a pixel's transmittance.
    pub noise: f64,
    /// Limit of the depths' accuracy.
    pub limit: Limit,
    /// Named in messages.
    pub name: String,
}

/// Limit of the accuracy of a picture's optical depths.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Limit {
    /// The voxels alone: noise has no say, and depths are the logarithms of single pixels.
    Voxels,
    /// The noise of the picture, and the voxels.
    Noise,
    /// The light, which is not exactly that of the model, and the noise.
    Light,
}

/// Optical depths of all pictures, and what is common to them.
#[derive(Debug, Clone)]
pub struct Observation {
    /// One map a view.
    pub maps: Vec<DepthMap>,
    /// Pictures with hardly any noise: what is empty has the background's very color, and what is not
    /// is about as smooth as volumes are.
    pub clean: bool,
}

/// Optical depth beyond which a pixel says only "opaque": the transmittance is below the steps of
/// half-precision files and any renderer's noise.
const OPAQUE: f64 = 14.0;
/// Error in optical depth that a volume of voxels makes of its own: noise below it hardly matters. (Noise
/// of size σ in a picture is noise of size σ / T in the optical depth, so dark pixels deserve weights of
/// T², from T = σ / error on.)
const OWN_ERROR: f64 = 0.08;
/// Error in optical depth of a photograph, relative to the depth and more than this of it: a real medium scatters light,
/// and is not lit evenly.
const RELATIVE_ERROR: f64 = 0.2;
const FAINT: f64 = 0.3;
/// Bounds of that error over the noise.
const TRUST: std::ops::RangeInclusive<f64> = 1.0..=60.0;
/// Noise in the transmittance from which on pictures count as noisy. Detail of a pixel's size responds to
/// the estimate too, up to half of this.
const NOISY: f64 = 8e-3;
/// Optical depth below which a pixel is empty where some have the background's very color: a few roundings of `f32`
/// near 1.
const EMPTY: f64 = 2e-6;
/// Noise in radiance below which channels count as equally exact, relative to the contrast.
const EXACT: f64 = 1e-3;

impl Observation {
    /// Reads transmittances off the pictures; `background` is the radiance behind the medium and
    /// `source` that of the medium itself. Channels count by their contrast and their noise, alpha among them where it
    /// is the more exact.
    ///
    /// # Errors
    /// If no channel tells the medium from the background, or a picture is mostly not finite.
    pub fn new(photos: &[Photo], background: [f32; 3], source: [f32; 3]) -> Result<Self> {
        let contrast: [f64; 3] = std::array::from_fn(|c| f64::from(background[c]) - f64::from(source[c]));
        let power: f64 = contrast.iter().map(|c| c * c).sum();
        let opaque = opaque(photos);
        if power >= 1e-12 {
            let readings =
                photos.par_iter().map(|photo| Reading::of_colors(photo, source.map(f64::from), contrast, opaque));
            return Self::of(photos, &readings.collect::<Vec<_>>());
        }
        if opaque {
            return Err(Error::invalid(
                "medium and background have the same color, and alpha is 1 in all pixels: the pictures do not show the \
                 medium",
            )
            .hint(
                "render on a background of another color than the medium's, stated as `background` in transforms.json, \
                 or with alpha",
            ));
        }
        Self::by_alpha(photos)
    }

    /// Reads transmittances off alpha alone, whatever the colors are.
    ///
    /// # Errors
    /// If alpha is 1 everywhere, or a picture is mostly not finite.
    pub fn by_alpha(photos: &[Photo]) -> Result<Self> {
        if opaque(photos) {
            return Err(Error::invalid(
                "alpha is 1 in all pixels, and only alpha tells how much light this medium lets through",
            )
            .hint("render with alpha = 1 - transmittance (in Cycles with a transparent film)"));
        }
        Self::of(photos, &vec![Reading::ALPHA; photos.len()])
    }

    /// Widens all silhouettes by a thirty-second of the pictures' shorter side, and returns them as they were: cameras
    /// that are a little off would cut one another's.
    pub fn widen_silhouettes(&mut self) -> Vec<Vec<bool>> {
        let widen = |map: &mut DepthMap| {
            let before = map.shown.clone();
            map.widen_silhouette((map.width.min(map.height) / 32).max(1));
            before
        };
        self.maps.par_iter_mut().map(widen).collect()
    }

    /// True if the noise of some picture has a say in what its pixels tell.
    pub fn noisy(&self) -> bool {
        self.maps.iter().any(|map| map.limit != Limit::Voxels)
    }

    /// True if some picture is a photograph.
    pub fn photographs(&self) -> bool {
        self.maps.iter().any(|map| map.limit == Limit::Light)
    }

    /// Standard deviations of the noise in the transmittances of the picture that has least and of that which has most;
    /// none where noise has no say.
    pub fn noise(&self) -> Option<[f64; 2]> {
        let noises = self.maps.iter().map(|map| map.noise);
        let range = noises.fold([f64::INFINITY, 0.0], |[least, most], n| [n.min(least), n.max(most)]);
        self.noisy().then_some(range)
    }

    fn of(photos: &[Photo], readings: &[Reading]) -> Result<Self> {
        let statistics: Vec<PictureStatistics> =
            photos.par_iter().zip(readings).map(|(photo, reading)| PictureStatistics::new(photo, *reading)).collect();
        for (photo, picture) in photos.iter().zip(&statistics) {
            let all = photo.film.rgba.len();
            if picture.bad * 10 > all {
                return Err(Error::invalid(format!("{} of {all} pixels are NaN or infinite", picture.bad))
                    .at(&photo.name)
                    .hint("render the view again, or take it out of the capture"));
            }
        }
        let pixels: usize = photos.iter().map(|photo| photo.film.rgba.len()).sum();
        let rendered = photos.iter().all(|photo| !photo.photograph);
        let exact = rendered && statistics.iter().map(|picture| picture.untouched).sum::<usize>() * 100 >= pixels;
        let vague = statistics.iter().any(|picture| picture.empty.is_none());
        let least_depth = if exact || !vague { EMPTY } else { haze(photos, readings) };
        let noise = median(statistics.iter().filter_map(|picture| picture.noise).collect()).unwrap_or(0.0);
        let clean = exact
            && noise < NOISY
            && statistics.iter().all(|picture| picture.empty.is_none_or(|n| n.deviation <= EMPTY));
        let maps = photos.par_iter().zip(readings).zip(&statistics);
        let maps =
            maps.map(|((photo, reading), picture)| picture.map(photo, *reading, least_depth, noise, clean)).collect();
        Ok(Self { maps, clean })
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

/// Noise and empty pixels of one picture.
#[derive(Debug, Clone)]
struct PictureStatistics {
    /// Pixels that are not finite.
    bad: usize,
    /// Pixels that show the background's very color.
    untouched: usize,
    /// Opacities of the empty pixels; none where there are hardly any.
    empty: Option<EmptyPixels>,
    /// Background of a photograph, where its border shows that.
    dark: Option<Dark>,
    /// Standard deviation of the noise in the transmittance of pixels that show something.
    noise: Option<f64>,
}

/// The background of a photograph.
#[derive(Debug, Clone)]
struct Dark {
    /// Opacity that it seems to have.
    black: EmptyPixels,
    /// Medians of all opacities, and the part of the background in them.
    medians: Vec<f32>,
    of_medians: EmptyPixels,
}

impl Dark {
    fn of(opacity: &Plane<'_>) -> Option<Self> {
        let black = EmptyPixels::of_border(opacity)?;
        let medians = opacity.medians();
        let of_medians = EmptyPixels::of_border(&Plane { values: &medians, ..*opacity })?;
        Some(Self { black, medians, of_medians })
    }
}

impl PictureStatistics {
    fn new(photo: &Photo, reading: Reading) -> Self {
        let opacity = opacity(photo, reading);
        let plane = Plane { width: photo.film.width, values: &opacity };
        Self {
            bad: opacity.iter().filter(|a| !a.is_finite()).count(),
            untouched: opacity.iter().filter(|a| f64::from(a.abs()) < EMPTY).count(),
            empty: EmptyPixels::of(&Plane { values: &plane.bounded(), ..plane }),
            dark: if photo.photograph { Dark::of(&plane) } else { None },
            noise: plane.deviation(|a| f64::from(a.abs()) > EMPTY),
        }
    }

    /// Returns the depths of the picture. Without noise, less than `least_depth` is empty; `usual` is the noise of
    /// pictures that do not tell their own.
    fn map(&self, photo: &Photo, reading: Reading, least_depth: f64, usual: f64, clean: bool) -> DepthMap {
        let empty = self.dark.as_ref().map(|dark| dark.black).or(self.empty);
        let noisy = empty.filter(|empty| empty.deviation > EMPTY);
        let shown_noise = self.noise.unwrap_or(usual);
        let noise = match noisy {
            // Empty pixels have no detail that could be taken for noise.
            Some(pixels) if shown_noise < (2.0 * pixels.deviation).max(NOISY) => pixels.deviation,
            _ => shown_noise,
        };
        // Without empty pixels, less than that may be detail.
        let limit = match photo.photograph {
            true => Limit::Light,
            false if clean || (noisy.is_none() && noise < NOISY) => Limit::Voxels,
            false => Limit::Noise,
        };
        // What a camera calls black is more than none.
        let black = self.dark.as_ref().map_or(0.0, |dark| dark.black.mean);
        let transmittance: Vec<f32> =
            photo.film.rgba.iter().map(|p| (reading.transmittance(p) + black) as f32).collect();
        let (depth, weight) = depths(&Plane { width: photo.film.width, values: &transmittance }, noise, limit);
        let shown = match (&self.dark, noisy) {
            (Some(Dark { medians, of_medians, .. }), _) => {
                let medians = Plane { width: photo.film.width, values: medians };
                without_specks(&medians, &silhouette(&medians, *of_medians), of_medians.mean)
            }
            (None, Some(pixels)) => {
                let opacity = opacity(photo, reading);
                silhouette(&Plane { width: photo.film.width, values: &opacity }, pixels)
            }
            (None, None) => {
                transmittance.iter().zip(&depth).map(|(t, d)| !t.is_finite() || f64::from(*d) > least_depth).collect()
            }
        };
        DepthMap {
            camera: photo.camera,
            width: photo.film.width,
            height: photo.film.height,
            transmittance,
            depth,
            weight,
            shown,
            noise,
            limit,
            name: photo.name.clone(),
        }
    }
}

/// Optical depths of transmittances and their weights.
///
/// The negative logarithm of a transmittance with noise of deviation σ is too large by σ²/2T² on average, and has no
/// value where noise makes T negative. Where σ counts, the depth is linearised about that of the mean transmittance
/// around, T₀: it is `1 - ln T₀ - T/T₀`, whose mean is right.
fn depths(transmittance: &Plane<'_>, noise: f64, limit: Limit) -> (Vec<f32>, Vec<f32>) {
    let trust = (OWN_ERROR / noise.max(1e-12)).clamp(*TRUST.start(), *TRUST.end());
    let least = (-OPAQUE).exp();
    let weight = |t: f64| {
        let t = t.max(least);
        if limit == Limit::Light {
            let error = |t: f64| (RELATIVE_ERROR * (FAINT - t.min(1.0).ln())).powi(2) + (noise / t).powi(2);
            return (error(1.0) / error(t)) as f32;
        }
        let relative = trust * t;
        (relative * relative / (1.0 + relative * relative)) as f32
    };
    let sums = (limit != Limit::Voxels).then(|| SummedAreaTable::new(transmittance));
    let measured = |(i, t): (usize, &f32)| {
        let t = f64::from(*t);
        if !t.is_finite() {
            return (0.0, 0.0);
        }
        let logarithm = -t.max(least).ln() as f32;
        let Some(sums) = &sums else {
            return (logarithm, if t > 0.0 { weight(t) } else { weight(t) * 1e-3 });
        };
        let (mean, _) = sums.mean(i, AROUND);
        let about = mean.max(noise / (2 * AROUND + 1) as f64).max(least);
        let depth = if about > CERTAIN * noise && t > 0.0 { logarithm } else { (1.0 - about.ln() - t / about) as f32 };
        (depth, weight(about))
    };
    transmittance.values.iter().enumerate().map(measured).unzip()
}

/// Pixels to each side whose mean a depth is linearised about, and the transmittance over its noise from which on its
/// logarithm is as good.
const AROUND: usize = 2;
const CERTAIN: f64 = 20.0;

/// Opacity of each pixel, 1 less its transmittance.
fn opacity(photo: &Photo, reading: Reading) -> Vec<f32> {
    photo.film.rgba.iter().map(|p| (1.0 - reading.transmittance(p)) as f32).collect()
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// True if alpha is 1 in all pixels.
fn opaque(photos: &[Photo]) -> bool {
    photos.iter().flat_map(|photo| &photo.film.rgba).all(|p| p[3] == 1.0)
}

/// Pixels that the shorter side of a picture keeps, however coarse the volume: with fewer the rays say nothing.
const FEWEST: usize = 8;

/// The largest of the halvings of `stride` by which a picture of this size keeps at least 8 pixels along its shorter
/// side; 1 for smaller pictures.
pub fn stride_within(stride: usize, width: usize, height: usize) -> usize {
    let shorter = width.min(height);
    let mut stride = stride.max(1);
    while stride > 1 && shorter / stride < FEWEST {
        stride /= 2;
    }
    stride
}

impl DepthMap {
    /// True if a pixel shows something.
    pub fn shows(&self, pixel: usize) -> bool {
        self.shown[pixel] && self.weight[pixel] > 0.0
    }

    /// Counts pixels as showing something that lie within `margin` rows and columns of one that does.
    pub fn widen_silhouette(&mut self, margin: usize) {
        let (w, h) = (self.width, self.height);
        let near = |i: usize, end: usize| i.saturating_sub(margin)..(i + margin + 1).min(end);
        let rows: Vec<bool> = (0..w * h).map(|i| near(i % w, w).any(|x| self.shown[i / w * w + x])).collect();
        self.shown = (0..w * h).map(|i| near(i / w, h).any(|y| rows[y * w + i % w])).collect();
    }

    /// Returns the stride of [`stride_within`] for this map.
    pub fn stride_within(&self, stride: usize) -> usize {
        stride_within(stride, self.width, self.height)
    }

    /// Means over blocks of `stride`² pixels, weights summed: a view for a coarser volume.
    pub fn reduced(&self, stride: usize) -> Self {
        if stride <= 1 {
            return self.clone();
        }
        let (width, height) = (self.width.div_ceil(stride), self.height.div_ceil(stride));
        let (mut transmittance, mut depth, mut shown, mut weight) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for y in 0..height {
            for x in 0..width {
                let rows = y * stride..((y + 1) * stride).min(self.height);
                let columns = x * stride..((x + 1) * stride).min(self.width);
                let (mut sums, mut count, mut any) = ([0.0_f64; 4], 0_u32, false);
                for i in rows.flat_map(|v| columns.clone().map(move |u| v * self.width + u)) {
                    let w = f64::from(self.weight[i]);
                    sums[0] += w * f64::from(self.depth[i]);
                    sums[1] += w;
                    if self.transmittance[i].is_finite() {
                        sums[2] += f64::from(self.transmittance[i]);
                        sums[3] += 1.0;
                    }
                    count += 1;
                    any |= self.shown[i];
                }
                depth.push(if sums[1] > 0.0 { (sums[0] / sums[1]) as f32 } else { 0.0 });
                weight.push((sums[1] / f64::from(count.max(1))) as f32);
                transmittance.push((sums[2] / sums[3]) as f32);
                shown.push(any);
            }
        }
        let s = stride as f64;
        let mut camera = self.camera;
        camera.focal /= s;
        camera.centre /= s;
        (camera.width, camera.height) = (width as u32, height as u32);
        let (noise, limit, name) = (self.noise / s, self.limit, self.name.clone());
        if limit != Limit::Voxels {
            (depth, weight) = depths(&Plane { width, values: &transmittance }, noise, limit);
        }
        Self { camera, width, height, transmittance, depth, weight, shown, noise, limit, name }
    }
}

/// Returns the distance from 1 up to which a transmittance counts as that of an empty pixel, where no pixel is exactly
/// the background: three times the distance that a tenth of all pixels stay within, at least [`EMPTY`].
fn haze(photos: &[Photo], readings: &[Reading]) -> f64 {
    let distances = photos.iter().zip(readings).flat_map(|(photo, reading)| opacity(photo, *reading));
    let mut distances: Vec<f32> = distances.map(f32::abs).filter(|d| d.is_finite()).collect();
    if distances.is_empty() {
        return EMPTY;
    }
    let tenth = distances.len() / 10;
    let (_, value, _) = distances.select_nth_unstable_by(tenth, f32::total_cmp);
    EMPTY.max(3.0 * f64::from(*value))
}
