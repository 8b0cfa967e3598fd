//! Path tracing against closed forms, deterministic quadrature and direct volume rendering: differences of means in units
//! of their standard error, for each channel of each ray.

use crate::common::fields::{self, field, lumps, noise, odd, rays, unit};
use cumulo::arch::Arch;
use cumulo::cancel::Cancel;
use cumulo::math::{Affine, Ray};
use cumulo::render::dvr::Dvr;
use cumulo::render::film::{self, Aov, Sampling};
use cumulo::render::integrator::{Integrator, Sample};
use cumulo::render::path::{Limits, PathTracer, Scratch};
use cumulo::render::sampler::Sampler;
use cumulo::scene::blur::Blur;
use cumulo::scene::bricks::Bricks;
use cumulo::scene::camera::{Camera, Projection};
use cumulo::scene::cone::Cone;
use cumulo::scene::emission::{self, Emission, Emitted};
use cumulo::scene::environment::{Environment, EnvironmentMap};
use cumulo::scene::film::{Film, Moments};
use cumulo::scene::light::Light;
use cumulo::scene::medium::{Medium, Scattering, Source};
use cumulo::scene::phase::Phase;
use cumulo::scene::scene::Scene;
use cumulo::scene::table::Table;
use cumulo::scene::volume::Volume;
use glam::{DMat3, DVec2, DVec3, Vec3};
use std::f64::consts::PI;
use std::sync::Arc;

/// Mean and squared standard error of each channel.
pub type Estimate = [[f64; 2]; 3];

/// Groups of paths; the numbers within a group are not independent, its means are.
const GROUPS: u32 = 256;

/// Estimates the radiance along a ray from groups of `paths`.
/// One path along a camera's ray.
fn sample(tracer: &PathTracer<'_>, ray: &Ray, sampler: &mut Sampler, scratch: &mut Scratch) -> Sample {
    let primary = tracer.primary(ray, scratch);
    tracer.li(ray, &primary, sampler, scratch)
}

pub fn estimate(tracer: &PathTracer<'_>, ray: &Ray, paths: u32) -> Estimate {
    let (mut scratch, mut moments) = (Scratch::default(), [Moments::default(); 3]);
    for group in 0..GROUPS {
        let mut sum = Vec3::ZERO;
        for path in 0..paths {
            let mut sampler = Sampler::new(u64::from(group), [3, 4], path);
            sum += sample(tracer, ray, &mut sampler, &mut scratch).radiance();
        }
        let mean = sum / paths as f32;
        moments.iter_mut().zip(mean.to_array()).for_each(|(m, v)| m.add(v.into()));
    }
    assert_eq!((scratch.counts.violations, scratch.counts.impossible), (0, 0));
    moments.map(|m| [m.mean(), m.variance_of_mean()])
}

/// The greatest difference in standard errors, to which single precision is added: 1e-5 of the value.
fn deviation(found: &[Estimate], expected: &[Estimate]) -> f64 {
    let pairs = found.iter().flatten().zip(expected.iter().flatten());
    pairs.map(|([a, va], [b, vb])| (a - b).abs() / (va + vb + (1e-5 * b).powi(2) + 1e-30).sqrt()).fold(0.0, f64::max)
}

/// Deviations that chance exceeds once in a hundred thousand tests of this many numbers (Šidák).
fn limit(numbers: usize) -> f64 {
    let tail = 1.0 - (1.0 - 1e-5_f64).powf(1.0 / numbers as f64);
    // Bisection of the two-sided tail of the normal distribution, by its continued fraction.
    let beyond = |z: f64| {
        let fraction = (1..60).rev().fold(0.0, |f, k| f64::from(k) / (z + f));
        2.0 * (-0.5 * z * z).exp() / ((z + fraction) * (2.0 * PI).sqrt())
    };
    let (mut low, mut high) = (2.0, 12.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if beyond(middle) > tail { low = middle } else { high = middle }
    }
    low
}

pub fn assert_agree(what: &str, found: &[Estimate], expected: &[Estimate]) {
    let (worst, limit) = (deviation(found, expected), limit(3 * found.len()));
    println!("{what}: {worst:.2} standard errors at most, {limit:.2} allowed");
    assert!(worst < limit, "{what}: {worst} > {limit}\n{found:?}\n{expected:?}");
}

pub fn exact(values: impl IntoIterator<Item = [f64; 3]>) -> Vec<Estimate> {
    values.into_iter().map(|rgb| rgb.map(|v| [v, 0.0])).collect()
}

pub fn medium(extinction: f64, albedo: [f32; 3], phase: Phase) -> Medium {
    Medium { scattering: Some(Scattering::new(albedo, phase)), ..Medium::absorbing(extinction) }
}

pub fn scene(field: &Bricks<f32>, medium: Medium, lights: Vec<Light>, sky: [f32; 3]) -> Scene {
    let environment = Environment::constant(sky);
    Scene { volumes: vec![Volume::Density(field.clone(), medium)], environment, lights, ..Scene::default() }
}

pub fn lumpy(transform: Affine) -> Bricks<f32> {
    field(20, transform, lumps(20))
}

