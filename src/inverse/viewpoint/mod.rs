//! Viewpoints from which a volume shows most: maxima of the opacity entropy over a sphere (Weiss & Westermann
//! 2021, sect. 5.1).
//!
//! Initial samples are taken about each start, on the smallest pictures and without derivatives; searches leave from
//! the best places that they find, first on small pictures; those that meet go on as one, on pictures twice as large
//! each time, the higher half of them. A picture of full size would move them by less than its pixels: it is for the
//! final pass, with the upright camera that is handed out. At that scale entropies are rough, and derivatives say
//! little: about the highest the best of a few pictures is taken.

pub mod entropy;

use crate::cancel::Cancel;
use crate::differentiate::gradient::camera_jacobian::Rows;
use crate::inverse::solver::ascent::{Ascent, Evaluation};
use crate::render::composited::Composited;
use crate::render::dvr::Dvr;
use crate::scene::sphere::{Sphere, fibonacci, levelled, stepped, upright};
use crate::scene::up::Up;
use entropy::Entropy;
use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;
use std::time::Instant;

/// Number of initial samples, for each start: where pictures are halved at least once, and else.
const INITIAL_SAMPLES: [usize; 2] = [12, 4];
/// Pixels along the shorter side beyond which a search begins with smaller pictures.
const COARSE: u32 = 32;
/// Searches that go on to larger pictures: half of them, but no fewer than this.
const HIGHEST: usize = 2;
/// Searches closer than this have met: pixels of the picture as it turns, and radians at most.
const MET: [f64; 2] = [3.0, 0.2];
/// Where searches end: length of a step, in pixels of the picture as it turns, and the rise that it promises. On the
/// way there pictures of few pixels are off by more.
const COARSELY: [f64; 2] = [0.5, 2e-5];
const FINELY: [f64; 2] = [0.2, 5e-7];

/// Pictures of the final pass about each of the [`HIGHEST`], and how far from it, in pixels of the picture as it turns.
const ABOUT: usize = 10;
const RING: f64 = 1.5;

/// Search for viewpoints of largest opacity entropy.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// Sphere of the cameras, and the size of their pictures.
    pub sphere: Sphere,
    /// Unit vectors from the centre to viewpoints about which initial samples are taken, to start from the best.
    pub starts: Vec<DVec3>,
    /// Unit vectors from the centre to more viewpoints, to start from as they are.
    pub exact_starts: Vec<DVec3>,
    /// Evaluations for each start and size of picture, at most.
    pub iterations: u32,
    /// True for cameras of the upper half of the sphere alone, about its up axis. Starts must lie there.
    pub hemisphere: bool,
}

impl Request {
    /// Returns true if a camera may stand in this direction from the centre.
    fn allows(&self, direction: DVec3) -> bool {
        !self.hemisphere || direction.dot(self.sphere.up.vector()) >= 0.0
    }

    /// Returns unit vectors spread evenly over the sphere, or its upper half: `count` of them.
    fn directions(&self, count: usize) -> Vec<DVec3> {
        let up = self.sphere.up;
        if self.hemisphere { upper(count, up) } else { fibonacci(count, up) }
    }
}

/// Returns unit vectors spread evenly over the upper half of the sphere, about the axis `up`: `count` of them.
pub fn upper(count: usize, up: Up) -> Vec<DVec3> {
    // The lattice descends from the pole, and is symmetric.
    fibonacci(2 * count, up).into_iter().take(count).collect()
}

/// Value of viewpoints that are not allowed, below all entropies: no step leads there.
const BELOW: f64 = -1.0;

/// A maximum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Axes of the camera: right, up, back.
    pub axes: DMat3,
    /// Of its picture.
    pub entropy: Entropy,
}

/// Path of a local search from one start.
#[derive(Debug, Clone, PartialEq)]
pub struct Path {
    /// Unit vectors from the centre to all viewpoints on the way, from the best of the initial samples about the start.
    pub directions: Vec<DVec3>,
    /// Number of evaluations, those as one with others that it met included, initial samples not.
    pub iterations: u32,
    /// Number of the view it has reached.
    pub view: usize,
}

/// Viewpoints found, and the searches that led to them.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Different maxima, the best first.
    pub views: Vec<View>,
    /// One for each start.
    pub paths: Vec<Path>,
    /// Wall time of all.
    pub seconds: f64,
    /// Wall time of one picture of full size without derivatives: the mean of the final pass.
    pub render_seconds: f64,
    /// True if it was stopped.
    pub stopped: bool,
}

