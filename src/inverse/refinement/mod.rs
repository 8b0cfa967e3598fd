//! Cameras refined together with the densities that they see.
//!
//! Rounds from coarse to fine, each of which solves for the densities with the cameras that there are, and then moves
//! every camera by one Gauss-Newton step to where its picture agrees better with the render. Taken by themselves such
//! rounds converge slowly, since the densities have adapted to the wrong cameras: on the finest level Anderson
//! acceleration makes up for that. The scene may be moved, turned and scaled with its cameras, which no picture tells:
//! the common part of all motions is taken out.

pub mod gauge;

use crate::differentiate::gradient::camera_jacobian::Rows;
use crate::error::{Error, Result};
use crate::inverse::density::Request;
use crate::inverse::density::multilevel;
use crate::inverse::observation::Observation;
use crate::inverse::observation::depth_map::DepthMap;
use crate::inverse::pose::colors::{Colors, linearised};
use crate::inverse::pose::normal::{Frame, Normal, Pose, Spectrum, steps};
use crate::inverse::progress::Step;
use crate::inverse::region::lattice;
use crate::inverse::solver::anderson::Anderson;
use crate::render::composited::Composited;
use crate::render::dvr::Dvr;
use crate::scene::bricks::Bricks;
use crate::scene::camera::Camera;
use crate::scene::medium::Medium;
use gauge::align;
use glam::{DMat3, DMat4, DQuat, DVec3};
use nalgebra::DVector;
use rayon::prelude::*;
use std::ops::ControlFlow;
use std::sync::Arc;

/// Voxels along the longest edge on the coarsest level, at least.
const COARSEST: f64 = 24.0;
/// Rounds on the coarsest level, on those between and on the finest, at most.
const COARSE_ROUNDS: u32 = 3;
const ROUNDS: u32 = 1;
const FINEST_ROUNDS: u32 = 8;
/// Iterations of the densities in a round: from a start on the same level, and else.
const ITERATIONS: u32 = 4;
const FIRST_ITERATIONS: u32 = 8;
/// Damping of the steps, as a share of the largest eigenvalue: coarse voxels tell shifts and rolls of a picture, and
/// lead directions astray that differ by parallax alone.
const COARSE_DAMPING: f64 = 0.05;
const DAMPING: f64 = 1e-4;
/// Former rounds that the acceleration remembers.
const MEMORY: usize = 2;
/// Pixels of a picture that its camera's step is computed from, about. What voxels do not resolve misleads the steps as
/// noise does: of a cloud with texture down to its voxels, 64 exact cameras of 128² pixels turn by 0.037 degrees with a
/// quarter of them.
const PIXELS: usize = 1 << 14;
/// Mean step in pixels below which the cameras are found; a focal length differs from the distance by little.
const FOUND: f64 = 0.002;
const FOUND_WITH_FOCAL: f64 = 0.0005;
/// Largest step, in radians, in units of the distance or of the focal length's logarithm.
const LARGEST: f64 = 0.2;
/// Pixels of a level by which silhouettes are widened: cameras that are off would cut each other's.
const MARGIN: usize = 2;

/// One round, for the progress display.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Round {
    /// Level, 0 the finest.
    pub level: u32,
    /// Displacement of the full pictures by the cameras' steps: the root mean square in pixels.
    pub pixels: f64,
}

/// Returns the largest number of rounds.
pub fn most_rounds(request: &Request) -> u64 {
    let levels = levels(request);
    (0..levels).map(|level| u64::from(rounds(level, levels))).sum()
}

