//! Gradients of losses that are sums over pixels, for any medium: value, loss derivative and adjoint
//! of one ray in one go.

use crate::optimise::parts::{Parts, Tile};
use crate::render::dvr::{Adjoint, Dvr, Loss, ParameterGradient, RayGradient, Sinks, Tape};
use crate::render::order::Tiles;
use crate::scene::bricks::{BRICK, Bricks, Voxel};
use crate::scene::camera::{Camera, CameraGradient};
use crate::scene::table::TableGradient;
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

/// Value and derivative of one pixel's loss: what is seen, what should be.
pub type PixelLoss<'l> = &'l (dyn Fn(&[f32; 4], &[f32; 4]) -> (f64, [f32; 4]) + Sync);

/// What gradients are added to; what is `None` is not computed.
#[derive(Debug, Default)]
pub struct Gradients<'g> {
    /// By stored value, 729 a brick.
    pub voxels: Option<&'g mut [f32]>,
    /// By piece of the transfer function.
    pub table: Option<&'g mut TableGradient>,
    /// By camera, one a target.
    pub cameras: Option<&'g mut [CameraGradient]>,
    /// By the quadrature's step, in voxels.
    pub step: Option<&'g mut f64>,
}

/// Memory that gradients are summed up in, kept from call to call.
#[derive(Debug, Clone, Default)]
pub struct Accumulators(Vec<Lane>);

/// Its share of one lane.
#[derive(Debug, Clone, Default)]
struct Lane {
    voxels: Vec<f32>,
    table: Option<TableGradient>,
    cameras: Option<Vec<CameraGradient>>,
    step: f64,
    tape: Tape<f32>,
}

impl Lane {
    /// Makes room for what is wanted: zeros, but for voxels, which have them when a brick is first looked at.
    fn clear(&mut self, dvr: &Dvr<'_, f32>, wanted: &Gradients<'_>) {
        let voxels = if wanted.voxels.is_some() { dvr.field().values.len() } else { 0 };
        if self.voxels.len() != voxels {
            self.voxels = vec![0.0; voxels];
        }
        self.table = wanted.table.as_ref().map(|t| TableGradient::of_knots(t.steps.len()));
        self.cameras = wanted.cameras.as_ref().map(|c| vec![CameraGradient::default(); c.len()]);
        self.step = 0.0;
    }
}

/// Adds the gradient of `Σ loss(seen, target)` over all pixels of the targets to `gradients` and returns
/// the sum. `loss` gives value and derivative per pixel. Accumulators are per lane and added in order:
/// the same bits for any number of threads.
pub fn gradient(
    dvr: &Dvr<'_, f32>,
    targets: &[&Target],
    loss: PixelLoss<'_>,
    adjoint: Adjoint,
    accumulators: &mut Accumulators,
    gradients: &mut Gradients<'_>,
) -> (f64, ParameterGradient) {
    let count = match gradients.voxels {
        Some(_) => lanes(dvr.field(), targets.iter().map(|t| t.rgba.len()).sum(), targets.len() < MOST_LANES),
        None => MOST_LANES,
    };
    let lanes = &mut accumulators.0;
    lanes.resize_with(count, Lane::default);
    let wanted = &*gradients;
    let cameras: Vec<&Camera> = targets.iter().map(|t| &t.camera).collect();
    let lookups = dvr.lookups(wanted.table.is_some());
    let parts = Parts::new(dvr.field(), &lookups, &cameras, count, wanted.voxels.is_some());
    let sums: Vec<(f64, ParameterGradient)> = lanes
        .par_iter_mut()
        .zip(&parts.tiles)
        // One at a time: some may be through long before others.
        .with_max_len(1)
        .map(|(own, tiles)| {
            let mut tape = std::mem::take(&mut own.tape);
            let (mut sum, mut shared) = (0.0, ParameterGradient::default());
            own.clear(dvr, wanted);
            for Tile { picture, number, new } in tiles {
                if wanted.voxels.is_some() {
                    // Now, not all at once: they are near when rays come to them.
                    new.iter().for_each(|brick| own.voxels[*brick as usize * BRICK..][..BRICK].fill(0.0));
                }
                let (shared, tape) = (&mut shared, &mut tape);
                let run = Run { dvr, target: targets[*picture], number: *picture, loss, adjoint, own, shared, tape };
                sum += run.loss(*number);
            }
            own.tape = tape;
            (sum, shared)
        })
        .collect();
    if let Some(voxels) = gradients.voxels.as_deref_mut() {
        voxels.par_chunks_mut(BRICK).zip(&parts.seen_by).enumerate().for_each(|(i, (total, seen_by))| {
            for (_, own) in lanes.iter().enumerate().filter(|(lane, _)| seen_by & 1 << lane != 0) {
                for (t, v) in total.iter_mut().zip(&own.voxels[i * BRICK..]) {
                    *t += v;
                }
            }
        });
    }
    for own in lanes {
        if let (Some(total), Some(own)) = (gradients.table.as_deref_mut(), &own.table) {
            total.add(own);
        }
        if let (Some(total), Some(own)) = (gradients.cameras.as_deref_mut(), &own.cameras) {
            total.iter_mut().zip(own).for_each(|(t, o)| *t = t.plus(o));
        }
        if let Some(total) = gradients.step.as_deref_mut() {
            *total += own.step;
        }
    }
    sums.iter().fold((0.0, ParameterGradient::default()), |(sum, shared), (s, p)| (sum + s, shared.plus(p)))
}

