//! `cumulo info` and `cumulo validate` on OpenEXR files and captures, from the outside: what they
//! print, the keys of their JSON, and how they end. VDBs have `vdb.rs`.

use crate::common::refusal;
use crate::common::work::fixture_text;
use assert_cmd::Command;
use cumulo::error::Code;
use cumulo::formats::exr;
use cumulo::scene::film::Film;
use predicates::prelude::PredicateBooleanExt;
use predicates::str::{contains, is_empty};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

fn cumulo(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_cumulo"));
    command.args(arguments);
    command
}

fn report(arguments: &[&str], code: i32) -> Value {
    let out = cumulo(arguments).arg("--json").assert().code(code).stderr(is_empty()).get_output().stdout.clone();
    serde_json::from_slice(&out).unwrap()
}

/// What people see on standard output.
fn text(arguments: &[&str], code: i32) -> String {
    let out = cumulo(arguments).assert().code(code).stderr(is_empty()).get_output().stdout.clone();
    String::from_utf8(out).unwrap()
}

/// The start of a file, under the same name in `folder`.
fn cut(folder: &TempDir, name: &str, bytes: usize) -> String {
    let whole = std::fs::read(fixture_text(name)).unwrap();
    let path = folder.path().join(Path::new(name).file_name().unwrap());
    std::fs::write(&path, &whole[..bytes.min(whole.len() - 1)]).unwrap();
    path.to_str().unwrap().to_owned()
}

/// A capture of three sound views; tests spoil what they need.
struct Capture {
    folder: TempDir,
    text: Value,
}

impl Capture {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let frame = |i: i32| {
            json!({"file_path": format!("{i}.exr"),
                "transform_matrix": [[1, 0, 0, i], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]})
        };
        let text = json!({"fl_x": 30, "w": 8, "h": 6, "model": "emission-absorption", "emission": [1, 0.5, 0.25],
            "emission_model": "linear", "lattice": [[0.5, 0, 0, 1], [0, 0.25, 0, 2], [0, 0, 2, 3]],
            "frames": [frame(0), frame(1), frame(2)]});
        let capture = Self { folder, text };
        (0..3).for_each(|i| capture.picture(i, 8, 6, 0.0));
        capture.save();
        capture
    }
    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
    fn picture(&self, view: i32, width: usize, height: usize, first: f32) {
        let mut film = Film::new(width, height);
        film.rgba[0][0] = first;
        exr::write_picture(&self.path(&format!("{view}.exr")), &film, &Default::default(), exr::Half::None).unwrap();
    }
    fn save(&self) {
        std::fs::write(self.path("transforms.json"), self.text.to_string()).unwrap();
    }
    fn folder(&self) -> String {
        self.folder.path().to_str().unwrap().to_owned()
    }
    fn json(&self) -> String {
        self.path("transforms.json").to_str().unwrap().to_owned()
    }
}

#[test]
fn info_shows_layers_windows_and_figures_of_an_exr() {
    let path = fixture_text("exr/nuke.exr");
    let found = &report(&["info", &path], 0)["files"][0];
    assert_eq!((&found["path"], &found["format"]), (&json!(path), &json!("exr")));
    assert_eq!(found["display_window"], json!({"min": [0, 0], "size": [24, 10]}));
    let part = &found["parts"][0];
    assert_eq!(part["data_window"], json!({"min": [-3, 4], "size": [20, 9]}));
    let layers: Vec<&Value> = part["layers"].as_array().unwrap().iter().map(|l| &l["name"]).collect();
    assert_eq!(layers, ["depth", "rgba"]);
    let red = &part["layers"][1]["channels"][3];
    assert_eq!(
        (&red["component"], &red["sample_type"], &red["non_finite"]),
        (&"red".into(), &"half".into(), &0.into())
    );
    // Channel 0 of the fixtures is (x % 16 + 16 (y % 16)) / 256 inside the data window and 0 outside;
    // all are exact. The window shows x in 0..17 and y in 4..10; the largest is at (15, 9).
    assert_eq!((&red["min"], &red["max"]), (&json!(0.0), &json!((15.0 + 16.0 * 9.0) / 256.0)));
    let pixels = (4..10).flat_map(|y| (0..17).map(move |x| f64::from(x % 16 + 16 * y) / 256.0));
    assert_eq!(red["mean"], pixels.sum::<f64>() / 240.0);

    let shown = text(&["info", &path], 0);
    assert!(shown.starts_with(&format!("{path}: OpenEXR, display window 24x10 at (0, 0)")), "{shown}");
    for words in ["data window 20x9 at (-3, 4)", "layer 'rgba'", "red      half   0 to 0.62109375, mean"] {
        assert!(shown.contains(words), "'{words}' is not in: {shown}");
    }
}

