//! Boundaries of volumes whose materials are known.

use super::*;
use crate::math::{Aabb, Affine};
use crate::scene::bricks::{BRICK, EDGE, Topology, slot};
use crate::scene::transfer::Transfer;
use glam::{DVec3, IVec3};
use std::sync::Arc;

const SIZE: i32 = 48;

/// A field of [`SIZE`]³ voxels of a given edge, of the distances of voxels from its centre.
fn field(edge: f64, value: impl Fn(f64) -> f64, noise: f64) -> Bricks<f32> {
    let bricks = SIZE / 8;
    let all = (0..bricks.pow(3)).map(|i| IVec3::new(i / bricks / bricks, i / bricks % bricks, i % bricks));
    let topology = Arc::new(Topology::new(all).unwrap());
    let mut field = Bricks::zeros(topology.clone(), Affine::uniform(edge, DVec3::ZERO).unwrap());
    field.background = value(f64::from(SIZE)) as f32;
    let centre = DVec3::splat(0.5 * f64::from(SIZE - 1));
    for (number, brick) in topology.bricks().iter().enumerate() {
        for i in 0..BRICK {
            let local = [i / EDGE / EDGE, i / EDGE % EDGE, i % EDGE];
            let at = 8 * *brick + IVec3::from_array(local.map(|c| c as i32));
            let [x, y, z] = local;
            let value = value(at.as_dvec3().distance(centre)) + noise * deviate(at);
            field.values[number * BRICK + slot(x, y, z)] = value as f32;
        }
    }
    field.domain = Aabb { min: DVec3::ZERO, max: DVec3::splat(f64::from(SIZE - 1)) };
    field
}

