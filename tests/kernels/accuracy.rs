//! Stated errors of pictures against converged ones, over many seeds.
//!
//! `COVERAGE_SEEDS=1000` runs the long form, of which `make coverage` prints a table.

use crate::common::fields::{field, lumps, unit};
use cumulo::cancel::Cancel;
use cumulo::render::accuracy::demand::Deal;
use cumulo::render::accuracy::interval::Intervals;
use cumulo::render::accuracy::pilot::{Goal, pilot};
use cumulo::render::film::{Blocks, FEWEST, Replicates, Sampling, View};
use cumulo::render::path::PathTracer;
use cumulo::scene::camera::{Camera, Projection};
use cumulo::scene::environment::Environment;
use cumulo::scene::light::Light;
use cumulo::scene::medium::{Medium, Scattering, Source};
use cumulo::scene::phase::Phase;
use cumulo::scene::scene::Scene;
use cumulo::scene::table::Table;
use cumulo::scene::volume::Volume;
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;
use std::sync::Arc;

/// Pixels along the edges of the pictures.
const SIZE: u32 = 32;

fn camera() -> Camera {
    Camera {
        camera_to_world: Camera::look_at(DVec3::new(9.5, -28.0, 16.0), DVec3::splat(9.5), DVec3::Z),
        focal: DVec2::splat(1.4 * f64::from(SIZE)),
        centre: DVec2::splat(0.5 * f64::from(SIZE)),
        width: SIZE,
        height: SIZE,
        near: 0.0,
        projection: Projection::Perspective,
    }
}

fn sun(irradiance: f32) -> Light {
    Light::Sun { direction: DVec3::new(0.5, -0.3, 1.0), irradiance: Vec3::splat(irradiance), angle: 0.01 }
}

fn dense(extinction: f64, albedo: f32, phase: Phase) -> Medium {
    Medium { scattering: Some(Scattering::new([albedo; 3], phase)), ..Medium::absorbing(extinction) }
}

/// Scenes that differ in what makes their noise.
fn scenes() -> Vec<(&'static str, Scene)> {
    let lumpy = || field(20, unit(), lumps(20));
    let sky = |v: f32| Environment::constant([v; 3]);
    let of = |volumes, environment, lights| Scene { volumes, environment, lights, ..Scene::default() };
    let hg = Phase::HenyeyGreenstein(0.8);
    let table =
        Table::new(vec![0.0, 0.3, 0.5, 1.0], vec![[0.0; 4], [0.8, 0.3, 0.1, 0.0], [0.1, 0.6, 0.9, 0.9], [1.0; 4]]);
    let function = Medium {
        scattering: Some(Scattering::new([0.8; 3], Phase::Isotropic)),
        ..Medium::new(0.8, Source::Transfer(Arc::new(table.unwrap())))
    };
    let fire = Medium {
        scattering: Some(Scattering::new([0.3; 3], Phase::Isotropic)),
        ..Medium::new(0.4, Source::Grey([4.0, 1.2, 0.3]))
    };
    let moved = field(20, cumulo::math::Affine::uniform(0.8, DVec3::new(3.0, 1.0, 2.0)).unwrap(), lumps(20));
    vec![
        (
            "thin plume",
            of(vec![Volume::Density(lumpy(), dense(0.05, 0.9, Phase::Isotropic))], sky(0.2), vec![sun(3.0)]),
        ),
        ("dense cloud", of(vec![Volume::Density(lumpy(), dense(2.0, 0.95, hg))], sky(0.3), vec![sun(3.0)])),
        ("fire", of(vec![Volume::Density(lumpy(), fire)], sky(0.0), vec![])),
        ("transfer function", of(vec![Volume::Density(lumpy(), function)], sky(0.5), vec![sun(2.0)])),
        (
            "light inside",
            of(
                vec![Volume::Density(lumpy(), dense(0.3, 0.9, Phase::Isotropic))],
                sky(0.0),
                vec![Light::Point { position: DVec3::new(9.0, 9.0, 11.0), intensity: Vec3::splat(30.0) }],
            ),
        ),
        (
            "overlapping volumes",
            of(
                vec![
                    Volume::Density(lumpy(), dense(0.3, 0.9, Phase::Isotropic)),
                    Volume::Density(moved, dense(0.6, 0.7, Phase::HenyeyGreenstein(0.5))),
                ],
                sky(0.3),
                vec![sun(2.0)],
            ),
        ),
    ]
}

