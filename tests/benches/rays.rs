//! What rays cost: gradients against values (B3), rays and cells a second, two threads against one (B11).

use super::fields;
use super::row::Row;
use super::turns::{in_turn, median, ratio};
use cumulo::cancel::Cancel;
use cumulo::differentiate::gradient::pictures::{self, Gradients, Target, Workspace};
use cumulo::inverse::observation::depth_map::{DepthMap, Limit};
use cumulo::inverse::projection::projector::Projector;
use cumulo::math::{Affine, Ray};
use cumulo::render::composited::Composited;
use cumulo::render::differentiable::Adjoint;
use cumulo::render::dvr::{Dvr, Tape};
use cumulo::render::film::{self, Sampling};
use cumulo::scene::bricks::{Bricks, NONE};
use cumulo::scene::camera::Camera;
use cumulo::scene::medium::{Medium, Source};
use cumulo::scene::orbit::{Layout, cameras};
use cumulo::scene::up::Up;
use glam::DVec3;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::hint::black_box;

/// Voxels along the volume's edge, pixels along the pictures'.
const VOXELS: i32 = 128;
const PIXELS: u32 = 128;
const VIEWS: usize = 2;

/// A cloud that fills a part of its box, and cameras around it.
struct Scene {
    field: Bricks<f32>,
    cameras: Vec<Camera>,
}

impl Scene {
    fn new() -> Self {
        let lumps = fields::lumps(VOXELS);
        let lattice = Affine::uniform(1.0, DVec3::splat(0.5)).unwrap();
        let field: Bricks<f32> = fields::field(VOXELS, lattice, |p| (lumps(p) - 0.1).max(0.0));
        let cameras = cameras(&field.outline(), VIEWS, Layout::Sphere, PIXELS, PIXELS, 40.0, Up::Z);
        Self { field, cameras }
    }

    /// A ray a pixel, all views.
    fn rays(&self) -> impl Iterator<Item = Ray> + '_ {
        self.cameras.iter().flat_map(|camera| {
            let pixel = |i: u32| camera.ray(f64::from(i % PIXELS) + 0.5, f64::from(i / PIXELS) + 0.5);
            (0..PIXELS * PIXELS).map(pixel)
        })
    }

    /// Cells of stored bricks that all rays cross, found without the renderer's own walk.
    fn cells(&self) -> f64 {
        let map = &self.field.transform;
        let crossed = |ray: Ray| {
            let ray = Ray::new(map.to_index(ray.origin), map.vector_to_index(ray.direction));
            let Some((enter, leave)) = self.field.topology.bounds().clip(&ray) else { return 0 };
            let mut cuts = vec![enter, leave];
            for (o, d) in ray.origin.to_array().into_iter().zip(ray.direction.to_array()).filter(|(_, d)| *d != 0.0) {
                let (a, b) = (o + enter * d, o + leave * d);
                cuts.extend((a.min(b).ceil() as i32..=a.max(b).floor() as i32).map(|plane| (f64::from(plane) - o) / d));
            }
            cuts.sort_by(f64::total_cmp);
            let stored = |pair: &&[f64]| {
                let cell = ray.at(0.5 * (pair[0] + pair[1])).floor();
                pair[1] > pair[0] && self.field.topology.find((cell / 8.0).floor().as_ivec3()) != NONE
            };
            cuts.windows(2).filter(stored).count()
        };
        self.rays().map(crossed).sum::<usize>() as f64
    }
}

/// All rows of this file.
pub fn rows() -> Vec<Row> {
    let scene = Scene::new();
    let pools = [1, 2].map(|n| ThreadPoolBuilder::new().num_threads(n).build().unwrap());
    let mut rows = Vec::new();
    for (name, color) in [("absorption", None), ("linear emission", Some([1.0; 3]))] {
        let source = color.map_or(Source::Grey([0.0; 3]), Source::Linear);
        let dvr = Dvr::new(&scene.field, Medium::new(0.15, source)).unwrap().over([1.0; 3]);
        rows.extend(gradients(name, &dvr, &scene, &pools[0]));
        rows.extend(pictures_per_second(name, &dvr, &scene, &pools));
    }
    rows.extend(projections_per_second(&scene, &pools));
    rows
}

fn render(dvr: &Composited<Dvr<'_, f32>>, scene: &Scene, pool: &ThreadPool) {
    let cancel = Cancel::NEVER;
    pool.install(|| {
        scene.cameras.iter().for_each(|c| drop(black_box(film::render(dvr, c, Sampling::grid(1), &[], &cancel))))
    });
}

