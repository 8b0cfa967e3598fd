//! Forward mode: its value is the value, it is the adjoint's transpose for every kind of parameter, and it
//! matches central differences.

use crate::common::fields::{assert_same, cloud, field, kinds, noise, rays, signed, unit, vector};
use cumulo::math::{Aabb, Ray};
use cumulo::real::Real;
use cumulo::render::composited::{Composited, Pixel};
use cumulo::render::differentiable::{Accumulators, Adjoint, ParameterGradient, RayGradient, Seeds};
use cumulo::render::dvr::{Directions, Dvr, Tape};
use cumulo::render::quadrature::Quadrature;
use cumulo::scene::blur::Blur;
use cumulo::scene::bricks::Bricks;
use cumulo::scene::camera::{Camera, CameraGradient, Projection};
use cumulo::scene::medium::{Medium, Source};
use cumulo::scene::table::TableGradient;
use cumulo::scene::transfer::Transfer;
use glam::{DVec2, DVec3};
use std::sync::Arc;

const BACKGROUND: [f32; 3] = [0.5, 0.25, 0.125];
const RULES: [Quadrature; 4] =
    [Quadrature::Exact, Quadrature::Preintegrated(10.0), Quadrature::Midpoint(0.4), Quadrature::Riemann(0.7)];

fn sources() -> Vec<Source> {
    let tables = kinds().into_iter().map(|t| Source::Transfer(Arc::new(t.table().unwrap())));
    [Source::Grey([0.6, 0.3, 0.8]), Source::Linear([0.5, 1.5, 0.2])].into_iter().chain(tables).collect()
}

/// Up, down, and up from nothing, in all channels.
fn steps() -> Transfer {
    let point = |density: f64, v: f64| [density, v, 1.0 - v, 0.5 * v, 0.4 * v];
    let points = [(0.1, 0.0), (0.1, 0.5), (0.3, 0.9), (0.3, 0.2), (0.55, 0.4), (0.55, 0.0), (0.7, 0.0), (0.7, 1.0)];
    Transfer::Piecewise { points: points.map(|(density, v)| point(density, v)).to_vec() }
}

fn is_double<R: Real>() -> bool {
    R::EPSILON.f64() < 1e-10
}

fn dvr<R: Real>(f: &Bricks<R>, medium: Medium, rule: Quadrature) -> Composited<Dvr<'_, R>> {
    let tolerance = if is_double::<R>() { 1e-11 } else { 4e-7 };
    Dvr::new(f, medium).unwrap().quadrature(rule).tolerance(tolerance).early_stop(0.0).over(BACKGROUND)
}

/// Not zero where its domain ends: entry and exit count. It ends inside of bricks.
fn cut<R: Real>() -> Bricks<R> {
    let mut f = field(16, unit(), |p| 0.5 + 0.02 * p.x + 0.01 * p.y * p.z / 16.0);
    f.domain = Aabb { min: DVec3::ZERO, max: DVec3::splat(15.0) };
    f
}

/// One kind of parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Voxels,
    Table,
    Origin,
    Direction,
    Step,
    Extinction,
    Color,
    Background,
    All,
}

const KINDS: [Kind; 9] = [
    Kind::Voxels,
    Kind::Table,
    Kind::Origin,
    Kind::Direction,
    Kind::Step,
    Kind::Extinction,
    Kind::Color,
    Kind::Background,
    Kind::All,
];

/// A direction in all parameters of a kind.
struct Step<R> {
    voxels: Option<Vec<R>>,
    table: Option<TableGradient>,
    ray: RayGradient,
    shared: ParameterGradient,
}

fn step<R: Real>(kind: Kind, f: &Bricks<R>, medium: &Medium, seed: u64) -> Step<R> {
    let is = |k: Kind| if kind == k || kind == Kind::All { 1.0 } else { 0.0 };
    let voxels = (0..f.values.len() as u64).map(|i| R::of(signed(seed ^ (i << 20)))).collect();
    let table = match &medium.source {
        Source::Transfer(table) => {
            let mut by = TableGradient::zeros(table);
            by.pieces.iter_mut().flatten().flatten().enumerate().for_each(|(i, v)| *v = signed(seed + i as u64));
            by.steps.iter_mut().enumerate().for_each(|(i, v)| *v = signed(seed + 500 + i as u64));
            Some(by)
        }
        _ => None,
    };
    let plain = f64::from(u8::from(table.is_none()));
    Step {
        voxels: (is(Kind::Voxels) > 0.0).then_some(voxels),
        table: table.filter(|_| is(Kind::Table) > 0.0),
        ray: RayGradient {
            origin: is(Kind::Origin) * vector(seed),
            direction: is(Kind::Direction) * vector(seed + 3),
            step: is(Kind::Step) * signed(seed + 6),
        },
        shared: ParameterGradient {
            extinction: is(Kind::Extinction) * signed(seed + 7),
            color: [1.0, -0.5, 2.0].map(|c| c * is(Kind::Color) * plain),
            background: [0.3, 0.7, -1.1].map(|c| c * is(Kind::Background)),
        },
    }
}

