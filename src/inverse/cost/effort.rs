//! The time of a search by conjugate gradients: what each level has to do, and how long a machine takes for it.
//!
//! A level prepares its rays once, and each iteration walks them there and back, clears and adds the sums of all
//! partitions, and goes over the vectors of the solver. Rates are of one thread: at most as many threads walk rays as
//! there are partitions, and all threads do the rest.

use crate::inverse::cost::Method;
use crate::inverse::cost::scaling::Pass;
use crate::inverse::density::Request;
use crate::inverse::density::multilevel::LevelSteps;
use crate::inverse::density::timing::LevelTimes;
use crate::inverse::progress::Stage;
use crate::inverse::region::hull::Survey;
use crate::scene::bricks::BRICK;

/// Seconds that one thread takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rates {
    /// Telling whether a block of 8³ voxels is empty, by one picture.
    pub hull: f64,
    /// Preparing a pixel for a level, beside the walk of its ray.
    pub pixel: f64,
    /// Walking a ray by the length of a voxel.
    pub forward: f64,
    /// Walking a ray by that length and back, with the adjoint.
    pub pass: f64,
    /// Clearing and adding the sums of a block in one partition.
    pub sums: f64,
    /// Going over the vectors of the solver of a block in an iteration.
    pub vectors: f64,
}

impl Rates {
    /// Rates of a processor of today, as measured on one, where nothing is timed.
    pub const USUAL: Self =
        Self { hull: 1.0e-6, pixel: 6.0e-8, forward: 7.0e-9, pass: 1.6e-8, sums: 4.0e-7, vectors: 2.0e-5 };

    /// Returns the rates of this machine and these pictures by the times of a level. `longest` is the number of voxels
    /// along the longest edge of the region there, `views` the number of pictures that bounded it.
    pub fn new(times: &LevelTimes, longest: f64, views: usize) -> Self {
        let threads = rayon::current_num_threads() as f64;
        let walked = (times.rays * longest).max(1.0);
        let forward = times.forward * at_work(times.partitions) / walked;
        let crossing = times.prepared * times.crossing * longest;
        Self {
            hull: times.hull * threads / (times.bricks * views as f64).max(1.0),
            pixel: ((times.rows * threads - forward * crossing) / times.pixels.max(1.0)).max(0.0),
            forward,
            pass: times.pass * at_work(times.partitions) / walked,
            sums: times.sums * threads / (times.bricks * in_sums(times.partitions)).max(1.0),
            vectors: times.vectors * threads / times.bricks.max(1.0),
        }
    }
}

/// Returns the seconds of a search by another method, of so many steps, by the work of its finest level. It is right
/// within a factor of a few.
pub fn of_steps(method: Method, survey: &Survey, request: &Request, pixels: u64, steps: u64, rates: &Rates) -> f64 {
    let fields = match method {
        Method::Cg | Method::Descent => 1.0,
        Method::Color | Method::ThroughTransfer => 4.0,
    };
    let rays = pixels as f64 * request.rays_per_edge.pow(2) as f64;
    let walk = rays * survey.longest * rates.pass * if fields == 1.0 { 1.0 } else { 2.0 };
    let pass = walk + survey.bricks * fields * rates.vectors;
    // The probes of the confidence are walks of a sixteenth of the pixels; there are at most 64.
    (steps as f64 * pass + 4.0 * walk) / rayon::current_num_threads() as f64
}

/// Returns the mean number of threads that are at work on so many partitions.
fn at_work(partitions: usize) -> f64 {
    partitions as f64 / partitions.div_ceil(rayon::current_num_threads()).max(1) as f64
}

/// Returns how often a pass goes over the stored values of a block: for each partition, to prepare and to gather.
fn in_sums(partitions: usize) -> f64 {
    partitions as f64 + 2.0
}

/// The pictures of a capture, as far as they decide the time.
#[derive(Debug, Clone, Copy)]
pub struct PictureCounts {
    /// Number of pictures, and those of them that are held out.
    pub views: usize,
    /// Held-out pictures, or those that tell instead whether noise is fitted.
    pub predicted: usize,
    /// Pixels of all pictures.
    pub pixels: f64,
    /// Share of the pixels whose rays cross unknowns.
    pub crossing: f64,
}

/// The work of a level.
#[derive(Debug, Clone, Copy)]
pub struct LevelWork {
    /// Level, its iterations and the length of its cycles.
    steps: LevelSteps,
    bricks: f64,
    views: f64,
    pixels: f64,
    /// Voxels along the rays that are walked in a pass, and along those that are predicted after an iteration.
    walked: f64,
    predicted: f64,
    partitions: usize,
}

/// Returns the work of each level; `survey` is that of the finest one.
pub fn levels(survey: &Survey, request: &Request, pictures: &PictureCounts, steps: &[LevelSteps]) -> Vec<LevelWork> {
    let PictureCounts { views, predicted, pixels, crossing } = *pictures;
    let of_level = |steps: &LevelSteps| {
        let coarser = f64::from(1_u32 << steps.level);
        let per_pixel = if steps.level == 0 { request.rays_per_edge.pow(2) as f64 } else { 1.0 };
        let along = |views: usize, all: usize| {
            let rays = pixels * views as f64 / all.max(1) as f64 * crossing * per_pixel / (coarser * coarser);
            rays * survey.longest / coarser
        };
        let bricks = coarser_bricks(survey.bricks, coarser);
        LevelWork {
            steps: *steps,
            bricks,
            views: views as f64,
            pixels,
            walked: along(views - request.held_out.len().min(views), views),
            predicted: along(predicted, views),
            partitions: partitions(bricks),
        }
    };
    steps.iter().map(of_level).collect()
}