/// Returns the cameras of the observation, moved to where its transmittances agree best with one volume; with `focal`
/// the focal length, too, by a factor that all share. The lattice and the bounds of `request` must hold the volume as
/// the cameras see it now; all views are used, the held-out ones too.
///
/// # Errors
/// If the bounds leave no unknown, the unknowns do not fit in memory, or the work is cancelled.
pub fn refine(
    observation: &Observation,
    request: &Request,
    focal: bool,
    mut watch: impl FnMut(&Round) -> ControlFlow<()>,
) -> Result<Vec<Camera>> {
    let given: Vec<Camera> = observation.maps.iter().map(|map| map.camera).collect();
    let (centre, points) = (request.bounds.centre(), request.bounds.inner_corners());
    let coordinates = Coordinates { given: &given, centre };
    let mut cameras = given.clone();
    let mut field: Option<Bricks<f32>> = None;
    let levels = levels(request);
    for level in (0..levels).rev() {
        let damping = if level + 1 == levels && levels > 1 { COARSE_DAMPING } else { DAMPING };
        let mut acceleration = Anderson::new(if level == 0 { MEMORY } else { 0 });
        for round in 0..rounds(level, levels) {
            let views = reduced(observation, &cameras, level);
            let iterations = if level == 0 && round > 0 { ITERATIONS } else { FIRST_ITERATIONS };
            let solved = densities(&views, request, level, iterations, field.take())?;
            let mut moved = step(&views, &solved, request, &cameras, damping, focal);
            if request.cancel.requested() {
                return Err(Error::cancelled());
            }
            field = Some(solved);
            let pixels = displacements(&cameras, &moved, &points);
            align(&mut moved, &given, &points);
            let next = acceleration.next(&coordinates.vector(&cameras), coordinates.vector(&moved));
            cameras = coordinates.cameras(&next);
            if watch(&Round { level, pixels }).is_break() {
                return Err(Error::cancelled());
            }
            if pixels < if focal { FOUND_WITH_FOCAL } else { FOUND } {
                break;
            }
        }
    }
    align(&mut cameras, &given, &points);
    Ok(cameras)
}

fn levels(request: &Request) -> u32 {
    lattice::levels_from(None, &request.lattice, &request.bounds, COARSEST) + 1
}

fn rounds(level: u32, levels: u32) -> u32 {
    match level {
        0 => FINEST_ROUNDS,
        level if level + 1 == levels => COARSE_ROUNDS,
        _ => ROUNDS,
    }
}

/// Root mean square of the displacements between cameras, in pixels.
fn displacements(from: &[Camera], to: &[Camera], points: &[DVec3]) -> f64 {
    let squares = from.iter().zip(to).filter_map(|(a, b)| a.displacement(b, points)).map(|pixels| pixels * pixels);
    let (sum, count) = squares.fold((0.0, 0.0), |(sum, count), square| (sum + square, count + 1.0));
    (sum / f64::max(count, 1.0)).sqrt()
}

/// The observation with these cameras, its pictures reduced to the level's size and its silhouettes widened.
fn reduced(observation: &Observation, cameras: &[Camera], level: u32) -> Observation {
    let reduced = |(map, camera): (&DepthMap, &Camera)| {
        let mut reduced = map.reduced(map.stride_within(1 << level));
        reduced.camera.camera_to_world = camera.camera_to_world;
        reduced.camera.focal *= camera.focal / map.camera.focal;
        reduced.widen_silhouette(MARGIN);
        reduced
    };
    let maps = observation.maps.par_iter().zip(cameras).map(reduced).collect();
    Observation { maps, clean: observation.clean }
}

/// The densities on a level, from all views.
fn densities(
    views: &Observation,
    request: &Request,
    level: u32,
    iterations: u32,
    init: Option<Bricks<f32>>,
) -> Result<Bricks<f32>> {
    let lattice = lattice::coarser(&request.lattice, level)?;
    let init = init.map(Arc::new);
    let request = Request { lattice, held_out: Vec::new(), iterations, init, ..request.clone() };
    let cancel = request.cancel.clone();
    let watch = |_: &Step| match cancel.requested() {
        true => ControlFlow::Break(()),
        false => ControlFlow::Continue(()),
    };
    Ok(multilevel::reconstruct(views, &request, watch)?.field)
}

