//! Albedos by density: against volumes of one albedo, closed forms, and a tracker of its own that is as simple as can
//! be.

use crate::common::fields::{field, lumps, noise, unit};
use crate::common::scenes::Draw;
use crate::path_tracing::{ALBEDO, Estimate, assert_agree, estimate, exact, lumpy, medium, peaks, scene, through};
use crate::plan::{MOST, excess, picture, request};
use cumulo::math::{Affine, Ray};
use cumulo::plan::{Effect, Integrator, Plan, State};
use cumulo::render::integrator::Integrator as _;
use cumulo::render::path::{Limits, PathTracer, Scratch};
use cumulo::render::sampler::Sampler;
use cumulo::scene::albedo::AlbedoFunction;
use cumulo::scene::bricks::Bricks;
use cumulo::scene::environment::Environment;
use cumulo::scene::film::Moments;
use cumulo::scene::light::Light;
use cumulo::scene::medium::{Medium, Scattering, Source};
use cumulo::scene::phase::Phase;
use cumulo::scene::scene::Scene;
use cumulo::scene::volume::Volume;
use glam::{DVec3, Vec3};
use std::f64::consts::TAU;
use std::sync::Arc;

fn function(points: &[[f64; 4]]) -> Option<Arc<AlbedoFunction>> {
    Some(Arc::new(AlbedoFunction::new(points).unwrap()))
}

fn one_color([r, g, b]: [f64; 3]) -> Option<Arc<AlbedoFunction>> {
    function(&[[0.3, r, g, b]])
}

/// Red where the density is low, blue where it is high, with a step between.
fn red_and_blue() -> Option<Arc<AlbedoFunction>> {
    function(&[[0.1, 1.0, 0.2, 0.0], [0.4, 0.9, 0.3, 0.1], [0.4, 0.2, 0.6, 0.7], [0.9, 0.0, 0.1, 1.0]])
}

fn by_function(extinction: f64, source: Source) -> Medium {
    Medium { source, ..medium(extinction, ALBEDO, Phase::Isotropic) }
}

/// Scenes of every kind of kernel, all of whose media have an albedo.
fn scenes(lights: &[Light], sky: [f32; 3]) -> Vec<(&'static str, Scene)> {
    let lumpy = lumpy(unit());
    let of = |medium: Medium| scene(&lumpy, medium, lights.to_vec(), sky);
    let peaks = || Source::Transfer(Arc::new(peaks().without_color()));
    let phased = |phase, gradient_shading| Medium {
        scattering: Some(Scattering { gradient_shading, ..Scattering::new(ALBEDO, phase) }),
        ..by_function(0.3, peaks())
    };
    let moved = field(20, Affine::uniform(0.8, DVec3::new(3.0, 1.0, 2.0)).unwrap(), lumps(20));
    let beside = Volume::Density(moved, medium(0.05, ALBEDO, Phase::HenyeyGreenstein(0.5)));
    let mut overlapping = of(by_function(0.2, peaks()));
    overlapping.volumes.push(beside.clone());
    let chromatic = of(Medium { color: [1.0, 0.5, 0.25], ..by_function(0.3, peaks()) });
    let mut two = chromatic.clone();
    two.volumes.push(beside);
    vec![
        ("proportional", of(medium(0.2, ALBEDO, Phase::HenyeyGreenstein(-0.4)))),
        ("function", of(by_function(0.3, peaks()))),
        ("forward", of(phased(Phase::HenyeyGreenstein(0.6), None))),
        ("shaded", of(phased(Phase::Isotropic, Some(0.05)))),
        ("overlapping", overlapping),
        ("chromatic", chromatic),
        ("two, one of them chromatic", two),
    ]
}

/// Returns a scene whose media have these albedos.
fn colored(scene: &Scene, albedo: [f32; 3], function: &Option<Arc<AlbedoFunction>>) -> Scene {
    let mut scene = scene.clone();
    for volume in &mut scene.volumes {
        let Volume::Density(_, medium) = volume else { continue };
        medium.scattering.as_mut().unwrap().albedo = albedo;
        medium.albedo_function = function.clone();
    }
    scene
}

fn all(scene: &Scene, limits: Limits, paths: u32) -> Vec<Estimate> {
    let tracer = PathTracer::new(scene).unwrap().limits(limits);
    through(&lumpy(unit()), 4).iter().map(|ray| estimate(&tracer, ray, paths)).collect()
}

/// Of a medium that absorbs nothing before a sky that is the same from all around nothing is seen.
#[test]
fn white_functions_vanish_in_a_white_sky() {
    for (name, scene) in scenes(&[], [0.7, 1.0, 2.0]) {
        let found = all(&colored(&scene, [1.0; 3], &one_color([1.0; 3])), Limits::default(), 32);
        assert_agree(name, &found, &exact(vec![[0.7, 1.0, 2.0]; found.len()]));
    }
}

