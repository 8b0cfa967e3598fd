//! `cumulo merge`, and pictures that go on from where they were stopped.

use crate::common::work::{Work, interrupt};
use cumulo::error::Code;
use cumulo::formats::exr;
use cumulo::formats::limits::Limits;
use cumulo::scene::film::Film;
use serde_json::Value;

const LIT: &str = "--views 1 --size 40x28 --density-scale 4 --albedo 0.9 --sun 1,1,2 --sun-color 3 --sky 0.2,0.3,0.5";

/// Returns a picture with all of its planes.
fn planes(work: &Work, name: &str) -> Film {
    exr::read_film_within(&work.path(name), None, Limits::default()).unwrap()
}

fn attribute(work: &Work, name: &str, key: &str) -> String {
    exr::header(&work.path(name)).unwrap().attributes()[key].clone()
}

fn part(work: &Work, options: &str, name: &str) -> Value {
    work.json(&format!("render @plume.vdb {LIT} {options} -o {name}"))
}

/// Parts of a picture, in any order and grouping, are the picture to the last bit of every plane.
#[test]
fn parts_are_the_whole() {
    let work = Work::new();
    let whole = part(&work, "--samples 2 --aov variance --replicates 0-11", "whole.exr");
    for (range, name) in [("0-3", "a"), ("4", "b"), ("5-8", "c"), ("9-11", "d")] {
        part(&work, &format!("--samples 2 --aov variance --replicates {range}"), &format!("{name}.exr"));
    }
    let joined = work.json("merge c.exr a.exr d.exr b.exr -o joined.exr");
    work.json("merge b.exr d.exr -o some.exr");
    work.json("merge some.exr c.exr a.exr -o again.exr");
    let expected = planes(&work, "whole.exr");
    assert_eq!(expected.planes.len(), 4 + 3 + 31);
    for name in ["joined.exr", "again.exr"] {
        let film = planes(&work, name);
        for plane in expected.planes.iter().filter(|plane| !plane.name.starts_with("replicates")) {
            assert!(film.plane(&plane.name) == Some(&plane.samples[..]), "{name} {}", plane.name);
        }
        assert_eq!(film.rgba, expected.rgba, "{name}");
    }
    assert_eq!(joined["replicates"], "seed 0: 0-11");
    assert_eq!(joined["accuracy"]["pictures"][0]["error"], whole["accuracy"]["pictures"][0]["error"]);
    assert!(joined["accuracy"]["pictures"][0]["error"].as_f64().unwrap() > 0.0, "{joined}");
}

/// Pictures of some paths and other seeds are joined by their paths; the first replicate of a picture is that picture.
#[test]
fn pictures_of_other_seeds_are_joined_by_their_paths() {
    let work = Work::new();
    part(&work, "--samples 4 --seed 1", "four.exr");
    part(&work, "--samples 12 --seed 2", "twelve.exr");
    part(&work, "--samples 4 --seed 1 --replicates 0", "first.exr");
    let report = work.json("merge four.exr twelve.exr -o joined.exr");
    let [four, twelve, joined, first] =
        ["four.exr", "twelve.exr", "joined.exr", "first.exr"].map(|name| planes(&work, name));
    assert_eq!(four.rgba, first.rgba);
    for ((a, b), mean) in four.rgba.iter().zip(&twelve.rgba).zip(&joined.rgba) {
        for c in 0..4 {
            let expected = (4.0 * f64::from(a[c]) + 12.0 * f64::from(b[c])) / 16.0;
            assert_eq!(mean[c], expected as f32);
        }
    }
    assert!(joined.plane("Debug Sample Count.X").unwrap().iter().all(|v| *v == 16.0));
    assert_eq!(
        (&report["replicates"], &report["accuracy"]["pictures"][0]["error"]),
        (&"seed 1: 0; seed 2: 0".into(), &Value::Null)
    );
    // Pictures of an error of their own, whose pixels have different numbers of paths.
    for (seed, name) in [(5, "e.exr"), (6, "f.exr")] {
        part(&work, &format!("--target-error 0.05 --aov replicates --seed {seed}"), name);
    }
    let report = work.json("merge e.exr f.exr --confidence 0.9 -o g.exr");
    assert_eq!(report["replicates"], "seed 5: 0-15; seed 6: 0-15");
    assert!(report["accuracy"]["pictures"][0]["error"].as_f64().unwrap() < 0.05, "{report}");
}

