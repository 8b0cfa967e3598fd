//! Rays of a pixel: where they pass through its square, and the random numbers of the paths along them.

use crate::math::Ray;
use crate::render::sampler::Sampler;
use crate::scene::camera::Camera;
use glam::DVec2;
use std::ops::Range;

/// The rays of a pixel: through the centres of `per_edge`² equal squares of it, row by row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Subpixels {
    per_edge: usize,
}

impl Subpixels {
    /// Creates `per_edge` rays along each edge of a pixel, at least one.
    pub fn new(per_edge: usize) -> Self {
        Self { per_edge: per_edge.max(1) }
    }

    /// Returns the number of rays of a pixel.
    #[inline(always)]
    pub(crate) fn count(self) -> usize {
        self.per_edge * self.per_edge
    }

    /// Returns the image position of a pixel's ray, in pixels.
    #[inline(always)]
    pub(crate) fn position(self, [x, y]: [usize; 2], ray: usize) -> [f64; 2] {
        let n = self.per_edge;
        let offset = |k: usize| (k as f64 + 0.5) / n as f64;
        [x as f64 + offset(ray % n), y as f64 + offset(ray / n)]
    }

    /// Returns the image positions of all rays of a pixel, in pixels.
    #[inline(always)]
    pub(crate) fn positions(self, pixel: [usize; 2]) -> impl Iterator<Item = [f64; 2]> {
        (0..self.count()).map(move |ray| self.position(pixel, ray))
    }
}

/// Placement of a pixel's rays.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Placement {
    /// In equal squares, each with one path.
    Grid(Subpixels),
    /// At random, evenly over the pixel.
    Random {
        /// Paths per pixel, at least one.
        samples: u32,
        /// Paths that begin with one ray.
        per_ray: u32,
        /// Seed of the random numbers.
        seed: u64,
    },
}

/// Which rays and paths a picture is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampling {
    placement: Placement,
    /// Column and row of the picture's first pixel in the picture that it is a part of, whose random numbers it has.
    origin: [u32; 2],
    /// Most radiance that is scattered to a path, in each channel: less noise for a picture that is too dark. `None`
    /// for all of it.
    pub(in crate::render) clamp: Option<f32>,
}

/// Most paths that begin with one camera ray.
const MOST_PER_RAY: u32 = 16;

/// A ray of a pixel, and the paths that begin with it.
pub(in crate::render) struct Shot {
    /// Image position, in pixels.
    pub place: DVec2,
    /// Half of the rays that it belongs to: 0 or 1.
    pub half: usize,
    /// Seed of its sequence of random numbers.
    pub seed: u64,
    /// Column and row of the pixel in the whole picture.
    pub pixel: [usize; 2],
    /// Number of the ray in that sequence.
    number: u32,
    /// Numbers of its paths in that sequence.
    pub paths: Range<u32>,
}

/// Sequence of the times of rays beside that of their places.
const TIMES: u64 = 0x8CB9_2BA7_2F3D_8DD7;

impl Shot {
    /// Returns the ray of a camera: of one whose picture is blurred, through a random point of its aperture at a random
    /// time.
    #[inline(always)]
    pub(crate) fn ray(&self, camera: &Camera) -> Ray {
        if camera.blur.is_none() { camera.ray(self.place.x, self.place.y) } else { self.blurred_ray(camera) }
    }

    #[cold]
    fn blurred_ray(&self, camera: &Camera) -> Ray {
        // The first two numbers are those of the ray's place.
        let [_, _, u, v] = Sampler::new(self.seed, self.pixel, self.number).stratified();
        let [time, ..] = Sampler::new(self.seed ^ TIMES, self.pixel, self.number).stratified();
        camera.blurred_ray(self.place.into(), [u, v], time)
    }
}

