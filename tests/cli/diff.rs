//! `cumulo diff` and reports over several files: names, unlike volumes, files that are not there.

use crate::common::grids::compact;
use crate::common::work::Work;
use cumulo::error::Code;
use cumulo::math::Affine;
use cumulo::metrics::volume::{Difference, Field, compare};
use cumulo::scene::grid::{Grid, Tile};
use glam::{DMat4, DVec3, IVec3};
use serde_json::Value;
use std::time::{Duration, Instant};

fn tile(origin: [i32; 3], dim: i32, value: f32, active: bool) -> Tile {
    Tile { origin, dim, value, active }
}

/// Value and state of a voxel, by a search through everything.
fn voxel(grid: &Grid, p: IVec3) -> (f32, bool) {
    let inside = |origin: [i32; 3], dim: i32| {
        let local = p - IVec3::from_array(origin);
        local.cmpge(IVec3::ZERO).all() && local.cmplt(IVec3::splat(dim)).all()
    };
    if let Some(leaf) = grid.leaves.iter().find(|l| inside(l.origin, 8)) {
        let l = p - IVec3::from_array(leaf.origin);
        let i = (l.x << 6 | l.y << 3 | l.z) as usize;
        return (leaf.values[i], leaf.active[i >> 6] >> (i & 63) & 1 == 1);
    }
    let tile = grid.tiles.iter().find(|t| inside(t.origin, t.dim));
    tile.map_or((grid.background, false), |t| (t.value, t.active))
}

fn sample(grid: &Grid, at: DVec3) -> (f32, bool) {
    let (base, f) = (at.floor(), at - at.floor());
    let mut sum = 0.0;
    for corner in 0..8 {
        let d = IVec3::new(corner & 1, corner >> 1 & 1, corner >> 2);
        let w: f64 = (0..3).map(|a| if d[a] == 1 { f[a] } else { 1.0 - f[a] }).product();
        if w > 0.0 {
            sum += w * f64::from(voxel(grid, base.as_ivec3() + d).0);
        }
    }
    (sum as f32, voxel(grid, at.round().as_ivec3()).1)
}

/// Every voxel of the domain, one by one.
fn brute(a: &Grid, b: &Grid, low: IVec3, high: IVec3) -> (f64, f64, f64) {
    let (mut squares, mut largest, mut both, mut either) = (0.0, 0.0_f64, 0.0, 0.0);
    for x in low.x..=high.x {
        for y in low.y..=high.y {
            for z in low.z..=high.z {
                let p = IVec3::new(x, y, z);
                let (u, on) = voxel(a, p);
                let (v, other) = sample(b, b.transform.to_index(a.transform.to_world(p.as_dvec3())));
                let d = f64::from(u) - f64::from(v);
                squares += d * d;
                largest = largest.max(d.abs());
                both += f64::from(u8::from(on && other));
                either += f64::from(u8::from(on || other));
            }
        }
    }
    let count = (high - low + 1).as_dvec3().element_product();
    ((squares / count).sqrt(), largest, both / either)
}

fn difference(a: &Grid, b: &Grid) -> Difference {
    compare(&Field::from_grid(a), &Field::from_grid(b)).unwrap()
}

