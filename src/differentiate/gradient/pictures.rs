//! Gradients of losses that are sums over pixels, for any medium: value, loss derivative and adjoint of one ray in one
//! pass.

use crate::cancel::Cancel;
use crate::differentiate::gradient::partition::{MOST_PARTITIONS, Partitions, Parts, Tile, bricks_crossed, partitions};
use crate::ranks;
use crate::render::composited::{self, Composited};
use crate::render::differentiable::Differentiable;
use crate::render::differentiable::{self, Adjoint, ParameterGradient, RayGradient};
use crate::render::emission_absorption::EmissionAbsorption;
use crate::render::film::{self, Sampling, Subpixels};
use crate::render::order::Tiles;
use crate::render::tiles;
use crate::scene::bricks::{BRICK, Bricks, Voxel};
use crate::scene::camera::{Camera, CameraGradient};
use crate::scene::table::TableGradient;
use rayon::prelude::*;

/// A camera and its target picture.
#[derive(Debug, Clone)]
pub struct Target {
    /// Camera of the picture.
    pub camera: Camera,
    /// Target colors and alpha, row-major. Pixels that are not finite are ignored.
    pub rgba: Vec<[f32; 4]>,
    /// Rays along each edge of a pixel, whose value is the mean over the square of that number.
    pub rays_per_edge: usize,
}

/// Value and derivative of one pixel's loss, from the rendered and the target pixel.
pub(crate) type PixelLoss<'l> = &'l (dyn Fn(&[f32; 4], &[f32; 4]) -> (f64, [f32; 4]) + Sync);

/// Accumulators that gradients are added to; a gradient that is `None` is not computed.
#[derive(Debug)]
pub struct Gradients<'g, V> {
    /// Gradient with respect to the stored values, 729 a brick.
    pub voxels: Option<&'g mut [V]>,
    /// Gradient with respect to the transfer function, by piece.
    pub table: Option<&'g mut TableGradient>,
    /// Gradient with respect to the cameras, one per target.
    pub cameras: Option<&'g mut [CameraGradient]>,
    /// Gradient with respect to the quadrature's step, in voxels; computed only together with that of the cameras.
    pub step: Option<&'g mut f64>,
    /// Polled between tiles of pixels; sums of a pass that it stops are incomplete.
    pub cancel: Cancel,
}

impl<V> Default for Gradients<'_, V> {
    fn default() -> Self {
        Self { voxels: None, table: None, cameras: None, step: None, cancel: Cancel::NEVER }
    }
}

/// Memory in which gradients are accumulated, kept from call to call: voxel gradients and tapes of all partitions.
#[derive(Debug, Clone, Default)]
pub struct Workspace<V, T>(Vec<Partition<V, T>>);

/// Workspace of one partition.
#[derive(Debug, Clone, Default)]
struct Partition<V, T> {
    /// Gradient with respect to the voxels; empty for the first partition, which adds to the caller's.
    voxels: Vec<V>,
    tape: T,
}

impl Sums {
    /// Returns all numbers.
    fn numbers(&mut self) -> Vec<&mut f64> {
        let Self { table, cameras, step, shared, loss } = self;
        let table = table.iter_mut();
        let table = table.flat_map(|t| t.pieces.iter_mut().flatten().flatten().chain(&mut t.steps));
        let cameras = cameras.iter_mut().flatten();
        let cameras = cameras.flat_map(|CameraGradient { position, rotation, focal, centre }| {
            let (position, rotation): (&mut [f64; 3], &mut [f64; 3]) = (position.as_mut(), rotation.as_mut());
            let (focal, centre): (&mut [f64; 2], &mut [f64; 2]) = (focal.as_mut(), centre.as_mut());
            position.iter_mut().chain(rotation).chain(focal).chain(centre)
        });
        let shared = [&mut shared.extinction].into_iter().chain(&mut shared.color).chain(&mut shared.background);
        table.chain(cameras).chain(shared).chain([step, loss]).collect()
    }
}

/// Number of a partition, its voxel gradient if requested, and its tape.
type Work<'l, I> = (usize, Option<&'l mut [<I as Differentiable>::Voxel]>, &'l mut <I as EmissionAbsorption>::Scratch);

/// Sums of one partition, but for its voxels'.
struct Sums {
    table: Option<TableGradient>,
    cameras: Option<Vec<CameraGradient>>,
    step: f64,
    shared: ParameterGradient,
    loss: f64,
}

