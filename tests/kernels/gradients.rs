//! Every derivative against central differences in f64, the adjoints against one another, and the
//! transpose identity. The fields are smooth and the pieces' number does not change under the
//! differences' steps, so central differences are good to h².

use crate::common::fields::{self, field, lumps, odd, rays, unit};
use crate::loss::{close, loss, slope};
use cumulo::math::Ray;
use cumulo::render::differentiable::{Accumulators, Adjoint, ParameterGradient};
use cumulo::render::dvr::{Dvr, Precision, Tape};
use cumulo::render::quadrature::Quadrature;
use cumulo::scene::bricks::Bricks;
use cumulo::scene::medium::{Medium, Source};

const BACKGROUND: [f32; 3] = [0.9, 0.4, 0.1];
const RULES: [Quadrature; 3] = [Quadrature::Exact, Quadrature::Midpoint(0.4), Quadrature::Riemann(0.7)];
const SOURCES: [Source; 2] = [Source::Grey([0.6, 0.3, 0.8]), Source::Linear([0.5, 1.5, 0.2])];

fn total(f: &Bricks<f64>, medium: &Medium, background: [f32; 3], rule: Quadrature, rays: &[Ray]) -> f64 {
    let dvr = Dvr::new(f, medium.clone()).unwrap().quadrature(rule).early_stop(0.0).over(background);
    rays.iter().map(|r| loss(&dvr.pixel(r))).sum()
}

fn gradient<R: Precision>(
    f: &Bricks<R>,
    medium: &Medium,
    rule: Quadrature,
    adjoint: Adjoint,
    rays: &[Ray],
) -> (Vec<R>, ParameterGradient) {
    let dvr = Dvr::new(f, medium.clone()).unwrap().quadrature(rule).early_stop(0.0).over(BACKGROUND);
    let (mut by_voxel, mut shared, mut tape) =
        (vec![R::ZERO; f.values.len()], ParameterGradient::default(), Tape::default());
    for ray in rays {
        let sinks = Accumulators { voxels: Some(&mut by_voxel), table: None, ray: None, shared: &mut shared };
        let seen = dvr.vjp(ray, &mut slope, adjoint, sinks, &mut tape);
        if adjoint != Adjoint::Inversion {
            assert_eq!(seen, dvr.pixel(ray), "the gradient's value is the value");
        }
    }
    (by_voxel, shared)
}

#[test]
fn every_parameter_matches_central_differences() {
    let mut f: Bricks<f64> = field(14, odd(), lumps(14));
    let rays = rays(f.world_bounds(), 25, 2);
    for rule in RULES {
        for source in SOURCES {
            let medium = Medium::new(0.8, source.clone());
            let (by_voxel, shared) = gradient(&f, &medium, rule, Adjoint::Tape, &rays);
            // The error of a central difference is h² f'''/6 + eps |f| / h: h = 1e-5 leaves 1e-10.
            let h = 1e-5;
            let mut order: Vec<usize> = (0..f.values.len()).collect();
            order.sort_by(|a, b| by_voxel[*b].abs().total_cmp(&by_voxel[*a].abs()));
            for i in order.into_iter().step_by(97).take(40) {
                let keep = f.values[i];
                f.values[i] = keep + h;
                let up = total(&f, &medium, BACKGROUND, rule, &rays);
                f.values[i] = keep - h;
                let down = total(&f, &medium, BACKGROUND, rule, &rays);
                f.values[i] = keep;
                close(&format!("{rule} {source:?} voxel {i}"), by_voxel[i], (up - down) / (2.0 * h), 2e-6, 1e-3);
            }
            let difference = |m: fn(&mut Medium, &mut [f32; 3], f64), h: f64| {
                let at = |h| {
                    let (mut medium, mut background) = (medium.clone(), BACKGROUND);
                    m(&mut medium, &mut background, h);
                    total(&f, &medium, background, rule, &rays)
                };
                (at(h) - at(-h)) / (2.0 * h)
            };
            close("extinction", shared.extinction, difference(|m, _, h| m.extinction += h, 1e-5), 2e-6, 1e-3);
            // Colors are f32: the step is a power of two so that it is taken exactly up to 2^-24 of
            // the value, and the loss is quadratic in them, which central differences get right.
            let h = 1.0 / 64.0;
            let color: [fn(&mut Medium, &mut [f32; 3], f64); 3] =
                [|m, _, h| tint(m, 0, h), |m, _, h| tint(m, 1, h), |m, _, h| tint(m, 2, h)];
            let behind: [fn(&mut Medium, &mut [f32; 3], f64); 3] =
                [|_, b, h| b[0] += h as f32, |_, b, h| b[1] += h as f32, |_, b, h| b[2] += h as f32];
            for c in 0..3 {
                close("color", shared.color[c], difference(color[c], h), 1e-5, 1e-3);
                close("background", shared.background[c], difference(behind[c], h), 1e-5, 1e-3);
            }
        }
    }
}

