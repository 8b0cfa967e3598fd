//! Pre-shaded volumes: light, its derivatives, and files.

use crate::common::fields::{noise, odd, tinted, unit};
use cumulo::math::{Aabb, Affine, Ray};
use cumulo::real::Real;
use cumulo::render::differentiable::{Accumulators, Adjoint, ParameterGradient, RayGradient};
use cumulo::render::preshaded::{Preshaded, Tape};
use cumulo::scene::blur::Blur;
use cumulo::scene::bricks::Bricks;
use cumulo::scene::camera::{Camera, CameraGradient, Projection};
use glam::{DVec2, DVec3, DVec4};

const N: i32 = 20;

/// Emissions and extinctions of a lumpy field; these `thick` times as large.
fn volume<R: Real>(thick: f64, transform: Affine) -> Bricks<R::Lanes> {
    tinted::<R>(N, thick, transform)
}

fn rays(transform: &Affine) -> Vec<Ray> {
    let at = |k: u64| DVec3::new(noise(3 * k), noise(3 * k + 1), noise(3 * k + 2));
    (0..12)
        .map(|k| {
            let target = transform.to_world(f64::from(N) * (0.25 + 0.5 * at(k)));
            let direction = (at(k + 100) - 0.5).normalize();
            Ray::new(target - 40.0 * direction, direction)
        })
        .collect()
}

/// A source of one color gives that color times alpha, however thick.
#[test]
fn one_color_is_seen_by_alpha() {
    for thick in [1e-3, 0.3, 3.0, 40.0] {
        let mut volume = volume::<f64>(thick, odd());
        volume.values.iter_mut().for_each(|v| *v = DVec4::new(0.9, 0.5, 0.1, 1.0) * v.w);
        let renderer = Preshaded::<f64>::new(&volume).over([0.2, 0.0, 0.0]);
        for ray in rays(&odd()) {
            let seen = renderer.pixel_on(&ray, &mut Tape::default());
            let (t, alpha) = (seen.transmittance, 1.0 - seen.transmittance);
            let wanted = [0.9 * alpha + 0.2 * t, 0.5 * alpha, 0.1 * alpha];
            for (c, wanted) in wanted.iter().enumerate() {
                assert!((seen.rgb[c] - wanted).abs() < 2e-4, "thick {thick}: {:?}, not {wanted}", seen.rgb[c]);
            }
        }
    }
}

/// What ending rays early costs stays below what is said: where sources have a brightest color, and where something is
/// emitted without extinction.
#[test]
fn early_stops_are_off_by_no_more_than_is_said() {
    for glow in [0.0, 0.02] {
        // Rays end between batches of bricks: there must be several.
        let mut volume = tinted::<f64>(100, 0.05, unit());
        volume.values.iter_mut().for_each(|v| v.x += glow);
        let whole = Preshaded::<f64>::new(&volume).early_stop(0.0).over([0.2, 0.0, 0.9]);
        let ended = whole.clone().with(|volume| volume.early_stop(0.4));
        assert!(whole.left_out() == 0.0 && ended.left_out().is_finite());
        let mut off = 0.0_f64;
        for k in 0..20 {
            let direction = DVec3::new(1.0, 0.3 * noise(k), 0.2 * noise(k + 50)).normalize();
            let ray = Ray::new(DVec3::new(-5.0, 90.0 * noise(k + 70), 90.0 * noise(k + 90)), direction);
            let [a, b] = [&whole, &ended].map(|renderer| renderer.pixel_on(&ray, &mut Tape::default()).rgba());
            off = (0..4).fold(off, |most, c| most.max((a[c] - b[c]).abs()));
        }
        assert!(off <= ended.left_out() && off > 1e-3, "{glow}: off by {off}, {} said", ended.left_out());
    }
}

