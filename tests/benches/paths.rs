//! What specialised kernels of path tracing save against the kernel that serves any number of volumes of any kind.

use super::fields;
use super::row::Row;
use super::turns::{in_turn, median, ratio};
use cumulo::math::Affine;
use cumulo::render::path::{PathTracer, Sampling};
use cumulo::scene::bricks::Bricks;
use cumulo::scene::environment::Environment;
use cumulo::scene::light::Light;
use cumulo::scene::medium::{Medium, Scattering, Source};
use cumulo::scene::orbit::{Layout, cameras};
use cumulo::scene::phase::Phase;
use cumulo::scene::scene::Scene;
use cumulo::scene::table::Table;
use cumulo::scene::volume::Volume;
use glam::{DVec3, Vec3};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Argument that asks for the rows.
pub const PATHS: &str = "--paths";

const VOXELS: i32 = 64;
const PIXELS: u32 = 64;

/// Twelve scenes by name: kinds of media, phase functions, depths and lights.
fn scenes() -> Vec<(&'static str, Scene)> {
    let lattice = Affine::uniform(1.0 / f64::from(VOXELS), DVec3::ZERO).unwrap();
    let lumps = fields::lumps(VOXELS);
    let field: Bricks<f32> = fields::field(VOXELS, lattice, |p| (lumps(p) - 0.1).max(0.0));
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
            cameras: cameras(&field.outline(), 1, Layout::Ring, PIXELS, PIXELS, 40.0),
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

/// Time to equal variance of the generic kernel over that of the specialised one: kernels differ in noise, too.
pub fn rows() -> Vec<Row> {
    let never = AtomicBool::new(false);
    let row = |(name, scene): (&'static str, Scene)| {
        let (own, generic) = (PathTracer::new(&scene).unwrap(), PathTracer::generic(&scene).unwrap());
        let picture = |tracer: &PathTracer<'_>, seed: u64| {
            tracer.picture(&scene.cameras[0], Sampling::new(64, seed), &[], &never).unwrap().film.rgba
        };
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
    };
    scenes().into_iter().map(row).collect()
}
