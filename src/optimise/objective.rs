//! A loss on pictures from several cameras: its value, and its derivative backward and forward, in either
//! precision. (The loops of reconstructions are in [`pictures`](super::pictures): `f32`, local losses,
//! compiled for each instruction set.)

use crate::dual::Dual;
use crate::optimise::loss::{Loss, Reach, Rgba};
use crate::render::dvr::{Adjoint, Directions, Dvr, ParameterGradient, Precision, RayGradient, Seeds, Sinks, Tape};
use crate::scene::camera::{Camera, CameraGradient};
use crate::scene::table::TableGradient;
use rayon::prelude::*;
use std::ops::Range;

/// A loss on pictures: the mean over the cameras.
#[derive(Debug, Clone, Copy)]
pub struct Objective<'o> {
    /// The loss of one picture.
    pub loss: Loss,
    /// Where pictures are taken from.
    pub cameras: &'o [Camera],
    /// What they should show, row-major, one a camera; none for losses that compare with nothing. Pixels
    /// that are not finite ask for nothing.
    pub wanted: &'o [Vec<Rgba>],
    /// A pixel is the mean over the square of so many rays.
    pub rays_per_edge: usize,
}

/// What is differentiated by, besides extinction, colour and background, which cost nothing.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct By {
    /// The stored voxels.
    pub voxels: bool,
    /// The transfer function, of so many knots.
    pub knots: Option<usize>,
    /// Cameras and the quadrature's step.
    pub rays: bool,
}

/// A gradient.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Gradient<R> {
    /// Value of the objective.
    pub value: f64,
    /// By stored voxel, 729 a brick; empty if not asked for.
    pub voxels: Vec<R>,
    /// By piece of the transfer function.
    pub table: TableGradient,
    /// By camera.
    pub cameras: Vec<CameraGradient>,
    /// By the quadrature's step, in voxels.
    pub step: f64,
    /// By what all rays share.
    pub shared: ParameterGradient,
}

/// A direction in which something changes.
#[derive(Debug, Clone, PartialEq)]
pub enum Direction<R> {
    /// A camera, by its number.
    Camera(usize, CameraGradient),
    /// The quadrature's step, in voxels.
    Step(f64),
    /// What all rays share.
    Shared(ParameterGradient),
    /// The transfer function's pieces.
    Table(TableGradient),
    /// Stored voxels, 729 a brick.
    Voxels(Vec<R>),
}

/// A precision with all numbers of directions that are compiled.
pub trait Forward: Directions<1> + Directions<2> + Directions<6> + Directions<7> {}
impl<R: Directions<1> + Directions<2> + Directions<6> + Directions<7>> Forward for R {}

/// Pixels handled in one go.
const RUN: usize = 256;
/// Accumulators of gradients: as many for any number of threads, added up in order.
const LANES: usize = 4;

/// Derivatives of an objective with respect to one picture's pixels.
enum Slopes<'s> {
    /// To be found pixel by pixel, times this.
    Local(f64),
    /// Known.
    Global(&'s [Rgba]),
}