fn seeds<'s, R: Real, const P: usize>(steps: &'s [Step<R>]) -> Seeds<'s, R, P> {
    Seeds {
        ray: std::array::from_fn(|p| steps[p].ray),
        voxels: std::array::from_fn(|p| steps[p].voxels.as_deref()),
        table: std::array::from_fn(|p| steps[p].table.as_ref()),
        shared: std::array::from_fn(|p| steps[p].shared),
    }
}

/// `⟨J v, w⟩` and `⟨v, Jᵀ w⟩` of one ray, and what rounding is relative to: the sum of the magnitudes that
/// either is added up from.
fn both<R: Directions<2>>(
    (dvr, rule): (&Composited<Dvr<'_, R>>, Quadrature),
    ray: &Ray,
    number: u64,
    steps: &[Step<R>],
) -> [[f64; 3]; 2] {
    let w: [f64; 4] = std::array::from_fn(|c| signed(1000 + 4 * number + c as u64));
    let mut tape = Tape::default();
    let pushed = dvr.jvp::<2>(ray, &seeds(steps), &mut tape);
    // The value of the tangent is the value.
    assert_same(rule, pushed.pixel(), dvr.pixel(ray));
    let first = &steps[0];
    let mut voxels = first.voxels.as_ref().map(|v| vec![R::ZERO; v.len()]);
    let mut table = first.table.as_ref().map(|t| TableGradient::of_knots(t.steps.len()));
    let (mut moved, mut shared) = (RayGradient::default(), ParameterGradient::default());
    let follows = first.ray != RayGradient::default();
    let sinks = Accumulators {
        voxels: voxels.as_deref_mut(),
        table: table.as_mut(),
        ray: follows.then_some(&mut moved),
        shared: &mut shared,
    };
    dvr.vjp(ray, &mut |_: &Pixel<R>| w.map(R::of), Adjoint::Tape, sinks, &mut tape);
    std::array::from_fn(|p| {
        let Step { voxels: v, table: t, ray: r, shared: s } = &steps[p];
        let mut terms = vec![moved.step * r.step, shared.extinction * s.extinction];
        terms.extend((0..3).flat_map(|a| [moved.origin[a] * r.origin[a], moved.direction[a] * r.direction[a]]));
        terms.extend((0..3).flat_map(|c| [shared.color[c] * s.color[c], shared.background[c] * s.background[c]]));
        if let (Some(g), Some(v)) = (&voxels, v) {
            terms.extend(g.iter().zip(v).map(|(g, v)| g.f64() * v.f64()));
        }
        if let (Some(g), Some(t)) = (&table, t) {
            terms.extend(
                g.pieces.iter().flatten().flatten().zip(t.pieces.iter().flatten().flatten()).map(|(g, t)| g * t),
            );
            terms.extend(g.steps.iter().zip(&t.steps).map(|(g, t)| g * t));
        }
        let left = pushed.rgba().into_iter().zip(w).map(|(c, w)| w * c.tangent[p].f64());
        let left: Vec<f64> = left.collect();
        let size: f64 = terms.iter().chain(&left).map(|t| t.abs()).sum();
        [left.iter().sum(), terms.iter().sum(), size]
    })
}

fn the_identity_holds<R: Directions<2>>(fields: &[Bricks<R>], relative: f64) {
    let mut worst = 0.0_f64;
    for f in fields {
        let mut rays = rays(f.world_bounds(), 12, 5);
        rays.push(Ray::new(f.world_bounds().centre(), DVec3::new(0.3, 0.5, 0.8).normalize()));
        let steps = Source::Transfer(Arc::new(steps().table().unwrap()));
        for source in sources().into_iter().chain([steps]) {
            let medium = Medium::new(0.8, source);
            for rule in RULES {
                let dvr = dvr(f, medium.clone(), rule);
                for kind in KINDS {
                    let steps = [3, 70_001].map(|seed| step(kind, f, &medium, seed));
                    let (mut off, mut sizes) = (0.0, 0.0);
                    for (i, ray) in rays.iter().enumerate() {
                        for [left, right, size] in both((&dvr, rule), ray, i as u64, &steps) {
                            off += (left - right).abs();
                            sizes += size;
                        }
                    }
                    // A ray's terms are of order 1, and rounded as such. By the step they all but cancel: a
                    // longer one sees the same light.
                    let floor = if kind == Kind::Step { 1.0 } else { 0.01 } * rays.len() as f64;
                    let error = off / sizes.max(floor);
                    worst = worst.max(error);
                    assert!(error <= relative, "{rule} {:?} {kind:?}: off by {error:.1e} of {sizes}", medium.source);
                }
            }
        }
    }
    assert!(worst > 0.0, "something was compared");
}

#[test]
fn the_tangent_is_the_adjoints_transpose() {
    the_identity_holds::<f64>(&[cloud(14), cut()], 1e-12);
    the_identity_holds::<f32>(&[cloud(14), cut()], 1e-5);
}

/// A direction's derivative does not depend on what stands beside it, nor on how many there are.
#[test]
fn directions_do_not_see_each_other() {
    fn check<R: Directions<1> + Directions<2> + Directions<6> + Directions<7>>() {
        let f: Bricks<R> = cloud(14);
        for source in sources() {
            let medium = Medium::new(0.8, source);
            let steps: Vec<Step<R>> =
                (0..7).map(|i| step(KINDS[[8, 1, 4, 0, 8, 5, 3][i]], &f, &medium, 31 * i as u64)).collect();
            let dvr = dvr(&f, medium.clone(), Quadrature::Midpoint(0.4));
            let mut tape = Tape::default();
            for ray in rays(f.world_bounds(), 4, 6) {
                let seven = dvr.jvp::<7>(&ray, &seeds(&steps), &mut tape).rgba();
                let six = dvr.jvp::<6>(&ray, &seeds(&steps), &mut tape).rgba();
                for c in 0..4 {
                    assert_eq!(six[c].tangent, seven[c].tangent[..6]);
                }
                // Table seeds decide which bricks are walked: the first direction has all, like the seven.
                let one = dvr.jvp::<1>(&ray, &seeds(&steps), &mut tape).rgba();
                for c in 0..4 {
                    assert_eq!(one[c].tangent[0], seven[c].tangent[0]);
                }
            }
        }
    }
    check::<f64>();
    check::<f32>();
}

#[test]
fn what_misses_the_volume_sees_the_background() {
    let f: Bricks<f64> = cloud(14);
    let dvr = dvr(&f, Medium::absorbing(1.0), Quadrature::Exact);
    let ray = Ray::new(f.world_bounds().max + 10.0, DVec3::X);
    let mut seeds: Seeds<'_, f64, 2> = Seeds::default();
    seeds.shared[1].background = [1.0, 2.0, 3.0];
    seeds.shared[0].extinction = 1.0;
    let seen = dvr.jvp(&ray, &seeds, &mut Tape::default());
    assert_eq!(seen.pixel(), dvr.pixel(&ray));
    assert_eq!(seen.rgb.map(|c| c.tangent), [[0.0, 1.0], [0.0, 2.0], [0.0, 3.0]]);
    assert_eq!(seen.transmittance.tangent, [0.0; 2]);
}

fn stepped(rule: Quadrature, h: f64) -> Quadrature {
    match rule {
        Quadrature::Exact | Quadrature::Preintegrated(_) => rule,
        Quadrature::Midpoint(s) => Quadrature::Midpoint(s + h),
        Quadrature::Riemann(s) => Quadrature::Riemann(s + h),
    }
}

/// Along one direction in each kind of parameter, every channel of every ray; the transfer function's by its
/// own parameters, knots included.
#[test]
fn tangents_match_central_differences() {
    let f: Bricks<f64> = cloud(14);
    let rays = rays(f.world_bounds(), 10, 2);
    let (voxels, h) = ((0..f.values.len() as u64).map(|i| noise(i << 20)).collect::<Vec<f64>>(), 1e-7);
    for transfer in kinds() {
        let of = |t: &Transfer| Source::Transfer(Arc::new(t.table().unwrap()));
        let parameters: Vec<f64> = transfer.parameters().iter().map(|p| p.1).collect();
        // Upward, so that nothing becomes negative; knots stay in their order.
        let by: Vec<f64> = (0..parameters.len()).map(|i| noise(i as u64)).collect();
        let table = transfer.push(&by).unwrap();
        for rule in RULES {
            let mut missed = 0;
            for (i, ray) in rays.iter().enumerate() {
                let (o, turn) = (vector(i as u64), vector(9 * i as u64));
                let across = turn - ray.direction * ray.direction.dot(turn);
                let mut seeds: Seeds<'_, f64, 7> = Seeds::default();
                seeds.ray[0].origin = o;
                seeds.ray[1].direction = across;
                seeds.ray[2].step = 1.0;
                seeds.voxels[3] = Some(&voxels);
                seeds.table[4] = Some(&table);
                seeds.shared[5].extinction = 1.0;
                let at = |p: usize, h: f64| {
                    let only = |q: usize| if p == q { h } else { 0.0 };
                    let mut moved = f.clone();
                    moved.values.iter_mut().zip(&voxels).for_each(|(v, by)| *v += only(3) * by);
                    let changed: Vec<f64> = parameters.iter().zip(&by).map(|(v, by)| v + only(4) * by).collect();
                    let source = of(&transfer.with_parameters(&changed));
                    let ray = Ray::new(ray.origin + only(0) * o, (ray.direction + only(1) * across).normalize());
                    let medium = Medium::new(0.8 + only(5), source);
                    dvr(&moved, medium, stepped(rule, only(2))).pixel(&ray).rgba()
                };
                let found = dvr(&f, Medium::new(0.8, of(&transfer)), rule);
                let found = found.jvp(ray, &seeds, &mut Tape::default()).rgba();
                for p in 0..6 {
                    // From above alone, to second order, where less is no density or no function.
                    let one_sided = p == 3 || p == 4;
                    let [a, b, c] = if one_sided { [0.0, h, 2.0 * h] } else { [-h, 0.0, h] }.map(|h| at(p, h));
                    for k in 0..4 {
                        let expected = if one_sided { 4.0 * b[k] - c[k] - 3.0 * a[k] } else { c[k] - a[k] } / (2.0 * h);
                        let got = found[k].tangent[p];
                        // Rounding of the value, 1e-16 over h, and of the quadrature's own tolerance.
                        let error = (got - expected).abs() / expected.abs().max(got.abs()).max(1e-2);
                        if error > 3e-5 {
                            missed += 1;
                            // Uniform samples may step across a kink: then the difference is not the derivative.
                            let kinks = if rule == Quadrature::Exact { 0 } else { 8 };
                            assert!(missed <= kinks, "{rule} {transfer:?} {p} ray {i} channel {k}: {got} {expected}");
                        }
                    }
                }
            }
        }
    }
}

/// A pixel by its camera: derivatives of a ray's beginning and direction, put into the tangent, are those of
/// what is seen.
#[test]
fn pixels_follow_their_camera() {
    let f: Bricks<f64> = cut();
    let camera = Camera {
        camera_to_world: Camera::look_at(DVec3::new(40.0, -20.0, 25.0), DVec3::splat(7.5), DVec3::Z),
        projection: Projection::Perspective,
        focal: DVec2::new(60.0, 65.0),
        centre: DVec2::new(16.0, 12.0),
        width: 32,
        height: 24,
        near: 0.1,
        blur: Blur::default(),
    };
    let transfer = &kinds()[1];
    let medium = Medium::new(0.3, Source::Transfer(Arc::new(transfer.table().unwrap())));
    let dvr = dvr(&f, medium, Quadrature::Exact);
    let by = |p: usize| {
        let mut by = CameraGradient::default();
        match p {
            0..3 => by.position[p] = 1.0,
            3..6 => by.rotation[p - 3] = 1.0,
            _ => by.focal.x = 1.0,
        }
        by
    };
    let mut seen_something = false;
    for (x, y) in [(16.5, 12.5), (10.2, 8.9), (20.5, 15.5), (25.0, 6.0)] {
        let mut seeds: Seeds<'_, f64, 7> = Seeds::default();
        for p in 0..7 {
            let Ray { origin, direction, .. } = camera.tangent(x, y, &by(p));
            seeds.ray[p] = RayGradient { origin, direction, step: 0.0 };
        }
        let found = dvr.jvp(&camera.ray(x, y), &seeds, &mut Tape::default()).rgba();
        for p in 0..7 {
            let at = |h: f64| {
                let step = by(p);
                let step = CameraGradient {
                    position: h * step.position,
                    rotation: h * step.rotation,
                    focal: h * step.focal,
                    centre: h * step.centre,
                };
                dvr.pixel(&camera.moved(&step).ray(x, y)).rgba()
            };
            let (up, down) = (at(1e-6), at(-1e-6));
            for c in 0..4 {
                let (got, expected) = (found[c].tangent[p], (up[c] - down[c]) / 2e-6);
                assert!((got - expected).abs() < 1e-5 * expected.abs().max(1e-2), "{p} {c}: {got} {expected}");
                seen_something |= got != 0.0;
            }
        }
    }
    assert!(seen_something);
}
