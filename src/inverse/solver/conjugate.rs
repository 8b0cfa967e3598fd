//! Non-negative least squares: conjugate gradients, preconditioned by the smoothness prior, in cycles between which
//! negative voxels are set to zero and held there while the gradient pushes them down (an active set).
//!
//! `min Σ w (A x - y)²`, `x ≥ 0`, zero outside the hull. One iteration costs one walk of all rays:
//! `⟨p, AᵀWA p⟩` and `AᵀWA p` come from the same pass.

use crate::inverse::solver::smoother::Smoother;
use rayon::prelude::*;

/// Iterations between two updates of the set of voxels held at zero, and up to the first: it starts from a guess.
const CYCLE: u32 = 8;
const FIRST_CYCLE: u32 = 4;

/// Weighted equations `A x = y`, one a row. The unknowns are those of a field, 512 a brick, or of several
/// fields, one behind the other.
pub trait Equations {
    /// Returns the number of equations.
    fn rows(&self) -> usize;
    /// Writes `AᵀWA x` and returns `⟨x, AᵀWA x⟩`.
    fn normal(&mut self, x: &[f32], out: &mut [f32]) -> f64;
    /// Writes `AᵀW (y - A x)`, in which a row whose weighted residual `√w |y - A x|` is larger than `bound`
    /// counts as if it were that; returns the sums of `√w |y - A x|`, bounded, and of what it is squared.
    fn residual(&mut self, x: &[f32], bound: f64, out: &mut [f32]) -> [f64; 2];
    /// True once the work is to stop; what the other methods wrote is incomplete then.
    fn cancelled(&self) -> bool {
        false
    }
}

/// The state of a solve.
#[derive(Debug)]
pub struct Solver<'a, E> {
    /// Normal equations that are solved.
    pub equations: E,
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

impl<'a, E: Equations> Solver<'a, E> {
    /// Starts from `x`; `unknown` is the hull, the same for each field.
    pub fn new(equations: E, smoother: &'a mut Smoother, unknown: &[bool], mut x: Vec<f32>) -> Self {
        let hull = unknown.iter().map(|u| f32::from(u8::from(*u)));
        let hull: Vec<f32> = hull.cycle().take(x.len()).collect();
        x.par_iter_mut().zip(&hull).for_each(|(x, h)| *x = x.max(0.0) * h);
        let zeros = vec![0.0; x.len()];
        Self {
            equations,
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

    /// Begins a new cycle of that many iterations with the next one, since the equations have changed.
    pub(crate) fn begin_anew(&mut self, length: u32) {
        (self.left, self.length) = (0, length);
    }

    /// Root mean square of the weighted residuals, as the quadratic model has it.
    pub fn loss(&self) -> f64 {
        (self.square.max(0.0) / self.equations.rows().max(1) as f64).sqrt()
    }

    /// The unknowns so far, not negative.
    pub fn solution(&self) -> Vec<f32> {
        self.x.par_iter().map(|v| v.max(0.0)).collect()
    }

    /// One iteration; false once nothing is left to improve, or the work is to stop: the unknowns are those of the
    /// iteration before.
    pub fn iterate(&mut self) -> bool {
        if self.left == 0 {
            if !self.begin_cycle() {
                return false;
            }
            (self.left, self.length) = (self.length, CYCLE);
        }
        self.left -= 1;
        let curvature = self.equations.normal(&self.direction, &mut self.image);
        if self.equations.cancelled() || !(curvature > 0.0 && curvature.is_finite()) {
            return false;
        }
        let length = (self.power / curvature) as f32;
        axpy(&mut self.x, length, &self.direction);
        axpy(&mut self.residual, -length, &self.image);
        self.square -= self.power * self.power / curvature;
        let before = self.power;
        self.precondition();
        if self.equations.cancelled() {
            return false;
        }
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
        let [absolute, square] = self.equations.residual(&self.x, self.huber, &mut self.residual);
        if self.equations.cancelled() {
            return false;
        }
        self.square = square;
        if self.robust {
            // Mean absolute value of a normal distribution: σ √(2/π); three σ is rare.
            let rows = self.equations.rows().max(1) as f64;
            self.huber = 3.0 * (std::f64::consts::PI / 2.0).sqrt() * absolute / rows;
        }
        let field = self.smoother.len();
        for (x, free) in self.x.chunks(field).zip(self.free.chunks_mut(field)) {
            self.smoother.relative(x, free);
        }
        let (x, residual) = (&self.x, &self.residual);
        self.free.par_iter_mut().zip(&self.hull).enumerate().for_each(|(i, (f, h))| {
            *f *= if x[i] == 0.0 && residual[i] <= 0.0 { 0.0 } else { *h };
        });
        self.precondition();
        self.direction.copy_from_slice(&self.preconditioned);
        self.power > 0.0 && self.power.is_finite()
    }

    fn precondition(&mut self) {
        let field = self.smoother.len();
        let fields = self.residual.chunks(field).zip(self.free.chunks(field));
        for ((residual, free), out) in fields.zip(self.preconditioned.chunks_mut(field)) {
            self.smoother.apply(residual, free, out);
        }
        self.power = dot(&self.residual, &self.preconditioned);
    }
}

fn axpy(y: &mut [f32], a: f32, x: &[f32]) {
    y.par_iter_mut().zip(x).for_each(|(y, x)| *y += a * x);
}

/// Inner product in fixed blocks: the same bits for any number of threads.
pub(super) fn dot(a: &[f32], b: &[f32]) -> f64 {
    let blocks: Vec<f64> = a
        .par_chunks(4096)
        .zip(b.par_chunks(4096))
        .map(|(a, b)| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum())
        .collect();
    blocks.into_iter().sum()
}
