//! Values of any sign and background through functions in the data's own units: default quadrature against the exact one,
//! shifts of data and function, and a background against the same voxels stored.

use crate::common::fields::{grid, lumps, noise, odd, rays, unit};
use crate::path_tracing::estimate;
use cumulo::math::{Affine, Ray};
use cumulo::real::Real;
use cumulo::render::composited::Composited;
use cumulo::render::dvr::{Dvr, Precision};
use cumulo::render::path::PathTracer;
use cumulo::render::quadrature::Quadrature;
use cumulo::scene::bricks::Bricks;
use cumulo::scene::environment::Environment;
use cumulo::scene::grid::{Grid, GridClass};
use cumulo::scene::medium::{Medium, Scattering, Source};
use cumulo::scene::phase::Phase;
use cumulo::scene::scene::Scene;
use cumulo::scene::table::Table;
use cumulo::scene::volume::Volume;
use glam::DVec3;
use std::sync::Arc;

const BACKGROUND: [f32; 3] = [0.5, 0.25, 0.125];
const VOXELS: i32 = 20;

/// A grid of no class with a background, of which only voxels of other values are active where it is sparse.
fn of_background(background: f32, sparse: bool, map: Affine, value: impl Fn(DVec3) -> f64) -> Grid {
    let mut made = Grid { class: GridClass::Unknown, background, ..grid(VOXELS, map, value) };
    for leaf in &mut made.leaves {
        for i in 0..512 {
            if leaf.active[i >> 6] >> (i & 63) & 1 == 0 {
                leaf.values[i] = background;
            } else if sparse && leaf.values[i] == background {
                leaf.active[i >> 6] &= !(1 << (i & 63));
            }
        }
    }
    if sparse {
        made.leaves.retain(|leaf| leaf.active != [0; 8]);
    }
    made
}

/// Bricks that end at the outermost voxels, as programs arrange them for a function.
fn arranged<R: Real>(grid: &Grid) -> Bricks<R> {
    let mut field = Bricks::instanced_values(grid, 1 << 30).unwrap();
    field.domain = grid.active_box();
    field.filled(1 << 30).unwrap()
}

/// A piecewise function of so many points over a range, clear in parts.
fn function(seed: u64, [first, last]: [f64; 2]) -> Table {
    let r = |k: u64| noise(seed.wrapping_mul(1 << 20).wrapping_add(k));
    let count = 2 + (r(0) * r(0) * 60.0) as u64;
    let mut knots: Vec<f64> = (0..count).map(|k| first + (last - first) * r(100 + k)).collect();
    knots.sort_by(f64::total_cmp);
    let point = |k: u64| {
        let extinction = if r(1004 + 8 * k) < 0.4 { 0.0 } else { r(1005 + 8 * k) };
        [r(1000 + 8 * k), r(1001 + 8 * k), r(1002 + 8 * k), extinction]
    };
    Table::new(knots, (0..count).map(point).collect()).unwrap()
}

fn medium(table: Table, extinction: f64) -> Medium {
    Medium::new(extinction, Source::Transfer(Arc::new(table)))
}

fn light<R: Precision>(field: &Bricks<R>, medium: &Medium, rule: Quadrature, rays: &[Ray]) -> Vec<[f64; 4]> {
    let double = R::of(1.0 / 3.0).f64() == 1.0 / 3.0;
    let dvr: Composited<_> = Dvr::new(field, medium.clone())
        .unwrap()
        .quadrature(rule)
        .tolerance(if double { 1e-11 } else { 4e-7 })
        .early_stop(if double { 0.0 } else { 1e-6 })
        .over(BACKGROUND);
    rays.iter().map(|ray| dvr.pixel(ray).rgba().map(Real::f64)).collect()
}

/// Mean of the squared differences, and the largest difference.
fn apart(a: &[[f64; 4]], b: &[[f64; 4]]) -> [f64; 2] {
    let pairs = || a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b).abs());
    [pairs().map(|d| d * d).sum::<f64>() / pairs().count() as f64, pairs().fold(0.0, f64::max)]
}

