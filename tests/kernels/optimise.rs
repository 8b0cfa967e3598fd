//! Parts of the reconstruction: the prior's metric, the hull, the measurements, the operator.

use crate::common::fields::{field, lumps, odd, unit};
use cumulo::cancel::Cancel;
use cumulo::differentiate::gradient::footprint::{Footprint, Lens};
use cumulo::differentiate::gradient::partition::Parts;
use cumulo::differentiate::gradient::pictures::{self, Gradients, Target, Workspace};
use cumulo::inverse::density::confidence::{MeasuredView, confidence};
use cumulo::inverse::observation::Observation;
use cumulo::inverse::observation::depth_map::DepthMap;
use cumulo::inverse::observation::photo::Photo;
use cumulo::inverse::projection::depths::{Depths, mean};
use cumulo::inverse::projection::projector::{Projector, Sample, View};
use cumulo::inverse::region::hull::Hull;
use cumulo::inverse::solver::conjugate::{Equations, Solver};
use cumulo::inverse::solver::smoother::Smoother;
use cumulo::math::{Aabb, Affine};
use cumulo::render::differentiable::{Accumulators, Adjoint, ParameterGradient};
use cumulo::render::dvr::{Dvr, Tape};
use cumulo::render::film::{self, Sampling};
use cumulo::render::order::Tiles;
use cumulo::render::preshaded::Preshaded;
use cumulo::scene::blur::Blur;
use cumulo::scene::bricks::{BRICK, Bricks, Topology};
use cumulo::scene::camera::{Camera, Projection};
use cumulo::scene::film::Film;
use cumulo::scene::grid::LEAF_VOXELS;
use cumulo::scene::medium::Medium;
use cumulo::scene::orbit::{self, Layout};
use cumulo::scene::up::Up;
use glam::{DMat4, DVec2, DVec3, IVec3, Vec4};
use std::sync::Arc;

/// Numbers in 0..1 that look random.
fn noise(count: usize, seed: u64) -> Vec<f32> {
    let mut state = seed;
    let next = |_| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1 << 24) as f32
    };
    (0..count).map(next).collect()
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
}

/// A ball of radius 9 voxels around (0.5, 0, 0), in a turned and stretched lattice.
fn ball() -> Bricks<f32> {
    let place = DMat4::from_translation(DVec3::new(3.0, -2.0, 1.0))
        * DMat4::from_rotation_y(0.4)
        * DMat4::from_scale(DVec3::new(0.1, 0.1, 0.12));
    let inside = |p: DVec3| if (p - DVec3::new(0.5, 0.0, 0.0)).length() < 9.0 { 0.8 } else { 0.0 };
    let bricks = (0..64).map(|i| IVec3::new(i >> 4, i >> 2 & 3, i & 3) - 2);
    let mut field = Bricks::zeros(Arc::new(Topology::new(bricks).unwrap()), Affine::new(place).unwrap());
    let owned: Vec<f32> = field
        .topology
        .bricks()
        .iter()
        .flat_map(|b| (0..512).map(move |i| inside((8 * *b + IVec3::new(i >> 6, i >> 3 & 7, i & 7)).as_dvec3())))
        .collect();
    field.topology.clone().fill_apron(&owned, &mut field.values);
    field
}

fn photos(field: &Bricks<f32>, cameras: &[Camera], background: [f32; 3]) -> Vec<Photo> {
    let dvr = Dvr::new(field, Medium::absorbing(1.5)).unwrap().early_stop(0.0).over(background);
    let shoot = |camera: &Camera| Photo {
        camera: *camera,
        film: film::render(&dvr, camera, Sampling::grid(1), &[], &Cancel::NEVER).unwrap().film,
        name: "view".into(),
        photograph: false,
    };
    cameras.iter().map(shoot).collect()
}

fn observed(field: &Bricks<f32>, views: usize) -> Observation {
    let cameras = orbit::cameras(&field.outline(), views, Layout::Sphere, 40, 36, 35.0, Up::Z);
    Observation::new(&photos(field, &cameras, [1.0; 3]), [1.0; 3], [0.0; 3]).unwrap()
}

#[test]
fn the_prior_is_a_metric() {
    let field = ball();
    let n = field.topology.len() * LEAF_VOXELS;
    let mask: Vec<f32> = noise(n, 5).iter().map(|v| if *v < 0.3 { 0.0 } else { *v }).collect();
    let (u, v) = (noise(n, 1), noise(n, 2));
    let (mut mu, mut mv) = (vec![0.0; n], vec![0.0; n]);
    for passes in [0, 1, 3] {
        let mut smoother = Smoother::new(&field.topology, passes, 0.2);
        smoother.apply(&u, &mask, &mut mu);
        smoother.apply(&v, &mask, &mut mv);
        let (a, b) = (dot(&mu, &v), dot(&u, &mv));
        // Sums of 2^15 products of f32: their roundings are some 1e-7 of the sum of magnitudes.
        assert!((a - b).abs() < 1e-5 * dot(&u, &v), "{passes} passes: {a} and {b}");
        assert!(dot(&mu, &u) > 0.0);
        assert!(mask.iter().zip(&mu).all(|(m, o)| *m > 0.0 || *o == 0.0));
    }
}

