//! Patterns and folders in every command that reads files: frame by frame, with the frames that fail named at the end.

use crate::common::grids::fog;
use crate::common::work::{self, Work, errors};
use cumulo::error::Code;
use cumulo::formats::exr;
use cumulo::math::Affine;
use cumulo::scene::film::Film;
use cumulo::scene::grid::Grid;
use glam::DVec3;
use serde_json::{Value, json};
use std::collections::BTreeMap;

fn grid(scale: f32) -> Grid {
    let mut grid = Grid { tiles: vec![], ..fog("density", 2, 7) };
    grid.leaves.iter_mut().for_each(|leaf| leaf.values.iter_mut().for_each(|v| *v *= scale));
    grid
}

/// Frames 1 to 6 that grow a little.
fn steady() -> Work {
    let work = Work::new();
    std::fs::create_dir(work.path("s")).unwrap();
    for n in 1..=6 {
        work.write(&format!("s/smoke.{n:04}.vdb"), &[&grid(1.0 + 0.1 * n as f32)]);
    }
    work
}

/// Runs with `--json` and gives the exit code and the document.
fn run(work: &Work, words: &str) -> (i32, Value) {
    let out = work.command(words).arg("--json").output().unwrap();
    let document = serde_json::from_slice(&out.stdout);
    (out.status.code().unwrap(), document.unwrap_or_else(|e| panic!("{words}: {e}\n{}", errors(&out))))
}

fn numbers(list: &Value, key: &str) -> Vec<u64> {
    list.as_array().unwrap().iter().map(|entry| entry[key].as_u64().unwrap()).collect()
}

#[test]
fn frames_are_described_in_order_whatever_names_them() {
    let work = steady();
    std::fs::remove_file(work.path("s/smoke.0004.vdb")).unwrap();
    for name in ["s/smoke.####.vdb", "s/smoke.%04d.vdb", "s/smoke.0001-0006.vdb", "s"] {
        let (code, report) = run(&work, &format!("info {name}"));
        assert_eq!((code, numbers(&report["files"], "frame")), (2, vec![1, 2, 3, 5, 6]), "{name}");
        let sequence = &report["sequences"][0];
        assert_eq!((&sequence["missing"], &sequence["frames"]), (&json!([4]), &json!(5)), "{sequence}");
    }
    let (code, some) = run(&work, "info s --frames 1-5x2");
    assert_eq!((code, numbers(&some["files"], "frame")), (0, vec![1, 3, 5]));
    let out = work.command("info s").output().unwrap();
    let text = String::from_utf8(out.stdout).unwrap();
    assert!(text.contains("smoke.####.vdb: 5 frames, 1 to 6") && text.contains("missing: 4"), "{text}");
    assert_eq!(text.lines().filter(|line| line.contains("'density'")).count(), 5, "{text}");
    // Damaged ones do not hide the others.
    std::fs::write(work.path("s/smoke.0002.vdb"), "none").unwrap();
    let (code, report) = run(&work, "info s");
    assert_eq!((code, &report["sequences"][0]["failed"]), (2, &json!([2])));
    assert_eq!(report["files"].as_array().unwrap().len(), 5);
    work.refused("info s/smoke.0001.vdb --frames 1-3", Code::Invalid, &["--frames", "no sequence"]);
    work.refused("info t.####.vdb", Code::Invalid, &["t.0001.vdb"]);
}

