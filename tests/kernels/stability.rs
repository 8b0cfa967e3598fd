//! Hard cases: f32 against f64, each with the figure it must keep.

use crate::common::fields::{self, field, lumps, noise, rays, unit};
use cumulo::math::{Affine, Ray};
use cumulo::real::Real;
use cumulo::render::differentiable::{Accumulators, Adjoint, ParameterGradient};
use cumulo::render::dvr::{Dvr, Precision, Tape};
use cumulo::render::quadrature::Quadrature;
use cumulo::scene::bricks::Bricks;
use cumulo::scene::medium::{Medium, Source};
use cumulo::scene::transfer::Transfer;
use glam::{DMat3, DMat4, DVec3};
use std::sync::Arc;

/// Gradient of rgb·(1, 2, 3) + alpha along one ray, by the given adjoint.
fn gradient<R: Precision>(f: &Bricks<R>, medium: &Medium, rule: Quadrature, adjoint: Adjoint, ray: &Ray) -> Vec<f64> {
    let dvr = Dvr::new(f, medium.clone()).unwrap().quadrature(rule).early_stop(0.0).over([0.3, 0.2, 0.1]);
    let (mut g, mut p, mut tape) = (vec![R::ZERO; f.values.len()], ParameterGradient::default(), Tape::default());
    let weights = [R::ONE, R::of(2.0), R::of(3.0), R::ONE];
    let sinks = Accumulators { voxels: Some(&mut g), table: None, ray: None, shared: &mut p };
    dvr.vjp(ray, &mut |_| weights, adjoint, sinks, &mut tape);
    g.into_iter().map(Real::f64).collect()
}

/// Largest difference over largest magnitude; infinite if anything is not finite.
fn relative(got: &[f64], expected: &[f64]) -> f64 {
    if got.iter().any(|v| !v.is_finite()) {
        return f64::INFINITY;
    }
    let scale = expected.iter().fold(f64::MIN_POSITIVE, |m, v| m.max(v.abs()));
    got.iter().zip(expected).fold(0.0_f64, |m, (a, b)| m.max((a - b).abs())) / scale
}

fn slanted() -> Ray {
    Ray { origin: DVec3::new(-20.0, 3.1, 5.2), direction: DVec3::new(0.9, 0.3, 0.2).normalize() }
}

/// Opaque samples, τΔt from 1e-8 to 1e6: the recursion stays within 5e-6 of f64 while the inversion
/// of the blend turns to NaN or noise as soon as one sample's alpha rounds to one.
#[test]
fn alpha_to_one() {
    let (narrow, wide): (Bricks<f32>, Bricks<f64>) = (field(16, unit(), lumps(16)), field(16, unit(), lumps(16)));
    let mut inversion_broke = 0;
    for exponent in -8..=6 {
        let medium = Medium::new(10_f64.powi(exponent), Source::Linear([0.5, 1.0, 0.25]));
        let rule = Quadrature::Midpoint(1.0);
        let reference = gradient(&wide, &medium, rule, Adjoint::Tape, &slanted());
        let recursion = relative(&gradient(&narrow, &medium, rule, Adjoint::Tape, &slanted()), &reference);
        let inversion = relative(&gradient(&narrow, &medium, rule, Adjoint::Inversion, &slanted()), &reference);
        assert!(recursion < 5e-6, "τΔt 1e{exponent}: recursion off by {recursion:.1e}");
        inversion_broke += i32::from(inversion > 1e-2);
    }
    assert!(
        inversion_broke >= 3,
        "the inversion is expected to fail on opaque samples, it did {inversion_broke} times"
    );
}

