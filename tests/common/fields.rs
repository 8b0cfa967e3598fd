//! Fields with known integrals, and rays through them.

use cumulo::math::{Affine, Ray};
use cumulo::real::Lanes;
use cumulo::real::Real;
use cumulo::render::composited::Pixel;
use cumulo::render::quadrature::Quadrature;
use cumulo::scene::bricks::Bricks;
use cumulo::scene::grid::{Grid, GridClass, LEAF_VOXELS, Leaf};
use cumulo::scene::transfer::{Lobe, Transfer};
use glam::{DMat3, DMat4, DVec3};
use std::collections::BTreeMap;

/// A grid of `n³` voxels, index (0, 0, 0) first, from a function of the index coordinates.
pub fn grid(n: i32, transform: Affine, f: impl Fn(DVec3) -> f64) -> Grid {
    let mut leaves = Vec::new();
    for x in (0..n).step_by(8) {
        for y in (0..n).step_by(8) {
            for z in (0..n).step_by(8) {
                let mut values = [0.0_f32; LEAF_VOXELS];
                let mut active = [0_u64; 8];
                for i in 0..LEAF_VOXELS {
                    let p = [x + (i as i32 >> 6), y + (i as i32 >> 3 & 7), z + (i as i32 & 7)];
                    if p.iter().all(|c| *c < n) {
                        values[i] = f(DVec3::new(p[0].into(), p[1].into(), p[2].into())) as f32;
                        active[i >> 6] |= 1 << (i & 63);
                    }
                }
                leaves.push(Leaf { origin: [x, y, z], values, active });
            }
        }
    }
    Grid {
        name: "density".into(),
        class: GridClass::FogVolume,
        transform,
        background: 0.0,
        leaves,
        tiles: Vec::new(),
        metadata: BTreeMap::new(),
    }
}

/// The same as bricks.
pub fn field<R: Real>(n: i32, transform: Affine, f: impl Fn(DVec3) -> f64) -> Bricks<R> {
    Bricks::from_grid(&grid(n, transform, f), 1 << 30).unwrap()
}

/// Voxels of edge 1 at integer world positions.
pub fn unit() -> Affine {
    Affine::uniform(1.0, DVec3::ZERO).unwrap()
}

/// Sheared, mirrored, non-uniform, shifted.
pub fn odd() -> Affine {
    let linear = DMat3::from_cols(DVec3::new(-0.7, 0.1, 0.05), DVec3::new(0.2, 1.3, -0.1), DVec3::new(0.0, 0.3, 0.45));
    Affine::new(DMat4::from_mat3_translation(linear, DVec3::new(3.0, -7.0, 11.0))).unwrap()
}

