//! Our side of B1 and B2: pictures through a transfer function, and gradients of them by voxel, on the volumes and
//! with the cameras that `python/peers/run_vtk.py` and `run_torch.py` have. One JSON line on stdout.

use super::turns::{in_turn, median};
use cumulo::cancel::Cancel;
use cumulo::differentiate::gradient::pictures::{self, Gradients, Target, Workspace};
use cumulo::formats::limits::Limits;
use cumulo::formats::vdb::File;
use cumulo::math::Aabb;
use cumulo::real::Real;
use cumulo::render::composited::Composited;
use cumulo::render::differentiable::Adjoint;
use cumulo::render::dvr::{Dvr, Precision, Tape};
use cumulo::render::film::{self, Sampling};
use cumulo::render::quadrature::Quadrature;
use cumulo::scene::blur::Blur;
use cumulo::scene::bricks::Bricks;
use cumulo::scene::camera::{Camera, Projection};
use cumulo::scene::medium::{Medium, Source};
use cumulo::scene::table::Table;
use glam::{DVec2, DVec3};
use rayon::ThreadPoolBuilder;
use rayon::prelude::*;
use serde_json::{Value, json};
use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;

/// The arguments by which `python/bench.py` asks for either.
pub const PICTURES: &str = "--pictures";
pub const GRADIENT: &str = "--gradient";

/// Rules that are tried.
const RULES: [&str; 10] = [
    "preintegrated",
    "preintegrated:0.1",
    "exact",
    "midpoint:0.5",
    "midpoint:0.7",
    "midpoint:1",
    "midpoint:1.4",
    "midpoint:2",
    "midpoint:2.8",
    "midpoint:4",
];
/// Pictures of each rule, of which the middle time counts, and seconds after which no further one is begun.
const PICTURES_EACH: usize = 3;
const ENOUGH: f64 = 4.0;
/// Of so many pixels in a row, and of so many rows, one is compared with the exact integral.
const STRIDE: u32 = 8;

fn volume(path: &Path) -> Bricks<f32> {
    let grid = File::open(path, Limits::default()).unwrap().read("density").unwrap().to_grid().unwrap();
    Bricks::from_grid(&grid, u64::MAX).unwrap()
}

/// A perspective camera 2.4 times the box's edge away around z, 0.6 above.
fn camera(edge: f64, centre: DVec3, turn: f64, pixels: u32, field_of_view: f64) -> Camera {
    let eye = centre + edge * DVec3::new(2.4 * turn.cos(), 2.4 * turn.sin(), 0.6);
    let size = DVec2::splat(f64::from(pixels));
    Camera {
        camera_to_world: Camera::look_at(eye, centre, DVec3::Z),
        projection: Projection::Perspective,
        focal: 0.5 * size / (0.5 * field_of_view.to_radians()).tan(),
        centre: 0.5 * size,
        width: pixels,
        height: pixels,
        near: 0.0,
        blur: Blur::default(),
    }
}

/// A function with these knots and extinctions, and the colors of all the functions here.
fn function(knots: Vec<f64>, extinction: impl Fn(f64) -> f64) -> Arc<Table> {
    let value = |x: &f64| [*x, 0.5 + 0.5 * (6.0 * x).sin(), 1.0 - x, extinction(*x)];
    let values = knots.iter().map(value).collect();
    Arc::new(Table::new(knots, values).unwrap())
}

/// 256 knots over 0..1.
fn even() -> Vec<f64> {
    (0..256).map(|i| f64::from(i) / 255.0).collect()
}

fn bump(x: f64, low: f64, high: f64) -> f64 {
    low * (-((x - 0.25) / 0.08).powi(2)).exp() + high * (-((x - 0.7) / 0.1).powi(2)).exp()
}

/// Knots and opacities of `bone`.
const BONE: [[f64; 2]; 6] = [[0.0, 0.0], [0.15, 0.0], [0.25, 0.03], [0.45, 0.03], [0.55, 0.53], [1.0, 0.53]];