#[test]
fn relative_weights_are_one_at_the_top_and_small_where_there_is_nothing() {
    let field = ball();
    let n = field.topology.len() * LEAF_VOXELS;
    let mut smoother = Smoother::new(&field.topology, 1, 0.2);
    let mut weights = vec![0.0; n];
    smoother.relative(&vec![0.0; n], &mut weights);
    assert!(weights.iter().all(|w| *w == 1.0));
    smoother.relative(&field.owned(), &mut weights);
    let (low, high) = weights.iter().fold((f32::MAX, 0.0_f32), |(l, h), w| (l.min(*w), h.max(*w)));
    // √(0.1 / 1.1) where nothing is. A blur of one pass leaves more than a hundredth of the ball as it was, so that the
    // 99th percentile is its density, and no weight is larger than 1; both to the rounding of some operations in f32.
    assert!((low - (0.1_f32 / 1.1).sqrt()).abs() < 1e-6 && (high - 1.0).abs() < 1e-6, "{low} {high}");
}

#[test]
fn the_hull_keeps_the_medium_and_little_more() {
    let field = ball();
    let observation = observed(&field, 14);
    let hull = Hull::new(&observation);
    let bounds = hull.bounds().unwrap();
    let content = field.outline().into_iter().fold(Aabb::EMPTY, Aabb::including);
    let reach = 0.12 * 3.0;
    assert!((bounds.min - content.min).min_element() > -2.0 * reach, "{bounds:?} {content:?}");
    assert!((bounds.max - content.max).max_element() < 2.0 * reach, "{bounds:?} {content:?}");
    let (topology, unknown) = hull.unknowns(&field.transform, &bounds, 1 << 20).unwrap();
    let mut inside = 0;
    for (b, brick) in field.topology.bricks().iter().enumerate() {
        for i in 0..512_i32 {
            let index = (8 * *brick + IVec3::new(i >> 6, i >> 3 & 7, i & 7)).as_dvec3();
            if field.sample(index) > 0.0 {
                inside += 1;
                let at = topology.find(*brick);
                assert!(at != cumulo::scene::bricks::NONE, "brick {b} was carved");
                assert!(unknown[at as usize * LEAF_VOXELS + i as usize], "voxel {index} was carved");
            }
        }
    }
    let kept = unknown.iter().filter(|u| **u).count();
    assert!(inside > 2500 && kept < 2 * inside, "{kept} unknowns for {inside} voxels");
}

/// Between the cones of few views lies much that no picture shows.
#[test]
fn outside_of_pictures_that_show_the_whole_medium_is_nothing() {
    let field = ball();
    let observation = observed(&field, 3);
    let content = field.outline().into_iter().fold(Aabb::EMPTY, Aabb::including);
    let far = 4.0 * content.size();
    let wide = Aabb { min: content.min - far, max: content.max + far };
    let (topology, unknown) = Hull::new(&observation).unknowns(&field.transform, &wide, 1 << 20).unwrap();
    let kept = unknown.iter().filter(|u| **u).count();
    // The ball has 3050 voxels; the cones of three views meet in a body some times as large.
    assert!(kept < 5 * 3050, "{kept} unknowns in {} bricks", topology.len());
}

/// A picture that shows the whole of one ball, and nothing at its border, but not the other ball: the
/// other pictures know better.
#[test]
fn a_close_up_of_a_part_takes_nothing_away() {
    let bricks = (0..128).map(|i| IVec3::new(i >> 2 & 15, i >> 1 & 1, i & 1) + IVec3::new(0, 0, 2 * (i >> 6)));
    let mut field = Bricks::zeros(Arc::new(Topology::new(bricks).unwrap()), Affine::uniform(1.0, DVec3::ZERO).unwrap());
    let balls = [DVec3::new(10.0, 8.0, 8.0), DVec3::new(110.0, 8.0, 8.0)];
    let owned: Vec<f32> = field
        .topology
        .bricks()
        .iter()
        .flat_map(|b| (0..512).map(move |i| (8 * *b + IVec3::new(i >> 6, i >> 3 & 7, i & 7)).as_dvec3()))
        .map(|p| if balls.iter().any(|c| (p - *c).length() < 5.0) { 0.2 } else { 0.0 })
        .collect();
    field.topology.clone().fill_apron(&owned, &mut field.values);
    let mut cameras = orbit::cameras(&field.outline(), 8, Layout::Sphere, 40, 40, 35.0, Up::Z);
    let close = Camera {
        camera_to_world: DMat4::from_translation(DVec3::new(10.0, 8.0, 60.0)),
        focal: DVec2::splat(80.0),
        ..cameras[0]
    };
    cameras.push(close);
    let observation = Observation::new(&photos(&field, &cameras, [1.0; 3]), [1.0; 3], [0.0; 3]).unwrap();
    let bounds = Hull::new(&observation).bounds().unwrap();
    assert!(balls.iter().all(|c| bounds.min.cmplt(*c - 4.0).all() && bounds.max.cmpgt(*c + 4.0).all()), "{bounds:?}");
}

