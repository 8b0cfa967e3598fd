//! Plans by measurement: what is left out is no more than is stated, in as many scenes as the confidence says.

use crate::common::fields::{field, lumps, unit};
use crate::common::scenes::{Draw, camera};
use cumulo::cancel::Cancel;
use cumulo::plan::{CONFIDENCE, Effect, Plan, Request, State};
use cumulo::render::film::{Blocks, Replicates, Sampling};
use cumulo::render::path::{Limits, PathTracer};
use cumulo::scene::environment::Environment;
use cumulo::scene::light::Light;
use cumulo::scene::medium::{Medium, Scattering};
use cumulo::scene::phase::Phase;
use cumulo::scene::scene::Scene;
use cumulo::scene::volume::Volume;
use glam::{DVec3, Vec3};

/// Replicates of pictures, and the paths of a pixel in each.
const REPLICATES: u64 = 16;
const PATHS: u32 = 8;

/// Means and squared standard errors of the blocks of a picture, by channel.
fn blocks(scene: &Scene, limits: Limits, background: Option<[f32; 3]>, seed: u64) -> Vec<[f64; 2]> {
    let camera = &scene.cameras[0];
    let tracer = PathTracer::new(scene).unwrap().limits(limits);
    let tracer = match background {
        Some(background) => tracer.background(background),
        None => tracer,
    };
    let size = [camera.width as usize, camera.height as usize];
    let mut replicates = Replicates::new(size, &[]);
    let grid = Blocks::new(size);
    for number in 0..REPLICATES {
        let sampling = vec![Some(Sampling::random(PATHS, 1000 * seed + number)); grid.count()];
        assert!(replicates.add(&tracer, camera, &sampling, &Cancel::NEVER));
    }
    let of_block = |block: usize, c: usize| {
        let count = grid.pixels(block).count() as f64;
        let sum = |of: &dyn Fn(usize) -> f64| grid.pixels(block).map(of).sum::<f64>();
        let sums = replicates.sums();
        [sum(&|i| sums[i].mean()[c]) / count, sum(&|i| sums[i].variance()[c]) / (count * count)]
    };
    (0..grid.count()).flat_map(|block| [0, 1, 2].map(|c| of_block(block, c))).collect()
}

fn request(max_omitted: f64) -> Request {
    Request { max_omitted, ..Request::default() }
}

fn measured(scene: &Scene, request: &Request) -> Plan {
    Plan::measured(scene, &scene.cameras, request, &Cancel::NEVER).unwrap()
}

/// Returns by how much a block of the full picture is brighter than that of the plan's, beyond three standard errors.
fn missing(full: &[[f64; 2]], less: &[[f64; 2]]) -> f64 {
    let sure = |([a, va], [b, vb]): (&[f64; 2], &[f64; 2])| a - b - 3.0 * (va + vb).sqrt();
    full.iter().zip(less).map(sure).fold(0.0, f64::max)
}

/// Random scenes, at several limits: what measurement leaves out is missing, and the limit holds as often as is stated.
#[test]
fn what_is_left_out_by_measurement_is_below_its_limit() {
    let (mut plans, mut broken, mut more) = (0, 0, 0);
    for number in 0..40 {
        let mut scene = Draw(1000 * number).scene();
        scene.cameras = vec![scene.cameras[0].resized([16, 16])];
        let mut full = None;
        let mut tell = format!("scene {number}:");
        for max_omitted in [0.003, 0.02, 0.1] {
            let plan = measured(&scene, &request(max_omitted));
            let omitted = plan.omitted.unwrap();
            assert!(omitted <= max_omitted, "{omitted} {max_omitted}");
            if plan.confidence == 1.0 {
                continue;
            }
            assert_eq!(plan.confidence, CONFIDENCE);
            let proved = Plan::new(&scene, &scene.cameras, &request(max_omitted)).unwrap();
            let left_out = |plan: &Plan| plan.effects.iter().filter(|e| !plan.simulates(e.name)).count();
            more += usize::from(left_out(&plan) > left_out(&proved));
            let full = full.get_or_insert_with(|| blocks(&scene, Limits::default(), None, 1));
            let simplified = plan.simplify(scene.clone()).unwrap();
            let found = blocks(&simplified, plan.limits, plan.background, 2);
            let missing = missing(full, &found);
            plans += 1;
            broken += usize::from(missing > omitted);
            tell += &format!(" {max_omitted} ({omitted:.4}) {missing:.4};");
        }
        println!("{tell}");
    }
    println!("{plans} plans by measurement, {more} leave more effects out, {broken} broken");
    assert!(plans > 30 && more > 10, "{plans} {more}");
    assert!(broken as f64 <= (1.0 - CONFIDENCE) * plans as f64, "{broken} of {plans}");
}

