//! Work that needs more memory than it may take, with a scratch folder: the same bits, within the memory.

use crate::common::fields;
use crate::common::work::{Work, errors};
use cumulo::error::Code;
use cumulo::formats::exr;
use cumulo::formats::vdb::{Codec, write_grids};
use cumulo::math::Affine;
use cumulo::scene::grid::{Grid, GridClass, LEAF_VOXELS, Leaf};
use glam::{DVec3, IVec3};
use std::collections::BTreeMap;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A folder on the disk of the build: temporary ones may be in memory.
fn scratch() -> tempfile::TempDir {
    tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap()
}

/// Largest memory of a process in MiB: what it has taken for itself, and what was resident at a time, pages of files
/// among it.
#[derive(Debug, Clone, Copy, Default)]
struct Peak {
    own: u64,
    resident: u64,
}

/// Runs a command, expects success, and returns its largest memory.
fn peak(command: &mut Command) -> Peak {
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let status = format!("/proc/{}/status", child.id());
    let mut peak = Peak::default();
    while child.try_wait().unwrap().is_none() {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let of = |name: &str| {
            let line = text.lines().find_map(|line| line.strip_prefix(name)?.trim().strip_suffix(" kB"));
            line.and_then(|kib| kib.parse::<u64>().ok()).unwrap_or(0) >> 10
        };
        peak = Peak { own: peak.own.max(of("RssAnon:")), resident: peak.resident.max(of("VmHWM:")) };
        std::thread::sleep(Duration::from_millis(2));
    }
    let out = child.wait_with_output().unwrap();
    assert!(out.status.success(), "{}", errors(&out));
    peak
}

fn write(work: &Work, name: &str, grid: &Grid) {
    write_grids(&work.path(name), &[grid], &BTreeMap::new(), Codec::None, false).unwrap();
}

/// 256 MB of voxels, which take more than twice as much while they are arranged for rays.
#[test]
fn a_volume_larger_than_the_memory_renders_to_the_same_bits() {
    let work = Work::new();
    let noise = |p: DVec3| fields::noise((p.x as u64) << 40 | (p.y as u64) << 20 | p.z as u64);
    write(&work, "noise.vdb", &fields::grid(400, fields::unit(), noise));
    let scratch = scratch();
    let render = "render noise.vdb --views 2 --size 48x48 --density-scale 0.01";
    let whole = peak(&mut work.command(&format!("{render} -o whole")));
    work.refused(&format!("{render} -o none --max-memory 448M"), Code::MemoryLimit, &["noise.vdb", "--scratch"]);
    let small =
        peak(&mut work.command(&format!("{render} -o small --max-memory 448M --scratch {}", scratch.path().display())));
    // Pages of files are mapped faster than any watch sees: they come on top for moments.
    assert!(small.own <= 256 && small.resident <= 640 && whole.own > 512, "{small:?} of {whole:?}");
    let names = std::fs::read_dir(work.path("whole")).unwrap().map(|entry| entry.unwrap().file_name());
    let pictures: Vec<_> = names.filter(|name| name.to_string_lossy().ends_with(".exr")).collect();
    assert_eq!(pictures.len(), 2);
    for name in pictures {
        let [a, b] = ["whole", "small"].map(|folder| exr::read_picture(&work.path(folder).join(&name), None).unwrap());
        assert!(a.rgba == b.rgba, "{name:?}");
    }
    assert_eq!(std::fs::read_dir(scratch.path()).unwrap().count(), 0);
}

#[test]
fn a_reconstruction_larger_than_the_memory_has_the_same_bits() {
    let work = Work::new();
    work.text("render @plume.vdb --views 6 --size 64x64 -o shots");
    let reconstruct = "reconstruct density shots --resolution 288 --iterations 2 --held-out 2";
    let whole = peak(&mut work.command(&format!("{reconstruct} -o whole.vdb")));
    let scratch = scratch();
    let words = format!("{reconstruct} -o small.vdb --max-memory 352M --scratch {}", scratch.path().display());
    let small = peak(&mut work.command(&words));
    assert!(small.own <= 256 && small.resident <= 400 && whole.own > 400, "{small:?} of {whole:?}");
    assert_eq!(work.difference("whole.vdb", "small.vdb")["max_abs"], 0.0);
    work.refused(&format!("{reconstruct} -o none.vdb --max-memory 352M"), Code::MemoryLimit, &["--scratch"]);
}

