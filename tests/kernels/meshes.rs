//! Paths among surfaces against closed forms: equilibrium in a closed room, lights on a floor, shadows, and surfaces that
//! emit as lights do.

use crate::common::fields::{field, lumps, unit};
use crate::common::shapes::{Triangles, quad, walls};
use crate::path_tracing::{ALBEDO, Estimate, assert_agree, estimate, exact, lumpy, medium, peaks, scene, through};
use cumulo::math::{Affine, Ray};
use cumulo::render::film::{self, Aov, Sampling, View};
use cumulo::render::integrator::Integrator;
use cumulo::render::path::{PathTracer, Scratch};
use cumulo::render::sampler::Sampler;
use cumulo::scene::blur::Blur;
use cumulo::scene::bricks::Bricks;
use cumulo::scene::camera::{Camera, Projection};
use cumulo::scene::cone::Cone;
use cumulo::scene::film::Film;
use cumulo::scene::holdout::Holdout;
use cumulo::scene::light::Light;
use cumulo::scene::medium::{Medium, Scattering, Source, Specular};
use cumulo::scene::meshes::{Material, Meshes};
use cumulo::scene::phase::Phase;
use cumulo::scene::scene::Scene;
use cumulo::scene::surfaces::Surfaces;
use cumulo::scene::table::Table;
use cumulo::scene::volume::Volume;
use glam::{DVec2, DVec3, Vec3};
use std::f64::consts::{FRAC_1_PI, PI};
use std::sync::Arc;

fn of(albedo: [f32; 3], emission: [f32; 3]) -> Material {
    Material { albedo: albedo.into(), emission: emission.into(), holdout: false }
}

fn among(scene: Scene, meshes: &[(Triangles, Material)]) -> Scene {
    Scene { meshes: Some(Arc::new(Meshes::new(meshes).unwrap())), ..scene }
}

/// A volume in which nothing is.
fn empty() -> Bricks<f32> {
    field(4, unit(), |_| 0.0)
}

fn estimates(scene: &Scene, rays: &[Ray], paths: u32) -> Vec<Estimate> {
    let tracer = PathTracer::new(scene).unwrap();
    rays.iter().map(|ray| estimate(&tracer, ray, paths)).collect()
}

/// Scenes of media of all kinds, whose sources have radiance 1.
fn media(lumpy: &Bricks<f32>) -> Vec<(&'static str, Scene)> {
    let warm = |medium: Medium| Medium { source: Source::Grey([1.0; 3]), ..medium };
    let white = |extinction, phase| warm(medium(extinction, ALBEDO, phase));
    let shading = |specular| Scattering {
        gradient_shading: Some(0.05),
        specular,
        ..Scattering::new(ALBEDO, Phase::HenyeyGreenstein(0.3))
    };
    let function = peaks();
    let points = function.values().iter().map(|v| [1.0, 1.0, 1.0, v[3]]).collect();
    let function = Table::new(function.knots().to_vec(), points).unwrap();
    let function = Medium {
        scattering: Some(Scattering::new(ALBEDO, Phase::Isotropic)),
        ..Medium::new(0.02, Source::Transfer(Arc::new(function)))
    };
    let moved = field(20, Affine::uniform(0.8, DVec3::new(3.0, 1.0, 2.0)).unwrap(), lumps(20));
    let with = |medium| scene(lumpy, medium, Vec::new(), [0.0; 3]);
    let mut several = with(white(0.05, Phase::Isotropic));
    several.volumes.push(Volume::Density(moved, white(0.05, Phase::HenyeyGreenstein(0.5))));
    let chromatic = Medium { color: [1.0, 0.5, 0.0], ..white(0.12, Phase::Isotropic) };
    let mut both = with(chromatic.clone());
    both.volumes.push(Volume::Density(lumpy.clone(), white(0.04, Phase::HenyeyGreenstein(-0.4))));
    let glossy = Specular::of(0.4, Some(0.3));
    vec![
        ("empty", scene(&empty(), white(1.0, Phase::Isotropic), Vec::new(), [0.0; 3])),
        ("thin", with(white(0.02, Phase::Isotropic))),
        ("dense", with(white(0.3, Phase::HenyeyGreenstein(0.5)))),
        // Bounds that a single voxel sets are too loose to track by.
        ("spiked", scene(&spiked(), white(0.05, Phase::Isotropic), Vec::new(), [0.0; 3])),
        ("shaded", with(warm(Medium { scattering: Some(shading(None)), ..Medium::absorbing(0.1) }))),
        ("glossy", with(warm(Medium { scattering: Some(shading(glossy)), ..Medium::absorbing(0.1) }))),
        ("function", with(function)),
        ("several", several),
        ("chromatic", with(chromatic)),
        ("chromatic and grey", both),
    ]
}

