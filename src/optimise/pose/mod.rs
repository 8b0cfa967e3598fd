//! Where cameras stood, from their pictures and the volume in them: least squares by Levenberg and Marquardt.
//!
//! The derivatives of every pixel's colors by the camera are those of the renderer's adjoint. Pictures are shrunk
//! at first, so that cameras find their way from further off.

pub mod normal;

use crate::optimise::gradient::camera_jacobian::Rows;
use crate::optimise::gradient::pictures::Target;
use crate::optimise::pose::normal::{Frame, Normal, Pose, Spectrum, steps};
use crate::render::composited::Composited;
use crate::render::differentiable::Differentiable;
use crate::scene::camera::Camera;
use crate::scene::medium::{Medium, Source};
use glam::DVec3;
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};

/// Pixels along the shorter side of the smallest pictures, at least.
const COARSEST: u32 = 16;
/// Steps (radians, shares of the distance) below which a search ends, on full pictures, there with a reference, and where
/// another search follows.
const FINE: f64 = 1e-7;
const REFERENCE: f64 = 1e-6;
const COARSE: f64 = 1e-4;
/// Damping at first, as a share of the largest eigenvalue.
const DAMPING: f64 = 1e-4;
/// Steps in a row that make it worse, after which a search ends: without a reference, and with one.
const PATIENCE: [u32; 2] = [6, 2];

/// Derivatives that a walk gives, and how the colors' follow from them.
#[derive(Debug, Clone, PartialEq)]
pub struct Colors {
    /// One a walk: derivatives with respect to red, green, blue and alpha.
    losses: Vec<[f32; 4]>,
    /// Weights of the losses in the derivative of each color, `mix[loss][color]`.
    mix: [[f64; 3]; 3],
}

impl Colors {
    /// Of a medium: those of a source of one shape are the same function of the ray but for factors.
    pub fn of(medium: &Medium, background: [f32; 3]) -> Self {
        let background = background.map(f64::from);
        match &medium.source {
            // L = α color + (1 - α) background.
            Source::Grey(color) => Self {
                losses: vec![unit(3)],
                mix: std::array::from_fn(|c| [f64::from(color[c]) - background[c], 0.0, 0.0]),
            },
            // L = e color + (1 - α) background: e from the brightest.
            Source::Linear(color) => {
                let most = (0..3).fold(0, |most, c| if color[c] > color[most] { c } else { most });
                let share = |c: usize| if color[c] > 0.0 { f64::from(color[c]) / f64::from(color[most]) } else { 0.0 };
                Self {
                    losses: vec![unit(most), unit(3)],
                    mix: std::array::from_fn(|c| [share(c), share(c) * background[most] - background[c], 0.0]),
                }
            }
            Source::Transfer(_) => Self::apart(),
        }
    }

    /// Each a function of its own.
    pub fn apart() -> Self {
        Self {
            losses: [0, 1, 2].map(unit).to_vec(),
            mix: [0, 1, 2].map(|c| std::array::from_fn(|i| if i == c { 1.0 } else { 0.0 })),
        }
    }
}

/// One of red, green, blue and alpha.
fn unit(c: usize) -> [f32; 4] {
    std::array::from_fn(|i| if i == c { 1.0 } else { 0.0 })
}

/// Settings of a search for poses.
#[derive(Debug, Clone, Copy)]
pub struct Request<'r> {
    /// How colors follow from what the renderer's walks give.
    pub colors: &'r Colors,
    /// A point that cameras look at: their distance to it is the unit of their position.
    pub centre: DVec3,
    /// Steps on each size of pictures, at most.
    pub iterations: u32,
    /// Whether a focal length that all share is to be found, too.
    pub solve_focal: bool,
}

/// Pose that a search ended with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseEstimate {
    /// Camera with that pose.
    pub camera: Camera,
    /// Root mean square of the colors' differences before and after; not numbers if they were not measured any more
    /// after the search was stopped.
    pub rms: [f64; 2],
    /// Number of colors that were compared.
    pub count: u64,
    /// Steps tried, on all sizes.
    pub iterations: u32,
    /// Directions of the six that its picture says nothing about.
    pub undetermined: usize,
}

/// Moves cameras to where their pictures agree with the renders. Those of `targets` are where they begin; `tick` is
/// told of every camera and size of picture that is done. Once `cancel` is set they stay where they are.
///
/// With a `reference`, which may be slow, the search ends on what that sees, while the renderer still says how it changes:
/// the fewer digits of derivatives make steps less sure, not what they lead to.
pub fn solve<I: Differentiable<Real = f32>>(
    renderer: &Composited<I>,
    reference: Option<&Composited<I>>,
    targets: &[Target],
    request: &Request<'_>,
    cancel: &AtomicBool,
    tick: &(dyn Fn() + Sync),
) -> Vec<PoseEstimate> {
    let search = |group: &[Target]| Search::new(renderer, reference, group, request, cancel).run(tick);
    if request.solve_focal {
        return search(targets);
    }
    targets.par_chunks(1).flat_map_iter(search).collect()
}