/// Adds the gradient of `Σ loss(rendered, target)` over all pixels of the targets to `gradients`. Returns the sum, and
/// its derivatives with respect to the parameters that all rays share. Partitions have sums of their own, which are
/// added in order: the result is bit-identical for any number of threads.
pub fn gradient<I: Differentiable<Real = f32>>(
    renderer: &Composited<I>,
    targets: &[&Target],
    loss: PixelLoss<'_>,
    adjoint: Adjoint,
    accumulators: &mut Workspace<I::Voxel, I::Scratch>,
    gradients: &mut Gradients<'_, I::Voxel>,
) -> (f64, ParameterGradient) {
    let (field, lookups) = (renderer.medium.field(), renderer.medium.lookups(gradients.table.is_some()));
    let count = partition_count(field, &lookups, targets, gradients.voxels.is_some());
    let Gradients { voxels, table, cameras, step, cancel } = gradients;
    let views: Vec<&Camera> = targets.iter().map(|t| &t.camera).collect();
    let parts = Parts::new(field, &lookups, &views, count, voxels.is_some());
    let mut own: Vec<Work<'_, I>> = accumulators.divided(count, voxels.as_deref_mut());
    let (knots, views) = (table.as_ref().map(|t| t.steps.len()), cameras.as_ref().map(|c| c.len()));
    let zero = || Sums {
        table: knots.map(TableGradient::of_knots),
        cameras: views.map(|views| vec![CameraGradient::default(); views]),
        step: 0.0,
        shared: ParameterGradient::default(),
        loss: 0.0,
    };
    let sums: Vec<Sums> = tiles::own_partitions(
        &mut own,
        cancel,
        |number| parts.tiles[number].iter(),
        |_| zero(),
        |(number, voxels, tape), sums, Tile { picture, number: tile, new }| {
            if let Some(voxels) = voxels {
                new.iter().for_each(|brick| approach(&mut voxels[*brick as usize * BRICK..][..BRICK], *number > 0));
            }
            Run {
                renderer,
                target: targets[*picture],
                number: *picture,
                tiles: &parts.pictures[*picture],
                loss,
                adjoint,
                voxels: voxels.as_deref_mut(),
                sums,
                tape,
            }
            .tile(*tile);
        },
    );
    let (mut loss, mut shared) = (0.0, ParameterGradient::default());
    for own in ranks::gathered(sums, count, zero, Sums::numbers) {
        if let (Some(total), Some(own)) = (table.as_deref_mut(), &own.table) {
            total.add(own);
        }
        if let (Some(total), Some(own)) = (cameras.as_deref_mut(), &own.cameras) {
            total.iter_mut().zip(own).for_each(|(t, o)| *t = t.plus(o));
        }
        if let Some(total) = step.as_deref_mut() {
            *total += own.step;
        }
        (loss, shared) = (loss + own.loss, shared.plus(&own.shared));
    }
    merge(own.iter_mut().filter_map(|(_, voxels, _)| voxels.as_deref_mut()), &parts.crossed_by);
    (loss, shared)
}

/// Returns the number of partitions that the pixels of all targets are divided into.
fn partition_count<V: Voxel>(field: &Bricks<V>, lookups: &[f32], targets: &[&Target], by_voxels: bool) -> usize {
    if !by_voxels {
        return MOST_PARTITIONS;
    }
    let finite = |t: &Target| t.rgba.par_iter().filter(|p| p.iter().all(|v| v.is_finite())).count();
    let rays: usize = targets.iter().map(|t| finite(t) * t.rays_per_edge.pow(2)).sum();
    let visible = lookups.iter().filter(|l| **l > 0.0);
    let mean = visible.clone().sum::<f32>() / visible.count().max(1) as f32;
    partitions(field, bricks_crossed(field, rays) * f64::from(mean), targets.len() < MOST_PARTITIONS)
}

impl<V, T> Workspace<V, T> {
    /// Returns the bytes of the voxel gradients that it holds.
    pub fn bytes(&self) -> u64 {
        self.0.iter().map(|partition| size_of_val(partition.voxels.as_slice()) as u64).sum()
    }
}

impl<V: Voxel, T: Default> Workspace<V, T> {
    /// Returns for each of `count` partitions its number, its voxel gradient (the caller's for the first) and its tape.
    fn divided<'w>(
        &'w mut self,
        count: usize,
        mut voxels: Option<&'w mut [V]>,
    ) -> Vec<(usize, Option<&'w mut [V]>, &'w mut T)> {
        let length = voxels.as_ref().map_or(0, |v| v.len());
        self.0.resize_with(count, Partition::default);
        let partitions = self.0.iter_mut().enumerate();
        partitions
            .map(|(number, Partition { voxels: own, tape })| {
                // Zeros that are not touched take no memory.
                if number > 0 && own.len() != length {
                    *own = vec![V::default(); length];
                }
                let own = (length > 0 && !own.is_empty()).then_some(&mut own[..]);
                (number, voxels.take().or(own), tape)
            })
            .collect()
    }
}