/// Optical depth 1 to 1e4 in 16 to 10 000 steps: no drift with the number of steps.
#[test]
fn deep_and_long() {
    let (narrow, wide): (Bricks<f32>, Bricks<f64>) = (field(16, unit(), lumps(16)), field(16, unit(), lumps(16)));
    for depth in [1.0, 10.0, 200.0, 1e4] {
        for step in [1.0, 0.1, 0.002] {
            let medium = Medium::new(depth / 6.0, Source::Linear([0.5, 1.0, 0.25]));
            let rule = Quadrature::Midpoint(step);
            let reference = gradient(&wide, &medium, rule, Adjoint::Replay, &slanted());
            let error = relative(&gradient(&narrow, &medium, rule, Adjoint::Replay, &slanted()), &reference);
            // Up to 10 000 f32 additions into one voxel; 5e-6 otherwise.
            let limit = if step < 0.01 { 3e-5 } else { 5e-6 };
            assert!(error < limit, "depth {depth}, step {step}: {error:.1e}");
        }
    }
}

/// Inversion drifts with the optical depth long before it is undefined.
#[test]
fn inversion_drifts_at_depth_fifteen() {
    let (narrow, wide): (Bricks<f32>, Bricks<f64>) = (field(16, unit(), |_| 1.0), field(16, unit(), |_| 1.0));
    let ray = Ray { origin: DVec3::new(-9.0, 7.5, 7.5), direction: DVec3::X };
    let medium = Medium::new(15.0 / 16.0, Source::Linear([0.5, 1.0, 0.25]));
    let rule = Quadrature::Midpoint(0.05);
    let reference = gradient(&wide, &medium, rule, Adjoint::Tape, &ray);
    let of = |adjoint| relative(&gradient(&narrow, &medium, rule, adjoint, &ray), &reference);
    let (recursion, inversion) = (of(Adjoint::Tape), of(Adjoint::Inversion));
    assert!(recursion < 5e-6 && inversion > 100.0 * recursion, "{recursion:.1e} {inversion:.1e}");
}

/// A shell thinner than the step is missed by sampling and seen by the exact rule.
#[test]
fn thin_dense_shell() {
    let shell = |p: DVec3| f64::from((p - DVec3::splat(12.0)).length().round() == 9.0);
    let f: Bricks<f64> = field(25, unit(), shell);
    let spread = |q| {
        let dvr = Dvr::new(&f, Medium::absorbing(1.0)).unwrap().quadrature(q).early_stop(0.0);
        let exact = Dvr::new(&f, Medium::absorbing(1.0)).unwrap().early_stop(0.0);
        rays(f.world_bounds(), 200, 21)
            .iter()
            .map(|r| (dvr.optical_depth(r) - exact.optical_depth(r)).abs())
            .fold(0.0, f64::max)
    };
    assert!(spread(Quadrature::Midpoint(4.0)) > 0.5, "four-voxel steps must miss the shell somewhere");
    assert!(spread(Quadrature::Midpoint(0.01)) < 1e-3);
}

/// Rays parallel to an axis, along faces, edges and corners of cells and bricks, and from inside:
/// no NaN, no cell twice, no cell missed.
#[test]
fn grazing_rays() {
    let f: Bricks<f32> = field(32, unit(), |_| 1.0);
    let dvr = Dvr::new(&f, Medium::absorbing(1.0)).unwrap().early_stop(0.0);
    for axis in 0..3 {
        for (a, b) in [(8.0, 8.0), (8.0, 3.5), (0.0, 0.0), (15.0, 16.0), (31.0, 31.0), (3.0, 24.0)] {
            for sign in [-1.0, 1.0] {
                let mut origin = DVec3::ZERO;
                origin[(axis + 1) % 3] = a;
                origin[(axis + 2) % 3] = b;
                origin[axis] = 15.5 - 100.0 * sign;
                let mut direction = DVec3::ZERO;
                direction[axis] = sign;
                let depth = dvr.optical_depth(&Ray { origin, direction });
                assert!((depth - 32.0).abs() < 1e-4, "axis {axis} at {a},{b}: {depth}");
                // From the middle: half of it.
                origin[axis] = 15.5;
                let inside = dvr.optical_depth(&Ray { origin, direction });
                assert!((inside - 16.0).abs() < 1e-4, "axis {axis} at {a},{b} from inside: {inside}");
            }
        }
    }
    // Along space diagonals every cell is entered through a corner.
    for sign in [-1.0, 1.0] {
        let direction = DVec3::splat(sign / 3.0_f64.sqrt());
        let depth = dvr.optical_depth(&Ray { origin: DVec3::splat(15.5) - 80.0 * direction, direction });
        // 31 cells of √3 at density 1 and the two cubic falloffs ∫(1-t)³ √3 dt = √3/4 each.
        assert!((depth - 3.0_f64.sqrt() * 31.5).abs() < 2e-4, "{depth}");
    }
    // Tangent to the outer face of the falloff: nothing.
    let outside = Ray { origin: DVec3::new(-50.0, 32.0, 10.0), direction: DVec3::X };
    assert_eq!(dvr.optical_depth(&outside), 0.0);
}

