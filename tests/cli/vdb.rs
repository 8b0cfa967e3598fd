//! The commands on VDB files: what they print, and how they end.

use crate::common::grids::compact;
use crate::common::refusal;
use crate::common::work::cumulo;
use cumulo::error::Code;
use cumulo::formats::limits::Limits;
use cumulo::formats::vdb::{Codec, File, write_grids};
use cumulo::scene::grid::{Grid, GridClass};
use predicates::str::contains;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

fn json(arguments: &[&str], code: i32) -> Value {
    let out = cumulo().args(arguments).arg("--json").assert().code(code).get_output().stdout.clone();
    serde_json::from_slice(&out).unwrap()
}

fn write(dir: &Path, name: &str, grids: &[&Grid]) -> PathBuf {
    let path = dir.join(name);
    write_grids(&path, grids, &BTreeMap::new(), Codec::Blosc, false).unwrap();
    path
}

fn folder() -> TempDir {
    tempfile::tempdir().unwrap()
}

#[test]
fn info_reports_statistics_that_add_up() {
    let dir = folder();
    let grid = compact("density", 2, 1);
    let path = write(dir.path(), "a.vdb", &[&grid]);
    let report = json(&["info", path.to_str().unwrap()], 0);
    let found = &report["files"][0]["grids"][0];
    let active: u64 = grid.leaves.iter().flat_map(|l| l.active).map(|w| u64::from(w.count_ones())).sum();
    assert_eq!(found["active_voxels"], active);
    assert_eq!((&found["class"], &found["leaves"]), (&"fog volume".into(), &8.into()));
    let s = &found["statistics"];
    let counts: u64 = s["histogram"].as_array().unwrap().iter().map(|n| n.as_u64().unwrap()).sum();
    assert_eq!(counts, active);
    let sum: f64 = grid.leaves.iter().flat_map(|l| l.values.iter()).map(|v| f64::from(*v)).sum();
    // Same additions in the same order.
    assert_eq!(s["mean"], sum / active as f64);
    // Voxel 0 is at world (1, -2, 3) with edge 0.25; the box reaches half a voxel beyond index -8.
    let low = found["world_bounds"]["min"][0].as_f64().unwrap();
    assert!((low - (1.0 + 0.25 * (found["index_bounds"]["min"][0].as_f64().unwrap() - 0.5))).abs() < 1e-12);
    cumulo().args(["info", path.to_str().unwrap()]).assert().success().stdout(contains("grid 'density': float, fog"));
}

#[test]
fn validate_names_what_is_wrong_and_repair_mends_it() {
    let dir = folder();
    let mut grid = compact("density", 1, 2);
    grid.leaves[0].active = [u64::MAX; 8];
    (grid.leaves[0].values[0], grid.leaves[0].values[1], grid.leaves[0].values[2]) = (f32::NAN, f32::INFINITY, -1.0);
    let mut empty = compact("empty", 1, 3);
    empty.leaves.clear();
    let path = write(dir.path(), "a.vdb", &[&grid, &empty]);
    let text = json(&["validate", path.to_str().unwrap()], 1).to_string();
    for word in ["NaN", "infinite", "negative", "empty", "--repair"] {
        assert!(text.contains(word), "{word}: {text}");
    }
    let good = dir.path().join("b.vdb");
    let (from, to) = (path.to_str().unwrap(), good.to_str().unwrap());
    let done = json(&["convert", from, to, "--repair", "--grid", "density"], 0);
    assert_eq!(done["grids"][0]["repaired"], 3);
    assert_eq!(json(&["validate", to], 0)["valid"], true);
}