#[test]
fn a_steady_sequence_is_valid_and_what_breaks_it_is_found() {
    let work = steady();
    let (code, report) = run(&work, "validate s");
    assert_eq!(
        (code, &report["valid"], &report["sequences"][0]["findings"]),
        (0, &json!(true), &json!([])),
        "{report}"
    );
    // One fault at a time, each in a fresh sequence.
    let broken = |change: &dyn Fn(&Work), expected: &[&str]| {
        let work = steady();
        change(&work);
        let (code, report) = run(&work, "validate s");
        let found = report["sequences"][0]["findings"].to_string();
        // What is missing cannot be checked, which is an error.
        let missing = expected[0].contains("missing");
        assert_eq!((code, &report["valid"]), (if missing { 2 } else { 1 }, &json!(false)), "{expected:?}: {report}");
        for text in expected {
            assert!(found.contains(text), "'{text}' is not in {found}");
        }
    };
    broken(&|w| std::fs::remove_file(w.path("s/smoke.0003.vdb")).unwrap(), &["frames are missing: 3"]);
    broken(&|w| w.write("s/smoke.0003.vdb", &[&grid(40.0)]), &["largest value of frame 3", "sum of the values"]);
    broken(
        &|w| w.write("s/smoke.0003.vdb", &[&Grid { name: "smoke".into(), ..grid(1.3) }]),
        &["grid 'density'", "not in frames 3", "grid 'smoke'", "in frames 3, but not in frames 1-2, 4-6"],
    );
    let coarse = || Grid { transform: Affine::uniform(0.5, DVec3::ZERO).unwrap(), ..grid(1.3) };
    broken(&|w| w.write("s/smoke.0003.vdb", &[&coarse()]), &["voxels changes at frames 3-4"]);
    // The same finding in several frames is written once.
    let work = steady();
    for n in [2, 3, 5] {
        let mut bad = grid(1.2);
        bad.leaves[0].values[0] = f32::NAN;
        bad.leaves[0].active[0] |= 1;
        work.write(&format!("s/smoke.{n:04}.vdb"), &[&bad]);
    }
    let out = work.command("validate s").output().unwrap();
    let text = String::from_utf8(out.stdout).unwrap();
    assert_eq!((out.status.code(), text.matches("1 values are NaN").count()), (Some(1), 1), "{text}");
    assert!(text.contains("frames 2-3, 5: "), "{text}");
}

#[test]
fn pictures_of_a_sequence_are_held_against_each_other() {
    let work = Work::new();
    let size = |n: u32| if n == 3 { 5 } else { 4 };
    for n in 1..=4 {
        let film = Film::of(size(n), 4, vec![[0.5, 0.5, 0.5, 1.0]; size(n) * 4]);
        exr::write_picture(&work.path(&format!("p.{n:02}.exr")), &film, &BTreeMap::new(), exr::Half::None).unwrap();
    }
    let (code, report) = run(&work, "validate p.##.exr");
    let found = report["sequences"][0]["findings"].to_string();
    assert!(code == 1 && found.contains("5 x 4 pixels") && found.contains("in frames 3"), "{report}");
}

#[test]
fn frames_are_converted_and_those_that_fail_are_named() {
    let work = steady();
    std::fs::write(work.path("s/smoke.0002.vdb"), "none").unwrap();
    let (code, report) = run(&work, "convert s out.##.vdb --half");
    assert_eq!((code, &report["converted"], numbers(&report["failed"], "frame")), (2, &json!(5), vec![2]), "{report}");
    assert_eq!(numbers(&report["frames"], "frame"), [1, 3, 4, 5, 6]);
    assert_eq!(report["frames"][0]["report"]["grids"][0]["half_overflow"], 0);
    assert!(report["bytes"].as_u64().unwrap() > 0 && report["failed"][0]["error"].as_str().unwrap().contains("0002"));
    for n in [1, 3, 4, 5, 6] {
        assert!(work.path(&format!("out.{n:02}.vdb")).exists(), "{n}");
    }
    assert!(!work.path("out.02.vdb").exists());
    // Each is what it would be alone, and a folder keeps the names.
    work.json("convert s/smoke.0003.vdb alone.vdb --half");
    assert_eq!(work.json("diff alone.vdb out.03.vdb")["same"], true);
    let (code, _) = run(&work, "convert s/smoke.####.vdb folder --frames 3-5");
    assert_eq!(code, 0);
    let names: Vec<_> = work.files("folder").into_keys().map(|p| p.file_name().unwrap().to_owned()).collect();
    assert_eq!(names, ["smoke.0003.vdb", "smoke.0004.vdb", "smoke.0005.vdb"]);
    work.refused("convert s one.vdb", Code::Invalid, &["one.vdb", "out.####.vdb"]);
    work.refused("convert s s", Code::OutputIsInput, &["smoke.0001.vdb"]);
}