/// Lumps of which one voxel is dense beyond measure.
fn spiked() -> Bricks<f32> {
    let lumps = lumps(20);
    field(20, unit(), move |p| if p == DVec3::new(3.0, 4.0, 5.0) { 1e5 } else { lumps(p) })
}

/// In a closed room whose walls emit what they do not reflect, and whose media emit what they do not scatter, all light
/// has radiance 1 in all directions (Kirchhoff 1860): in every kind of medium.
#[test]
fn a_closed_room_is_in_equilibrium() {
    let lumpy = lumpy(unit());
    let bounds = lumpy.world_bounds();
    let room = walls(bounds.min - 3.0, bounds.max + DVec3::new(2.0, 5.0, 4.0));
    let wall = [0.3, 0.5, 0.8];
    let meshes = [(room, of(wall, wall.map(|a| 1.0 - a)))];
    let mut rays = through(&lumpy, 2);
    // Rays begin within the room.
    for ray in &mut rays {
        let (enter, leave) = bounds.clip(ray).unwrap();
        ray.origin = ray.at(0.9 * enter.max(0.0) + 0.1 * leave);
        ray.origin = ray.origin.clamp(bounds.min, bounds.max);
    }
    rays.push(Ray::new(bounds.max + DVec3::ONE, DVec3::new(0.3, -1.0, 0.2).normalize()));
    for (name, scene) in media(&lumpy) {
        let found = estimates(&among(scene, &meshes), &rays, 32);
        assert_agree(name, &found, &exact([[1.0; 3]; 3]));
    }
}

/// Lights of all kinds on a floor that is seen obliquely: albedo over π times the irradiance.
#[test]
fn lights_shine_on_a_floor() {
    let power = Vec3::new(3.0, 2.0, 1.0);
    let floor = quad(DVec3::new(-50.0, -50.0, 0.0), DVec3::X * 100.0, DVec3::Y * 100.0);
    let meshes = [(floor, of(ALBEDO, [0.0; 3]))];
    let at = DVec3::new(0.4, -0.3, 0.0);
    let above = at + DVec3::new(0.0, 0.0, 2.0);
    let aside = DVec3::new(0.6, 0.3, 0.7).normalize();
    let cosine = aside.z;
    let cone = Cone::new(-aside, 0.4, 0.0).unwrap();
    // The form factor of a square of edge 1.2 parallel to the floor, 2 above a point beneath its middle.
    let x: f64 = 0.6 / 2.0;
    let quarter = 2.0 * x / (1.0 + x * x).sqrt() * (x / (1.0 + x * x).sqrt()).atan();
    let square = 4.0 * quarter / (2.0 * PI);
    let corner = above - DVec3::new(0.6, 0.6, 0.0);
    let [u, v] = [DVec3::Y * 1.2, DVec3::X * 1.2];
    let spot = |radius, soft| Light::Spot { position: at + 3.0 * aside, radius, soft, intensity: power, cone };
    let cases = [
        ("sun", Light::Sun { direction: aside, irradiance: power, angle: 0.0 }, cosine),
        ("wide sun", Light::Sun { direction: aside, irradiance: power, angle: 0.4 }, cosine),
        ("point", Light::Point { position: at + 3.0 * aside, intensity: power }, cosine / 9.0),
        (
            "sphere",
            Light::Sphere { centre: at + 3.0 * aside, radius: 0.7, radiance: power },
            PI * (0.7_f64 / 3.0).powi(2) * cosine,
        ),
        ("spot", spot(0.0, false), cosine / 9.0),
        ("rectangle", Light::Rectangle { corner, edges: [u, v], radiance: power }, PI * square),
    ];
    let rays = [DVec3::new(0.3, 0.2, -1.0), DVec3::new(-0.9, 0.1, -0.3)]
        .map(|direction| Ray::new(at - 4.0 * direction.normalize(), direction.normalize()));
    let expected = |irradiance: f64| {
        let radiance = power.as_dvec3() * Vec3::from(ALBEDO).as_dvec3() * irradiance * FRAC_1_PI;
        exact([radiance.to_array(); 2])
    };
    for (name, light, irradiance) in cases {
        let lit = among(scene(&empty(), medium(1.0, ALBEDO, Phase::Isotropic), vec![light], [0.0; 3]), &meshes);
        assert_agree(name, &estimates(&lit, &rays, 64), &expected(irradiance));
    }
    let sky = scene(&empty(), medium(1.0, ALBEDO, Phase::Isotropic), Vec::new(), power.to_array());
    assert_agree("sky", &estimates(&among(sky, &meshes), &rays, 16), &expected(PI));
    // A square that emits is as the light, and stands in the way of rays from behind it.
    let emitting = (quad(corner, u, v), of([0.0; 3], power.to_array()));
    let shone = scene(&empty(), medium(1.0, ALBEDO, Phase::Isotropic), Vec::new(), [0.0; 3]);
    let all = [meshes[0].clone(), emitting];
    let beside = [rays[1], Ray::new(DVec3::new(3.0, 0.0, 2.5), (at - DVec3::new(3.0, 0.0, 2.5)).normalize())];
    assert_agree("square", &estimates(&among(shone, &all), &beside, 64), &expected(PI * square));
}