/// What `render` refuses is found by `validate` or mended by what the refusal says: values that are not
/// active, and densities in grids that are not marked as such.
#[test]
fn every_refusal_of_a_density_has_a_way_out() {
    let dir = folder();
    let to = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let mut hidden = compact("density", 1, 7);
    hidden.background = 0.0;
    hidden.leaves[0].active = [0; 8];
    hidden.leaves[0].active[0] = 1;
    hidden.leaves[0].values.fill(0.5);
    hidden.leaves[0].values[9] = -1.0;
    let mut unmarked = hidden.clone();
    unmarked.class = GridClass::Unknown;
    unmarked.leaves[0].active = [u64::MAX; 8];
    for (grid, name, code, repair) in
        [(&hidden, "hidden", 1, "--repair"), (&unmarked, "unmarked", 0, "--repair=density")]
    {
        let path = write(dir.path(), &format!("{name}.vdb"), &[grid]);
        let path = path.to_str().unwrap();
        let report = json(&["validate", path], code).to_string();
        assert!(report.contains("negative") && report.contains(repair), "{name}: {report}");
        let words = ["render", path, "--views", "1", "--size", "4x4", "-o", &to(&format!("{name}-shots"))];
        cumulo().args(words).assert().code(2).stderr(contains("--repair=density"));
        let good = to(&format!("{name}-good.vdb"));
        assert_eq!(json(&["convert", path, &good, repair], 0)["grids"][0]["repaired"], 1, "{name}");
        cumulo().args(["render", &good]).args(&words[2..]).assert().success();
    }
    // By its class alone nothing in it is wrong.
    let kept = json(&["convert", &to("unmarked.vdb"), &to("kept.vdb"), "--repair"], 0);
    assert_eq!(kept["grids"][0]["repaired"], 0);
}

#[test]
fn validate_refuses_a_truncated_file_and_does_not_stop_there() {
    let dir = folder();
    let path = write(dir.path(), "a.vdb", &[&compact("density", 1, 4)]);
    let cut = dir.path().join("cut.vdb");
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&cut, &bytes[..bytes.len() - 1]).unwrap();
    let report = json(&["validate", cut.to_str().unwrap(), path.to_str().unwrap()], 1);
    assert_eq!((&report["files"][0]["valid"], &report["files"][1]["valid"]), (&false.into(), &true.into()));
}

#[test]
fn convert_renames_crops_prunes_and_packs() {
    let dir = folder();
    let path = write(dir.path(), "a.vdb", &[&compact("density", 2, 5), &compact("other", 1, 6)]);
    let out = dir.path().join("b.vdb");
    let (from, to) = (path.to_str().unwrap(), out.to_str().unwrap());
    // World x from 1 on is index 0 on: half of the leaves.
    let arguments =
        ["convert", from, to, "--grid", "density", "--rename", "density=smoke", "--half", "--codec", "none"];
    cumulo().args(arguments).args(["--crop", "1,-9,-9,9,9,9", "--prune", "0"]).assert().success();
    let file = File::open(&out, Limits::default()).unwrap();
    assert_eq!(file.entries().len(), 1);
    let info = file.read("smoke").unwrap().info().unwrap();
    assert!(info.half && info.leaf_count == 4, "{info:?}");
    assert_eq!(info.index_box.unwrap().0[0], 0);
}

#[test]
fn convert_counts_what_half_cannot_hold() {
    let dir = folder();
    let mut grid = compact("density", 1, 7);
    (grid.leaves[0].values[0], grid.leaves[0].values[1]) = (70_000.0, 1e-9);
    let path = write(dir.path(), "a.vdb", &[&grid]);
    let out = dir.path().join("b.vdb");
    let done = json(&["convert", path.to_str().unwrap(), out.to_str().unwrap(), "--half"], 0);
    assert_eq!((&done["grids"][0]["half_overflow"], &done["grids"][0]["half_underflow"]), (&1.into(), &1.into()));
}

#[test]
fn resampling_reproduces_a_linear_ramp() {
    let dir = folder();
    let mut grid = compact("density", 2, 8);
    for leaf in &mut grid.leaves {
        leaf.active = [u64::MAX; 8];
        for i in 0..512 {
            leaf.values[i] = (leaf.origin[0] + (i >> 6) as i32) as f32;
        }
    }
    let path = write(dir.path(), "a.vdb", &[&grid]);
    let out = dir.path().join("b.vdb");
    let (from, to) = (path.to_str().unwrap(), out.to_str().unwrap());
    cumulo().args(["convert", from, to, "--resample", "0.125"]).assert().success();
    let fine = File::open(&out, Limits::default()).unwrap().read_grid("density").unwrap();
    assert!((fine.transform.voxel_size() - 0.125).length() < 1e-12);
    let leaf = fine.leaves.iter().find(|l| l.origin == [0, 0, 0]).unwrap();
    for (i, v) in leaf.values.iter().enumerate() {
        // Trilinear interpolation is exact on a ramp; halves are exact in f32.
        assert_eq!(*v, 0.5 * (i >> 6) as f32);
    }
}