/// A cloud that no bound tells anything of: deep, bright, and forward scattering.
fn cloud() -> Scene {
    let scattering = Some(Scattering::new([0.99; 3], Phase::HenyeyGreenstein(0.85)));
    let medium = Medium { scattering, ..Medium::absorbing(6.0) };
    let volumes = vec![Volume::Density(field(24, unit(), lumps(24)), medium)];
    let bounds = volumes[0].density().unwrap().0.world_bounds();
    let sun =
        Light::Sun { direction: DVec3::new(0.4, -0.5, 0.8).normalize(), irradiance: Vec3::splat(3.0), angle: 0.01 };
    let eye = bounds.centre() + bounds.size().length() * DVec3::new(0.3, 1.2, 0.2);
    Scene {
        volumes,
        lights: vec![sun, Light::Sun { direction: DVec3::Z, irradiance: Vec3::splat(1e-3), angle: 0.0 }],
        environment: Environment::constant([0.15, 0.2, 0.3]),
        cameras: vec![camera(eye, bounds.centre()).resized([32, 32])],
        ..Scene::default()
    }
}

#[test]
fn a_dense_cloud_loses_what_adds_nothing() {
    let scene = cloud();
    let proved = Plan::new(&scene, &scene.cameras, &request(0.01)).unwrap();
    assert_eq!(proved.state(Effect::Light(1)), State::On);
    assert!(proved.effects.iter().all(|effect| effect.state != State::Bounded), "{proved:#?}");
    let plan = measured(&scene, &request(0.01));
    println!("{plan:#?}");
    assert_eq!((plan.confidence, plan.state(Effect::Light(1))), (CONFIDENCE, State::Measured), "{plan:#?}");
    assert_eq!(plan.state(Effect::Light(0)), State::On);
    assert!(plan.omitted.unwrap() <= 0.01);
    let [full, found] = [
        blocks(&scene, Limits::default(), None, 1),
        blocks(&plan.simplify(scene.clone()).unwrap(), plan.limits, plan.background, 2),
    ];
    assert!(missing(&full, &found) < plan.omitted.unwrap());
    // Contributions are told where nothing may be left out, and where effects are kept by force nothing is measured.
    let told = measured(&scene, &request(0.0));
    assert_eq!((told.omitted, told.confidence), (Some(0.0), 1.0));
    let of = |plan: &Plan, name| plan.effects.iter().find(|effect| effect.name == name).unwrap().contribution;
    let [sun, faint] = [0, 1].map(|light| of(&told, Effect::Light(light)).unwrap());
    assert!(
        sun.mean > 0.0 && sun.worst > 100.0 * faint.worst && faint.limit.unwrap() > faint.worst,
        "{sun:?} {faint:?}"
    );
    let forced = Request { force: vec![Effect::Light(1)], ..request(0.01) };
    assert_eq!(of(&measured(&scene, &forced), Effect::Light(1)), None);
}

/// Threads change nothing, bit for bit.
#[test]
fn measurements_do_not_depend_on_threads() {
    let scene = cloud();
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let plan = pool.install(|| measured(&scene, &request(0.0)));
        plan.effects.iter().map(|effect| effect.contribution).collect::<Vec<_>>()
    };
    assert_eq!(on(1), on(3));
}