/// Values about a middle, smooth or noisy.
fn shape(seed: u64, [low, high]: [f64; 2]) -> impl Fn(DVec3) -> f64 {
    let (smooth, noisy) = (lumps(VOXELS), seed % 2 == 1);
    move |p: DVec3| {
        let voxel = noise(seed ^ ((p.x as u64) << 40 | (p.y as u64) << 20 | p.z as u64).wrapping_mul(31));
        let wave = 0.5 + 0.5 * (0.45 * p.x + 0.1 * seed as f64).sin() * (0.3 * p.y).cos() * (0.2 * p.z + 1.0).sin();
        let share = 0.6 * wave + 0.33 * smooth(p) + if noisy { 0.3 * (voxel - 0.5) } else { 0.0 };
        low + (high - low) * share
    }
}

/// A hundred functions over signed values of many ranges: the default quadrature in single precision against the exact
/// one in double is good for 60 dB of the brightest color, and for what it states.
#[test]
fn random_functions_of_signed_values_have_sixty_decibels() {
    let ranges =
        [[-1.0, 1.0], [-1000.0, 3000.0], [-3024.0, 3071.0], [-32768.0, 32767.0], [1e6, 1e6 + 40.0], [-9.0, -8.9]];
    let (mut sum, mut worst) = (0.0, [f64::INFINITY, 0.0]);
    let (mut by_tables, mut seen) = (0, 0);
    for seed in 0..100_u64 {
        let range = ranges[seed as usize % ranges.len()];
        let [background, map] = [range[0], seed as f64];
        let map = if map % 4.0 < 2.0 { unit() } else { odd() };
        let made = of_background(background as f32, false, map, shape(seed, range));
        let (wide, narrow) = (arranged::<f64>(&made), arranged::<f32>(&made));
        let width = range[1] - range[0];
        let table = function(seed, [range[0] - 0.1 * width, range[1] + 0.1 * width]);
        let medium = medium(table, 10_f64.powf(2.0 * noise(seed + 7) - 1.5));
        let rays = rays(narrow.world_bounds(), 120, seed);
        let exact = light(&wide, &medium, Quadrature::Exact, &rays);
        let usual = Quadrature::usual(&medium.source);
        // Of the brightest of function, background and alpha, which is 1 at least.
        let stated = if let Quadrature::Preintegrated(tolerance) = usual { tolerance } else { 0.0 };
        let [square, largest] = apart(&light(&narrow, &medium, usual, &rays), &exact);
        let decibels = -10.0 * square.log10();
        assert!(largest <= stated + 4e-5, "{seed}, {range:?}: off by {largest:.1e}, {stated:.0e} stated");
        assert!(decibels >= 60.0, "{seed}, {range:?}: {decibels:.1} dB");
        let [_, tabled] = apart(&light(&narrow, &medium, Quadrature::PREINTEGRATED, &rays), &exact);
        assert!(tabled <= 1e-2 + 4e-5, "{seed}, {range:?}: pre-integration is off by {tabled:.1e}");
        let [_, single] = apart(&light(&narrow, &medium, Quadrature::Exact, &rays), &exact);
        assert!(single < 4e-5, "{seed}, {range:?}: exact quadrature in f32 is off by {single:.1e}");
        by_tables += usize::from(stated > 0.0);
        let opacity = exact.iter().map(|rgba| rgba[3]).sum::<f64>() / exact.len() as f64;
        seen += usize::from((0.02..0.98).contains(&opacity));
        sum += square;
        worst = [worst[0].min(decibels), worst[1].max(largest)];
    }
    // Both default rules have their share, and most draws are neither empty nor solid.
    assert!(by_tables >= 15 && seen >= 60, "{by_tables} by tables, {seen} seen");
    println!(
        "{:.1} dB together, at least {:.1} dB, off by {:.1e} at most; {by_tables} by tables, {seen} half-seen",
        -10.0 * (sum / 100.0).log10(),
        worst[0],
        worst[1]
    );
}

/// Voxels that are exact in single precision whatever the shift.
fn sixteenths(seed: u64) -> impl Fn(DVec3) -> f64 {
    let shape = shape(seed, [-40.0, 60.0]);
    move |p| (16.0 * shape(p)).round() / 16.0
}