/// What goes through the pixels of one view.
struct Run<'a, 'd> {
    dvr: &'a Dvr<'d, f32>,
    target: &'a Target,
    /// The target's.
    number: usize,
    loss: PixelLoss<'a>,
    adjoint: Adjoint,
    own: &'a mut Lane,
    shared: &'a mut ParameterGradient,
    tape: &'a mut Tape<f32>,
}

impl Run<'_, '_> {
    /// Radiance and gradient of the ray through an image position.
    fn ray(&mut self, [x, y]: [f64; 2], slope: Loss<'_, f32>) {
        let mut moved = RayGradient::default();
        let own = &mut *self.own;
        let follow = own.cameras.is_some();
        let sinks = Sinks {
            voxels: (!own.voxels.is_empty()).then_some(&mut own.voxels),
            table: own.table.as_mut(),
            ray: follow.then_some(&mut moved),
            shared: self.shared,
        };
        let camera = &self.target.camera;
        self.dvr.gradient(&camera.ray(x, y), slope, self.adjoint, sinks, self.tape);
        if let Some(cameras) = &mut own.cameras {
            cameras[self.number] = cameras[self.number].plus(&camera.gradient(x, y, moved.origin, moved.direction));
            own.step += moved.step;
        }
    }

    /// Adds the gradients of a tile's pixels; returns the sum of their losses.
    fn loss(mut self, tile: usize) -> f64 {
        let Target { camera, rgba, rays_per_edge: n } = self.target;
        let (width, share) = (camera.width as usize, 1.0 / (n * n) as f32);
        let (mut sum, loss) = (0.0, self.loss);
        let pixels = Tiles::new(width, camera.height as usize).pixels(tile);
        for i in pixels.filter(|i| rgba[*i].iter().all(|v| v.is_finite())) {
            let position = |k: usize| {
                let offset = |k: usize| (k as f64 + 0.5) / *n as f64;
                [(i % width) as f64 + offset(k % n), (i / width) as f64 + offset(k / n)]
            };
            let mut loss = |seen: &[f32; 4]| {
                let (value, slope) = loss(seen, &rgba[i]);
                sum += value;
                slope
            };
            if *n == 1 {
                self.ray(position(0), &mut |seen| loss(&seen.rgba()));
                continue;
            }
            let mut mean = [0.0; 4];
            for k in 0..n * n {
                let [x, y] = position(k);
                let seen = self.dvr.radiance_on(&camera.ray(x, y), self.tape).rgba();
                mean.iter_mut().zip(seen).for_each(|(m, v)| *m += share * v);
            }
            let slope = loss(&mean).map(|g| share * g);
            for k in 0..n * n {
                self.ray(position(k), &mut |_| slope);
            }
        }
        sum
    }
}

/// The most accumulators.
const MOST_LANES: usize = 16;

/// Accumulators for so many rays through a field: as many as pay (each is cleared and added up, which
/// must cost less than the rays do) and as fit in memory, from 2 to 16. Those `apart` see a part of the field each.
pub fn lanes<V: Voxel>(field: &Bricks<V>, rays: usize, apart: bool) -> usize {
    let values = field.values.len().max(1);
    // A ray through the whole of a cube of bricks crosses about one and a half cells a voxel.
    let cells = rays as f64 * 12.0 * (field.topology.len() as f64).cbrt();
    let pays = cells / values as f64;
    // Together they see the field, and what lies between them twice: that grows with their borders.
    let pays = if apart { pays.max(3.0 * pays.sqrt()) } else { pays };
    let fits = (256 << 20) / (values * size_of::<V>());
    // A power of two: as many for each of two, four or eight threads.
    1 << (pays as usize).min(fits).clamp(2, MOST_LANES).ilog2()
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