/// Climbs from every start. `tick` is told of every initial sample, and of every start and every size of picture that
/// it has been through: as often as [`ticks`] says. Once `cancel` is set searches stay where they are.
pub fn search(dvr: &Composited<Dvr<'_, f32>>, request: &Request, cancel: &Cancel, tick: &(dyn Fn() + Sync)) -> Outcome {
    let begun = Instant::now();
    let sampled_starts = sampled_starts(dvr, request, cancel, tick);
    let starts: Vec<DMat3> =
        sampled_starts.iter().chain(&request.exact_starts).map(|d| upright(*d, request.sphere.up)).collect();
    let mut searches: Vec<LocalSearch> = starts
        .iter()
        .enumerate()
        .map(|(i, axes)| LocalSearch { ascent: Ascent::new(*axes), starts: vec![i] })
        .collect();
    let mut paths: Vec<Path> =
        starts.iter().map(|axes| Path { directions: vec![axes.z_axis], iterations: 0, view: 0 }).collect();
    let mut count = searches.len();
    for (turn, level) in sizes(&request.sphere).enumerate() {
        let sphere = request.sphere.scaled(0.5_f64.powi(level));
        let end = if level > 1 { COARSELY } else { FINELY };
        if turn > 0 {
            count = count.min(searches.len()).div_ceil(2).max(HIGHEST);
        }
        searches.iter().skip(count).flat_map(|search| &search.starts).for_each(|_| tick());
        searches.par_iter_mut().take(count).for_each(|search| {
            climb(dvr, request, &sphere, &mut search.ascent, end, cancel);
            search.starts.iter().for_each(|_| tick());
        });
        for search in searches.iter().take(count) {
            for start in &search.starts {
                let path = &mut paths[*start];
                path.directions.extend(search.ascent.path.iter().map(|axes| axes.z_axis));
                path.iterations += search.ascent.evaluations;
            }
        }
        searches = merged(searches, (MET[0] * radians_per_pixel(&sphere)).min(MET[1]));
    }
    let final_pass = Instant::now();
    let mut pictures = 0;
    let mut views: Vec<(&LocalSearch, View)> = Vec::new();
    for (number, search) in searches.iter().enumerate() {
        let about = if number < HIGHEST && !cancel.requested() { ABOUT } else { 0 };
        let mut places = about_a_place(&search.ascent.axes, about, &request.sphere);
        places.retain(|axes| request.allows(axes.z_axis));
        pictures += places.len();
        let candidates = places.iter().map(|axes| {
            let whole = (!cancel.requested()).then(|| entropy_at(dvr, &request.sphere, axes, cancel));
            // A search that was stopped keeps the entropy that its ascent evaluated last.
            let last = Entropy { value: search.ascent.value.unwrap_or(0.0), by_turn: DVec3::ZERO, blank: false };
            View { axes: *axes, entropy: whole.filter(|_| !cancel.requested()).unwrap_or(last) }
        });
        // The first of equals.
        let best = candidates.reduce(|a, b| if b.entropy.value > a.entropy.value { b } else { a });
        views.extend(best.map(|view| (search, view)));
    }
    let render_seconds = final_pass.elapsed().as_secs_f64() / pictures.max(1) as f64;
    // Stable: equal ones as they were.
    views.sort_by(|a, b| b.1.entropy.value.total_cmp(&a.1.entropy.value));
    for (number, (search, view)) in views.iter().enumerate() {
        for start in &search.starts {
            paths[*start].view = number;
            paths[*start].directions.push(view.axes.z_axis);
        }
    }
    let views = views.into_iter().map(|(_, view)| view).collect();
    let stopped = cancel.requested();
    Outcome { views, paths, seconds: begun.elapsed().as_secs_f64(), render_seconds, stopped }
}

/// A viewpoint, and so many evenly about it, [`RING`] pixels away, all upright.
fn about_a_place(axes: &DMat3, count: usize, sphere: &Sphere) -> Vec<DMat3> {
    let distance = RING * radians_per_pixel(sphere);
    let turn = |i: usize| distance * DVec2::from_angle(std::f64::consts::TAU * i as f64 / count as f64);
    let places = std::iter::once(*axes).chain((0..count).map(|i| stepped(axes, turn(i))));
    places.map(|axes| levelled(&axes, sphere.up)).collect()
}

/// Returns how often a search that is not stopped reports its progress.
pub fn ticks(request: &Request) -> usize {
    let (own, sizes) = (request.starts.len(), sizes(&request.sphere).len());
    own + initial_samples(request).len() + (own + request.exact_starts.len()) * sizes
}

/// Directions of the initial samples.
fn initial_samples(request: &Request) -> Vec<DVec3> {
    let halved = sizes(&request.sphere).next().is_some_and(|level| level > 0);
    request.directions(INITIAL_SAMPLES[usize::from(!halved)] * request.starts.len())
}

