//! What specialised kernels of path tracing save against the kernel that serves any number of volumes of any kind, what
//! effects cost that are off, and how times grow with threads and voxels.

use super::fields;
use super::row::Row;
use super::turns::{in_turn, median, ratio};
use cumulo::cancel::Cancel;
use cumulo::math::Affine;
use cumulo::plan::{Plan, Request};
use cumulo::render::film::{self, Rendered, Sampling};
use cumulo::render::path::PathTracer;
use cumulo::scene::bricks::Bricks;
use cumulo::scene::environment::Environment;
use cumulo::scene::light::Light;
use cumulo::scene::medium::{Medium, Scattering, Source};
use cumulo::scene::orbit::{Layout, cameras};
use cumulo::scene::phase::Phase;
use cumulo::scene::scene::Scene;
use cumulo::scene::table::Table;
use cumulo::scene::up::Up;
use cumulo::scene::volume::Volume;
use glam::{DVec3, Vec3};
use rayon::ThreadPoolBuilder;
use std::sync::Arc;

/// Argument that asks for the rows.
pub const PATHS: &str = "--paths";

const VOXELS: i32 = 64;
const PIXELS: u32 = 64;

/// Lumps in the unit cube.
fn lumps(voxels: i32) -> Bricks<f32> {
    let lattice = Affine::uniform(1.0 / f64::from(voxels), DVec3::ZERO).unwrap();
    let lumps = fields::lumps(voxels);
    fields::field(voxels, lattice, |p| (lumps(p) - 0.1).max(0.0))
}

/// Twelve scenes by name: kinds of media, phase functions, depths and lights.
fn scenes() -> Vec<(&'static str, Scene)> {
    let field = lumps(VOXELS);
    let glow = [[0.0; 4], [0.9, 0.3, 0.1, 0.4], [0.1, 0.1, 0.8, 0.1], [1.0, 1.0, 1.0, 1.0]];
    let glow = Source::Transfer(Arc::new(Table::new(vec![0.0, 0.3, 0.6, 1.0], glow.to_vec()).unwrap()));
    let (dark, grey) = (Source::Grey([0.0; 3]), Source::Grey([1.0, 0.6, 0.2]));
    let (even, forward) = (Phase::Isotropic, Phase::HenyeyGreenstein(0.8));
    let sun = Light::Sun { direction: DVec3::new(0.4, -0.5, 0.8), irradiance: Vec3::ONE, angle: 0.01 };
    let point = Light::Point { position: DVec3::new(0.5, -1.0, 1.5), intensity: Vec3::ONE };
    let sphere = Light::Sphere { centre: DVec3::new(0.5, -1.0, 1.5), radius: 0.3, radiance: Vec3::ONE };
    let panel =
        Light::Rectangle { corner: DVec3::new(0.0, 0.0, 2.0), edges: [DVec3::Y, DVec3::X], radiance: Vec3::ONE };
    let scene = |extinction: f64, albedo: f32, phase, source: &Source, lights: &[Light], sky: f32| {
        let scattering = Some(Scattering::new([albedo; 3], phase));
        let medium = Medium { scattering, ..Medium::new(extinction, source.clone()) };
        Scene {
            cameras: cameras(&field.outline(), 1, Layout::Ring, PIXELS, PIXELS, 40.0, Up::Z),
            volumes: vec![Volume::Density(field.clone(), medium)],
            environment: Environment::constant([sky; 3]),
            lights: lights.to_vec(),
            ..Scene::default()
        }
    };
    vec![
        ("white sky", scene(10.0, 0.9, even, &dark, &[], 1.0)),
        ("white sky, forward", scene(10.0, 0.9, forward, &dark, &[], 1.0)),
        ("sun", scene(10.0, 0.9, even, &dark, &[sun], 0.0)),
        ("sun and sky, forward", scene(10.0, 0.9, forward, &dark, &[sun], 0.3)),
        ("thin, point light", scene(1.0, 0.9, even, &dark, &[point], 0.0)),
        ("dense cloud, forward", scene(60.0, 0.99, forward, &dark, &[sun], 0.3)),
        ("sphere light", scene(10.0, 0.7, even, &dark, &[sphere], 0.0)),
        ("panel, forward", scene(10.0, 0.7, forward, &dark, &[panel], 0.0)),
        ("emission, sun", scene(10.0, 0.5, even, &grey, &[sun], 0.0)),
        ("emission, sky, forward", scene(10.0, 0.5, forward, &grey, &[], 0.5)),
        ("transfer function, panel", scene(20.0, 0.7, even, &glow, &[panel], 0.0)),
        ("transfer function, sky, forward", scene(20.0, 0.7, forward, &glow, &[], 0.5)),
    ]
}