/// One rule for all commands: a frame that is missing in the midst is named, the others go on, and the exit code is 2.
#[test]
fn a_hole_is_named_by_every_command() {
    let work = steady();
    std::fs::create_dir(work.path("p")).unwrap();
    for n in 1..=6 {
        let film = Film::of(12, 12, vec![[0.5; 4]; 144]);
        exr::write_picture(&work.path(&format!("p/f.{n:04}.exr")), &film, &BTreeMap::new(), exr::Half::None).unwrap();
    }
    work.json("convert s t");
    work.json("render s/smoke.0001.vdb --views 1 --size 8x8 -o one");
    for name in ["s/smoke.0004.vdb", "p/f.0004.exr"] {
        std::fs::remove_file(work.path(name)).unwrap();
    }
    for words in [
        "convert s out",
        "diff s t",
        "diff t s",
        "diff s s",
        "compare p p",
        "info s",
        "validate p",
        "view s -o s.png",
        "view p -o p.png",
        "view p/f.####.exr --frames 1-6 -o q.png",
        "denoise p/f.####.exr -o d/f.####.exr",
        "motion s/smoke.####.vdb --cameras one/transforms.json --samples 1 -o m.####.exr",
        "render s/smoke.####.vdb --views 1 --size 8x8 -o r",
    ] {
        let out = work.command(words).output().unwrap();
        let text = format!("{}{}", String::from_utf8_lossy(&out.stdout), errors(&out));
        assert_eq!(out.status.code(), Some(2), "{words}: {text}");
        let named = ["frame 4", "missing: 4", "0004"].iter().any(|name| text.contains(name));
        assert!(named, "{words}: {text}");
    }
    let written = ["out/smoke.0005.vdb", "s.png", "p.png", "q.png", "d/f.0005.exr", "m.0005.exr", "r/frame.0005.exr"];
    assert!(written.iter().all(|name| work.path(name).is_file()), "{:?}", work.files("").keys());
    let (_, report) = run(&work, "view p -o p.png");
    assert_eq!(numbers(&report["sheets"][0]["failed"], "frame"), [4], "{report}");
    // What goes by a step is whole.
    for n in [2, 6] {
        std::fs::remove_file(work.path(&format!("p/f.{n:04}.exr"))).unwrap();
    }
    std::fs::copy(work.path("p/f.0001.exr"), work.path("p/f.0007.exr")).unwrap();
    assert_eq!(run(&work, "info p").0, 0);
}

#[test]
fn sequences_of_volumes_are_compared_with_totals() {
    let work = steady();
    work.json("convert s b");
    let (code, report) = run(&work, "diff s b");
    assert_eq!((code, &report["same"], numbers(&report["frames"], "frame")), (0, &json!(true), (1..=6).collect()));
    work.write("b/smoke.0004.vdb", &[&grid(2.0)]);
    std::fs::remove_file(work.path("b/smoke.0006.vdb")).unwrap();
    let (code, report) = run(&work, "diff s/smoke.####.vdb b/smoke.####.vdb");
    assert_eq!((code, &report["different"], &report["left_out"]), (1, &json!(1), &json!([6])), "{report}");
    // The largest value is below 1.4 in A and 2 in B.
    let most = report["max_abs"].as_f64().unwrap();
    assert!(most > 0.3 && most < 0.6 && report["psnr_db"].is_number(), "{report}");
    let (code, report) = run(&work, "diff s b --frames 1-3");
    assert_eq!((code, report["frames"].as_array().unwrap().len()), (0, 3));
    std::fs::write(work.path("b/smoke.0002.vdb"), "none").unwrap();
    let (code, report) = run(&work, "diff s b --frames 1-3");
    assert_eq!((code, numbers(&report["failed"], "frame"), &report["same"]), (2, vec![2], &json!(false)));
    work.refused("diff s b/smoke.0001.vdb", Code::Invalid, &["the other one is a sequence"]);
}

#[test]
fn sequences_of_pictures_are_compared_whatever_fails() {
    let work = Work::new();
    for folder in ["a", "b"] {
        std::fs::create_dir(work.path(folder)).unwrap();
        for n in 1..=5 {
            let value = if (folder, n) == ("b", 4) { 0.75 } else { 0.5 };
            let film = Film::of(12, 12, vec![[value; 4]; 144]);
            exr::write_picture(&work.path(&format!("{folder}/f.{n:04}.exr")), &film, &BTreeMap::new(), exr::Half::None)
                .unwrap();
        }
    }
    let (code, report) = run(&work, "compare a b");
    assert_eq!((code, &report["differ"], report["max_abs"].as_f64()), (1, &json!(true), Some(0.25)), "{report}");
    assert_eq!(run(&work, "compare a b --frames 1-3").0, 0);
    std::fs::write(work.path("b/f.0002.exr"), "none").unwrap();
    let (code, report) = run(&work, "compare a b --frames 1-3");
    assert_eq!(
        (code, numbers(&report["failed"], "frame"), numbers(&report["frames"], "frame")),
        (2, vec![2], vec![1, 3])
    );
    let out = work.command("compare a b --frames 1-3").output().unwrap();
    let text = String::from_utf8(out.stdout).unwrap();
    assert!(text.contains("frame 2 failed") && text.contains("agree where they could be compared"), "{text}");
}

