//! Derivatives of pre-shaded volumes: forward, and backward by tape, replay and inversion, agree.

use crate::common::fields::{odd, rays, signed, tinted, unit, vector};
use cumulo::math::{Aabb, Ray};
use cumulo::real::Lanes;
use cumulo::real::Real;
use cumulo::render::composited::Composited;
use cumulo::render::differentiable::{Accumulators, Adjoint, ParameterGradient, RayGradient, Seeds};
use cumulo::render::preshaded::{Preshaded, Tape};
use cumulo::scene::bricks::Bricks;
use glam::DVec3;

const BACKGROUND: [f32; 3] = [0.4, 0.1, 0.8];

/// Faint and thick (cut cells), and one that is not zero where its box ends, between voxels.
fn volumes<R: Real>() -> Vec<Bricks<R::Lanes>> {
    let mut cut = tinted::<R>(20, 1.0, odd());
    cut.domain = Aabb { min: DVec3::new(5.3, 6.4, 4.0), max: DVec3::new(13.7, 14.2, 12.0) };
    vec![tinted::<R>(20, 0.3, odd()), tinted::<R>(20, 8.0, unit()), cut]
}

/// A direction in all there is, or in one kind.
struct Step<R: Real> {
    values: Option<Vec<R::Lanes>>,
    ray: RayGradient,
    shared: ParameterGradient,
}

fn steps<R: Real>(volume: &Bricks<R::Lanes>) -> [Step<R>; 6] {
    let ray = |origin: f64, direction: f64, seed: u64| RayGradient {
        origin: origin * vector(seed),
        direction: direction * vector(seed + 3),
        step: 0.0,
    };
    let shared = |by: f64| ParameterGradient { background: [0.3, 0.7, -1.1].map(|b| by * b), ..Default::default() };
    let values = |seed: u64| {
        let lane = move |i: usize, c: u64| R::of(signed(seed + 4 * i as u64 + c));
        let one = move |i: usize| R::Lanes::load([lane(i, 0), lane(i, 1), lane(i, 2), lane(i, 3)]);
        Some((0..volume.values.len()).map(one).collect())
    };
    [
        Step { values: values(11), ray: ray(1.0, 1.0, 5), shared: shared(1.0) },
        Step { values: values(77), ray: ray(0.0, 0.0, 0), shared: shared(0.0) },
        Step { values: None, ray: ray(1.0, 0.0, 7), shared: shared(0.0) },
        Step { values: None, ray: ray(0.0, 1.0, 9), shared: shared(0.0) },
        Step { values: None, ray: ray(0.0, 0.0, 0), shared: shared(1.0) },
        Step { values: None, ray: ray(0.0, 0.0, 0), shared: shared(0.0) },
    ]
}

fn seeds<R: Real, const P: usize>(steps: &[Step<R>]) -> Seeds<'_, R::Lanes, P> {
    Seeds {
        ray: std::array::from_fn(|p| steps[p].ray),
        voxels: std::array::from_fn(|p| steps[p].values.as_deref()),
        table: [None; P],
        shared: std::array::from_fn(|p| steps[p].shared),
    }
}

/// All derivatives by one ray.
struct Found<R: Real> {
    values: Vec<R::Lanes>,
    ray: RayGradient,
    background: [f64; 3],
}

fn back<R: Real>(renderer: &Composited<Preshaded<'_, R>>, ray: &Ray, weights: [f64; 4], adjoint: Adjoint) -> Found<R> {
    let mut values = vec![R::Lanes::default(); renderer.medium.field().values.len()];
    let (mut by_ray, mut shared) = (RayGradient::default(), ParameterGradient::default());
    let sinks =
        Accumulators { voxels: Some(&mut values[..]), table: None, ray: Some(&mut by_ray), shared: &mut shared };
    let mut tape = Tape::default();
    let seen = renderer.vjp(ray, &mut |_| weights.map(R::of), adjoint, sinks, &mut tape);
    assert_eq!(seen, renderer.pixel_on(ray, &mut tape), "a gradient's value is the value");
    Found { values, ray: by_ray, background: shared.background }
}