/// Rays with some of the volume in front of them.
pub fn through(field: &Bricks<f32>, count: usize) -> Vec<Ray> {
    let dvr = Dvr::new(field, Medium::absorbing(1.0)).unwrap();
    let thick = |ray: &Ray| dvr.optical_depth(ray) > 0.1 * field.transform.voxel_size().min_element();
    rays(field.world_bounds(), 200, 11).into_iter().filter(thick).take(count).collect()
}

/// Light scattered once, by midpoint quadrature along the ray in double precision. `light` gives the integral of phase
/// function, radiance and transmittance over the directions at a point.
fn scattered_once(
    field: &Bricks<f64>,
    extinction: f64,
    albedo: [f32; 3],
    ray: &Ray,
    light: impl Fn(DVec3, &Dvr<'_, f64>) -> DVec3,
) -> [f64; 3] {
    let dvr = Dvr::new(field, Medium::absorbing(extinction)).unwrap().early_stop(0.0);
    let Some((enter, leave)) = field.world_bounds().clip(ray) else { return [0.0; 3] };
    let steps = 120;
    let dt = (leave - enter) / f64::from(steps);
    let mut sum = DVec3::ZERO;
    for k in 0..steps {
        let at = ray.at(enter + (f64::from(k) + 0.5) * dt);
        let density = field.sample(field.transform.to_index(at));
        if density > 0.0 {
            let back = Ray::new(at, -ray.direction);
            let arriving = (-dvr.optical_depth(&back)).exp();
            sum += extinction * density * arriving * dt * light(at, &dvr);
        }
    }
    (sum * DVec3::from_array(albedo.map(f64::from))).to_array()
}

pub const ALBEDO: [f32; 3] = [0.9, 0.6, 0.3];

/// A sun without extent, for several anisotropies and transforms; a point light; sun, sphere and rectangle with extent.
#[test]
fn light_scattered_once_is_that_of_quadrature() {
    let radiance = Vec3::new(2.0, 1.0, 0.5);
    let towards = DVec3::new(0.3, -0.5, 0.8).normalize();
    for (transform, extinction) in [(unit(), 0.2), (odd(), 2.0)] {
        let (single, double) = (lumpy(transform), field::<f64>(20, transform, lumps(20)));
        let (centre, size) = (single.world_bounds().centre(), single.world_bounds().size().length());
        let sun = |angle| Light::Sun { direction: towards, irradiance: radiance, angle };
        let away = centre + 1.5 * size * towards;
        let cone = Cone::new(-towards, 0.3, 0.8).unwrap();
        let lights = [
            ("sun", sun(0.0)),
            ("point", Light::Point { position: away, intensity: radiance * (size * size) as f32 }),
            ("wide sun", sun(0.6)),
            ("sphere", Light::Sphere { centre: away, radius: 0.4 * size, radiance }),
            ("disc", Light::Disc { centre: away, radius: 0.6 * size, radiance }),
            (
                "spot",
                Light::Spot {
                    position: away,
                    radius: 0.0,
                    soft: false,
                    intensity: radiance * (size * size) as f32,
                    cone,
                },
            ),
            (
                "rectangle",
                Light::Rectangle {
                    corner: away,
                    edges: [
                        towards.any_orthogonal_vector() * size,
                        towards.cross(towards.any_orthogonal_vector()) * size,
                    ]
                    .map(|edge| -edge),
                    radiance: 4.0 * radiance,
                },
            ),
        ];
        for (g, gradient_shading) in [(0.0, None), (0.7, None), (-0.9, None), (0.3, Some(0.05))] {
            let phase = Phase::of_anisotropy(g);
            let scattering = Scattering { gradient_shading, ..Scattering::new(ALBEDO, phase) };
            let scattered = |at: DVec3, from: DVec3, to: DVec3| {
                let index = single.transform.to_index(at);
                let slope = |axis| 0.5 * (double.sample(index + axis) - double.sample(index - axis));
                let inverse = DMat3::from_mat4(single.transform.inverse_matrix());
                let gradient = inverse.transpose() * DVec3::from_array(DVec3::AXES.map(slope));
                let (normal, ratio) =
                    (gradient.normalize(), gradient_shading.map_or(0.0, |half| gradient.length() / half));
                let share = ratio * ratio / (1.0 + ratio * ratio);
                let lit = -from.dot(normal).signum() * normal.dot(to);
                share * lit.max(0.0) / PI + (1.0 - share) * phase.value(from.dot(to))
            };
            for (name, light) in lights {
                let light = light.checked().unwrap();
                let light = match light {
                    // The light shines to the side of u × v.
                    Light::Rectangle { corner, edges: [u, v], radiance }
                        if light.sample(centre, [0.5, 0.5]).is_none() =>
                    {
                        Light::Rectangle { corner, edges: [v, u], radiance }
                    }
                    light => light,
                };
                let rays = through(&single, 4);
                let medium = Medium { scattering: Some(scattering), ..Medium::absorbing(extinction) };
                let scene = scene(&single, medium, vec![light], [0.0; 3]);
                let tracer = PathTracer::new(&scene).unwrap().limits(Limits { max_bounces: 1 });
                let found: Vec<_> = rays.iter().map(|ray| estimate(&tracer, ray, 32)).collect();
                let expected = rays.iter().map(|ray| {
                    scattered_once(&double, extinction, ALBEDO, ray, |at, dvr| {
                        let edge = if matches!(name, "sun" | "point" | "spot") { 1 } else { 20 };
                        let mut sum = DVec3::ZERO;
                        for k in 0..edge * edge {
                            let u = [k % edge, k / edge].map(|i| (f64::from(i) + 0.5) / f64::from(edge));
                            let Some(arrival) = light.sample(at, u) else { continue };
                            let toward = Ray::new(at, arrival.direction);
                            let scattered = scattered(at, ray.direction, arrival.direction);
                            let density = if arrival.density.is_infinite() { 1.0 } else { arrival.density };
                            let transmittance = (-dvr.optical_depth(&toward)).exp();
                            sum += arrival.radiance.as_dvec3() * scattered * transmittance / density;
                        }
                        sum / f64::from(edge * edge)
                    })
                });
                let expected: Vec<Estimate> = expected
                    // Of the quadrature: 120 steps, and 400 directions of a light with extent.
                    .map(|rgb| rgb.map(|v| [v, (2e-3 * v).powi(2)]))
                    .collect();
                assert_agree(&format!("{name}, anisotropy {g}, {gradient_shading:?}"), &found, &expected);
            }
        }
    }
}

/// A picture of the sky with a small sun, scattered once; and a white one, in which nothing that absorbs nothing is seen.
#[test]
fn skies_are_those_of_their_pictures() {
    let sky = |pixel: &dyn Fn(usize, usize) -> f32| {
        let rgba = (0..32 * 16).map(|i| [pixel(i % 32, i / 32), 0.5 * pixel(i % 32, i / 32), 1.0, 1.0]);
        Some(Arc::new(EnvironmentMap::new(&Film::of(32, 16, rgba.collect()), [1.0; 3]).unwrap()))
    };
    let (field, double) = (lumpy(unit()), field::<f64>(20, unit(), lumps(20)));
    let phase = Phase::HenyeyGreenstein(0.6);
    let sunny = sky(&|x, y| if (x, y) == (5, 4) { 60.0 } else { 0.1 + 0.02 * (x % 5) as f32 });
    let mut lit = scene(&field, medium(0.2, ALBEDO, phase), vec![], [0.0; 3]);
    lit.environment.map = sunny.clone();
    let rays = through(&field, 3);
    let tracer = PathTracer::new(&lit).unwrap().limits(Limits { max_bounces: 1 }).background([0.0; 3]);
    let found: Vec<_> = rays.iter().map(|ray| estimate(&tracer, ray, 64)).collect();
    let map = sunny.unwrap();
    let expected = rays.iter().map(|ray| {
        scattered_once(&double, 0.2, ALBEDO, ray, |at, dvr| {
            let (mut sum, [turns, rises]) = (DVec3::ZERO, [96_u32, 48]);
            for k in 0..turns * rises {
                let (turn, rise) =
                    ((f64::from(k % turns) + 0.5) / f64::from(turns), (f64::from(k / turns) + 0.5) / f64::from(rises));
                let (elevation, turn) = (PI * rise, 2.0 * PI * turn);
                let direction = DVec3::new(elevation.sin() * turn.cos(), elevation.sin() * turn.sin(), elevation.cos());
                let area = elevation.sin() * 2.0 * PI * PI / f64::from(turns * rises);
                let transmittance = (-dvr.optical_depth(&Ray::new(at, direction))).exp();
                sum += map.towards(direction).as_dvec3()
                    * (phase.value(ray.direction.dot(direction)) * transmittance * area);
            }
            sum
        })
    });
    // Of the quadrature over directions and along the ray.
    let expected: Vec<Estimate> = expected.map(|rgb| rgb.map(|v| [v, (4e-3 * v).powi(2)])).collect();
    assert_agree("a sky with a sun", &found, &expected);

    let rgba = vec![[0.7, 1.0, 2.0, 1.0]; 8];
    let mut white = scene(&field, medium(1.0, [1.0; 3], phase), vec![], [0.0; 3]);
    white.environment.map = Some(Arc::new(EnvironmentMap::new(&Film::of(4, 2, rgba), [1.0; 3]).unwrap()));
    let tracer = PathTracer::new(&white).unwrap();
    let white: Vec<_> = rays.iter().map(|ray| estimate(&tracer, ray, 16)).collect();
    assert_agree("a white picture", &white, &exact(rays.iter().map(|_| [0.7, 1.0, 2.0])));
}

/// Whatever is inside, a volume that absorbs nothing is invisible in light that is the same from everywhere.
#[test]
fn a_white_furnace_stays_white() {
    let field = lumpy(unit());
    for (g, gradient_shading) in [(-0.9, None), (0.0, None), (0.5, None), (0.9, None), (0.5, Some(0.05))] {
        for extinction in [0.01, 1.0, 10.0] {
            let scattering = Scattering { gradient_shading, ..Scattering::new([1.0; 3], Phase::HenyeyGreenstein(g)) };
            let medium = Medium { scattering: Some(scattering), ..Medium::absorbing(extinction) };
            let scene = scene(&field, medium, vec![], [0.7, 1.0, 2.0]);
            let tracer = PathTracer::new(&scene).unwrap();
            let mut scratch = Scratch::default();
            for (k, ray) in through(&field, 4).iter().enumerate() {
                let paths = 500;
                let mut sum = Vec3::ZERO;
                for path in 0..paths {
                    let mut sampler = Sampler::new(1, [k, 0], path);
                    sum += sample(&tracer, ray, &mut sampler, &mut scratch).radiance() / paths as f32;
                }
                // What is not scattered is computed, and what is returns unchanged: nothing is noisy.
                for (found, expected) in sum.to_array().into_iter().zip([0.7, 1.0, 2.0]) {
                    assert!((found / expected - 1.0).abs() < 1e-4, "g {g}, extinction {extinction}: {sum}");
                }
            }
            assert_eq!((scratch.counts.violations, scratch.counts.impossible), (0, 0));
        }
    }
}

pub fn peaks() -> Table {
    let value = |s: f64| [0.8 * s, 0.3 + 0.1 * s, 0.2, s];
    Table::new(vec![0.05, 0.2, 0.3, 0.6, 0.6, 0.9], [0.0, 3.0, 0.2, 0.0, 1.0, 0.5].map(value).to_vec()).unwrap()
}

/// A half space that scatters like a surface, seen along its normal: light of irradiance E from the angle of cosine µ is
/// scattered once as the radiance `ϖ E µ² / (π (1 + µ))`, whatever the densities by depth.
#[test]
fn a_wall_is_lit_by_lamberts_law() {
    let field = field::<f32>(33, unit(), |p| p.z);
    let ray = Ray::new(DVec3::new(16.2, 15.7, -5.0), DVec3::Z);
    for cosine in [0.5_f64, 0.9] {
        let direction = DVec3::new((1.0 - cosine * cosine).sqrt(), 0.0, -cosine);
        let sun = Light::Sun { direction, irradiance: Vec3::ONE, angle: 0.0 };
        let scattering =
            Scattering { gradient_shading: Some(1e-4), ..Scattering::new(ALBEDO, Phase::HenyeyGreenstein(0.7)) };
        let wall = Medium { scattering: Some(scattering), ..Medium::absorbing(2.0) };
        let scene = scene(&field, wall, vec![sun], [0.0; 3]);
        let tracer = PathTracer::new(&scene).unwrap().limits(Limits { max_bounces: 1 });
        let expected = ALBEDO.map(|albedo| f64::from(albedo) * cosine * cosine / (PI * (1.0 + cosine)));
        assert_agree("a wall", &[estimate(&tracer, &ray, 400)], &exact([expected]));
    }
}

/// What grids emit is the same in one volume, in several that overlap, and in each channel of chromatic ones.
#[test]
fn flames_overlap_and_shine_through_chromatic_media() {
    let field = lumpy(unit());
    let flame = fields::field::<f32>(20, unit(), |p| (-(p - DVec3::new(9.0, 8.0, 12.0)).length_squared() / 9.0).exp());
    let emissive = |medium: Medium, share: f32| {
        let emission = Emission::Linear(Vec3::new(1.0, 0.5, 0.25) * share);
        let grid = emission::volume(&field, medium.extinction, &[(flame.clone(), emission)]).unwrap();
        Volume::Emissive { density: field.clone(), medium, emission: Box::new(Emitted::new(grid)) }
    };
    let of_depth = |extinction| medium(extinction, ALBEDO, Phase::HenyeyGreenstein(0.3));
    let sun = Light::Sun { direction: DVec3::Z, irradiance: Vec3::ONE, angle: 0.0 };
    let lit = |volumes| Scene { volumes, ..scene(&field, of_depth(1.0), vec![sun], [0.1; 3]) };
    let rays = through(&field, 4);
    let traced = |tracer: PathTracer<'_>| rays.iter().map(|ray| estimate(&tracer, ray, 32)).collect::<Vec<_>>();
    let of = |volumes| traced(PathTracer::new(&lit(volumes)).unwrap());
    let whole = lit(vec![emissive(of_depth(0.5), 1.0)]);
    let expected = traced(PathTracer::new(&whole).unwrap());
    assert_agree("sampled", &traced(PathTracer::generic(&whole).unwrap()), &expected);
    let halves = vec![emissive(of_depth(0.3), 0.75), emissive(of_depth(0.2), 0.25)];
    assert_agree("two flames", &of(halves), &expected);
    let beside = vec![Volume::Density(field.clone(), of_depth(0.3)), emissive(of_depth(0.2), 1.0)];
    assert_agree("smoke beside", &of(beside), &expected);
    let color = [0.3, 1.0, 0.6];
    let channels = color.map(|share| of(vec![emissive(of_depth(0.5 * f64::from(share)), 1.0)]));
    let expected: Vec<Estimate> =
        (0..rays.len()).map(|ray| [0, 1, 2].map(|channel| channels[channel][ray][channel])).collect();
    assert_agree("chromatic", &of(vec![emissive(Medium { color, ..of_depth(0.5) }, 1.0)]), &expected);
}

/// Without scattering, paths and direct volume rendering have the same mean, by the same function.
#[test]
fn without_scattering_it_is_direct_volume_rendering() {
    let field = lumpy(unit());
    let sources = [Source::Grey([0.3, 0.6, 0.9]), Source::Linear([1.0, 0.5, 0.2]), Source::Transfer(Arc::new(peaks()))];
    for source in sources {
        let medium = Medium::new(0.4, source.clone());
        let dvr = Dvr::new(&field, medium.clone()).unwrap().over([0.1, 0.2, 0.3]);
        let rays = through(&field, 6);
        let expected = exact(rays.iter().map(|ray| dvr.pixel(ray).rgb.map(f64::from)));
        let scene = scene(&field, medium, vec![], [0.1, 0.2, 0.3]);
        let tracer = PathTracer::new(&scene).unwrap();
        let found: Vec<_> = rays.iter().map(|ray| estimate(&tracer, ray, 64)).collect();
        assert_agree(&format!("{source:?}").chars().take(20).collect::<String>(), &found, &expected);
    }
}

/// Scenes with all effects, for comparisons of estimators with each other.
fn busy(field: &Bricks<f32>) -> Scene {
    let medium = Medium {
        scattering: Some(Scattering::new(ALBEDO, Phase::HenyeyGreenstein(0.4))),
        ..Medium::new(0.3, Source::Transfer(Arc::new(peaks())))
    };
    let (centre, size) = (field.world_bounds().centre(), field.world_bounds().size().length());
    let lights = vec![
        Light::Sun { direction: DVec3::new(0.2, 0.4, 0.9), irradiance: Vec3::splat(2.0), angle: 0.1 },
        Light::Sphere { centre: centre + DVec3::X * size, radius: 0.2 * size, radiance: Vec3::new(3.0, 2.0, 1.0) },
    ];
    scene(field, medium, lights, [0.2, 0.3, 0.4])
}

/// Two volumes of half the density in one place are one; several volumes use the generic kernel, which agrees with the
/// specialised one.
#[test]
fn overlapping_volumes_add() {
    let field = lumpy(unit());
    let whole = medium(0.4, ALBEDO, Phase::HenyeyGreenstein(0.3));
    let sun = Light::Sun { direction: DVec3::Y, irradiance: Vec3::ONE, angle: 0.0 };
    let one = scene(&field, whole.clone(), vec![sun], [0.5; 3]);
    let mut two = one.clone();
    two.volumes = vec![Volume::Density(field.clone(), Medium { extinction: 0.2, ..whole }); 2];
    let rays = through(&field, 5);
    let of = |tracer: PathTracer<'_>| -> Vec<_> { rays.iter().map(|ray| estimate(&tracer, ray, 32)).collect() };
    let expected = of(PathTracer::new(&one).unwrap());
    assert_agree("two halves", &of(PathTracer::new(&two).unwrap()), &expected);
    assert_agree("generic kernel", &of(PathTracer::generic(&one).unwrap()), &expected);
    let busy = busy(&field);
    assert_agree(
        "generic kernel, all effects",
        &of(PathTracer::generic(&busy).unwrap()),
        &of(PathTracer::new(&busy).unwrap()),
    );
}

/// The plane of optical depths is exact, whatever the paths estimate transmittances by: of one volume, of two in one
/// place, and in the mean of the channels.
#[test]
fn optical_depths_add() {
    let field = lumpy(unit());
    let whole = medium(0.4, ALBEDO, Phase::HenyeyGreenstein(0.3));
    let one = scene(&field, whole.clone(), vec![], [0.5; 3]);
    let with = |volumes| Scene { volumes, ..one.clone() };
    let volume = |extinction, color| Volume::Density(field.clone(), Medium { extinction, color, ..whole.clone() });
    let cases = [
        one.volumes.clone(),
        vec![volume(0.2, [1.0; 3]); 2],
        vec![volume(0.6, [1.0, 0.5, 0.5])],
        vec![volume(0.3, [1.0, 0.5, 0.5]); 2],
    ];
    let dvr = Dvr::new(&field, Medium::absorbing(0.4)).unwrap().early_stop(0.0).over([0.0; 3]);
    let (camera, aovs, never) = (camera(&field, 24), [Aov::OpticalDepth], Cancel::NEVER);
    let expected = film::render(&dvr, &camera, Sampling::grid(8), &aovs, &never).unwrap().film;
    let deepest = expected.planes[0].samples.iter().copied().fold(0.0, f32::max);
    for volumes in cases {
        let scene = with(volumes);
        let tracer = PathTracer::new(&scene).unwrap();
        let found = film::render(&tracer, &camera, Sampling::random(64, 1), &aovs, &never).unwrap().film;
        let pairs = || found.planes[0].samples.iter().zip(&expected.planes[0].samples);
        let largest = pairs().map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(largest < 0.1 * deepest, "{largest} of {deepest}");
        let mean = pairs().map(|(a, b)| a - b).sum::<f32>() / pairs().map(|(_, b)| b).sum::<f32>();
        assert!(mean.abs() < 2e-3, "{mean}");
    }
}

/// A chromatic medium is in each channel what a medium of that channel's extinction is, whatever lights it: one channel may
/// let all light through, and volumes may overlap.
#[test]
fn each_channel_of_a_chromatic_medium_is_a_medium_of_its_own() {
    let field = lumpy(unit());
    let busy = busy(&field);
    let plain = medium(0.5, ALBEDO, Phase::HenyeyGreenstein(0.6));
    let (centre, size) = (field.world_bounds().centre(), field.world_bounds().size().length());
    let pixels = (0..32).map(|i| if i == 9 { [9.0, 6.0, 3.0, 1.0] } else { [0.1, 0.1, 0.2, 1.0] }).collect();
    let map = Some(Arc::new(EnvironmentMap::new(&Film::of(8, 4, pixels), [1.0; 3]).unwrap()));
    let panel = Light::Rectangle {
        corner: centre + DVec3::new(-0.5, -0.5, 0.7) * size,
        edges: [DVec3::Y * size, DVec3::X * size],
        radiance: Vec3::new(1.0, 2.0, 3.0),
    };
    let pictured = Scene {
        environment: Environment { radiance: [0.1, 0.0, 0.2], map },
        ..scene(&field, plain.clone(), vec![panel], [0.0; 3])
    };
    let mut two = pictured.clone();
    two.volumes.push(Volume::Density(field.clone(), Medium { extinction: 0.2, ..plain.clone() }));
    let dense = scene(&field, Medium { extinction: 20.0, ..plain }, vec![panel], [0.5; 3]);
    let rays = through(&field, 4);
    for (what, scene, color) in [
        ("all effects", busy, [0.3, 1.0, 0.6]),
        ("picture of a sky", pictured, [1.0, 0.1, 0.0]),
        ("two volumes", two, [0.2, 0.5, 1.0]),
        ("dense", dense, [1.0, 0.02, 0.2]),
    ] {
        let with = |change: &dyn Fn(Medium) -> Medium| {
            let mut scene = scene.clone();
            if let Volume::Density(_, medium) = &mut scene.volumes[0] {
                *medium = change(medium.clone());
            }
            let tracer = PathTracer::new(&scene).unwrap();
            rays.iter().map(|ray| estimate(&tracer, ray, 32)).collect::<Vec<_>>()
        };
        let found = with(&|medium| Medium { color, ..medium });
        let channels =
            color.map(|share| with(&|m| Medium { extinction: m.extinction * f64::from(share.max(1e-9)), ..m }));
        let expected: Vec<Estimate> =
            (0..rays.len()).map(|ray| [0, 1, 2].map(|channel| channels[channel][ray][channel])).collect();
        assert_agree(what, &found, &expected);
    }
}

/// Chromatic media that absorb nothing are invisible in light from everywhere, however the path's channels compete.
#[test]
fn a_chromatic_furnace_stays_white() {
    let field = lumpy(unit());
    for extinction in [0.05, 1.0, 10.0] {
        let medium = Medium { color: [1.0, 0.5, 0.1], ..medium(extinction, [1.0; 3], Phase::Isotropic) };
        let scene = scene(&field, medium, vec![], [0.7, 1.0, 2.0]);
        let tracer = PathTracer::new(&scene).unwrap();
        let found: Vec<_> = through(&field, 3).iter().map(|ray| estimate(&tracer, ray, 32)).collect();
        assert_agree(&format!("extinction {extinction}"), &found, &exact(vec![[0.7, 1.0, 2.0]; 3]));
    }
}

/// A grid that emits beside a medium does what a source of the medium does, if it is proportional to the density; without
/// scattering nothing is noisy.
#[test]
fn grids_emit_as_sources_do() {
    let field = lumpy(unit());
    let (albedo, color) = ([0.8, 0.5, 0.0], [1.0, 0.5, 2.0_f32]);
    let rays = through(&field, 4);
    for phase in [Phase::Isotropic, Phase::HenyeyGreenstein(-0.5)] {
        for lights in [vec![], vec![Light::Sun { direction: DVec3::Z, irradiance: Vec3::ONE, angle: 0.0 }]] {
            let medium = medium(0.5, albedo, phase);
            let by_source = Medium { source: Source::Grey(color), ..medium.clone() };
            let source = scene(&field, by_source, lights, [0.1; 3]);
            let emitted = Vec3::from_array(color) * (Vec3::ONE - Vec3::from_array(albedo)) * 0.5;
            let emission = emission::volume(&field, 0.5, &[(field.clone(), Emission::Linear(emitted))]);
            let emission = Box::new(Emitted::new(emission.unwrap()));
            let mut grid = source.clone();
            grid.volumes = vec![Volume::Emissive { density: field.clone(), medium, emission }];
            let of = |scene: &Scene| -> Vec<_> {
                let tracer = PathTracer::new(scene).unwrap();
                rays.iter().map(|ray| estimate(&tracer, ray, 32)).collect()
            };
            assert_agree(&format!("{phase:?}"), &of(&grid), &of(&source));
        }
    }
}

/// What a test of means must not let pass: an albedo and a phase function that are slightly off, an order of scattering
/// left out, a light that is a little too bright.
#[test]
fn biased_variants_are_found() {
    let field = lumpy(unit());
    let right = busy(&field);
    let rays = through(&field, 6);
    let of = |scene: &Scene, max_bounces| -> Vec<_> {
        let tracer = PathTracer::new(scene).unwrap().limits(Limits { max_bounces });
        rays.iter().map(|ray| estimate(&tracer, ray, 64)).collect()
    };
    let expected = of(&right, u32::MAX);
    let changed = |change: &dyn Fn(&mut Medium)| {
        let mut scene = right.clone();
        if let Volume::Density(_, medium) = &mut scene.volumes[0] {
            change(medium);
        }
        scene
    };
    let scattering =
        |albedo, phase| move |medium: &mut Medium| medium.scattering = Some(Scattering::new(albedo, phase));
    let mut brighter = right.clone();
    if let Light::Sphere { radiance, .. } = &mut brighter.lights[1] {
        *radiance *= 1.2;
    }
    let variants = [
        ("albedo", of(&changed(&scattering([0.93, 0.63, 0.33], Phase::HenyeyGreenstein(0.4))), u32::MAX)),
        ("phase function", of(&changed(&scattering(ALBEDO, Phase::HenyeyGreenstein(0.3))), u32::MAX)),
        ("orders above the second", of(&right, 2)),
        ("light", of(&brighter, u32::MAX)),
    ];
    for (name, found) in variants {
        let (worst, limit) = (deviation(&found, &expected), limit(3 * rays.len()));
        println!("{name}: {worst:.1} standard errors, {limit:.1} allowed");
        assert!(worst > limit, "{name}: {worst} standard errors pass for chance");
    }
}

fn camera(field: &Bricks<f32>, size: u32) -> Camera {
    let bounds = field.world_bounds();
    Camera {
        camera_to_world: Camera::look_at(bounds.centre() + bounds.size() * 1.3, bounds.centre(), DVec3::Z),
        projection: Projection::Perspective,
        focal: DVec2::splat(1.4 * f64::from(size)),
        centre: DVec2::splat(0.5 * f64::from(size)),
        width: size,
        height: size,
        near: 0.0,
        blur: Blur::default(),
    }
}

/// Pictures are the same bit for bit with one thread and with several, with any instruction set but for rounding, and
/// their pixels do not depend on what else the picture holds.
#[test]
fn pictures_depend_on_seed_and_pixel_alone() {
    let field = lumpy(unit());
    let scene = busy(&field);
    let (camera, go, sampling) = (camera(&field, 24), Cancel::NEVER, Sampling::random(8, 5));
    let picture = |threads: usize, arch: Arch, camera: &Camera, sampling| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let tracer = PathTracer::new(&scene).unwrap().arch(arch);
        pool.install(|| film::render(&tracer, camera, sampling, &[], &go)).unwrap().film
    };
    let one = picture(1, Arch::default(), &camera, sampling);
    assert!(one.rgba.iter().flatten().all(|v| v.is_finite() && *v >= 0.0));
    assert_eq!(one, picture(7, Arch::default(), &camera, sampling));
    assert_ne!(one, picture(7, Arch::default(), &camera, Sampling::random(8, 6)));
    let upper = Camera { height: 10, ..camera };
    assert_eq!(one.rgba[..240], picture(3, Arch::default(), &upper, sampling).rgba);
}

