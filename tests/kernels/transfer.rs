//! Transfer functions: values against a fine sum, every gradient against central differences in f64, the
//! adjoints against one another.

use crate::common::fields::{assert_same, cloud, field, grid, kinds, lumps, noise, odd, rays, unit};
use crate::loss::{close, loss, slope};
use cumulo::math::{Aabb, Affine, Ray};
use cumulo::real::Real;
use cumulo::render::composited::Composited;
use cumulo::render::differentiable::{Accumulators, Adjoint, ParameterGradient, RayGradient};
use cumulo::render::dvr::{Dvr, Precision, TableJacobian, Tape};
use cumulo::render::quadrature::Quadrature;
use cumulo::scene::bricks::{BRICK, Bricks};
use cumulo::scene::medium::{Medium, Source};
use cumulo::scene::table::{Table, TableGradient};
use cumulo::scene::transfer::Transfer;
use glam::{DMat4, DVec3, DVec4};
use std::sync::Arc;

const BACKGROUND: [f32; 3] = [0.5, 0.25, 0.125];
const RULES: [Quadrature; 3] = [Quadrature::Exact, Quadrature::Midpoint(0.4), Quadrature::Riemann(0.7)];
/// All rules, pre-integration included.
const ALL_RULES: [Quadrature; 4] = [RULES[0], RULES[1], RULES[2], Quadrature::PREINTEGRATED];

fn medium(transfer: &Transfer, extinction: f64) -> Medium {
    Medium::new(extinction, Source::Transfer(Arc::new(transfer.table().unwrap())))
}

fn dvr<R: Real>(f: &Bricks<R>, medium: Medium, rule: Quadrature) -> Composited<Dvr<'_, R>> {
    let tolerance = if R::of(1.0 / 3.0).f64() == 1.0 / 3.0 { 1e-11 } else { 4e-7 };
    Dvr::new(f, medium).unwrap().quadrature(rule).tolerance(tolerance).early_stop(0.0).over(BACKGROUND)
}

fn total(f: &Bricks<f64>, medium: &Medium, rule: Quadrature, rays: &[Ray]) -> f64 {
    let dvr = dvr(f, medium.clone(), rule);
    rays.iter().map(|r| loss(&dvr.pixel(r))).sum()
}

/// Everything's gradient.
#[derive(Debug, Default, PartialEq)]
struct All<R> {
    voxels: Vec<R>,
    table: TableGradient,
    rays: Vec<RayGradient>,
    shared: ParameterGradient,
}

fn gradient<R: Precision>(f: &Bricks<R>, medium: &Medium, rule: Quadrature, adjoint: Adjoint, rays: &[Ray]) -> All<R> {
    let dvr = dvr(f, medium.clone(), rule);
    let Source::Transfer(table) = &medium.source else { unreachable!() };
    let mut all = All {
        voxels: vec![R::ZERO; f.values.len()],
        table: TableGradient::zeros(table),
        rays: Vec::new(),
        shared: ParameterGradient::default(),
    };
    let mut tape = Tape::default();
    for ray in rays {
        let mut moved = RayGradient::default();
        let sinks = Accumulators {
            voxels: Some(&mut all.voxels),
            table: Some(&mut all.table),
            ray: Some(&mut moved),
            shared: &mut all.shared,
        };
        dvr.vjp(ray, &mut slope, adjoint, sinks, &mut tape);
        all.rays.push(moved);
    }
    all
}

/// Central difference; from above only, to second order too, where less than zero would be a kink of the
/// function, or no function at all.
fn difference(value: f64, h: f64, mut at: impl FnMut(f64) -> f64) -> f64 {
    if value >= h {
        (at(value + h) - at(value - h)) / (2.0 * h)
    } else {
        (4.0 * at(value + h) - at(value + 2.0 * h) - 3.0 * at(value)) / (2.0 * h)
    }
}

/// The integral itself, by 40 000 midpoints of the interpolated density and the table's own look-up.
fn fine(f: &Bricks<f64>, medium: &Medium, ray: &Ray) -> [f64; 4] {
    let Source::Transfer(table) = &medium.source else { unreachable!() };
    let to_index = |p: DVec3| f.transform.to_index(p);
    let (o, d) = (to_index(ray.origin), f.transform.vector_to_index(ray.direction));
    let Some((enter, leave)) = f.domain.clip(&Ray::new(o, d)) else {
        return [BACKGROUND[0].into(), BACKGROUND[1].into(), BACKGROUND[2].into(), 0.0];
    };
    let (n, mut depth, mut rgb) = (40_000, 0.0_f64, [0.0; 3]);
    let h = (leave - enter) / f64::from(n);
    for i in 0..n {
        let value = table.at(f.sample(o + (enter + (f64::from(i) + 0.5) * h) * d));
        let x = medium.extinction * value[3] * h;
        for c in 0..3 {
            rgb[c] += (-depth).exp() * -(-x).exp_m1() * value[c];
        }
        depth += x;
    }
    let open = (-depth).exp();
    let rgb: [f64; 3] = std::array::from_fn(|c| rgb[c] + open * f64::from(BACKGROUND[c]));
    [rgb[0], rgb[1], rgb[2], 1.0 - open]
}

#[test]
fn exact_values_are_the_integral() {
    let wide: Bricks<f64> = cloud(20);
    let narrow: Bricks<f32> = cloud(20);
    let rays = rays(wide.world_bounds(), 12, 5);
    for transfer in kinds() {
        for extinction in [0.3, 3.0, 60.0] {
            let medium = medium(&transfer, extinction);
            for ray in &rays {
                let reference = fine(&wide, &medium, ray);
                let exact = dvr(&wide, medium.clone(), Quadrature::Exact).pixel(ray).rgba();
                let single = dvr(&narrow, medium.clone(), Quadrature::Exact).pixel(ray).rgba();
                for c in 0..4 {
                    // The fine sum's own error is about (h σ)² / 24 of the whole.
                    assert!((exact[c] - reference[c]).abs() < 2e-5, "{transfer:?} {exact:?} {reference:?}");
                    assert!((f64::from(single[c]) - exact[c]).abs() < 4e-6, "{transfer:?} {single:?} {exact:?}");
                }
            }
        }
    }
}