/// A function of one color is the volume's albedo, bit for bit; with lights inside the media, too.
#[test]
fn functions_of_one_color_are_albedos() {
    let lights = [
        Light::Sun { direction: DVec3::new(0.3, 0.2, 1.0), irradiance: Vec3::ONE, angle: 0.1 },
        Light::Sphere { centre: DVec3::new(9.0, 9.0, 11.0), radius: 0.5, radiance: Vec3::new(3.0, 2.0, 1.0) },
    ];
    let color = [0.75, 0.5, 0.125];
    for (name, scene) in scenes(&lights, [0.1, 0.2, 0.3]) {
        let expected = all(&colored(&scene, color.map(|v| v as f32), &None), Limits::default(), 4);
        assert_eq!(all(&colored(&scene, [1.0; 3], &one_color(color)), Limits::default(), 4), expected, "{name}");
        let half = all(&colored(&scene, [0.5; 3], &one_color(color)), Limits::default(), 4);
        assert_eq!(half, all(&colored(&scene, color.map(|v| 0.5 * v as f32), &None), Limits::default(), 4), "{name}");
    }
}

/// What a path tells of its first collision is the albedo at the density there.
#[test]
fn collisions_know_the_albedo_of_their_density() {
    let (field, function) = (lumpy(unit()), red_and_blue());
    let scene = colored(&scenes(&[], [1.0; 3])[1].1, ALBEDO, &function);
    let tracer = PathTracer::new(&scene).unwrap();
    let (mut scratch, mut seen) = (Scratch::default(), [0; 2]);
    for (number, ray) in through(&field, 4).iter().enumerate() {
        let primary = tracer.primary(ray, &mut scratch);
        for path in 0..64 {
            let mut sampler = Sampler::new(number as u64, [0, 0], path);
            let Some(first) = tracer.li(ray, &primary, &mut sampler, &mut scratch).first else { continue };
            let density = f64::from(field.sample(field.transform.to_index(first.position)));
            // Next to the step either side is right.
            if (density - 0.4).abs() > 1e-4 {
                let expected = DVec3::from_array(function.as_ref().unwrap().at(density)).as_vec3();
                let found = first.albedo - expected * Vec3::from_array(ALBEDO);
                assert!(found.abs().max_element() < 1e-3, "{density}: {} {expected}", first.albedo);
                seen[usize::from(density > 0.4)] += 1;
            }
        }
    }
    assert!(seen.into_iter().all(|count| count > 10), "{seen:?}");
}

/// Radiance along a ray by delta tracking in double precision, with one majorant for the field: paths of isotropic
/// scattering that end at the sky.
fn tracked(field: &Bricks<f64>, medium: &Medium, sky: DVec3, ray: &Ray, paths: u32) -> Estimate {
    let Source::Transfer(table) = &medium.source else { panic!("a function is expected") };
    let (function, majorant) = (medium.albedo_function.as_ref().unwrap(), medium.extinction * table.peak()[3]);
    let albedo = Vec3::from_array(medium.scattering.unwrap().albedo).as_dvec3();
    let (bounds, mut seed) = (field.world_bounds(), 0_u64);
    let mut number = || {
        seed += 1;
        noise(seed.wrapping_mul(7919))
    };
    let mut moments = [Moments::default(); 3];
    for _ in 0..paths {
        let (mut ray, mut weight, mut found) = (*ray, DVec3::ONE, DVec3::ZERO);
        'path: while let Some((enter, leave)) = bounds.clip(&ray) {
            let mut at = enter.max(0.0);
            let density = loop {
                at -= (1.0 - number()).ln() / majorant;
                if at >= leave {
                    break 'path;
                }
                let density = field.sample(field.transform.to_index(ray.at(at)));
                if number() * majorant < medium.extinction * table.at(density)[3] {
                    break density;
                }
            };
            let (scattered, source) = (albedo * DVec3::from_array(function.at(density)), table.at(density));
            found += weight * (DVec3::ONE - scattered) * DVec3::from_slice(&source);
            weight *= scattered;
            let (cosine, turn) = (2.0 * number() - 1.0, TAU * number());
            let sine = (1.0 - cosine * cosine).sqrt();
            let direction = DVec3::new(sine * turn.cos(), sine * turn.sin(), cosine);
            ray = Ray::new(ray.at(at), direction);
        }
        found += weight * sky;
        moments.iter_mut().zip(found.to_array()).for_each(|(m, v)| m.add(v));
    }
    moments.map(|m| [m.mean(), m.variance_of_mean()])
}