#[test]
fn views_of_one_direction_bound_nothing() {
    let field = ball();
    let camera = orbit::cameras(&field.outline(), 1, Layout::Ring, 40, 36, 35.0, Up::Z)[0];
    let pictures = photos(&field, &[camera, camera], [1.0; 3]);
    let observation = Observation::new(&pictures, [1.0; 3], [0.0; 3]).unwrap();
    let message = Hull::new(&observation).bounds().unwrap_err().to_string();
    assert!(message.contains("`bounds"), "{message}");
}

#[test]
fn what_a_near_plane_hides_is_not_carved() {
    let field = ball();
    let mut cameras = orbit::cameras(&field.outline(), 14, Layout::Sphere, 40, 36, 35.0, Up::Z);
    // One camera begins to see behind the whole medium: its picture is empty.
    cameras[4].near = 2.0 * (cameras[4].position() - field.world_bounds().centre()).length();
    let pictures = photos(&field, &cameras, [1.0; 3]);
    assert!(pictures[4].film.rgba.iter().all(|p| p[3] == 0.0));
    let observation = Observation::new(&pictures, [1.0; 3], [0.0; 3]).unwrap();
    let bounds = Hull::new(&observation).bounds().unwrap();
    let content = field.outline().into_iter().fold(Aabb::EMPTY, Aabb::including);
    assert!(bounds.size().min_element() > 0.7 * content.size().min_element(), "{bounds:?}");
}

#[test]
fn transmittance_is_read_off_any_grey_medium() {
    let camera = orbit::cameras(&[DVec3::ZERO, DVec3::ONE], 1, Layout::Ring, 4, 1, 30.0, Up::Z)[0];
    let (source, background) = ([0.9, 0.1, 0.4], [0.0, 0.5, 0.4]);
    let mut film = Film::new(4, 1);
    for (pixel, t) in film.rgba.iter_mut().zip([1.0_f32, 0.5, 0.01, 0.25]) {
        *pixel = [0, 1, 2, 3].map(|c| if c == 3 { 1.0 - t } else { source[c] * (1.0 - t) + background[c] * t });
    }
    film.rgba[3][1] = f32::NAN;
    let photo = Photo { camera, film, name: "view".into(), photograph: false };
    // One pixel in four is more than is tolerated in a whole picture; among ten it is not.
    assert!(Observation::new(std::slice::from_ref(&photo), background, source).is_err());
    let mut wide = photo;
    wide.film = Film::of(12, 1, [&wide.film.rgba[..], &[[0.0, 0.5, 0.4, 0.0]; 8]].concat());
    let map = &Observation::new(&[wide], background, source).unwrap().maps[0];
    let depths = map.depths();
    for (depth, t) in depths.depth.iter().zip([1.0_f32, 0.5, 0.01]) {
        // Colors near 0.5 are rounded at 3e-8; at T = 0.01 that is 6e-6 of the depth.
        assert!((depth + t.ln()).abs() < 2e-5, "{depth} {t}");
    }
    assert_eq!((depths.depth[3], depths.weight[3]), (0.0, 0.0));
    assert!(depths.weight[..3].iter().all(|w| *w > 0.2 && *w <= 1.0), "{:?}", depths.weight);
}

/// `⟨A x, y⟩ = ⟨x, Aᵀ y⟩` through the one walk that gives both.
#[test]
fn the_operator_has_its_transpose() {
    let field = ball();
    let observation = observed(&field, 3);
    let maps: Vec<&DepthMap> = observation.maps.iter().collect();
    for rays in [1, 2] {
        let mut projector = Projector::new(field.topology.clone(), field.transform, 1.5, rays);
        let n = projector.unknowns();
        let views = projector.views(&maps, 1, &vec![true; n]);
        let (x, mut back) = (noise(n, 3), vec![0.0; n]);
        // y is the measured depth of each pixel.
        let [forward, _] = projector.normal(&x, &views, &mut back, |s, z| {
            let y = f64::from(s.depth);
            (y, [mean(z) * y, 0.0])
        });
        let backward = dot(&x, &back);
        assert!((forward / backward - 1.0).abs() < 1e-5, "{rays} rays: {forward} and {backward}");
    }
}