/// A normal deviate of a voxel, nearly: the sum of twelve even ones.
fn deviate(at: IVec3) -> f64 {
    let mut state = at.to_array().iter().fold(1_u64, |seed, c| seed.wrapping_mul(1009).wrapping_add(*c as u64));
    let mut even = || {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((mixed ^ (mixed >> 31)) >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
    };
    (0..12).map(|_| even()).sum()
}

/// A step from 1 to 0 at a radius, blurred by 1.5 voxels: the logistic function nearest to the normal distribution's.
fn blurred(distance: f64, radius: f64) -> f64 {
    1.0 / (1.0 + (1.702 * (distance - radius) / 1.5).exp())
}

fn shells([outside, shell, inside]: [f64; 3]) -> impl Fn(f64) -> f64 {
    move |r| outside + (shell - outside) * blurred(r, 20.0) + (inside - shell) * blurred(r, 10.0)
}

fn found(analysis: &Analysis) -> Vec<f64> {
    analysis.boundaries.iter().map(|boundary| boundary.value).collect()
}

fn assert_near(analysis: &Analysis, expected: &[f64], tolerance: f64) {
    let found = found(analysis);
    let near = found.len() == expected.len() && found.iter().zip(expected).all(|(a, b)| (a - b).abs() < tolerance);
    assert!(near, "{found:?}, {expected:?} expected");
}

#[test]
fn a_ball_has_one_boundary_of_known_thickness() {
    for (edge, noise) in [(1.0, 0.0), (0.25, 0.0), (1.0, 0.05)] {
        let analysis = Analysis::of(&field(edge, |r| blurred(r, 14.0), noise)).unwrap();
        assert_near(&analysis, &[0.5], 0.05);
        let Boundary { thickness, gradient, half_width, share, .. } = analysis.boundaries[0];
        assert!((2.0..5.0).contains(&thickness), "{thickness} of 3 voxels");
        // The logistic function's slope is 1.702 / 4 per deviation.
        assert!((gradient * edge * 1.5 / 0.4255 - 1.0).abs() < 0.2, "{gradient}");
        assert!((0.2..0.5).contains(&half_width) && (0.01..0.2).contains(&share), "{half_width} {share}");
        assert!(analysis.background.abs() < 0.1, "{}", analysis.background);
        let [outside, ball] = &analysis.materials[..] else { panic!("{:?}", analysis.materials) };
        assert!(outside.value.abs() < 0.1 && (ball.value - 1.0).abs() < 0.1 && outside.share > ball.share);
    }
}

#[test]
fn shells_are_found_in_any_unit_and_in_noise() {
    assert_near(&Analysis::of(&field(1.0, shells([0.0, 0.4, 1.0]), 0.0)).unwrap(), &[0.2, 0.7], 0.05);
    assert_near(&Analysis::of(&field(1.0, shells([0.0, 0.4, 1.0]), 0.05)).unwrap(), &[0.2, 0.7], 0.05);
    let scan = Analysis::of(&field(0.7, shells([-1000.0, 40.0, 700.0]), 20.0)).unwrap();
    assert_near(&scan, &[-480.0, 370.0], 85.0);
    assert!((scan.background + 1000.0).abs() < 30.0, "{}", scan.background);
    assert_eq!(
        scan.candidates().iter().map(|c| c.name.as_str()).collect::<Vec<_>>(),
        ["all boundaries", "boundary 1", "boundary 2", "ramp"]
    );
}

/// Labels and phantoms have no values between their materials, but rays see those that are interpolated.
#[test]
fn steps_between_voxels_are_boundaries() {
    let step = |r: f64, radius: f64| f64::from(u8::from(r < radius));
    let ball = Analysis::of(&field(1.0, |r| step(r, 14.0), 0.0)).unwrap();
    assert_near(&ball, &[0.5], 0.05);
    assert!((0.3..1.5).contains(&ball.boundaries[0].thickness), "{:?}", ball.boundaries);
    let phantom = |r| -1000.0 + 1035.0 * step(r, 20.0) + 1065.0 * step(r, 10.0);
    assert_near(&Analysis::of(&field(1.0, phantom, 0.0)).unwrap(), &[-482.5, 567.5], 100.0);
}

#[test]
fn functions_are_clear_at_the_background_and_have_the_depth_they_state() {
    for (materials, noise) in [([0.0, 0.4, 1.0], 0.0), ([-1000.0, 40.0, 700.0], 20.0), ([1.0, 0.4, -2.0], 0.02)] {
        let analysis = Analysis::of(&field(0.5, shells(materials), noise)).unwrap();
        for Candidate { name, transfer } in analysis.candidates() {
            let table = transfer.clone().checked().unwrap().table().unwrap();
            assert_eq!(table.at(analysis.background)[3], 0.0, "{name}");
            let Transfer::Piecewise { points } = &transfer else { panic!("{transfer:?}") };
            assert!(points.iter().all(|p| p[1..4].iter().all(|c| (0.0..=1.0).contains(c))), "{points:?}");
            if name == "boundary 1" {
                // The integral over the path that the value passes along.
                let depth = 0.5 * points[1][4] * (points[2][0] - points[0][0]) / analysis.boundaries[0].gradient;
                assert!((depth - 1.5).abs() < 1e-9, "{depth}");
            }
        }
        let depths = analysis.depths();
        let outer_first = materials[2] > materials[0];
        assert_eq!(depths[0] < depths[1], outer_first, "{depths:?}");
    }
}

#[test]
fn volumes_without_boundaries_get_a_ramp_and_constant_ones_none() {
    let haze = Analysis::of(&field(1.0, |_| 0.0, 1.0)).unwrap();
    assert!(haze.boundaries.is_empty(), "{:?}", haze.boundaries);
    let [Candidate { name, transfer }] = &haze.candidates()[..] else { panic!("one candidate is expected") };
    let table = transfer.table().unwrap();
    assert!(name == "ramp" && table.at(0.0)[3] == 0.0 && table.at(2.9)[3] > 0.0 && table.at(-2.9)[3] > 0.0);
    let error = Analysis::of(&field(1.0, |_| 3.0, 0.0)).unwrap_err().to_string();
    assert!(error.contains("value 3"), "{error}");
    let mut empty = field(1.0, |_| 3.0, 0.0);
    empty.domain = Aabb::EMPTY;
    assert_eq!(Analysis::of(&empty).unwrap_err().code(), Code::EmptyGrid);
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let field = field(1.0, shells([0.0, 0.4, 1.0]), 0.05);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| Analysis::of(&field).unwrap().candidates())
    };
    assert_eq!(run(1), run(3));
}
