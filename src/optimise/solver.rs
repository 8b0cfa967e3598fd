//! Non-negative least squares in optical depth: conjugate gradients, preconditioned by the smoothness
//! prior, in cycles between which negative voxels are set to zero and held there while the gradient
//! pushes them down (an active set).
//!
//! `min Σ w (A x - y)²`, `x ≥ 0`, zero outside the hull. One iteration costs one walk of all rays:
//! `⟨p, AᵀWA p⟩` and `AᵀWA p` come from the same pass.

use crate::optimise::projector::{Projector, View};
use crate::optimise::smooth::Smoother;
use rayon::prelude::*;

/// Iterations between two looks at which voxels are zero, and up to the first: it starts from a guess.
const CYCLE: u32 = 8;
const FIRST_CYCLE: u32 = 4;

/// The state of a solve: unknowns, 512 a brick.
#[derive(Debug)]
pub struct Solver<'a> {
    views: &'a [View],
    projector: &'a mut Projector,
    smoother: &'a mut Smoother,
    /// 1 where a voxel may be anything, by the hull.
    hull: Vec<f32>,
    /// The prior's weight of each voxel that is neither held at zero nor outside the hull.
    free: Vec<f32>,
    x: Vec<f32>,
    residual: Vec<f32>,
    preconditioned: Vec<f32>,
    direction: Vec<f32>,
    image: Vec<f32>,
    /// ⟨residual, preconditioned⟩, 0 before a cycle.
    power: f64,
    robust: bool,
    /// Huber's threshold on a weighted residual, infinite for least squares.
    huber: f64,
    /// Sum of the squares that are made small.
    square: f64,
    /// Iterations left of this cycle, and those of the next.
    left: u32,
    length: u32,
}

impl<'a> Solver<'a> {
    /// Starts from `x` (512 values a brick); `unknown` is the hull.
    pub fn new(
        views: &'a [View],
        projector: &'a mut Projector,
        smoother: &'a mut Smoother,
        unknown: &[bool],
        mut x: Vec<f32>,
    ) -> Self {
        let hull: Vec<f32> = unknown.iter().map(|u| f32::from(u8::from(*u))).collect();
        x.par_iter_mut().zip(&hull).for_each(|(x, h)| *x = x.max(0.0) * h);
        let zeros = vec![0.0; x.len()];
        Self {
            views,
            projector,
            smoother,
            free: hull.clone(),
            hull,
            x,
            residual: zeros.clone(),
            preconditioned: zeros.clone(),
            direction: zeros.clone(),
            image: zeros,
            power: 0.0,
            robust: false,
            huber: f64::INFINITY,
            left: 0,
            length: FIRST_CYCLE,
            square: 0.0,
        }
    }

    /// Bounds the influence of pixels whose residual is an outlier, reweighted at the start of each
    /// cycle but the first (Huber's loss by iteratively reweighted least squares).
    #[must_use]
    pub fn robust(mut self, robust: bool) -> Self {
        self.robust = robust;
        self
    }

    /// Root mean square of the weighted residuals in optical depth, as the quadratic model has it.
    pub fn loss(&self) -> f64 {
        let pixels = self.views.iter().map(|v| v.samples.len()).sum::<usize>().max(1);
        (self.square.max(0.0) / pixels as f64).sqrt()
    }

    /// The densities so far, not negative.
    pub fn densities(&self) -> Vec<f32> {
        self.x.par_iter().map(|v| v.max(0.0)).collect()
    }

    /// Evaluates a sum over pixels at the densities so far: `value(sample, depths of its rays)`.
    pub fn measure(
        &mut self,
        views: &[View],
        value: impl Fn(&crate::optimise::projector::Sample, &[f64]) -> f64 + Sync,
    ) -> f64 {
        let x = self.densities();
        self.projector.measure(&x, views, value)
    }

