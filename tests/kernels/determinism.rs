//! The same bits for any number of threads and any instruction set.

use crate::common::fields::{field, kinds, lumps, noise, odd};
use crate::common::work::{self, Work, density};
use cumulo::arch::Arch;
use cumulo::cancel::Cancel;
use cumulo::differentiate::gradient::pictures::{self, Gradients, Target, Workspace};
use cumulo::inverse::density::Request;
use cumulo::inverse::density::multilevel;
use cumulo::inverse::observation::Observation;
use cumulo::inverse::observation::depth_map::DepthMap;
use cumulo::inverse::observation::photo::Photo;
use cumulo::inverse::projection::projector::Projector;
use cumulo::inverse::refinement;
use cumulo::inverse::region::hull::Hull;
use cumulo::render::composited::Composited;
use cumulo::render::differentiable::Adjoint;
use cumulo::render::dvr::Dvr;
use cumulo::render::film::{self, Sampling};
use cumulo::render::quadrature::Quadrature;
use cumulo::scene::bricks::Bricks;
use cumulo::scene::camera::Camera;
use cumulo::scene::medium::{Medium, Source};
use cumulo::scene::orbit::{self, Layout};
use cumulo::scene::up::Up;
use std::fmt::Debug;
use std::ops::ControlFlow;
use std::sync::Arc;

/// Runs `f` with 1, 2 and 8 threads and expects equal results.
fn alike<T: PartialEq + Debug + Send>(what: &str, f: impl Fn() -> T + Sync) {
    let on = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(&f);
    let one = on(1);
    for threads in [2, 8] {
        assert!(on(threads) == one, "{what}: {threads} threads give other bits than one");
    }
}

fn scene() -> (Bricks<f32>, Vec<Camera>) {
    let field: Bricks<f32> = field(40, odd(), lumps(40));
    let cameras = orbit::cameras(&field.world_bounds().corners(), 9, Layout::Sphere, 48, 40, 40.0, Up::Z);
    (field, cameras)
}

const MEDIA: [Medium; 3] = [
    Medium::new(0.8, Source::Grey([0.0; 3])),
    Medium::new(0.8, Source::Grey([0.5, 1.0, 0.25])),
    Medium::new(0.8, Source::Linear([0.5, 1.0, 0.25])),
];
const RULES: [Quadrature; 3] = [Quadrature::Exact, Quadrature::Midpoint(0.6), Quadrature::Riemann(0.6)];

fn photos(field: &Bricks<f32>, cameras: &[Camera], medium: Medium) -> Vec<Photo> {
    let dvr = Dvr::new(field, medium).unwrap().over([1.0; 3]);
    let film = |c: &Camera| film::render(&dvr, c, Sampling::grid(1), &[], &Cancel::NEVER).unwrap().film;
    cameras.iter().map(|c| Photo { camera: *c, film: film(c), name: "photo".into(), photograph: false }).collect()
}

#[test]
fn pictures() {
    let (field, cameras) = scene();
    for medium in MEDIA {
        for rule in RULES {
            let dvr = Dvr::new(&field, medium.clone()).unwrap().quadrature(rule).over([1.0; 3]);
            alike("picture", || film::render(&dvr, &cameras[2], Sampling::grid(2), &[], &Cancel::NEVER));
        }
    }
}

/// The comparison of instruction sets says nothing where there is only one to compare.
fn two_instruction_sets() {
    #[cfg(target_arch = "x86_64")]
    assert!(
        is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
        "this machine has no AVX2 with FMA: what is dispatched to it cannot be compared here"
    );
    let wide = |arch: Arch| format!("{arch:?}");
    assert!(
        cfg!(not(target_arch = "x86_64")) || wide(Arch::default()) != wide(Arch::oldest()),
        "kernels are not dispatched to what the machine has"
    );
}