#[test]
fn info_shows_cameras_attributes_and_holes_of_an_exr() {
    let path = fixture_text("exr/camera.exr");
    let found = &report(&["info", &path], 0)["files"][0];
    let rows = json!([[0.0, 1.0, 2.0, 3.0], [4.0, 5.0, 6.0, 7.0], [8.0, 9.0, 10.0, 11.0], [12.0, 13.0, 14.0, 15.0]]);
    assert_eq!(found["camera"], json!({"worldToCamera": rows}));
    assert_eq!(found["attributes"]["comments"], "none of these is a camera's");
    assert!(found["attributes"].get("worldToCamera").is_none(), "shown once");
    let shown = text(&["info", &path], 0);
    assert!(shown.contains("worldToCamera") && shown.contains("12.000000    13.000000"), "{shown}");

    let path = fixture_text("exr/nan.exr");
    let found = &report(&["info", &path], 0)["files"][0]["parts"][0]["layers"][0]["channels"];
    let counts: Vec<u64> = found.as_array().unwrap().iter().map(|c| c["non_finite"].as_u64().unwrap()).collect();
    assert_eq!(counts, [1, 0, 1, 1]);
    assert!(text(&["info", &path], 0).contains("(1 NaN or infinite)"));
}

#[test]
fn info_sums_up_a_capture_by_its_folder_and_by_its_file() {
    let capture = Capture::new();
    let by_file = report(&["info", &capture.json()], 0);
    let mut by_folder = report(&["info", &capture.folder()], 0);
    assert_eq!(by_folder["files"][0]["path"], json!(capture.folder()));
    by_folder["files"][0]["path"] = json!(capture.json());
    assert_eq!(by_file, by_folder);
    let expected = json!({"path": capture.json(), "format": "capture", "frames": 3, "sizes": {"8x6": 3},
        "formats": {"OpenEXR": 3}, "color_space": null, "masked": 0, "distorted": 0, "remarks": [],
        "orthographic": 0, "cameras_min": [0.0, 0.0, 4.0], "cameras_max": [2.0, 0.0, 4.0],
        "model": "emission-absorption", "emission": [1.0, 0.5, 0.25], "emission_model": "linear", "transfer": false,
        "background": [1.0, 1.0, 1.0], "pixel_filter": "point", "density_scale": 1.0,
        "lattice_voxel_size": [0.5, 0.25, 2.0]});
    assert_eq!(by_file["files"][0], expected);
    let shown = text(&["info", &capture.folder()], 0);
    for words in
        ["capture of 3 view", "3 of 8x6", "from [0.0, 0.0, 4.0] to [2.0, 0.0, 4.0]", "voxel size 0.5 x 0.25 x 2"]
    {
        assert!(shown.contains(words), "'{words}' is not in: {shown}");
    }
}

