//! The search for cameras: Levenberg and Marquardt's method from small pictures to large ones, near where they begin.
//!
//! Small pictures tell where the volume is, but hardly how a camera stands around it: to turn and to step aside at once
//! changes them little. Without more, coarse steps lead cameras around the volume to another place that looks alike.
//! So each has a Gaussian prior around where it began, with a weight by what its picture leaves unexplained, until the
//! full pictures decide alone. A camera whose picture stays unexplained begins again from places around.

use crate::cancel::Cancel;
use crate::differentiate::gradient::camera_jacobian::Rows;
use crate::differentiate::gradient::pictures::Target;
use crate::inverse::observation::plane::Plane;
use crate::inverse::pose::colors::{Colors, linearised};
use crate::inverse::pose::normal::{Frame, Normal, Pose, Spectrum, steps};
use crate::inverse::pose::pyramid::{pyramid, shrunk};
use crate::render::composited::Composited;
use crate::render::differentiable::Differentiable;
use crate::scene::camera::Camera;
use glam::DVec3;
use rayon::prelude::*;

/// Steps (radians, shares of the distance) below which a search ends, on full pictures, there with a reference, and
/// where another search follows.
const FINE: f64 = 1e-7;
const REFERENCE: f64 = 1e-6;
const COARSE: f64 = 1e-4;
/// Largest step: beyond it no derivative holds.
const LARGEST: f64 = 0.2;
/// Damping at first, as a share of the largest eigenvalue.
const DAMPING: f64 = 1e-4;
/// Steps in a row that make it worse, after which a search ends: without a reference, and with one.
const PATIENCE: [u32; 2] = [6, 2];
/// Standard deviation of the prior on each rotation (radians) and position (shares of the distance).
const DEVIATION: f64 = 0.05;
/// Number of independent observations that a picture counts as beside the prior: neighbouring pixels differ alike.
const OBSERVATIONS: f64 = 100.0;
/// Share of a picture's variance that a camera in its place may leave unexplained, but for white noise.
pub const UNEXPLAINED: f64 = 0.02;
/// Displacement from the beginning (radians, shares of the distance) beyond which an unexplained picture's camera is
/// taken back.
const FAR: f64 = 0.25;
/// Angle in radians by which another beginning is turned.
const AROUND: f64 = 0.12;
/// Number of beginnings that are followed on the smallest pictures but one, and so on.
const KEPT: [usize; 3] = [4, 2, 1];

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
    /// Share of the picture's variance that the search left unexplained, white noise apart; not a number if it was not
    /// measured.
    pub unexplained_variance: f64,
    /// True if the search went farther than cameras that are a few degrees off have to go. If the picture was left
    /// unexplained there, the camera is back where it began.
    pub far: bool,
}

/// Moves cameras to where their pictures agree with the renders. Those of `targets` are where they begin, a few degrees
/// and percent of the distance off; the search keeps near them. `tick` is told of every camera and size of picture that
/// is done. Once `cancel` is set they stay where they are.
///
/// With a `reference`, which may be slow, the search ends on what that sees, while the renderer still says how it
/// changes: the fewer digits of derivatives make steps less sure, not what they lead to.
pub fn solve<I: Differentiable<Real = f32>>(
    renderer: &Composited<I>,
    reference: Option<&Composited<I>>,
    targets: &[Target],
    request: &Request<'_>,
    cancel: &Cancel,
    tick: &(dyn Fn() + Sync),
) -> Vec<PoseEstimate> {
    let search = |group: &[Target]| Search::new(renderer, reference, group, request, cancel).run(tick);
    if request.solve_focal {
        return search(targets);
    }
    targets.par_chunks(1).flat_map_iter(search).collect()
}

/// Normal equations of all cameras.
type Equations = Vec<(Normal, Spectrum)>;

/// Where a search stands.
#[derive(Clone)]
struct State {
    cameras: Vec<Camera>,
    /// Normal equations on the last pictures; none if the search was stopped before they were complete.
    equations: Option<Equations>,
    iterations: u32,
}

impl State {
    fn error(&self) -> f64 {
        self.equations.as_ref().map_or(f64::INFINITY, |all| all.iter().map(|(normal, _)| normal.error).sum())
    }
}

/// Cameras that are moved together.
struct Search<'s, I> {
    renderer: &'s Composited<I>,
    reference: Option<&'s Composited<I>>,
    request: &'s Request<'s>,
    cancel: &'s Cancel,
    pyramids: Vec<Vec<Target>>,
    /// Cameras of the full pictures, where the search begins.
    starts: Vec<Camera>,
    /// Distances of these from the centre, in world units.
    distances: Vec<f64>,
}

impl<'s, I: Differentiable<Real = f32>> Search<'s, I> {
    /// Begins with the cameras of `targets`.
    fn new(
        renderer: &'s Composited<I>,
        reference: Option<&'s Composited<I>>,
        targets: &[Target],
        request: &'s Request<'s>,
        cancel: &'s Cancel,
    ) -> Self {
        let distance = |t: &Target| t.camera.position().distance(request.centre).max(f64::MIN_POSITIVE);
        Self {
            renderer,
            reference,
            request,
            cancel,
            pyramids: targets.iter().map(pyramid).collect(),
            starts: targets.iter().map(|t| t.camera).collect(),
            distances: targets.iter().map(distance).collect(),
        }
    }