fn shifted(table: &Table, by: f64) -> Table {
    Table::new(table.knots().iter().map(|knot| knot + by).collect(), table.values().to_vec()).unwrap()
}

/// A constant that is added to data and function leaves pictures but for rounding, however large it is.
#[test]
fn shifts_of_data_and_function_change_rounding_alone() {
    for seed in 0..6 {
        let value = sixteenths(seed);
        let table = function(seed + 40, [-50.0, 70.0]);
        let at = |shift: f64| {
            let made = of_background((shift - 40.0) as f32, false, odd(), |p| value(p) + shift);
            let medium = medium(shifted(&table, shift), 0.2);
            let (wide, narrow) = (arranged::<f64>(&made), arranged::<f32>(&made));
            let rays = rays(narrow.world_bounds(), 60, seed);
            let of = |rule| (light(&wide, &medium, rule, &rays), light(&narrow, &medium, rule, &rays));
            [Quadrature::Exact, Quadrature::PREINTEGRATED, Quadrature::Midpoint(0.4)].map(of)
        };
        let plain = at(0.0);
        for shift in [-1000.0, 40.0, 32_000.0, -500_000.0] {
            for (rule, ((wide, narrow), (wide_plain, narrow_plain))) in at(shift).iter().zip(&plain).enumerate() {
                let ([_, double], [_, single]) = (apart(wide, wide_plain), apart(narrow, narrow_plain));
                // Nodes of pre-integration are placed by estimates that rounding may tip over: what it states holds.
                let [double_limit, single_limit] = if rule == 1 { [1e-3; 2] } else { [1e-8, 1e-4] };
                assert!(double < double_limit, "{seed}, {shift}, rule {rule}: {double:.1e} in f64");
                assert!(single < single_limit, "{seed}, {shift}, rule {rule}: {single:.1e} in f32");
            }
        }
    }
}

/// A sphere of signed values in air.
fn body(p: DVec3) -> f64 {
    let r = (p - DVec3::splat(9.3)).length();
    match r {
        r if r > 7.5 => -1000.0,
        // The outermost voxels span the box of the air.
        _ => (1500.0 - 260.0 * r + 80.0 * (0.9 * p.x).sin()).round(),
    }
}

/// Air that is a background is the air that is stored, to the bit with all rules, whether the function shows it or not.
#[test]
fn a_background_is_the_same_air_as_voxels() {
    let (sparse, mut dense) = (of_background(-1000.0, true, odd(), body), of_background(-1000.0, false, odd(), body));
    // The air of one ends where that of the other does.
    let bounds = sparse.active_box();
    assert!(sparse.leaves.len() < dense.leaves.len() && bounds.max.max_element() < f64::from(VOXELS - 1));
    dense.background = 0.0;
    let fields = |grid: &Grid| {
        let mut field: Bricks<f32> = Bricks::instanced_values(grid, 1 << 30).unwrap();
        field.domain = bounds;
        field
    };
    for (shown, filled) in [(0.0, false), (0.3, true)] {
        let knots = vec![-1000.0, -600.0, -200.0, 300.0, 1500.0];
        let values =
            [[0.2, 0.4, 0.9, shown], [0.5, 0.5, 0.5, 0.0], [0.9, 0.3, 0.2, 0.1], [1.0, 0.9, 0.7, 0.6], [1.0; 4]];
        let medium = medium(Table::new(knots, values.to_vec()).unwrap(), 0.7);
        let (a, b) = (fields(&sparse), fields(&dense));
        assert_eq!(Dvr::new(&a, medium.clone()).is_err(), filled && !a.is_filled(), "bricks of the air are needed");
        let (a, b) = if filled { (a.filled(1 << 30).unwrap(), b.filled(1 << 30).unwrap()) } else { (a, b) };
        let rays = rays(a.world_bounds(), 200, 5);
        for rule in [Quadrature::Exact, Quadrature::PREINTEGRATED, Quadrature::Midpoint(0.4), Quadrature::Riemann(0.6)]
        {
            let [_, largest] = apart(&light(&a, &medium, rule, &rays), &light(&b, &medium, rule, &rays));
            assert!(largest <= if rule == Quadrature::PREINTEGRATED { 1e-3 } else { 1e-6 }, "{rule}: {largest:.1e}");
        }
        // Outside of the bricks the air goes on.
        assert_eq!(a.sample(DVec3::splat(-50.0)), -1000.0);
    }
}

