//! What a reconstruction will cost, before anything large is allocated.
//!
//! Memory follows from the sizes of what is held at once; it errs upwards. Time follows from the number of passes, and
//! from what a voxel and a step along a ray take: on a processor of today, which is right within a factor of a few, or
//! as [timed](crate::inverse::density::timing) with the real operators on the machine at hand.

pub mod effort;
pub mod scaling;

use crate::error::{Code, Error, Result};
use crate::inverse::region::hull::Survey;
use crate::scene::bricks::BRICK;
use crate::scene::capture::{Capture, Frame};
use crate::scene::grid::LEAF_VOXELS;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Expected cost of a reconstruction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct Cost {
    /// Unknown numbers: voxels, times the numbers of each.
    pub unknowns: u64,
    /// Pixels of all pictures.
    pub measurements: u64,
    /// Largest resident memory, in MB (2²⁰ bytes).
    pub memory_mb: f64,
    /// Wall time.
    pub seconds: f64,
}

/// Sizes of the pictures of a capture.
#[derive(Debug, Clone, Copy)]
pub struct PictureSizes {
    /// Pixels of all pictures.
    pub pixels: u64,
    /// Pixels of the largest one.
    pub largest: u64,
    /// Number of pictures.
    pub count: usize,
}

impl PictureSizes {
    /// Returns those of a capture.
    pub fn of(capture: &Capture) -> Self {
        let of = |frame: &Frame| u64::from(frame.camera.width) * u64::from(frame.camera.height);
        let largest = capture.frames.iter().map(of).max().unwrap_or(0);
        Self { pixels: capture.pixels(), largest, count: capture.frames.len() }
    }

    /// Returns the bytes of the pictures that all threads work on at once, with so many a pixel.
    fn at_once(&self, bytes: f64) -> f64 {
        bytes * self.largest as f64 * self.count.min(rayon::current_num_threads()) as f64
    }
}

/// Method by which unknowns are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Conjugate gradients on densities.
    Cg,
    /// Adam on densities.
    Descent,
    /// Extinctions and emissions by conjugate gradients.
    Color,
    /// Extinctions and emissions, and the densities behind a transfer function.
    ThroughTransfer,
}

/// The program and its libraries, with what threads and allocators keep.
const BASE: f64 = 72.0 * MB;
const MB: f64 = (1_u64 << 20) as f64;
/// Bytes a pixel: the picture, its optical depth and weight, the samples of the solver, and copies on the way; and of
/// pictures of which only the transmittances are kept, with what of them the rays of the solver need.
const PIXEL: f64 = 96.0;
const PIXEL_OF_DEPTHS: f64 = 21.0;
/// Bytes a pixel that is kept while the pictures are read: its transmittance, and whether it shows anything.
const PIXEL_READ: f64 = 6.0;
/// Bytes a pixel of a picture that is being read: its colors and samples, and the planes by which its noise is judged.
const DECODED: f64 = 72.0;
/// Bytes a pixel of a picture whose rays are being found: its optical depths, the sums that they are estimated by, and
/// samples that grow.
const WALKED: f64 = 56.0;
/// Accumulators of several threads take this much together, or are two.
const ACCUMULATED: f64 = 256.0 * MB;
/// Seconds that a ray takes for each voxel along its way, on one core.
const STEP_SECONDS: f64 = 1.6e-8;

impl Cost {
    /// The cost of a method whose search takes `seconds`. Memory is that of the finest level, or of the pictures that
    /// are read at once where that is more.
    pub fn new(method: Method, survey: &Survey, pictures: PictureSizes, seconds: f64) -> Self {
        let pixels = pictures.pixels as f64;
        let (stored, owned) = ((BRICK * size_of::<f32>()) as f64, (LEAF_VOXELS * size_of::<f32>()) as f64);
        // As many accumulators as fit, a power of two from 2 to 16.
        let accumulators = |each: f64| {
            let fits = (ACCUMULATED / (survey.bricks * each).max(1.0)).clamp(2.0, 16.0);
            fits.log2().floor().exp2() * each
        };
        // Gathered voxels, solver vectors, starts and bests, the scratch of prior and penalty, confidence.
        let density = stored + accumulators(stored) + 16.0 * owned + 1100.0;
        let brick = match method {
            Method::Cg => density,
            Method::Descent => 2.0 * stored + accumulators(stored) + 10.0 * owned + 1100.0,
            Method::Color | Method::ThroughTransfer => {
                let four = 4.0 * stored;
                density.max(2.0 * four + accumulators(four) + 3.0 * 10.0 * owned)
            }
        };
        let fields = match method {
            Method::Cg | Method::Descent => 1,
            Method::Color | Method::ThroughTransfer => 4,
        };
        // What is kept while pictures are read, and while the volume is found.
        let [first, kept] = match method {
            Method::Cg => [pixels * PIXEL_READ, pixels * PIXEL_OF_DEPTHS + pictures.at_once(WALKED)],
            _ => [pixels * PIXEL; 2],
        };
        let (reading, solving) = (first + pictures.at_once(DECODED), kept + survey.bricks * brick);
        Self {
            unknowns: (survey.unknowns * f64::from(fields)) as u64,
            measurements: pictures.pixels,
            memory_mb: (BASE + reading.max(solving)) / MB,
            seconds,
        }
    }