#[test]
fn validate_is_content_with_sound_files_of_all_kinds_in_one_call() {
    let capture = Capture::new();
    let paths = [fixture_text("exr/multipart.exr"), capture.folder(), fixture_text("cube.vdb"), capture.json()];
    let arguments: Vec<&str> = std::iter::once("validate").chain(paths.iter().map(String::as_str)).collect();
    let found = report(&arguments, 0);
    let formats: Vec<&Value> = found["files"].as_array().unwrap().iter().map(|f| &f["format"]).collect();
    assert_eq!(formats, ["exr", "capture", "vdb", "capture"]);
    assert_eq!(found["valid"], true);
    assert_eq!(text(&arguments, 0).matches(": valid\n").count(), 4);
}

#[test]
fn info_takes_all_kinds_in_one_call_and_keeps_their_order() {
    let capture = Capture::new();
    let (exr, vdb) = (fixture_text("exr/grey.exr"), fixture_text("cube.vdb"));
    let arguments = ["info", &vdb, &capture.folder(), &exr];
    let found = report(&arguments, 0);
    let kinds: Vec<(&str, bool)> = ["grids", "frames", "parts"]
        .into_iter()
        .enumerate()
        .map(|(i, key)| (key, found["files"][i].get(key).is_some()))
        .collect();
    assert_eq!(kinds, [("grids", true), ("frames", true), ("parts", true)]);
    let shown = text(&arguments, 0);
    let heads: Vec<&str> = shown.lines().filter(|l| !l.starts_with(' ')).collect();
    assert_eq!(heads.len(), 3, "one line a file that is not indented: {shown}");
}

/// The findings of a single file, each as `part: what -> do`.
fn findings(path: &str) -> Vec<String> {
    let found = report(&["validate", path], 1);
    let file = &found["files"][0];
    assert_eq!((&found["valid"], &file["valid"]), (&json!(false), &json!(false)));
    let line = |f: &Value| {
        let keys: Vec<&String> = f.as_object().unwrap().keys().collect();
        assert_eq!(keys.len(), 4, "{keys:?}");
        assert_eq!(f["severity"], "problem");
        assert!(!f["do"].as_str().unwrap().is_empty());
        format!("{}: {} -> {}", f["part"].as_str().unwrap_or("file"), f["what"].as_str().unwrap(), f["do"])
    };
    file["findings"].as_array().unwrap().iter().map(line).collect()
}

#[track_caller]
fn assert_found(path: &str, expected: &[&[&str]]) {
    let found = findings(path);
    assert_eq!(found.len(), expected.len(), "{found:#?}");
    for (line, words) in found.iter().zip(expected) {
        assert!(words.iter().all(|w| line.contains(w)), "{line} lacks one of {words:?}");
    }
    // People read the same.
    let shown = text(&["validate", path], 1);
    assert!(shown.starts_with(&format!("{path}: not valid\n  problem: ")), "{shown}");
    assert_eq!(shown.matches("problem: ").count(), expected.len(), "{shown}");
}

#[test]
fn a_truncated_exr_is_a_finding_of_validate_and_an_error_of_info() {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in [("exr/blender.exr", 300), ("exr/zip.exr", usize::MAX), ("exr/tiled.exr", 1000)] {
        let path = cut(&folder, name, bytes);
        assert_found(&path, &[&["file: ", "damaged or incomplete", "again"]]);
        cumulo(&["info", &path])
            .assert()
            .code(2)
            .stdout(is_empty())
            .stderr(contains(&path).and(contains("damaged or incomplete")));
    }
}

#[test]
fn holes_and_unsupported_features_of_an_exr_are_findings() {
    let holes: Vec<[&str; 2]> = ["'A'", "'G'", "'R'"].map(|c| [c, "NaN or infinite samples: 1"]).to_vec();
    let expected: Vec<&[&str]> = holes.iter().map(|h| &h[..]).collect();
    assert_found(&fixture_text("exr/nan.exr"), &expected);
}