    /// One iteration; false once nothing is left to improve.
    pub fn iterate(&mut self) -> bool {
        if self.left == 0 {
            if !self.begin_cycle() {
                return false;
            }
            (self.left, self.length) = (self.length, CYCLE);
        }
        self.left -= 1;
        let [curvature, _] = self.projector.normal(&self.direction, self.views, &mut self.image, |s, z| {
            let z = mean(z);
            (f64::from(s.weight) * z, [f64::from(s.weight) * z * z, 0.0])
        });
        if !(curvature > 0.0 && curvature.is_finite()) {
            return false;
        }
        let length = (self.power / curvature) as f32;
        axpy(&mut self.x, length, &self.direction);
        axpy(&mut self.residual, -length, &self.image);
        self.square -= self.power * self.power / curvature;
        let before = self.power;
        self.precondition();
        if self.power.is_nan() || self.power <= 1e-12 * before {
            self.power = 0.0;
            self.left = 0;
            return true;
        }
        let ratio = (self.power / before) as f32;
        self.direction.par_iter_mut().zip(&self.preconditioned).for_each(|(d, z)| *d = z + ratio * *d);
        true
    }

    /// Projects onto the constraint, recomputes the true gradient and frees or holds voxels.
    fn begin_cycle(&mut self) -> bool {
        self.x.par_iter_mut().for_each(|x| *x = x.max(0.0));
        let huber = self.huber;
        let [spread, square] = self.projector.normal(&self.x, self.views, &mut self.residual, |s, z| {
            // A pixel is the mean of transmittances, not of depths: the difference is known from the
            // present estimate and taken off the measurement.
            let z_mean = mean(z);
            let bent = if z.len() > 1 { mean_of(z, |z| (z_mean - z).exp()).ln() } else { 0.0 };
            let miss = f64::from(s.depth) - (z_mean - bent);
            let size = f64::from(s.weight).sqrt() * miss.abs();
            let trust = if size > huber { huber / size } else { 1.0 };
            let pull = f64::from(s.weight) * trust * miss;
            (pull, [size.min(huber), pull * miss])
        });
        self.square = square;
        if self.robust {
            // Mean absolute value of a normal distribution: σ √(2/π); three σ is rare.
            let pixels = self.views.iter().map(|v| v.samples.len()).sum::<usize>().max(1);
            self.huber = 3.0 * (std::f64::consts::PI / 2.0).sqrt() * spread / pixels as f64;
        }
        self.smoother.relative(&self.x, &mut self.free);
        let (x, residual) = (&self.x, &self.residual);
        self.free.par_iter_mut().zip(&self.hull).enumerate().for_each(|(i, (f, h))| {
            *f *= if x[i] == 0.0 && residual[i] <= 0.0 { 0.0 } else { *h };
        });
        self.precondition();
        self.direction.copy_from_slice(&self.preconditioned);
        self.power > 0.0 && self.power.is_finite()
    }

    fn precondition(&mut self) {
        self.smoother.apply(&self.residual, &self.free, &mut self.preconditioned);
        self.power = dot(&self.residual, &self.preconditioned);
    }
}

/// Mean optical depth of a pixel's rays.
pub fn mean(depths: &[f64]) -> f64 {
    mean_of(depths, |z| z)
}

fn mean_of(depths: &[f64], f: impl Fn(f64) -> f64) -> f64 {
    depths.iter().map(|z| f(*z)).sum::<f64>() / depths.len() as f64
}

fn axpy(y: &mut [f32], a: f32, x: &[f32]) {
    y.par_iter_mut().zip(x).for_each(|(y, x)| *y += a * x);
}

/// Inner product in fixed blocks: the same bits for any number of threads.
fn dot(a: &[f32], b: &[f32]) -> f64 {
    let blocks: Vec<f64> = a
        .par_chunks(4096)
        .zip(b.par_chunks(4096))
        .map(|(a, b)| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum())
        .collect();
    blocks.into_iter().sum()
}