    /// The cost of a transfer function of so many texels, through a volume of so many stored voxels that is there
    /// already; `walked` are the voxels along all rays that are drawn.
    pub fn of_function(texels: usize, voxels: usize, pixels: usize, walked: f64, steps: u32) -> Self {
        // Sums of 16 partitions (twice four numbers of four bytes each pair of texels), and four matrices of all
        // unknowns.
        let (pairs, count) = ((texels * texels) as f64, (4 * texels) as f64);
        let sums = 16.0 * 2.0 * 16.0 * pairs + 4.0 * 8.0 * count * count;
        // A refinement walks for the equations, which costs as much as ten plain walks, and for a few steps.
        let threads = rayon::current_num_threads() as f64;
        Self {
            unknowns: 4 * texels as u64,
            measurements: pixels as u64,
            memory_mb: (BASE + pixels as f64 * PIXEL + 6.0 * voxels as f64 + sums + walked / 8.0) / MB,
            seconds: (f64::from(steps) + 8.0) * (12.0 * walked * STEP_SECONDS + 2e-10 * count * count * count)
                / threads,
        }
    }

    /// Refuses what does not fit.
    ///
    /// # Errors
    /// If more than `max_memory` bytes would be needed.
    pub fn fits(&self, max_memory: u64) -> Result<()> {
        if self.memory_mb * MB <= max_memory as f64 {
            return Ok(());
        }
        Err(Error::unsupported(format!(
            "about {} unknowns from {} pixels do not fit in memory: {:.0} MB are needed, {:.0} MB are allowed",
            self.unknowns,
            self.measurements,
            self.memory_mb,
            max_memory as f64 / MB
        ))
        .coded(Code::MemoryLimit)
        .hint("choose a larger ⟨voxel_size⟩ or a smaller ⟨resolution⟩, give ⟨bounds⟩, or raise ⟨max_memory⟩"))
    }
}

impl fmt::Display for Cost {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { unknowns, measurements, memory_mb, seconds } = self;
        write!(f, "about {unknowns} unknowns from {measurements} pixels, {memory_mb:.0} MB of memory, ")?;
        write!(f, "{}", Duration(*seconds))
    }
}

/// A time that is expected, in words: in seconds, or in minutes from a minute and a half on.
#[derive(Debug, Clone, Copy)]
pub struct Duration(pub f64);

impl fmt::Display for Duration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(seconds) = self;
        if *seconds < 90.0 {
            write!(f, "{:.0} s", seconds.ceil())
        } else {
            write!(f, "{:.0} minutes", (seconds / 60.0).ceil())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every term by itself, in bytes and seconds beyond those of nothing.
    #[test]
    fn the_cost_of_a_function_is_the_sum_of_its_terms() {
        let nothing = Cost::of_function(0, 0, 0, 0.0, 0);
        assert_eq!((nothing.unknowns, nothing.measurements, nothing.seconds), (0, 0, 0.0));
        assert!((nothing.memory_mb - BASE / MB).abs() < 1e-9);
        let threads = rayon::current_num_threads() as f64;
        let of = |texels, voxels, pixels, walked, steps| {
            let cost = Cost::of_function(texels, voxels, pixels, walked, steps);
            ((cost.memory_mb - nothing.memory_mb) * MB, cost.seconds * threads)
        };
        // 16 parts of 8 numbers of 4 bytes a pair of texels; four matrices of 16 unknowns², in double precision.
        let (memory, seconds) = of(4, 0, 0, 0.0, 2);
        assert!((memory - (16.0 * 32.0 * 16.0 + 4.0 * 8.0 * 256.0)).abs() < 1.0, "{memory}");
        assert!((seconds - 10.0 * 2e-10 * 4096.0).abs() < 1e-12, "{seconds}");
        assert!((of(0, 1000, 0, 0.0, 0).0 - 6000.0).abs() < 1.0);
        assert!((of(0, 0, 1000, 0.0, 0).0 - 96_000.0).abs() < 1.0);
        let (memory, seconds) = of(0, 0, 0, 8e6, 12);
        assert!((memory - 1e6).abs() < 1.0, "{memory}");
        assert!((seconds - 20.0 * 12.0 * 8e6 * 1.6e-8).abs() < 1e-9, "{seconds}");
    }

    /// Pictures that threads decode at once count beside those that are kept, as far as there are so many.
    #[test]
    fn pictures_that_are_read_at_once_take_memory() {
        let survey = Survey { bricks: 8.0, unknowns: 100.0, longest: 8.0 };
        let of = |largest: u64, count: usize| {
            let sizes = PictureSizes { pixels: 1 << 20, largest, count };
            Cost::new(Method::Cg, &survey, sizes, 0.0).memory_mb * MB
        };
        let (threads, kept) = (rayon::current_num_threads(), BASE + PIXEL_READ * f64::from(1 << 20));
        for count in [1, 2, 1000] {
            let expected = kept + DECODED * 1e9 * count.min(threads) as f64;
            assert!((of(1_000_000_000, count) - expected).abs() < 1.0, "{count}");
        }
        assert!(of(1000, 1000) - of(1, 1) < 1e5 * threads as f64, "small pictures take less than the search");
    }

    #[test]
    fn what_does_not_fit_is_refused_with_what_is_needed() {
        let cost = Cost { unknowns: 5, measurements: 7, memory_mb: 100.0, seconds: 91.0 };
        assert!(cost.fits(100 << 20).is_ok());
        let error = cost.fits((100 << 20) - 1).unwrap_err().to_string();
        assert!(error.contains("5 unknowns from 7 pixels") && error.contains("100 MB are needed"), "{error}");
        assert!(cost.to_string().ends_with("100 MB of memory, 2 minutes"), "{cost}");
        assert!(Cost { seconds: 89.2, ..cost }.to_string().ends_with("90 s"), "{cost}");
    }
}
