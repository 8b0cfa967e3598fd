//! The optical depths of one view.

use super::plane::{Plane, SummedAreaTable};
use crate::scene::camera::Camera;
use std::borrow::Cow;

/// Transmittances of a view, from which the optical depth of every pixel follows.
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
    /// True for pixels that show something, and for those that have measured nothing.
    pub shown: Vec<bool>,
    /// Standard deviation of the noise in a pixel's transmittance.
    pub noise: f64,
    /// Limit of the depths' accuracy.
    pub limit: Limit,
    /// Named in messages.
    pub name: String,
    /// Depths that are means of those of several pixels; none where they follow from the transmittances.
    pub means: Option<WeightedDepths>,
}

/// Optical depths of pixels and their weights, row-major.
#[derive(Debug, Clone)]
pub struct WeightedDepths {
    /// Optical depth; noise may make it negative.
    pub depth: Vec<f32>,
    /// Weight of a squared residual in optical depth, 0..1; 0 where nothing was measured.
    pub weight: Vec<f32>,
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

/// Optical depth beyond which a pixel says only "opaque": the transmittance is below the steps of
/// half-precision files and any renderer's noise.
const OPAQUE: f64 = 14.0;
/// Error in optical depth that a volume of voxels makes of its own: noise below it hardly matters. (Noise
/// of size σ in a picture is noise of size σ / T in the optical depth, so dark pixels deserve weights of
/// T², from T = σ / error on.)
const OWN_ERROR: f64 = 0.08;
/// Error in optical depth of a photograph, relative to the depth and more than this of it: a real medium scatters
/// light, and is not lit evenly.
const RELATIVE_ERROR: f64 = 0.2;
const FAINT: f64 = 0.3;
/// Bounds of that error over the noise.
const TRUST: std::ops::RangeInclusive<f64> = 1.0..=60.0;
/// Pixels that the shorter side of a picture keeps, however coarse the volume: with fewer the rays say nothing.
const FEWEST: usize = 8;

/// The largest of the halvings of `stride` by which a picture of this size keeps at least 8 pixels along its shorter
/// side; 1 for smaller pictures.
pub(crate) fn stride_within(stride: usize, width: usize, height: usize) -> usize {
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
        self.shown[pixel] && self.transmittance[pixel].is_finite()
    }

    /// Returns the optical depths and their weights.
    pub fn depths(&self) -> Cow<'_, WeightedDepths> {
        match &self.means {
            Some(means) => Cow::Borrowed(means),
            None => {
                Cow::Owned(depths(&Plane { width: self.width, values: &self.transmittance }, self.noise, self.limit))
            }
        }
    }

    /// Counts pixels as showing something that lie within `margin` rows and columns of one that does.
    pub(crate) fn widen_silhouette(&mut self, margin: usize) {
        let (w, h) = (self.width, self.height);
        let near = |i: usize, end: usize| i.saturating_sub(margin)..(i + margin + 1).min(end);
        let rows: Vec<bool> = (0..w * h).map(|i| near(i % w, w).any(|x| self.shown[i / w * w + x])).collect();
        self.shown = (0..w * h).map(|i| near(i / w, h).any(|y| rows[y * w + i % w])).collect();
    }

    /// Returns the stride of [`stride_within`] for this map.
    pub(crate) fn stride_within(&self, stride: usize) -> usize {
        stride_within(stride, self.width, self.height)
    }

    /// Means over blocks of `stride`² pixels, weights summed: a view for a coarser volume.
    pub fn reduced(&self, stride: usize) -> Self {
        if stride <= 1 {
            return self.clone();
        }
        let own = self.depths();
        let (width, height) = (self.width.div_ceil(stride), self.height.div_ceil(stride));
        let (mut transmittance, mut depth, mut shown, mut weight) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for y in 0..height {
            for x in 0..width {
                let rows = y * stride..((y + 1) * stride).min(self.height);
                let columns = x * stride..((x + 1) * stride).min(self.width);
                let (mut sums, mut count, mut any) = ([0.0_f64; 4], 0_u32, false);
                for i in rows.flat_map(|v| columns.clone().map(move |u| v * self.width + u)) {
                    let w = f64::from(own.weight[i]);
                    sums[0] += w * f64::from(own.depth[i]);
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
        let means = (limit == Limit::Voxels).then_some(WeightedDepths { depth, weight });
        Self { camera, width, height, transmittance, shown, noise, limit, name, means }
    }
}

/// Optical depths of transmittances and their weights.
///
/// The negative logarithm of a transmittance with noise of deviation σ is too large by σ²/2T² on average, and has no
/// value where noise makes T negative. Where σ counts, the depth is linearised about that of the mean transmittance
/// around, T₀: it is `1 - ln T₀ - T/T₀`, whose mean is right.
fn depths(transmittance: &Plane<'_>, noise: f64, limit: Limit) -> WeightedDepths {
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
    let (depth, weight) = transmittance.values.iter().enumerate().map(measured).unzip();
    WeightedDepths { depth, weight }
}

/// Pixels to each side whose mean a depth is linearised about, and the transmittance over its noise from which on its
/// logarithm is as good.
const AROUND: usize = 2;
const CERTAIN: f64 = 20.0;