#[test]
fn diff_is_nothing_for_a_copy_and_right_for_an_offset() {
    let dir = folder();
    let a = compact("density", 2, 9);
    let mut b = a.clone();
    b.leaves.iter_mut().for_each(|l| l.values.iter_mut().for_each(|v| *v += 0.25));
    b.background = 0.25;
    let (pa, pb) = (write(dir.path(), "a.vdb", &[&a]), write(dir.path(), "b.vdb", &[&b]));
    let (pa, pb) = (pa.to_str().unwrap(), pb.to_str().unwrap());
    let same = json(&["diff", pa, pa], 0);
    assert_eq!((&same["grids"][0]["psnr_db"], &same["grids"][0]["topology_iou"]), (&Value::Null, &1.0.into()));
    let other = json(&["diff", pa, pb], 1);
    let g = &other["grids"][0];
    // Each sum rounds once in f32: at most 2^-24 of a value below 2.
    assert!((g["rms"].as_f64().unwrap() - 0.25).abs() < 2e-7, "{g}");
    let peak = a.leaves.iter().flat_map(|l| l.values.iter()).fold(0.0_f32, |m, v| m.max(*v));
    let expected = 20.0 * (f64::from(peak) / 0.25).log10();
    assert!((g["psnr_db"].as_f64().unwrap() - expected).abs() < 1e-5, "{g}");
    assert_eq!(json(&["diff", pa, pb, "--tolerance", "0.26"], 0)["same"], true);
}

#[test]
fn diff_samples_through_world_space_where_lattices_differ() {
    let dir = folder();
    let a = compact("density", 2, 10);
    let mut b = a.clone();
    b.transform = cumulo::math::Affine::uniform(0.25, glam::DVec3::new(1.25, -2.0, 3.0)).unwrap();
    let (pa, pb) = (write(dir.path(), "a.vdb", &[&a]), write(dir.path(), "b.vdb", &[&b]));
    let report = json(&["diff", pa.to_str().unwrap(), pb.to_str().unwrap()], 1);
    let g = &report["grids"][0];
    // One voxel of 0.25 along x, whatever the corner.
    assert!((g["transform_difference"].as_f64().unwrap() - 0.25).abs() < 1e-12, "{g}");
    assert!(g["rms"].as_f64().unwrap() > 0.1 && g["topology_iou"].as_f64().unwrap() < 0.6, "{g}");
}

#[test]
fn wrong_use_ends_with_2_and_says_what_is_expected() {
    let dir = folder();
    let path = write(dir.path(), "a.vdb", &[&compact("density", 1, 11)]);
    let p = path.to_str().unwrap();
    let cases: [(&[&str], Code, &str); 9] = [
        (&["info"], Code::Usage, "FILE"),
        (&["info", "/nowhere.vdb"], Code::NotFound, "/nowhere.vdb"),
        (&["validate", "/nowhere.vdb"], Code::NotFound, "/nowhere.vdb"),
        (&["info", p, "--max-memory", "many"], Code::Usage, "4G"),
        (&["convert", p, "/nowhere/b.vdb"], Code::NotFound, "/nowhere/b.vdb"),
        (&["convert", p, "/tmp/b.vdb", "--grid", "smoke"], Code::NoSuchGrid, "'density'"),
        (&["convert", p, "/tmp/b.vdb", "--crop", "1,2,3"], Code::Usage, "--crop"),
        (&["convert", p, "/tmp/b.vdb", "--resample", "0"], Code::Usage, "--resample"),
        (&["diff", p, p, "--grid", "smoke"], Code::NoSuchGrid, "'density'"),
    ];
    for (arguments, code, fact) in cases {
        refusal::of(arguments, code, &[fact]);
    }
}