impl Sampling {
    /// Creates the sampling of pixels by `samples` paths, at least one, through random points of their squares.
    /// Pictures of different seeds are independent.
    pub fn random(samples: u32, seed: u64) -> Self {
        let samples = samples.max(1);
        // As many as there are rays, or fewer, and each ray has as many.
        let shared = (1..=MOST_PER_RAY).filter(|n| samples.is_multiple_of(*n) && n * n <= samples);
        let per_ray = shared.max().unwrap_or(1);
        Self { placement: Placement::Random { samples, per_ray, seed }, origin: [0; 2], clamp: None }
    }

    /// Creates the sampling of pixels by one ray in each of `per_edge`² equal squares, at least one: for integrators
    /// without random numbers.
    pub fn grid(per_edge: usize) -> Self {
        Self { placement: Placement::Grid(Subpixels::new(per_edge)), origin: [0; 2], clamp: None }
    }

    /// Sets column and row of the picture's first pixel in the picture that it is a part of, for its random numbers.
    #[must_use]
    pub fn within(self, origin: [u32; 2]) -> Self {
        Self { origin, ..self }
    }

    /// Sets the most radiance that is scattered to a path, in each channel: less noise for a picture that is too dark.
    #[must_use]
    pub fn clamped(self, clamp: Option<f32>) -> Self {
        Self { clamp, ..self }
    }

    /// Returns the least number of paths from `samples` on that share camera rays well.
    pub fn shared(samples: u32) -> u32 {
        samples.next_multiple_of(samples.isqrt().clamp(1, MOST_PER_RAY))
    }

    /// True if rays are placed at random.
    pub(super) fn is_random(&self) -> bool {
        matches!(self.placement, Placement::Random { .. })
    }

    /// Returns the number of estimates that a pixel is the mean of.
    pub fn samples(&self) -> u32 {
        match self.placement {
            Placement::Grid(rays) => rays.count() as u32,
            Placement::Random { samples, .. } => samples,
        }
    }

    /// Returns the number of estimates along each ray.
    #[inline(always)]
    pub(in crate::render) fn per_ray(&self) -> u32 {
        match self.placement {
            Placement::Grid(_) => 1,
            Placement::Random { per_ray, .. } => per_ray,
        }
    }

    /// Returns a ray of a pixel by its number. `in_halves` gives rays of even and of odd number random numbers of their
    /// own sequences.
    #[inline(always)]
    pub(in crate::render) fn shot(&self, at: [usize; 2], number: u32, in_halves: bool) -> Shot {
        let half = (number % 2) as usize;
        let pixel = [0, 1].map(|axis| at[axis] + self.origin[axis] as usize);
        match self.placement {
            Placement::Grid(rays) => {
                let place = rays.position(at, number as usize).into();
                Shot { place, half, seed: 0, pixel, number, paths: number..number + 1 }
            }
            Placement::Random { per_ray, seed, .. } => {
                let seed = if in_halves && half == 1 { seed ^ 0xD1B5_4A32_D192_ED03 } else { seed };
                let number = if in_halves { number / 2 } else { number };
                let [dx, dy, ..] = Sampler::new(seed, pixel, number).stratified();
                let place = DVec2::new(at[0] as f64 + dx, at[1] as f64 + dy);
                Shot { place, half, seed, pixel, number, paths: number * per_ray..(number + 1) * per_ray }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_of_a_pixel_stand_in_the_middle_of_equal_squares() {
        let two: Vec<[f64; 2]> = Subpixels::new(2).positions([3, 5]).collect();
        assert_eq!(two, [[3.25, 5.25], [3.75, 5.25], [3.25, 5.75], [3.75, 5.75]]);
        assert_eq!(Subpixels::new(0).positions([0, 0]).collect::<Vec<_>>(), [[0.5, 0.5]]);
    }

    #[test]
    fn paths_are_shared_evenly_among_rays() {
        for (samples, per_ray) in [(0, 1), (1, 1), (3, 1), (4, 2), (7, 1), (12, 3), (64, 8), (4096, 16)] {
            assert_eq!(Sampling::random(samples, 0).per_ray(), per_ray, "{samples}");
        }
        assert_eq!((Sampling::grid(3).samples(), Sampling::grid(0).samples()), (9, 1));
    }
}