/// Value against value and gradient, one thread, each through the driver that the program itself uses.
fn gradients(name: &str, dvr: &Composited<Dvr<'_, f32>>, scene: &Scene, pool: &ThreadPool) -> Vec<Row> {
    let grey = vec![[0.5; 4]; (PIXELS * PIXELS) as usize];
    let targets: Vec<Target> =
        scene.cameras.iter().map(|c| Target { camera: *c, rgba: grey.clone(), rays_per_edge: 1 }).collect();
    let targets: Vec<&Target> = targets.iter().collect();
    let squares = |seen: &[f32; 4], wanted: &[f32; 4]| {
        let d: [f32; 4] = std::array::from_fn(|c| seen[c] - wanted[c]);
        (d.iter().map(|d| f64::from(0.5 * d * d)).sum(), d)
    };
    let mut sums = [(); 2].map(|()| (Workspace::default(), vec![0.0_f32; scene.field.values.len()]));
    let [by_tape, by_replay] = &mut sums;
    let back = |adjoint: Adjoint, (accumulators, sum): &mut (Workspace<f32, Tape<f32>>, Vec<f32>)| {
        let mut gradients = Gradients { voxels: Some(sum), ..Gradients::default() };
        pool.install(|| black_box(pictures::gradient(dvr, &targets, &squares, adjoint, accumulators, &mut gradients)));
    };
    let [value, tape, replay] =
        in_turn([&mut || render(dvr, scene, pool), &mut || back(Adjoint::Tape, by_tape), &mut || {
            back(Adjoint::Replay, by_replay)
        }]);
    let row = |how: &str, seconds: &[f64], goal: f64| {
        let work = format!("{name}, gradient by {how} against value");
        let ours = format!("{:.1} ms to {:.1} ms", 1e3 * median(seconds), 1e3 * median(&value));
        let row = Row::at_most("B3", work, ours, ratio(seconds, &value), goal);
        row.with("value", median(&value)).with("gradient", median(seconds))
    };
    vec![row("tape", &tape, 1.7), row("replay", &replay, 2.3)]
}

/// Rays and cells a second, and what the second thread brings.
fn rates(work: String, rays: f64, cells: f64, one: &[f64], two: &[f64]) -> Vec<Row> {
    let fast = |seconds: f64| format!("{:.2} M rays/s, {:.0} M cells/s", 1e-6 * rays / seconds, 1e-6 * cells / seconds);
    let (a, b) = (median(one), median(two));
    let efficiency = 0.5 * ratio(one, two);
    vec![
        Row::figure("rate", format!("{work}, 1 thread"), fast(a))
            .with("seconds", a)
            .with("rays", rays)
            .with("cells", cells),
        Row::at_least("B11", format!("{work}, 2 threads: efficiency"), fast(b), efficiency, 0.9).with("seconds", b),
    ]
}

fn pictures_per_second(name: &str, dvr: &Composited<Dvr<'_, f32>>, scene: &Scene, pools: &[ThreadPool; 2]) -> Vec<Row> {
    let dvr = dvr.clone().with(|dvr| dvr.early_stop(0.0));
    let [one, two] = in_turn([&mut || render(&dvr, scene, &pools[0]), &mut || render(&dvr, scene, &pools[1])]);
    rates(format!("exact picture, {name}"), scene.rays().count() as f64, scene.cells(), &one, &two)
}

/// The reconstruction's operator and its transpose, one pass over all pixels.
fn projections_per_second(scene: &Scene, pools: &[ThreadPool; 2]) -> Vec<Row> {
    let pixels = (PIXELS * PIXELS) as usize;
    let map = |camera: &Camera| DepthMap {
        camera: *camera,
        width: PIXELS as usize,
        height: PIXELS as usize,
        transmittance: vec![(-1.0_f32).exp(); pixels],
        shown: vec![true; pixels],
        noise: 0.0,
        limit: Limit::Voxels,
        name: "view".into(),
        means: None,
    };
    let topology = &scene.field.topology;
    let mut projector = Projector::new(topology.clone(), scene.field.transform, 0.15, 1);
    let maps: Vec<DepthMap> = scene.cameras.iter().map(map).collect();
    let views = projector.views(&maps.iter().collect::<Vec<_>>(), 1, &vec![true; projector.unknowns()]);
    let mut voxels = vec![0.0; projector.unknowns()];
    topology.gather_apron(&scene.field.values, &mut voxels);
    let mut out = voxels.clone();
    let mut pass = |pool: &ThreadPool| {
        pool.install(|| {
            black_box(projector.normal(&voxels, &views, &mut out, |s, z| (z[0] - f64::from(s.depth), [z[0], 0.0])));
        });
    };
    let pass = std::cell::RefCell::new(&mut pass);
    let [one, two] = in_turn([&mut || pass.borrow_mut()(&pools[0]), &mut || pass.borrow_mut()(&pools[1])]);
    let rays = views.iter().map(|v| v.samples.len()).sum::<usize>() as f64;
    rates("projector there and back".into(), rays, scene.cells(), &one, &two)
}