/// Pixels are put aside only if nothing of them depends on an unknown: what is left out of the walk is
/// zero in it, and sums over pixels are as if nothing were.
#[test]
fn idle_pixels_are_those_without_a_say() {
    let field = ball();
    let observation = observed(&field, 3);
    let maps: Vec<&DepthMap> = observation.maps.iter().collect();
    let mut projector = Projector::new(field.topology.clone(), field.transform, 1.5, 2);
    let n = projector.unknowns();
    let unknown: Vec<bool> = (0..n).map(|i| i % 512 == 77).collect();
    let (all, some) = (projector.views(&maps, 1, &vec![true; n]), projector.views(&maps, 1, &unknown));
    let count = |views: &[View]| views.iter().map(|v| (v.samples.len(), v.idle.len())).collect::<Vec<_>>();
    assert!(count(&all).iter().zip(count(&some)).all(|(a, s)| s.1 > a.1 && s.0 > 0 && s.0 < a.0));
    let x: Vec<f32> = noise(n, 5).iter().zip(&unknown).map(|(x, u)| if *u { *x } else { 0.0 }).collect();
    let square = |s: &Sample, z: &[f64]| (mean(z) - f64::from(s.depth)).powi(2);
    let (a, s) = (projector.measure(&x, &all, square), projector.measure(&x, &some, square));
    assert!((a - s).abs() < 1e-9 * a, "{a} {s}");
    let mut backward = [vec![0.0; n], vec![0.0; n]];
    for (views, out) in [&all, &some].into_iter().zip(&mut backward) {
        projector.normal(&x, views, out, |s, z| (mean(z) - f64::from(s.depth), [0.0; 2]));
    }
    for i in (0..n).filter(|i| unknown[*i]) {
        assert!((backward[0][i] - backward[1][i]).abs() <= 1e-4 * backward[0][i].abs().max(1e-2), "voxel {i}");
    }
}

#[test]
fn the_solver_goes_down_and_stays_above_zero() {
    let field = ball();
    let observation = observed(&field, 10);
    let mut projector = Projector::new(field.topology.clone(), field.transform, 1.5, 1);
    let mut smoother = Smoother::new(&field.topology, 1, 0.2);
    let n = projector.unknowns();
    let views = projector.views(&observation.maps.iter().collect::<Vec<_>>(), 1, &vec![true; n]);
    let depths = Depths::new(&views, &mut projector);
    let mut solver = Solver::new(depths, &mut smoother, &vec![true; n], vec![0.0; n]);
    let mut losses = Vec::new();
    for _ in 0..4 {
        assert!(solver.iterate());
        losses.push(solver.loss());
    }
    assert!(losses.windows(2).all(|w| w[1] < w[0]), "{losses:?}");
    for _ in 0..16 {
        solver.iterate();
    }
    assert!(solver.loss() < 0.1 * losses[0], "{losses:?}, then {}", solver.loss());
    let found = solver.solution();
    assert!(found.iter().all(|v| *v >= 0.0 && v.is_finite()));
    // What is returned has its negative values set to zero, which must cost nothing: the solver holds them there itself.
    // Cycles of 4 and 8 iterations begin with that; after one more iteration few voxels are below zero, and by little.
    solver.iterate();
    let (found, told) = (solver.solution(), solver.loss());
    let [_, square] = solver.equations.residual(&found, f64::INFINITY, &mut vec![0.0; n]);
    let seen = (square / solver.equations.rows() as f64).sqrt();
    // Measured: 5e-8.
    assert!((seen / told - 1.0).abs() < 1e-4, "the loss is {told}, and that of the solution {seen}");
}

/// Two equations in two unknowns: `a + b = 1`, `a + 2 b = 0`.
struct Two {
    unknowns: [usize; 2],
}

impl Two {
    const ROWS: [[f64; 2]; 2] = [[1.0, 1.0], [1.0, 2.0]];
    const RIGHT: [f64; 2] = [1.0, 0.0];

    fn product(&self, x: &[f32]) -> [f64; 2] {
        Self::ROWS.map(|row| row.iter().zip(self.unknowns).map(|(a, i)| a * f64::from(x[i])).sum())
    }

    fn transpose(&self, y: [f64; 2], out: &mut [f32]) {
        out.fill(0.0);
        for (k, i) in self.unknowns.into_iter().enumerate() {
            out[i] = (0..2).map(|row| Self::ROWS[row][k] * y[row]).sum::<f64>() as f32;
        }
    }
}

impl Equations for Two {
    fn rows(&self) -> usize {
        2
    }
    fn normal(&mut self, x: &[f32], out: &mut [f32]) -> f64 {
        let y = self.product(x);
        self.transpose(y, out);
        y.iter().map(|y| y * y).sum()
    }
    fn residual(&mut self, x: &[f32], _bound: f64, out: &mut [f32]) -> [f64; 2] {
        let product = self.product(x);
        let miss = [0, 1].map(|row| Self::RIGHT[row] - product[row]);
        self.transpose(miss, out);
        [miss.iter().map(|m| m.abs()).sum(), miss.iter().map(|m| m * m).sum()]
    }
}

/// The solution without a bound is a = 2, b = -1. With b set to zero afterwards a would stay 2; the least squares among
/// what is not negative have b = 0 and a = 1/2, the mean of 1 and 0.
#[test]
fn what_is_held_at_zero_changes_the_rest() {
    let topology = Topology::new([IVec3::ZERO]).unwrap();
    let mut smoother = Smoother::new(&topology, 0, 0.2);
    let unknowns = [100, 300];
    let hull: Vec<bool> = (0..LEAF_VOXELS).map(|i| unknowns.contains(&i)).collect();
    let mut solver = Solver::new(Two { unknowns }, &mut smoother, &hull, vec![0.0; LEAF_VOXELS]);
    // Two unknowns take two iterations of a cycle; holding one takes another cycle.
    for _ in 0..40 {
        if !solver.iterate() {
            break;
        }
    }
    let found = solver.solution();
    // Rounding of f32 in sums of two, some iterations over.
    assert!((found[100] - 0.5).abs() < 1e-5 && found[300] == 0.0, "{} and {}", found[100], found[300]);
}