/// Surfaces stop light: media behind a wall get none, and the floor gets what the media let through.
#[test]
fn surfaces_stop_light_and_media_dim_it() {
    let lumpy = lumpy(unit());
    let bounds = lumpy.world_bounds();
    let sun = Light::Sun { direction: DVec3::Z, irradiance: Vec3::new(3.0, 2.0, 1.0), angle: 0.0 };
    let wide = DVec3::X * 200.0;
    let across = DVec3::Y * 200.0;
    let corner = bounds.centre() - 0.5 * (wide + across);
    let roof = (quad(corner.with_z(bounds.max.z + 1.0), wide, across), of([0.0; 3], [0.0; 3]));
    let rays = through(&lumpy, 3);
    let lit = scene(&lumpy, medium(0.2, ALBEDO, Phase::Isotropic), vec![sun], [0.0; 3]);
    let up: Vec<Ray> = rays.iter().copied().filter(|ray| ray.origin.z < bounds.max.z).collect();
    assert!(!up.is_empty());
    assert_agree(
        "roof",
        &estimates(&among(lit.clone(), &[roof]), &up, 4),
        &exact(std::iter::repeat_n([0.0; 3], up.len())),
    );
    // Beneath a medium that only absorbs.
    for color in [[1.0; 3], [1.0, 0.5, 0.2]] {
        let absorbing = Medium { color, ..medium(0.1, [0.0; 3], Phase::Isotropic) };
        let lit = scene(&lumpy, absorbing, vec![sun], [0.0; 3]);
        let floor = (quad(corner.with_z(bounds.min.z - 1.0), wide, across), of(ALBEDO, [0.0; 3]));
        let clear = PathTracer::new(&lit).unwrap();
        let mut scratch = Scratch::default();
        let ray = Ray::new(bounds.centre().with_z(bounds.min.z - 0.5), DVec3::new(0.2, 0.1, -1.0).normalize());
        let at = ray.at(0.5 / -ray.direction.z);
        let up = Ray::new(at, DVec3::Z);
        let primary = clear.primary(&up, &mut scratch);
        let depth = clear.optical_depth(&up, &primary, &mut scratch);
        assert!(depth > 0.1, "{depth}");
        let of_channel = depth / (color.iter().map(|v| f64::from(*v)).sum::<f64>() / 3.0);
        let expected = [0, 1, 2].map(|c| {
            let (albedo, sun) = (f64::from(ALBEDO[c]), [3.0, 2.0, 1.0][c]);
            albedo * FRAC_1_PI * sun * (-of_channel * f64::from(color[c])).exp()
        });
        assert_agree("floor", &estimates(&among(lit.clone(), &[floor]), &[ray], 16), &exact([expected]));
    }
}