fn bone(x: f64) -> f64 {
    let after = BONE.iter().position(|[knot, _]| x <= *knot).unwrap_or(BONE.len() - 1).max(1);
    let [[low, from], [high, to]] = [BONE[after - 1], BONE[after]];
    from + (to - from) * (x - low) / (high - low)
}

/// A function's name with its opacities over one voxel's edge.
type Opacity = (&'static str, fn(f64) -> f64);
const OPACITIES: [Opacity; 4] =
    [("bump", |x| bump(x, 0.25, 0.5)), ("ramp", |x| 0.25 * x), ("thin", |x| 0.0005 + 0.005 * x), ("bone", bone)];

fn rgb(rgba: [f64; 4]) -> DVec3 {
    DVec3::new(rgba[0], rgba[1], rgba[2])
}

/// Light of every pixel that is compared, so many rows lower and columns to the right.
fn compared<R: Precision>(dvr: &Composited<Dvr<'_, R>>, camera: &Camera, [lower, right]: [f64; 2]) -> Vec<DVec3> {
    let pixels: Vec<(u32, u32)> = (0..camera.height / STRIDE)
        .flat_map(|y| (0..camera.width / STRIDE).map(move |x| (STRIDE * x, STRIDE * y)))
        .collect();
    let see = |(x, y): &(u32, u32)| {
        let rgba = dvr.pixel(&camera.ray(f64::from(*x) + 0.5 + right, f64::from(*y) + 0.5 + lower)).rgba();
        rgb(rgba.map(Real::f64))
    };
    pixels.par_iter().map(see).collect()
}

/// A volume whose box ends at its outermost voxels, of which there are so many, in the precision asked for.
fn boxed<R: Real>(field: &Bricks<f32>, voxels: DVec3) -> Bricks<R> {
    let boxed = Bricks {
        topology: field.topology.clone(),
        values: field.values.iter().map(|v| R::of(f64::from(*v))).collect(),
        background: R::ZERO,
        reference: 0.0,
        transform: field.transform,
        domain: Aabb { min: DVec3::ZERO, max: voxels - 1.0 },
    };
    boxed.filled(u64::MAX).unwrap()
}

/// Seconds of processor time, of all threads, that this process has used.
fn processor_seconds() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// Processor seconds of a picture, decibels and the largest error against the exact integral, by function and rule; the
/// volume has so many voxels, which are units. The folder gets the light of the compared pixels, `light_NAME.f64`:
/// `[row shift, column shift, row, column, rgb]`, at shifts of half a pixel each way: the other side's rays may go
/// elsewhere through a pixel.
pub fn pictures(path: &Path, threads: usize, folder: &Path, voxels: DVec3) {
    let field = volume(path);
    let (fast, exact) = (boxed::<f32>(&field, voxels), boxed::<f64>(&field, voxels));
    let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let camera = camera(voxels.max_element(), 0.5 * (voxels - 1.0), 0.3, 512, 30.0);
    let cancel = Cancel::NEVER;
    let by_function = OPACITIES.map(|(name, opacity)| {
        let knots = if name == "bone" { BONE.map(|[knot, _]| knot).to_vec() } else { even() };
        let medium = Medium::new(1.0, Source::Transfer(function(knots, |x| -(-opacity(x)).ln_1p())));
        let whole = Dvr::new(&exact, medium.clone()).unwrap().early_stop(0.0).over([0.0; 3]);
        let shifts = (0..9).map(|k| [f64::from(k / 3 - 1), f64::from(k % 3 - 1)].map(|shift| 0.5 * shift));
        let light: Vec<Vec<DVec3>> = shifts.map(|shift| compared(&whole, &camera, shift)).collect();
        let bytes: Vec<u8> = light.iter().flatten().flat_map(|v| v.to_array()).flat_map(f64::to_le_bytes).collect();
        std::fs::write(folder.join(format!("light_{name}.f64")), bytes).unwrap();
        let rules = RULES.map(|rule| {
            let dvr = Dvr::new(&fast, medium.clone()).unwrap().quadrature(rule.parse().unwrap()).over([0.0; 3]);
            let mut seconds: Vec<f64> = Vec::new();
            while seconds.len() < PICTURES_EACH && seconds.iter().sum::<f64>() < ENOUGH {
                let before = processor_seconds();
                pool.install(|| drop(black_box(film::render(&dvr, &camera, Sampling::grid(1), &[], &cancel))));
                seconds.push(processor_seconds() - before);
            }
            let seen = compared(&dvr, &camera, [0.0; 2]);
            let off = seen.iter().zip(&light[4]).map(|(a, b)| *a - *b);
            let square: f64 = off.clone().map(|off| off.length_squared()).sum();
            let largest = off.map(|off| off.abs().max_element()).fold(0.0, f64::max);
            let decibels = -10.0 * (square / (3 * seen.len()) as f64).log10();
            (rule.to_owned(), json!({"seconds": median(&seconds), "psnr_db": decibels, "largest": largest}))
        });
        (name.to_owned(), Value::Object(rules.into_iter().collect()))
    });
    println!("{}", Value::Object(by_function.into_iter().collect()));
}

/// Kilobytes of this process's memory: now (`VmRSS`) or at most since [`forget_peak`] (`VmHWM`).
fn memory(what: &str) -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|l| l.starts_with(what)).unwrap();
    line.split_whitespace().nth(1).unwrap().parse().unwrap()
}