    /// Moves the cameras to where their pictures are explained. `tick` is called for each camera and size of picture.
    fn run(self, tick: &(dyn Fn() + Sync)) -> Vec<PoseEstimate> {
        // Measured by the renderer that measures the end.
        let before = self.linearised(&self.starts, 0, self.reference);
        let measured = !self.cancelled();
        let mut state = State { cameras: self.starts.clone(), equations: None, iterations: 0 };
        let deepest = self.pyramids.iter().map(Vec::len).max().unwrap_or(1);
        for level in (0..deepest).rev() {
            state = self.descend(state, level, None);
            self.pyramids.iter().filter(|p| level < p.len()).for_each(|_| tick());
        }
        if self.starts.len() == 1 && self.unexplained(&state)[0] > UNEXPLAINED {
            let again = self.restarted(deepest);
            let iterations = state.iterations + again.iterations;
            if self.surprise(&again) < self.surprise(&state) {
                state = again;
            }
            state.iterations = iterations;
        }
        if self.reference.is_some() {
            state = self.descend(state, 0, self.reference);
            self.pyramids.iter().for_each(|_| tick());
        }
        let unexplained = self.unexplained(&state);
        let estimate = |(i, unexplained_variance): (usize, f64)| {
            let after = state.equations.as_ref().map(|all| &all[i]);
            let rms_before = if measured { before[i].0.rms() } else { f64::NAN };
            let far = self.displacement(&state.cameras, i).norm() > FAR;
            let lost = far && unexplained_variance > UNEXPLAINED;
            let found = state.cameras[i];
            PoseEstimate {
                camera: if lost { Camera { focal: found.focal, ..self.starts[i] } } else { found },
                rms: [rms_before, if lost { rms_before } else { after.map_or(f64::NAN, |(normal, _)| normal.rms()) }],
                count: after.map_or(0, |(normal, _)| normal.count),
                iterations: state.iterations,
                undetermined: after.map_or(0, |(_, spectrum)| spectrum.undetermined()),
                unexplained_variance,
                far,
            }
        };
        unexplained.into_iter().enumerate().map(estimate).collect()
    }

    /// Begins from places around the first one; on the smallest pictures all are followed, on the others the best.
    fn restarted(&self, deepest: usize) -> State {
        let beginning = |step: &Pose| {
            let camera = Frame::new(&self.starts[0], self.distances[0]).moved(&self.starts[0], step, 0.0);
            State { cameras: vec![camera], equations: None, iterations: 0 }
        };
        let mut states: Vec<State> = beginnings().iter().map(beginning).collect();
        let mut iterations = 0;
        for (level, kept) in (0..deepest).rev().zip(KEPT.into_iter().chain(std::iter::repeat(1))) {
            states = states.into_par_iter().map(|state| self.descend(state, level, None)).collect();
            iterations = states.iter().map(|state| state.iterations).sum();
            states.sort_by(|a, b| self.surprise(a).total_cmp(&self.surprise(b)));
            states.truncate(kept);
        }
        State { iterations, ..states.swap_remove(0) }
    }

    /// Negative logarithm of the posterior density of a search's only camera, but for a constant.
    fn surprise(&self, state: &State) -> f64 {
        let prior = self.displacement(&state.cameras, 0).norm_squared() / (DEVIATION * DEVIATION);
        OBSERVATIONS * state.error().ln() + prior
    }

    /// How far a camera has come from where it began.
    fn displacement(&self, cameras: &[Camera], i: usize) -> Pose {
        Frame::new(&cameras[i], self.distances[i]).displacement(&self.starts[i], &cameras[i])
    }

    /// Returns the share of each picture's variance that its camera leaves unexplained, white noise apart. Not numbers
    /// once the search is stopped.
    ///
    /// Of noise, means over two by two pixels have a quarter; but so has detail of a pixel's size. So no more is taken
    /// off than the noise that the picture itself shows.
    fn unexplained(&self, state: &State) -> Vec<f64> {
        let coarse = self.linearised(&state.cameras, 1, None);
        let Some(fine) = state.equations.as_ref().filter(|_| !self.cancelled()) else {
            return vec![f64::NAN; self.starts.len()];
        };
        let share = |i: usize| {
            let square = |normal: &Normal| normal.error / normal.count.max(1) as f64;
            let (fine, coarse, picture) = (square(&fine[i].0), square(&coarse[i].0), &self.pyramids[i][0]);
            let shared = if self.pyramids[i].len() > 1 { (4.0 * coarse - fine) / 3.0 } else { 0.0 };
            shared.max(fine - noise_variance(picture)).max(0.0) / variance(&picture.rgba).max(f64::MIN_POSITIVE)
        };
        (0..self.starts.len()).map(share).collect()
    }

