//! Pictures from several cameras as a function of all that they depend on, whatever is made of them: their values, and
//! the products of their Jacobian with vectors from the left (reverse mode) and from the right (forward mode).

use crate::cancel::Cancel;
use crate::differentiate::loss::Rgba;
use crate::dual::Dual;
use crate::real::Real;
use crate::render::composited::{Composited, Pixel};
use crate::render::differentiable::{
    Accumulators, Adjoint, Differentiable, Forward, ParameterGradient, RayGradient, Seeds,
};
use crate::render::film::Subpixels;
use crate::render::tiles;
use crate::scene::camera::{Camera, CameraGradient};
use crate::scene::table::TableGradient;
use rayon::prelude::*;
use std::ops::Range;

/// Pictures of cameras, row-major.
#[derive(Debug, Clone, Copy)]
pub struct Views<'v> {
    /// Cameras of the pictures.
    pub cameras: &'v [Camera],
    /// Rays along each edge of a pixel, whose value is the mean over the square of that number.
    pub rays_per_edge: usize,
    /// Polled between runs of pixels.
    pub cancel: &'v Cancel,
}

/// Parameters to differentiate with respect to, besides extinction, color and background, which cost nothing.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ActiveParameters {
    /// True for the stored voxels.
    pub voxels: bool,
    /// Number of knots of the transfer function, for derivatives with respect to it.
    pub knots: Option<usize>,
    /// True for cameras and the quadrature's step.
    pub rays: bool,
}

/// Value and gradient of an objective.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Gradient<V> {
    /// Value of the objective.
    pub value: f64,
    /// Derivatives with respect to the stored voxels, 729 a brick; empty if not requested.
    pub voxels: Vec<V>,
    /// Derivatives with respect to the transfer function, by piece.
    pub table: TableGradient,
    /// Derivatives with respect to each camera.
    pub cameras: Vec<CameraGradient>,
    /// Derivative with respect to the quadrature's step, in voxels.
    pub step: f64,
    /// Derivatives with respect to the parameters that all rays share.
    pub shared: ParameterGradient,
}

/// A direction in which one kind of parameter changes.
#[derive(Debug, Clone, PartialEq)]
pub enum Direction<V> {
    /// Change of a camera, given by its number.
    Camera(usize, CameraGradient),
    /// Change of the quadrature's step, in voxels.
    Step(f64),
    /// Change of the parameters that all rays share.
    Shared(ParameterGradient),
    /// Change of the transfer function's pieces.
    Table(TableGradient),
    /// Change of the stored voxels, 729 a brick.
    Voxels(Vec<V>),
}

/// A renderer with forward mode in all numbers of directions that are compiled.
pub trait ForwardInAll: Forward<1> + Forward<2> + Forward<6> + Forward<7> {}
impl<I: Forward<1> + Forward<2> + Forward<6> + Forward<7>> ForwardInAll for I {}

/// Pixels processed in one run.
pub(super) const RUN: usize = 256;
/// Number of gradient accumulators, for any number of threads; they are added in order.
const PARTS: usize = 4;

/// Derivatives of a pixel's loss, from its value; or those that are known already.
pub(super) enum Cotangent<'l, R> {
    /// Derivatives with respect to the mean over the pixel's rays.
    Known(Rgba),
    /// Derivatives that follow from the only ray of the pixel.
    Of(&'l mut dyn FnMut(&Pixel<R>) -> [R; 4]),
}