/// Against many small steps.
#[test]
fn light_is_that_of_small_steps() {
    let volume = volume::<f64>(0.4, unit());
    let lanes: [Bricks<f64>; 4] = [0, 1, 2, 3].map(|c| Bricks {
        topology: volume.topology.clone(),
        values: volume.values.iter().map(|v| v[c]).collect(),
        background: 0.0,
        reference: 0.0,
        transform: volume.transform,
        domain: volume.domain,
    });
    let renderer = Preshaded::<f64>::new(&volume).over([0.0; 3]);
    for ray in rays(&unit()).iter().take(4) {
        let (steps, length) = (200_000, 80.0);
        let step = length / f64::from(steps);
        let (mut light, mut depth) = ([0.0; 3], 0.0_f64);
        for i in 0..steps {
            let at = ray.at((f64::from(i) + 0.5) * step);
            let x = lanes[3].sample(at) * step;
            for c in 0..3 {
                light[c] += lanes[c].sample(at) * step * (-depth - 0.5 * x).exp();
            }
            depth += x;
        }
        let seen = renderer.pixel_on(ray, &mut Tape::default());
        assert!((seen.depth - depth).abs() < 1e-6 * (1.0 + depth), "{} {depth}", seen.depth);
        for c in 0..3 {
            assert!((seen.rgb[c] - light[c]).abs() < 5e-5 * light[c], "{:?} {light:?}", seen.rgb);
        }
    }
}

/// Every stored value's derivative is that of central differences.
#[test]
fn gradients_are_those_of_differences() {
    for thick in [0.3, 8.0] {
        let mut volume = volume::<f64>(thick, odd());
        for ray in rays(&odd()).iter().take(3) {
            let weights = [0.7, -0.3, 0.5, 0.9];
            let value = |volume: &Bricks<DVec4>| {
                let seen = Preshaded::<f64>::new(volume).over([0.4, 0.1, 0.8]).pixel_on(ray, &mut Tape::default());
                seen.rgba().iter().zip(weights).map(|(v, w)| v * w).sum::<f64>()
            };
            let mut gradient = vec![DVec4::ZERO; volume.values.len()];
            let mut shared = ParameterGradient::default();
            let sinks = Accumulators { voxels: Some(&mut gradient[..]), table: None, ray: None, shared: &mut shared };
            let renderer = Preshaded::<f64>::new(&volume).over([0.4, 0.1, 0.8]);
            renderer.vjp(ray, &mut |_| weights, Adjoint::Tape, sinks, &mut Tape::default());
            let scale = gradient.iter().fold(0.0_f64, |a, v| a.max(v.abs().max_element()));
            let touched: Vec<usize> = (0..gradient.len()).filter(|i| gradient[*i] != DVec4::ZERO).collect();
            assert!(touched.len() > 50);
            for i in touched.iter().step_by(touched.len() / 40) {
                for c in 0..4 {
                    let (kept, h) = (volume.values[*i], 1e-5);
                    let mut at = |d: f64| {
                        volume.values[*i][c] = kept[c] + d;
                        value(&volume)
                    };
                    let difference = (at(h) - at(-h)) / (2.0 * h);
                    volume.values[*i] = kept;
                    assert!(
                        (difference - gradient[*i][c]).abs() < 1e-6 * scale,
                        "thick {thick}, value {i}, lane {c}: {difference} {}",
                        gradient[*i][c]
                    );
                }
            }
        }
    }
}

/// The picture is linear in the emissions, and `spread` is its transpose.
#[test]
fn spread_is_the_transpose() {
    let base = volume::<f64>(0.5, odd());
    let mut other = base.clone();
    other.values.iter_mut().enumerate().for_each(|(i, v)| {
        let n = |k: u64| noise(7 * i as u64 + k);
        *v = DVec4::new(n(0), n(1), n(2), v.w);
    });
    for (k, ray) in rays(&odd()).iter().enumerate() {
        let by = [noise(k as u64), -noise(k as u64 + 9), 0.3];
        let mut tape = Tape::default();
        let seen = Preshaded::<f64>::new(&other).trace(ray, &mut tape);
        let mut gradient = vec![DVec4::ZERO; base.values.len()];
        tape.accumulate(by, &mut gradient);
        let forward: f64 = (0..3).map(|c| by[c] * seen.rgb[c]).sum();
        let backward: f64 = gradient.iter().zip(&other.values).map(|(g, v)| g.dot(*v)).sum();
        assert!((forward - backward).abs() < 1e-12 * (1.0 + forward.abs()), "{forward} {backward}");
    }
}