/// Paths through both, and through the same values and function moved to densities: differences of means in standard
/// errors, and no majorant is violated.
#[test]
fn paths_see_the_same_air_and_the_same_values() {
    let scene = |grid: &Grid, bounds, table: Table| {
        let mut field: Bricks<f32> = Bricks::instanced_values(grid, 1 << 30).unwrap();
        field.domain = bounds;
        let scattering =
            Scattering { gradient_shading: Some(300.0), ..Scattering::new([0.8, 0.7, 0.6], Phase::Isotropic) };
        let medium = Medium { scattering: Some(scattering), ..medium(table, 0.4) };
        let environment = Environment::constant([1.0, 0.8, 0.6]);
        Scene { volumes: vec![Volume::Density(field, medium)], environment, ..Scene::default() }
    };
    let table = |shift: f64| {
        let knots = [-1000.0, -300.0, 0.0, 700.0, 1500.0].map(|k| k + shift).to_vec();
        let values = [[0.0; 4], [0.5, 0.5, 0.5, 0.0], [0.9, 0.3, 0.2, 0.3], [1.0, 0.9, 0.7, 0.6], [1.0; 4]];
        Table::new(knots, values.to_vec()).unwrap()
    };
    let sparse = of_background(-1000.0, true, unit(), body);
    let bounds = sparse.active_box();
    let dense = Grid { background: 0.0, ..of_background(-1000.0, false, unit(), body) };
    let moved = of_background(0.0, true, unit(), |p| body(p) + 1000.0);
    let far = of_background(999_000.0, true, unit(), |p| body(p) + 1e6);
    let scenes =
        [(&sparse, 0.0), (&dense, 0.0), (&moved, 1000.0), (&far, 1e6)].map(|(grid, by)| scene(grid, bounds, table(by)));
    let field = scenes[0].volumes[0].density().unwrap().0;
    let rays = rays(field.world_bounds(), 6, 3);
    let seen = scenes.each_ref().map(|scene| {
        let tracer = PathTracer::new(scene).unwrap();
        rays.iter().map(|ray| estimate(&tracer, ray, 64)).collect::<Vec<_>>()
    });
    for other in &seen[1..] {
        for (a, b) in seen[0].iter().flatten().zip(other.iter().flatten()) {
            let z = (a[0] - b[0]).abs() / (a[1] + b[1] + (1e-5 * b[0]).powi(2) + 1e-30).sqrt();
            assert!(z < 4.5, "{z} standard errors: {a:?} {b:?}");
        }
    }
}

/// Without a function values are densities, which have no sign and no background.
#[test]
fn media_without_a_function_refuse_other_values() {
    let made = of_background(-1000.0, true, unit(), body);
    assert!(Bricks::<f32>::from_grid(&made, 1 << 30).unwrap_err().to_string().contains("background is -1000"));
    let signed = Grid { background: 0.0, ..made.clone() };
    let error = Bricks::<f32>::instanced(&signed, 1 << 30).unwrap_err().to_string();
    assert!(error.contains("negative") && error.contains("transfer function"), "{error}");
    let field: Bricks<f32> = Bricks::from_values(&made, 1 << 30).unwrap();
    assert!(Dvr::new(&field, Medium::absorbing(1.0)).unwrap_err().to_string().contains("transfer function"));
    for bad in [f32::NAN, f32::INFINITY] {
        let mut broken = made.clone();
        broken.leaves[0].values[3] = bad;
        assert!(Bricks::<f32>::from_values(&broken, 1 << 30).unwrap_err().to_string().contains("1 values"));
        let outside = Grid { background: bad, ..made.clone() };
        assert!(Bricks::<f32>::from_values(&outside, 1 << 30).unwrap_err().to_string().contains("background"));
    }
}