    /// Levenberg and Marquardt's method on pictures of one size, with Nielsen's damping (1999).
    fn descend(&self, from: State, level: usize, reference: Option<&Composited<I>>) -> State {
        let shortest = match (level, reference, self.reference) {
            (0, None, None) => FINE,
            (0, Some(_), _) => REFERENCE,
            _ => COARSE,
        };
        let error = |equations: &Equations| equations.iter().map(|(normal, _)| normal.error).sum::<f64>();
        let (mut cameras, mut iterations) = (from.cameras, from.iterations);
        let mut current = self.linearised(&cameras, level, reference);
        if self.cancelled() {
            return State { cameras, equations: from.equations, iterations };
        }
        let largest = current.iter().map(|(_, spectrum)| spectrum.largest()).fold(0.0, f64::max);
        let (mut damping, mut growth, mut failed) = (DAMPING * largest, 2.0, 0);
        for _ in 0..self.request.iterations {
            if self.cancelled() {
                break;
            }
            let weights: Vec<f64> = current.iter().map(|(normal, _)| prior_weight(normal, level)).collect();
            let penalised = self.penalised(&current, &cameras, &weights);
            let (poses, focal, predicted) = steps(&penalised, damping, self.request.solve_focal);
            let size = poses.iter().map(Pose::amax).fold(focal.abs(), f64::max);
            if !(size > shortest && size.is_finite() && predicted > 0.0) {
                break;
            }
            let share = (LARGEST / size).min(1.0);
            let moved = |((camera, distance), step): ((&Camera, &f64), &Pose)| {
                Frame::new(camera, *distance).moved(camera, &(share * step), share * focal)
            };
            let trial: Vec<Camera> = cameras.iter().zip(&self.distances).zip(&poses).map(moved).collect();
            let candidate = self.linearised(&trial, level, reference);
            if self.cancelled() {
                break;
            }
            iterations += 1;
            let gain = (error(&penalised) - error(&self.penalised(&candidate, &trial, &weights))) / predicted;
            if gain > 0.0 {
                damping *= (1.0 - (2.0 * gain - 1.0).powi(3)).max(0.1);
                (growth, failed) = (2.0, 0);
                (cameras, current) = (trial, candidate);
            } else {
                damping *= growth;
                growth *= 2.0;
                failed += 1;
                if failed == PATIENCE[usize::from(reference.is_some())] {
                    break;
                }
            }
        }
        State { cameras, equations: Some(current), iterations }
    }

    /// Equations with the prior around the beginning.
    fn penalised(&self, equations: &Equations, cameras: &[Camera], weights: &[f64]) -> Equations {
        let with_prior = |(i, (normal, _)): (usize, &(Normal, Spectrum))| {
            let normal = normal.with_prior(&self.displacement(cameras, i), weights[i]);
            (normal, normal.spectrum())
        };
        equations.iter().enumerate().map(with_prior).collect()
    }

    fn cancelled(&self) -> bool {
        self.cancel.requested()
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
            let normal = linearised(&rows, &frame, &|i| rgba[i], self.request.colors, 1);
            (normal, normal.spectrum())
        };
        cameras.par_iter().zip(&self.distances).zip(&self.pyramids).map(of).collect()
    }
}

/// Weight of the squared displacement beside the squared residuals: their variance, by what is left of them, over the
/// prior's. The full pictures decide alone.
fn prior_weight(normal: &Normal, level: usize) -> f64 {
    if level == 0 { 0.0 } else { normal.error / (OBSERVATIONS * DEVIATION * DEVIATION) }
}

/// Steps from one beginning to others: turned aside, and rolled or turned around the volume by stepping aside and back,
/// each alone and with another.
fn beginnings() -> Vec<Pose> {
    let signs = [-1.0, 0.0, 1.0];
    let all = signs.into_iter().flat_map(|a| signs.into_iter().flat_map(move |b| signs.map(|c| [a, b, c])));
    let some = all.filter(|turns| (1..=2).contains(&turns.iter().filter(|t| **t != 0.0).count()));
    let around = some.map(|[right, up, roll]| Pose::new(right, up, roll, up, -right, 0.0));
    let aside = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]];
    let aside = aside.map(|[right, up]| Pose::new(right, up, 0.0, 0.0, 0.0, 0.0));
    around.chain(aside).map(|step| AROUND * step).collect()
}

/// Variance of the white noise in the colors of a picture.
fn noise_variance(picture: &Target) -> f64 {
    let of = |c: usize| {
        let values: Vec<f32> = picture.rgba.iter().map(|p| p[c]).collect();
        let plane = Plane { width: picture.camera.width as usize, values: &values };
        plane.deviation(|_| true).unwrap_or(0.0).powi(2)
    };
    (0..3).map(of).sum::<f64>() / 3.0
}

/// Variance of the colors over a picture.
fn variance(rgba: &[[f32; 4]]) -> f64 {
    let finite = || rgba.iter().filter(|p| p[..3].iter().all(|v| v.is_finite()));
    let count = finite().count().max(1) as f64;
    let of = |c: usize| {
        let mean = finite().map(|p| f64::from(p[c])).sum::<f64>() / count;
        finite().map(|p| (f64::from(p[c]) - mean).powi(2)).sum::<f64>() / count
    };
    (0..3).map(of).sum::<f64>() / 3.0
}