#[test]
fn every_fault_of_a_captures_pictures_is_a_finding() {
    let capture = Capture::new();
    capture.picture(0, 6, 8, 0.0);
    std::fs::remove_file(capture.path("1.exr")).unwrap();
    capture.picture(2, 8, 6, f32::NAN);
    let expected: &[&[&str]] = &[
        &["frame 0: ", "8x6", "6x8", "0.exr", "'w' and 'h'"],
        &["frame 1: ", "1.exr", "no such picture", "file_path"],
        &["frame 2: ", "2.exr", "NaN"],
    ];
    assert_found(&capture.folder(), expected);
    assert_found(&capture.json(), expected);
    // The cameras are sound all the same.
    assert_eq!(report(&["info", &capture.folder()], 0)["files"][0]["frames"], 3);

    let whole = std::fs::read(capture.path("2.exr")).unwrap();
    std::fs::write(capture.path("2.exr"), &whole[..whole.len() - 1]).unwrap();
    assert!(findings(&capture.folder())[2].contains("damaged or incomplete"));
}

#[test]
fn faults_of_a_captures_file_are_findings_and_errors_of_info() {
    let mut capture = Capture::new();
    capture.text["frames"][1]["transform_matrix"][0][1] = json!(0.5);
    capture.text["frames"][2]["k1"] = json!(0.5);
    capture.save();
    assert_found(&capture.folder(), &[&["frame 1: ", "orthogonal"], &["frame 2: ", "k1", "undistort"]]);
    cumulo(&["info", &capture.folder()]).assert().code(2).stdout(is_empty()).stderr(contains("frame 1: "));
    for (text, words) in [("{\"frames\": [", "no valid JSON"), ("{}", "no key 'frames'")] {
        std::fs::write(capture.path("transforms.json"), text).unwrap();
        assert_found(&capture.json(), &[&["file: ", words]]);
        cumulo(&["info", &capture.folder()]).assert().code(2).stderr(contains(words));
    }
    // Notepad's byte order mark is no fault.
    let sound = Capture::new();
    std::fs::write(sound.path("transforms.json"), format!("\u{feff}{}", sound.text)).unwrap();
    assert_eq!(report(&["validate", &sound.folder()], 0)["valid"], true);
}

#[test]
fn one_bad_file_does_not_hide_the_others_from_validate() {
    let folder = tempfile::tempdir().unwrap();
    let (bad, good) = (cut(&folder, "exr/zip.exr", 500), fixture_text("exr/zip.exr"));
    let note = folder.path().join("note.txt");
    std::fs::write(&note, "no picture").unwrap();
    let note = note.to_str().unwrap();
    let found = report(&["validate", &bad, note, &good], 1);
    let verdicts: Vec<(&Value, &Value)> =
        found["files"].as_array().unwrap().iter().map(|f| (&f["format"], &f["valid"])).collect();
    let (no, yes) = (json!(false), json!(true));
    assert_eq!(verdicts, [(&json!("exr"), &no), (&json!("unknown"), &no), (&json!("exr"), &yes)]);
}

#[test]
fn files_of_no_known_kind_are_named_as_such() {
    let folder = tempfile::tempdir().unwrap();
    for (name, content) in [("empty.exr", ""), ("note.txt", "no picture"), ("a.toml", "[package]")] {
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        let path = path.to_str().unwrap();
        assert_found(path, &[&["file: no file of a known kind", "OpenEXR", "transforms.json"]]);
        cumulo(&["info", path]).assert().code(2).stderr(contains("no file of a known kind"));
    }
}

#[test]
fn wrong_use_and_what_cannot_be_opened_end_with_2() {
    let empty = tempfile::tempdir().unwrap();
    let folder = empty.path().to_str().unwrap();
    let sound = fixture_text("exr/zip.exr");
    for command in ["info", "validate"] {
        let cases: [(&[&str], Code, &str); 4] = [
            (&[], Code::Usage, "FILE"),
            (&[&sound, "--color"], Code::Usage, "--color"),
            (&["/nowhere.exr"], Code::NotFound, "/nowhere.exr"),
            (&[folder], Code::Invalid, "the folder that holds one"),
        ];
        for (arguments, code, fact) in cases {
            refusal::of(&[&[command], arguments].concat(), code, &[fact]);
        }
    }
}