#[test]
fn every_gradient_matches_central_differences() {
    let mut f: Bricks<f64> = cloud(14);
    let rays = rays(f.world_bounds(), 25, 2);
    // Values jump by less than the tolerance where a segment begins to be divided: here none is.
    for rule in [RULES[0], RULES[1], RULES[2], Quadrature::Preintegrated(10.0)] {
        for transfer in kinds() {
            let table = transfer.table().unwrap();
            let medium = medium(&transfer, 0.8);
            let all = gradient(&f, &medium, rule, Adjoint::Tape, &rays);
            let whole = matches!(rule, Quadrature::Exact | Quadrature::Preintegrated(_));
            let h = if whole { 1e-5 } else { 1e-6 };
            // Uniform samples that step across a kink would make the difference another than the derivative: with these
            // rays and steps none does. Of h² times the third derivative and rounding of 1e-16 / h, relative to values
            // from 1e-3 on, either stays below 1e-6 where h is 1e-6; a factor of 20 is left for what curves more.
            let check = |what: String, got: f64, expected: f64| {
                close(&format!("{rule} {transfer:?} {what}"), got, expected, 2e-5, 1e-3);
            };
            let mut order: Vec<usize> = (0..f.values.len()).collect();
            order.sort_by(|a, b| all.voxels[*b].abs().total_cmp(&all.voxels[*a].abs()));
            for i in order.into_iter().step_by(61).take(40) {
                let keep = f.values[i];
                let on_face = [i % BRICK / 81, i % 81 / 9, i % 9].into_iter().any(|at| at == 0 || at == 8);
                // Of what is stored more than once one copy changes, and the field jumps from brick to brick: where it
                // is zero, to less than zero.
                if keep == 0.0 && on_face {
                    continue;
                }
                let difference = difference(keep, h, |value| {
                    f.values[i] = value;
                    total(&f, &medium, rule, &rays)
                });
                f.values[i] = keep;
                check(format!("voxel {i}"), all.voxels[i], difference);
            }
            let at = |m: Medium| total(&f, &m, rule, &rays);
            let mut scaled = [medium.clone(), medium.clone()];
            scaled[0].extinction += h;
            scaled[1].extinction -= h;
            let [up, down] = scaled.map(at);
            check("extinction".into(), all.shared.extinction, (up - down) / (2.0 * h));
            let parameters = transfer.parameters();
            for (i, (by, (name, value))) in transfer.chain(&all.table).unwrap().into_iter().zip(&parameters).enumerate()
            {
                let mut p: Vec<f64> = parameters.iter().map(|p| p.1).collect();
                let difference = difference(*value, h, |value| {
                    p[i] = value;
                    total(&f, &self::medium(&transfer.with_parameters(&p), 0.8), rule, &rays)
                });
                check(format!("{name} of {}", table.knots().len()), by, difference);
            }
            // Where each ray begins and goes, and the step.
            // A ray that touches a knot's isosurface has a derivative that is no Lipschitz function.
            let h = 1e-7;
            for (ray, got) in rays.iter().zip(&all.rays).take(12) {
                for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                    let at = |ray: Ray| total(&f, &medium, rule, &[ray]);
                    let origin = |h: f64| at(Ray { origin: ray.origin + h * axis, ..*ray });
                    check("origin".into(), got.origin.dot(axis), (origin(h) - origin(-h)) / (2.0 * h));
                    let turn = |h: f64| at(Ray { direction: (ray.direction + h * axis).normalize(), ..*ray });
                    let across = axis - ray.direction * ray.direction.dot(axis);
                    check("direction".into(), got.direction.dot(across), (turn(h) - turn(-h)) / (2.0 * h));
                }
            }
            let by_step: f64 = all.rays.iter().map(|r| r.step).sum();
            let stepped = |h: f64| match rule {
                Quadrature::Exact | Quadrature::Preintegrated(_) => rule,
                Quadrature::Midpoint(s) => Quadrature::Midpoint(s + h),
                Quadrature::Riemann(s) => Quadrature::Riemann(s + h),
            };
            let at = |h: f64| total(&f, &medium, stepped(h), &rays);
            check("step".into(), by_step, (at(1e-7) - at(-1e-7)) / 2e-7);
        }
    }
}

/// A field that is not zero where its domain ends, seen from outside and from within: entry and exit
/// move with the ray.
#[test]
fn entry_and_exit_move_with_the_ray() {
    let mut f: Bricks<f64> = field(16, unit(), |p| 0.5 + 0.02 * p.x + 0.01 * p.y * p.z / 16.0);
    f.domain = Aabb { min: DVec3::splat(0.0), max: DVec3::splat(15.0) };
    let mut rays = rays(f.world_bounds(), 20, 9);
    rays.push(Ray::new(DVec3::new(7.1, 6.4, 3.2), DVec3::new(0.3, 0.5, 0.8).normalize()));
    let transfer = Transfer::Piecewise { points: vec![[0.0, 1.0, 0.2, 0.1, 0.05], [1.0, 0.2, 0.8, 0.6, 0.4]] };
    let both = [Adjoint::Replay, Adjoint::Inversion];
    let mut ways: Vec<_> = RULES.into_iter().flat_map(|rule| both.map(|adjoint| (rule, adjoint, 0.5))).collect();
    // Thick stretches are cut where colors drift.
    let cut = [(0.002, 0.5), (0.1, 0.5), (0.1, 30.0)];
    ways.extend(cut.map(|(tolerance, thick)| (Quadrature::Preintegrated(tolerance), Adjoint::Replay, thick)));
    for (rule, adjoint, thick) in ways {
        let medium = medium(&transfer, thick);
        for (ray, got) in rays.iter().zip(&gradient(&f, &medium, rule, adjoint, &rays).rays) {
            for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                let at = |ray: Ray| total(&f, &medium, rule, &[ray]);
                let h = 1e-6;
                let origin = |h: f64| at(Ray { origin: ray.origin + h * axis, ..*ray });
                close("origin", got.origin.dot(axis), (origin(h) - origin(-h)) / (2.0 * h), 1e-5, 1e-3);
                let turn = |h: f64| at(Ray { direction: (ray.direction + h * axis).normalize(), ..*ray });
                let across = axis - ray.direction * ray.direction.dot(axis);
                close("direction", got.direction.dot(across), (turn(h) - turn(-h)) / (2.0 * h), 1e-5, 1e-3);
            }
        }
    }
}

