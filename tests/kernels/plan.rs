//! Plans: what is left out is no more than the bound, on random scenes, and what is not called for is off.

use crate::common::fields::{field, lumps, unit};
use crate::common::scenes::{Draw, EDGE};
use cumulo::cancel::Cancel;
use cumulo::plan::{Effect, Integrator, Plan, Request, State};
use cumulo::render::direct::DirectRenderer;
use cumulo::render::film::{self, Sampling};
use cumulo::render::path::{Limits, PathTracer};
use cumulo::render::quadrature::Quadrature;
use cumulo::scene::environment::Environment;
use cumulo::scene::film::Film;
use cumulo::scene::light::Light;
use cumulo::scene::medium::{Medium, Scattering};
use cumulo::scene::phase::Phase;
use cumulo::scene::scene::Scene;
use cumulo::scene::volume::Volume;
use glam::{DVec3, Vec3};

/// Means and squared standard errors of the picture, by channel and pixel.
pub fn picture(
    scene: &Scene,
    integrator: Integrator,
    limits: Limits,
    background: Option<[f32; 3]>,
    seed: u64,
) -> Vec<[f64; 2]> {
    let never = Cancel::NEVER;
    let camera = &scene.cameras[0];
    if integrator == Integrator::DirectVolumeRendering {
        let film = DirectRenderer::new(scene, Quadrature::Exact)
            .unwrap()
            .render(camera, Sampling::grid(12), &[], &never)
            .unwrap()
            .film;
        return film.rgba.iter().flat_map(|v| v[..3].to_vec()).map(|v| [v.into(), 0.0]).collect();
    }
    let tracer = PathTracer::new(scene).unwrap().limits(limits);
    let tracer = match background {
        Some(background) => tracer.background(background),
        None => tracer,
    };
    // Pictures of different seeds are independent, the paths of one are not.
    let groups: Vec<Film> = (0..16)
        .map(|group| {
            let sampling = Sampling::random(32, 1000 * seed + group);
            film::render(&tracer, camera, sampling, &[], &never).unwrap().film
        })
        .collect();
    let values = |pixel: usize, c: usize| groups.iter().map(move |film| f64::from(film.rgba[pixel][c]));
    let estimate = |(pixel, c): (usize, usize)| {
        let mean = values(pixel, c).sum::<f64>() / groups.len() as f64;
        let square = values(pixel, c).map(|v| (v - mean).powi(2)).sum::<f64>();
        [mean, square / (groups.len() * (groups.len() - 1)) as f64]
    };
    (0..(EDGE * EDGE) as usize).flat_map(|pixel| (0..3).map(move |c| (pixel, c))).map(estimate).collect()
}

pub fn request(max_omitted: f64) -> Request {
    Request { max_omitted, ..Request::default() }
}

/// Returns by how many standard errors the first picture is brighter than the second and the bound at most. Standard errors of
/// few groups have long tails; one thousandth of the value and what a pixel's square may hide from 12² rays are added.
pub fn excess(full: &[[f64; 2]], less: &[[f64; 2]], bound: f64) -> f64 {
    let over =
        |([a, va], [b, vb]): (&[f64; 2], &[f64; 2])| (a - b - bound) / (va + vb + (2e-3 * a).powi(2) + 1e-12).sqrt();
    full.iter().zip(less).map(over).fold(f64::NEG_INFINITY, f64::max)
}

/// Standard errors of 15 degrees of freedom that chance exceeds in one of a million pixels.
pub const MOST: f64 = 7.5;

/// Random scenes: light that a plan leaves out is missing, and no more than the bound; the plan without a limit leaves out
/// nothing.
#[test]
fn what_is_left_out_is_below_the_bound() {
    let (mut left_out, mut straight, mut bounded) = (0, 0, 0);
    for number in 0..40 {
        let scene = Draw(1000 * number).scene();
        let full = picture(&scene, Integrator::PathTracing, Limits::default(), None, 1);
        let mut tell = format!("scene {number}:");
        for max_omitted in [0.0, 0.02, 0.3] {
            let plan = Plan::new(&scene, &scene.cameras, &request(max_omitted)).unwrap();
            let simplified = plan.simplify(scene.clone()).unwrap();
            let found = picture(&simplified, plan.integrator, plan.limits, plan.background, 2);
            let omitted = plan.omitted.unwrap();
            assert!(omitted <= max_omitted);
            let [missing, added] = [excess(&full, &found, omitted), excess(&found, &full, 0.0)];
            tell += &format!(" {max_omitted} ({omitted:.4}) {missing:.1} {added:.1};");
            assert!(missing < MOST && added < MOST, "{tell} {plan:#?}");
            left_out += usize::from(omitted > 0.0);
            straight += usize::from(plan.integrator == Integrator::DirectVolumeRendering);
            bounded += usize::from(plan.state(Effect::MultipleScattering) == State::Bounded);
        }
        println!("{tell}");
    }
    println!("left out {left_out}, straight {straight}, bounded {bounded}");
    assert!(left_out > 10 && straight > 5 && bounded > 5, "{left_out} {straight} {bounded}");
}

