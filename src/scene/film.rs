//! A picture: RGBA pixels and further named planes.

use glam::{DMat3, DVec3};
use std::ops::Range;

/// Scene-linear premultiplied RGBA and named planes over one raster, row-major from the top left.
#[derive(Debug, Clone, PartialEq)]
pub struct Film {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Pixels `rgba[y * width + x]`, each the mean over its samples; alpha is 1 - transmittance.
    pub rgba: Vec<[f32; 4]>,
    /// Number of samples per pixel; 0 where it is unknown, as for pictures from files.
    pub samples: u32,
    /// Further planes in the order in which they were added.
    pub planes: Vec<Plane>,
}

/// A named plane with one number per pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct Plane {
    /// Layer and channel joined by a dot, as in OpenEXR: `variance.R`. A name without a dot is a channel of the unnamed
    /// layer.
    pub name: String,
    /// Values `samples[y * width + x]`.
    pub samples: Vec<f32>,
}

impl Film {
    /// A black, fully transparent film without further planes.
    pub fn new(width: usize, height: usize) -> Self {
        Self::of(width, height, vec![[0.0; 4]; width * height])
    }

    /// A film of the given pixels without further planes.
    pub fn of(width: usize, height: usize, rgba: Vec<[f32; 4]>) -> Self {
        Self { width, height, rgba, samples: 0, planes: Vec::new() }
    }

    /// Returns a part of the picture, by its columns and rows, with its planes.
    ///
    /// # Panics
    /// If the part reaches out of the picture.
    #[must_use]
    pub fn part(&self, [columns, rows]: [Range<usize>; 2]) -> Self {
        fn of<T: Copy>(values: &[T], width: usize, columns: &Range<usize>, rows: &Range<usize>) -> Vec<T> {
            let row = |y: usize| &values[y * width..][columns.clone()];
            rows.clone().flat_map(row).copied().collect()
        }
        let planes = self
            .planes
            .iter()
            .map(|plane| Plane { name: plane.name.clone(), samples: of(&plane.samples, self.width, &columns, &rows) });
        Self {
            width: columns.len(),
            height: rows.len(),
            rgba: of(&self.rgba, self.width, &columns, &rows),
            samples: self.samples,
            planes: planes.collect(),
        }
    }

    /// Multiplies the color of each pixel by a matrix, such as one between primaries.
    pub fn convert(&mut self, matrix: DMat3) {
        for [colors @ .., _] in &mut self.rgba {
            *colors = (matrix * DVec3::from_array(colors.map(f64::from))).as_vec3().to_array();
        }
    }

    /// Returns what alpha alone tells: the transmittance in each color, as a medium that only absorbs shows it before
    /// white.
    #[must_use]
    pub fn by_alpha(&self) -> Self {
        let transmittance = |p: &[f32; 4]| [1.0 - p[3], 1.0 - p[3], 1.0 - p[3], p[3]];
        Self::of(self.width, self.height, self.rgba.iter().map(transmittance).collect())
    }

    /// Values of the plane named `name`, if there is one.
    pub fn plane(&self, name: &str) -> Option<&[f32]> {
        self.planes.iter().find(|plane| plane.name == name).map(|plane| &plane.samples[..])
    }
}

/// Running mean and variance of a pixel's samples (Welford 1962), free of cancellation for any number of samples.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Moments {
    count: u32,
    mean: f64,
    /// Sum of squared differences from the mean.
    spread: f64,
}

impl Moments {
    /// Adds one sample.
    pub fn add(&mut self, sample: f64) {
        self.count += 1;
        let before = sample - self.mean;
        self.mean += before / f64::from(self.count);
        self.spread += before * (sample - self.mean);
    }

    /// Mean of the samples; 0 if there are none.
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// Unbiased estimate of the variance of the mean, `Σ (x - x̄)² / (n (n - 1))`; infinite for fewer than two samples.
    pub fn variance_of_mean(&self) -> f64 {
        if self.count < 2 {
            return f64::INFINITY;
        }
        self.spread / (f64::from(self.count) * f64::from(self.count - 1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_those_of_all_samples() {
        let samples = [1e9 + 4.0, 1e9 + 7.0, 1e9 + 13.0, 1e9 + 16.0];
        let mut moments = Moments::default();
        assert_eq!((moments.mean(), moments.variance_of_mean()), (0.0, f64::INFINITY));
        samples.iter().for_each(|v| moments.add(*v));
        // Σ (x - x̄)² = 90; sums of squares would have lost it this far from zero.
        assert_eq!((moments.mean(), moments.variance_of_mean()), (1e9 + 10.0, 90.0 / 12.0));
    }
}
