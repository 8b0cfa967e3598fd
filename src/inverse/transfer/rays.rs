//! Rays drawn from pictures, with their target values.

use crate::cancel::Cancel;
use crate::inverse::observation::photo::Photo;
use crate::math::Ray;
use crate::render::order::morton;

/// Number of rays to draw.
#[derive(Debug, Clone, Copy)]
pub(super) struct Draw {
    /// Pixels, about.
    pub count: usize,
    /// Rays along each edge of a pixel.
    pub per_edge: usize,
}

/// Pixels, each with its rays and its value.
#[derive(Debug, Clone, Default)]
pub(super) struct Rays {
    /// `per_pixel` for each pixel.
    pub rays: Vec<Ray>,
    /// Rays a pixel.
    pub per_pixel: usize,
    /// Target red, green, blue and alpha of each pixel.
    pub targets: Vec<[f32; 4]>,
    /// Polled between pixels by what walks the rays; sums of a walk that it stopped are incomplete.
    pub cancel: Cancel,
}

/// The golden section: multiples of it spread evenly over 0..1, however many there are.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

impl Rays {
    /// Draws pixels from the photos that `selects` accepts by number: evenly along a Morton curve of each, beginning at
    /// another place in each. Pixels that are not finite are left out.
    pub(crate) fn draw(photos: &[Photo], selects: impl Fn(usize) -> bool, draw: Draw) -> Self {
        let chosen: Vec<(usize, &Photo)> = photos.iter().enumerate().filter(|(i, _)| selects(*i)).collect();
        let pixels: usize = chosen.iter().map(|(_, p)| p.film.rgba.len()).sum();
        let stride = (pixels as f64 / draw.count.max(1) as f64).max(1.0);
        let n = draw.per_edge.max(1);
        let offset = |k: usize| (k as f64 + 0.5) / n as f64;
        let mut all = Self { per_pixel: n * n, ..Self::default() };
        for (number, photo) in chosen {
            let width = photo.film.width;
            let order: Vec<usize> = morton(width, photo.film.height).collect();
            let mut at = stride * (GOLDEN * number as f64).fract();
            while (at as usize) < order.len() {
                let pixel = order[at as usize];
                at += stride;
                let value = photo.film.rgba[pixel];
                if !value.iter().all(|v| v.is_finite()) {
                    continue;
                }
                let (x, y) = ((pixel % width) as f64, (pixel / width) as f64);
                all.rays.extend((0..n * n).map(|k| photo.camera.ray(x + offset(k % n), y + offset(k / n))));
                all.targets.push(value);
            }
        }
        all
    }

    /// Returns the number of pixels.
    pub(crate) fn len(&self) -> usize {
        self.targets.len()
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.targets.is_empty()
    }

    /// Returns the rays of one pixel.
    pub(crate) fn of_pixel(&self, pixel: usize) -> &[Ray] {
        &self.rays[pixel * self.per_pixel..(pixel + 1) * self.per_pixel]
    }
}