#[test]
fn adjoints_agree() {
    let single: Bricks<f32> = cloud(20);
    let wide: Bricks<f64> = cloud(20);
    let rays = rays(wide.world_bounds(), 40, 4);
    for transfer in kinds() {
        for rule in ALL_RULES {
            let medium = medium(&transfer, 0.3);
            let tape = gradient(&single, &medium, rule, Adjoint::Tape, &rays);
            let replay = gradient(&single, &medium, rule, Adjoint::Replay, &rays);
            assert_eq!(tape.voxels, replay.voxels, "{transfer:?} {rule}");
            assert_eq!(tape.rays, replay.rays, "{transfer:?} {rule}");
            let (a, b) = (transfer.chain(&tape.table).unwrap(), transfer.chain(&replay.table).unwrap());
            assert_eq!(a, b);
            let replay = gradient(&wide, &medium, rule, Adjoint::Replay, &rays);
            if rule == Quadrature::PREINTEGRATED {
                let worst = replay.voxels.iter().zip(&tape.voxels).map(|(a, b)| (a - f64::from(*b)).abs());
                let scale = replay.voxels.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
                let worst = worst.fold(0.0, f64::max) / scale;
                // Which segments are divided is a matter of rounding where their bound is that allowed.
                assert!(worst < 5e-2, "{transfer:?} single precision: {worst:.1e}");
                let apart = |(a, b): (&RayGradient, &RayGradient)| (a.origin - b.origin).length();
                let worst = replay.rays.iter().zip(&tape.rays).map(apart).fold(0.0, f64::max);
                let scale = replay.rays.iter().fold(0.0_f64, |m, by| m.max(by.origin.length()));
                assert!(worst < 5e-2 * scale, "{transfer:?} single precision: rays off by {worst:.1e} of {scale:.1e}");
                continue;
            }
            let inversion = gradient(&wide, &medium, rule, Adjoint::Inversion, &rays);
            let scale = replay.voxels.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            for (a, b) in replay.voxels.iter().zip(&inversion.voxels) {
                assert!((a - b).abs() < 1e-9 * scale, "{transfer:?} {rule} {a} {b}");
            }
        }
    }
}

/// A world drawn at random: a field with noise, edges or constant parts, in a domain of its own; a function with steps,
/// clear bands and peaks, of which neither end need be clear; rays from all sides.
struct Draw {
    field: Bricks<f64>,
    narrow: Bricks<f32>,
    medium: Medium,
    rays: Vec<Ray>,
    seed: u64,
}

impl Draw {
    fn new(seed: u64) -> Self {
        let r = |k: u64| noise(seed.wrapping_mul(1 << 20).wrapping_add(k));
        let n = 6 + (r(0) * 16.0) as i32;
        let (kind, amplitude) = ((r(1) * 7.0) as usize, [0.0, 0.02, 0.3][(r(2) * 3.0) as usize]);
        let (offset, center) = (r(3), DVec3::new(r(4), r(5), r(6)) * f64::from(n));
        let smooth = lumps(n);
        let shape = |p: DVec3| match kind {
            0 => offset,
            1 => smooth(p),
            2 => f64::from((p - center).length() < 0.35 * f64::from(n)),
            3 => f64::from((p.x as i32 / 3 + p.y as i32 / 3 + p.z as i32 / 3) % 2),
            4 => 0.5 + 0.4 * (0.9 * p.x + offset).sin() * (0.7 * p.y).cos() * (0.5 * p.z + 1.0).sin(),
            5 => ((p - center).x * 0.04 + 0.5).clamp(0.0, 1.0),
            _ => smooth(p) - 0.3 + 0.1 * offset,
        };
        let voxel =
            |p: DVec3| noise(seed ^ ((p.x as u64) << 40 | (p.y as u64) << 20 | p.z as u64).wrapping_mul(31)) - 0.5;
        // A field without any brick is another matter.
        let value = |p: DVec3| if p == DVec3::ONE { 0.5 } else { (shape(p) + amplitude * voxel(p)).max(0.0) };
        let transform = if r(7) < 0.5 { unit() } else { odd() };
        let (mut field, mut narrow) = (field::<f64>(n, transform, value), field::<f32>(n, transform, value));
        if r(14) < 0.5 {
            // Not zero where the domain ends, as a grid of another background is.
            field.domain = Aabb { min: DVec3::ZERO, max: DVec3::splat(f64::from(n - 1)) };
            narrow.domain = field.domain;
        }
        let (field, narrow) = (field.filled(1 << 30).unwrap(), narrow.filled(1 << 30).unwrap());
        let count = 1 + (r(8) * r(8) * 30.0) as u64;
        let (first, range) = (0.6 * r(9) - 0.3, 0.2 + 1.2 * r(10));
        let mut knots: Vec<f64> = (0..count).map(|k| first + range * r(100 + k)).collect();
        knots.sort_by(f64::total_cmp);
        if count > 2 && r(11) < 0.3 {
            knots[1] = knots[0];
        }
        let one_color = r(12) < 0.4;
        let point = |k: u64| {
            let color = |c: u64| if one_color { 0.7 } else { 2.0 * r(1000 + 8 * k + c) };
            let extinction = if r(1004 + 8 * k) < 0.5 { 0.0 } else { r(1005 + 8 * k) };
            [color(0), color(1), color(2), extinction]
        };
        let table = Table::new(knots, (0..count).map(point).collect()).unwrap();
        let medium = Medium::new(10_f64.powf(3.0 * r(13) - 1.0), Source::Transfer(Arc::new(table)));
        let rays = rays(field.world_bounds(), 8, seed);
        Self { field, narrow, medium, rays, seed }
    }

    /// True if the function has a step.
    fn steps(&self) -> bool {
        let Source::Transfer(table) = &self.medium.source else { unreachable!() };
        table.knots().windows(2).any(|knots| knots[0] == knots[1])
    }

    /// Radiance that errors of red, green and blue are measured by; the alpha's are absolute.
    fn brightest(&self) -> f64 {
        let Source::Transfer(table) = &self.medium.source else { unreachable!() };
        table.peak()[..3].iter().fold(f64::from(BACKGROUND[0]), |m, v| m.max(*v))
    }
}

/// Draws by `TRANSFER_DRAWS`: `TRANSFER_DRAWS=1000 cargo test --release --test kernels transfer::`.
fn draws(usual: u64) -> impl Iterator<Item = Draw> {
    let count = std::env::var("TRANSFER_DRAWS").ok().and_then(|v| v.parse().ok()).unwrap_or(usual);
    (0..count).map(|i| Draw::new(20_261_125 + i))
}

/// Light of the rules with a step by the plainest of loops, over the interpolated density.
fn plain_steps(f: &Bricks<f64>, medium: &Medium, ray: &Ray, step: f64, phase: f64) -> [f64; 4] {
    let Source::Transfer(table) = &medium.source else { unreachable!() };
    let (o, d) = (f.transform.to_index(ray.origin), f.transform.vector_to_index(ray.direction));
    let (mut rgb, mut depth) = ([0.0; 3], 0.0_f64);
    if let Some((enter, leave)) = f.domain.clip(&Ray::new(o, d)) {
        let h = step * f.transform.voxel_size().min_element();
        let count = ((leave - enter) / h).ceil() as i64;
        for k in 0..count {
            let begin = enter + k as f64 * h;
            let length = h.min(leave - begin);
            let value = table.at(f.sample(o + (begin + phase * length) * d));
            let x = medium.extinction * value[3] * length;
            (0..3).for_each(|c| rgb[c] += (-depth).exp() * -(-x).exp_m1() * value[c]);
            depth += x;
        }
    }
    let through = (-depth).exp();
    let rgb: [f64; 3] = std::array::from_fn(|c| rgb[c] + through * f64::from(BACKGROUND[c]));
    [rgb[0], rgb[1], rgb[2], 1.0 - through]
}

