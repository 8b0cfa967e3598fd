//! The same inputs give the same bits as the version before: hashes of what commands write.
//!
//! A hash that moves says that arithmetic changed. If that was meant, the run prints the new table; say in the change
//! log what moved, and why. The hashes are those of x86-64 with glibc, whose exponentials and sines go into them.

use crate::common::fields::{tinted, unit};
use crate::common::work::{self, Work};
use cumulo::formats::exr::read_picture;
use cumulo::formats::limits::Limits;
use cumulo::formats::vdb::{File, shaded};
use cumulo::formats::{transfer, transforms};
use serde_json::Value;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::fmt::Write;

/// Peaks, a gap, and a step up and down.
const FUNCTION: &str = r#"{"format": "cumulo-transfer-function", "version": 1, "transfer": {"kind": "piecewise", "points": [
    [0.0, 0.9, 0.3, 0.1, 0.0], [0.15, 1.0, 0.5, 0.1, 2.0], [0.25, 0.4, 0.6, 0.2, 0.0], [0.34, 0.4, 0.6, 0.2, 0.0],
    [0.34, 0.1, 0.2, 0.8, 3.0], [0.6, 0.1, 0.2, 0.8, 1.0], [0.6, 0.8, 0.2, 0.1, 4.0], [1.2, 0.9, 0.2, 0.1, 6.0]]}}"#;
/// Two slopes, to be found again.
const SLOPES: &str = r#"{"format": "cumulo-transfer-function", "version": 1, "transfer": {"kind": "piecewise", "points": [
    [0.0, 0.1, 0.4, 0.9, 0.0], [0.4, 0.9, 0.4, 0.1, 2.0], [1.0, 0.2, 0.8, 0.3, 9.0]]}}"#;

/// What commands make, and the first eight bytes of the SHA-256 of its numbers.
const KNOWN: &[(&str, &str)] = &[
    ("absorption", "9f15e1168f31139f"),
    ("absorption midpoint", "21155fe697d3a592"),
    ("linear", "8b57e855a96ad750"),
    ("linear midpoint", "4edd53612c7b2028"),
    ("grey riemann, 4 rays", "2668af9fda27da88"),
    ("function", "c263925ddd896e57"),
    ("function preintegrated", "a47fc1000172755f"),
    ("function midpoint", "a22177c7205564df"),
    ("pre-shaded", "6e5f0fd6f23fb0cb"),
    ("by density", "e733d11ec254ccad"),
    ("by density, linear", "92b7ff23758a4cf5"),
    ("by density, midpoint", "420dde0df428cf21"),
    ("by density, inversion", "207e1527f983879c"),
    ("by density, function", "1ad70295348808ce"),
    ("by density, preintegrated", "d9583b994d6affe5"),
    ("by density, preintegrated replay", "d9583b994d6affe5"),
    ("by density, pre-shaded", "417d14591d8b12a3"),
    ("derivatives backward", "a8a33fc8228c2f36"),
    ("derivatives forward", "9fccf205ef02598f"),
    ("derivatives by step", "71156b0379d7f9ec"),
    ("derivatives preintegrated", "7f86199b75908199"),
    ("derivatives pre-shaded", "f1d70498e4ed6a60"),
    ("density", "316474d932f6f5dc"),
    ("density by a function", "10ad89029ccb2855"),
    ("density by descent", "d806cb02d4a7cabc"),
    ("colors", "e8dd0eac390d9ba1"),
    ("function by pictures", "3c2180a4be76ff40"),
    ("pose", "444b37fbb6fe82e6"),
    ("viewpoint", "9d1a7325662e915b"),
];

/// Hash of numbers, bit by bit.
fn hash(numbers: impl IntoIterator<Item = f64>) -> String {
    let mut numbers = numbers.into_iter().peekable();
    assert!(numbers.peek().is_some(), "nothing was written");
    let mut hash = Sha256::new();
    numbers.for_each(|n| hash.update(n.to_bits().to_le_bytes()));
    hash.finalize()[..8].iter().fold(String::new(), |mut text, byte| {
        write!(text, "{byte:02x}").unwrap();
        text
    })
}