/// What is behind an opaque wall is not seen: light of the other half of a medium ends at it, exactly.
#[test]
fn walls_part_media() {
    let lumpy = lumpy(unit());
    let bounds = lumpy.world_bounds();
    let middle = bounds.centre().x + 0.123;
    let wall = quad(DVec3::new(middle, -300.0, -300.0), DVec3::Y * 600.0, DVec3::Z * 600.0);
    let meshes = [(wall, of([0.0; 3], [0.0; 3]))];
    let light = Light::Point { position: DVec3::new(middle + 2.0, 9.0, 9.0), intensity: Vec3::splat(100.0) };
    let eye = bounds.centre() - DVec3::new(30.0, 4.0, 3.0);
    let ray = Ray::new(eye, (bounds.centre() - eye).normalize());
    for (name, mut scene) in media(&lumpy) {
        for volume in &mut scene.volumes {
            let Volume::Density(_, medium) = volume else { continue };
            medium.source = match &medium.source {
                Source::Transfer(table) => Source::Transfer(Arc::new(table.without_color())),
                _ => Source::Grey([0.0; 3]),
            };
        }
        scene.lights = vec![light];
        assert_agree(name, &estimates(&among(scene, &meshes), &[ray], 16), &exact([[0.0; 3]]));
    }
}

/// A black square that emits lights media as the light of its shape does.
#[test]
fn surfaces_that_emit_light_media() {
    let lumpy = lumpy(unit());
    let bounds = lumpy.world_bounds();
    let radiance = [9.0, 6.0, 3.0];
    let corner = bounds.centre().with_z(bounds.max.z + 1.0) - DVec3::new(2.0, 3.0, 0.0);
    let edges = [DVec3::Y * 6.0, DVec3::X * 4.0];
    let light = Light::Rectangle { corner, edges, radiance: radiance.into() };
    let square = (quad(corner, edges[0], edges[1]), of([0.0; 3], radiance));
    let rays: Vec<Ray> = through(&lumpy, 8).into_iter().filter(|ray| ray.origin.z < bounds.max.z).take(3).collect();
    assert_eq!(rays.len(), 3);
    for (name, medium) in [
        ("plain", medium(0.1, ALBEDO, Phase::HenyeyGreenstein(0.4))),
        ("chromatic", Medium { color: [1.0, 0.6, 0.2], ..medium(0.2, ALBEDO, Phase::Isotropic) }),
    ] {
        let lit = scene(&lumpy, medium.clone(), vec![light], [0.0; 3]);
        let shone = among(scene(&lumpy, medium, Vec::new(), [0.0; 3]), std::slice::from_ref(&square));
        let [found, expected] = [&shone, &lit].map(|scene| {
            let tracer = PathTracer::new(scene).unwrap();
            rays.iter().map(|ray| estimate(&tracer, ray, 256)).collect::<Vec<_>>()
        });
        assert_agree(name, &found, &expected);
    }
}

fn camera(eye: DVec3, target: DVec3) -> Camera {
    Camera {
        camera_to_world: Camera::look_at(eye, target, DVec3::Z),
        projection: Projection::Perspective,
        focal: DVec2::splat(45.0),
        centre: DVec2::splat(8.0),
        width: 16,
        height: 16,
        near: 0.0,
        blur: Blur::default(),
    }
}

fn plane<'f>(film: &'f Film, name: &str) -> &'f [f32] {
    &film.planes.iter().find(|plane| plane.name == name).unwrap().samples
}