/// A cheap hash to 0..1, the same everywhere.
pub fn noise(seed: u64) -> f64 {
    let mut h = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0xD1B5_4A32_D192_ED03;
    h = (h ^ (h >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    h = (h ^ (h >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((h ^ (h >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// A number from -1 to 1 from a hash.
pub fn signed(seed: u64) -> f64 {
    2.0 * noise(seed) - 1.0
}

pub fn vector(seed: u64) -> DVec3 {
    DVec3::new(signed(seed), signed(seed + 1), signed(seed + 2))
}

/// A smooth positive bump field, irregular enough to have no symmetry.
pub fn lumps(n: i32) -> impl Fn(DVec3) -> f64 {
    move |p| {
        let q = p / f64::from(n);
        let blob = |c: DVec3, s: f64| (-(q - c).length_squared() / (2.0 * s * s)).exp();
        let wave = 1.0 + 0.5 * (9.0 * q.x + 4.0 * q.y * q.y).sin() * (7.0 * q.z - 3.0 * q.x).cos();
        let edge = |c: f64| (c * (1.0 - c) * 8.0).clamp(0.0, 1.0);
        (blob(DVec3::new(0.4, 0.5, 0.45), 0.16) + 0.6 * blob(DVec3::new(0.65, 0.4, 0.6), 0.1))
            * wave
            * edge(q.x)
            * edge(q.y)
            * edge(q.z)
    }
}

/// A pre-shaded volume of lumps: emissions of three tints, and extinctions `thick` times the density.
pub fn tinted<R: Real>(n: i32, thick: f64, transform: Affine) -> Bricks<R::Lanes> {
    let density: Bricks<R> = field(n, transform, lumps(n));
    let mut volume = Bricks::<R::Lanes>::zeros(density.topology.clone(), transform);
    for (v, d) in volume.values.iter_mut().zip(&density.values) {
        // Apron copies must agree: the tint follows the density, not the slot.
        let tint = |k: f64| R::of(d.f64() * (1.0 + 0.5 * (k * 9.0 * d.f64()).sin()));
        *v = R::Lanes::load([tint(1.0), tint(2.0), tint(3.0), R::of(thick * d.f64())]);
    }
    volume
}

/// Lumps, and zeros around them: some of the functions absorb there.
pub fn cloud<R: Real>(n: i32) -> Bricks<R> {
    field(n, odd(), lumps(n)).filled(1 << 30).unwrap()
}

/// Peaks, a plateau, a transparent gap; densities of [`lumps`] go up to about 1.2.
pub fn kinds() -> Vec<Transfer> {
    let texel = |i: usize| {
        let d = (i as f64 + 0.5) / 12.0;
        [d, 1.0 - d, 0.5 + 0.4 * (9.0 * d).sin(), 1.5 * (8.0 * d).sin().powi(2)]
    };
    vec![
        Transfer::Texture { domain: [0.0, 1.0], texels: (0..12).map(texel).collect() },
        Transfer::Piecewise {
            points: vec![
                [0.05, 1.0, 0.0, 0.0, 0.0],
                [0.2, 1.0, 0.5, 0.0, 2.0],
                [0.3, 0.5, 0.5, 0.5, 0.0],
                [0.5, 0.5, 0.5, 0.5, 0.0],
                [0.7, 0.0, 0.2, 1.0, 3.0],
            ],
        },
        Transfer::Gaussians {
            domain: [0.0, 1.0],
            lobes: vec![
                Lobe { mean: 0.25, ln_width: -3.0, rgbs: [1.0, 0.6, 0.1, 1.0] },
                Lobe { mean: 0.7, ln_width: -2.0, rgbs: [0.1, 0.3, 0.9, 2.0] },
            ],
        },
        Transfer::Identity { domain: [0.0, 0.9], color: [0.9, 0.6, 0.3] },
    ]
}

/// Rays from a sphere around the field's box towards points inside it.
pub fn rays(field_bounds: cumulo::math::Aabb, count: u64, seed: u64) -> Vec<Ray> {
    let (centre, size) = (field_bounds.centre(), field_bounds.size());
    (0..count)
        .map(|i| {
            let r = |k: u64| noise(seed.wrapping_add(i * 16 + k)) - 0.5;
            let target = centre + size * DVec3::new(r(0), r(1), r(2)) * 0.8;
            let from = DVec3::new(r(3), r(4), r(5)).normalize() * size.length();
            Ray::new(centre + from, (target - centre - from).normalize())
        })
        .collect()
}

/// Fails unless two ways to a pixel give the same bits; of the rules with a step, which add up samples in another order
/// where values alone are wanted, numbers that rounding tells apart.
#[allow(dead_code, reason = "not every test program compares pixels")]
pub fn assert_same<R: Real>(rule: Quadrature, seen: Pixel<R>, expected: Pixel<R>) {
    if !matches!(rule, Quadrature::Midpoint(_) | Quadrature::Riemann(_)) {
        assert_eq!(seen, expected, "{rule}");
        return;
    }
    let close = |a: f64, b: f64| (a - b).abs() <= 64.0 * R::EPSILON.f64() * b.abs().max(1.0);
    let rgba = seen.rgba().into_iter().zip(expected.rgba()).all(|(a, b)| close(a.f64(), b.f64()));
    assert!(rgba && close(seen.depth, expected.depth), "{rule}: {seen:?} is not {expected:?}");
}
