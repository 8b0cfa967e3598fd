//! How well a volume predicts views that it was not fitted to.
//!
//! The error of a projection at a spatial frequency k is that of the volume in the same plane of frequencies (Fourier
//! slice theorem), and there are more frequencies of the volume to each of the picture the higher it is: the mean square
//! error of the volume is that of the picture with weights that grow as |k|. Without them the choice falls on volumes
//! that are too rough, or too smooth for clean pictures. The noise of the pictures themselves is known, and taken off.

use crate::metrics::error::unit_psnr_db;
use crate::optimise::projection::projector::{Projector, View};

/// Share of the noise that is taken off, so that what is left is no less than zero.
const NOISE_SHARE: f64 = 0.95;

/// Errors of the transmittances in views, over all their pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Prediction {
    /// Mean square error, and the part of it that is the noise of the pictures.
    pub square: f64,
    pub noise: f64,
    /// PSNR in dB, peak 1.
    pub psnr_db: f64,
    /// The same of errors weighted by their frequency, without noise: what choices rest on.
    pub score_db: f64,
}

impl Prediction {
    /// Measures the views with the densities `voxels`; none without views, or once the work is cancelled.
    pub fn new(projector: &mut Projector, voxels: &[f32], views: &[View]) -> Option<Self> {
        let (mut square, mut noise, mut score, mut count) = (0.0, 0.0, 0.0, 0.0);
        for view in views {
            let error = ErrorPicture::new(projector, voxels, view);
            count += error.values.len() as f64;
            square += error.square();
            let own = view.noise * view.noise * view.measured() as f64;
            noise += own;
            score += error.weighted(NOISE_SHARE * own);
        }
        (count > 0.0 && !projector.cancel.requested()).then(|| Self {
            square: square / count,
            noise: noise / count,
            psnr_db: unit_psnr_db(square / count),
            score_db: unit_psnr_db(score / count),
        })
    }
}

/// Errors of the pixels of a view, row by row; 0 where nothing was measured.
struct ErrorPicture {
    width: usize,
    values: Vec<f32>,
}

impl ErrorPicture {
    fn new(projector: &mut Projector, voxels: &[f32], view: &View) -> Self {
        let width = view.camera.width as usize;
        let mut values = vec![0.0; width * view.camera.height as usize];
        let found = projector.transmittances(voxels, view);
        let idle = view.idle.iter().map(|sample| (sample, 1.0));
        for (sample, transmittance) in view.samples.iter().zip(found).chain(idle) {
            let [x, y] = sample.position.map(|v| v as usize);
            values[y * width + x] = sample.transmittance - transmittance;
        }
        Self { width, values }
    }

    fn square(&self) -> f64 {
        self.values.iter().map(|v| f64::from(*v).powi(2)).sum()
    }

    /// Sum of squares with the weight 2⁻ʲ in the octave j of frequencies, the highest first (Haar's wavelets), of which
    /// white noise of the sum of squares `noise` is taken off.
    fn weighted(self, noise: f64) -> f64 {
        let (mut sum, mut weight, mut pixels) = (0.0, 1.0, 1.0);
        let mut level = self;
        // A pixel of level j is the mean of 4ʲ, and so are the sums of squares: noise has 4⁻ʲ of its own.
        let beyond_noise = |level: &Self, pixels: f64| pixels * level.square() - noise / pixels;
        while level.width > 1 && level.values.len() > level.width {
            let next = level.halved();
            sum += weight * (beyond_noise(&level, pixels) - beyond_noise(&next, 4.0 * pixels));
            (level, weight, pixels) = (next, 0.5 * weight, 4.0 * pixels);
        }
        sum + weight * beyond_noise(&level, pixels)
    }

    /// Means of four pixels; what lies beyond the border counts as no error.
    fn halved(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), (self.values.len() / self.width).div_ceil(2));
        let at = |x: usize, y: usize| if x < self.width { self.values.get(y * self.width + x) } else { None };
        let mean = |i: usize| {
            let (x, y) = (2 * (i % width), 2 * (i / width));
            [(0, 0), (1, 0), (0, 1), (1, 1)].iter().map(|(u, v)| 0.25 * at(x + u, y + v).unwrap_or(&0.0)).sum()
        };
        Self { width, values: (0..width * height).map(mean).collect() }
    }
}