/// Returns the normal equations of one camera: those of its render against the colors of its picture, row-major, of
/// which one in `stride` pixels is compared. Colors that are not finite ask for nothing.
pub fn linearised<I: Differentiable<Real = f32>>(
    rows: &Rows<'_, I>,
    frame: &Frame,
    rgba: &[[f32; 4]],
    colors: &Colors,
    stride: usize,
) -> Normal {
    let compared = |i: usize| i.is_multiple_of(stride) && rgba[i][..3].iter().all(|v| v.is_finite());
    let Colors { losses, mix } = colors;
    let sums = rows.fold(compared, losses, |normal: &mut Normal, i, rendered, by| {
        let by: Vec<(Pose, f64)> = by.iter().map(|by| frame.derivative(by)).collect();
        for c in 0..3 {
            let row = by
                .iter()
                .zip(mix[c])
                .fold((Pose::zeros(), 0.0), |(pose, focal), (by, share)| (pose + share * by.0, focal + share * by.1));
            normal.add(&row, f64::from(rgba[i][c]) - rendered[c]);
        }
    });
    sums.into_iter().sum()
}

/// Returns how far points lie apart in the pictures of two cameras: the root mean square in pixels; none if both see
/// none of them.
pub fn displacement(from: &Camera, to: &Camera, points: &[DVec3]) -> Option<f64> {
    let apart = |point: &DVec3| Some(from.project(*point)?.0.distance_squared(to.project(*point)?.0));
    let squares: Vec<f64> = points.iter().filter_map(apart).collect();
    (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
}

/// How often a picture is halved before the search begins.
pub fn levels(camera: &Camera) -> usize {
    let shorter = camera.width.min(camera.height);
    (1..32).take_while(|level| shorter >> level >= COARSEST).count()
}

/// A picture and its halves, the smallest last.
fn pyramid(target: &Target) -> Vec<Target> {
    let mut all = vec![target.clone()];
    for _ in 0..levels(&target.camera) {
        let next = halved(&all[all.len() - 1]);
        all.push(next);
    }
    all
}

/// A picture of half the size: means over two by two pixels (an odd row or column is left out), with its camera.
fn halved(target: &Target) -> Target {
    let camera = shrunk(&target.camera, 1);
    let (w, from) = (camera.width as usize, target.camera.width as usize);
    let mean = |i: usize| {
        let corner = 2 * (i / w) * from + 2 * (i % w);
        let four = [0, 1, from, from + 1].map(|k| target.rgba[corner + k]);
        // One that asks for nothing leaves nothing that could be asked for.
        std::array::from_fn(|c| 0.25 * four.iter().map(|p| p[c]).sum::<f32>())
    };
    let rgba = (0..w * camera.height as usize).map(mean).collect();
    Target { camera, rgba, rays_per_edge: target.rays_per_edge.max(2) }
}

/// The camera of a picture that was halved so many times.
fn shrunk(camera: &Camera, level: usize) -> Camera {
    let share = 0.5_f64.powi(level as i32);
    Camera {
        focal: share * camera.focal,
        centre: share * camera.centre,
        width: camera.width >> level,
        height: camera.height >> level,
        ..*camera
    }
}

/// Cameras that are moved together.
struct Search<'s, I> {
    renderer: &'s Composited<I>,
    reference: Option<&'s Composited<I>>,
    request: &'s Request<'s>,
    cancel: &'s AtomicBool,
    pyramids: Vec<Vec<Target>>,
    /// Cameras of the full pictures, where they stand now.
    cameras: Vec<Camera>,
    /// Distances of the cameras from the centre when the search began, in world units.
    distances: Vec<f64>,
    iterations: u32,
}

/// Normal equations of all cameras.
type Equations = Vec<(Normal, Spectrum)>;

impl<'s, I: Differentiable<Real = f32>> Search<'s, I> {
    fn new(
        renderer: &'s Composited<I>,
        reference: Option<&'s Composited<I>>,
        targets: &[Target],
        request: &'s Request<'s>,
        cancel: &'s AtomicBool,
    ) -> Self {
        let distance = |t: &Target| t.camera.position().distance(request.centre).max(f64::MIN_POSITIVE);
        Self {
            renderer,
            reference,
            request,
            cancel,
            pyramids: targets.iter().map(pyramid).collect(),
            cameras: targets.iter().map(|t| t.camera).collect(),
            distances: targets.iter().map(distance).collect(),
            iterations: 0,
        }
    }