/// The cameras of the full pictures after one step each.
fn step(
    views: &Observation,
    field: &Bricks<f32>,
    request: &Request,
    cameras: &[Camera],
    damping: f64,
    focal: bool,
) -> Vec<Camera> {
    let medium = Medium::absorbing(request.medium.extinction);
    let colors = Colors::from_medium(&medium, [1.0; 3]);
    let Ok(dvr) = Dvr::new(field, medium) else { return cameras.to_vec() };
    let renderer = dvr.early_stop(0.0).over([1.0; 3]);
    let frame = |camera: &Camera| {
        Frame::new(camera, camera.position().distance(request.bounds.centre()).max(f64::MIN_POSITIVE))
    };
    let of_view = |map: &DepthMap| {
        let normal = normal(&renderer, map, &frame(&map.camera), &colors, request);
        (normal, normal.spectrum())
    };
    let equations: Vec<(Normal, Spectrum)> = views.maps.par_iter().map(of_view).collect();
    let largest = equations.iter().map(|(_, spectrum)| spectrum.largest()).fold(0.0, f64::max);
    let (poses, factor, _) = steps(&equations, damping * largest, focal);
    let size = poses.iter().map(Pose::amax).fold(factor.abs(), f64::max);
    if !size.is_finite() {
        return cameras.to_vec();
    }
    let share = (LARGEST / size).min(1.0);
    let moved = |(camera, step): (&Camera, &Pose)| frame(camera).moved(camera, &(share * step), share * factor);
    cameras.iter().zip(&poses).map(moved).collect()
}

/// Normal equations of the camera of a map's transmittances.
fn normal(
    renderer: &Composited<Dvr<'_, f32>>,
    map: &DepthMap,
    frame: &Frame,
    colors: &Colors,
    request: &Request,
) -> Normal {
    let rows = Rows {
        renderer,
        reference: None,
        camera: &map.camera,
        rays_per_edge: request.rays_per_edge,
        cancel: &request.cancel,
    };
    // An odd stride does not fall into columns.
    let stride = (rows.pixels() / PIXELS).max(1) | 1;
    linearised(&rows, frame, &|i| [map.transmittance[i]; 4], colors, stride)
}

/// Cameras as one vector: rotation and motion from the given ones, in radians and units of the distance, and the
/// logarithm of the focal length's factor.
struct Coordinates<'c> {
    given: &'c [Camera],
    centre: DVec3,
}

impl Coordinates<'_> {
    fn distance(&self, given: &Camera) -> f64 {
        given.position().distance(self.centre).max(f64::MIN_POSITIVE)
    }

    fn vector(&self, cameras: &[Camera]) -> DVector<f64> {
        let numbers = cameras.iter().zip(self.given).flat_map(|(camera, given)| {
            let turn = given.rotation_to(camera);
            let motion = (camera.position() - given.position()) / self.distance(given);
            [turn.x, turn.y, turn.z, motion.x, motion.y, motion.z, (camera.focal.x / given.focal.x).ln()]
        });
        DVector::from_iterator(7 * self.given.len(), numbers)
    }

    fn cameras(&self, coordinates: &DVector<f64>) -> Vec<Camera> {
        let camera = |(given, numbers): (&Camera, &[f64])| {
            let [turn, motion] = [0, 3].map(|k| DVec3::from_slice(&numbers[k..k + 3]));
            let axes = DMat3::from_quat(DQuat::from_scaled_axis(turn)) * DMat3::from_mat4(given.camera_to_world);
            let position = given.position() + self.distance(given) * motion;
            let camera_to_world = DMat4::from_mat3_translation(axes, position);
            Camera { camera_to_world, focal: numbers[6].exp() * given.focal, ..*given }
        };
        self.given.iter().zip(coordinates.as_slice().chunks_exact(7)).map(camera).collect()
    }
}