/// A knotted tube through a cube of `n`³ voxels of edge 1 / `n`: the torus knot of two turns and three.
fn knot(n: i32) -> Grid {
    let size = f64::from(n);
    let at = |t: f64| {
        let radius = 0.5 + 0.2 * (3.0 * t).cos();
        size * (DVec3::new(radius * (2.0 * t).cos(), radius * (2.0 * t).sin(), 0.2 * (3.0 * t).sin()) / 1.5 + 0.5)
    };
    let points: Vec<DVec3> = (0..2000).map(|i| at(std::f64::consts::TAU * f64::from(i) / 2000.0)).collect();
    let thick = 0.02 * size;
    let mut near: BTreeMap<[i32; 3], Vec<DVec3>> = BTreeMap::new();
    for point in &points {
        let [low, high] = [-thick, thick].map(|r| ((*point + r) / 8.0).floor().as_ivec3());
        let all = (low.x..=high.x).flat_map(|x| (low.y..=high.y).map(move |y| (x, y)));
        for brick in all.flat_map(|(x, y)| (low.z..=high.z).map(move |z| [x, y, z])) {
            near.entry(brick).or_default().push(*point);
        }
    }
    let leaf = |(brick, points): (&[i32; 3], &Vec<DVec3>)| {
        let origin = 8 * IVec3::from_array(*brick);
        let (mut values, mut active) = ([0.0; LEAF_VOXELS], [0_u64; 8]);
        for i in 0..LEAF_VOXELS {
            let voxel = origin + IVec3::new((i >> 6) as i32, (i >> 3 & 7) as i32, (i & 7) as i32);
            let square = |point: &DVec3| (*point - voxel.as_dvec3()).length_squared();
            let distance = points.iter().map(square).fold(f64::INFINITY, f64::min).sqrt();
            if distance < thick {
                values[i] = (1.0 + 0.5 * (0.05 * f64::from(voxel.z)).sin()) as f32;
                active[i >> 6] |= 1 << (i & 63);
            }
        }
        (active != [0; 8]).then_some(Leaf { origin: origin.to_array(), values, active })
    };
    Grid {
        name: "density".into(),
        class: GridClass::FogVolume,
        transform: Affine::uniform(1.0 / size, DVec3::ZERO).unwrap(),
        background: 0.0,
        leaves: near.iter().filter_map(leaf).collect(),
        tiles: Vec::new(),
        metadata: BTreeMap::new(),
    }
}

/// A cube of 1024³ voxels, of which a tube is filled: from 64 pictures of 512², within 2 GiB, in some minutes.
#[test]
fn a_sparse_volume_of_1024_voxels_along_each_axis_is_reconstructed_within_2_gib() {
    if std::env::var_os("CUMULO_LARGE").is_none() {
        println!("left out: `make large` runs it");
        return;
    }
    let work = Work::new();
    write(&work, "knot.vdb", &knot(1024));
    let scratch = scratch();
    let memory = format!("--max-memory 2G --scratch {}", scratch.path().display());
    let run = |words: &str| {
        let begun = Instant::now();
        let peak = peak(&mut work.command(&format!("{words} {memory}")));
        println!("{words}: {peak:?}, {:.0} s", begun.elapsed().as_secs_f64());
        assert!(peak.resident <= 2048);
    };
    run("render knot.vdb --views 64 --size 512x512 --density-scale 20 -o shots");
    run("reconstruct density shots -o found.vdb --resolution 1024");
    run("render found.vdb --cameras shots --size 512x512 -o again");
    let out = work.command("compare shots again --json").output().unwrap();
    let compared: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    for frame in compared["frames"].as_array().unwrap() {
        assert!(frame["psnr_db"].as_f64().is_none_or(|psnr| psnr > 45.0), "{frame}");
    }
}