/// Renders a picture whose error is to be `error` by its scale.
fn picture(tracer: &PathTracer<'_>, camera: &Camera, error: f64, seed: u64) -> Replicates {
    let sampling = |paths: u32, stream: u64| Sampling::random(paths, (seed << 40) ^ stream);
    let view = View::from(camera);
    let watch = (&Cancel::NEVER).into();
    let (demand, _) = pilot(tracer, view, sampling, (Goal::Error(error), 0.95), watch).unwrap();
    let deal = Deal::new(demand.paths(error), 2 * FEWEST);
    let mut replicates = Replicates::new([SIZE as usize; 2], &[]);
    for number in 0..deal.replicates() {
        let rays = deal.replicate(number, |paths| sampling(paths, number.into()));
        assert!(replicates.add(tracer, view, &rays, watch));
    }
    replicates
}

/// Renders a converged picture.
fn converged(tracer: &PathTracer<'_>, camera: &Camera, paths: u32) -> Replicates {
    let mut reference = Replicates::new([SIZE as usize; 2], &[]);
    for number in 0..16 {
        let rays = vec![Some(Sampling::random(paths / 16, u64::MAX - number)); Blocks::new([SIZE as usize; 2]).count()];
        assert!(reference.add(tracer, View::from(camera), &rays, &Cancel::NEVER));
    }
    reference
}

#[test]
fn intervals_hold_what_they_state() {
    let seeds: u64 = std::env::var("COVERAGE_SEEDS").ok().and_then(|n| n.parse().ok()).unwrap_or(40);
    let error: f64 = std::env::var("COVERAGE_ERROR").ok().and_then(|n| n.parse().ok()).unwrap_or(0.03);
    println!("| scene | paths a pixel | intervals | held | stated | errors within the target |");
    let only = std::env::var("COVERAGE_SCENE").ok();
    for (name, scene) in scenes().into_iter().filter(|(name, _)| only.as_ref().is_none_or(|only| only == name)) {
        let tracer = PathTracer::new(&scene).unwrap();
        let camera = camera();
        let truth = Intervals::of(&converged(&tracer, &camera, if seeds > 100 { 65_536 } else { 4096 }), 0.95);
        let begun = std::time::Instant::now();
        let of_seed = |seed: u64| {
            let made = picture(&tracer, &camera, error, seed);
            let stated = Intervals::of(&made, 0.95);
            let paths: u64 = made.sums().iter().map(|sums| sums.paths).sum();
            let mut n = [paths as usize, 0, 0, 0, 0, 0, 0];
            for (found, truth) in stated.blocks.iter().zip(&truth.blocks) {
                n[1] += 1;
                if found.doubt.is_some() {
                    continue;
                }
                n[2] += 1;
                let off = |c: usize| found.mean[c] - truth.mean[c];
                if found.doubt_within(error * stated.scale).is_none() {
                    n[5] += 1;
                    n[6] += usize::from((0..3).all(|c| off(c).abs() <= error * stated.scale));
                }
                for c in 0..3 {
                    let allowed = found.half_width[c].hypot(truth.half_width[c]);
                    // What both pictures show without noise tells nothing.
                    if found.half_width[c] > 0.0 {
                        n[3] += 1;
                        n[4] += usize::from(off(c).abs() <= allowed);
                    }
                }
            }
            n
        };
        let sums =
            (0..seeds).into_par_iter().map(of_seed).reduce(|| [0; 7], |a, b| std::array::from_fn(|i| a[i] + b[i]));
        eprintln!("{:.1} s", begun.elapsed().as_secs_f64());
        let share = |a: usize, b: usize| 100.0 * a as f64 / b.max(1) as f64;
        println!(
            "| {name} | {:.0} | {} | {:.2} % | {:.1} % | certified {:.1} %, of these within {:.2} % |",
            sums[0] as f64 / (seeds as f64 * f64::from(SIZE * SIZE)),
            sums[3],
            share(sums[4], sums[3]),
            share(sums[2], sums[1]),
            share(sums[5], sums[1]),
            share(sums[6], sums[5])
        );
    }
}