/// The kernel that is compiled for this machine's instruction set, against the one that is compiled for
/// the oldest.
#[test]
fn dispatched_kernels_equal_the_scalar_one() {
    two_instruction_sets();
    let (field, cameras) = scene();
    for medium in MEDIA {
        for rule in RULES {
            let dvr = Dvr::new(&field, medium.clone()).unwrap().quadrature(rule).over([1.0; 3]);
            let film = film::render(&dvr, &cameras[3], Sampling::grid(1), &[], &Cancel::NEVER).unwrap().film;
            for (i, pixel) in film.rgba.iter().enumerate() {
                let ray = cameras[3].ray((i % film.width) as f64 + 0.5, (i / film.width) as f64 + 0.5);
                let bits = |p: [f32; 4]| p.map(f32::to_bits);
                assert_eq!(
                    bits(*pixel),
                    bits(dvr.clone().with(|dvr| dvr.arch(Arch::oldest())).pixel(&ray).rgba()),
                    "{medium:?} {rule} pixel {i}"
                );
            }
        }
    }
}

#[test]
fn gradients() {
    let (field, cameras) = scene();
    for medium in MEDIA {
        let dvr = Dvr::new(&field, medium.clone()).unwrap().over([1.0; 3]);
        let target = |c: &Camera| Target { camera: *c, rgba: vec![[0.4, 0.5, 0.6, 0.3]; 48 * 40], rays_per_edge: 1 };
        let targets: Vec<Target> = cameras.iter().take(3).map(target).collect();
        let all: Vec<&Target> = targets.iter().collect();
        alike("gradient", || {
            let mut g = vec![0.0; field.values.len()];
            let (sum, shared) = pictures::gradient(
                &dvr,
                &all,
                &|a, b| {
                    let d: [f32; 4] = std::array::from_fn(|c| a[c] - b[c]);
                    (d.iter().map(|d| f64::from(d * d)).sum(), d)
                },
                Adjoint::Tape,
                &mut Workspace::default(),
                &mut Gradients { voxels: Some(&mut g), ..Gradients::default() },
            );
            assert!(g.iter().any(|v| *v != 0.0));
            (g, sum.to_bits(), shared)
        });
    }
}

/// Pre-integration: pictures and gradients for any number of threads, and on the oldest instruction set.
#[test]
fn pre_integration() {
    two_instruction_sets();
    let (field, cameras) = scene();
    for transfer in kinds() {
        let medium = Medium::new(0.8, Source::Transfer(Arc::new(transfer.table().unwrap())));
        let field = field.clone().filled(1 << 30).unwrap();
        let dvr = Dvr::new(&field, medium).unwrap().quadrature(Quadrature::PREINTEGRATED).over([1.0; 3]);
        let oldest = dvr.clone().with(|dvr| dvr.arch(Arch::oldest()));
        alike("picture", || film::render(&dvr, &cameras[2], Sampling::grid(2), &[], &Cancel::NEVER));
        let of =
            |dvr: &Composited<Dvr<'_, f32>>| film::render(dvr, &cameras[3], Sampling::grid(1), &[], &Cancel::NEVER);
        assert!(of(&dvr) == of(&oldest), "{transfer:?}");
        let camera = cameras[1];
        let target = Target { camera, rgba: vec![[0.4, 0.5, 0.6, 0.3]; 48 * 40], rays_per_edge: 1 };
        let gradient = |dvr: &Composited<Dvr<'_, f32>>, adjoint: Adjoint| {
            let mut g = vec![0.0; field.values.len()];
            let loss = |a: &[f32; 4], b: &[f32; 4]| (0.0, std::array::from_fn(|c| a[c] - b[c]));
            let mut gradients = Gradients { voxels: Some(&mut g), ..Gradients::default() };
            let found = pictures::gradient(dvr, &[&target], &loss, adjoint, &mut Workspace::default(), &mut gradients);
            (g, found.1)
        };
        alike("gradient", || gradient(&dvr, Adjoint::Tape));
        assert!(gradient(&dvr, Adjoint::Tape) == gradient(&oldest, Adjoint::Replay), "{transfer:?}");
    }
}

