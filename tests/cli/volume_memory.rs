//! What volumes of few bytes may cost: giant tiles, giant outputs, tiny voxels, and what says nothing of a loss.

use crate::common::grids::fog;
use crate::common::work::{Work, errors};
use cumulo::formats::limits::Limits;
use cumulo::formats::vdb::{File, NativeGrid};
use cumulo::math::{Affine, Ray};
use cumulo::render::dvr::Dvr;
use cumulo::render::quadrature::Quadrature;
use cumulo::scene::bricks::Bricks;
use cumulo::scene::grid::{Grid, GridClass, Tile};
use cumulo::scene::medium::{Medium, Source};
use cumulo::scene::transfer::Transfer;
use glam::{DMat4, DVec3};
use serde_json::Value;
use std::collections::BTreeMap;
use std::process::Output;
use std::sync::Arc;
use std::time::{Duration, Instant};

fn empty(voxel: f64) -> Grid {
    Grid {
        name: "density".into(),
        class: GridClass::FogVolume,
        transform: Affine::uniform(voxel, DVec3::ZERO).unwrap(),
        background: 0.0,
        leaves: vec![],
        tiles: vec![],
        metadata: BTreeMap::new(),
    }
}

fn tile(origin: [i32; 3], dim: i32, value: f32) -> Tile {
    Tile { origin, dim, value, active: true }
}

/// A cube of `n`³ tiles of edge `dim`.
fn tiles(n: i32, dim: i32) -> Grid {
    let all = (0..n * n * n).map(|i| tile([i / n / n * dim, i / n % n * dim, i % n * dim], dim, 0.01));
    Grid { tiles: all.collect(), ..empty(0.01) }
}

/// Leaves beside tiles of all sizes that touch one another, and a leaf whose low faces are empty.
fn mixture() -> Grid {
    let mut grid = fog("density", 3, 5);
    grid.leaves.iter_mut().for_each(|leaf| leaf.origin[0] += 136);
    let leaf = &mut grid.leaves[13];
    for i in (0..512).filter(|i| i >> 6 == 0 || i >> 3 & 7 == 0 || i & 7 == 0) {
        leaf.values[i] = 0.0;
    }
    grid.tiles = vec![
        tile([0, -128, 0], 128, 0.25),
        tile([0, 0, 0], 128, 0.5),
        tile([128, -16, 16], 8, 0.5),
        Tile { active: false, ..tile([128, 0, 24], 8, 0.125) },
        tile([152, 0, 0], 8, 0.75),
        tile([152, 8, 0], 8, 0.75),
    ];
    grid
}

fn run(work: &Work, words: &str, memory: &str) -> (Output, Duration) {
    let start = Instant::now();
    let line = format!("ulimit -v {memory}; exec \"$0\" \"$@\"");
    let command = work.command(words);
    let mut shell = std::process::Command::new("sh");
    shell.args(["-c", &line]).arg(command.get_program()).args(command.get_args());
    let out = shell.current_dir(work.path("")).env("RAYON_NUM_THREADS", "2").output().unwrap();
    (out, start.elapsed())
}