    fn run(mut self, tick: &(dyn Fn() + Sync)) -> Vec<PoseEstimate> {
        // Measured by the renderer that measures the end.
        let before = self.linearised(&self.cameras, 0, self.reference);
        let measured = !self.cancelled();
        let deepest = self.pyramids.iter().map(Vec::len).max().unwrap_or(1);
        let mut after: Option<Equations> = None;
        for level in (0..deepest).rev() {
            after = self.descend(level, None).or(after);
            self.pyramids.iter().filter(|p| level < p.len()).for_each(|_| tick());
        }
        if let Some(reference) = self.reference {
            after = self.descend(0, Some(reference)).or(after);
            self.pyramids.iter().for_each(|_| tick());
        }
        let estimates = self.cameras.iter().zip(&before).enumerate().map(|(i, (camera, before))| {
            let after = after.as_ref().map(|all| &all[i]);
            PoseEstimate {
                camera: *camera,
                rms: [
                    if measured { before.0.rms() } else { f64::NAN },
                    after.map_or(f64::NAN, |(normal, _)| normal.rms()),
                ],
                count: after.map_or(0, |(normal, _)| normal.count),
                iterations: self.iterations,
                undetermined: after.map_or(0, |(_, spectrum)| spectrum.undetermined()),
            }
        });
        estimates.collect()
    }

    /// Levenberg and Marquardt's method on pictures of one size, with Nielsen's damping (1999).
    /// Gives the equations where it ends; none if it was stopped before they were complete.
    fn descend(&mut self, level: usize, reference: Option<&Composited<I>>) -> Option<Equations> {
        let shortest = match (level, reference, self.reference) {
            (0, None, None) => FINE,
            (0, Some(_), _) => REFERENCE,
            _ => COARSE,
        };
        let error = |equations: &Equations| equations.iter().map(|(normal, _)| normal.error).sum::<f64>();
        let mut current = self.linearised(&self.cameras, level, reference);
        if self.cancelled() {
            return None;
        }
        let largest = current.iter().map(|(_, spectrum)| spectrum.largest()).fold(0.0, f64::max);
        let (mut damping, mut growth, mut failed) = (DAMPING * largest, 2.0, 0);
        for _ in 0..self.request.iterations {
            if self.cancelled() {
                break;
            }
            let (poses, focal, predicted) = steps(&current, damping, self.request.solve_focal);
            let size = poses.iter().map(Pose::amax).fold(focal.abs(), f64::max);
            if !(size > shortest && size.is_finite() && predicted > 0.0) {
                break;
            }
            // Beyond that no derivative holds.
            let share = (0.2 / size).min(1.0);
            let trial: Vec<Camera> = self
                .cameras
                .iter()
                .zip(&self.distances)
                .zip(&poses)
                .map(|((c, distance), step)| Frame::new(c, *distance).moved(c, &(share * step), share * focal))
                .collect();
            let candidate = self.linearised(&trial, level, reference);
            if self.cancelled() {
                break;
            }
            self.iterations += 1;
            let gain = (error(&current) - error(&candidate)) / predicted;
            if gain > 0.0 {
                damping *= (1.0 - (2.0 * gain - 1.0).powi(3)).max(0.1);
                (growth, failed) = (2.0, 0);
                (self.cameras, current) = (trial, candidate);
            } else {
                damping *= growth;
                growth *= 2.0;
                failed += 1;
                if failed == PATIENCE[usize::from(reference.is_some())] {
                    break;
                }
            }
        }
        Some(current)
    }

    fn cancelled(&self) -> bool {
        self.cancel.load(Ordering::Relaxed)
    }

    /// Normal equations of cameras of full pictures on pictures of a level, or the smallest there are.
    fn linearised(&self, cameras: &[Camera], level: usize, reference: Option<&Composited<I>>) -> Equations {
        let of = |((camera, distance), pyramid): ((&Camera, &f64), &Vec<Target>)| {
            let level = level.min(pyramid.len() - 1);
            let Target { rgba, rays_per_edge, .. } = &pyramid[level];
            let camera = shrunk(camera, level);
            let frame = Frame::new(&camera, *distance);
            let rows = Rows {
                renderer: self.renderer,
                reference,
                camera: &camera,
                rays_per_edge: *rays_per_edge,
                cancel: self.cancel,
            };
            let normal = linearised(&rows, &frame, rgba, self.request.colors, 1);
            (normal, normal.spectrum())
        };
        cameras.par_iter().zip(&self.distances).zip(&self.pyramids).map(of).collect()
    }
}