/// Noise is told from detail: the estimate follows what was added to the pictures and sees none in them.
#[test]
fn weights_follow_the_noise() {
    let field = ball();
    let cameras = orbit::cameras(&field.outline(), 4, Layout::Sphere, 64, 64, 35.0, Up::Z);
    let weight = |sigma: f32| {
        let mut photos = photos(&field, &cameras, [1.0; 3]);
        for (k, photo) in photos.iter_mut().enumerate() {
            let n = photo.film.rgba.len();
            let (a, b, c) = (noise(n, k as u64), noise(n, k as u64 + 100), noise(n, k as u64 + 200));
            for (i, pixel) in photo.film.rgba.iter_mut().enumerate().filter(|(_, p)| p[3] > 0.0) {
                let add = sigma * 2.0 * (a[i] + b[i] + c[i] - 1.5);
                pixel[..3].iter_mut().for_each(|v| *v += add);
            }
            // Alpha would be the more exact.
            photo.film.rgba.iter_mut().for_each(|p| p[3] = 1.0);
        }
        let observation = Observation::new(&photos, [1.0; 3], [0.0; 3]).unwrap();
        let found: Vec<f64> = observation.maps.iter().map(|m| m.noise).collect();
        // The weight of the darkest pixel falls with the noise.
        let depths: Vec<_> = observation.maps.iter().map(|m| m.depths().into_owned()).collect();
        let weights = depths.iter().flat_map(|m| m.weight.iter().zip(&m.depth));
        let darkest = weights.filter(|(_, d)| (0.9..1.1).contains(*d)).map(|(w, _)| *w).fold(1.0, f32::min);
        let largest = depths.iter().flat_map(|m| &m.weight).fold(0.0, |a: f32, b| a.max(*b));
        (observation.clean, darkest, largest, found)
    };
    let (clean, noisy) = (weight(0.0), weight(0.05));
    // The weight is r² / (1 + r²) of r = trust · T. Trust is 0.08 of the noise, from 1 to 60; where there is noise of
    // 0.05 it is about 1.6, and so is the largest r, at T = 1.
    let weigh = |trust: f32, depth: f32| (trust * (-depth).exp()).powi(2) / (1.0 + (trust * (-depth).exp()).powi(2));
    let expected = weigh(60.0, 1.1) - 1e-5..=weigh(60.0, 0.9) + 1e-5;
    assert!(clean.0 && expected.contains(&clean.1), "{clean:?}");
    assert!(!noisy.0 && (weigh(1.4, 0.0)..=weigh(1.9, 0.0)).contains(&noisy.2), "{noisy:?}");
    // The ball fills a few hundred pixels of each picture, which tell a deviation to about 5 %.
    assert!(noisy.3.iter().all(|n| (0.043..0.057).contains(n)), "{noisy:?}");
    assert!(clean.3.iter().all(|n| *n < 4e-3), "{clean:?}");
}

/// Photographs: what the camera calls black counts as none, and an error counts by its share of the depth.
#[test]
fn photographs_have_a_black_and_count_by_shares() {
    const SIDE: usize = 32;
    let light =
        |i: usize| [0.0, 0.05, 0.5][usize::from((8..24).contains(&(i / SIDE))) * (1 + usize::from(i % SIDE > 15))];
    let film = Film::of(SIDE, SIDE, (0..SIDE * SIDE).map(|i| [light(i) + 0.004; 4]).collect());
    let camera = orbit::cameras(&[DVec3::ZERO, DVec3::ONE], 1, Layout::Ring, SIDE as u32, SIDE as u32, 40.0, Up::Z)[0];
    let observe = |photograph: bool| {
        let photo = Photo { camera, film: film.clone(), name: "view".into(), photograph };
        Observation::new(&[photo], [0.0; 3], [1.0; 3]).unwrap()
    };
    let (photograph, render) = (observe(true), observe(false));
    assert!(photograph.photographs() && !render.photographs());
    let at = |x: usize| 16 * SIDE + x;
    // The border shows the medium in a quarter of its pixels.
    let depths = photograph.maps[0].depths();
    let [thin, dense] = [4, 28].map(|x| (photograph.maps[0].transmittance[at(x)], depths.weight[at(x)]));
    assert!((thin.0 - 0.95).abs() < 1e-6 && (dense.0 - 0.5).abs() < 1e-6, "{thin:?} {dense:?}");
    // (0.3 + τ)² of the two depths, where noise has no say.
    let share = |t: f64| (0.3 / (0.3 - t.ln())).powi(2);
    assert!((f64::from(thin.1) - share(0.95)).abs() < 0.01 && (f64::from(dense.1) - share(0.5)).abs() < 0.01);
    assert!((render.maps[0].transmittance[at(4)] - 0.946).abs() < 1e-6);
    assert!(!photograph.maps[0].shown[0] && photograph.maps[0].shown[at(4)]);
}

