//! What several hosts render of one sequence: cameras that all have, and the bundles of jobs.

use crate::common::work::Work;
use cumulo::error::Code;
use serde_json::Value;

fn read(work: &Work, name: &str) -> Value {
    serde_json::from_slice(&std::fs::read(work.path(name)).unwrap()).unwrap()
}

/// The matrices of a capture's cameras.
fn cameras(work: &Work, name: &str) -> Vec<Value> {
    let frames = read(work, name)["frames"].as_array().unwrap().clone();
    frames.into_iter().map(|frame| frame["transform_matrix"].clone()).collect()
}

/// Cameras without pictures are those of a render, whose frames may have other numbers.
#[test]
fn cameras_are_placed_without_pictures() {
    let work = Work::new();
    let words = "@plume.vdb --views 6 --layout ring --size 12x12 --density-scale auto";
    let report = work.json(&format!("capture new {words} -o turn.json"));
    assert_eq!((&report["views"], &report["size"][0]), (&6.into(), &12.into()));
    work.json(&format!("capture new {words} -o folder"));
    work.json(&format!("render {words} -o shots"));
    assert_eq!(cameras(&work, "turn.json"), cameras(&work, "shots/transforms.json"));
    assert_eq!(cameras(&work, "folder/transforms.json"), cameras(&work, "shots/transforms.json"));
    work.json("render @plume.vdb --cameras turn.json -o again");
    work.json("compare shots again --tolerance 0");
    work.refused("capture new @plume.vdb --views 2 -o turn.json", Code::OutputExists, &["--overwrite"]);
    work.json("render @plume.vdb --cameras turn.json --frames 1-6 --camera-offset=-1 -o frames");
    assert_eq!(cameras(&work, "frames/transforms.json"), cameras(&work, "turn.json"));
    work.json("render @plume.vdb --cameras turn.json --frames 3 --camera-offset 2 -o one.exr");
    work.json("compare one.exr shots/view_005.exr --tolerance 0");
    let missing = "render @plume.vdb --cameras turn.json --frames 0-2 --camera-offset=-1 -o none";
    let out = work.command(missing).output().unwrap();
    let text = String::from_utf8(out.stderr).unwrap();
    assert!(text.contains("no camera for frame 0") && text.contains("--camera-offset"), "{text}");
}

/// A camera that turns is that of the frame's number, whichever frames are rendered, of one volume or of several.
#[test]
fn the_camera_turns() {
    let work = Work::new();
    work.json("render @plume.vdb --views 4 --layout ring --size 12x12 -o ring");
    work.json("render @plume.vdb --frames 0-4 --orbit 4 --size 12x12 -o turn");
    let (ring, turn) = (cameras(&work, "ring/transforms.json"), cameras(&work, "turn/transforms.json"));
    assert_eq!(turn, [&ring[0], &ring[1], &ring[2], &ring[3], &ring[0]].map(Clone::clone));
    for name in ["s.0001.vdb", "s.0002.vdb", "s.0003.vdb"] {
        std::fs::copy(crate::common::work::fixture("plume.vdb"), work.path(name)).unwrap();
    }
    std::fs::copy(crate::common::work::fixture("cube.vdb"), work.path("s.0002.vdb")).unwrap();
    let moving = "render s.####.vdb --orbit 8 --size 12x12 --density-scale auto --albedo 0.9 --samples 1 --aov motion";
    work.json(&format!("{moving} -o whole"));
    for frame in 1..=3 {
        work.json(&format!("{moving} --frames {frame} -o parts"));
    }
    assert_eq!(cameras(&work, "parts/transforms.json"), cameras(&work, "whole/transforms.json"));
    work.json("compare parts whole --tolerance 0");
    let refused = |words: &str, facts: &[&str]| {
        work.refused(&format!("render @plume.vdb --size 8x8 -o no {words}"), Code::Invalid, facts);
    };
    refused("--orbit 4", &["--frames"]);
    refused("--camera-offset 1 --cameras ring", &["--frames"]);
}

/// A bundle states its parts, its paths and its files.
#[test]
fn a_bundle_states_its_parts() {
    let work = Work::new();
    let report =
        work.json("render @plume.vdb --views 1 --frames 1-9x2 --size 8x8 -o out --png --openjd job --openjd-chunk 2");
    assert_eq!((&report["steps"][0]["over"], &report["steps"][0]["chunk"]), (&"1-9:2".into(), &2.into()));
    assert!(!work.path("out").exists(), "nothing is rendered");
    let template = read(&work, "job/template.json");
    assert_eq!(template["specificationVersion"], "jobtemplate-2023-09");
    let run = &template["steps"][0]["script"]["actions"]["onRun"];
    let words: Vec<&str> = run["args"].as_array().unwrap().iter().filter_map(Value::as_str).collect();
    assert_eq!(words[..2], ["render", "{{Param.Input}}"]);
    for word in ["--output={{Param.Output}}", "--png", "--resume", "--frames={{Task.Param.Frame}}", "--views=1"] {
        assert!(words.contains(&word), "{word}: {words:?}");
    }
    let values = read(&work, "job/parameters.json");
    assert_eq!(values["Output"], work.path("out").to_str().unwrap());
    let assets = read(&work, "job/asset_references.json");
    assert_eq!(assets["assetReferences"]["inputs"]["filenames"][0], values["Input"]);
    let estimated = work.json("render @plume.vdb --views 8 --size 8x8 -o out --openjd other");
    assert!(estimated["seconds_each"].is_number() && estimated["steps"][0]["chunk"] == 8, "{estimated}");
    let words = "render @plume.vdb --frames 1-4 --views 1 --albedo 0.9 --time 5s -o out --openjd no";
    work.refused(words, Code::Invalid, &["--time", "--target-error"]);
    work.refused("render @plume.vdb --views 2 -o out{{x}} --openjd no", Code::Unsupported, &["'{{'"]);
}

/// A reference that no task could compare with is told of before the job is sent.
#[test]
fn references_of_a_job_are_pictures_of_its_kind() {
    let work = Work::new();
    work.json("render @plume.vdb --views 4 --size 8x8 -o shots");
    let refused = |words: &str, reference: &str, code, facts: &[&str]| {
        work.refused(&format!("{words} --openjd no --openjd-reference {reference}"), code, facts);
        assert!(!work.path("no").exists());
    };
    let views = "render @plume.vdb --views 2 --size 8x8 -o out";
    for reference in ["none.exr", "none", "none.####.exr", "@plume.vdb"] {
        refused(views, reference, Code::Invalid, &["no OpenEXR pictures"]);
    }
    refused(views, "shots/view_000.exr", Code::Invalid, &["makes several", "view_000.exr"]);
    refused(&views.replace("2 --size", "1 --size").replace("out", "one.exr"), "shots", Code::Invalid, &["makes one"]);
    refused(views, "shots --openjd-tolerance=-1", Code::Usage, &["--openjd-tolerance", "negative"]);
    let density = "reconstruct density shots -o found.vdb";
    refused(density, "shots", Code::Unsupported, &["--openjd-reference", "cumulo diff"]);
}