#[test]
fn single_precision_is_close() {
    let (single, double) = (volume::<f32>(0.8, odd()), volume::<f64>(0.8, odd()));
    for ray in rays(&odd()) {
        let a = Preshaded::<f32>::new(&single).over([0.5; 3]).pixel_on(&ray, &mut Tape::default());
        let b = Preshaded::<f64>::new(&double).over([0.5; 3]).pixel_on(&ray, &mut Tape::default());
        for c in 0..3 {
            assert!((f64::from(a.rgb[c]) - b.rgb[c]).abs() < 1e-5, "{:?} {:?}", a.rgb, b.rgb);
        }
    }
}

const WEIGHTS: [f64; 4] = [0.7, -0.3, 0.5, 0.9];
const BACKGROUND: [f32; 3] = [0.4, 0.1, 0.8];

fn loss(volume: &Bricks<DVec4>, ray: &Ray) -> f64 {
    let seen = Preshaded::<f64>::new(volume).over(BACKGROUND).pixel_on(ray, &mut Tape::default());
    seen.rgba().iter().zip(WEIGHTS).map(|(v, w)| v * w).sum()
}

/// Derivatives by the ray and by the background.
fn followed(volume: &Bricks<DVec4>, ray: &Ray) -> (RayGradient, [f64; 3]) {
    let (mut by, mut shared) = (RayGradient::default(), ParameterGradient::default());
    let sinks = Accumulators { voxels: None, table: None, ray: Some(&mut by), shared: &mut shared };
    let renderer = Preshaded::<f64>::new(volume).over(BACKGROUND);
    renderer.vjp(ray, &mut |_| WEIGHTS, Adjoint::Tape, sinks, &mut Tape::default());
    (by, shared.background)
}

fn close(what: &str, found: f64, difference: f64, scale: f64) {
    assert!((found - difference).abs() < 1e-6 * scale, "{what}: {found}, by differences {difference}");
}

/// Origin and direction have the derivatives of what is computed: cut cells and moving faces included.
fn rays_are_followed(volume: &Bricks<DVec4>, rays: &[Ray]) {
    let h = 1e-6;
    let found: Vec<RayGradient> = rays.iter().map(|ray| followed(volume, ray).0).collect();
    let scale = found.iter().fold([0.0_f64; 2], |[a, b], by| [a.max(by.origin.length()), b.max(by.direction.length())]);
    assert!(scale[0] > 1e-3);
    for (ray, by) in rays.iter().zip(&found) {
        for axis in DVec3::AXES {
            let shifted = |h: f64| loss(volume, &Ray { origin: ray.origin + h * axis, ..*ray });
            close("origin", by.origin.dot(axis), (shifted(h) - shifted(-h)) / (2.0 * h), scale[0]);
            let turned = |h: f64| loss(volume, &Ray { direction: (ray.direction + h * axis).normalize(), ..*ray });
            let across = axis - ray.direction * ray.direction.dot(axis);
            close("direction", by.direction.dot(across), (turned(h) - turned(-h)) / (2.0 * h), scale[1]);
        }
    }
}

#[test]
fn rays_are_followed_as_differences_say() {
    for thick in [0.3, 3.0, 8.0] {
        for transform in [odd(), unit()] {
            rays_are_followed(&volume::<f64>(thick, transform), &rays(&transform));
        }
        let along = DVec3::AXES.map(|direction| Ray::new(DVec3::new(8.3, 9.2, 8.7) - 30.0 * direction, direction));
        let within = Ray::new(DVec3::new(8.3, 9.2, 8.7), DVec3::new(0.6, -0.48, 0.64));
        rays_are_followed(&volume::<f64>(thick, unit()), &[along[0], along[1], along[2], within]);
    }
}