impl Objective<'_> {
    /// The value.
    pub fn value<R: Precision>(&self, dvr: &Dvr<'_, R>) -> f64 {
        let of = |view: usize| self.loss.picture(&self.picture(dvr, view), self.wanted(view), self.width(view)).0;
        (0..self.cameras.len()).map(of).sum::<f64>() / self.cameras.len() as f64
    }

    /// Value and gradient, backward.
    pub fn adjoint<R: Precision>(&self, dvr: &Dvr<'_, R>, adjoint: Adjoint, by: By) -> Gradient<R> {
        let zero = || Gradient {
            voxels: if by.voxels { vec![R::ZERO; dvr.field().values.len()] } else { Vec::new() },
            table: by.knots.map_or_else(TableGradient::default, TableGradient::of_knots),
            cameras: vec![CameraGradient::default(); self.cameras.len()],
            ..Gradient::default()
        };
        let mut lanes: Vec<Gradient<R>> = (0..LANES).map(|_| zero()).collect();
        let mut value = 0.0;
        for view in 0..self.cameras.len() {
            let (global, known) = self.global(dvr, view);
            value += global;
            let slopes = self.slopes(view, known.as_deref());
            let runs = self.runs(view);
            lanes.par_iter_mut().enumerate().for_each(|(lane, own)| {
                let mut tape = Tape::default();
                for i in runs.iter().skip(lane).step_by(LANES).flat_map(|run| run.clone()) {
                    self.pixel_back(dvr, adjoint, by, (view, i), &slopes, own, &mut tape);
                }
            });
        }
        let mut total = zero();
        total.value = value;
        for lane in lanes {
            total.value += lane.value;
            total.voxels.par_iter_mut().zip(lane.voxels).for_each(|(t, v)| *t += v);
            total.table.add(&lane.table);
            total.cameras.iter_mut().zip(&lane.cameras).for_each(|(t, c)| *t = t.plus(c));
            total.step += lane.step;
            total.shared = total.shared.plus(&lane.shared);
        }
        total
    }

    /// Value and derivatives along directions, forward, a few in each walk.
    pub fn tangent<R: Forward>(&self, dvr: &Dvr<'_, R>, directions: &[Direction<R>]) -> (f64, Vec<f64>) {
        let mut all = Vec::with_capacity(directions.len());
        let mut left = directions;
        loop {
            let (now, later) = left.split_at(left.len().min(7));
            let (value, some) = match now.len() {
                0 | 1 => self.tangent_of::<R, 1>(dvr, now),
                2 => self.tangent_of::<R, 2>(dvr, now),
                3..=6 => self.tangent_of::<R, 6>(dvr, now),
                _ => self.tangent_of::<R, 7>(dvr, now),
            };
            all.extend(some);
            left = later;
            if left.is_empty() {
                return (value, all);
            }
        }
    }

    fn tangent_of<R: Directions<P>, const P: usize>(
        &self,
        dvr: &Dvr<'_, R>,
        directions: &[Direction<R>],
    ) -> (f64, Vec<f64>) {
        let mut sum = Dual::<f64, P>::constant(0.0);
        for view in 0..self.cameras.len() {
            let runs = self.runs(view);
            if self.loss.reach() == Reach::Global {
                // Derivatives wait for the loss's: forward, no ray is walked again.
                let of_run = |run: &Range<usize>| {
                    let mut tape = Tape::default();
                    run.clone().map(|i| self.pixel_forward(dvr, directions, (view, i), &mut tape)).collect::<Vec<_>>()
                };
                let pixels: Vec<[Dual<f64, P>; 4]> = runs.par_iter().flat_map_iter(of_run).collect();
                let seen: Vec<Rgba> = pixels.iter().map(|p| p.map(|c| c.value)).collect();
                let (value, slopes) = self.of_picture(&seen, view);
                sum.value += value;
                pixels.iter().zip(&slopes).for_each(|(pixel, slope)| add_along(&mut sum, pixel, slope));
                continue;
            }
            let slopes = self.slopes(view, None);
            let of_run = |run: &Range<usize>| {
                let (mut sum, mut tape) = (Dual::<f64, P>::constant(0.0), Tape::default());
                for i in run.clone() {
                    let pixel = self.pixel_forward(dvr, directions, (view, i), &mut tape);
                    let (value, slope) = self.pixel(view, i, &pixel.map(|c| c.value), &slopes);
                    sum.value += value;
                    add_along(&mut sum, &pixel, &slope);
                }
                sum
            };
            let parts: Vec<Dual<f64, P>> = runs.par_iter().map(of_run).collect();
            sum = parts.into_iter().fold(sum, |sum, part| sum + part);
        }
        (sum.value, sum.tangent[..directions.len()].to_vec())
    }

    /// What one pixel adds to a gradient.
    fn pixel_back<R: Precision>(
        &self,
        dvr: &Dvr<'_, R>,
        adjoint: Adjoint,
        by: By,
        (view, i): (usize, usize),
        slopes: &Slopes<'_>,
        own: &mut Gradient<R>,
        tape: &mut Tape<R>,
    ) {
        let rays = self.positions(view, i);
        let share = 1.0 / rays.len() as f64;
        // Of several rays the mean must be known first.
        let known = match slopes {
            Slopes::Local(_) if rays.len() == 1 => None,
            Slopes::Local(_) => {
                let (value, slope) = self.pixel(view, i, &self.seen(dvr, view, i), slopes);
                own.value += value;
                Some(slope)
            }
            Slopes::Global(known) => Some(known[i]),
        };
        for (x, y) in rays {
            let mut moved = RayGradient::default();
            let sinks = Sinks {
                voxels: by.voxels.then_some(&mut own.voxels),
                table: by.knots.is_some().then_some(&mut own.table),
                ray: by.rays.then_some(&mut moved),
                shared: &mut own.shared,
            };
            let camera = &self.cameras[view];
            let value = &mut own.value;
            let mut slope = |seen: &crate::render::dvr::Radiance<R>| match known {
                Some(slope) => slope.map(|s| R::of(share * s)),
                None => {
                    let (here, slope) = self.pixel(view, i, &seen.rgba().map(R::f64), slopes);
                    *value += here;
                    slope.map(R::of)
                }
            };
            dvr.gradient(&camera.ray(x, y), &mut slope, adjoint, sinks, tape);
            if by.rays {
                let by_camera = camera.gradient(x, y, moved.origin, moved.direction);
                own.cameras[view] = own.cameras[view].plus(&by_camera);
                own.step += moved.step;
            }
        }
    }

    /// One pixel, with its derivatives.
    fn pixel_forward<R: Directions<P>, const P: usize>(
        &self,
        dvr: &Dvr<'_, R>,
        directions: &[Direction<R>],
        (view, i): (usize, usize),
        tape: &mut Tape<R>,
    ) -> [Dual<f64, P>; 4] {
        let rays = self.positions(view, i);
        let share = 1.0 / rays.len() as f64;
        let camera = &self.cameras[view];
        let mut mean = [Dual::<f64, P>::constant(0.0); 4];
        for (x, y) in rays {
            let mut seeds: Seeds<'_, R, P> = Seeds::default();
            for (p, direction) in directions.iter().enumerate() {
                match direction {
                    Direction::Camera(number, by) if *number == view => {
                        let ray = camera.tangent(x, y, by);
                        seeds.ray[p] = RayGradient { origin: ray.origin, direction: ray.direction, step: 0.0 };
                    }
                    Direction::Camera(..) => {}
                    Direction::Step(by) => seeds.ray[p].step = *by,
                    Direction::Shared(by) => seeds.shared[p] = *by,
                    Direction::Table(by) => seeds.table[p] = Some(by),
                    Direction::Voxels(by) => seeds.voxels[p] = Some(by),
                }
            }
            let seen = dvr.tangent(&camera.ray(x, y), &seeds, tape).rgba();
            (0..4).for_each(|c| mean[c] = mean[c] + seen[c].f64().linear(|v| share * v));
        }
        mean
    }

    /// Value and derivative that a pixel adds; a global loss has its value already.
    fn pixel(&self, view: usize, i: usize, seen: &Rgba, slopes: &Slopes<'_>) -> (f64, Rgba) {
        let share = match slopes {
            Slopes::Global(known) => return (0.0, known[i]),
            Slopes::Local(share) => *share,
        };
        let nothing = [0.0; 4];
        let wanted = self.wanted(view).map_or(&nothing, |w| &w[i]);
        if wanted.iter().chain(seen).any(|v| !v.is_finite()) {
            return (0.0, nothing);
        }
        let (value, slope) = self.loss.pixel(seen, wanted);
        (share * value, slope.map(|s| share * s))
    }

    /// Value and derivatives of a picture, where the loss needs all of it; times the view's share.
    fn global<R: Precision>(&self, dvr: &Dvr<'_, R>, view: usize) -> (f64, Option<Vec<Rgba>>) {
        if self.loss.reach() == Reach::Local {
            return (0.0, None);
        }
        let (value, slopes) = self.of_picture(&self.picture(dvr, view), view);
        (value, Some(slopes))
    }

    /// The same of a picture that is known.
    fn of_picture(&self, seen: &[Rgba], view: usize) -> (f64, Vec<Rgba>) {
        let share = 1.0 / self.cameras.len() as f64;
        let (value, mut slopes) = self.loss.picture(seen, self.wanted(view), self.width(view));
        slopes.iter_mut().flatten().for_each(|s| *s *= share);
        (share * value, slopes)
    }

    fn slopes<'s>(&self, view: usize, known: Option<&'s [Rgba]>) -> Slopes<'s> {
        match known {
            Some(known) => Slopes::Global(known),
            None => {
                let count = match self.wanted(view) {
                    Some(wanted) => wanted.iter().filter(|p| p.iter().all(|v| v.is_finite())).count(),
                    None => self.pixels(view),
                };
                Slopes::Local(1.0 / (count.max(1) * self.cameras.len()) as f64)
            }
        }
    }

    /// A picture as it is.
    fn picture<R: Precision>(&self, dvr: &Dvr<'_, R>, view: usize) -> Vec<Rgba> {
        (0..self.pixels(view)).into_par_iter().map(|i| self.seen(dvr, view, i)).collect()
    }

    /// Mean over a pixel's rays.
    fn seen<R: Precision>(&self, dvr: &Dvr<'_, R>, view: usize, i: usize) -> Rgba {
        let rays = self.positions(view, i);
        let share = 1.0 / rays.len() as f64;
        let mut mean = [0.0; 4];
        for (x, y) in rays {
            let seen = dvr.radiance(&self.cameras[view].ray(x, y)).rgba();
            (0..4).for_each(|c| mean[c] += share * seen[c].f64());
        }
        mean
    }

    /// Image positions of a pixel's rays.
    fn positions(&self, view: usize, i: usize) -> impl ExactSizeIterator<Item = (f64, f64)> {
        let (n, width) = (self.rays_per_edge.max(1), self.width(view));
        let offset = move |k: usize| (k as f64 + 0.5) / n as f64;
        (0..n * n).map(move |k| ((i % width) as f64 + offset(k % n), (i / width) as f64 + offset(k / n)))
    }

    fn runs(&self, view: usize) -> Vec<Range<usize>> {
        let pixels = self.pixels(view);
        (0..pixels).step_by(RUN).map(|i| i..pixels.min(i + RUN)).collect()
    }

    fn wanted(&self, view: usize) -> Option<&[Rgba]> {
        self.wanted.get(view).map(Vec::as_slice)
    }

    fn width(&self, view: usize) -> usize {
        self.cameras[view].width as usize
    }

    fn pixels(&self, view: usize) -> usize {
        self.width(view) * self.cameras[view].height as usize
    }
}

/// Adds a pixel's derivatives, weighed by the loss's.
fn add_along<const P: usize>(sum: &mut Dual<f64, P>, pixel: &[Dual<f64, P>; 4], slope: &Rgba) {
    for (channel, slope) in pixel.iter().zip(slope) {
        (0..P).for_each(|p| sum.tangent[p] += slope * channel.tangent[p]);
    }
}