/// The mean depth of dark pixels is right whatever their noise: logarithms of single pixels would be off by far.
#[test]
fn noise_leaves_no_bias_in_depths() {
    const SIDE: usize = 96;
    let camera = orbit::cameras(&[DVec3::ZERO, DVec3::ONE], 1, Layout::Ring, SIDE as u32, SIDE as u32, 30.0, Up::Z)[0];
    let (sigma, dark) = (0.05, 0.1_f32);
    let n = noise(3 * SIDE * SIDE, 5);
    let mut film = Film::new(SIDE, SIDE);
    for i in 0..SIDE * SIDE {
        let light = if i % SIDE < SIDE / 2 { dark } else { 1.0 };
        let light = light + sigma * 2.0 * (n[3 * i] + n[3 * i + 1] + n[3 * i + 2] - 1.5);
        film.rgba[i] = [light, light, light, 1.0];
    }
    let observation =
        Observation::new(&[Photo { camera, film, name: "view".into(), photograph: false }], [1.0; 3], [0.0; 3])
            .unwrap();
    let map = observation.maps[0].depths();
    let inner = (0..SIDE * SIDE).filter(|i| (3..SIDE / 2 - 3).contains(&(i % SIDE)));
    let (sum, weight) = inner.fold((0.0, 0.0), |(sum, weight), i| {
        let w = f64::from(map.weight[i]);
        (sum + w * f64::from(map.depth[i]), weight + w)
    });
    // The noise over T is 0.5, a fifth of that in the mean T₀ of 25 pixels: 0.1² / 2 of curvature are left, and the
    // weights, which grow as T₀², add about twice 0.1². By logarithms the mean is off by 0.12 and more.
    let bias = sum / weight + f64::from(dark).ln();
    assert!(bias.abs() < 0.04, "{bias}");
}

/// A faint medium is found by means over many pixels, the empty ones around it are not, and one hot pixel shows nothing.
#[test]
fn empty_pixels_are_told_in_noise() {
    const SIDE: usize = 128;
    let camera = orbit::cameras(&[DVec3::ZERO, DVec3::ONE], 1, Layout::Ring, SIDE as u32, SIDE as u32, 30.0, Up::Z)[0];
    let sigma = 0.05;
    // Noise as it is, cut at the background, and the same in two neighbours.
    for kind in ["white", "cut", "correlated"] {
        let n = noise(3 * SIDE * SIDE + 6, 11);
        let white = |i: usize| sigma * 2.0 * (n[3 * i] + n[3 * i + 1] + n[3 * i + 2] - 1.5);
        let mut film = Film::new(SIDE, SIDE);
        for i in 0..SIDE * SIDE {
            let (x, y) = ((i % SIDE) as f32 - 63.5, (i / SIDE) as f32 - 63.5);
            // Hardly more than the noise up to a radius of 32, and nothing from there on.
            let opacity = 0.08 * f32::from(x.hypot(y) < 32.0);
            let noise = if kind == "correlated" { (white(i) + white(i + 1)) / 2.0_f32.sqrt() } else { white(i) };
            let light = 1.0 - opacity + noise;
            let light = if kind == "cut" { light.min(1.0) } else { light };
            film.rgba[i] = [light, light, light, 1.0];
        }
        film.rgba[5 * SIDE + 5] = [-3.0, -3.0, -3.0, 1.0];
        let observation =
            Observation::new(&[Photo { camera, film, name: "view".into(), photograph: false }], [1.0; 3], [0.0; 3])
                .unwrap();
        let shown = &observation.maps[0].shown;
        let share = |within: &dyn Fn(f32) -> bool| {
            let radius = |i: usize| ((i % SIDE) as f32 - 63.5).hypot((i / SIDE) as f32 - 63.5);
            let all: Vec<bool> = (0..SIDE * SIDE).filter(|i| within(radius(*i))).map(|i| shown[i]).collect();
            all.iter().filter(|s| **s).count() as f64 / all.len() as f64
        };
        let (inside, outside) = (share(&|r| r < 26.0), share(&|r| r > 46.0));
        assert!(inside > 0.98 && outside < 0.002, "{kind}: {inside} inside, {outside} outside");
        assert!(observation.noisy() && !observation.clean);
    }
}

