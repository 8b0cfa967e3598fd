//! How well a volume predicts views that it was not fitted to.
//!
//! The error of a projection at a spatial frequency k is that of the volume in the same plane of frequencies (Fourier
//! slice theorem), and the volume has more frequencies to each of the picture the higher it is: the mean square error
//! of the volume is that of the picture with weights that grow as |k|. The pictures' own noise adds the same to all.

use crate::inverse::projection::projector::{Projector, View};
use crate::metrics::error::unit_psnr_db;

/// Errors of the transmittances in views, over all their pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Prediction {
    /// Mean square error.
    pub square: f64,
    /// Mean square of the pictures' own noise, which is a part of the error.
    pub noise: f64,
    /// PSNR in dB, peak 1.
    pub psnr_db: f64,
    /// PSNR in dB of the error weighted by frequency: the number that choices rest on.
    pub score_db: f64,
}

impl Prediction {
    /// Measures the views with the densities `voxels`; none without views, or once the work is cancelled.
    pub(crate) fn new(projector: &mut Projector, voxels: &[f32], views: &[View]) -> Option<Self> {
        let (mut square, mut noise, mut score, mut count) = (0.0, 0.0, 0.0, 0.0);
        for view in views {
            let error = ErrorPicture::new(projector, voxels, view);
            count += error.values.len() as f64;
            square += error.square();
            noise += view.noise * view.noise * view.measured() as f64;
            score += error.weighted();
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
            values[sample.pixel as usize] = sample.transmittance - transmittance;
        }
        Self { width, values }
    }

    fn square(&self) -> f64 {
        self.values.iter().map(|v| f64::from(*v).powi(2)).sum()
    }

    /// Returns the sum of squares with the weight 2⁻ʲ in the octave j of frequencies, the highest first (Haar's
    /// wavelets).
    fn weighted(self) -> f64 {
        let (mut sum, mut weight, mut pixels) = (0.0, 1.0, 1.0);
        let mut level = self;
        while level.width > 1 && level.values.len() > level.width {
            // A pixel of level j stands for 4ʲ.
            let next = level.halved();
            sum += weight * (pixels * level.square() - 4.0 * pixels * next.square());
            (level, weight, pixels) = (next, 0.5 * weight, 4.0 * pixels);
        }
        sum + weight * pixels * level.square()
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Fine errors count whole, and those of twice the size half as much.
    #[test]
    fn errors_count_by_their_frequency() {
        let picture = |value: fn(usize, usize) -> f32| {
            let values = (0..64).map(|i| value(i % 8, i / 8)).collect();
            ErrorPicture { width: 8, values }
        };
        assert_eq!(picture(|_, _| 0.5).weighted(), 64.0 * 0.25 / 8.0);
        assert_eq!(picture(|x, y| if (x + y) % 2 == 0 { 0.5 } else { -0.5 }).weighted(), 64.0 * 0.25);
        assert_eq!(picture(|x, y| if (x / 2 + y / 2) % 2 == 0 { 0.5 } else { -0.5 }).weighted(), 64.0 * 0.25 / 2.0);
    }
}
