//! Lights within media and beside them: points that are drawn by their angle about a light leave the mean as it is.

use crate::common::fields::{field, lumps, unit};
use crate::path_tracing::{ALBEDO, Estimate, assert_agree, estimate, lumpy, medium, peaks, scene, through};
use cumulo::cancel::Cancel;
use cumulo::math::{Affine, Ray};
use cumulo::render::dvr::Dvr;
use cumulo::render::film::{self, Sampling};
use cumulo::render::path::{Limits, PathTracer};
use cumulo::scene::blur::Blur;
use cumulo::scene::camera::{Camera, Projection};
use cumulo::scene::cone::Cone;
use cumulo::scene::light::Light;
use cumulo::scene::medium::{Medium, Scattering, Source};
use cumulo::scene::phase::Phase;
use cumulo::scene::scene::Scene;
use cumulo::scene::volume::Volume;
use glam::{DVec2, DVec3, Vec3};
use std::sync::Arc;

/// A place in the densest part of [`lumps`].
const INSIDE: DVec3 = DVec3::new(9.0, 9.0, 11.0);

fn point(position: DVec3) -> Light {
    Light::Point { position, intensity: Vec3::new(30.0, 20.0, 10.0) }
}

fn sphere(centre: DVec3, radius: f64) -> Light {
    Light::Sphere { centre, radius, radiance: Vec3::new(3.0, 2.0, 1.0) }
}

fn disc(centre: DVec3, radius: f64) -> Light {
    Light::Disc { centre, radius, radiance: Vec3::new(3.0, 2.0, 1.0) }
}

fn spot(radius: f64, soft: bool) -> Light {
    let cone = Cone::new(DVec3::new(0.2, 0.1, -1.0), 0.9, 0.4).unwrap();
    Light::Spot { position: INSIDE, radius, soft, intensity: Vec3::new(30.0, 20.0, 10.0), cone }
}

fn rectangle(height: f64) -> Light {
    let corner = DVec3::new(7.0, 7.0, height);
    Light::Rectangle { corner, edges: [DVec3::Y * 5.0, DVec3::X * 4.0], radiance: Vec3::new(3.0, 2.0, 1.0) }
}

/// Media of all kinds, and lights of all kinds within and beside them.
fn scenes() -> Vec<(&'static str, Scene)> {
    let lumpy = lumpy(unit());
    let (isotropic, forward) = (Phase::Isotropic, Phase::HenyeyGreenstein(0.5));
    let plain = |extinction, phase, lights| scene(&lumpy, medium(extinction, ALBEDO, phase), lights, [0.1; 3]);
    let of = |medium, lights| scene(&lumpy, medium, lights, [0.0; 3]);
    let shading = Scattering { gradient_shading: Some(0.05), ..Scattering::new(ALBEDO, Phase::HenyeyGreenstein(0.3)) };
    let function = Medium {
        scattering: Some(Scattering::new(ALBEDO, isotropic)),
        ..Medium::new(0.02, Source::Transfer(Arc::new(peaks())))
    };
    let moved = field(20, Affine::uniform(0.8, DVec3::new(3.0, 1.0, 2.0)).unwrap(), lumps(20));
    let mut overlapping = plain(0.05, isotropic, vec![sphere(INSIDE, 0.8), point(DVec3::new(9.5, 9.5, 20.5))]);
    overlapping.volumes.push(Volume::Density(moved, medium(0.05, [0.7; 3], forward)));
    let colored = |lights| of(Medium { color: [1.0, 0.5, 0.0], ..medium(0.12, ALBEDO, isotropic) }, lights);
    let mut two = colored(vec![rectangle(14.0)]);
    two.volumes.push(Volume::Density(lumpy.clone(), medium(0.04, ALBEDO, forward)));
    let sun = Light::Sun { direction: DVec3::Z, irradiance: Vec3::ONE, angle: 0.1 };
    vec![
        ("thin", plain(0.03, isotropic, vec![point(INSIDE)])),
        ("sphere", plain(0.1, isotropic, vec![sphere(INSIDE, 0.5)])),
        ("large sphere", plain(0.1, forward, vec![sphere(INSIDE, 1.5)])),
        ("disc", plain(0.1, isotropic, vec![disc(INSIDE, 1.2)])),
        ("spot", plain(0.1, forward, vec![spot(0.0, false)])),
        ("spots with extent", plain(0.1, isotropic, vec![spot(0.5, false), spot(0.8, true)])),
        ("rectangle inside", plain(0.1, forward, vec![rectangle(13.0)])),
        ("beside", plain(0.1, isotropic, vec![point(DVec3::new(9.5, 9.5, 20.5)), rectangle(17.0)])),
        ("forward", plain(0.1, forward, vec![sphere(INSIDE, 0.3), sun])),
        ("overlapping", overlapping),
        ("chromatic", colored(vec![sphere(INSIDE, 0.5), sun])),
        ("chromatic and grey", two),
        (
            "gradient shading",
            of(Medium { scattering: Some(shading), ..Medium::absorbing(0.1) }, vec![sphere(INSIDE, 0.5)]),
        ),
        ("function", of(function, vec![sphere(INSIDE, 0.5), point(DVec3::new(4.0, 3.0, 5.0))])),
    ]
}