/// A part that was cut out keeps its place, and its random numbers.
#[test]
fn parts_of_the_picture_keep_their_place() {
    let work = Work::new();
    for (range, name) in [("0-1", "a"), ("2-3", "b"), ("0-3", "ab")] {
        part(&work, &format!("--samples 2 --crop 8,4,20x12 --replicates {range}"), &format!("{name}.exr"));
    }
    work.json("merge a.exr b.exr -o joined.exr");
    let [joined, whole] = ["joined.exr", "ab.exr"].map(|name| exr::header(&work.path(name)).unwrap());
    assert_eq!((joined.data_window, joined.display_window), (whole.data_window, whole.display_window));
    assert_eq!(joined.data_window.size, [20, 12]);
    assert_eq!(planes(&work, "joined.exr").rgba, planes(&work, "ab.exr").rgba);
}

#[test]
fn what_is_no_part_of_a_picture_is_refused() {
    let work = Work::new();
    part(&work, "--samples 2 --replicates 0-3", "a.exr");
    for (options, name) in [
        ("--samples 2 --replicates 3-4", "same.exr"),
        ("--samples 2 --replicates 4-5 --anisotropy 0.5", "medium.exr"),
        ("--samples 2 --replicates 4-5 --fov 30", "camera.exr"),
        ("--samples 2 --replicates 4-5 --crop 0,0,8x8", "cut.exr"),
        ("--samples 2 --replicates 4-5 --clamp 0.5", "clamped.exr"),
        ("--target-error 0.2", "error.exr"),
    ] {
        part(&work, options, name);
    }
    work.json("render @plume.vdb --views 1 --size 40x28 --density-scale 4 -o straight.exr");
    // What other programs have changed.
    part(&work, "--samples 2 --replicates 4-5", "b.exr");
    part(&work, "--samples 2 --seed 9", "plain.exr");
    let attributes = |name: &str| exr::header(&work.path(name)).unwrap().attributes();
    let mut graded = planes(&work, "b.exr");
    graded.rgba[300][1] *= 1.5;
    exr::write_picture(&work.path("graded.exr"), &graded, &attributes("b.exr"), exr::Half::None).unwrap();
    for name in ["b", "plain"] {
        let (film, attributes) = (planes(&work, &format!("{name}.exr")), attributes(&format!("{name}.exr")));
        exr::write_picture(&work.path(&format!("half-{name}.exr")), &film, &attributes, exr::Half::All).unwrap();
    }
    work.json(&format!("render @cube.vdb {LIT} --samples 2 --replicates 4-5 -o volume.exr"));
    for (name, facts) in [
        ("graded.exr", vec!["graded.exr", "another program"]),
        ("half-b.exr", vec!["half-b.exr"]),
        ("half-plain.exr", vec!["half-plain.exr", "32 bits"]),
        ("same.exr", vec!["seed 0: 3 "]),
        ("medium.exr", vec!["a.exr", "--anisotropy 0.5"]),
        ("camera.exr", vec!["--fov 30"]),
        ("cut.exr", vec!["--crop"]),
        ("clamped.exr", vec!["--clamp"]),
        ("volume.exr", vec!["cube.vdb"]),
        ("error.exr", vec!["error.exr", "--aov replicates"]),
        ("straight.exr", vec!["straight.exr", "states no replicates"]),
        ("@exr/blender.exr", vec!["blender.exr", "states no replicates"]),
    ] {
        work.refused(&format!("merge a.exr {name} -o out.exr"), Code::Invalid, &facts);
    }
    work.refused("merge a.exr none.exr -o out.exr", Code::NotFound, &["none.exr"]);
    work.refused("merge a.exr -o a.exr --overwrite", Code::OutputIsInput, &["a.exr"]);
    work.refused("merge a.exr -o out.png", Code::OutputName, &["out.png"]);
    assert!(!work.path("out.exr").exists());
    for (words, code) in [
        ("--replicates 3-1", Code::Usage),
        ("--replicates x", Code::Usage),
        ("--replicates 0-9999999", Code::Usage),
        ("--replicates 0-3 --target-error 0.1", Code::Usage),
        ("--replicates 0-3 --time 3", Code::Usage),
        ("--aov replicates", Code::Invalid),
        ("--replicates 0-3 --aov albedo", Code::Invalid),
    ] {
        work.refused(&format!("render @plume.vdb {LIT} {words} -o out.exr"), code, &[]);
    }
    work.refused("render @plume.vdb --views 1 --replicates 0-3 -o out.exr", Code::Invalid, &["--replicates"]);
}