/// Hard cases (design notes, numerics): each gives finite pixels that are not negative, without a majorant violated.
/// Halves are independent over 200 seeds, and the plane of variances is on average that of the mean.
#[test]
fn halves_are_independent_and_variances_those_of_means() {
    const SEEDS: u64 = 200;
    let field = lumpy(unit());
    let scene = busy(&field);
    let tracer = PathTracer::new(&scene).unwrap();
    let camera = camera(&field, 6);
    let never = Cancel::NEVER;
    for paths in [4, 16, 64, 256] {
        let picture = |seed| {
            film::render(&tracer, &camera, Sampling::random(paths, seed), &[Aov::Variance, Aov::Halves], &never)
                .unwrap()
                .film
        };
        let films: Vec<Film> = (0..SEEDS).map(picture).collect();
        // Sums over pixels and channels: of the variances over seeds, those stated, and of halves with one another.
        let (mut seen, mut stated, mut both, mut of_a, mut of_b) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (channel, name) in ["R", "G", "B"].into_iter().enumerate() {
            for pixel in 0..36 {
                let of = |plane: &str| -> Vec<f64> {
                    let plane = format!("{plane}.{name}");
                    films.iter().map(|film| f64::from(film.plane(&plane).unwrap()[pixel])).collect()
                };
                let (a, b) = (of("half_a"), of("half_b"));
                let means: Vec<f64> = films.iter().map(|film| f64::from(film.rgba[pixel][channel])).collect();
                let covariance = |x: &[f64], y: &[f64]| {
                    let [mx, my] = [x, y].map(|v| v.iter().sum::<f64>() / SEEDS as f64);
                    x.iter().zip(y).map(|(x, y)| (x - mx) * (y - my)).sum::<f64>() / (SEEDS - 1) as f64
                };
                assert!(a.iter().zip(&b).zip(&means).all(|((a, b), m)| (0.5 * (a + b) - m).abs() < 1e-5 * (1.0 + m)));
                seen += covariance(&means, &means);
                stated += of("variance").iter().sum::<f64>() / SEEDS as f64;
                both += covariance(&a, &b);
                of_a += covariance(&a, &a);
                of_b += covariance(&b, &b);
            }
        }
        let (correlation, ratio) = (both / (of_a * of_b).sqrt(), stated / seen);
        println!("{paths} paths: correlation of halves {correlation:.3}, stated over seen variance {ratio:.3}");
        assert!(correlation.abs() < 0.1 && (0.9..1.1).contains(&ratio), "{paths}: {correlation} {ratio}");
    }
}