/// What each rule states of its error holds on every ray of every draw; the rules with a step, which state nothing, are
/// what they say they are.
#[test]
fn stated_errors_hold_for_random_functions_of_random_fields() {
    let mut largest = [0.0_f64; 4];
    for draw in draws(60) {
        let brightest = draw.brightest();
        let off = |a: [f64; 4], b: [f64; 4]| {
            let of = |c: usize| (a[c] - b[c]).abs() / if c < 3 { brightest.max(1e-9) } else { 1.0 };
            of(0).max(of(1)).max(of(2)).max(of(3))
        };
        let tolerance = 10_f64.powf(-1.5 - 2.5 * noise(draw.seed));
        for ray in &draw.rays {
            let exact = dvr(&draw.field, draw.medium.clone(), Quadrature::Exact).pixel(ray).rgba();
            let single = |rule| {
                let dvr = Dvr::new(&draw.narrow, draw.medium.clone()).unwrap().quadrature(rule).over(BACKGROUND);
                dvr.pixel(ray).rgba().map(f64::from)
            };
            let rules = [
                (Quadrature::Exact, 0.0),
                (Quadrature::PREINTEGRATED, 1e-2),
                (Quadrature::Preintegrated(tolerance), tolerance),
            ];
            for (k, (rule, stated)) in rules.into_iter().enumerate() {
                let error = off(single(rule), exact);
                // Single precision, the early stop's 1e-6, and exact quadrature's 4e-7 a piece.
                let rest = 4e-5;
                assert!(error <= stated + rest, "draw {}, {rule}: {error:.1e}, {:?}", draw.seed, draw.medium);
                largest[k] = largest[k].max(error / if k == 0 { 1.0 } else { stated });
            }
            if draw.seed % 8 == 0 {
                let error = off(exact, fine(&draw.field, &draw.medium, ray));
                assert!(error < 1e-3, "draw {}: {error:.1e} off a fine sum, {:?}", draw.seed, draw.medium);
                largest[3] = largest[3].max(error);
            }
            for (rule, step, phase) in [(Quadrature::Midpoint(0.3), 0.3, 0.5), (Quadrature::Riemann(0.6), 0.6, 0.0)] {
                let seen = dvr(&draw.field, draw.medium.clone(), rule).pixel(ray).rgba();
                let plain = plain_steps(&draw.field, &draw.medium, ray, step, phase);
                let error = off(seen, plain);
                assert!(error < 1e-9, "draw {}, {rule}: {error:.1e}", draw.seed);
                let error = off(single(rule), plain);
                // A sample beside a step of the function may end on its other side.
                assert!(error < 4e-5 || draw.steps(), "draw {}, {rule} in f32: {error:.1e}", draw.seed);
            }
        }
    }
    println!(
        "largest errors: exact {:.1e}; of what is allowed {:.2}, {:.2}; a fine sum {:.1e}",
        largest[0], largest[1], largest[2], largest[3]
    );
}

/// Steps through what is the background in many bricks are taken together, and those through clear ones not at all: light
/// is that of every step, of rays along the faces of bricks and from within, too.
#[test]
fn steps_through_the_background_are_those_of_every_step() {
    let ball = |p: DVec3| (1.0 - (p - 29.0).length() / 9.0).max(0.0) + (1.0 - (p - 55.0).length() / 5.0).max(0.0);
    let mut wide = field::<f64>(64, unit(), ball);
    wide.domain = Aabb { min: DVec3::splat(1.5), max: DVec3::new(61.0, 64.0, 63.0) };
    let wide = wide.filled(1 << 30).unwrap();
    let mut narrow = field::<f32>(64, unit(), ball);
    narrow.domain = wide.domain;
    let narrow = narrow.filled(1 << 30).unwrap();
    let mut seen = rays(wide.world_bounds(), 60, 9);
    for at in [8.0, 16.0, 24.0, 64.0, 31.3] {
        for axis in [DVec3::X, DVec3::Y, DVec3::Z, -DVec3::X, -DVec3::Y, -DVec3::Z] {
            let across = DVec3::splat(at) * (DVec3::ONE - axis.abs());
            seen.push(Ray::new(across + axis * -100.0 * axis.element_sum(), axis));
            seen.push(Ray::new(across + axis.abs() * 28.7, axis));
        }
    }
    let points =
        |outside: f64| vec![[0.0, 0.2, 0.4, 0.1, outside], [0.3, 1.0, 0.5, 0.0, 0.02], [1.0, 0.0, 1.0, 2.0, 0.4]];
    for outside in [0.0, 1e-4, 0.05] {
        let medium = medium(&Transfer::Piecewise { points: points(outside) }, 1.0);
        for (rule, step, phase) in [0.05, 0.7, 3.0, 40.0, 500.0]
            .into_iter()
            .flat_map(|s| [(Quadrature::Midpoint(s), s, 0.5), (Quadrature::Riemann(s), s, 0.0)])
        {
            let (by_double, by_single) = (dvr(&wide, medium.clone(), rule), dvr(&narrow, medium.clone(), rule));
            for ray in &seen {
                let plain = plain_steps(&wide, &medium, ray, step, phase);
                let off = |rgba: [f64; 4]| (0..4).map(|c| (rgba[c] - plain[c]).abs()).fold(0.0, f64::max);
                let double = off(by_double.pixel(ray).rgba());
                assert!(double < 1e-9, "{outside}, {rule}, {ray:?}: {double:.1e}");
                let single = off(by_single.pixel(ray).rgba().map(f64::from));
                assert!(single < 4e-5, "{outside}, {rule}, {ray:?}: {single:.1e} in f32");
            }
        }
    }
}

