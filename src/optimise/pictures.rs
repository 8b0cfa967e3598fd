//! Gradients of losses that are sums over pixels, for any medium: value, loss derivative and adjoint
//! of one ray in one go.

use crate::optimise::footprint::{Footprints, Rectangle};
use crate::render::dvr::{Adjoint, Dvr, Loss, ParameterGradient, RayGradient, Sinks, Tape};
use crate::render::order;
use crate::scene::bricks::{BRICK, Bricks, Voxel};
use crate::scene::camera::{Camera, CameraGradient};
use crate::scene::table::TableGradient;
use rayon::prelude::*;
use std::ops::Range;

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

impl Target {
    /// Width and height.
    fn size(&self) -> [usize; 2] {
        [self.camera.width, self.camera.height].map(|n| n as usize)
    }
}

/// Value and derivative of one pixel's loss: what is seen, what should be.
pub type PixelLoss<'l> = &'l (dyn Fn(&[f32; 4], &[f32; 4]) -> (f64, [f32; 4]) + Sync);

/// Pixels handled in one go.
const RUN: usize = 512;

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
    /// By brick of the field, whether its rays can look at it.
    looked_at: Vec<bool>,
    voxels: Option<Vec<f32>>,
    table: Option<TableGradient>,
    cameras: Option<Vec<CameraGradient>>,
    step: f64,
    tape: Tape<f32>,
}

impl Lane {
    /// Zeros for what is wanted, in the bricks that its rays can look at: in others nothing is touched.
    fn clear(&mut self, dvr: &Dvr<'_, f32>, wanted: &Gradients<'_>) {
        self.voxels = wanted.voxels.is_some().then(|| match self.voxels.take() {
            Some(mut voxels) if voxels.len() == dvr.field().values.len() => {
                let bricks = voxels.chunks_mut(BRICK).zip(&self.looked_at);
                bricks.filter(|(_, looked_at)| **looked_at).for_each(|(brick, _)| brick.fill(0.0));
                voxels
            }
            _ => vec![0.0; dvr.field().values.len()],
        });
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
    let runs: Vec<(usize, Range<usize>)> = (0..targets.len())
        .flat_map(|number| {
            let [width, height] = targets[number].size();
            let length = order::length(width, height);
            (0..length).step_by(RUN).map(move |from| (number, from..length.min(from + RUN)))
        })
        .collect();
    let count = match gradients.voxels {
        Some(_) => {
            // Parts of one picture look at parts of the field: more of them pay.
            let parts = (MOST_LANES / 4 / targets.len().max(1)).max(1);
            lanes(dvr.field(), parts * targets.iter().map(|t| t.rgba.len()).sum::<usize>())
        }
        None => MOST_LANES,
    };
    let lanes = &mut accumulators.0;
    lanes.resize_with(count, Lane::default);
    let wanted = &*gradients;
    let seen = Seen::new(dvr, targets, count, wanted);
    let parts: Vec<(f64, ParameterGradient)> = lanes
        .par_iter_mut()
        .enumerate()
        // One at a time: the first ones may see nothing and the last ones all.
        .with_max_len(1)
        .map(|(lane, own)| {
            let mut tape = std::mem::take(&mut own.tape);
            let (mut sum, mut shared) = (0.0, ParameterGradient::default());
            let ours = &runs[lane * runs.len() / count..(lane + 1) * runs.len() / count];
            own.looked_at = seen.by(targets, ours);
            own.clear(dvr, wanted);
            for (number, stretch) in ours {
                let (number, stretch) = (*number, stretch.clone());
                let (shared, tape) = (&mut shared, &mut tape);
                let run = Run { dvr, target: targets[number], number, stretch, loss, adjoint, own, shared, tape };
                sum += run.loss();
            }
            own.tape = tape;
            (sum, shared)
        })
        .collect();
    if let Some(voxels) = gradients.voxels.as_deref_mut() {
        voxels.par_chunks_mut(BRICK).enumerate().for_each(|(i, total)| {
            for own in lanes.iter().filter(|lane| lane.looked_at[i]).filter_map(|lane| lane.voxels.as_ref()) {
                for (t, v) in total.iter_mut().zip(&own[i * BRICK..]) {
                    *t += v;
                }
            }
        });
    }
    for lane in lanes {
        if let (Some(total), Some(own)) = (gradients.table.as_deref_mut(), &lane.table) {
            total.add(own);
        }
        if let (Some(total), Some(own)) = (gradients.cameras.as_deref_mut(), &lane.cameras) {
            total.iter_mut().zip(own).for_each(|(t, o)| *t = t.plus(o));
        }
        if let Some(total) = gradients.step.as_deref_mut() {
            *total += lane.step;
        }
    }
    parts.iter().fold((0.0, ParameterGradient::default()), |(sum, shared), (s, p)| (sum + s, shared.plus(p)))
}

/// Which bricks rays look at.
struct Seen {
    /// All rays together.
    looked_at: Vec<bool>,
    /// By target, if lanes have a part of a picture each; those of whole pictures are not worth the while.
    footprints: Option<Vec<Footprints>>,
}

impl Seen {
    fn new(dvr: &Dvr<'_, f32>, targets: &[&Target], lanes: usize, wanted: &Gradients<'_>) -> Self {
        let field = dvr.field();
        let of = |target: &&Target| Footprints::new(&target.camera, &field.transform, field.topology.bricks());
        let parted = wanted.voxels.is_some() && targets.len() < lanes;
        Self {
            looked_at: dvr.looked_at(wanted.table.is_some()),
            footprints: parted.then(|| targets.iter().map(of).collect()),
        }
    }