#[test]
fn hard_cases_stay_finite() {
    let cube = |value: f64| field::<f32>(9, unit(), move |_| value);
    let sun = |angle| Light::Sun { direction: DVec3::Z, irradiance: Vec3::ONE, angle };
    let inside = Light::Sphere { centre: DVec3::splat(4.0), radius: 2.0, radiance: Vec3::ONE };
    let at = Light::Point { position: DVec3::splat(4.0), intensity: Vec3::ONE };
    let hg = Phase::HenyeyGreenstein;
    let cases = [
        ("empty", cube(0.0), medium(1.0, [0.9; 3], Phase::Isotropic), vec![sun(0.0)]),
        ("thin", cube(1e-8), medium(1.0, [0.9; 3], Phase::Isotropic), vec![sun(0.0)]),
        ("optical depth 1e4", cube(1.0), medium(1e3, [0.99; 3], Phase::Isotropic), vec![sun(0.0)]),
        ("optical depth 1e8", cube(1.0), medium(1e7, [0.5; 3], Phase::Isotropic), vec![sun(0.0)]),
        ("black", cube(1.0), medium(1.0, [0.0; 3], Phase::Isotropic), vec![sun(0.0)]),
        ("forward", cube(1.0), medium(1.0, [0.9; 3], hg(0.999)), vec![sun(0.0), sun(0.01)]),
        ("backward", cube(1.0), medium(1.0, [0.9; 3], hg(-0.999)), vec![sun(1e-9), sun(3.1)]),
        ("light inside", cube(1.0), medium(0.3, [0.9; 3], hg(0.5)), vec![inside, at]),
        ("one colored", cube(1.0), medium(1.0, [1.0, 0.0, 0.5], hg(0.5)), vec![inside, sun(0.1)]),
    ];
    let shell = field::<f32>(17, unit(), |p| f64::from((p - 8.0).length() > 6.9) * (1.0 + noise(p.x.to_bits())));
    // One voxel that sets the bound of all around it.
    let spike = field::<f32>(9, unit(), |p| if p == DVec3::splat(4.0) { 1e9 } else { 0.1 });
    let far = field::<f32>(9, Affine::uniform(1e-4, DVec3::splat(1e3)).unwrap(), |_| 1.0);
    let scattering = Some(Scattering::new([0.9; 3], Phase::Isotropic));
    let peaked = Medium { scattering, ..Medium::new(1.0, Source::Transfer(Arc::new(peaks()))) };
    let more = [
        ("shell", shell, medium(50.0, [0.9; 3], Phase::Isotropic), vec![sun(0.1)]),
        ("spike", spike.clone(), medium(1.0, [0.9; 3], Phase::Isotropic), vec![sun(0.1)]),
        ("spike behind a function", spike, Medium { extinction: 1e12, ..peaked.clone() }, vec![sun(0.1)]),
        ("far from the origin", far, medium(1e4, [0.9; 3], Phase::Isotropic), vec![sun(0.1)]),
    ];
    for (name, field, medium, lights) in cases.into_iter().chain(more) {
        let scene = scene(&field, medium, lights, [1.0, 0.5, 0.1]);
        let tracer = PathTracer::new(&scene).unwrap();
        let go = Cancel::NEVER;
        let outside = camera(&field, 12);
        let inside = Camera {
            camera_to_world: Camera::look_at(field.world_bounds().centre(), DVec3::ZERO, DVec3::Z),
            ..outside
        };
        for camera in [outside, inside] {
            let found = film::render(&tracer, &camera, Sampling::random(4, 1), &[], &go).unwrap();
            assert!(found.film.rgba.iter().flatten().all(|v| v.is_finite() && *v >= 0.0), "{name}");
            assert_eq!((found.counts.violations, found.counts.impossible), (0, 0), "{name}");
        }
    }
}