/// Bricks stored once hold what bricks of their own do, and rays see the same bits.
#[test]
fn shared_bricks_hold_the_same_values() {
    let grid = mixture();
    let own = Bricks::<f32>::from_grid(&grid, 1 << 30).unwrap();
    let shared = Bricks::<f32>::instanced(&grid, 1 << 30).unwrap();
    assert!(shared.values.len() < own.values.len() / 10, "{} of {}", shared.values.len(), own.values.len());
    assert_eq!(own.topology.bounds(), shared.topology.bounds());
    assert_eq!(shared.topology.places().count(), own.topology.len());
    for brick in own.topology.bricks() {
        assert_eq!(own.brick(*brick), shared.brick(*brick), "{brick}");
    }
    let again = shared.clone().expanded(1 << 30).unwrap();
    assert_eq!((&again.topology, &again.values), (&own.topology, &own.values));
    assert_eq!(shared.to_grid("density"), own.to_grid("density"));

    let [mut own, mut shared] = [own, shared];
    own.domain = grid.active_box();
    shared.domain = grid.active_box();
    let [own_full, shared_full] = [&own, &shared].map(|f| f.clone().filled(1 << 30).unwrap());
    assert!(own_full.is_filled() && shared_full.is_filled() && !shared.is_filled());
    assert!(shared_full.values.len() <= shared.values.len() + 729);
    let bounds = own.world_bounds();
    let rays: Vec<Ray> = (0..200)
        .map(|i| {
            let at = |k: f64| (f64::from(i) * k).fract();
            let from = bounds.min + bounds.size() * DVec3::new(at(0.618), at(0.414), -0.5);
            let to = bounds.min + bounds.size() * DVec3::new(at(0.732), at(0.236), 1.5);
            Ray::new(from, (to - from).normalize())
        })
        .collect();
    let same = |a: &Bricks<f32>, b: &Bricks<f32>, medium: &Medium, quadrature: Quadrature| {
        let [a, b] = [a, b].map(|f| Dvr::new(f, medium.clone()).unwrap().quadrature(quadrature).over([1.0; 3]));
        let mut met = 0;
        for ray in &rays {
            let (a, b) = (a.pixel(ray), b.pixel(ray));
            assert_eq!((a.rgb.map(f32::to_bits), a.depth.to_bits()), (b.rgb.map(f32::to_bits), b.depth.to_bits()));
            met += usize::from(a.depth > 0.0);
        }
        assert!(met > 50, "{met}");
    };
    let linear = Medium::new(0.3, Source::Linear([1.0, 0.5, 0.25]));
    same(&own, &shared, &linear, Quadrature::Exact);
    for opacity in [0.0, 0.2] {
        let points = vec![[0.0, 1.0, 0.5, 0.0, opacity], [0.3, 0.2, 0.5, 1.0, 0.0], [1.0, 0.5, 0.5, 0.5, 2.0]];
        let table = Arc::new(Transfer::Piecewise { points }.table().unwrap());
        let medium = Medium::new(0.3, Source::Transfer(table));
        let (a, b) = if opacity > 0.0 { (&own_full, &shared_full) } else { (&own, &shared) };
        for quadrature in [Quadrature::Exact, Quadrature::PREINTEGRATED, Quadrature::Midpoint(0.5)] {
            same(a, b, &medium, quadrature);
        }
    }
    // What cameras are placed around does not change, either.
    assert_eq!(own.outline(), shared.outline());
}

/// 1024³ voxels of one value took 5 GB.
#[test]
fn giant_tiles_are_rendered_told_of_compared_and_copied_in_little_memory() {
    let work = Work::new();
    work.write("tile.vdb", &[&tiles(8, 128)]);
    work.write("other.vdb", &[&Grid { transform: Affine::uniform(0.013, DVec3::ZERO).unwrap(), ..tiles(8, 128) }]);
    for words in [
        "render tile.vdb --views 2 --size 24x24 --density-scale auto -o pictures --max-memory 200M",
        "info tile.vdb other.vdb --max-memory 200M",
        "validate tile.vdb other.vdb --max-memory 200M",
        "diff tile.vdb tile.vdb --max-memory 200M",
        "convert tile.vdb copy.vdb --half --max-memory 200M",
    ] {
        let (out, took) = run(&work, words, "1500000");
        assert!(out.status.success(), "{words}: {}", errors(&out));
        assert!(took < Duration::from_secs(20), "{words}: {took:?}");
    }
    let (out, took) = run(&work, "diff tile.vdb other.vdb --max-memory 200M", "1500000");
    assert_eq!(out.status.code(), Some(1), "{}", errors(&out));
    assert!(took < Duration::from_secs(60), "{took:?}");
    // 4096 tiles of 4096³: the table of places alone would have 6.9e10 entries.
    work.write("vast.vdb", &[&tiles(8, 4096)]);
    let (out, took) = run(&work, "render vast.vdb --views 1 --size 8x8 -o pictures2", "1500000");
    assert_eq!(out.status.code(), Some(2), "{}", errors(&out));
    assert!(errors(&out).contains("too far apart to index") && took < Duration::from_secs(5), "{}", errors(&out));
}

#[test]
fn outputs_too_large_are_refused_before_the_work() {
    let work = Work::new();
    work.write("tile.vdb", &[&Grid { tiles: vec![tile([0; 3], 4096, 1.0)], ..empty(1.0) }]);
    for (words, expected) in [
        ("convert tile.vdb o.vdb --resample 1.7 --max-memory 112M", "--resample"),
        ("convert @cube.vdb o.vdb --resample 1e-3 --max-memory 300M", "--resample"),
        ("convert tile.vdb o.vdb --crop=0.5,0.5,0.5,4094,4094,4094 --max-memory 112M", "--crop"),
    ] {
        let (out, took) = run(&work, words, "1500000");
        assert_eq!(out.status.code(), Some(2), "{words}: {}", errors(&out));
        assert!(errors(&out).contains("needs about") && errors(&out).contains(expected), "{}", errors(&out));
        assert!(took < Duration::from_secs(10), "{words}: {took:?}");
        assert!(!work.path("o.vdb").exists());
    }
    // What fits goes on, and takes no more than was said.
    let report = work.json("convert @cube.vdb o.vdb --resample 0.01 --max-memory 112M");
    assert!(report["grids"][0]["active_voxels"].as_u64().unwrap() > 6_000_000);
}