/// Returns the blocks of a lattice of so much larger voxels. The survey adds one that only cells reach into along each
/// axis.
pub fn coarser_bricks(bricks: f64, coarser: f64) -> f64 {
    ((bricks.cbrt() - 1.0).max(1.0) / coarser + 1.0).powi(3)
}

/// Returns the partitions of the rays through so many blocks, as the projector has them.
fn partitions(bricks: f64) -> usize {
    let fits = (f64::from(256 << 20) / (bricks * (BRICK * 4) as f64).max(1.0)).clamp(2.0, 16.0);
    1 << (fits as usize).ilog2()
}

impl LevelWork {
    /// Returns the least, the expected and the largest number of iterations.
    pub fn iterations(&self) -> [f64; 3] {
        self.steps.iterations
    }

    /// Returns the seconds of the level's two stages with the fewest, the usual and the most iterations.
    pub fn stages(&self, rates: &Rates) -> [[Stage; 2]; 3] {
        let threads = rayon::current_num_threads() as f64;
        let level = self.steps.level;
        let stage = |name: &str, seconds: f64| Stage { name: format!("level {level}: {name}"), seconds };
        let prepare = rates.hull * self.bricks * self.views
            + rates.pixel * self.pixels
            + rates.forward * (self.walked + self.predicted);
        self.steps.iterations.map(|iterations| {
            let [search, quality] = self.passes(rates, iterations);
            let of = |pass: &Pass| pass.count * (pass.rays / at_work(pass.partitions) + pass.sums + pass.alone);
            [stage("hull and rays", prepare / threads), stage("solve", of(&search) + of(&quality))]
        })
    }

    /// Returns the passes of the search with so many iterations, and that which measures its result.
    pub fn passes(&self, rates: &Rates, iterations: f64) -> [Pass; 2] {
        let threads = rayon::current_num_threads() as f64;
        let count = iterations + (iterations / self.steps.cycle).ceil();
        let predicted = rates.forward * self.predicted * iterations / count.max(1.0);
        let search = Pass {
            count,
            rays: rates.pass * self.walked,
            sums: rates.sums * self.bricks * in_sums(self.partitions) / threads,
            alone: (rates.vectors * self.bricks + predicted) / threads,
            partitions: self.partitions,
            bytes: self.bricks * (BRICK * 4) as f64,
        };
        let rays = rates.forward * (self.walked + self.predicted);
        let quality = Pass { count: 1.0, rays, sums: 0.0, alone: 0.0, partitions: self.partitions, bytes: 0.0 };
        [search, quality]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOTHING: Rates = Rates { hull: 0.0, pixel: 0.0, forward: 0.0, pass: 0.0, sums: 0.0, vectors: 0.0 };

    fn level(level: u32, iterations: f64) -> LevelWork {
        let steps = LevelSteps { level, iterations: [iterations; 3], cycle: 4.0 };
        LevelWork { steps, bricks: 100.0, views: 10.0, pixels: 1e4, walked: 1e6, predicted: 2e5, partitions: 16 }
    }

    /// Every rate has a part of its own in the time.
    #[test]
    fn times_are_sums_of_their_parts() {
        let threads = rayon::current_num_threads() as f64;
        let seconds = |rates: Rates| level(1, 8.0).stages(&rates)[1].clone().map(|stage| stage.seconds * threads);
        let near = |a: f64, b: f64| assert!((a - b).abs() <= 1e-9 * b.abs().max(1e-12), "{a} {b}");
        let prepared = |rates: Rates, expected: f64| near(seconds(rates)[0], expected);
        prepared(Rates { hull: 1e-3, ..NOTHING }, 1.0);
        prepared(Rates { pixel: 1e-3, ..NOTHING }, 10.0);
        prepared(Rates { forward: 1e-6, ..NOTHING }, 1.2);
        // Eight iterations in two cycles are ten passes.
        let solved = |rates: Rates, expected: f64| near(seconds(rates)[1], expected);
        solved(Rates { vectors: 1e-3, ..NOTHING }, 10.0 * 0.1);
        solved(Rates { sums: 1e-4, ..NOTHING }, 10.0 * 18.0 * 1e-2);
        let busy = threads / at_work(16);
        solved(Rates { pass: 1e-6, ..NOTHING }, 10.0 * busy);
        solved(Rates { forward: 1e-6, ..NOTHING }, 8.0 * 0.2 + 1.2 * busy);
        assert_eq!(level(1, 8.0).stages(&NOTHING)[0][1].name, "level 1: solve");
    }

    /// Twice the voxels' edge: an eighth of the blocks but for the border, whose two neighbours are one as before.
    #[test]
    fn coarser_levels_have_fewer_blocks() {
        assert!((coarser_bricks(9_f64.powi(3), 2.0) - 5_f64.powi(3)).abs() < 1e-9);
        assert_eq!((partitions(10.0), partitions(1e4), partitions(1e6)), (16, 8, 2));
    }
}