fn forget_peak() {
    std::fs::write("/proc/self/clear_refs", "5").unwrap();
}

/// Seconds of a picture and of its loss's gradient by every voxel, and megabytes that the gradient by tape takes beyond
/// the volume and the picture that is aimed at; the volume fills the unit cube. One rule and size a process: what an
/// earlier one gave back would not be seen.
pub fn gradient(path: &Path, threads: usize, rule: Quadrature, pixels: u32) {
    let field = volume(path).filled(u64::MAX).unwrap();
    let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let medium = Medium::new(1.0, Source::Transfer(function(even(), |x| bump(x, 20.0, 60.0))));
    let cancel = Cancel::NEVER;
    let squares = |seen: &[f32; 4], wanted: &[f32; 4]| {
        let d: [f32; 4] = std::array::from_fn(|c| seen[c] - wanted[c]);
        (d.iter().map(|d| f64::from(d * d)).sum(), d.map(|d| 2.0 * d))
    };
    let camera = camera(1.0, DVec3::splat(0.5), 0.3, pixels, 40.0);
    let grey = Target { camera, rgba: vec![[0.3; 4]; (pixels * pixels) as usize], rays_per_edge: 1 };
    let dvr = Dvr::new(&field, medium).unwrap().quadrature(rule).over([0.0; 3]);
    let back = |adjoint: Adjoint, (accumulators, sum): &mut (Workspace<f32, Tape<f32>>, Vec<f32>)| {
        let mut gradients = Gradients { voxels: Some(sum), ..Gradients::default() };
        pool.install(|| black_box(pictures::gradient(&dvr, &[&grey], &squares, adjoint, accumulators, &mut gradients)));
    };
    let fresh = || (Workspace::default(), vec![0.0_f32; field.values.len()]);
    let base = memory("VmRSS:");
    forget_peak();
    let mut by_tape = fresh();
    back(Adjoint::Tape, &mut by_tape);
    let megabytes = (memory("VmHWM:") - base) / 1024.0;
    let mut by_replay = fresh();
    let [value, tape, replay] = in_turn([
        &mut || pool.install(|| drop(black_box(film::render(&dvr, &camera, Sampling::grid(1), &[], &cancel)))),
        &mut || back(Adjoint::Tape, &mut by_tape),
        &mut || back(Adjoint::Replay, &mut by_replay),
    ]);
    let row = json!({
        "value": median(&value), "tape": median(&tape), "replay": median(&replay), "megabytes": megabytes,
    });
    println!("{row}");
}