/// A plume that grows: scale and camera are the same for all frames, and for parts of them.
#[test]
fn what_must_not_flicker_is_settled_once() {
    let work = Work::new();
    for n in 1..=4 {
        let mut grid = grid(n as f32);
        // Later frames reach further.
        grid.leaves.iter_mut().for_each(|leaf| leaf.origin[2] *= n);
        work.write(&format!("s.{n:04}.vdb"), &[&grid]);
    }
    let command = "render s.####.vdb --views 1 --size 16x16 --density-scale auto";
    let whole = work.json(&format!("{command} -o whole"));
    let part = work.json(&format!("{command} --frames 3-4 -o part"));
    assert_eq!(whole["density_scale"], part["density_scale"], "parts that are rendered apart fit together");
    assert_eq!(work.picture("whole/frame.0003.exr"), work.picture("part/frame.0003.exr"));
    // The densest frame tells the scale, and the camera sees all of it.
    let single = work.json("render s.0004.vdb --views 1 --size 16x16 --density-scale auto -o single");
    let [first, last] = [1, 4].map(|n| work.picture(&format!("whole/frame.{n:04}.exr")));
    let most = |film: &Film| film.rgba.iter().map(|p| p[3]).fold(0.0, f32::max);
    assert!(whole["density_scale"].as_f64().unwrap() <= 1.05 * single["density_scale"].as_f64().unwrap());
    assert!(most(&first) < most(&last) && most(&last) > 0.8, "{} {}", most(&first), most(&last));
    assert!(last.rgba[..16].iter().all(|p| p[3] < 0.01), "no part of it is cut off");
    // Resumed, the scale stays, although a frame came that would have changed it.
    work.json(&format!("{command} --frames 1-2 -o parts"));
    work.write("s.0005.vdb", &[&grid(50.0)]);
    let resumed = work.json(&format!("{command} --frames 3-5 -o parts --resume"));
    assert_eq!(resumed["density_scale"], whole["density_scale"]);
}

/// One path of several that names nothing keeps no other from being reported.
#[test]
fn a_sequence_without_its_frames_is_reported_beside_others() {
    let work = Work::new();
    for number in [1, 2] {
        std::fs::copy(work::fixture("cube.vdb"), work.path(&format!("s.{number:04}.vdb"))).unwrap();
        std::fs::copy(work::fixture("cube.vdb"), work.path(&format!("t.{:04}.vdb", number + 8))).unwrap();
    }
    for command in ["info", "validate"] {
        let out = work.command(&format!("{command} s.####.vdb t.####.vdb --frames 1-2 --json")).output().unwrap();
        assert_eq!(out.status.code(), Some(2));
        let report: Value = serde_json::from_slice(&out.stdout).unwrap();
        let files = report["files"].as_array().unwrap();
        assert_eq!((files.len(), files[0]["frame"].as_u64(), files[1]["frame"].as_u64()), (3, Some(1), Some(2)));
        assert!(files[2]["error"]["what"].as_str().unwrap().contains("none of the frames"), "{report}");
    }
}

/// A frame whose picture beside is of another size counts in neither of the comparisons.
#[test]
fn a_frame_beside_of_another_size_counts_nowhere() {
    let work = Work::new();
    let write = |name: &str, side: usize, value: f32| {
        let film = Film::of(side, side, vec![[value, value, value, 1.0]; side * side]);
        exr::write_picture(&work.path(name), &film, &BTreeMap::new(), exr::Half::None).unwrap();
    };
    for n in 1..=3 {
        write(&format!("a.{n}.exr"), 8, 0.5);
        write(&format!("b.{n}.exr"), 8, 0.4);
        write(&format!("c.{n}.exr"), if n == 2 { 4 } else { 8 }, 0.3);
    }
    let out = work.command("compare a.#.exr b.#.exr --beside c.#.exr --json").output().unwrap();
    assert_eq!(out.status.code(), Some(2));
    let report: Value = serde_json::from_slice(&out.stdout).unwrap();
    let numbers = |track: &Value| -> Vec<u64> {
        track["frames"].as_array().unwrap().iter().map(|f| f["frame"].as_u64().unwrap()).collect()
    };
    assert_eq!((numbers(&report), numbers(&report["beside"])), (vec![1, 3], vec![1, 3]));
    assert!(report["failed"][0]["error"].as_str().unwrap().contains("c.2.exr"), "{report}");
}