/// Once, twice and any number of times scattered, light of near lights is what collisions alone find.
#[test]
fn points_by_angle_leave_the_mean() {
    let rays = through(&lumpy(unit()), 3);
    for (name, scene) in scenes() {
        for max_bounces in [1, 2, u32::MAX] {
            let limits = Limits { max_bounces };
            let of = |tracer: PathTracer<'_>| -> Vec<_> {
                let tracer = tracer.limits(limits);
                rays.iter().map(|ray| estimate(&tracer, ray, 128)).collect()
            };
            let found = of(PathTracer::new(&scene).unwrap());
            let expected = of(PathTracer::new(&scene).unwrap().at_collisions());
            assert_ne!(found, expected, "{name}: no point was drawn by angle");
            assert_agree(&format!("{name}, {max_bounces} bounces"), &found, &expected);
        }
    }
}

/// Light of a point within the medium that is scattered once, by quadrature over the angle about it: in `dt / (D² + t²) =
/// dθ / D` nothing is large (Pegoraro & Parker 2009).
#[test]
fn airlight_is_that_of_quadrature() {
    let (single, double) = (lumpy(unit()), field::<f64>(20, unit(), lumps(20)));
    let light = point(INSIDE);
    let across = DVec3::new(0.3, 1.0, -0.2).normalize();
    let aside = across.any_orthonormal_vector();
    for (extinction, g) in [(1e-3, 0.0), (0.02, 0.5), (0.1, 0.0)] {
        let phase = Phase::of_anisotropy(g);
        let scene = scene(&single, medium(extinction, ALBEDO, phase), vec![light], [0.0; 3]);
        let tracer = PathTracer::new(&scene).unwrap().limits(Limits { max_bounces: 1 });
        let dvr = Dvr::new(&double, Medium::absorbing(extinction)).unwrap().early_stop(0.0);
        let rays: Vec<Ray> = [0.01, 0.3, 2.0].map(|off| Ray::new(INSIDE + off * aside - 30.0 * across, across)).into();
        let of_ray = |ray: &Ray| {
            let (enter, leave) = double.world_bounds().clip(ray).unwrap();
            let nearest = (INSIDE - ray.origin).dot(across);
            let distance = (INSIDE - ray.at(nearest)).length();
            let [from, to] = [enter, leave].map(|end| ((end - nearest) / distance).atan());
            let steps = 4000;
            let sum: f64 = (0..steps)
                .map(|k| {
                    let angle = from + (to - from) * (f64::from(k) + 0.5) / f64::from(steps);
                    let at = ray.at(nearest + distance * angle.tan());
                    let arrival = light.sample(at, [0.0; 2]).unwrap();
                    let beyond = |origin, direction| dvr.optical_depth(&Ray::new(origin, direction));
                    let depth = beyond(at, -across) + beyond(at, arrival.direction) - beyond(INSIDE, arrival.direction);
                    extinction
                        * double.sample(double.transform.to_index(at))
                        * phase.value(across.dot(arrival.direction))
                        * (-depth).exp()
                })
                .sum();
            let share = sum * (to - from) / f64::from(steps) / distance;
            std::array::from_fn(|c| {
                let v = share * f64::from(ALBEDO[c]) * [30.0, 20.0, 10.0][c];
                // Of single precision, and of the quadrature.
                [v, (1e-3 * v).powi(2)]
            })
        };
        let found: Vec<_> = rays.iter().map(|ray| estimate(&tracer, ray, 128)).collect();
        let expected: Vec<Estimate> = rays.iter().map(of_ray).collect();
        assert_agree(&format!("airlight, extinction {extinction}"), &found, &expected);
    }
}

/// The same bits with one thread and with several.
#[test]
fn pictures_with_near_lights_depend_on_seed_and_pixel_alone() {
    let camera = Camera {
        camera_to_world: Camera::look_at(DVec3::new(9.5, -28.0, 16.0), DVec3::splat(9.5), DVec3::Z),
        focal: DVec2::splat(33.0),
        centre: DVec2::splat(12.0),
        width: 24,
        height: 24,
        near: 0.0,
        blur: Blur::default(),
        projection: Projection::Perspective,
    };
    for (name, scene) in scenes() {
        let picture = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let tracer = PathTracer::new(&scene).unwrap();
            let sampling = Sampling::random(8, 5);
            pool.install(|| film::render(&tracer, &camera, sampling, &[], &Cancel::NEVER)).unwrap()
        };
        let one = picture(1);
        assert!(one.film.rgba.iter().flatten().all(|v| v.is_finite() && *v >= 0.0), "{name}");
        assert_eq!((one.counts.violations, one.counts.impossible), (0, 0), "{name}");
        assert_eq!(one, picture(5), "{name}");
    }
}

/// Of lights that are far from the media nothing is drawn by angle: pictures are what they were, bit by bit.
#[test]
fn far_lights_are_left_to_collisions() {
    let field = lumpy(unit());
    let far = vec![point(DVec3::splat(80.0)), Light::Sun { direction: DVec3::Z, irradiance: Vec3::ONE, angle: 0.1 }];
    for (lights, near) in [(far.clone(), false), ([far, vec![point(INSIDE)]].concat(), true)] {
        let scene = scene(&field, medium(0.1, ALBEDO, Phase::Isotropic), lights, [0.1; 3]);
        let rays = through(&field, 2);
        let of = |tracer: PathTracer<'_>| -> Vec<_> { rays.iter().map(|ray| estimate(&tracer, ray, 8)).collect() };
        let same = of(PathTracer::new(&scene).unwrap()) == of(PathTracer::new(&scene).unwrap().at_collisions());
        assert_eq!(same, !near);
    }
}