/// All rows.
pub fn rows() -> Vec<Row> {
    let of_scene = |(name, scene): (&'static str, Scene)| [kernels(name, &scene), events(name, &scene)];
    scenes().into_iter().flat_map(of_scene).chain([off_effects()]).chain(threads()).chain(resolutions()).collect()
}

fn picture(tracer: &PathTracer<'_>, scene: &Scene, seed: u64) -> Rendered {
    film::render(tracer, &scene.cameras[0], Sampling::random(64, seed), &[], &Cancel::NEVER).unwrap()
}

/// What effects cost that a plan has found to be off: lights that are black. Pictures must be the same bit for bit.
fn off_effects() -> Row {
    let cost = |(_, scene): &(&'static str, Scene)| {
        let mut more = scene.clone();
        more.lights.push(Light::Point { position: DVec3::new(0.2, 1.4, 1.7), intensity: Vec3::ZERO });
        more.lights.push(Light::Sphere { centre: DVec3::new(0.5, -1.0, 1.5), radius: 0.3, radiance: Vec3::ZERO });
        let planned = Plan::new(&more, &more.cameras, &Request::default()).unwrap().simplify(more).unwrap();
        let [own, with] = [scene, &planned].map(|scene| PathTracer::new(scene).unwrap());
        assert_eq!(picture(&own, scene, 1).film, picture(&with, &planned, 1).film);
        let [own, with] = in_turn([&mut || drop(picture(&own, scene, 1)), &mut || drop(picture(&with, &planned, 1))]);
        ratio(&with, &own)
    };
    let costs: Vec<f64> = scenes().iter().map(cost).collect();
    let [least, most] = [f64::min, f64::max].map(|of| costs.iter().copied().reduce(of).unwrap_or(1.0));
    let mean = costs.iter().sum::<f64>() / costs.len() as f64;
    Row::at_most("paths", "off effects, mean of the scenes", format!("{least:.2} to {most:.2}"), mean, 1.02)
}

/// Events of a path beside their least number: a lookup for each collision that tracking finds, and in the light of lights a
/// ray for each scattering.
fn events(name: &str, scene: &Scene) -> Row {
    let counts = picture(&PathTracer::new(scene).unwrap(), scene, 1).counts;
    let each = |events: u64| events as f64 / counts.paths as f64;
    let text = format!(
        "{:.2} collisions, {:.2} lookups, {:.2} rays to lights",
        each(counts.collisions),
        each(counts.lookups),
        each(counts.shadow_rays)
    );
    Row::figure("events a path", name, text)
}

/// Two threads against one.
fn threads() -> Vec<Row> {
    let row = |(name, scene): &(&'static str, Scene)| {
        let tracer = PathTracer::new(scene).unwrap();
        let pools = [1, 2].map(|threads| ThreadPoolBuilder::new().num_threads(threads).build().unwrap());
        let [one, two] = in_turn([&mut || drop(pools[0].install(|| picture(&tracer, scene, 1))), &mut || {
            drop(pools[1].install(|| picture(&tracer, scene, 1)))
        }]);
        let text = |of: &[f64]| format!("{:.1} ms", 1e3 * median(of));
        let work = format!("paths, {name}, 2 threads: efficiency");
        Row::at_least("B11", work, text(&two), 0.5 * ratio(&one, &two), 0.9).against(text(&one))
    };
    scenes().iter().take(3).map(row).collect()
}

/// Larger volumes of the same medium: rays cross twice as many cells where there are twice as many voxels along an edge.
fn resolutions() -> Vec<Row> {
    let of = |voxels: i32| {
        let (_, mut scene) = scenes().swap_remove(2);
        if let Volume::Density(field, _) = &mut scene.volumes[0] {
            *field = lumps(voxels);
        }
        scene
    };
    let [small, large] = [64, 256].map(of);
    let tracers = [&small, &large].map(|scene| PathTracer::new(scene).unwrap());
    let [few, many] =
        in_turn([&mut || drop(picture(&tracers[0], &small, 1)), &mut || drop(picture(&tracers[1], &large, 1))]);
    let text = |of: &[f64]| format!("{:.1} ms", 1e3 * median(of));
    vec![
        Row::at_most("B11", "paths, sun, 256³ against 64³ voxels", text(&many), ratio(&many, &few), 4.0)
            .against(text(&few)),
    ]
}

/// Time to equal variance of the generic kernel over that of the specialised one: kernels differ in noise, too.
fn kernels(name: &str, scene: &Scene) -> Row {
    let (own, generic) = (PathTracer::new(scene).unwrap(), PathTracer::generic(scene).unwrap());
    let picture = |tracer: &PathTracer<'_>, seed: u64| picture(tracer, scene, seed).film.rgba;
    // Half of the mean square of the difference of two pictures is the variance of one.
    let variance = |tracer: &PathTracer<'_>| {
        let squares = (0..4).flat_map(|pair| {
            let [a, b] = [2 * pair, 2 * pair + 1].map(|seed| picture(tracer, seed));
            a.into_iter().zip(b).map(|(a, b)| 0.5 * f64::from(a[1] - b[1]).powi(2)).collect::<Vec<_>>()
        });
        let squares: Vec<f64> = squares.collect();
        squares.iter().sum::<f64>() / squares.len() as f64
    };
    let [noise, of_generic] = [variance(&own), variance(&generic)];
    let [seconds, generic] = in_turn([&mut || drop(picture(&own, 1)), &mut || drop(picture(&generic, 1))]);
    let text = |of: &[f64], variance: f64| format!("{:.1} ms, deviation {:.4}", 1e3 * median(of), variance.sqrt());
    let gain = ratio(&generic, &seconds) * of_generic / noise;
    Row::at_least("paths", name, text(&seconds, noise), gain, 1.0).against(text(&generic, of_generic))
}