/// Cubes that are compared as a whole, and blocks that are compared voxel by voxel, add up to all voxels.
#[test]
fn parted_by_nodes_the_difference_is_that_of_all_voxels() {
    let with = |n, seed, tiles: Vec<Tile>| Grid { tiles, ..compact("density", n, seed) };
    let a = with(2, 1, vec![tile([16, 0, 0], 8, 0.5, true), tile([-24, 8, -16], 8, 0.25, false)]);
    let b = with(3, 2, vec![tile([16, 8, 0], 8, 0.75, true), tile([-24, 8, -16], 8, 0.25, true)]);
    for (a, b) in [(&a, &b), (&b, &a), (&a, &a)] {
        let found = difference(a, b);
        let bounds = a.active_box().union(b.active_box());
        let (rms, largest, iou) = brute(a, b, bounds.min.as_ivec3(), bounds.max.as_ivec3());
        assert!((found.rms - rms).abs() <= 1e-12 * rms, "{} {rms}", found.rms);
        assert_eq!((found.max_abs, found.topology_iou), (largest, iou));
    }
    // On other lattices: finer, coarser, turned.
    let turned = DMat4::from_rotation_z(0.4) * DMat4::from_scale(DVec3::new(0.2, 0.3, 0.25));
    let coarse = DMat4::from_scale(DVec3::new(0.6, 0.9, 0.7));
    for map in [DMat4::from_scale(DVec3::splat(0.11)), DMat4::from_scale(DVec3::splat(0.6)), coarse, turned] {
        let b = Grid {
            transform: Affine::new(DMat4::from_translation(DVec3::new(1.0, -2.1, 3.2)) * map).unwrap(),
            ..b.clone()
        };
        let found = difference(&a, &b);
        let index = b.active_box().corners().map(|c| a.transform.to_index(b.transform.to_world(c)));
        let bounds = index.into_iter().fold(cumulo::math::Aabb::EMPTY, |all, c| all.including(c));
        let (low, high) = ((bounds.min + 1e-6).floor(), (bounds.max - 1e-6).ceil());
        let bounds = cumulo::math::Aabb { min: low, max: high }.union(a.active_box());
        let (low, high) = (bounds.min.as_ivec3(), bounds.max.as_ivec3());
        let (rms, largest, iou) = brute(&a, &b, low, high);
        assert_eq!(found.voxels as f64, (high - low + 1).as_dvec3().element_product());
        assert!((found.rms - rms).abs() <= 1e-6 * rms, "{} {rms}", found.rms);
        assert!((found.max_abs - largest).abs() < 1e-6 && (found.topology_iou - iou).abs() < 1e-12);
    }
}

/// Volumes far apart, and on unlike lattices: 245 s for what their boxes span.
#[test]
fn unlike_volumes_are_compared_in_seconds() {
    let work = Work::new();
    let mut far = compact("density", 12, 4);
    far.leaves.iter_mut().for_each(|leaf| leaf.origin = leaf.origin.map(|c| c + 1600));
    far.transform = Affine::uniform(0.23, DVec3::ZERO).unwrap();
    work.write("a.vdb", &[&compact("density", 12, 3)]);
    work.write("b.vdb", &[&far]);
    // A coarse volume around a fine one: 8.5e9 voxels of the fine lattice.
    let mut coarse = compact("density", 12, 5);
    coarse.transform = Affine::uniform(5.3, DVec3::ZERO).unwrap();
    work.write("c.vdb", &[&coarse]);
    let start = Instant::now();
    assert!(work.difference("a.vdb", "c.vdb")["voxels"].as_u64().unwrap() > 8_000_000_000);
    assert!(start.elapsed() < Duration::from_secs(20), "{:?}", start.elapsed());
    let start = Instant::now();
    let found = work.difference("a.vdb", "b.vdb");
    assert!(start.elapsed() < Duration::from_secs(15), "{:?}", start.elapsed());
    assert!(found["voxels"].as_u64().unwrap() > 2_000_000_000 && found["topology_iou"] == 0.0, "{found}");
    // Boxes that no walk over blocks would end with.
    far.leaves.iter_mut().for_each(|leaf| leaf.origin = leaf.origin.map(|c| c + (1 << 30)));
    far.transform = compact("density", 1, 1).transform;
    work.write("b.vdb", &[&far]);
    assert_eq!(work.difference("a.vdb", "b.vdb")["topology_iou"], 0.0);
}

#[test]
fn names_that_differ_are_a_difference() {
    let work = Work::new();
    let a = compact("density", 1, 3);
    work.write("a.vdb", &[&a]);
    work.write("b.vdb", &[&Grid { name: "smoke".into(), ..a }]);
    let out = work.command("diff a.vdb b.vdb --json").output().unwrap();
    assert_eq!(out.status.code(), Some(1));
    let report: Value = serde_json::from_slice(&out.stdout).unwrap();
    let grid = &report["grids"][0];
    assert_eq!(
        (&report["same"], &grid["name"], &grid["name_in_b"]),
        (&false.into(), &"density".into(), &"smoke".into())
    );
    let out = work.command("diff a.vdb b.vdb").output().unwrap();
    let text = String::from_utf8_lossy(&out.stdout).into_owned();
    assert!(
        text.contains("in the second file 'smoke'") && text.contains("different: grid 'density': the name"),
        "{text}"
    );
    assert_eq!(work.json("diff a.vdb b.vdb --grid density")["same"], true);
    assert!(work.json("diff a.vdb a.vdb")["grids"][0].get("name_in_b").is_none());
}