/// A light in the plane of a surface shines, and faces that coincide emit once.
#[test]
fn what_lies_in_one_plane_is_told_apart() {
    let floor = (quad(DVec3::new(-50.0, -50.0, 0.0), DVec3::X * 100.0, DVec3::Y * 100.0), of(ALBEDO, [0.0; 3]));
    let ceiling = (quad(DVec3::new(-3.0, -3.0, 2.0), DVec3::X * 6.0, DVec3::Y * 6.0), of([0.0; 3], [0.0; 3]));
    let rays = [DVec3::new(0.3, 0.2, -1.0), DVec3::new(-0.2, 0.5, -0.9)].map(|direction| {
        let direction = direction.normalize();
        Ray::new(DVec3::new(0.4, -0.3, 0.0) - direction, direction)
    });
    let corner = DVec3::new(-0.5, -0.5, 2.0);
    let power = Vec3::new(3.0, 2.0, 1.0);
    let medium = || medium(1.0, ALBEDO, Phase::Isotropic);
    for light in [
        Light::Rectangle { corner, edges: [DVec3::Y, DVec3::X], radiance: power },
        Light::Point { position: corner, intensity: power },
    ] {
        let lit = scene(&empty(), medium(), vec![light], [0.0; 3]);
        let free = estimates(&among(lit.clone(), std::slice::from_ref(&floor)), &rays, 64);
        // Once is enough: a second scattering would see the ceiling.
        assert_agree("in the ceiling", &estimates(&among(lit, &[floor.clone(), ceiling.clone()]), &rays, 64), &free);
    }
    let lamp = || quad(corner, DVec3::Y, DVec3::X);
    let shines = of([0.0; 3], power.to_array());
    let dark = scene(&empty(), medium(), Vec::new(), [0.0; 3]);
    let once = estimates(&among(dark.clone(), &[floor.clone(), (lamp(), shines)]), &rays, 256);
    let turned = quad(corner, DVec3::X, DVec3::Y);
    for more in [vec![(lamp(), shines)], vec![(turned.clone(), shines)], vec![(lamp(), shines), (turned, shines)]] {
        let all = [vec![floor.clone(), (lamp(), shines)], more].concat();
        assert_agree("twice", &estimates(&among(dark.clone(), &all), &rays, 256), &once);
    }
    // A camera in the plane of a surface sees beside it.
    let sky = scene(&empty(), medium(), Vec::new(), [0.25, 0.5, 1.0]);
    let up = Ray::new(DVec3::new(1.0, 2.0, 0.0), DVec3::new(0.1, 0.2, 0.9).normalize());
    assert_agree("in the floor", &estimates(&among(sky, &[floor]), &[up], 4), &exact([[0.25, 0.5, 1.0]]));
}

/// Between walls that absorb nothing no path ends: those are given up, and told.
#[test]
fn paths_between_white_walls_are_given_up() {
    let lit = scene(
        &empty(),
        medium(1.0, ALBEDO, Phase::Isotropic),
        vec![Light::Point { position: DVec3::ZERO, intensity: Vec3::ONE }],
        [0.0; 3],
    );
    let white = (walls(DVec3::splat(-5.0), DVec3::splat(5.0)), of([1.0, 0.0, 0.5], [0.0; 3]));
    let lit = among(lit, &[white]);
    let tracer = PathTracer::new(&lit).unwrap();
    let towards = DVec3::new(0.3, 0.5, -0.8).normalize();
    let (mut scratch, ray) = (Scratch::default(), Ray::new(DVec3::splat(-3.0), towards));
    let primary = tracer.primary(&ray, &mut scratch);
    let sample = tracer.li(&ray, &primary, &mut Sampler::new(1, [0, 0], 0), &mut scratch);
    assert!(sample.radiance().is_finite());
    assert_eq!(PathTracer::take_counts(&mut scratch).unfinished, 1);
}