/// For each of the starts, the best of it and of those initial samples' viewpoints that lie nearest to it.
fn sampled_starts(
    dvr: &Composited<Dvr<'_, f32>>,
    request: &Request,
    cancel: &Cancel,
    tick: &(dyn Fn() + Sync),
) -> Vec<DVec3> {
    let level = sizes(&request.sphere).next().unwrap_or(0);
    let sphere = request.sphere.scaled(0.5_f64.powi(level));
    let entropies_of = |directions: &[DVec3]| entropies_of(dvr, &sphere, directions, cancel, tick);
    let (Some(own), Some(sampled)) = (entropies_of(&request.starts), entropies_of(&initial_samples(request))) else {
        return request.starts.clone();
    };
    best_nearby(&own, &sampled)
}

/// For each place the highest of it and of those of `others` that lie nearest to it.
fn best_nearby(places: &[(DVec3, f64)], others: &[(DVec3, f64)]) -> Vec<DVec3> {
    let mut best = places.to_vec();
    for (direction, value) in others {
        let near = |i: &usize| places[*i].0.dot(*direction);
        let nearest = (0..places.len()).max_by(|a, b| near(a).total_cmp(&near(b)));
        if let Some(i) = nearest.filter(|i| *value > best[*i].1) {
            best[i] = (*direction, *value);
        }
    }
    best.into_iter().map(|(direction, _)| direction).collect()
}

/// Entropies of upright views spread evenly over the sphere of the request, or its half, with their directions. Nothing
/// if it was stopped.
pub fn sample(
    dvr: &Composited<Dvr<'_, f32>>,
    request: &Request,
    count: usize,
    cancel: &Cancel,
    tick: &(dyn Fn() + Sync),
) -> Option<Vec<(DVec3, f64)>> {
    entropies_of(dvr, &request.sphere, &request.directions(count), cancel, tick)
}

/// Entropies of upright views, with their directions.
fn entropies_of(
    dvr: &Composited<Dvr<'_, f32>>,
    sphere: &Sphere,
    directions: &[DVec3],
    cancel: &Cancel,
    tick: &(dyn Fn() + Sync),
) -> Option<Vec<(DVec3, f64)>> {
    let of = |direction: &DVec3| {
        if cancel.requested() {
            return None;
        }
        tick();
        let value = entropy_at(dvr, sphere, &upright(*direction, sphere.up), cancel).value;
        (!cancel.requested()).then_some((*direction, value))
    };
    directions.par_iter().map(of).collect()
}

/// How often pictures are halved, for each size that the search goes through.
fn sizes(sphere: &Sphere) -> impl ExactSizeIterator<Item = i32> {
    let shorter = sphere.size[0].min(sphere.size[1]);
    let most = (1..32).take_while(|level| shorter >> level >= COARSE).count() as i32;
    (most.min(1)..most + 1).rev()
}

/// A search, and the starts that have become it.
#[derive(Debug)]
struct LocalSearch {
    ascent: Ascent,
    starts: Vec<usize>,
}

impl LocalSearch {
    fn height(&self) -> f64 {
        self.ascent.value.unwrap_or(f64::NEG_INFINITY)
    }
}

/// Climbs on pictures of one size.
fn climb(
    dvr: &Composited<Dvr<'_, f32>>,
    request: &Request,
    sphere: &Sphere,
    ascent: &mut Ascent,
    [pixels, rise]: [f64; 2],
    cancel: &Cancel,
) {
    // Upright at first, never on the way: pixels that turn would be a step in the entropy.
    let axes = levelled(&ascent.axes, sphere.up);
    ascent.restart(axes);
    ascent.climb([pixels * radians_per_pixel(sphere), rise], request.iterations, |axes| {
        if !request.allows(axes.z_axis) {
            return Some(Evaluation { value: BELOW, gradient: DVec2::ZERO });
        }
        if cancel.requested() {
            return None;
        }
        let camera = sphere.camera(axes);
        let Entropy { value, by_turn, .. } = entropy::gradient(
            &Rows { renderer: dvr, reference: None, camera: &camera, rays_per_edge: 1, cancel },
            sphere.centre,
        );
        if cancel.requested() {
            return None;
        }
        // A turn about the line of sight changes nothing but the pixels' places.
        Some(Evaluation { value, gradient: DVec2::new(by_turn.dot(axes.x_axis), by_turn.dot(axes.y_axis)) })
    });
}

/// Turn by which what is nearest moves on by a pixel.
fn radians_per_pixel(sphere: &Sphere) -> f64 {
    2.0 / f64::from(sphere.size[0].min(sphere.size[1]))
}