/// The first sample of a rule that samples where steps begin lies on a face of the box, beyond which there are no bricks;
/// all that follows is background.
#[test]
fn steps_begin_on_the_faces_of_a_sparse_volume() {
    let corners = |p: DVec3| f64::from(u8::from(p == DVec3::ZERO || p == DVec3::splat(47.0)));
    let affine = Affine::new(DMat4::from_cols(
        DVec4::new(1.1, 0.0, 0.0, 0.0),
        DVec4::new(0.0, 1.4, 0.0, 0.0),
        DVec4::new(0.0, 0.0, 0.7, 0.0),
        DVec4::new(3.0, -2.0, 0.3, 1.0),
    ));
    let mut sparse = grid(48, affine.unwrap(), corners);
    sparse.leaves.retain(|leaf| leaf.values.iter().any(|v| *v != 0.0));
    let mut wide = Bricks::<f64>::from_grid(&sparse, 1 << 30).unwrap();
    wide.domain = Aabb { min: DVec3::ZERO, max: DVec3::splat(47.0) };
    let wide = wide.filled(1 << 30).unwrap();
    let points = vec![[0.0, 1.0, 0.5, 0.25, 0.03], [2.0, 1.0, 0.5, 0.25, 0.03]];
    let medium = medium(&Transfer::Piecewise { points }, 1.0);
    let eye = DVec3::new(-60.0, -50.0, -70.0);
    let bounds = wide.world_bounds();
    let towards =
        |i: u64| bounds.min + (bounds.max - bounds.min) * DVec3::new(noise(3 * i), noise(3 * i + 1), noise(3 * i + 2));
    let seen: Vec<Ray> = (0..300).map(|i| Ray::new(eye, (towards(i) - eye).normalize())).collect();
    for (rule, step, phase) in [0.1, 3.0, 1000.0]
        .into_iter()
        .flat_map(|s| [(Quadrature::Midpoint(s), s, 0.5), (Quadrature::Riemann(s), s, 0.0)])
    {
        let by_double = dvr(&wide, medium.clone(), rule);
        for ray in &seen {
            let plain = plain_steps(&wide, &medium, ray, step, phase);
            let seen = by_double.pixel(ray).rgba();
            let off = (0..4).map(|c| (seen[c] - plain[c]).abs()).fold(0.0, f64::max);
            assert!(off < 1e-9, "{rule}, {ray:?}: {off:.1e}");
        }
    }
}

/// What pre-integration states holds where the background lies within a narrow part of the function, in front of an
/// edge: gaps between bricks hold nothing but the background, however small the error that is allowed.
#[test]
fn stated_errors_hold_in_front_of_edges() {
    let cube = |p: DVec3| if p.cmpge(DVec3::splat(8.0)).all() && p.cmplt(DVec3::splat(24.0)).all() { 0.9 } else { 0.0 };
    let (wide, narrow) = (boxed_of::<f64>(40, cube), boxed_of::<f32>(40, cube));
    let mut seen = rays(wide.world_bounds(), 60, 8);
    seen.extend((0..12).map(|i| Ray::new(DVec3::new(9.3 + f64::from(i), 11.7, 90.0), DVec3::NEG_Z)));
    for width in [5e-3, 1.3e-3, 3e-4] {
        let points = vec![[-width, 0.0, 1.0, 0.0, 0.18], [width, 0.0, 0.0, 1.0, 0.06]];
        let medium = medium(&Transfer::Piecewise { points }, 1.0);
        for tolerance in [1e-1, 1e-2, 1e-3, 1e-4, 1e-5] {
            let rendered = dvr(&narrow, medium.clone(), Quadrature::Preintegrated(tolerance));
            for ray in &seen {
                let exact = dvr(&wide, medium.clone(), Quadrature::Exact).pixel(ray).rgba();
                let seen = rendered.pixel(ray).rgba().map(f64::from);
                let error = (0..4).map(|c| (seen[c] - exact[c]).abs()).fold(0.0, f64::max);
                // Single precision of a place moves a density within the narrow part.
                assert!(error < tolerance + 1e-3, "{width}, {tolerance}: {seen:?} for {exact:?}");
            }
        }
    }
}

/// What pre-integration states holds where rounding and points of the function meet: densities that lie at its last
/// point with dips below them, as in clipped data, and zeros beside densities far larger than all points.
#[test]
fn stated_errors_hold_at_the_ends_of_functions() {
    let clipped = even(41, [0.0, 1.0], |k| [1.0, 1.0, 1.0, if k == 40 { 0.0 } else { 2.0 + (k % 2) as f64 }]);
    let steep = even(64, [0.0, 6.3e-4], |k| [1.0, 1.0, 0.5, if k == 0 { 0.0 } else { 0.2 }]);
    let dipped = |p: DVec3| if p == DVec3::splat(5.0) { 0.5 } else { 1.0 };
    let slabs = |p: DVec3| if p.x as i32 / 2 % 2 == 0 { 1000.0 + 1000.0 * voxel_noise(p) } else { 0.0 };
    let cases: [(Source, &dyn Fn(DVec3) -> f64); 2] = [(clipped, &dipped), (steep, &slabs)];
    for (source, value) in cases {
        let (wide, narrow) = (boxed::<f64>(value), boxed::<f32>(value));
        let medium = Medium::new(1.0, source);
        for tolerance in [1e-1, 1e-2, 1e-3] {
            let rule = Quadrature::Preintegrated(tolerance);
            let rendered = dvr(&narrow, medium.clone(), rule);
            for ray in rays(wide.world_bounds(), 200, 3) {
                let exact = dvr(&wide, medium.clone(), Quadrature::Exact).pixel(&ray).rgba();
                let seen = rendered.pixel(&ray).rgba().map(f64::from);
                let error = (0..4).map(|c| (seen[c] - exact[c]).abs()).fold(0.0, f64::max);
                assert!(error < tolerance, "{rule}: {seen:?} for {exact:?}, {:?}", medium.source);
            }
        }
    }
}

/// Exact quadrature extrapolates no color, where points lie so close that rounding puts densities beyond them.
#[test]
fn light_lies_between_the_colors() {
    let opposed = even(64, [0.739, 0.7406], |k| [(k % 2) as f64, 0.0, (1 - k % 2) as f64, 200.0]);
    let narrow = boxed::<f32>(|p| 0.74 + 1e-4 * voxel_noise(p));
    let rendered = dvr(&narrow, Medium::new(1.0, opposed), Quadrature::Exact);
    for ray in rays(narrow.world_bounds(), 400, 3) {
        let seen = rendered.pixel(&ray).rgba();
        assert!(seen.iter().all(|v| (-1e-6..1.0 + 1e-6).contains(v)), "{seen:?}");
    }
}

/// A function of evenly spaced points.
fn even(count: usize, [first, last]: [f64; 2], value: impl Fn(usize) -> [f64; 4]) -> Source {
    let knots = (0..count).map(|k| first + (last - first) * k as f64 / (count - 1) as f64).collect();
    Source::Transfer(Arc::new(Table::new(knots, (0..count).map(value).collect()).unwrap()))
}

/// A field of 12³ voxels that ends at its outermost voxels.
fn boxed<R: Real>(value: impl Fn(DVec3) -> f64) -> Bricks<R> {
    boxed_of(12, value)
}

/// A field of as many voxels along each edge that ends at its outermost voxels.
fn boxed_of<R: Real>(edge: i32, value: impl Fn(DVec3) -> f64) -> Bricks<R> {
    let mut field = field::<R>(edge, unit(), value);
    field.domain = Aabb { min: DVec3::ZERO, max: DVec3::splat(f64::from(edge - 1)) };
    field.filled(1 << 30).unwrap()
}

fn voxel_noise(p: DVec3) -> f64 {
    noise((p.x * 400.0 + p.y * 20.0 + p.z) as u64)
}