fn tint(m: &mut Medium, c: usize, h: f64) {
    if let Source::Grey(k) | Source::Linear(k) = &mut m.source {
        k[c] += h as f32;
    }
}

/// Replay walks the same spans backward: not one bit of difference, though rays cross several batches of
/// bricks, some without a sample, and cells are cut by what was found before them.
#[test]
fn tape_and_replay_are_identical() {
    let short: Bricks<f32> = field(20, odd(), lumps(20));
    let lumps = lumps(170);
    let long: Bricks<f32> = field(170, odd(), |p| (lumps(p) - 0.3).max(0.0));
    for (f, extinction) in [(&short, 6.0), (&long, 0.05), (&long, 2.0)] {
        let rays = rays(f.world_bounds(), 100, 4);
        for rule in RULES.into_iter().chain([Quadrature::Midpoint(30.0)]) {
            for source in SOURCES {
                let medium = Medium::new(extinction, source.clone());
                let tape = gradient(f, &medium, rule, Adjoint::Tape, &rays);
                let replay = gradient(f, &medium, rule, Adjoint::Replay, &rays);
                assert_eq!(tape, replay, "{rule} {source:?} {extinction}");
            }
        }
    }
}

/// The same after a ray has ended early.
#[test]
fn tape_and_replay_agree_after_an_early_stop() {
    let f: Bricks<f32> = field(24, unit(), |_| 0.5);
    let medium = Medium::new(4.0, Source::Linear([1.0; 3]));
    let dvr = Dvr::new(&f, medium).unwrap().early_stop(1e-3).over([1.0; 3]);
    let rays = rays(f.world_bounds(), 50, 8);
    let run = |adjoint| {
        let (mut g, mut p, mut tape) = (vec![0.0; f.values.len()], ParameterGradient::default(), Tape::default());
        for r in &rays {
            let sinks = Accumulators { voxels: Some(&mut g), table: None, ray: None, shared: &mut p };
            dvr.vjp(r, &mut slope, adjoint, sinks, &mut tape);
        }
        (g, p)
    };
    let (tape, replay) = (run(Adjoint::Tape), run(Adjoint::Replay));
    assert_eq!(tape, replay);
    assert!(tape.0.iter().filter(|g| **g == 0.0).count() > tape.0.len() / 4, "what lies behind has no gradient");
}

/// Where nothing is opaque the paper's inversion gives the same numbers in f64.
#[test]
fn inversion_agrees_where_it_is_stable() {
    let f: Bricks<f64> = field(14, odd(), lumps(14));
    let rays = rays(f.world_bounds(), 30, 6);
    for rule in RULES {
        for source in SOURCES {
            let medium = Medium::new(0.3, source.clone());
            let (a, pa) = gradient(&f, &medium, rule, Adjoint::Replay, &rays);
            let (b, pb) = gradient(&f, &medium, rule, Adjoint::Inversion, &rays);
            let scale = a.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            for (a, b) in a.iter().zip(&b) {
                // Depth up to 3: the inversion loses e^3 of 2^-52 a step, over 60 steps. It sees a grey
                // source through the quadrature of one that varies, whose error is far below its bound.
                assert!((a - b).abs() < 1e-8 * scale, "{rule} {source:?} {a} {b}");
            }
            close("extinction", pb.extinction, pa.extinction, 1e-10, 1e-6);
        }
    }
}

/// ⟨A u, w⟩ = ⟨u, Aᵀ w⟩ for the optical depth, which is linear in the voxels.
#[test]
fn the_adjoint_is_the_transpose() {
    fn both<R: Precision>(tolerance: f64) {
        let f: Bricks<R> = field(20, odd(), lumps(20));
        let dvr = Dvr::new(&f, Medium::absorbing(1.7)).unwrap().early_stop(0.0);
        let (mut left, mut transposed, mut tape) = (0.0, vec![R::ZERO; f.values.len()], Tape::default());
        for (i, ray) in rays(f.world_bounds(), 400, 12).iter().enumerate() {
            let w = fields::noise(i as u64);
            left += w * dvr.trace(ray, &mut tape);
            tape.accumulate(w, &dvr, &mut transposed);
        }
        let right: f64 = transposed.iter().zip(&f.values).map(|(g, v)| g.f64() * v.f64()).sum();
        assert!((left - right).abs() < tolerance * left, "{left} {right}");
    }
    both::<f64>(1e-12);
    both::<f32>(1e-5);
}