/// Pixels of a capture, view after view.
fn pixels(work: &Work, capture: &str) -> String {
    let frames = transforms::load(&work.path(capture)).unwrap().frames;
    let of = |path| read_picture(path, None).unwrap().rgba.into_iter().flatten().map(f64::from).collect::<Vec<_>>();
    hash(frames.iter().flat_map(|frame| of(&frame.picture)))
}

/// Voxels of a grid of scalars, leaf after leaf, with where these lie.
fn voxels(work: &Work, file: &str, grid: &str) -> String {
    let mut grid = File::open(work.path(file), Limits::default()).unwrap().read_grid(grid).unwrap();
    grid.leaves.sort_by_key(|leaf| leaf.origin);
    let of = |leaf: &cumulo::scene::grid::Leaf| {
        let values = leaf.values.iter().map(|v| f64::from(*v));
        leaf.origin.map(f64::from).into_iter().chain(values).collect::<Vec<_>>()
    };
    hash(grid.leaves.iter().flat_map(of))
}

/// Voxels of a pre-shaded volume.
fn shaded_voxels(work: &Work, file: &str) -> String {
    let file = File::open(work.path(file), Limits::default()).unwrap();
    let volume = shaded::read(&file, None, 1 << 30).unwrap();
    hash(volume.owned().iter().flat_map(|v| v.to_array()).map(f64::from))
}

/// The numbers of a list of a report, under these keys.
fn numbers(report: &Value, list: &str, keys: &[&str]) -> String {
    let rows = report[list].as_array().unwrap();
    assert!(!rows.is_empty(), "{report}");
    hash(rows.iter().flat_map(|row| keys.iter().map(|key| row[key].as_f64().unwrap())))
}

/// Cameras of a capture.
fn cameras(work: &Work, capture: &str) -> String {
    let frames = transforms::load(&work.path(capture)).unwrap().frames;
    hash(frames.iter().flat_map(|f| f.camera.camera_to_world.to_cols_array()))
}