/// Gradients are those of the computed value, for every rule on every draw, where the value is smooth: two central
/// differences of different widths agree. (At a knot, and where pre-integration begins to divide a segment, none is.)
#[test]
fn gradients_are_those_of_random_draws() {
    let (mut checked, mut kinks) = (0, 0);
    for mut draw in draws(40) {
        // Nothing is quite constant: where it is, any change makes pre-integration look closer.
        for (i, v) in draw.field.values.iter_mut().enumerate() {
            *v += 1e-3 * noise(i as u64);
        }
        for rule in ALL_RULES {
            let ray = [draw.rays[0]];
            let all = gradient(&draw.field, &draw.medium, rule, Adjoint::Tape, &ray);
            let mut check = |what: &str, got: f64, at: &mut dyn FnMut(f64) -> f64| {
                let mut difference = |h: f64| (at(h) - at(-h)) / (2.0 * h);
                let (wide, narrow) = (difference(2e-6), difference(7e-7));
                let size = wide.abs().max(got.abs()).max(1e-3);
                if (wide - narrow).abs() > 1e-4 * size {
                    kinks += 1;
                } else {
                    checked += 1;
                    let error = (got - wide).abs() / size;
                    assert!(
                        error < 1e-3,
                        "draw {}, {rule}, {what}: {got} against {wide}, {:?}",
                        draw.seed,
                        draw.medium
                    );
                }
            };
            let mut order: Vec<usize> = (0..draw.field.values.len()).collect();
            order.sort_by(|a, b| all.voxels[*b].abs().total_cmp(&all.voxels[*a].abs()));
            for i in order.into_iter().take(3).filter(|i| all.voxels[*i] != 0.0) {
                let keep = draw.field.values[i];
                check("voxel", all.voxels[i], &mut |h| {
                    draw.field.values[i] = keep + h;
                    total(&draw.field, &draw.medium, rule, &ray)
                });
                draw.field.values[i] = keep;
            }
            check("extinction", all.shared.extinction, &mut |h| {
                let medium = Medium { extinction: draw.medium.extinction + h, ..draw.medium.clone() };
                total(&draw.field, &medium, rule, &ray)
            });
        }
    }
    println!("{checked} derivatives hold, {kinks} are of kinks");
    assert!(checked > 4 * kinks, "{checked} {kinks}");
}

/// A tolerance is paid for: a thousandth of it brings less than half of the error, where the density is smooth.
#[test]
fn what_is_tolerated_is_what_is_lost() {
    let round = |p: DVec3| (-(p - DVec3::splat(31.5)).length_squared() / 260.0).exp();
    let smooth: Bricks<f64> = field(64, unit(), |p| (round(p) - 1e-3).max(0.0));
    let smooth = smooth.filled(u64::MAX).unwrap();
    let rays = rays(smooth.world_bounds(), 100, 9);
    for transfer in kinds() {
        let worst = |rule| {
            let off = |ray: &Ray| {
                let [exact, seen] =
                    [Quadrature::Exact, rule].map(|rule| dvr(&smooth, medium(&transfer, 0.2), rule).pixel(ray).rgba());
                (0..4).map(|c| (exact[c] - seen[c]).abs()).fold(0.0, f64::max)
            };
            rays.iter().map(off).fold(0.0, f64::max)
        };
        let [coarse, fine] = [1.0, 1e-3].map(|tolerance| worst(Quadrature::Preintegrated(tolerance)));
        assert!(coarse < 1.0 && fine < 1e-3 && fine < 0.5 * coarse, "{transfer:?} {coarse:.1e} {fine:.1e}");
    }
}

/// A volume of one density where the function is clear, and opaque at density 0, is clear everywhere.
#[test]
fn clear_bricks_are_no_gaps_of_density_zero() {
    let points = vec![
        [0.0, 0.0, 0.0, 1.0, 12.0],
        [0.2, 0.0, 0.0, 1.0, 12.0],
        [0.25, 0.0, 0.0, 1.0, 0.0],
        [1.0, 1.0, 0.0, 0.0, 0.0],
    ];
    let medium = medium(&Transfer::Piecewise { points }, 1.0);
    let mut half: Bricks<f32> = field(32, unit(), |_| 0.5).filled(1 << 30).unwrap();
    half.domain = Aabb { min: DVec3::ZERO, max: DVec3::splat(31.0) };
    for ray in rays(half.world_bounds(), 200, 3) {
        let dvr = Dvr::new(&half, medium.clone()).unwrap().quadrature(Quadrature::PREINTEGRATED);
        let exact = dvr.clone().quadrature(Quadrature::Exact);
        assert_eq!(exact.radiance(&ray).depth, 0.0);
        assert_eq!(dvr.radiance(&ray).depth, 0.0);
    }
}

/// A density that is a point of the function up to rounding, at the foot of a steep slope, is as clear as the point: no rule
/// follows the slope below zero.
#[test]
fn slopes_end_at_their_points() {
    for (value, peak) in [(0.7, 3000.0), (0.3, 3000.0), (0.7, 80.0)] {
        let points = vec![
            [0.0, 0.0, 0.0, 0.0, 0.0],
            [0.3, 1.0, 0.0, 0.0, 0.0],
            [0.301, 0.0, 1.0, 0.0, 0.25 * peak],
            [0.302, 0.0, 0.0, 1.0, 0.0],
            [0.7, 1.0, 1.0, 1.0, 0.0],
            [0.7001, 1.0, 1.0, 0.0, peak],
            [0.7002, 1.0, 0.0, 1.0, 0.0],
            [1.0, 1.0, 1.0, 1.0, 0.0],
        ];
        let medium = medium(&Transfer::Piecewise { points }, 1.0);
        for density in [value, value + 1e-4, value + 2e-4] {
            let mut constant: Bricks<f32> = field(16, unit(), |_| density);
            constant.domain = Aabb { min: DVec3::ZERO, max: DVec3::splat(15.0) };
            for ray in rays(constant.world_bounds(), 50, 3) {
                let exact = Dvr::new(&constant, medium.clone()).unwrap().quadrature(Quadrature::Exact);
                let [rgb, depth] = [exact.radiance(&ray).rgb, [exact.radiance(&ray).depth; 3]];
                assert!(rgb.iter().chain(&depth).all(|v| *v >= 0.0), "exact, {density}: {rgb:?} {depth:?}");
                for tolerance in [0.1, 0.01, 0.001] {
                    let found = exact.clone().quadrature(Quadrature::Preintegrated(tolerance)).radiance(&ray);
                    assert!(
                        found.rgb.iter().all(|v| *v >= -1e-6) && found.depth >= 0.0,
                        "{density}: {found:?} by {tolerance}"
                    );
                    let apart = found.rgb.iter().zip(rgb).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                    assert!(apart < tolerance, "{density} by {tolerance}: {found:?}, and {rgb:?}");
                }
            }
        }
    }
}

