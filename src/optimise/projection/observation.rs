//! Pictures as measurements: optical depths with weights.
//!
//! A grey medium shows `L = c (1 - T) + T b` in each channel, so the transmittance, and with it the
//! optical depth, follows from the picture alone: `T = Σ (L - c)(b - c) / Σ (b - c)²`. Absorption is
//! `c = 0`. Reconstruction is then linear in the unknown densities.

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
    /// Optical depth, row-major; noise may make it negative.
    pub depth: Vec<f32>,
    /// Weight of a squared residual in optical depth, 0..1; 0 where nothing was measured.
    pub weight: Vec<f32>,
    /// Named in messages.
    pub name: String,
}

/// Optical depths of all pictures, and what is common to them.
#[derive(Debug, Clone)]
pub struct Observation {
    /// One map a view.
    pub maps: Vec<DepthMap>,
    /// A pixel with less optical depth than this has met nothing.
    pub empty: f32,
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
/// Bounds of that error over the noise.
const TRUST: std::ops::RangeInclusive<f64> = 3.0..=60.0;
/// Noise in the transmittance from which on pictures count as noisy. Detail of a pixel's size responds to
/// the estimate too, up to half of this.
const NOISY: f64 = 8e-3;
/// Optical depth below which a pixel is empty where some have the background's very color: a few roundings of `f32` near 1.
const EMPTY: f32 = 2e-6;

impl Observation {
    /// Reads transmittances off the pictures; `background` is the radiance behind the medium and
    /// `source` that of the medium itself.
    ///
    /// # Errors
    /// If no channel tells the medium from the background, or a picture is mostly not finite.
    pub fn new(photos: &[Photo], background: [f32; 3], source: [f32; 3]) -> Result<Self> {
        let contrast: [f64; 3] = std::array::from_fn(|c| f64::from(background[c]) - f64::from(source[c]));
        let power: f64 = contrast.iter().map(|c| c * c).sum();
        if power >= 1e-12 {
            let over = |p: &[f32; 4], c: usize| (f64::from(p[c]) - f64::from(source[c])) * contrast[c];
            return Self::of(photos, |p| (0..3).map(|c| over(p, c)).sum::<f64>() / power);
        }
        if opaque(photos) {
            return Err(Error::invalid("medium and background have the same color, and alpha is 1 in all pixels: the pictures do not show the medium")
                .hint("render on a background of another color than the medium's, stated as `background` in transforms.json, or with alpha"));
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
        Self::of(photos, |p| 1.0 - f64::from(p[3]))
    }

    fn of(photos: &[Photo], transmittance: impl Fn(&[f32; 4]) -> f64 + Sync) -> Result<Self> {
        let transmittances: Vec<Vec<f64>> =
            photos.par_iter().map(|p| p.film.rgba.iter().map(&transmittance).collect()).collect();
        for (photo, values) in photos.iter().zip(&transmittances) {
            let bad = values.iter().filter(|v| !v.is_finite()).count();
            if bad * 10 > values.len() {
                return Err(Error::invalid(format!("{bad} of {} pixels are NaN or infinite", values.len()))
                    .at(&photo.name)
                    .hint("render the view again, or take it out of the capture"));
            }
        }
        let untouched = transmittances.iter().flatten().filter(|t| (**t - 1.0).abs() < f64::from(EMPTY)).count();
        let exact = untouched * 100 >= transmittances.iter().map(Vec::len).sum::<usize>();
        let empty = if exact { EMPTY } else { haze(&transmittances) };
        let noise = noise(photos, &transmittances);
        let clean = exact && noise < NOISY;
        let trust = (OWN_ERROR / noise.max(1e-12)).clamp(*TRUST.start(), *TRUST.end());
        let maps = photos
            .iter()
            .zip(transmittances)
            .map(|(photo, transmittances)| {
                let limit = (-OPAQUE).exp();
                let weight = |t: f64| {
                    let relative = trust * t.max(limit);
                    if t.is_finite() { (relative * relative / (1.0 + relative * relative)) as f32 } else { 0.0 }
                };
                DepthMap {
                    camera: photo.camera,
                    width: photo.film.width,
                    height: photo.film.height,
                    weight: transmittances
                        .iter()
                        .map(|t| if *t > 0.0 { weight(*t) } else { weight(*t) * 1e-3 })
                        .collect(),
                    depth: transmittances
                        .iter()
                        .map(|t| if t.is_finite() { -t.max(limit).ln() as f32 } else { 0.0 })
                        .collect(),
                    name: photo.name.clone(),
                }
            })
            .collect();
        Ok(Self { maps, empty, clean })
    }
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
        let mut out = Self { width, height, depth: Vec::new(), weight: Vec::new(), ..self.clone() };
        for y in 0..height {
            for x in 0..width {
                let (mut sum, mut weight, mut count) = (0.0_f64, 0.0_f64, 0_u32);
                for v in y * stride..((y + 1) * stride).min(self.height) {
                    for u in x * stride..((x + 1) * stride).min(self.width) {
                        let i = v * self.width + u;
                        sum += f64::from(self.weight[i]) * f64::from(self.depth[i]);
                        weight += f64::from(self.weight[i]);
                        count += 1;
                    }
                }
                out.depth.push(if weight > 0.0 { (sum / weight) as f32 } else { 0.0 });
                out.weight.push((weight / f64::from(count.max(1))) as f32);
            }
        }
        let s = stride as f64;
        out.camera.focal /= s;
        out.camera.centre /= s;
        out.camera.width = width as u32;
        out.camera.height = height as u32;
        out
    }
}

/// Returns the distance from 1 up to which a transmittance counts as that of an empty pixel, where no pixel is exactly the
/// background: three times the distance that a tenth of all pixels stay within, at least [`EMPTY`].
fn haze(transmittances: &[Vec<f64>]) -> f32 {
    let mut distances: Vec<f64> =
        transmittances.iter().flatten().filter(|t| t.is_finite()).map(|t| (t - 1.0).abs()).collect();
    if distances.is_empty() {
        return EMPTY;
    }
    let k = distances.len() / 10;
    let (_, value, _) = distances.select_nth_unstable_by(k, f64::total_cmp);
    EMPTY.max(3.0 * *value as f32)
}

/// Standard deviation of the noise in the transmittance of pixels that show something, by a mask that
/// smooth pictures hardly respond to (Immerkær 1996). Noise responds half as much in pictures of half the
/// size, detail several times as much: what both responses share is no noise.
fn noise(photos: &[Photo], transmittances: &[Vec<f64>]) -> f64 {
    let full: Vec<Picture> = photos
        .iter()
        .zip(transmittances)
        .map(|(p, t)| Picture { width: p.film.width, height: p.film.height, t: t.clone() })
        .collect();
    let half: Vec<Picture> = full.iter().map(Picture::halved).collect();
    let (fine, coarse) = (response(&full), response(&half));
    (fine * fine - 0.25 * coarse * coarse).max(0.0).sqrt()
}

/// Transmittances of a picture, row by row.
struct Picture {
    width: usize,
    height: usize,
    t: Vec<f64>,
}

impl Picture {
    /// Means of four pixels; an odd last row or column is left out.
    fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let mean = |i: usize| {
            let corner = 2 * (i / width.max(1)) * self.width + 2 * (i % width.max(1));
            [0, 1, self.width, self.width + 1].iter().map(|k| 0.25 * self.t[corner + k]).sum()
        };
        Self { width, height, t: (0..width * height).map(mean).collect() }
    }
}

