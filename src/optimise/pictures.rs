//! Gradients of losses that are sums over pixels, for any medium: value, loss derivative and adjoint
//! of one ray in one go.

use crate::render::dvr::{Adjoint, Dvr, ParameterGradient, Radiance, Tape};
use crate::render::order::morton;
use crate::scene::bricks::{BRICK, Bricks};
use crate::scene::camera::Camera;
use rayon::prelude::*;

/// A camera and the colours and alpha it should see.
#[derive(Debug, Clone)]
pub struct Target {
    /// Where it was taken from.
    pub camera: Camera,
    /// Row-major. Pixels that are not finite ask for nothing.
    pub rgba: Vec<[f32; 4]>,
    /// A pixel is the mean over the square of so many rays.
    pub rays_per_edge: usize,
}

/// Pixels handled in one go.
const RUN: usize = 1024;

/// Memory that gradients are summed up in, kept from call to call.
#[derive(Debug, Clone, Default)]
pub struct Accumulators(Vec<Vec<f32>>);

/// Adds the gradient of `Σ loss(seen, target)` over all pixels of the targets to `gradient` (stored
/// values, 729 a brick) and returns the sum. `loss` gives value and derivative per pixel. Accumulators
/// are per lane and added in order: the same bits for any number of threads.
pub fn gradient(
    dvr: &Dvr<'_, f32>,
    targets: &[&Target],
    loss: impl Fn(&[f32; 4], &[f32; 4]) -> (f64, [f32; 4]) + Sync,
    adjoint: Adjoint,
    accumulators: &mut Accumulators,
    gradient: &mut [f32],
) -> (f64, ParameterGradient) {
    let orders: Vec<Vec<usize>> =
        targets.iter().map(|t| morton(t.camera.width as usize, t.camera.height as usize).collect()).collect();
    let runs: Vec<(&Target, &[usize])> =
        targets.iter().zip(&orders).flat_map(|(t, order)| order.chunks(RUN).map(move |pixels| (*t, pixels))).collect();
    let count = lanes(dvr.field(), targets.iter().map(|t| t.rgba.len()).sum());
    let arch = pulp::Arch::new();
    let lanes = &mut accumulators.0;
    lanes.resize_with(count, Vec::new);
    let parts: Vec<(f64, ParameterGradient)> = lanes
        .par_iter_mut()
        .enumerate()
        .map(|(lane, own)| {
            let mut tape = Tape::default();
            let (mut sum, mut shared) = (0.0, ParameterGradient::default());
            own.clear();
            own.resize(dvr.field().values.len(), 0.0);
            for (target, pixels) in runs.iter().skip(lane).step_by(count) {
                let (loss, gradient, shared, tape) = (&loss, &mut own[..], &mut shared, &mut tape);
                sum += arch.dispatch(Run { dvr, target, pixels, loss, adjoint, gradient, shared, tape });
            }
            (sum, shared)
        })
        .collect();
    gradient.par_chunks_mut(BRICK).enumerate().for_each(|(i, total)| {
        for lane in lanes.iter() {
            for (t, v) in total.iter_mut().zip(&lane[i * BRICK..]) {
                *t += v;
            }
        }
    });
    parts.iter().fold((0.0, ParameterGradient::default()), |(sum, shared), (s, p)| (sum + s, shared.plus(p)))
}

/// Neighbouring pixels of one view: the unit that is compiled once for each instruction set.
struct Run<'a, 'd, F> {
    dvr: &'a Dvr<'d, f32>,
    target: &'a Target,
    pixels: &'a [usize],
    loss: &'a F,
    adjoint: Adjoint,
    gradient: &'a mut [f32],
    shared: &'a mut ParameterGradient,
    tape: &'a mut Tape<f32>,
}

impl<F: Fn(&[f32; 4], &[f32; 4]) -> (f64, [f32; 4])> pulp::NullaryFnOnce for Run<'_, '_, F> {
    type Output = f64;

    #[inline(always)]
    fn call(self) -> f64 {
        let Target { camera, rgba, rays_per_edge: n } = self.target;
        let (width, share) = (camera.width as usize, 1.0 / (n * n) as f32);
        let mut sum = 0.0;
        let asked = self.pixels.iter().filter(|i| rgba[**i].iter().all(|v| v.is_finite()));
        for &i in asked {
            let ray = |k: usize| {
                let offset = |k: usize| (k as f64 + 0.5) / *n as f64;
                camera.ray((i % width) as f64 + offset(k % n), (i / width) as f64 + offset(k / n))
            };
            let mut loss = |seen: &[f32; 4]| {
                let (value, slope) = (self.loss)(seen, &rgba[i]);
                sum += value;
                slope
            };
            if *n == 1 {
                let slope = |seen: &Radiance<f32>| loss(&seen.rgba());
                self.dvr.gradient(&ray(0), slope, self.adjoint, self.gradient, self.shared, self.tape);
                continue;
            }
            let mut mean = [0.0; 4];
            for k in 0..n * n {
                let seen = self.dvr.radiance_with(&ray(k), self.tape).rgba();
                mean.iter_mut().zip(seen).for_each(|(m, v)| *m += share * v);
            }
            let slope = loss(&mean).map(|g| share * g);
            for k in 0..n * n {
                self.dvr.gradient(&ray(k), |_| slope, self.adjoint, self.gradient, self.shared, self.tape);
            }
        }
        sum
    }
}

/// Accumulators for so many rays through a field: as many as pay (each is cleared and added up, which
/// must cost less than the rays do) and as fit in memory, from 2 to 16.
pub fn lanes(field: &Bricks<f32>, rays: usize) -> usize {
    let values = field.values.len().max(1);
    // A ray through the whole of a cube of bricks crosses about one and a half cells a voxel.
    let cells = rays as f64 * 12.0 * (field.topology.len() as f64).cbrt();
    let pays = (cells / values as f64) as usize;
    let fits = (256 << 20) / (values * size_of::<f32>());
    // A power of two: as many for each of two, four or eight threads.
    1 << pays.min(fits).clamp(2, 16).ilog2()
}

/// Sum of squared differences of the colours over all pixels that are finite.
pub fn error(dvr: &Dvr<'_, f32>, targets: &[&Target]) -> f64 {
    let cancel = std::sync::atomic::AtomicBool::new(false);
    let of = |t: &&Target| -> f64 {
        let Some(film) = crate::render::picture(dvr, &t.camera, t.rays_per_edge, &cancel) else { return f64::INFINITY };
        let square = |(a, b): (&[f32; 4], &[f32; 4])| (0..3).map(|c| f64::from(a[c] - b[c]).powi(2)).sum::<f64>();
        let asked = film.rgba.iter().zip(&t.rgba).filter(|(_, wanted)| wanted.iter().all(|v| v.is_finite()));
        asked.map(square).sum()
    };
    targets.iter().map(of).sum()
}