/// Where the density is linear, depths have no error, however far apart the nodes are; voxels are rounded to single
/// precision.
#[test]
fn preintegrated_depths_of_linear_densities_are_exact() {
    let identity = Transfer::Identity { domain: [0.0, 5.0], color: [0.3, 0.6, 0.9] };
    let mut linear: Bricks<f64> = field(16, unit(), |p| 0.2 + 0.1 * p.x + 0.05 * p.y + 0.02 * p.z);
    linear.domain = Aabb { min: DVec3::ZERO, max: DVec3::splat(15.0) };
    let depth = |f: &Bricks<f64>, rule, ray: &Ray| dvr(f, medium(&identity, 0.7), rule).medium.optical_depth(ray);
    for ray in rays(linear.world_bounds(), 30, 8) {
        let both = [Quadrature::PREINTEGRATED, Quadrature::Exact].map(|rule| depth(&linear, rule, &ray));
        close("depth", both[0], both[1], 1e-7, 1e-3);
    }
}

/// Constant densities have a closed form: `L = c (1 - e^{-σ l}) + e^{-σ l} · background`, for the faintest and the most
/// opaque, on knots and between them, in both precisions.
#[test]
fn preintegrated_slabs_have_their_closed_form() {
    fn seen<R: Precision>(density: f64, medium: &Medium) -> [f64; 4] {
        let mut f: Bricks<R> = field(24, unit(), |_| density);
        f.domain = Aabb { min: DVec3::splat(3.0), max: DVec3::splat(19.0) };
        let ray = Ray::new(DVec3::new(-3.0, 7.3, 6.8), DVec3::X);
        dvr(&f, medium.clone(), Quadrature::PREINTEGRATED).pixel(&ray).rgba().map(Real::f64)
    }
    let step = Transfer::Piecewise {
        points: vec![
            [0.2, 1.0, 0.5, 0.0, 1.0],
            [0.5, 0.8, 0.4, 0.2, 2.0],
            [0.5, 0.1, 0.2, 0.3, 3.0],
            [0.9, 0.0, 0.0, 1.0, 4.0],
        ],
    };
    let one = Transfer::Piecewise { points: vec![[0.4, 0.3, 0.6, 0.9, 1.5]] };
    for transfer in [step, one] {
        for density in [0.0625, 0.25, 0.5, 0.75, 2.0, 1e30] {
            for extinction in [1e-8, 1e-3, 0.1, 1e6] {
                let medium = medium(&transfer, extinction);
                let Source::Transfer(table) = &medium.source else { unreachable!() };
                let value = table.at(density);
                let open = (-16.0 * extinction * value[3]).exp();
                for (got, tolerance) in [(seen::<f64>(density, &medium), 1e-12), (seen::<f32>(density, &medium), 1e-6)]
                {
                    for c in 0..3 {
                        let expected = value[c] * (1.0 - open) + open * f64::from(BACKGROUND[c]);
                        assert!((got[c] - expected).abs() < tolerance, "{density} {extinction}: {got:?} {expected}");
                    }
                    assert!((got[3] - (1.0 - open)).abs() < tolerance, "{density} {extinction}: {got:?} {open}");
                }
            }
        }
    }
}

/// The largest densities that are taken, beside small ones: a picture has no colors that nothing has.
#[test]
fn densities_as_large_as_they_may_be() {
    let f: Bricks<f32> = field(16, unit(), |p| if (p.x + p.y) as i32 % 3 == 0 { 1e30 } else { 0.4 * p.z / 15.0 });
    for transfer in kinds() {
        for rule in ALL_RULES {
            // Where one of them absorbs at density 0 the field has to be filled.
            let filled = f.clone().filled(1 << 30).unwrap();
            let dvr = Dvr::new(&filled, medium(&transfer, 0.3)).unwrap().quadrature(rule).over(BACKGROUND);
            let table = transfer.table().unwrap();
            // A picture is a mean of the function's colors and the background, rounded.
            let colors = |c: usize| table.values().iter().map(move |v| v[c]).chain([f64::from(BACKGROUND[c])]);
            for ray in rays(f.world_bounds(), 20, 3) {
                let seen = dvr.pixel(&ray);
                assert!((0.0..=1.0).contains(&seen.transmittance), "{rule} {transfer:?} {seen:?}");
                for c in 0..3 {
                    let (low, high) = colors(c).fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
                    let value = f64::from(seen.rgb[c]);
                    let inside = (low - 1e-5..=high + 1e-5).contains(&value);
                    assert!(inside, "{rule} {transfer:?} {ray:?}: {seen:?}, channel {c} of {low}..{high}");
                }
            }
        }
    }
}

/// A thin opaque shell that samples miss, and a spike narrower than any cell's range of densities.
#[test]
fn nothing_is_missed_between_samples() {
    let f: Bricks<f64> = field(16, unit(), |p| p.x / 15.0);
    let ray = Ray::new(DVec3::new(-3.0, 7.3, 6.8), DVec3::X);
    let spike = |width: f64| Transfer::Piecewise {
        points: vec![
            [0.5 - width, 1.0, 1.0, 1.0, 0.0],
            [0.5, 1.0, 1.0, 1.0, 2.0 / width],
            [0.5 + width, 1.0, 1.0, 1.0, 0.0],
        ],
    };
    for width in [1e-1, 1e-3, 1e-6] {
        // Its area in density is 2; a unit of density is 15 units of length; then a lone voxel's fade.
        let seen = dvr(&f, medium(&spike(width), 0.1), Quadrature::Exact).medium.optical_depth(&ray);
        let expected = 0.1 * 2.0 * 15.0 + 0.1 * 2.0;
        close("depth", seen, expected, 1e-6, 1.0);
    }
}