#[test]
fn what_commands_write_has_the_bits_that_it_had() {
    let work = Work::new();
    std::fs::write(work.path("f.tf.json"), FUNCTION).unwrap();
    std::fs::write(work.path("slopes.tf.json"), SLOPES).unwrap();
    shaded::write(&work.path("shaded.vdb"), &tinted::<f32>(16, 0.4, unit()), &[], &BTreeMap::new()).unwrap();
    let mut found: Vec<(&str, String)> = Vec::new();

    let size = "--views 3 --size 40x30 --density-scale 0.4";
    let emission = "--model emission-absorption --emission 0.2,0.9,0.5";
    for (name, words) in [
        ("absorption", format!("@plume.vdb {size}")),
        ("absorption midpoint", format!("@plume.vdb {size} --quadrature midpoint:0.6")),
        ("linear", format!("@plume.vdb {size} {emission} --emission-model linear")),
        ("linear midpoint", format!("@plume.vdb {size} {emission} --emission-model linear --quadrature midpoint:0.5")),
        ("grey riemann, 4 rays", format!("@plume.vdb {size} {emission} --quadrature riemann:0.7 --supersample 2")),
        ("function", format!("@plume.vdb {size} --tf f.tf.json --quadrature exact")),
        ("function preintegrated", format!("@plume.vdb {size} --tf f.tf.json --background 0.1,0.2,0.3")),
        ("function midpoint", format!("@plume.vdb {size} --tf f.tf.json --quadrature midpoint:0.7")),
        ("pre-shaded", "shaded.vdb --views 3 --size 40x30 --model pre-shaded --background 0.3,0.1,0.2".to_owned()),
    ] {
        let folder = name.replace([' ', ','], "_");
        work.json(&format!("render {words} -o {folder}"));
        found.push((name, pixels(&work, &folder)));
    }

    for (name, words) in [
        ("by density", "@plume.vdb --target absorption"),
        ("by density, linear", "@plume.vdb --target linear --background 0.1,0.1,0.2"),
        ("by density, midpoint", "@plume.vdb --target linear --quadrature midpoint:0.8 --adjoint replay"),
        ("by density, inversion", "@plume.vdb --target linear --adjoint inversion"),
        ("by density, function", "@plume.vdb --target function"),
        ("by density, preintegrated", "@plume.vdb --target function --quadrature preintegrated"),
        (
            "by density, preintegrated replay",
            "@plume.vdb --target function --quadrature preintegrated --adjoint replay",
        ),
        ("by density, pre-shaded", "shaded.vdb --target pre-shaded --background 0.9,0.1,0.1"),
    ] {
        let scale = if words.contains("shaded.vdb") { "" } else { "--density-scale 0.3" };
        work.json(&format!("gradient {words} --loss l2 --wrt density --mode adjoint {scale} -o g.vdb"));
        found.push((name, voxels(&work, "g.vdb", "gradient")));
    }
    for (name, words) in [
        ("derivatives backward", "@plume.vdb --target function --wrt tf,camera,extinction,background --mode adjoint"),
        ("derivatives forward", "@plume.vdb --target function --wrt tf,camera,extinction,background --mode tangent"),
        ("derivatives by step", "@plume.vdb --target linear --wrt step,camera --quadrature riemann:0.7"),
        ("derivatives preintegrated", "@plume.vdb --target function --wrt tf,camera --quadrature preintegrated"),
        ("derivatives pre-shaded", "shaded.vdb --target pre-shaded --wrt camera,background --mode tangent"),
    ] {
        let report = work.json(&format!("gradient {words} --loss l2 --background 0.3,0.2,0.4"));
        found.push((name, numbers(&report, "rows", &["gradient"])));
    }

    work.json("render @plume.vdb --views 10 --size 24x24 --density-scale 0.4 -o many");
    work.json("reconstruct density many -o density.vdb --iterations 6 --resolution 16");
    found.push(("density", voxels(&work, "density.vdb", "density")));
    work.json("render @plume.vdb --views 10 --size 24x24 --tf slopes.tf.json --background 0.2,0.1,0.3 -o bright");
    work.json("reconstruct density bright -o behind.vdb --iterations 2 --resolution 16");
    found.push(("density by a function", voxels(&work, "behind.vdb", "density")));
    work.json("reconstruct density bright -o paper.vdb --solver weiss2021 --iterations 2 --resolution 16");
    found.push(("density by descent", voxels(&work, "paper.vdb", "density")));
    work.json("reconstruct color bright -o colors.vdb --iterations 3 --resolution 16");
    found.push(("colors", shaded_voxels(&work, "colors.vdb")));
    work.json("reconstruct tf bright --volume @plume.vdb -o found.tf.json --texels 16 --rays 2000 --iterations 5");
    let transfer = transfer::load(&work.path("found.tf.json"), &transfer::Options::default()).unwrap().transfer;
    found.push(("function by pictures", hash(transfer.table().unwrap().values().iter().flatten().copied())));
    work.json("pose bright --volume @plume.vdb -o posed.json --iterations 3");
    found.push(("pose", cameras(&work, "posed.json")));
    let out =
        work.command("viewpoint @plume.vdb -o view.json --samples 20 --iterations 4 --size 24x24").output().unwrap();
    assert!(out.status.success(), "{}", work::errors(&out));
    found.push(("viewpoint", cameras(&work, "view.json")));

    let table = found.iter().fold(String::new(), |mut text, (name, hash)| {
        writeln!(text, "    ({name:?}, {hash:?}),").unwrap();
        text
    });
    let moved: Vec<&str> = found.iter().filter(|(n, h)| !KNOWN.contains(&(n, h))).map(|(name, _)| *name).collect();
    assert!(moved.is_empty() && found.len() == KNOWN.len(), "moved: {moved:?}; all there are now:\n{table}");
}