    /// By brick, whether these runs' rays can look at it.
    fn by(&self, targets: &[&Target], runs: &[(usize, Range<usize>)]) -> Vec<bool> {
        let Some(footprints) = &self.footprints else { return self.looked_at.clone() };
        let rectangles: Vec<(usize, Rectangle)> = runs
            .chunk_by(|a, b| a.0 == b.0)
            .map(|part| {
                let (number, [width, height]) = (part[0].0, targets[part[0].0].size());
                (number, order::bounds(width, height, part[0].1.start..part[part.len() - 1].1.end))
            })
            .collect();
        let meets = |i: usize| rectangles.iter().any(|(number, part)| footprints[*number].meets(i, *part));
        self.looked_at.iter().enumerate().map(|(i, looked_at)| *looked_at && meets(i)).collect()
    }
}

/// Neighbouring pixels of one view.
struct Run<'a, 'd> {
    dvr: &'a Dvr<'d, f32>,
    target: &'a Target,
    /// The target's.
    number: usize,
    /// Of its pixels' order.
    stretch: Range<usize>,
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
            voxels: own.voxels.as_deref_mut(),
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

    /// Adds all pixels' gradients; returns the sum of their losses.
    fn loss(mut self) -> f64 {
        let Target { camera, rgba, rays_per_edge: n } = self.target;
        let ([width, height], share) = (self.target.size(), 1.0 / (n * n) as f32);
        let (mut sum, loss) = (0.0, self.loss);
        let pixels = order::stretch(width, height, self.stretch.clone());
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
/// must cost less than the rays do) and as fit in memory, from 2 to 16.
pub fn lanes<V: Voxel>(field: &Bricks<V>, rays: usize) -> usize {
    let values = field.values.len().max(1);
    // A ray through the whole of a cube of bricks crosses about one and a half cells a voxel.
    let cells = rays as f64 * 12.0 * (field.topology.len() as f64).cbrt();
    let pays = (cells / values as f64) as usize;
    let fits = (256 << 20) / (values * size_of::<V>());
    // A power of two: as many for each of two, four or eight threads.
    1 << pays.min(fits).clamp(2, MOST_LANES).ilog2()
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