/// All orders of scattering with emission of the rest, in each channel.
#[test]
fn pictures_are_those_of_plain_delta_tracking() {
    let (field, sky) = (field::<f64>(20, unit(), lumps(20)), [0.4, 0.2, 1.0]);
    for (name, source) in [("dark", peaks().without_color()), ("emitting", peaks())] {
        let medium = Medium { albedo_function: red_and_blue(), ..by_function(0.5, Source::Transfer(Arc::new(source))) };
        let expected: Vec<_> = through(&lumpy(unit()), 4)
            .iter()
            .map(|ray| tracked(&field, &medium, Vec3::from_array(sky).as_dvec3(), ray, 60_000))
            .collect();
        let lit = scene(&lumpy(unit()), medium, vec![], sky);
        assert_agree(name, &all(&lit, Limits::default(), 128), &expected);
        // A test that finds nothing would tell nothing.
        let flat = colored(&lit, ALBEDO, &one_color([0.5; 3]));
        let apart = all(&flat, Limits::default(), 32);
        let far = |(a, b): (&Estimate, &Estimate)| (0..3).any(|c| (a[c][0] - b[c][0]).abs() > 0.02);
        assert!(apart.iter().zip(&expected).any(far), "{name}");
    }
}

/// The kernels of several and of chromatic volumes tell what that of one volume does.
#[test]
fn kernels_agree() {
    let lights =
        [Light::Sphere { centre: DVec3::new(9.0, 9.0, 11.0), radius: 0.5, radiance: Vec3::new(3.0, 2.0, 1.0) }];
    let one = colored(&scenes(&lights, [0.1, 0.2, 0.3])[1].1, ALBEDO, &red_and_blue());
    let expected = all(&one, Limits::default(), 64);
    let generic = PathTracer::generic(&one).unwrap();
    let found: Vec<_> = through(&lumpy(unit()), 4).iter().map(|ray| estimate(&generic, ray, 64)).collect();
    assert_agree("generic", &found, &expected);
    // A channel more or less of the same extinction changes nothing in the others.
    let mut chromatic = one.clone();
    let Volume::Density(_, medium) = &mut chromatic.volumes[0] else { panic!("a density is expected") };
    medium.color = [1.0, 1.0, 0.999];
    let mut found = all(&chromatic, Limits::default(), 64);
    found.iter_mut().zip(&expected).for_each(|(found, expected)| found[2] = expected[2]);
    assert_agree("chromatic", &found, &expected);
}

/// Random scenes with albedos by density: what a plan leaves out is missing, and no more than its bound.
#[test]
fn plans_keep_to_their_bounds() {
    let (mut left_out, mut straight) = (0, 0);
    for number in 100..125 {
        let mut draw = Draw(1000 * number);
        let mut scene = draw.scene();
        for volume in &mut scene.volumes {
            let Volume::Density(_, medium) = volume else { continue };
            let points = [0.0, 0.2, 0.5, 1.0].map(|d| [d, draw.number(), draw.number(), draw.number()]);
            medium.albedo_function = function(&points);
        }
        let full = picture(&scene, Integrator::PathTracing, Limits::default(), None, 1);
        for max_omitted in [0.0, 0.02, 0.3] {
            let plan = Plan::new(&scene, &scene.cameras, &request(max_omitted)).unwrap();
            let simplified = plan.simplify(scene.clone()).unwrap();
            let found = picture(&simplified, plan.integrator, plan.limits, plan.background, 2);
            let [missing, added] = [excess(&full, &found, plan.omitted.unwrap()), excess(&found, &full, 0.0)];
            assert!(missing < MOST && added < MOST, "scene {number}: {missing} {added} {plan:#?}");
            left_out += usize::from(plan.omitted > Some(0.0));
            straight += usize::from(plan.integrator == Integrator::DirectVolumeRendering);
        }
    }
    println!("left out {left_out}, straight {straight}");
    assert!(left_out > 5 && straight > 2, "{left_out} {straight}");
}

/// Where nothing is scattered any more, the share that each density leaves is emitted: paths tell it, as no table does.
#[test]
fn emission_without_scattering_is_that_of_each_density() {
    let mut scene = Draw(7).scene();
    let medium = Medium { albedo_function: red_and_blue(), ..by_function(0.002, Source::Transfer(Arc::new(peaks()))) };
    scene.volumes = vec![Volume::Density(lumpy(unit()), medium)];
    (scene.lights, scene.environment) = (Vec::new(), Environment::default());
    let plan = Plan::new(&scene, &scene.cameras, &request(1e9)).unwrap();
    assert_eq!(plan.integrator, Integrator::DirectVolumeRendering, "all may be left out");
    let plan = Plan::new(&scene, &scene.cameras, &request(0.05)).unwrap();
    let states = [Effect::Emission, Effect::Scattering].map(|effect| plan.state(effect));
    assert_eq!((states, plan.limits.max_bounces), ([State::On, State::Off], 0), "{plan:#?}");
    assert_eq!(plan.integrator, Integrator::PathTracing);
    let simplified = plan.simplify(scene.clone()).unwrap();
    let found = picture(&simplified, plan.integrator, plan.limits, plan.background, 2);
    let full = picture(&scene, Integrator::PathTracing, Limits { max_bounces: 0 }, None, 1);
    assert!(full.iter().any(|[mean, _]| *mean > 1e-3));
    assert!(excess(&full, &found, 0.0) < MOST && excess(&found, &full, 0.0) < MOST);
}