/// One walk for all channels gives what the gradient gives in four, each of one channel alone; weights add up.
#[test]
fn the_jacobian_by_table_holds_the_gradients_of_all_channels() {
    let f: Bricks<f64> = cloud(12);
    let rays = rays(f.world_bounds(), 8, 3);
    for transfer in kinds() {
        let medium = medium(&transfer, 3.0);
        let Source::Transfer(table) = &medium.source else { unreachable!() };
        for rule in ALL_RULES {
            let dvr = dvr(&f, medium.clone(), rule);
            let mut tape = Tape::default();
            let mut jacobian = TableJacobian::zeros(table.knots().len());
            let mut expected: [TableGradient; 4] = std::array::from_fn(|_| TableGradient::zeros(table));
            for (weight, ray) in (1..).map(|k| 0.5 * f64::from(k)).zip(&rays) {
                let seen = dvr.table_jacobian(ray, weight, &mut jacobian, &mut tape);
                // The value of the Jacobian is the value.
                assert_same(rule, seen, dvr.pixel(ray));
                for (channel, table) in expected.iter_mut().enumerate() {
                    let mut only = [0.0; 4];
                    only[channel] = weight;
                    let shared = &mut ParameterGradient::default();
                    let sinks = Accumulators { voxels: None, table: Some(table), ray: None, shared };
                    dvr.vjp(ray, &mut |_| only, Adjoint::Tape, sinks, &mut tape);
                }
            }
            let expected = expected.map(|table| table.by_value());
            for (knot, by) in jacobian.by_knot().iter().enumerate() {
                for (c, expected) in expected.iter().enumerate() {
                    let what = format!("{transfer:?} {rule:?} knot {knot}, channel {c}");
                    close(&what, by.extinction[c], expected[knot][3], 1e-9, 1e-6);
                    if c < 3 {
                        close(&what, by.color, expected[knot][c], 1e-9, 1e-6);
                    }
                }
            }
            jacobian.forget();
            assert!(jacobian.by_knot().iter().all(|by| by.is_none()), "nothing is left");
        }
    }
}

/// Rays of more nodes than replay keeps: it walks again, and finds the same.
#[test]
fn replay_of_long_rays_is_the_tape() {
    let f: Bricks<f64> = field(120, unit(), |p| 0.5 + 0.4 * (0.9 * p.x).sin() * (0.7 * p.y).cos() * (0.8 * p.z).sin());
    let mut rays = rays(f.world_bounds(), 5, 9);
    // From corner to corner: some four hundred nodes.
    let (corner, along) = (f.world_bounds().min, f.world_bounds().size().normalize());
    rays.push(Ray::new(corner - 5.0 * along, along));
    let transfer = kinds().swap_remove(0);
    let medium = medium(&transfer, 0.01);
    let by = |adjoint| gradient(&f, &medium, Quadrature::PREINTEGRATED, adjoint, &rays);
    let (tape, replay) = (by(Adjoint::Tape), by(Adjoint::Replay));
    let touched = |voxels: &[f64]| voxels.iter().filter(|v| **v != 0.0).count();
    assert!(touched(&tape.voxels) > 6 * 200, "rays are long");
    assert!(tape == replay);
    // The longest one again, ending behind what replay keeps.
    let ray = rays[rays.len() - 1];
    let depth = dvr(&f, medium.clone(), Quadrature::PREINTEGRATED).medium.optical_depth(&ray);
    let by = |adjoint, depth: f64| {
        let dvr = dvr(&f, medium.clone(), Quadrature::PREINTEGRATED).with(|dvr| dvr.early_stop((-depth).exp()));
        let (mut voxels, mut shared) = (vec![0.0; f.values.len()], ParameterGradient::default());
        let sinks = Accumulators { voxels: Some(&mut voxels), table: None, ray: None, shared: &mut shared };
        dvr.vjp(&ray, &mut slope, adjoint, sinks, &mut Tape::default());
        (voxels, shared)
    };
    let (tape, replay, whole) =
        (by(Adjoint::Tape, 0.8 * depth), by(Adjoint::Replay, 0.8 * depth), by(Adjoint::Tape, 2.0 * depth));
    let (part, whole) = (touched(&tape.0), touched(&whole.0));
    // The depth grows evenly but for waves of 7 to 9 voxels, a twentieth of the ray's 208: four fifths of the depth are
    // four fifths of the way to within a tenth. Replay keeps half of its nodes, and ends behind these.
    assert!((7 * whole..9 * whole).contains(&(10 * part)), "{part} of {whole}");
    assert!(tape == replay);
}

/// A step of the function, met where the density is a ramp: light has a closed form, and so have its derivatives by the
/// step's density, by all voxels at once, and by where the ray begins.
#[test]
fn steps_have_their_closed_form() {
    const RISE: f64 = 1.0 / 32.0;
    fn check<R: Precision>(rule: Quadrature, [value, derivative]: [f64; 2]) {
        let mut f: Bricks<R> = field(24, unit(), |p| RISE * p.x);
        f.domain = Aabb { min: DVec3::ZERO, max: DVec3::splat(23.0) };
        let (below, above) = ([1.0, 0.5, 0.0, 0.05], [0.0, 0.25, 1.0, 0.2]);
        let point = |[r, g, b, s]: [f64; 4]| [0.4, r, g, b, s];
        let medium = medium(&Transfer::Piecewise { points: vec![point(below), point(above)] }, 1.0);
        let Source::Transfer(table) = &medium.source else { unreachable!() };
        let ray = Ray::new(DVec3::new(-2.0, 7.3, 6.8), DVec3::X);
        let (met, length) = (0.4 / RISE, 23.0);
        let (near, far) = ((-below[3] * met).exp(), (-above[3] * (length - met)).exp());
        let dvr = dvr(&f, medium.clone(), rule);
        for c in 0..3 {
            let behind = above[c] * (1.0 - far) + far * f64::from(BACKGROUND[c]);
            let light = below[c] * (1.0 - near) + near * behind;
            // By the length at which the step is met.
            let expected =
                near * below[3] * (below[c] - behind) - near * far * above[3] * (above[c] - f64::from(BACKGROUND[c]));
            let mut voxels = vec![R::ZERO; f.values.len()];
            let (mut by, mut moved, mut shared) =
                (TableGradient::zeros(table), RayGradient::default(), ParameterGradient::default());
            let sinks = Accumulators {
                voxels: Some(&mut voxels),
                table: Some(&mut by),
                ray: Some(&mut moved),
                shared: &mut shared,
            };
            let mut weight = [R::ZERO; 4];
            weight[c] = R::ONE;
            let seen = dvr.vjp(&ray, &mut |_| weight, Adjoint::Tape, sinks, &mut Tape::default());
            let close = |what: &str, got: f64, expected: f64| {
                let tolerance = if what == "light" { value } else { derivative };
                assert!((got - expected).abs() < tolerance, "{rule} {c} {what}: {got} {expected}");
            };
            close("light", seen.rgb[c].f64(), light);
            close("by step", by.by_knot(table).iter().sum::<f64>() * RISE, expected);
            close("by voxel", voxels.iter().map(|v| v.f64()).sum::<f64>() * RISE, -expected);
            // The box stands still, and so does the density: nothing changes.
            close("by origin", moved.origin.x, 0.0);
        }
    }
    check::<f64>(Quadrature::Exact, [1e-11; 2]);
    check::<f32>(Quadrature::Exact, [1e-5; 2]);
    // A stretch across the step mixes both sides: light is off by the tolerance, and where in the stretch the step is
    // makes no difference to what is in front of what.
    check::<f64>(Quadrature::Preintegrated(1e-4), [5e-4, 5e-3]);
    check::<f32>(Quadrature::Preintegrated(1e-4), [5e-4, 5e-3]);
}
