//! Pre-shaded volumes: light, its derivatives, and files.
#![allow(clippy::unwrap_used, missing_docs, reason = "a panic is how a test fails")]

mod fields;

use cumulo::lanes::Lanes;
use cumulo::math::Ray;
use cumulo::real::Real;
use cumulo::render::preshaded::{Preshaded, Tape};
use cumulo::scene::bricks::Bricks;
use fields::{field, lumps, noise, odd, unit};
use glam::{DVec3, DVec4};

const N: i32 = 20;

/// Emissions and extinctions of a lumpy field; these `thick` times as large.
fn volume<R: Real>(thick: f64, transform: cumulo::math::Affine) -> Bricks<R::Lanes> {
    let density: Bricks<R> = field(N, transform, lumps(N));
    let mut volume = Bricks::<R::Lanes>::zeros(density.topology.clone(), transform);
    for (v, d) in volume.values.iter_mut().zip(&density.values) {
        // Apron copies must agree: the tint follows the density, not the slot.
        let tint = |k: f64| R::of(d.f64() * (1.0 + 0.5 * (k * 9.0 * d.f64()).sin()));
        *v = R::Lanes::load([tint(1.0), tint(2.0), tint(3.0), R::of(thick * d.f64())]);
    }
    volume
}

fn rays(transform: &cumulo::math::Affine) -> Vec<Ray> {
    let at = |k: u64| DVec3::new(noise(3 * k), noise(3 * k + 1), noise(3 * k + 2));
    (0..12)
        .map(|k| {
            let target = transform.to_world(f64::from(N) * (0.25 + 0.5 * at(k)));
            let direction = (at(k + 100) - 0.5).normalize();
            Ray { origin: target - 40.0 * direction, direction }
        })
        .collect()
}

/// A source of one colour gives that colour times alpha, however thick.
#[test]
fn one_colour_is_seen_by_alpha() {
    for thick in [1e-3, 0.3, 3.0, 40.0] {
        let mut volume = volume::<f64>(thick, odd());
        volume.values.iter_mut().for_each(|v| *v = DVec4::new(0.9, 0.5, 0.1, 1.0) * v.w);
        let renderer = Preshaded::<f64>::new(&volume, [0.2, 0.0, 0.0]);
        for ray in rays(&odd()) {
            let seen = renderer.trace(&ray, &mut Tape::default());
            let (t, alpha) = (seen.transmittance, 1.0 - seen.transmittance);
            let wanted = [0.9 * alpha + 0.2 * t, 0.5 * alpha, 0.1 * alpha];
            for (c, wanted) in wanted.iter().enumerate() {
                assert!((seen.rgb[c] - wanted).abs() < 2e-4, "thick {thick}: {:?}, not {wanted}", seen.rgb[c]);
            }
        }
    }
}

/// Against many small steps.
#[test]
fn light_is_that_of_small_steps() {
    let volume = volume::<f64>(0.4, unit());
    let lanes: [Bricks<f64>; 4] = [0, 1, 2, 3].map(|c| Bricks {
        topology: volume.topology.clone(),
        values: volume.values.iter().map(|v| v[c]).collect(),
        transform: volume.transform,
        domain: volume.domain,
    });
    let renderer = Preshaded::<f64>::new(&volume, [0.0; 3]);
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
        let seen = renderer.trace(ray, &mut Tape::default());
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
                let seen = Preshaded::<f64>::new(volume, [0.4, 0.1, 0.8]).trace(ray, &mut Tape::default());
                seen.rgba().iter().zip(weights).map(|(v, w)| v * w).sum::<f64>()
            };
            let mut gradient = vec![DVec4::ZERO; volume.values.len()];
            Preshaded::<f64>::new(&volume, [0.4, 0.1, 0.8]).gradient(ray, |_| weights, &mut gradient);
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
        let seen = Preshaded::<f64>::new(&other, [0.0; 3]).trace(ray, &mut tape);
        let mut gradient = vec![DVec4::ZERO; base.values.len()];
        tape.spread(by, &mut gradient);
        let forward: f64 = (0..3).map(|c| by[c] * seen.rgb[c]).sum();
        let backward: f64 = gradient.iter().zip(&other.values).map(|(g, v)| g.dot(*v)).sum();
        assert!((forward - backward).abs() < 1e-12 * (1.0 + forward.abs()), "{forward} {backward}");
    }
}

#[test]
fn single_precision_is_close() {
    let (single, double) = (volume::<f32>(0.8, odd()), volume::<f64>(0.8, odd()));
    for ray in rays(&odd()) {
        let a = Preshaded::<f32>::new(&single, [0.5; 3]).radiance_on(&ray, &mut Tape::default());
        let b = Preshaded::<f64>::new(&double, [0.5; 3]).trace(&ray, &mut Tape::default());
        for c in 0..3 {
            assert!((f64::from(a.rgb[c]) - b.rgb[c]).abs() < 1e-5, "{:?} {:?}", a.rgb, b.rgb);
        }
    }
}