/// The estimate of a resampling is at least what the tree takes, and little more where it is dense. (What is made
/// coarser is made by way of a finer tree, which counts.)
#[test]
fn the_estimate_of_a_resampling_holds() {
    for (grid, voxel, most) in [
        (tiles(1, 128), 0.01, 1.4),
        (tiles(1, 128), 0.007, 1.5),
        (tiles(1, 128), 0.03, 20.0),
        (Grid { tiles: vec![], ..fog("density", 8, 3) }, 0.1, 1.5),
        (Grid { tiles: vec![], ..fog("density", 2, 3) }, 0.3, 6.0),
    ] {
        let mut native = NativeGrid::from_grid(&grid).unwrap();
        let estimate = native.resampled_bytes(voxel, u64::MAX).unwrap() as f64;
        native.resample(voxel).unwrap();
        let info = native.info().unwrap();
        let leaves = (info.leaf_count * info.leaf_bytes()) as f64;
        assert!(estimate >= leaves, "{estimate} {leaves}");
        assert!(estimate <= most * leaves + 1.1e6, "{voxel}: {estimate} {leaves}");
        let cap = native.resampled_bytes(voxel / 100.0, 1 << 20).unwrap();
        assert!(cap > 1 << 20, "{cap}");
    }
}

#[test]
fn the_estimate_of_a_crop_holds() {
    let grid = Grid { tiles: vec![tile([0; 3], 128, 1.0), tile([128, 0, 0], 128, 2.0)], ..empty(1.0) };
    let mut native = NativeGrid::from_grid(&grid).unwrap();
    let world = cumulo::math::Aabb { min: DVec3::splat(3.5), max: DVec3::new(200.0, 100.0, 90.0) };
    let before = native.info().unwrap().memory;
    let estimate = native.cropped_bytes(world).unwrap() as f64;
    native.crop(world).unwrap();
    let info = native.info().unwrap();
    let grown = info.memory.saturating_sub(before) as f64;
    assert!(estimate >= 0.9 * grown && estimate <= 1.4 * grown, "{estimate} {grown}");
    let whole = cumulo::math::Aabb { min: DVec3::splat(-1e9), max: DVec3::splat(1e9) };
    assert_eq!(NativeGrid::from_grid(&grid).unwrap().cropped_bytes(whole).unwrap(), 0);
}

#[test]
fn a_crop_beyond_index_space_keeps_all_and_one_beside_the_volume_warns() {
    let work = Work::new();
    for far in ["1e9", "1e300"] {
        let report = work.json(&format!("convert @cube.vdb o.vdb --crop=-{far},-{far},-{far},{far},{far},{far}"));
        assert_eq!(report["grids"][0]["active_voxels"], 4096);
        assert_eq!(report["warnings"], Value::Array(vec![]));
    }
    for (words, expected) in
        [("--crop=50,50,50,60,60,60", "no active voxel"), ("--crop=1e12,1e12,1e12,1e13,1e13,1e13", "no active voxel")]
    {
        let out = work.command(&format!("convert @cube.vdb o.vdb {words} --json")).output().unwrap();
        assert!(out.status.success() && errors(&out).contains(expected), "{}", errors(&out));
        let report: Value = serde_json::from_slice(&out.stdout).unwrap();
        assert!(report["warnings"][0].as_str().unwrap().contains("density"));
        assert_eq!(report["grids"][0]["active_voxels"], 0);
    }
}

/// OpenVDB refuses to write a grid whose `file_compression` has another type than its own.
#[test]
fn damaged_metadata_does_not_stop_a_conversion() {
    let work = Work::new();
    work.write("a.vdb", &[&Grid { tiles: vec![], ..fog("density", 1, 3) }]);
    let mut bytes = std::fs::read(work.path("a.vdb")).unwrap();
    let name = b"file_compression";
    let at = bytes.windows(name.len()).position(|w| w == name).unwrap() + name.len() + 4;
    assert_eq!(&bytes[at..at + 6], b"string");
    bytes[at + 4] = 0x1b;
    std::fs::write(work.path("a.vdb"), bytes).unwrap();
    let report = work.json("convert a.vdb o.vdb");
    assert!(report["warnings"][0].as_str().unwrap().contains("file_compression"), "{report}");
    assert_eq!(work.difference("a.vdb", "o.vdb")["max_abs"], 0.0);
}

