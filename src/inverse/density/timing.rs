//! How long the parts of a level take on this machine: the real operators and the real solver, timed on some of the
//! rays.

use crate::error::Result;
use crate::inverse::density::Request;
use crate::inverse::density::level::Level;
use crate::inverse::density::multilevel::usual_passes;
use crate::inverse::observation::Observation;
use crate::inverse::projection::depths::{Depths, mean};
use crate::inverse::projection::projector::{Projector, RUN, View};
use crate::inverse::region::hull::Hull;
use crate::inverse::region::lattice;
use crate::inverse::solver::conjugate::{Equations, Solver};
use crate::inverse::solver::tikhonov::Tikhonov;
use crate::scene::bricks::Bricks;
use crate::scene::neighbours::Neighbours;
use std::time::Instant;

/// Times of the parts of a level in seconds of wall time, and of how much of it.
#[derive(Debug, Clone)]
pub struct LevelTimes {
    /// Blocks of 8³ voxels.
    pub bricks: f64,
    /// Finding the unknown voxels by all pictures.
    pub hull: f64,
    /// Pixels of the pictures whose rays were prepared.
    pub pixels: f64,
    /// Preparing those rays.
    pub rows: f64,
    /// Pixels of the level, which are means of those where it is not the finest.
    pub prepared: f64,
    /// Share of the level's pixels whose rays cross unknowns.
    pub crossing: f64,
    /// Rays that were walked in a pass.
    pub rays: f64,
    /// Walking these rays there and back.
    pub pass: f64,
    /// Walking these rays there.
    pub forward: f64,
    /// Clearing and adding the sums of a pass.
    pub sums: f64,
    /// Vectors of the solver in an iteration.
    pub vectors: f64,
    /// Partitions of the rays.
    pub partitions: usize,
    /// Densities after a few iterations.
    pub field: Bricks<f32>,
}

/// Pixels that rays are prepared of, and rays that are walked, at most (or one picture's).
const PIXELS: usize = 1 << 21;
const RAYS: usize = 1 << 17;
/// Iterations that are timed; the fastest counts, since other programs make some of them slower.
const TIMED: usize = 3;

impl LevelTimes {
    /// Times a level, 0 the finest, of the reconstruction of some pictures; the held-out ones of `request` are numbers
    /// of other pictures, and count for nothing.
    ///
    /// # Errors
    /// If the pictures leave no unknown, or the unknowns do not fit in memory.
    pub fn measure(observation: &Observation, request: &Request, level: u32) -> Result<Self> {
        let request = Request { held_out: Vec::new(), checkpoint: None, init: None, ..request.clone() };
        let begun = Instant::now();
        let hull = Hull::new(observation).cancel(request.cancel.clone());
        let lattice = lattice::coarser(&request.lattice, level)?;
        let found = hull.unknowns(&lattice, &request.bounds, Level::most_bricks(&request))?;
        drop(hull);
        let hull = begun.elapsed().as_secs_f64();

        let each = observation.maps.first().map_or(1, |map| map.transmittance.len()).max(1);
        let some = (PIXELS / each).clamp(1, observation.maps.len().max(1));
        // Evenly spaced, as the pictures are.
        let maps: Vec<_> = (0..some).map(|i| observation.maps[i * observation.maps.len() / some].clone()).collect();
        let some = Observation { maps, clean: observation.clean };
        let begun = Instant::now();
        let passes = usual_passes(observation, &request);
        let mut work = Level::within(&some, &request, level, found, None, passes)?;
        let rows = begun.elapsed().as_secs_f64();
        let pixels: usize = some.maps.iter().map(|map| map.transmittance.len()).sum();
        let left: usize = work.train.iter().map(|view| view.camera.width as usize * view.camera.height as usize).sum();
        let crossing: usize = work.train.iter().map(|view| view.samples.len()).sum();
        let per_pixel = if level == 0 { request.rays_per_edge.pow(2) } else { 1 };
        thin(&mut work.train, RAYS / per_pixel);
        let rays: usize = work.train.iter().map(|view| view.samples.len() * per_pixel).sum();
        let (iteration, voxels) = work.iterations();
        let passes = Passes::measure(&mut work.projector, &work.train, &voxels);
        let bricks = work.topology.len() as f64;
        let partitions = work.projector.partitions();
        Ok(Self {
            bricks,
            hull,
            pixels: pixels as f64,
            rows,
            prepared: left as f64,
            crossing: crossing as f64 / left.max(1) as f64,
            rays: rays as f64,
            pass: (passes.there_and_back - passes.sums).max(0.0),
            forward: passes.there,
            sums: passes.sums,
            vectors: (iteration - passes.there_and_back).max(0.0),
            partitions,
            field: work.field(voxels).0,
        })
    }
}

impl Level {
    /// Returns the time of an iteration of the solver that suits the pictures, and the voxels after some.
    fn iterations(&mut self) -> (f64, Vec<f32>) {
        let start = std::mem::take(&mut self.start);
        let neighbours;
        let depths = Depths::new(&self.train, &mut self.projector);
        match self.penalty {
            Some(penalty) => {
                neighbours = Neighbours::new(&self.topology);
                let regularized = Tikhonov::new(depths, &neighbours, penalty);
                timed(Solver::new(regularized, &mut self.smoother, &self.unknown, start).robust(self.robust))
            }
            None => timed(Solver::new(depths, &mut self.smoother, &self.unknown, start).robust(self.robust)),
        }
    }
}

/// Returns the time of the fastest iteration of some, but for the first one, which begins a cycle.
fn timed<E: Equations>(mut solver: Solver<'_, E>) -> (f64, Vec<f32>) {
    let (mut fastest, mut solution) = (f64::INFINITY, Vec::new());
    for i in 0..=TIMED {
        let begun = Instant::now();
        if !solver.iterate() {
            break;
        }
        solution = solver.solution();
        if i > 0 {
            fastest = fastest.min(begun.elapsed().as_secs_f64());
        }
    }
    if solution.is_empty() {
        solution = solver.solution();
    }
    (if fastest.is_finite() { fastest } else { 0.0 }, solution)
}

/// Times of a pass over rays: with their adjoint, without them, and without the adjoint.
struct Passes {
    there_and_back: f64,
    sums: f64,
    there: f64,
}

impl Passes {
    fn measure(projector: &mut Projector, views: &[View], voxels: &[f32]) -> Self {
        let mut out = vec![0.0; voxels.len()];
        let mut pass = |views: &[View]| {
            fastest(|| {
                projector.normal(voxels, views, &mut out, |sample, depths| {
                    (f64::from(sample.weight) * mean(depths), [0.0; 2])
                });
            })
        };
        let (there_and_back, sums) = (pass(views), pass(&[]));
        let there = fastest(|| {
            projector.measure(voxels, views, |_, depths| mean(depths));
        });
        Self { there_and_back, sums, there }
    }
}

fn fastest(mut work: impl FnMut()) -> f64 {
    let mut time = || {
        let begun = Instant::now();
        work();
        begun.elapsed().as_secs_f64()
    };
    (0..TIMED).map(|_| time()).fold(f64::INFINITY, f64::min)
}

/// Leaves at most about so many rays to the views, in runs of neighbours.
fn thin(views: &mut [View], most: usize) {
    let all: usize = views.iter().map(|view| view.samples.len()).sum();
    let step = all.div_ceil(most.max(1)).max(1);
    if step > 1 {
        for view in views {
            view.samples = view.samples.chunks(RUN).step_by(step).flatten().copied().collect();
        }
    }
}