/// Alpha is 1 where surfaces stand and 0 in the holes of holdouts; planes are those of the surfaces.
#[test]
fn pictures_show_where_surfaces_stand() {
    let lumpy = lumpy(unit());
    let bounds = lumpy.world_bounds();
    let camera = camera(bounds.centre() + DVec3::new(60.0, 0.0, 0.0), bounds.centre());
    // Behind the volume, wider than the picture.
    let wall = quad(bounds.centre() - DVec3::new(30.0, 200.0, 200.0), DVec3::Y * 400.0, DVec3::Z * 400.0);
    let emitting = Medium { source: Source::Grey([1.0; 3]), ..medium(0.1, [0.0; 3], Phase::Isotropic) };
    let plain = scene(&lumpy, emitting, Vec::new(), [0.0; 3]);
    let render = |scene: &Scene, view: View<'_>| {
        let aovs = [Aov::Normal, Aov::Depth, Aov::Albedo];
        let tracer = PathTracer::new(scene).unwrap();
        film::render(&tracer, view, Sampling::random(64, 3), &aovs, &Default::default()).unwrap().film
    };
    let stands = render(&among(plain.clone(), &[(wall.clone(), of(ALBEDO, [0.0; 3]))]), (&camera).into());
    assert!(stands.rgba.iter().all(|v| v[3] == 1.0));
    // A corner of the picture that no density covers.
    assert!((plane(&stands, "Depth.Z")[0] - 90.0).abs() < 1e-3, "{}", plane(&stands, "Depth.Z")[0]);
    assert_eq!(["X", "Y", "Z"].map(|c| plane(&stands, &format!("Denoising Normal.{c}"))[0]), [1.0, 0.0, 0.0]);
    assert!((plane(&stands, "Denoising Albedo.G")[0] - ALBEDO[1]).abs() < 1e-6);
    // A holdout in the scene is one beside it, where nothing sends light through it.
    let across = quad(bounds.centre() - DVec3::new(0.5, 200.0, 200.0), DVec3::Y * 400.0, DVec3::Z * 400.0);
    let hole = Material { holdout: true, ..of([0.0; 3], [0.0; 3]) };
    let inside = render(&among(plain.clone(), &[(across.clone(), hole)]), (&camera).into());
    let holdout = Holdout::Surfaces(Arc::new(Surfaces::new(&across).unwrap()));
    let beside = render(&plain, View { holdout: Some(&holdout), ..(&camera).into() });
    let (mut sums, mut seen) = ([0.0_f64; 2], 0);
    for (a, b) in inside.rgba.iter().zip(&beside.rgba) {
        assert!((a[3] - b[3]).abs() < 1e-6, "{a:?} {b:?}");
        sums[0] += f64::from(a[0]);
        sums[1] += f64::from(b[0]);
        seen += u32::from(a[3] > 0.1 && a[3] < 0.9);
    }
    assert!(seen > 20, "{seen}");
    assert!((sums[0] / sums[1] - 1.0).abs() < 0.01, "{sums:?}");
}

/// Scattering ends at the limit of bounces, of which surfaces take one each.
#[test]
fn bounces_are_limited() {
    use cumulo::render::path::Limits;
    let (sky, floor) = ([0.5, 1.0, 2.0], quad(DVec3::new(-9.0, -9.0, 0.0), DVec3::X * 18.0, DVec3::Y * 18.0));
    let lit = scene(&empty(), medium(1.0, ALBEDO, Phase::Isotropic), Vec::new(), sky);
    let lit = among(lit, &[(floor, of(ALBEDO, [0.25; 3]))]);
    let ray = Ray::new(DVec3::new(1.0, 1.0, 3.0), DVec3::new(0.1, 0.0, -1.0).normalize());
    for (most, reflected) in [(0, 0.0), (1, 1.0)] {
        let tracer = PathTracer::new(&lit).unwrap().limits(Limits { max_bounces: most });
        let mut scratch = Scratch::default();
        let primary = tracer.primary(&ray, &mut scratch);
        let sample = tracer.li(&ray, &primary, &mut Sampler::new(1, [0, 0], 0), &mut scratch);
        let expected = Vec3::splat(0.25) + reflected * Vec3::from(ALBEDO) * Vec3::from(sky);
        assert!((sample.radiance() - expected).abs().max_element() < 1e-5, "{sample:?}");
        assert_eq!(sample.transmittance, 0.0);
    }
}

#[test]
fn materials_that_cannot_be_are_refused() {
    let floor = || quad(DVec3::ZERO, DVec3::X, DVec3::Y);
    for bad in [
        of([1.1, 0.0, 0.0], [0.0; 3]),
        of([f32::NAN; 3], [0.0; 3]),
        of([0.5; 3], [-1.0; 3]),
        of([0.5; 3], [f32::INFINITY; 3]),
    ] {
        assert!(Meshes::new(&[(floor(), bad)]).is_err(), "{bad:?}");
    }
    assert!(Meshes::new(&[]).is_err());
}