/// Searches that are as near become one, the one that is higher up. The highest come first.
fn merged(mut searches: Vec<LocalSearch>, near: f64) -> Vec<LocalSearch> {
    searches.sort_by(|a, b| b.height().total_cmp(&a.height()));
    let mut kept: Vec<LocalSearch> = Vec::new();
    for search in searches {
        let place = |c: &LocalSearch| c.ascent.axes.z_axis;
        match kept.iter_mut().find(|other| place(other).angle_between(place(&search)) < near) {
            Some(other) => other.starts.extend(search.starts),
            None => kept.push(search),
        }
    }
    kept
}

/// Entropy of a view; that of a part of its pixels once `cancel` is set.
fn entropy_at(dvr: &Composited<Dvr<'_, f32>>, sphere: &Sphere, axes: &DMat3, cancel: &Cancel) -> Entropy {
    entropy::value(&Rows { renderer: dvr, reference: None, camera: &sphere.camera(axes), rays_per_edge: 1, cancel })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Affine;
    use crate::scene::bricks::{Bricks, Topology};
    use crate::scene::medium::Medium;
    use glam::IVec3;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn searches_meet_and_the_higher_one_goes_on() {
        let search = |start: usize, x: f64, value: f64| {
            let mut ascent = Ascent::new(upright(DVec3::new(x, 0.0, 1.0).normalize(), Up::Z));
            ascent.value = Some(value);
            LocalSearch { ascent, starts: vec![start] }
        };
        let kept = merged(vec![search(0, 0.0, 0.5), search(1, 1.0, 0.7), search(2, 0.01, 0.6)], 0.02);
        let kept_starts: Vec<_> = kept.iter().map(|c| (c.starts.clone(), c.ascent.value)).collect();
        assert_eq!(kept_starts, [(vec![1], Some(0.7)), (vec![2, 0], Some(0.6))]);
    }

    #[test]
    fn starts_move_to_the_highest_place_nearby() {
        let places = [(DVec3::X, 0.5), (DVec3::Y, 0.5), (DVec3::Z, 0.9)];
        let toward = |to: DVec3, from: DVec3| (to + 0.3 * from).normalize();
        let initial_samples =
            [(toward(DVec3::X, DVec3::Y), 0.6), (toward(DVec3::X, DVec3::Z), 0.7), (toward(DVec3::Z, DVec3::X), 0.8)];
        assert_eq!(best_nearby(&places, &initial_samples), [initial_samples[1].0, DVec3::Y, DVec3::Z]);
        assert!(best_nearby(&[], &initial_samples).is_empty());
    }

    #[test]
    fn all_that_is_done_is_told_of() {
        let bricks = Arc::new(Topology::new([IVec3::ZERO]).unwrap());
        let mut field = Bricks::zeros(bricks, Affine::uniform(1.0, DVec3::ZERO).unwrap());
        field.values.iter_mut().enumerate().for_each(|(i, v)| *v = (i % 7) as f32);
        let dvr = Dvr::new(&field, Medium::absorbing(0.1)).unwrap().over([1.0; 3]);
        for size in [24, 70] {
            let sphere = Sphere::around(&field.outline(), [size, size], 40.0, Up::Z).unwrap();
            let starts = fibonacci(3, Up::Z);
            let request = Request { sphere, starts, exact_starts: vec![DVec3::X], iterations: 2, hemisphere: false };
            let ticked = AtomicUsize::new(0);
            let tick = || {
                ticked.fetch_add(1, Ordering::Relaxed);
            };
            let outcome = search(&dvr, &request, &Cancel::NEVER, &tick);
            assert_eq!(outcome.paths.len(), 4);
            assert_eq!(ticked.into_inner(), ticks(&request), "pictures of {size}");
        }
    }

    #[test]
    fn the_upper_half_is_covered_evenly() {
        for count in [1, 2, 9, 200] {
            let all = upper(count, Up::Z);
            assert!(all.len() == count && all.iter().all(|d| d.z > 0.0), "{all:?}");
        }
        // The mean height over a half sphere is 1/2; the lattice is within 1/count of it.
        assert!((upper(200, Up::Z).iter().map(|d| d.z).sum::<f64>() / 200.0 - 0.5).abs() < 0.005);
    }

    #[test]
    fn large_pictures_are_halved() {
        let sphere = |size| Sphere { centre: DVec3::ZERO, distance: 1.0, focal: 1.0, size, up: Up::Z };
        let of = |size: [u32; 2]| sizes(&sphere(size)).collect();
        let all: [Vec<i32>; 5] = [of([256, 256]), of([32, 900]), of([63, 63]), of([64, 400]), of([1, 1])];
        assert_eq!(all, [vec![3, 2, 1], vec![0], vec![0], vec![1], vec![0]]);
    }
}