/// Standard deviation of white noise that the median response of all pixels to the mask would be of.
fn response(pictures: &[Picture]) -> f64 {
    const MASK: [f64; 9] = [1.0, -2.0, 1.0, -2.0, 4.0, -2.0, 1.0, -2.0, 1.0];
    let of = |p: &Picture| -> Vec<f64> {
        let at = |x: usize, y: usize| p.t[y * p.width + x];
        let response =
            |x: usize, y: usize| (0..9).map(|k| MASK[k] * at(x + k % 3 - 1, y + k / 3 - 1)).sum::<f64>().abs();
        let inner = (1..p.height.saturating_sub(1)).flat_map(|y| (1..p.width.saturating_sub(1)).map(move |x| (x, y)));
        let shown = inner.filter(|(x, y)| (at(*x, *y) - 1.0).abs() > f64::from(EMPTY));
        shown.map(|(x, y)| response(x, y)).filter(|a| a.is_finite()).collect()
    };
    let mut responses: Vec<f64> = pictures.par_iter().flat_map_iter(of).collect();
    if responses.is_empty() {
        return 0.0;
    }
    let middle = responses.len() / 2;
    let (_, median, _) = responses.select_nth_unstable_by(middle, f64::total_cmp);
    // The squares of the mask's weights sum up to 36; half of a normal distribution lies within 0.6745 σ.
    *median / (6.0 * 0.6745)
}