#[test]
fn the_projector() {
    let (field, cameras) = scene();
    let observation = Observation::new(&photos(&field, &cameras, MEDIA[0].clone()), [1.0; 3], [0.0; 3]).unwrap();
    let (topology, transform) = (field.topology.clone(), field.transform);
    let maps: Vec<&DepthMap> = observation.maps.iter().collect();
    let x: Vec<f32> = (0..topology.len() as u64 * 512).map(|i| noise(i) as f32).collect();
    alike("projector", || {
        let mut projector = Projector::new(topology.clone(), transform, 0.8, 2);
        let mut out = vec![0.0; projector.unknowns()];
        let views = projector.views(&maps, 1, &vec![true; projector.unknowns()]);
        let sums = projector.normal(&x, &views, &mut out, |s, z| {
            let miss = f64::from(s.depth) - z.iter().sum::<f64>();
            (miss, [miss * miss, 1.0])
        });
        (out, sums.map(f64::to_bits))
    });
}

fn request(field: &Bricks<f32>, observation: &Observation) -> Request {
    Request {
        lattice: field.transform,
        bounds: Hull::new(observation).bounds().unwrap(),
        medium: MEDIA[0].clone(),
        background: [1.0; 3],
        rays_per_edge: 1,
        held_out: vec![4],
        iterations: 6,
        smoothing: None,
        robust: true,
        prior: None,
        init: None,
        max_memory: 1 << 30,
        cancel: Cancel::NEVER,
        checkpoint: None,
        closing: Cancel::NEVER,
    }
}

#[test]
fn a_whole_reconstruction() {
    let (field, cameras) = scene();
    let observation = Observation::new(&photos(&field, &cameras, MEDIA[0].clone()), [1.0; 3], [0.0; 3]).unwrap();
    alike("reconstruction", || {
        let request = request(&field, &observation);
        let outcome = multilevel::reconstruct(&observation, &request, |_| ControlFlow::Continue(())).unwrap();
        let losses: Vec<u64> = outcome.history.iter().map(|s| s.loss.to_bits()).collect();
        (outcome.field.to_grid("density"), losses, outcome.train_psnr_db.to_bits())
    });
}

#[test]
fn refined_cameras() {
    let (field, mut cameras) = scene();
    let mut photos = photos(&field, &cameras, MEDIA[0].clone());
    cameras[2].centre.x += 1.5;
    photos[2].camera = cameras[2];
    let observation = Observation::new(&photos, [1.0; 3], [0.0; 3]).unwrap();
    alike("refinement", || {
        let request = request(&field, &observation);
        let refined = refinement::refine(&observation, &request, true, |_| ControlFlow::Continue(())).unwrap();
        let numbers = refined.iter().flat_map(|c| c.camera_to_world.to_cols_array().into_iter().chain([c.focal.x]));
        numbers.map(f64::to_bits).collect::<Vec<_>>()
    });
}

#[test]
fn the_command_line() {
    let work = Work::new();
    let kinds = [("one", "1", "--threads 1"), ("two", "1", "--threads 2"), ("eight", "8", "")];
    for (name, threads, option) in kinds {
        for words in [
            format!("render @plume.vdb --views 9 --size 24x24 --density-scale 3 {option} -o {name}"),
            format!("reconstruct density {name} --resolution 14 --iterations 6 {option} -o {name}.vdb"),
            format!(
                "reconstruct density {name} --resolution 10 --iterations 1 --solver weiss2021 {option} -o {name}p.vdb"
            ),
        ] {
            let out = work.command(&words).env("RAYON_NUM_THREADS", threads).output().unwrap();
            assert!(out.status.success(), "{words}: {}", work::errors(&out));
        }
    }
    for other in ["two", "eight"] {
        for i in 0..9 {
            let of = |folder| work.picture(&format!("{folder}/view_{i:03}.exr"));
            assert!(of("one") == of(other), "{other}: view {i}");
        }
        for kind in ["", "p"] {
            // Metadata holds the command line and the time.
            let of = |name| {
                let grid = density(&work.path(&format!("{name}{kind}.vdb")));
                (grid.leaves, grid.tiles, grid.transform)
            };
            assert!(of("one") == of(other), "{other}{kind}: the volumes differ");
        }
    }
}