/// `⟨J v, w⟩ = ⟨v, Jᵀ w⟩`, relative to the sum of the magnitudes that either is added up from; and every value is that
/// of the walk without derivatives.
fn the_identity_holds<R: Real>(relative: f64) {
    for volume in volumes::<R>() {
        let (renderer, steps) = (Preshaded::<R>::new(&volume).over(BACKGROUND), steps::<R>(&volume));
        let mut compared = 0;
        for (i, ray) in rays(volume.world_bounds(), 12, 5).iter().enumerate() {
            let weights: [f64; 4] = std::array::from_fn(|c| signed(1000 + 4 * i as u64 + c as u64));
            let mut tape = Tape::default();
            let pushed = renderer.jvp::<6>(ray, &seeds(&steps), &mut tape);
            assert_eq!(pushed.pixel(), renderer.pixel_on(ray, &mut tape), "the tangent's value is the value");
            let found = back(&renderer, ray, weights, Adjoint::Tape);
            for (p, Step { values, ray: by, shared }) in steps.iter().enumerate() {
                let mut terms = Vec::new();
                for a in 0..3 {
                    terms.push(found.ray.origin[a] * by.origin[a]);
                    terms.push(found.ray.direction[a] * by.direction[a]);
                    terms.push(found.background[a] * shared.background[a]);
                }
                for (a, b) in found.values.iter().zip(values.iter().flatten()) {
                    terms.extend((0..4).map(|c| a.store()[c].f64() * b.store()[c].f64()));
                }
                let left: Vec<f64> =
                    pushed.rgba().into_iter().zip(weights).map(|(c, w)| w * c.tangent[p].f64()).collect();
                let size: f64 = terms.iter().chain(&left).map(|t| t.abs()).sum();
                let off = (left.iter().sum::<f64>() - terms.iter().sum::<f64>()).abs();
                assert!(off <= relative * size.max(0.01), "direction {p}, ray {i}: off by {off:.1e} of {size:.1e}");
                compared += usize::from(size > 0.01);
            }
        }
        assert!(compared > 20, "{compared}");
    }
}

#[test]
fn the_tangent_is_the_adjoints_transpose() {
    the_identity_holds::<f64>(1e-12);
    the_identity_holds::<f32>(1e-5);
}

#[test]
fn tangents_are_those_of_differences() {
    let h = 1e-6;
    for volume in volumes::<f64>() {
        let steps = steps::<f64>(&volume);
        for ray in rays(volume.world_bounds(), 8, 2) {
            let renderer = Preshaded::<f64>::new(&volume).over([0.5; 3]);
            // Unit length is kept to first order by steps across the direction.
            let across = |by: &RayGradient| by.direction - ray.direction * ray.direction.dot(by.direction);
            let mut seeds = seeds::<f64, 6>(&steps);
            seeds.ray.iter_mut().for_each(|by| by.direction = across(by));
            let found = renderer.jvp(&ray, &seeds, &mut Tape::default()).rgba();
            for (p, step) in steps.iter().enumerate().take(4) {
                let at = |h: f64| {
                    let mut moved = volume.clone();
                    let by = step.values.iter().flatten();
                    moved.values.iter_mut().zip(by).for_each(|(v, by)| *v += h * *by);
                    let origin = ray.origin + h * step.ray.origin;
                    let direction = (ray.direction + h * across(&step.ray)).normalize();
                    let seen = Preshaded::<f64>::new(&moved)
                        .over([0.5; 3])
                        .pixel_on(&Ray::new(origin, direction), &mut Tape::default());
                    let behind = seen.transmittance * h;
                    let rgb: [f64; 3] = std::array::from_fn(|c| seen.rgb[c] + behind * step.shared.background[c]);
                    [rgb[0], rgb[1], rgb[2], 1.0 - seen.transmittance]
                };
                let (above, below) = (at(h), at(-h));
                for c in 0..4 {
                    let difference = (above[c] - below[c]) / (2.0 * h);
                    let scale = difference.abs().max(0.1);
                    assert!((found[c].tangent[p] - difference).abs() < 1e-6 * scale, "direction {p}, channel {c}");
                }
            }
        }
    }
}