/// What was added up for other views before leaves nothing behind, and parts of pictures add up to the whole.
#[test]
fn gradients_of_pictures_are_sums_over_rays() {
    let field: Bricks<f32> = field(40, odd(), lumps(40));
    let dvr = Dvr::new(&field, Medium::absorbing(0.3)).unwrap().over([1.0; 3]);
    let bounds = field.world_bounds();
    let target = |angle: f64| {
        let eye = bounds.centre() + 1.3 * bounds.size().max_element() * DVec3::new(angle.cos(), angle.sin(), 0.3);
        let camera = Camera {
            camera_to_world: Camera::look_at(eye, bounds.centre(), DVec3::Z),
            projection: Projection::Perspective,
            focal: DVec2::splat(90.0),
            centre: DVec2::new(40.0, 37.0),
            width: 83,
            height: 77,
            near: 0.0,
            blur: Blur::default(),
        };
        Target { camera, rgba: vec![[0.2; 4]; 83 * 77], rays_per_edge: 1 }
    };
    let squares = |seen: &[f32; 4], wanted: &[f32; 4]| {
        let d: [f32; 4] = std::array::from_fn(|c| seen[c] - wanted[c]);
        (d.iter().map(|d| f64::from(d * d)).sum(), d.map(|d| 2.0 * d))
    };
    let mut kept = Workspace::default();
    let mut of = |target: &Target, accumulators: Option<&mut Workspace<f32, Tape<f32>>>| {
        let mut sum = vec![0.0; field.values.len()];
        let mut gradients = Gradients { voxels: Some(&mut sum), ..Gradients::default() };
        let accumulators = accumulators.unwrap_or(&mut kept);
        pictures::gradient(&dvr, &[target], &squares, Adjoint::Tape, accumulators, &mut gradients);
        sum
    };
    for angle in [0.3, 2.0, 4.5] {
        let target = target(angle);
        let (again, fresh) = (of(&target, None), of(&target, Some(&mut Workspace::default())));
        assert!(again == fresh, "other views left something behind");
        let (mut rays, mut tape) = (vec![0.0_f32; field.values.len()], Tape::default());
        for i in 0..83 * 77 {
            let ray = target.camera.ray(f64::from(i % 83) + 0.5, f64::from(i / 83) + 0.5);
            let sinks = Accumulators {
                voxels: Some(&mut rays),
                table: None,
                ray: None,
                shared: &mut ParameterGradient::default(),
            };
            dvr.vjp(&ray, &mut |seen| squares(&seen.rgba(), &[0.2; 4]).1, Adjoint::Tape, sinks, &mut tape);
        }
        let most = rays.iter().fold(0.0_f32, |m, v| m.max(v.abs()));
        let off = rays.iter().zip(&fresh).fold(0.0_f32, |m, (a, b)| m.max((a - b).abs()));
        assert!(most > 0.0 && off < 1e-5 * most, "off by {off}, of {most}");
    }
}

/// Tiles of pictures are handed out once each, and lanes have about as far to go through the volume as one another, where
/// parts of a picture differ by much.
#[test]
fn tiles_are_shared_out() {
    let field: Bricks<f32> = field(120, odd(), |_| 1.0);
    // Depth is length.
    let dvr = Dvr::new(&field, Medium::absorbing(1.0)).unwrap().early_stop(0.0).over([1.0; 3]);
    let centre = field.world_bounds().centre();
    let size = field.world_bounds().size().max_element();
    let camera = |angle: f64| Camera {
        camera_to_world: Camera::look_at(
            centre + 1.4 * size * DVec3::new(angle.cos(), angle.sin(), 0.4),
            centre,
            DVec3::Z,
        ),
        projection: Projection::Perspective,
        focal: DVec2::splat(150.0),
        // Off the middle: most of the picture is empty.
        centre: DVec2::new(180.0, 60.0),
        width: 240,
        height: 170,
        near: 0.0,
        blur: Blur::default(),
    };
    let cameras: Vec<Camera> = (0..20).map(|i| camera(0.3 + 0.9 * f64::from(i))).collect();
    // So many that rays that meet nothing are nothing.
    let lookups = vec![1000.0; field.topology.len()];
    for (pictures, lanes) in [(1, 4), (3, 16), (20, 8)] {
        let cameras: Vec<&Camera> = cameras[..pictures].iter().collect();
        let parts = Parts::new(&field, &lookups, &cameras, lanes, true);
        let mut handed_out: Vec<(usize, usize)> = parts.tiles.iter().flatten().map(|t| (t.picture, t.number)).collect();
        handed_out.sort_unstable();
        let tiles = Tiles::new(240, 170);
        let all = (0..pictures).flat_map(|picture| (0..tiles.count()).map(move |tile| (picture, tile)));
        assert!(handed_out.into_iter().eq(all), "each once");
        let way = |picture: usize, tile: usize| -> f64 {
            let ray = |[x, y]: [usize; 2]| cameras[picture].ray(x as f64 + 0.5, y as f64 + 0.5);
            tiles.pixels(tile).map(|pixel| dvr.medium.optical_depth(&ray(pixel))).sum()
        };
        let ways = parts.tiles.iter().map(|tiles| tiles.iter().map(|tile| way(tile.picture, tile.number)).sum());
        let ways: Vec<f64> = ways.collect();
        let mean = ways.iter().sum::<f64>() / lanes as f64;
        // Not exactly: a brick is taken for the rectangle around it.
        assert!(ways.iter().all(|way| (way / mean - 1.0).abs() < 0.5), "{pictures} in {lanes}: {mean}, {ways:?}");
    }
}