/// A ray that creeps over the face between two bricks at a slope of 1e-17 rounds onto it from either
/// side: nothing may be lost.
#[test]
fn creeping_along_a_face() {
    let f: Bricks<f32> = field(32, unit(), |p| 1.0 + 0.1 * p.x);
    let dvr = Dvr::new(&f, Medium::absorbing(1.0)).unwrap().early_stop(0.0);
    for slope in [6e-17, -6e-17, 1e-12, -1e-12, 0.0] {
        for x in [8.0, 8.0 + 2e-15, 8.0 - 2e-15, 16.0, 16.0 - 4e-15] {
            let ray = Ray { origin: DVec3::new(x, -40.0, 9.5), direction: DVec3::new(slope, 1.0, 0.0) };
            let depth = dvr.optical_depth(&ray);
            let expected = 32.0 * (1.0 + 0.1 * x);
            assert!((depth - expected).abs() < 1e-5 * expected, "{slope} {x}: {depth} {expected}");
        }
    }
}

/// A volume at 1e7 with voxels of 1e-4, and one of voxels of 1e7: rebased in f64.
#[test]
fn far_from_the_origin() {
    let place = |size: f64, at: DVec3| Affine::uniform(size, at).unwrap();
    let near: Bricks<f64> = field(24, unit(), lumps(24));
    let reference = Dvr::new(&near, Medium::absorbing(1.0)).unwrap();
    for (size, at) in [
        (1e-4, DVec3::new(1e3, -2e3, 5e2)),
        (1.0, DVec3::splat(1e7)),
        (1e7, DVec3::splat(-1e12)),
        (1e-4, DVec3::splat(1e7)),
    ] {
        let transform = place(size, at);
        let far: Bricks<f32> = field(24, transform, lumps(24));
        let dvr = Dvr::new(&far, Medium::absorbing(1.0 / size)).unwrap();
        for ray in rays(near.world_bounds(), 60, 31) {
            let world = Ray { origin: transform.to_world(ray.origin), direction: ray.direction };
            let (a, b) = (dvr.optical_depth(&world), reference.optical_depth(&ray));
            // The ray's own origin is rounded to 2^-52 of where it is: 2e-5 voxels at 1e7, whose densities
            // change by up to their own size from voxel to voxel.
            let rounding = 2.0 * 2.0_f64.powi(-52) * at.abs().max_element() / size;
            assert!((a - b).abs() < (4e-6 + rounding) * b.max(0.1), "{size} {at}: {a} {b}");
        }
    }
}

#[test]
fn singular_maps_are_refused_with_their_condition() {
    let flat = DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::new(1.0, 1.0, 0.0));
    let error = Affine::new(DMat4::from_mat3(flat)).unwrap_err().to_string();
    assert!(error.contains("condition number"), "{error}");
    assert!(Affine::new(DMat4::from_mat3(flat) + DMat4::from_cols_array(&[0.0; 16])).is_err());
    assert!(Affine::uniform(f64::NAN, DVec3::ZERO).is_err());
    // Tiny voxels are not singular.
    assert!(Affine::uniform(1e-30, DVec3::ZERO).is_ok());
}