/// OpenVDB's own constructors refuse determinants below 3e-15; its files hold uniform scales below all the same.
#[test]
fn tiny_voxels_work_or_are_refused_before_the_work() {
    for voxel in [1e-5, 1e-12] {
        let work = Work::new();
        let transform = Affine::uniform(voxel, DVec3::ZERO).unwrap();
        let mut grid = Grid { transform, tiles: vec![], ..fog("density", 2, 7) };
        work.write("a.vdb", &[&grid]);
        let back = File::open(work.path("a.vdb"), Limits::default()).unwrap().read_grid("density").unwrap();
        assert_eq!(back.transform, transform);
        assert_eq!(work.json("info a.vdb")["files"][0]["grids"][0]["transform"]["voxel_size"][0], voxel);
        assert_eq!(work.json("validate a.vdb")["valid"], true);
        work.json("render a.vdb --views 2 --size 16x16 --density-scale auto -o pictures");
        assert_eq!(work.json("diff a.vdb a.vdb")["same"], true);
        let words = format!("convert a.vdb b.vdb --crop=0,0,0,{:e},{:e},{:e}", 3.5 * voxel, 1.5 * voxel, 1.5 * voxel);
        // Of 16 voxels about half are active.
        let kept = work.json(&words)["grids"][0]["active_voxels"].as_u64().unwrap();
        assert!((1..=16).contains(&kept), "{kept}");
        let report = work.json(&format!("convert a.vdb b.vdb --resample {:e}", 0.5 * voxel));
        assert!(report["grids"][0]["active_voxels"].as_u64().unwrap() > 10_000);
        let fine = File::open(work.path("b.vdb"), Limits::default()).unwrap().read_grid("density").unwrap();
        assert_eq!(fine.transform, Affine::uniform(0.5 * voxel, DVec3::ZERO).unwrap());
        // What OpenVDB can write in no way is refused with the reason.
        for matrix in [
            DMat4::from_rotation_z(0.3) * DMat4::from_scale(DVec3::splat(voxel)),
            DMat4::from_scale(DVec3::new(voxel, 2.0 * voxel, voxel)),
            DMat4::from_translation(DVec3::splat(voxel)) * DMat4::from_scale(DVec3::splat(voxel)),
        ] {
            grid.transform = Affine::new(matrix).unwrap();
            let error = NativeGrid::from_grid(&grid).unwrap_err().to_string();
            assert!(
                error.contains("too small for OpenVDB to write") && error.contains("scale the scene up"),
                "{error}"
            );
        }
    }
}

#[test]
fn validate_finds_what_render_refuses() {
    let work = Work::new();
    let leaf = |value: f32| {
        let mut grid = Grid { tiles: vec![], ..fog("density", 1, 3) };
        grid.leaves[0].values[0] = value;
        grid.leaves[0].active[0] |= 1;
        grid
    };
    let with = |key: &str, text: &str| {
        let mut grid = leaf(0.5);
        grid.metadata.insert(key.into(), cumulo::scene::grid::MetaValue::Text(text.into()));
        grid
    };
    let apart = Grid { tiles: vec![tile([0; 3], 8, 1.0), tile([1 << 30, 1 << 30, 1 << 30], 8, 1.0)], ..empty(1.0) };
    for (grid, expected) in [
        (with("cumulo_transfer", "{ not json"), "no valid JSON"),
        (Grid { tiles: vec![tile([0; 3], 8, 3e38)], ..empty(1.0) }, "densities reach"),
        (apart, "too far apart"),
        (Grid { background: 5.0, ..leaf(0.5) }, "background [5.0] is infinite"),
    ] {
        work.write("a.vdb", &[&grid]);
        let out = work.command("validate a.vdb").output().unwrap();
        let text = String::from_utf8_lossy(&out.stdout).into_owned();
        assert_eq!(out.status.code(), Some(1), "{text}");
        assert!(text.contains(expected) && !text.contains("--crop it"), "{text}");
        let out = work.command("render a.vdb --views 1 --size 8x8 --density-scale auto -o p").output().unwrap();
        assert_eq!(out.status.code(), Some(2), "{expected}");
    }
    work.write("a.vdb", &[&leaf(0.5)]);
    assert_eq!(work.json("validate a.vdb")["valid"], true);
}