/// Rays of a pixel meet no brick but those whose footprints meet the pixel, wherever the camera stands: accumulators
/// are cleared and added up there alone.
#[test]
fn rays_stay_in_footprints() {
    let field: Bricks<f32> = field(40, odd(), lumps(40));
    let dvr = Dvr::new(&field, Medium::absorbing(0.3)).unwrap().over([1.0; 3]);
    let centre = field.world_bounds().centre();
    let size = field.world_bounds().size().max_element();
    let from = |eye: DVec3, projection: Projection, focal: f64| Camera {
        camera_to_world: Camera::look_at(eye, centre + DVec3::new(0.3, -0.2, 0.1), DVec3::Z),
        projection,
        focal: DVec2::splat(focal),
        centre: DVec2::new(13.0, 11.0),
        width: 24,
        height: 20,
        near: 0.0,
        blur: Blur::default(),
    };
    let away = centre + size * DVec3::new(1.1, -0.7, 0.4);
    let cameras = [
        from(away, Projection::Perspective, 18.0),
        from(away, Projection::Orthographic, 14.0 / size),
        // Inside: bricks lie beside the eye and behind it.
        from(centre + 0.2 * size * DVec3::X, Projection::Perspective, 9.0),
    ];
    for camera in cameras {
        let bricks = field.topology.bricks();
        let footprints: Vec<Footprint> =
            bricks.iter().map(|brick| Lens::new(&camera, &field.transform).footprint(*brick)).collect();
        let (mut met, mut all) = (0, 0);
        for i in (0..24 * 20).step_by(7) {
            let (x, y) = (i % 24, i / 24);
            let mut voxels = vec![0.0_f32; field.values.len()];
            let sinks = Accumulators {
                voxels: Some(&mut voxels),
                table: None,
                ray: None,
                shared: &mut ParameterGradient::default(),
            };
            let ray = camera.ray(x as f64 + 0.99, y as f64 + 0.01);
            dvr.vjp(&ray, &mut |_| [1.0; 4], Adjoint::Tape, sinks, &mut Tape::default());
            for (brick, values) in voxels.chunks(BRICK).enumerate() {
                let Footprint { low, high } = footprints[brick];
                let (left, top) = (x as f64, y as f64);
                let meets = low.x <= left + 1.0 && left <= high.x && low.y <= top + 1.0 && top <= high.y;
                assert!(meets || values.iter().all(|v| *v == 0.0), "{camera:?} pixel {x} {y}, brick {brick}");
                met += usize::from(meets);
                all += 1;
            }
        }
        assert!(met > 0 && met < all, "{met} of {all}: some are met, not all");
    }
}

/// Nothing is known of the colors that a wall hides, and of what may be behind it; in front of it both are.
#[test]
fn a_wall_hides_what_is_behind_it() {
    let bricks = (0..64).map(|i| IVec3::new(i >> 4, i >> 2 & 3, i & 3));
    let mut field = Bricks::<Vec4>::zeros(Arc::new(Topology::new(bricks).unwrap()), unit());
    let place = |field: &Bricks<Vec4>, voxel: usize| {
        let [brick, i] = [voxel / LEAF_VOXELS, voxel % LEAF_VOXELS].map(|n| n as i32);
        8 * field.topology.bricks()[brick as usize] + IVec3::new(i >> 6, i >> 3 & 7, i & 7)
    };
    let light = |at: IVec3| {
        if (14..17).contains(&at.x) { Vec4::new(20.0, 30.0, 40.0, 50.0) } else { Vec4::new(0.1, 0.2, 0.3, 0.05) }
    };
    let count = field.topology.len() * LEAF_VOXELS;
    let owned: Vec<Vec4> = (0..count).map(|voxel| light(place(&field, voxel))).collect();
    field.topology.clone().fill_apron(&owned, &mut field.values);
    let camera = Camera {
        camera_to_world: Camera::look_at(DVec3::new(-20.0, 15.5, 15.5), DVec3::new(0.0, 15.5, 15.5), DVec3::Z),
        projection: Projection::Orthographic,
        focal: DVec2::splat(2.0),
        centre: DVec2::splat(24.0),
        width: 48,
        height: 48,
        near: 0.0,
        blur: Blur::default(),
    };
    let view = MeasuredView { camera, rays_per_edge: 1, measured: &|_| true };
    let renderer = Preshaded::new(&field).over([0.9, 0.1, 0.4]);
    let known = confidence(&renderer, &[view], 0.01, &[(&[3], 0.1), (&[0, 1, 2], 0.1)], &Cancel::NEVER, |_, _| ());
    let known = known.unwrap();
    for (which, known) in ["extinction", "emission"].into_iter().zip(known) {
        for (voxel, known) in known.into_iter().enumerate() {
            let at = place(&field, voxel);
            // Where its neighbours are seen, too.
            let seen = (6..26).contains(&at.y) && (6..26).contains(&at.z);
            match at.x {
                1..12 if seen => assert!(known > 0.5, "{which} at {at}: {known}"),
                18.. => assert!(known < 1e-6, "{which} at {at}: {known}"),
                _ => assert!((0.0..=1.0).contains(&known)),
            }
        }
    }
}
