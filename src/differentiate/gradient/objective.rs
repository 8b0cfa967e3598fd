//! A loss on pictures from several cameras: its value, and its derivatives in reverse and forward mode, in either
//! precision. (The loops of reconstructions are in [`pictures`](super::pictures): `f32`, local losses, compiled for
//! each instruction set.)

use super::views::{ActiveParameters, Cotangent, Direction, ForwardInAll, Gradient, RUN, Views};
use crate::cancel::Cancel;
use crate::differentiate::loss::{Loss, Reach, Rgba};
use crate::dual::Dual;
use crate::real::Real;
use crate::render::composited::{Composited, Pixel};
use crate::render::differentiable::{Adjoint, Differentiable, Forward};
use crate::render::tiles;
use crate::scene::camera::Camera;
use std::ops::Range;

/// A loss on pictures: the mean over the cameras.
#[derive(Debug, Clone, Copy)]
pub struct Objective<'o> {
    /// The loss of one picture.
    pub loss: Loss,
    /// Cameras of the pictures.
    pub cameras: &'o [Camera],
    /// Target pictures, row-major, one per camera; none for losses that compare with nothing. Pixels that are not
    /// finite are ignored.
    pub targets: &'o [Vec<Rgba>],
    /// Rays along each edge of a pixel, whose value is the mean over the square of that number.
    pub rays_per_edge: usize,
    /// Polled between runs of pixels; what a pass that it stopped returns is incomplete.
    pub cancel: &'o Cancel,
}

/// Derivatives of an objective with respect to one picture's pixels.
enum Cotangents {
    /// Derivatives that are computed pixel by pixel, times this factor.
    Local(f64),
    /// Derivatives of all pixels, computed in advance.
    Global(Vec<Rgba>),
}

