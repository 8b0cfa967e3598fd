//! Derivatives of a picture with respect to its camera, pixel by pixel: rows of the Jacobian.

use crate::cancel::Cancel;
use crate::render::composited::Composited;
use crate::render::differentiable::Differentiable;
use crate::render::differentiable::RayGradient;
use crate::render::film::Subpixels;
use crate::render::order::morton;
use crate::render::tiles;
use crate::scene::camera::{Camera, CameraGradient};
use std::ops::Range;

/// Pixels processed in one run. Small pictures need many runs, so that all threads have some.
const RUN: usize = 256;

/// A camera's picture, whose pixels and derivatives are computed.
#[derive(Debug)]
pub struct Rows<'r, I> {
    /// Renderer of the pixels and their derivatives.
    pub renderer: &'r Composited<I>,
    /// Renderer of the pixels alone, if their values are to be more accurate than the derivatives.
    pub reference: Option<&'r Composited<I>>,
    /// Camera of the picture.
    pub camera: &'r Camera,
    /// Rays along each edge of a pixel, whose value is the mean over the square of that number.
    pub rays_per_edge: usize,
    /// Polled between pixels: once it is set the remaining pixels are left out, and sums are incomplete.
    pub cancel: &'r Cancel,
}

/// Receives a pixel: its row-major number, red, green, blue and alpha, and its derivatives by loss.
type Visit<'v> = &'v mut dyn FnMut(usize, &[f64; 4], &[CameraGradient]);

impl<I: Differentiable<Real = f32>> Rows<'_, I> {
    /// Returns the number of pixels.
    pub fn pixels(&self) -> usize {
        self.camera.width as usize * self.camera.height as usize
    }

    /// Visits the pixels that `selects` accepts by their row-major number, with their values and the derivatives of
    /// each of `losses` with respect to the camera; a loss is given by its derivatives with respect to red, green, blue
    /// and alpha. Pixels are visited in runs that depend on the picture's size alone, each with a sum of its own; the
    /// sums are returned in a fixed order, so that their total is bit-identical for any number of threads.
    pub fn fold<A: Default + Send>(
        &self,
        selects: impl Fn(usize) -> bool + Sync,
        losses: &[[f32; 4]],
        visit: impl Fn(&mut A, usize, &[f64; 4], &[CameraGradient]) + Sync,
    ) -> Vec<A> {
        let order: Vec<usize> = morton(self.camera.width as usize, self.camera.height as usize).collect();
        let run = |tape: &mut I::Scratch, pixels: &Range<usize>| {
            let (mut sum, pixels) = (A::default(), &order[pixels.clone()]);
            let selected: Vec<usize> = pixels.iter().copied().filter(|i| selects(*i)).collect();
            let visit: Visit<'_> = &mut |i, rendered, by| visit(&mut sum, i, rendered, by);
            Run { rows: self, pixels: &selected, losses, visit }.walk(tape);
            sum
        };
        tiles::map(&tiles::runs(order.len(), RUN), &Cancel::NEVER, I::Scratch::default, run).unwrap_or_default()
    }
}

/// Neighbouring pixels.
struct Run<'a, I> {
    rows: &'a Rows<'a, I>,
    pixels: &'a [usize],
    losses: &'a [[f32; 4]],
    visit: Visit<'a>,
}

impl<I: Differentiable<Real = f32>> Run<'_, I> {
    fn walk(self, tape: &mut I::Scratch) {
        let Rows { renderer, reference, camera, rays_per_edge, cancel } = *self.rows;
        let (rays, width) = (Subpixels::new(rays_per_edge), camera.width as usize);
        let share = 1.0 / rays.count() as f64;
        let mut by = vec![CameraGradient::default(); self.losses.len()];
        for &i in self.pixels {
            if cancel.requested() {
                return;
            }
            let mut rendered = [0.0; 4];
            by.fill(CameraGradient::default());
            for [x, y] in rays.positions([i % width, i / width]) {
                let ray = camera.ray(x, y);
                let mut radiance = None;
                for (by, loss) in by.iter_mut().zip(self.losses) {
                    let mut ray_gradient = RayGradient::default();
                    radiance = Some(renderer.ray_vjp(&ray, *loss, &mut ray_gradient, tape));
                    // Many rays meet nothing.
                    if ray_gradient != RayGradient::default() {
                        *by = by.plus(&camera.gradient(
                            x,
                            y,
                            share * ray_gradient.origin,
                            share * ray_gradient.direction,
                        ));
                    }
                }
                let radiance = match (reference, radiance) {
                    (None, Some(radiance)) => radiance,
                    _ => reference.unwrap_or(renderer).pixel_on(&ray, tape),
                };
                for c in 0..3 {
                    rendered[c] += share * f64::from(radiance.rgb[c]);
                }
                // One minus the transmittance would be zero for faint media.
                rendered[3] -= share * (-radiance.depth).exp_m1();
            }
            (self.visit)(i, &rendered, &by);
        }
    }
}