/// Empty, constant and one-voxel volumes.
#[test]
fn degenerate_volumes() {
    let empty: Bricks<f32> = field(8, unit(), |_| 0.0);
    assert!(empty.topology.is_empty());
    let ray = Ray { origin: DVec3::new(-5.0, 4.0, 4.0), direction: DVec3::X };
    let seen = Dvr::new(&empty, Medium::absorbing(1.0)).unwrap().over([1.0; 3]).pixel(&ray);
    assert_eq!((seen.rgb, seen.transmittance), ([1.0; 3], 1.0));
    // Along no axis, where the empty box's slabs are all crossed.
    let slanted = Dvr::new(&empty, Medium::absorbing(1.0)).unwrap().over([1.0; 3]).pixel(&slanted());
    assert_eq!((slanted.rgb, slanted.transmittance), ([1.0; 3], 1.0));

    // One voxel at the low corner of a leaf: it reaches into bricks that have no leaf.
    let single: Bricks<f32> = field(9, unit(), |p| f64::from(p == DVec3::splat(8.0)));
    let dvr = Dvr::new(&single, Medium::absorbing(1.0)).unwrap();
    for direction in [DVec3::X, DVec3::Y, DVec3::NEG_Z] {
        let depth = dvr.optical_depth(&Ray { origin: DVec3::splat(8.0) - 20.0 * direction, direction });
        assert!((depth - 1.0).abs() < 1e-6, "a hat of height and half-width one: {depth}");
    }
}

/// NaN, infinite and negative densities are refused with their number, not rendered.
#[test]
fn poisoned_values_are_refused() {
    for bad in [f64::NAN, f64::INFINITY, -1.0] {
        let g = fields::grid(8, unit(), |p| if p == DVec3::ZERO { bad } else { noise(p.x as u64) });
        let error = Bricks::<f32>::from_grid(&g, 1 << 30).unwrap_err().to_string();
        assert!(error.contains("1 values are") && error.contains("`convert.repair"), "{error}");
    }
}

/// What ending rays early costs stays below what is said, whatever shines.
#[test]
fn early_stops_are_off_by_no_more_than_is_said() {
    let f: Bricks<f64> = field(160, unit(), |p| 0.3 + 0.2 * (0.2 * p.x).sin() * (0.15 * p.y + 0.1 * p.z).cos());
    let points = vec![[0.1, 3.0, 0.5, 0.1, 0.0], [0.3, 0.2, 5.0, 0.1, 0.2], [0.5, 0.1, 0.2, 0.9, 0.4]];
    let function = Arc::new(Transfer::Piecewise { points }.table().unwrap());
    let sources = [Source::Grey([4.0, 0.5, 0.0]), Source::Linear([9.0, 1.0, 0.0]), Source::Transfer(function)];
    for source in sources {
        let medium = Medium::new(0.1, source.clone());
        for rule in [Quadrature::Exact, Quadrature::PREINTEGRATED, Quadrature::Midpoint(0.5)] {
            let whole = Dvr::new(&f, medium.clone()).unwrap().quadrature(rule).early_stop(0.0).over([0.5, 2.0, 0.1]);
            let ended = whole.clone().with(|dvr| dvr.early_stop(0.2));
            let mut off = 0.0_f64;
            for ray in rays(f.world_bounds(), 60, 5) {
                let [a, b] = [&whole, &ended].map(|dvr| dvr.pixel(&ray).rgba());
                off = (0..4).fold(off, |most, c| most.max((a[c] - b[c]).abs()));
            }
            let bound = ended.left_out();
            assert!(
                whole.left_out() == 0.0 && off <= bound && off > 1e-3 * bound,
                "{source:?} {rule}: {off}, {bound} said"
            );
        }
    }
}