impl Objective<'_> {
    /// Returns the value of the objective.
    pub fn value<I: Differentiable>(&self, renderer: &Composited<I>) -> f64 {
        let of = |view: usize| {
            self.loss.picture(&self.picture(renderer, view), self.target(view), self.views().width(view)).0
        };
        (0..self.cameras.len()).map(of).sum::<f64>() / self.cameras.len() as f64
    }

    /// Returns value and gradient, in reverse mode.
    pub fn adjoint<I: Differentiable>(
        &self,
        renderer: &Composited<I>,
        adjoint: Adjoint,
        active: ActiveParameters,
    ) -> Gradient<I::Voxel> {
        let views = self.views();
        let (mut value, mut cotangents) = (0.0, Vec::new());
        for view in 0..self.cameras.len() {
            let (global, precomputed) = self.global(renderer, view);
            value += global;
            cotangents.push(self.cotangents(view, precomputed));
        }
        let mut total = views.accumulate(renderer, active, |view, i, own, tape| {
            let mut value = 0.0;
            let mut loss = |rendered: &Pixel<I::Real>| {
                let (loss, cotangent) = self.pixel(view, i, &rendered.rgba().map(Real::f64), &cotangents[view]);
                value += loss;
                cotangent.map(I::Real::of)
            };
            let cotangent = match &cotangents[view] {
                Cotangents::Global(all) => Cotangent::Known(all[i]),
                Cotangents::Local(_) if self.rays_per_edge <= 1 => Cotangent::Of(&mut loss),
                // Of several rays the mean must be known first.
                local => {
                    let (loss, cotangent) = self.pixel(view, i, &views.pixel(renderer, (view, i), tape), local);
                    own.value += loss;
                    Cotangent::Known(cotangent)
                }
            };
            views.pixel_reverse(renderer, (adjoint, active), (view, i), cotangent, own, tape);
            own.value += value;
        });
        total.value += value;
        total
    }

    /// Returns the pictures that the loss is one of.
    fn views(&self) -> Views<'_> {
        Views { cameras: self.cameras, rays_per_edge: self.rays_per_edge, cancel: self.cancel }
    }

    /// Returns the value and its derivatives along directions, in forward mode with up to 7 directions per walk.
    pub fn tangent<I: ForwardInAll>(
        &self,
        renderer: &Composited<I>,
        directions: &[Direction<I::Voxel>],
    ) -> (f64, Vec<f64>) {
        let mut all = Vec::with_capacity(directions.len());
        let mut left = directions;
        loop {
            let (now, later) = left.split_at(left.len().min(7));
            let (value, some) = match now.len() {
                0 | 1 => self.tangent_of::<I, 1>(renderer, now),
                2 => self.tangent_of::<I, 2>(renderer, now),
                3..=6 => self.tangent_of::<I, 6>(renderer, now),
                _ => self.tangent_of::<I, 7>(renderer, now),
            };
            all.extend(some);
            left = later;
            if left.is_empty() {
                return (value, all);
            }
        }
    }

    fn tangent_of<I: Forward<P>, const P: usize>(
        &self,
        renderer: &Composited<I>,
        directions: &[Direction<I::Voxel>],
    ) -> (f64, Vec<f64>) {
        let mut sum = Dual::<f64, P>::constant(0.0);
        for view in 0..self.cameras.len() {
            if self.loss.reach() == Reach::Global {
                // Derivatives wait for the loss's: forward, no ray is walked again.
                let forward =
                    |tape: &mut I::Scratch, i: usize| self.views().pixel_forward(renderer, directions, (view, i), tape);
                let pixels: Vec<[Dual<f64, P>; 4]> = self
                    .views()
                    .each_pixel(view, I::Scratch::default, forward)
                    .unwrap_or_else(|| vec![[Dual::constant(0.0); 4]; self.views().pixels(view)]);
                let rendered: Vec<Rgba> = pixels.iter().map(|p| p.map(|c| c.value)).collect();
                let (value, cotangents) = self.of_picture(&rendered, view);
                sum.value += value;
                pixels.iter().zip(&cotangents).for_each(|(pixel, cotangent)| add_along(&mut sum, pixel, cotangent));
                continue;
            }
            let cotangents = self.cotangents(view, None);
            let of_run = |tape: &mut I::Scratch, run: &Range<usize>| {
                let mut sum = Dual::<f64, P>::constant(0.0);
                for i in run.clone() {
                    let pixel = self.views().pixel_forward(renderer, directions, (view, i), tape);
                    let (value, cotangent) = self.pixel(view, i, &pixel.map(|c| c.value), &cotangents);
                    sum.value += value;
                    add_along(&mut sum, &pixel, &cotangent);
                }
                sum
            };
            let parts =
                tiles::map(&tiles::runs(self.views().pixels(view), RUN), self.cancel, I::Scratch::default, of_run);
            sum = parts.into_iter().flatten().fold(sum, |sum, part| sum + part);
        }
        (sum.value, sum.tangent[..directions.len()].to_vec())
    }

    /// Returns value and derivatives that a pixel adds; the value is 0 for a global loss, which is added for the whole
    /// picture.
    fn pixel(&self, view: usize, i: usize, rendered: &Rgba, cotangents: &Cotangents) -> (f64, Rgba) {
        let share = match cotangents {
            Cotangents::Global(all) => return (0.0, all[i]),
            Cotangents::Local(share) => *share,
        };
        let nothing = [0.0; 4];
        let target = self.target(view).map_or(&nothing, |t| &t[i]);
        if target.iter().chain(rendered).any(|v| !v.is_finite()) {
            return (0.0, nothing);
        }
        let (value, cotangent) = self.loss.pixel(rendered, target);
        (share * value, cotangent.map(|s| share * s))
    }

    /// Returns value and derivatives of a rendered picture, times the view's share, for losses that need all of it; 0
    /// and `None` for local losses.
    fn global<I: Differentiable>(&self, renderer: &Composited<I>, view: usize) -> (f64, Option<Vec<Rgba>>) {
        if self.loss.reach() == Reach::Local {
            return (0.0, None);
        }
        let (value, cotangents) = self.of_picture(&self.picture(renderer, view), view);
        (value, Some(cotangents))
    }

    /// Returns value and derivatives of a given picture, times the view's share.
    fn of_picture(&self, rendered: &[Rgba], view: usize) -> (f64, Vec<Rgba>) {
        let share = 1.0 / self.cameras.len() as f64;
        let (value, mut cotangents) = self.loss.picture(rendered, self.target(view), self.views().width(view));
        cotangents.iter_mut().flatten().for_each(|s| *s *= share);
        (share * value, cotangents)
    }

    fn cotangents(&self, view: usize, precomputed: Option<Vec<Rgba>>) -> Cotangents {
        match precomputed {
            Some(precomputed) => Cotangents::Global(precomputed),
            None => {
                let count = match self.target(view) {
                    Some(target) => target.iter().filter(|p| p.iter().all(|v| v.is_finite())).count(),
                    None => self.views().pixels(view),
                };
                Cotangents::Local(1.0 / (count.max(1) * self.cameras.len()) as f64)
            }
        }
    }

    /// Renders the picture of a camera, row-major; black if the work was cancelled.
    pub fn picture<I: Differentiable>(&self, renderer: &Composited<I>, view: usize) -> Vec<Rgba> {
        self.views().picture(renderer, view).unwrap_or_else(|| vec![[0.0; 4]; self.views().pixels(view)])
    }

    fn target(&self, view: usize) -> Option<&[Rgba]> {
        self.targets.get(view).map(Vec::as_slice)
    }
}

/// Adds a pixel's derivatives, weighted by the loss's.
fn add_along<const P: usize>(sum: &mut Dual<f64, P>, pixel: &[Dual<f64, P>; 4], cotangent: &Rgba) {
    for (channel, cotangent) in pixel.iter().zip(cotangent) {
        (0..P).for_each(|p| sum.tangent[p] += cotangent * channel.tangent[p]);
    }
}