/// A picture that was stopped is there with its error, and goes on to the bits of one that was not; a frame, too.
#[test]
fn stopped_pictures_go_on() {
    let work = Work::new();
    for (views, output) in [("", "out.exr"), ("--frames 3-4", "shot")] {
        let words = format!("render @plume.vdb {LIT} {views} --target-error 0.003 --json");
        let far = |event: &Value| event["event"] == "advanced" && event["done"].as_f64() > Some(0.15);
        let out = interrupt(work.reached(&format!("{words} -o {output}"), far));
        assert_eq!(out.status.code(), Some(130), "{}", String::from_utf8_lossy(&out.stdout));
        let name = if views.is_empty() { "out.exr" } else { "shot/frame.0003.exr" };
        assert_eq!(attribute(&work, name, "cumulo:stopped"), "true");
        let begun = attribute(&work, name, "cumulo:replicates");
        assert!(begun.starts_with("seed 0: 0") && begun != "seed 0: 0-15", "{begun}");
        assert!(planes(&work, name).plane("replicates.count").is_some());
        work.json(&format!("render @plume.vdb {LIT} {views} --target-error 0.003 -o {output} --resume"));
        work.json(&format!("render @plume.vdb {LIT} {views} --target-error 0.003 -o whole-{output}"));
        let expected = planes(&work, &format!("whole-{name}"));
        assert_eq!(planes(&work, name), expected);
        assert!(!exr::header(&work.path(name)).unwrap().attributes().contains_key("cumulo:stopped"));
    }
    let report = work.json(&format!("render @plume.vdb {LIT} --target-error 0.003 -o out.exr --resume"));
    assert_eq!(report["views"], 0);
}

/// A wanted error is reached by the replicates that reports ask for, whoever renders them.
#[test]
fn an_error_is_reached_by_the_replicates_that_are_asked_for() {
    let work = Work::new();
    part(&work, "--samples 4 --replicates 0-7", "0.exr");
    let mut parts = "0.exr".to_owned();
    let mut count = 8;
    for round in 1.. {
        let out =
            work.command(&format!("merge {parts} -o joined{round}.exr --target-error 0.005 --json")).output().unwrap();
        let report: Value = serde_json::from_slice(&out.stdout).unwrap();
        let accuracy = &report["accuracy"]["pictures"][0];
        assert_eq!(report["accuracy"]["target_error"], 0.005);
        let Some(missing) = report["missing"].as_str() else {
            assert_eq!(out.status.code(), Some(0));
            // The picture has corners in which rays hardly meet the medium.
            let doubtful = accuracy["doubtful"].as_array().unwrap();
            assert!(doubtful.iter().all(|blocks| blocks["reason"] == "rare-events"), "{report}");
            assert!(accuracy["certified"].as_u64().unwrap() >= 18, "{report}");
            assert!(accuracy["error"].as_f64().unwrap() <= 0.005 && round > 1, "{report}");
            break;
        };
        assert_eq!(out.status.code(), Some(1));
        assert!(round < 8, "{report}");
        let range = missing.strip_prefix("seed 0: ").unwrap();
        let first: u32 = range.split('-').next().unwrap().parse().unwrap();
        assert_eq!(first, count, "{report}");
        count = range.split('-').next_back().unwrap().parse::<u32>().unwrap() + 1;
        part(&work, &format!("--samples 4 --replicates {range}"), &format!("{round}.exr"));
        parts = format!("{parts} {round}.exr");
    }
    work.refused("merge 0.exr -o x.exr --target-error 0", Code::Usage, &[]);
}