/// Adds the voxel gradients of all partitions to that of the first, in their order; `crossed_by` tells of each brick
/// which partitions have rays through it.
fn merge<'v, V: Voxel>(mut voxels: impl Iterator<Item = &'v mut [V]>, crossed_by: &[Partitions]) {
    let Some(total) = voxels.next() else { return };
    let others: Vec<&[V]> = voxels.map(|own| &*own).collect();
    let own = ranks::own(others.len() + 1);
    let others: Vec<(usize, &[V])> = (1..).zip(others).filter(|(number, _)| own.contains(number)).collect();
    ranks::added(total, BRICK, |brick, total| {
        for (_, own) in others.iter().filter(|(number, _)| crossed_by[brick] & 1 << number != 0) {
            for (t, v) in total.iter_mut().zip(&own[brick * BRICK..]) {
                *t += *v;
            }
        }
    });
}

/// Prepares a brick's gradient for a partition whose rays are about to cross it: clears it if it belongs to the
/// partition, else loads it into the cache. Done brick by brick, because recently touched memory is still cached.
fn approach<V: Voxel>(brick: &mut [V], own: bool) {
    if own {
        brick.fill(V::default());
        return;
    }
    let mut sum = V::default();
    brick.iter().step_by(64 / size_of::<V>()).for_each(|v| sum += *v);
    std::hint::black_box(sum);
}

/// Pass over the pixels of one view, for one partition.
struct Run<'a, 'v, I: Differentiable> {
    renderer: &'a Composited<I>,
    target: &'a Target,
    /// Number of the target.
    number: usize,
    tiles: &'a Tiles,
    loss: PixelLoss<'a>,
    adjoint: Adjoint,
    voxels: Option<&'v mut [I::Voxel]>,
    sums: &'a mut Sums,
    tape: &'a mut I::Scratch,
}

impl<I: Differentiable<Real = f32>> Run<'_, '_, I> {
    /// Computes radiance and gradient of the ray through an image position.
    fn ray(&mut self, [x, y]: [f64; 2], loss: composited::PixelLoss<'_, f32>) {
        let mut ray_gradient = RayGradient::default();
        let own = &mut *self.sums;
        let with_camera = own.cameras.is_some();
        let to = differentiable::Accumulators {
            voxels: self.voxels.as_deref_mut(),
            table: own.table.as_mut(),
            ray: with_camera.then_some(&mut ray_gradient),
            shared: &mut own.shared,
        };
        let camera = &self.target.camera;
        self.renderer.vjp(&camera.ray(x, y), loss, self.adjoint, to, self.tape);
        if let Some(cameras) = &mut own.cameras {
            cameras[self.number] =
                cameras[self.number].plus(&camera.gradient(x, y, ray_gradient.origin, ray_gradient.direction));
            own.step += ray_gradient.step;
        }
    }

    /// Adds losses and gradients of a tile's pixels.
    fn tile(mut self, tile: usize) {
        let Target { camera, rgba, rays_per_edge: n } = self.target;
        let (width, rays) = (camera.width as usize, Subpixels::new(*n));
        let share = 1.0 / rays.count() as f32;
        let (mut sum, loss) = (0.0, self.loss);
        let ([left, top], edge) = (self.tiles.corner(tile), self.tiles.edge);
        // All at once: far memory is waited for once, not at every ray.
        let mut all = vec![[f32::NAN; 4]; edge * edge];
        let across = edge.min(width.saturating_sub(left));
        for (row, target) in rgba.chunks(width).skip(top).zip(all.chunks_mut(edge)).filter(|_| across > 0) {
            target[..across].copy_from_slice(&row[left..left + across]);
        }
        for [x, y] in self.tiles.pixels(tile) {
            let target = &all[(y - top) * edge + x - left];
            if target.iter().any(|v| !v.is_finite()) {
                continue;
            }
            let mut loss = |rendered: &[f32; 4]| {
                let (value, cotangent) = loss(rendered, target);
                sum += value;
                cotangent
            };
            if rays.count() == 1 {
                self.ray(rays.position([x, y], 0), &mut |rendered| loss(&rendered.rgba()));
                continue;
            }
            let mean = self.renderer.mean(camera, rays, [x, y], self.tape);
            let cotangent = loss(&mean).map(|g| share * g);
            rays.positions([x, y]).for_each(|position| self.ray(position, &mut |_| cotangent));
        }
        self.sums.loss += sum;
    }
}

/// Returns the sum of squared differences of the colors over all pixels that are finite; infinite once the work is
/// cancelled.
pub fn error(renderer: &Composited<impl Differentiable<Real = f32>>, targets: &[&Target], cancel: &Cancel) -> f64 {
    let squared_error = |t: &&Target| -> f64 {
        let sampling = Sampling::grid(t.rays_per_edge);
        let Some(rendered) = film::render(renderer, &t.camera, sampling, &[], cancel) else {
            return f64::INFINITY;
        };
        let square = |(a, b): (&[f32; 4], &[f32; 4])| (0..3).map(|c| f64::from(a[c] - b[c]).powi(2)).sum::<f64>();
        let compared =
            rendered.film.rgba.iter().zip(&t.rgba).filter(|(_, target)| target.iter().all(|v| v.is_finite()));
        compared.map(square).sum()
    };
    targets.iter().map(squared_error).sum()
}
