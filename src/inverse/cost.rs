//! What a reconstruction will cost, before anything large is allocated.
//!
//! Memory follows from the sizes of what is held at once; it errs upwards, but for pictures that threads decode at once
//! (4 % too little was seen of pictures of 1024²). Time follows from the number of passes, and
//! from what a voxel and a step along a ray take on a processor of today, measured: it is right within a factor of a
//! few.

use crate::error::{Code, Error, Result};
use crate::inverse::density::Request;
use crate::inverse::region::hull::Survey;
use crate::scene::bricks::BRICK;
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

/// The program and its libraries.
const BASE: f64 = 48.0 * MB;
const MB: f64 = (1_u64 << 20) as f64;
/// Bytes a pixel: the picture, its optical depth and weight, the samples of the solver, and copies on the way; and of
/// pictures of which only the transmittances are kept, with what of them the rays of the solver need.
const PIXEL: f64 = 96.0;
const PIXEL_OF_DEPTHS: f64 = 24.0;
/// Accumulators of several threads take this much together, or are two.
const ACCUMULATED: f64 = 256.0 * MB;
/// Seconds that a voxel takes in an iteration, and a ray for each voxel along its way, on one core.
const VOXEL_SECONDS: f64 = 6e-8;
const STEP_SECONDS: f64 = 1.6e-8;

impl Cost {
    /// The cost of the finest level, with the share of the coarser ones in the time. `pixels` are those of all
    /// pictures, `steps` the iterations or epochs.
    pub fn new(method: Method, survey: &Survey, request: &Request, pixels: u64, steps: u64) -> Self {
        let pictures = pixels as f64;
        let rays = pictures * (request.rays_per_edge * request.rays_per_edge) as f64;
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
        let walk = rays * survey.longest * STEP_SECONDS * if fields == 1 { 1.0 } else { 2.0 };
        let pass = walk + survey.unknowns * fields as f64 * VOXEL_SECONDS;
        // The probes of the confidence are walks of a sixteenth of the pixels; there are at most 64.
        let seconds = (steps as f64 * pass + 4.0 * walk) / rayon::current_num_threads() as f64;
        Self {
            unknowns: (survey.unknowns * f64::from(fields)) as u64,
            measurements: pixels,
            memory_mb: (BASE
                + pictures * if method == Method::Cg { PIXEL_OF_DEPTHS } else { PIXEL }
                + survey.bricks * brick)
                / MB,
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
        assert!((nothing.memory_mb - 48.0).abs() < 1e-9);
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
