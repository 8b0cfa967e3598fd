//! Spots, and discs that turn to whatever they light: closed forms, and the bounds that plans are made by.

use cumulo::math::Aabb;
use cumulo::scene::cone::Cone;
use cumulo::scene::light::{Arrival, Light};
use glam::{DVec3, Vec3};
use std::f64::consts::PI;

fn numbers(mut state: u64) -> impl FnMut() -> f64 {
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// Fluence rate at a point, by drawn directions.
fn fluence(light: &Light, from: DVec3) -> f64 {
    let edge = 40;
    let of = |arrival: Arrival| {
        f64::from(arrival.radiance.x) / if arrival.density.is_infinite() { 1.0 } else { arrival.density }
    };
    let draws = (0..edge * edge).map(|k| [k % edge, k / edge].map(|i| (f64::from(i) + 0.5) / f64::from(edge)));
    draws.filter_map(|u| light.sample(from, u)).map(of).sum::<f64>() / f64::from(edge * edge)
}

/// The light of a disc that faces the point is that of the integral over its area, from far outside to deep within.
#[test]
fn discs_light_as_their_area_does() {
    let disc = Light::Disc { centre: DVec3::new(0.3, -0.2, 0.1), radius: 0.8, radiance: Vec3::splat(2.0) };
    let disc = disc.checked().unwrap();
    for distance in [20.0, 2.0, 0.8, 0.1] {
        let from = DVec3::new(0.3, -0.2, 0.1) + distance * DVec3::new(0.6, 0.0, 0.8);
        // ∫ L cos θ / ρ² dA over rings of radius a: cos θ = d / ρ.
        let rings = 4000;
        let area: f64 = (0..rings)
            .map(|k| {
                let a = 0.8 * (f64::from(k) + 0.5) / f64::from(rings);
                2.0 * PI * a * (0.8 / f64::from(rings)) * distance / (distance * distance + a * a).powf(1.5)
            })
            .sum();
        // Rings of the midpoint rule, and radiances of single precision.
        assert!((fluence(&disc, from) / (2.0 * area) - 1.0).abs() < 1e-5, "{distance}");
        // At the rim of what is drawn, the disc is met as far away as its edge is.
        let met = disc.sample(from, [1.0 - 1e-12, 0.3]).unwrap();
        assert!((met.distance / distance.hypot(0.8) - 1.0).abs() < 1e-9, "{distance}: {met:?}");
    }
}

/// A small spot is as bright as a point of its intensity, times the share of its cone.
#[test]
fn small_spots_are_points_with_a_cone() {
    let cone = Cone::new(DVec3::new(0.0, 1.0, -1.0), 0.6, 0.5).unwrap();
    let position = DVec3::new(1.0, 2.0, 3.0);
    let point = Light::Point { position, intensity: Vec3::splat(5.0) };
    for (radius, soft) in [(0.0, false), (1e-4, false), (1e-4, true)] {
        let spot = Light::Spot { position, radius, soft, intensity: Vec3::splat(5.0), cone }.checked().unwrap();
        for turn in 0..12 {
            let from = position + 4.0 * DVec3::new(0.1 * f64::from(turn), 1.0, -0.9).normalize();
            let share = f64::from(cone.share((from - position).normalize()));
            let expected = share * fluence(&point, from);
            // Directions to the ball differ by its angle, 2.5e-5, which is that much of the steepest falloff.
            assert!((fluence(&spot, from) - expected).abs() < 3e-4 * expected.max(0.1), "{radius} {soft} {turn}");
        }
        assert!(spot.sample(position + DVec3::Z, [0.5; 2]).is_none(), "behind the spot it is dark");
    }
}

/// No point of a box gets more light than the bounds say, and boxes outside of a cone get none.
#[test]
fn bounds_of_spots_and_discs_hold() {
    let mut next = numbers(7);
    let mut dark = 0;
    for _ in 0..300 {
        let place = |next: &mut dyn FnMut() -> f64| 4.0 * DVec3::new(next(), next(), next()) - 2.0;
        let radius = if next() < 0.3 { 0.0 } else { 0.6 * next() + 1e-3 };
        let cone = Cone::new(place(&mut next) + 1e-3, PI * next() + 1e-9, next()).unwrap();
        let (position, soft) = (place(&mut next), next() < 0.5);
        let spot = Light::Spot { position, radius, soft, intensity: Vec3::ONE, cone };
        let disc = Light::Disc { centre: position, radius: radius + 1e-3, radiance: Vec3::ONE };
        let low = place(&mut next);
        let within = Aabb { min: low, max: low + DVec3::new(next(), next(), next()) };
        for light in [spot, disc] {
            let bounds = light.checked().unwrap().bounds(within);
            for _ in 0..20 {
                let at = within.min + within.size() * DVec3::new(next(), next(), next());
                let found = fluence(&light, at);
                assert!(found <= f64::from(bounds.fluence.x) * (1.0 + 1e-5), "{light:?} {found} {bounds:?}");
            }
            dark += usize::from(bounds.fluence == Vec3::ZERO);
        }
    }
    assert!(dark > 30, "cones that miss their box are bounded by 0: {dark}");
}