/// A field that is not zero where its box ends, between voxels.
#[test]
fn entry_and_exit_move_with_the_ray() {
    for transform in [odd(), unit()] {
        let mut volume = volume::<f64>(1.0, transform);
        volume.domain = Aabb { min: DVec3::new(5.3, 6.4, 4.0), max: DVec3::new(13.7, 14.2, 12.0) };
        rays_are_followed(&volume, &rays(&transform));
    }
}

/// An origin that moves along its ray, outside of the field, changes nothing.
#[test]
fn along_itself_a_ray_stays() {
    for thick in [0.3, 8.0] {
        let volume = volume::<f64>(thick, odd());
        for ray in rays(&odd()) {
            let by = followed(&volume, &ray).0.origin;
            assert!(by.dot(ray.direction).abs() < 1e-13 * (1.0 + by.length()), "{by} {}", ray.direction);
        }
    }
}

/// A ray in a face of cells that gains no more than rounding across it: no more than what both sides give.
#[test]
fn a_grazed_face_does_no_harm() {
    let (single, double) = (volume::<f32>(0.3, unit()), volume::<f64>(0.3, unit()));
    let ray = |y: f64, tilt: f64| Ray::new(DVec3::new(-30.0, y, 8.7), DVec3::new(1.0, tilt, 0.0));
    let [low, high] = [-1e-7, 1e-7].map(|d| followed(&double, &ray(9.0 + d, 0.0)).0.origin);
    for tilt in [0.0, 1e-17, -1e-17, 1e-12, -1e-9] {
        // Somewhere in the volume it crosses y = 9.
        let ray = ray(9.0 - 38.0 * tilt, tilt);
        let mut by = RayGradient::default();
        let weights = WEIGHTS.map(|w| w as f32);
        Preshaded::<f32>::new(&single).over(BACKGROUND).ray_vjp(&ray, weights, &mut by, &mut Tape::default());
        for found in [by.origin, followed(&double, &ray).0.origin] {
            let slack = DVec3::splat(1e-4);
            let inside = found.cmpge(low.min(high) - slack) & found.cmple(low.max(high) + slack);
            assert!(inside.all(), "{tilt}: {found}, not between {low} and {high}");
        }
    }
}

#[test]
fn cameras_and_background_have_the_derivatives_of_differences() {
    let volume = volume::<f64>(2.0, odd());
    let lens = (DVec2::new(150.0, 130.0), DVec2::new(16.5, 12.0));
    let middle = odd().to_world(DVec3::new(8.0, 10.0, 9.0));
    for projection in [Projection::Perspective, Projection::Orthographic] {
        let camera = Camera {
            camera_to_world: Camera::look_at(middle + DVec3::new(30.0, -20.0, 25.0), middle, DVec3::Z),
            projection,
            focal: if projection == Projection::Perspective { lens.0 } else { lens.0 / 40.0 },
            centre: lens.1,
            width: 32,
            height: 24,
            near: 0.25,
            blur: Blur::default(),
        };
        let pixels = [(16.2, 12.6), (14.5, 10.5), (19.5, 13.5), (12.5, 14.5)];
        let seen = |camera: &Camera| pixels.iter().map(|(x, y)| loss(&volume, &camera.ray(*x, *y))).sum::<f64>();
        let by = pixels.iter().fold(CameraGradient::default(), |sum, (x, y)| {
            let by = followed(&volume, &camera.ray(*x, *y)).0;
            sum.plus(&camera.gradient(*x, *y, by.origin, by.direction))
        });
        // Steps that move rays about as far.
        let check = |what: &str, found: f64, size: f64, h: f64, set: &dyn Fn(&mut CameraGradient, f64)| {
            let at = |h: f64| {
                let mut step = CameraGradient::default();
                set(&mut step, h);
                seen(&camera.moved(&step))
            };
            close(what, found, (at(h) - at(-h)) / (2.0 * h), size);
        };
        for a in 0..3 {
            check("position", by.position[a], by.position.length(), 4e-6, &|s, h| s.position[a] = h);
            check("rotation", by.rotation[a], by.rotation.length(), 1e-7, &|s, h| s.rotation[a] = h);
        }
        for a in 0..2 {
            check("focal", by.focal[a], by.focal.length(), 1e-5 * camera.focal[a], &|s, h| s.focal[a] = h);
            check("centre", by.centre[a], by.centre.length(), 1e-5, &|s, h| s.centre[a] = h);
        }
        assert!(by.position.length() > 1e-3 && by.focal.length() > 1e-5, "{by:?}");
    }
    for ray in rays(&odd()) {
        let found = followed(&volume, &ray).1;
        let open = Preshaded::<f64>::new(&volume).over(BACKGROUND).pixel_on(&ray, &mut Tape::default()).transmittance;
        assert_eq!(found, [0, 1, 2].map(|c| WEIGHTS[c] * open));
    }
}