/// How far another adjoint is from the tape's, relative to the largest derivative.
fn off<R: Real>(volume: &Bricks<R::Lanes>, early_stop: f64, adjoint: Adjoint) -> f64 {
    let renderer = Preshaded::<R>::new(volume).early_stop(early_stop).over(BACKGROUND);
    let mut worst = 0.0_f64;
    for (i, ray) in rays(volume.world_bounds(), 8, 5).iter().enumerate() {
        let weights: [f64; 4] = std::array::from_fn(|c| signed(4 * i as u64 + c as u64));
        let [tape, other] = [Adjoint::Tape, adjoint].map(|adjoint| back(&renderer, ray, weights, adjoint));
        let lanes = |found: &Found<R>| found.values.iter().flat_map(|v| v.store().map(Real::f64)).collect::<Vec<_>>();
        let (a, b) = (lanes(&tape), lanes(&other));
        let largest = a.iter().fold(0.0_f64, |m, v| m.max(v.abs())).max(1e-3);
        for (a, b) in a.iter().zip(&b) {
            // What is not a number is as far as can be.
            let off = (a - b).abs() / largest;
            worst = if off.is_nan() { f64::INFINITY } else { worst.max(off) };
        }
        let turned = (tape.ray.direction - other.ray.direction).length();
        worst = worst.max(turned / tape.ray.direction.length().max(1e-3));
        assert_eq!(tape.background, other.background);
    }
    worst
}

/// Rays of several batches of bricks: replay walks all but the last again.
#[test]
fn tape_replay_and_inversion_agree() {
    for thick in [0.02, 0.3] {
        let (double, single) = (tinted::<f64>(100, thick, unit()), tinted::<f32>(100, thick, unit()));
        for adjoint in [Adjoint::Replay, Adjoint::Inversion] {
            assert!(off::<f64>(&double, 1e-6, adjoint) < 1e-9, "{thick} {adjoint:?}");
        }
        assert!(off::<f64>(&double, 0.0, Adjoint::Replay) < 1e-12, "{thick}");
        assert!(off::<f32>(&single, 1e-6, Adjoint::Replay) < 1e-5, "{thick}");
    }
}

/// Where nothing comes through, what was before cannot be told from what was behind; the other two do not ask.
#[test]
fn only_the_inversion_breaks_where_all_is_opaque() {
    let opaque = tinted::<f64>(20, 400.0, unit());
    assert!(off::<f64>(&opaque, 0.0, Adjoint::Replay) < 1e-12);
    assert!(off::<f64>(&opaque, 0.0, Adjoint::Inversion) > 1e-2);
    let opaque = tinted::<f32>(20, 60.0, unit());
    assert!(off::<f32>(&opaque, 0.0, Adjoint::Replay) < 1e-5);
    assert!(off::<f32>(&opaque, 0.0, Adjoint::Inversion) > 1e-2);
}

#[test]
fn what_misses_the_volume_sees_the_background() {
    let volume = tinted::<f64>(20, 1.0, unit());
    let renderer = Preshaded::<f64>::new(&volume).over(BACKGROUND);
    let ray = Ray::new(volume.world_bounds().max + 10.0, DVec3::X);
    let steps = steps::<f64>(&volume);
    let seen = renderer.jvp::<6>(&ray, &seeds(&steps), &mut Tape::default());
    assert_eq!(seen.pixel(), renderer.pixel_on(&ray, &mut Tape::default()));
    let by = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    assert_eq!(seen.rgb.map(|c| c.tangent), [0.3, 0.7, -1.1].map(|b| by.map(|by| by * b)));
    assert_eq!(seen.transmittance.tangent, [0.0; 6]);
}