/// Each effect alone: without it a picture misses no more than its bound, which is not beyond all measure.
#[test]
fn each_bound_holds() {
    for number in 40..60 {
        let scene = Draw(1000 * number).scene();
        let plan = Plan::new(&scene, &scene.cameras, &request(0.0)).unwrap();
        let full = picture(&scene, Integrator::PathTracing, Limits::default(), None, 1);
        for planned in &plan.effects {
            let (mut less, mut limits) = (scene.clone(), Limits::default());
            match planned.name {
                Effect::Light(number) => {
                    less.lights.remove(number);
                }
                Effect::Scattering => limits.max_bounces = 0,
                Effect::MultipleScattering => limits.max_bounces = 1,
                _ => continue,
            }
            let found = picture(&less, Integrator::PathTracing, limits, None, 2);
            let bound = planned.bound.unwrap_or(f64::INFINITY);
            let missing = excess(&full, &found, bound);
            println!("scene {number} without {}: {missing:.1} standard errors above {bound:.3}", planned.name);
            assert!(missing < MOST, "scene {number} without {}: {missing} {bound}", planned.name);
        }
    }
}

/// A plan that took the bound of the third order for that of the second would be found.
#[test]
fn a_bound_that_is_too_small_is_found() {
    let mut draw = Draw(5);
    let mut scene = draw.scene();
    let scattering = Some(Scattering::new([1.0; 3], Phase::Isotropic));
    scene.volumes =
        vec![Volume::Density(field(20, unit(), lumps(20)), Medium { scattering, ..Medium::absorbing(0.3) })];
    scene.environment = Environment::constant([1.0; 3]);
    let full = picture(&scene, Integrator::PathTracing, Limits::default(), Some([0.0; 3]), 1);
    let once = picture(&scene, Integrator::PathTracing, Limits { max_bounces: 1 }, Some([0.0; 3]), 2);
    let plan = Plan::new(&scene, &scene.cameras, &request(0.0)).unwrap();
    let bound = plan.effects.iter().find(|e| e.name == Effect::MultipleScattering).unwrap().bound.unwrap();
    assert!(excess(&full, &once, bound) < MOST);
    assert!(excess(&full, &once, 0.02) > MOST);
}

#[test]
fn what_is_not_called_for_is_off() {
    let volume = |medium| vec![Volume::Density(field(20, unit(), lumps(20)), medium)];
    let states = |scene: &Scene, request: &Request| {
        let plan = Plan::new(scene, &scene.cameras, request).unwrap();
        let on: Vec<String> =
            plan.effects.iter().filter(|e| e.state != State::Off).map(|e| e.name.to_string()).collect();
        (plan.integrator, on.join(" "))
    };
    let scattering = |albedo: f32| Some(Scattering::new([albedo; 3], Phase::Isotropic));
    let smoke = |albedo| Medium { scattering: scattering(albedo), ..Medium::absorbing(0.3) };
    let sun = Light::Sun { direction: DVec3::Z, irradiance: Vec3::ONE, angle: 0.0 };
    let white = Environment::constant([1.0; 3]);
    use Integrator::{DirectVolumeRendering, PathTracing};

    let scene =
        |albedo, lights, environment| Scene { volumes: volume(smoke(albedo)), lights, environment, ..Scene::default() };
    let black = Environment::default;
    let no = Request::default;
    assert_eq!(states(&scene(0.0, vec![sun], black()), &no()), (DirectVolumeRendering, String::new()));
    assert_eq!(states(&scene(0.5, vec![], black()), &no()), (DirectVolumeRendering, String::new()));
    assert_eq!(states(&scene(0.0, vec![sun], white.clone()), &no()), (DirectVolumeRendering, "environment".into()));
    let all = "scattering light-0 environment multiple-scattering";
    assert_eq!(states(&scene(0.5, vec![sun], white.clone()), &no()), (PathTracing, all.into()));
    // A limit above all there is leaves straight rays, unless an effect is kept by force.
    let most = request(1e9);
    assert_eq!(states(&scene(0.5, vec![sun], white.clone()), &most), (DirectVolumeRendering, "environment".into()));
    let force = |effect| Request { force: vec![effect], ..request(1e9) };
    let kept = states(&scene(0.5, vec![sun], white.clone()), &force(Effect::Scattering));
    assert_eq!(kept, (PathTracing, "scattering".into()));
    let light = Request { force: vec![Effect::Scattering, Effect::Light(0)], ..request(1e9) };
    assert_eq!(states(&scene(0.5, vec![sun], white.clone()), &light), (PathTracing, "scattering light-0".into()));
    let missing = Plan::new(&scene(0.5, vec![sun], white), &[], &force(Effect::Light(1))).unwrap_err().to_string();
    assert!(missing.contains("light-1") && missing.contains("1 light"), "{missing}");
}