/// A ray beside the field, and one that begins behind it.
#[test]
fn a_ray_that_misses_has_no_derivative() {
    let volume = volume::<f64>(1.0, unit());
    for origin in [DVec3::new(-50.0, 100.0, 5.0), DVec3::new(50.0, 5.0, 5.0)] {
        let (by, background) = followed(&volume, &Ray::new(origin, DVec3::X));
        assert_eq!((by, background), (RayGradient::default(), [0, 1, 2].map(|c| WEIGHTS[c])));
    }
}

/// The gradient by the emissions is the transpose, too; and what is not asked for changes nothing.
#[test]
fn what_else_is_asked_for_changes_nothing() {
    let volume = volume::<f64>(3.0, odd());
    for ray in rays(&odd()) {
        let renderer = Preshaded::<f64>::new(&volume).over(BACKGROUND);
        let mut tape = Tape::default();
        let seen = renderer.pixel_on(&ray, &mut tape);
        let [mut by_tape, mut by_value] = [(); 2].map(|()| vec![DVec4::ZERO; volume.values.len()]);
        let (mut by_ray, mut shared) = (RayGradient::default(), ParameterGradient::default());
        let sinks =
            Accumulators { voxels: Some(&mut by_value[..]), table: None, ray: Some(&mut by_ray), shared: &mut shared };
        assert_eq!(renderer.vjp(&ray, &mut |_| WEIGHTS, Adjoint::Tape, sinks, &mut tape), seen);
        assert_eq!((by_ray, shared.background), followed(&volume, &ray));
        renderer.medium.trace(&ray, &mut tape);
        tape.accumulate([WEIGHTS[0], WEIGHTS[1], WEIGHTS[2]], &mut by_tape);
        for (a, b) in by_tape.iter().zip(&by_value) {
            assert!((a.truncate() - b.truncate()).abs().max_element() < 1e-14, "{a} {b}");
        }
    }
}

#[test]
fn single_precision_follows_as_closely() {
    let (single, double) = (volume::<f32>(0.8, odd()), volume::<f64>(0.8, odd()));
    let all = rays(&odd()).into_iter().map(|ray| {
        let mut by = RayGradient::default();
        let weights = WEIGHTS.map(|w| w as f32);
        Preshaded::<f32>::new(&single).over(BACKGROUND).ray_vjp(&ray, weights, &mut by, &mut Tape::default());
        (by, followed(&double, &ray).0)
    });
    let all: Vec<_> = all.collect();
    let scale =
        all.iter().fold([0.0_f64; 2], |[a, b], (_, by)| [a.max(by.origin.length()), b.max(by.direction.length())]);
    for (a, b) in all {
        assert!((a.origin - b.origin).length() < 1e-4 * scale[0], "{a:?} {b:?}");
        assert!((a.direction - b.direction).length() < 1e-4 * scale[1], "{a:?} {b:?}");
    }
}