#[test]
fn comparing_is_refused_where_both_do_not_fit() {
    let work = Work::new();
    // 28³ leaves of 2 KiB are 43 MiB, of the first grid as they are compared, and of the second as they are read, too.
    work.write("a.vdb", &[&compact("density", 28, 3)]);
    work.refused("diff a.vdb a.vdb --max-memory 112M", Code::MemoryLimit, &["--max-memory"]);
    assert_eq!(work.json("diff a.vdb a.vdb --max-memory 1G")["same"], true);
}

#[test]
fn a_missing_file_does_not_hide_the_good_one() {
    let work = Work::new();
    work.write("a.vdb", &[&compact("density", 1, 3)]);
    for command in ["info", "validate"] {
        let out = work.command(&format!("{command} a.vdb missing.vdb a.vdb --json")).output().unwrap();
        assert_eq!(out.status.code(), Some(2));
        let report: Value = serde_json::from_slice(&out.stdout).unwrap();
        let files = report["files"].as_array().unwrap();
        assert_eq!(files.len(), 3);
        assert!(files[0].get("error").is_none() && files[2]["format"] == "vdb");
        assert!(files[1]["error"]["what"].as_str().unwrap().contains("No such file"), "{report}");
        let errors = String::from_utf8_lossy(&out.stderr).into_owned();
        assert!(errors.contains("missing.vdb"), "{errors}");
        let out = work.command(&format!("{command} a.vdb missing.vdb")).output().unwrap();
        let text = String::from_utf8_lossy(&out.stdout).into_owned();
        assert!(
            out.status.code() == Some(2) && text.contains("a.vdb: ") && text.contains("missing.vdb: could not"),
            "{text}"
        );
        // Of one file alone it is the error of the command.
        let out = work.command(&format!("{command} missing.vdb")).output().unwrap();
        assert!(out.status.code() == Some(2) && out.stdout.is_empty());
    }
}

/// A volume that is another one times a factor is told as such, on one lattice, on two, and by a sample.
#[test]
fn a_multiple_is_told() {
    let work = Work::new();
    work.json("convert @plume.vdb three.vdb --scale 3");
    let same = work.difference("@plume.vdb", "three.vdb");
    // The plume holds 16-bit floats, to which three times its values are rounded.
    assert!((same["multiple"]["factor"].as_f64().unwrap() - 3.0).abs() < 1e-3, "{same}");
    assert!(same["multiple"]["psnr_db"].as_f64().unwrap() > 80.0, "{same}");
    let text = String::from_utf8(work.command("diff @plume.vdb three.vdb").output().unwrap().stdout).unwrap();
    assert!(text.contains("B is 3.000") && text.contains("--scale 0.3333"), "{text}");
    // Coarser voxels, so that constants and cells are compared. Means are less steep, whatever the scale.
    work.json("convert @plume.vdb coarse.vdb --resample 0.13");
    work.json("convert three.vdb coarse_three.vdb --resample 0.13");
    let [one, three] = ["coarse.vdb", "coarse_three.vdb"].map(|name| work.difference("@plume.vdb", name));
    let of = |difference: &Value, key: &str| difference["multiple"][key].as_f64().unwrap();
    assert!((of(&three, "factor") / of(&one, "factor") - 3.0).abs() < 1e-3, "{one} {three}");
    assert!((of(&three, "psnr_db") - of(&one, "psnr_db")).abs() < 0.01, "{one} {three}");
    // What no factor explains is not said to be one.
    let other = String::from_utf8(work.command("diff @plume.vdb @cube.vdb").output().unwrap().stdout).unwrap();
    assert!(!other.contains("times A"), "{other}");
}