impl Views<'_> {
    /// Returns the pictures of all cameras; `None` if the work was cancelled.
    pub fn render<I: Differentiable>(&self, renderer: &Composited<I>) -> Option<Vec<Vec<Rgba>>> {
        (0..self.cameras.len()).map(|view| self.picture(renderer, view)).collect()
    }

    /// Renders the picture of a camera; `None` if the work was cancelled.
    pub(super) fn picture<I: Differentiable>(&self, renderer: &Composited<I>, view: usize) -> Option<Vec<Rgba>> {
        self.each_pixel(view, I::Scratch::default, |tape, i| self.pixel(renderer, (view, i), tape))
    }

    /// Returns the derivatives of a loss with respect to what pictures depend on, from those with respect to the
    /// pictures, one per camera; `None` if the work was cancelled. The value of the loss is not known here, and 0.
    pub fn vjp<I: Differentiable>(
        &self,
        renderer: &Composited<I>,
        cotangents: &[Vec<Rgba>],
        adjoint: Adjoint,
        active: ActiveParameters,
    ) -> Option<Gradient<I::Voxel>> {
        let total = self.accumulate(renderer, active, |view, i, own, tape| {
            let cotangent = Cotangent::Known(cotangents[view][i]);
            self.pixel_reverse(renderer, (adjoint, active), (view, i), cotangent, own, tape);
        });
        (!self.cancel.requested()).then_some(total)
    }

    /// Returns the change of the pictures when the parameters change along all directions at once; `None` if the work
    /// was cancelled.
    pub fn jvp<I: ForwardInAll>(
        &self,
        renderer: &Composited<I>,
        directions: &[Direction<I::Voxel>],
    ) -> Option<Vec<Vec<Rgba>>> {
        let of = |view: usize| {
            let mut sum = vec![[0.0; 4]; self.pixels(view)];
            let mut left = directions;
            while !left.is_empty() {
                let (now, later) = left.split_at(left.len().min(7));
                let changes = match now.len() {
                    1 => self.changes::<I, 1>(renderer, now, view),
                    2 => self.changes::<I, 2>(renderer, now, view),
                    3..=6 => self.changes::<I, 6>(renderer, now, view),
                    _ => self.changes::<I, 7>(renderer, now, view),
                }?;
                sum.iter_mut().zip(changes).for_each(|(sum, by)| (0..4).for_each(|c| sum[c] += by[c]));
                left = later;
            }
            Some(sum)
        };
        (0..self.cameras.len()).map(of).collect()
    }

    fn changes<I: Forward<P>, const P: usize>(
        &self,
        renderer: &Composited<I>,
        directions: &[Direction<I::Voxel>],
        view: usize,
    ) -> Option<Vec<Rgba>> {
        self.each_pixel(view, I::Scratch::default, |tape, i| {
            let pixel = self.pixel_forward::<I, P>(renderer, directions, (view, i), tape);
            pixel.map(|channel| channel.tangent.iter().sum())
        })
    }

    /// Adds up the gradients of all pixels of all views: `add(view, pixel, sum, scratch)` adds that of one.
    pub(super) fn accumulate<I: Differentiable>(
        &self,
        renderer: &Composited<I>,
        active: ActiveParameters,
        add: impl Fn(usize, usize, &mut Gradient<I::Voxel>, &mut I::Scratch) + Sync,
    ) -> Gradient<I::Voxel> {
        let zero = || Gradient {
            voxels: if active.voxels {
                vec![I::Voxel::default(); renderer.medium.field().values.len()]
            } else {
                Vec::new()
            },
            table: active.knots.map_or_else(TableGradient::default, TableGradient::of_knots),
            cameras: vec![CameraGradient::default(); self.cameras.len()],
            ..Gradient::default()
        };
        let mut parts: Vec<Gradient<I::Voxel>> = (0..PARTS).map(|_| zero()).collect();
        for view in 0..self.cameras.len() {
            let runs = tiles::runs(self.pixels(view), RUN);
            tiles::partitions(
                &mut parts,
                self.cancel,
                |part| tiles::dealt(&runs, part, PARTS),
                |_| I::Scratch::default(),
                |own, tape, run| run.clone().for_each(|i| add(view, i, own, tape)),
            );
        }
        let mut total = zero();
        for part in parts {
            total.value += part.value;
            total.voxels.par_iter_mut().zip(part.voxels).for_each(|(t, v)| *t += v);
            total.table.add(&part.table);
            total.cameras.iter_mut().zip(&part.cameras).for_each(|(t, c)| *t = t.plus(c));
            total.step += part.step;
            total.shared = total.shared.plus(&part.shared);
        }
        total
    }

    /// Adds the derivatives of one pixel to a gradient.
    pub(super) fn pixel_reverse<I: Differentiable>(
        &self,
        renderer: &Composited<I>,
        (adjoint, active): (Adjoint, ActiveParameters),
        (view, i): (usize, usize),
        mut cotangent: Cotangent<'_, I::Real>,
        own: &mut Gradient<I::Voxel>,
        tape: &mut I::Scratch,
    ) {
        let (rays, share) = (self.positions(view, i), self.share());
        for [x, y] in rays {
            let mut ray_gradient = RayGradient::default();
            let to = Accumulators {
                voxels: active.voxels.then_some(&mut own.voxels),
                table: active.knots.is_some().then_some(&mut own.table),
                ray: active.rays.then_some(&mut ray_gradient),
                shared: &mut own.shared,
            };
            let camera = &self.cameras[view];
            let mut loss = |rendered: &Pixel<I::Real>| match &mut cotangent {
                Cotangent::Known(cotangent) => cotangent.map(|s| I::Real::of(share * s)),
                Cotangent::Of(loss) => loss(rendered),
            };
            renderer.vjp(&camera.ray(x, y), &mut loss, adjoint, to, tape);
            if active.rays {
                let by_camera = camera.gradient(x, y, ray_gradient.origin, ray_gradient.direction);
                own.cameras[view] = own.cameras[view].plus(&by_camera);
                own.step += ray_gradient.step;
            }
        }
    }

    /// Returns one pixel with its derivatives along the directions.
    pub(super) fn pixel_forward<I: Forward<P>, const P: usize>(
        &self,
        renderer: &Composited<I>,
        directions: &[Direction<I::Voxel>],
        (view, i): (usize, usize),
        tape: &mut I::Scratch,
    ) -> [Dual<f64, P>; 4] {
        let (rays, share) = (self.positions(view, i), self.share());
        let camera = &self.cameras[view];
        let mut mean = [Dual::<f64, P>::constant(0.0); 4];
        for [x, y] in rays {
            let mut seeds: Seeds<'_, I::Voxel, P> = Seeds::default();
            for (p, direction) in directions.iter().enumerate() {
                match direction {
                    Direction::Camera(number, change) if *number == view => {
                        let ray = camera.tangent(x, y, change);
                        seeds.ray[p] = RayGradient { origin: ray.origin, direction: ray.direction, step: 0.0 };
                    }
                    Direction::Camera(..) => {}
                    Direction::Step(change) => seeds.ray[p].step = *change,
                    Direction::Shared(change) => seeds.shared[p] = *change,
                    Direction::Table(change) => seeds.table[p] = Some(change),
                    Direction::Voxels(change) => seeds.voxels[p] = Some(change),
                }
            }
            let rendered = renderer.jvp(&camera.ray(x, y), &seeds, tape).rgba();
            (0..4).for_each(|c| mean[c] = mean[c] + rendered[c].f64().linear(|v| share * v));
        }
        mean
    }

    /// Computes a value for each pixel of a view, by its row-major number; `None` if the work was cancelled.
    pub(super) fn each_pixel<S, T: Send>(
        &self,
        view: usize,
        scratch: impl Fn() -> S + Sync + Send,
        pixel: impl Fn(&mut S, usize) -> T + Sync + Send,
    ) -> Option<Vec<T>> {
        let run = |scratch: &mut S, run: &Range<usize>| run.clone().map(|i| pixel(scratch, i)).collect::<Vec<T>>();
        let runs = tiles::map(&tiles::runs(self.pixels(view), RUN), self.cancel, scratch, run)?;
        Some(runs.into_iter().flatten().collect())
    }

    /// Returns the mean over a pixel's rays.
    pub(super) fn pixel<I: Differentiable>(
        &self,
        renderer: &Composited<I>,
        (view, i): (usize, usize),
        tape: &mut I::Scratch,
    ) -> Rgba {
        let (rays, share) = (self.positions(view, i), self.share());
        let mut mean = [0.0; 4];
        for [x, y] in rays {
            let pixel = renderer.pixel_on(&self.cameras[view].ray(x, y), tape).rgba();
            (0..4).for_each(|c| mean[c] += share * pixel[c].f64());
        }
        mean
    }

    /// Returns the image positions of a pixel's rays.
    fn positions(&self, view: usize, i: usize) -> impl Iterator<Item = [f64; 2]> + use<> {
        let width = self.width(view);
        Subpixels::new(self.rays_per_edge).positions([i % width, i / width])
    }

    /// Returns the weight of one ray in its pixel.
    fn share(&self) -> f64 {
        1.0 / Subpixels::new(self.rays_per_edge).count() as f64
    }

    pub(super) fn width(&self, view: usize) -> usize {
        self.cameras[view].width as usize
    }

    pub(super) fn pixels(&self, view: usize) -> usize {
        self.width(view) * self.cameras[view].height as usize
    }
}
