//! `cumulo render --frames`: sequences of volumes and of cameras, resumed, in parts, with frames that fail.

use crate::common::work::{Work, density, errors, fixture};
use cumulo::error::Code;
use cumulo::formats::limits::Limits;
use cumulo::formats::vdb::{Codec, NativeGrid, RawLeaf, write_native};
use cumulo::formats::{exr, transforms};
use cumulo::scene::grid::{GridClass, Leaf};
use glam::DVec3;
use serde_json::Value;
use std::collections::BTreeMap;

const LIT: &str = "--size 20x16 --density-scale 4 --albedo 0.9 --sun 1,1,2 --sky 0.2 --samples 4";

fn frames(work: &Work, folder: &str) -> Vec<String> {
    let json: Value =
        serde_json::from_slice(&std::fs::read(work.path(&format!("{folder}/transforms.json"))).unwrap()).unwrap();
    json["frames"].as_array().unwrap().iter().map(|f| f["file_path"].as_str().unwrap().to_owned()).collect()
}

/// A frame without a volume fails by name, and the rest go on; resumed, only what is missing is rendered.
#[test]
fn a_frame_that_fails_does_not_stop_the_others() {
    let work = Work::new();
    for (name, from) in [("smoke.0001.vdb", "plume.vdb"), ("smoke.0003.vdb", "blob_sheared.vdb")] {
        std::fs::copy(fixture(from), work.path(name)).unwrap();
    }
    let command = "render smoke.####.vdb --frames 1-3 --views 1 --size 20x16 --density-scale auto -o out";
    let out = work.command(command).arg("--json").output().unwrap();
    assert_eq!(out.status.code(), Some(2), "{}", errors(&out));
    assert!(errors(&out).contains("frame 2") && errors(&out).contains("smoke.0002.vdb"), "{}", errors(&out));
    let report: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!((&report["rendered"], &report["failed"][0]["frame"]), (&Value::from(2), &Value::from(2)));
    assert_eq!(frames(&work, "out"), ["frame.0001.exr", "frame.0003.exr"]);

    std::fs::copy(fixture("cube.vdb"), work.path("smoke.0002.vdb")).unwrap();
    let before = work.files("out");
    let again = work.json(&format!("{command} --resume"));
    assert_eq!((&again["rendered"], &again["skipped"]), (&Value::from(1), &Value::from(2)));
    assert_eq!(frames(&work, "out"), ["frame.0001.exr", "frame.0002.exr", "frame.0003.exr"]);
    for (path, bytes) in before.iter().filter(|(path, _)| path.extension().is_some_and(|e| e == "exr")) {
        assert_eq!(work.files("out").get(path), Some(bytes), "{}", path.display());
    }
    // A picture names what it was made from, and not what others were.
    let named = exr::header(&work.path("out/frame.0003.exr")).unwrap().attributes()["cumulo:input"].clone();
    assert!(named.contains("smoke.0003.vdb") && !named.contains("smoke.0001.vdb"), "{named}");
    // All frames have the first one's camera and density scale.
    let scale = again["density_scale"].as_f64().unwrap();
    work.json(&format!("render smoke.0003.vdb --cameras out --density-scale {scale} -o single"));
    assert_eq!(work.picture("out/frame.0003.exr"), work.picture("single/view_002.exr"));

    // A volume that has changed is rendered again, one that is younger alone is not; without a range, all files are frames.
    let late = std::fs::File::options().append(true).open(work.path("smoke.0003.vdb")).unwrap();
    late.set_modified(std::time::SystemTime::now() + std::time::Duration::from_secs(5)).unwrap();
    std::fs::copy(fixture("slab.vdb"), work.path("smoke.0001.vdb")).unwrap();
    let changed = work.json(&format!("{} --resume", command.replace("--frames 1-3 ", "")));
    assert_eq!((&changed["rendered"], &changed["skipped"]), (&Value::from(1), &Value::from(2)));
    assert_eq!(changed["renewed"], serde_json::json!([{"input": "smoke.0001.vdb", "frames": [1]}]));
    // Without a range a hole is a frame that fails.
    std::fs::remove_file(work.path("smoke.0002.vdb")).unwrap();
    let out = work.command(&command.replace("--frames 1-3 ", "").replace("-o out", "-o hole")).output().unwrap();
    assert_eq!(out.status.code(), Some(2), "{}", errors(&out));
    assert!(errors(&out).contains("frame 2") && frames(&work, "hole").len() == 2, "{}", errors(&out));
}

/// What is left of a picture that was cut short counted as another command's, or as whole.
#[test]
fn damaged_frames_are_rendered_again() {
    let work = Work::new();
    let command = "render @plume.vdb --views 1 --size 8x8 --frames 1-3 -o out";
    work.json(command);
    let path = work.path("out/frame.0002.exr");
    let (picture, whole) = (work.picture("out/frame.0002.exr"), std::fs::read(&path).unwrap());
    for length in [0, 4, 100, whole.len() / 2, whole.len() - 1] {
        std::fs::write(&path, &whole[..length]).unwrap();
        if length <= 100 {
            work.refused(command, Code::OutputExists, &["frame.0002.exr", "damaged", "--overwrite replaces it"]);
        }
        let report = work.json(&format!("{command} --resume"));
        let told = (&report["rendered"], &report["skipped"], &report["renewed"]);
        assert_eq!(told, (&Value::from(1), &Value::from(2), &Value::Null), "{length}: {report}");
        assert_eq!(work.picture("out/frame.0002.exr"), picture, "{length}");
    }
    // What a crash may leave: the length is right, and the end is zeros.
    let larger = command.replace("8x8", "32x32").replace("-o out", "-o larger");
    work.json(&larger);
    let damaged = work.path("larger/frame.0001.exr");
    let (picture, mut bytes) = (work.picture("larger/frame.0001.exr"), std::fs::read(&damaged).unwrap());
    let half = bytes.len() / 2;
    bytes[half..].fill(0);
    std::fs::write(&damaged, bytes).unwrap();
    assert_eq!(work.json(&format!("{larger} --resume"))["rendered"], 1);
    assert_eq!(work.picture("larger/frame.0001.exr"), picture);
    // Files that are no pictures are somebody's.
    std::fs::write(&path, "notes").unwrap();
    work.refused(&format!("{command} --resume"), Code::OutputExists, &["frame.0002.exr"]);
    assert_eq!(std::fs::read(&path).unwrap(), b"notes");
}

/// Whatever a picture was made from counts, not its volume alone.
#[test]
fn a_changed_input_has_its_frames_rendered_again() {
    let work = Work::new();
    std::fs::copy(fixture("plume.vdb"), work.path("s.vdb")).unwrap();
    work.json("render s.vdb --views 3 --size 8x8 --density-scale auto -o path");
    work.json("render s.vdb --views 1 --size 8x4 --albedo 0.9 --samples 1 -o sky.exr");
    let tf = |top: f64| {
        let text = format!(
            r#"{{"format": "cumulo-transfer-function", "version": 1, "transfer": {{"kind": "piecewise",
                "points": [[0.0, 1, 1, 1, 0.0], [1.0, 0.2, 0.5, 0.9, {top}]]}}}}"#
        );
        std::fs::write(work.path("a.tf.json"), text).unwrap();
    };
    tf(2.0);
    let command = "render s.vdb --cameras path --tf a.tf.json --albedo 0.9 --tf-color emission --sky sky.exr --samples 1 --frames 0-2 -o out";
    work.json(command);
    let resumed = |renewed: Value| {
        let report = work.json(&format!("{command} --resume"));
        let count = if renewed.is_null() { 0 } else { 3 };
        assert_eq!(
            (&report["rendered"], &report["skipped"]),
            (&Value::from(count), &Value::from(3 - count)),
            "{report}"
        );
        assert_eq!(report["renewed"], renewed);
    };
    let by = |input: &str| serde_json::json!([{"input": input, "frames": [0, 1, 2]}]);
    resumed(Value::Null);
    let before = work.picture("out/frame.0001.exr");
    let json = std::fs::read_to_string(work.path("path/transforms.json")).unwrap();
    let mut moved: Value = serde_json::from_str(&json).unwrap();
    moved["frames"].as_array_mut().unwrap().iter_mut().for_each(|f| {
        let x = f["transform_matrix"][0][3].as_f64().unwrap();
        f["transform_matrix"][0][3] = (x + 0.5).into();
    });
    std::fs::write(work.path("path/transforms.json"), moved.to_string()).unwrap();
    resumed(by("path/transforms.json"));
    assert_ne!(work.picture("out/frame.0001.exr"), before);
    let [camera, listed] = ["path", "out"].map(|name| transforms::load(&work.path(name)).unwrap().frames[1].camera);
    assert_eq!(camera.camera_to_world, listed.camera_to_world);
    tf(3.0);
    resumed(by("a.tf.json"));
    work.json("render s.vdb --views 1 --size 8x4 --albedo 0.5 --samples 1 --overwrite -o sky.exr");
    resumed(by("sky.exr"));
    resumed(Value::Null);
    // The text says so in a line.
    tf(4.0);
    let text = work.text(&format!("{command} --resume"));
    assert!(text.contains("made again, since a.tf.json has changed: 0-2"), "{text}");
    // A list of cameras that lacks frames is made whole again.
    std::fs::remove_file(work.path("out/transforms.json")).unwrap();
    resumed(Value::Null);
    assert_eq!(frames(&work, "out").len(), 3);
}

/// Frames of one volume by the cameras of a capture are the views of the same numbers, in one run or in parts.
#[test]
fn cameras_are_found_by_number() {
    let work = Work::new();
    work.json(&format!("render @plume.vdb --views 4 {LIT} -o views"));
    let options = LIT.replace("--size 20x16", "--cameras views");
    let whole = work.json(&format!("render @plume.vdb --frames 1-3x2 {options} -o whole"));
    assert_eq!((&whole["rendered"], &whole["paths"]["samples"]), (&Value::from(2), &Value::from(4)));
    for number in [1, 3] {
        let [frame, view] = [format!("whole/frame.000{number}.exr"), format!("views/view_00{number}.exr")];
        assert_eq!(work.picture(&frame), work.picture(&view), "{number}");
    }
    work.json(&format!("render @plume.vdb --frames 0-1 {options} -o parts"));
    work.json(&format!("render @plume.vdb --frames 2-3 {options} -o parts --resume"));
    assert_eq!(frames(&work, "parts").len(), 4);
    assert_eq!(work.picture("parts/frame.0003.exr"), work.picture("whole/frame.0003.exr"));

    // Points of the volume go where the next camera sees them: the difference of depth and place tells.
    work.json(&format!("render @plume.vdb --frames 1-3 {options} --aov motion,position,samples -o moved"));
    let film = exr::read_film_within(&work.path("moved/frame.0002.exr"), None, Limits::default()).unwrap();
    let cameras = transforms::load(&work.path("moved")).unwrap().frames;
    let plane = |name: &str| film.plane(name).unwrap_or_else(|| panic!("{name}"));
    assert!(plane("Debug Sample Count.X").iter().all(|n| *n == 4.0));
    let mut seen = 0;
    for pixel in (0..film.width * film.height).filter(|pixel| film.rgba[*pixel][3] > 0.5) {
        let at = |layer: &str, c: &str| f64::from(plane(&format!("{layer}.{c}"))[pixel]);
        let world = DVec3::new(at("Position", "X"), at("Position", "Y"), at("Position", "Z"));
        let [before, now, after] = [0, 1, 2].map(|i| cameras[i].camera.project(world).unwrap().0);
        let [back, on] = [before - now, now - after];
        let expected = [back.x, -back.y, on.x, -on.y];
        let found = ["X", "Y", "Z", "W"].map(|c| at("Vector", c));
        // The mean of places is not quite the place of the mean.
        let off = expected.iter().zip(found).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 0.1 * back.length().max(on.length()) + 0.05, "{pixel}: {expected:?} {found:?}");
        seen += 1;
    }
    assert!(seen > 10, "{seen}");
    work.refused(
        &format!("render @plume.vdb --views 1 {LIT} --aov motion -o no"),
        Code::Invalid,
        &["motion", "--frames"],
    );

    work.refused(&format!("render @plume.vdb --frames 2-4 {options} -o more"), Code::Invalid, &["frame 4", "0 to 3"]);
    let other = options.replace("0.9", "0.8");
    work.refused(
        &format!("render @plume.vdb --frames 0-3 {other} -o parts --resume"),
        Code::OutputExists,
        &["transforms.json"],
    );
    work.refused(&format!("render @plume.vdb --frames 0-3 {other} -o parts"), Code::OutputExists, &["--overwrite"]);
    // The folder of the cameras is none for pictures, as its list would lose cameras.
    let list = std::fs::read(work.path("views/transforms.json")).unwrap();
    for more in ["", " --overwrite", " --resume"] {
        let words = format!("render @plume.vdb --frames 0-1 {options} -o views{more}");
        work.refused(&words, Code::OutputIsInput, &["transforms.json"]);
    }
    assert_eq!(std::fs::read(work.path("views/transforms.json")).unwrap(), list);
    work.refused(&format!("render @plume.vdb --frames 3-1 {options} -o whole"), Code::Usage, &["empty"]);
    work.refused(&format!("render @plume.vdb --views 4 --frames 1-3 {LIT} -o no"), Code::Invalid, &["--views 1"]);
    work.refused(&format!("render none.####.vdb --views 1 {LIT} -o no"), Code::Invalid, &["none.0001.vdb"]);
}

/// A scene file may hold a sequence.
#[test]
fn scene_files_hold_sequences() {
    let work = Work::new();
    for (name, from) in [("s.0001.vdb", "plume.vdb"), ("s.0002.vdb", "cube.vdb")] {
        std::fs::copy(fixture(from), work.path(name)).unwrap();
    }
    let scene = serde_json::json!({
        "volumes": [{"file": "s.%04d.vdb", "medium": {"density_scale": 4, "albedo": [0.9, 0.9, 0.9]}}],
        "lights": [{"type": "DomeLight"}],
    });
    std::fs::write(work.path("scene.json"), scene.to_string()).unwrap();
    let command = "render scene.json --views 1 --size 12x12 --samples 4 --frames 1-2 -o out";
    let report = work.json(command);
    assert_eq!(report["rendered"], 2);
    assert_ne!(work.picture("out/frame.0001.exr"), work.picture("out/frame.0002.exr"));
    // A volume behind the scene that has changed counts.
    std::fs::copy(fixture("slab.vdb"), work.path("s.0002.vdb")).unwrap();
    let again = work.json(&format!("{command} --resume"));
    assert_eq!((&again["rendered"], &again["skipped"]), (&Value::from(1), &Value::from(1)));
    assert_eq!(again["renewed"], serde_json::json!([{"input": "s.0002.vdb", "frames": [2]}]));
    work.refused("render scene.json --views 1 -o no", Code::Invalid, &["s.%04d.vdb", "--frames"]);
    // A scene file for each frame moves lights, media and functions.
    for (frame, radiance) in [(1, 1.0), (2, 3.0)] {
        let scene = serde_json::json!({
            "volumes": [{"file": fixture("plume.vdb"), "medium": {"albedo": [1, 1, 1]}}],
            "lights": [{"type": "DomeLight", "radiance": [radiance, radiance, radiance]}]});
        std::fs::write(work.path(&format!("lit.{frame:04}.json")), scene.to_string()).unwrap();
    }
    let report = work.json("render lit.####.json --views 1 --size 12x12 --samples 4 -o lit");
    assert_eq!(report["rendered"], 2);
    let [first, second] = [1, 2].map(|frame| work.picture(&format!("lit/frame.{frame:04}.exr")).rgba[0][0]);
    assert!((second - 3.0 * first).abs() < 1e-5, "{first} {second}");
    assert_eq!(work.json("plan scene.json --frame 2 --size 12x12")["integrator"], "path-tracing");
}

/// Writes the plume with a grid `vel` of constant velocity.
fn moving_plume(work: &Work, name: &str, velocity: [f32; 3]) {
    let grid = density(&fixture("plume.vdb"));
    let leaf = |leaf: &Leaf| RawLeaf {
        origin: leaf.origin,
        values: velocity.iter().copied().cycle().take(3 * 512).collect(),
        active: [u64::MAX; 8],
    };
    let leaves: Vec<RawLeaf> = grid.leaves.iter().map(leaf).collect();
    let vectors = NativeGrid::from_vectors("vel", GridClass::Unknown, &grid.transform, &leaves).unwrap();
    let densities = NativeGrid::from_grid(&grid).unwrap();
    let metadata = BTreeMap::new();
    write_native(&work.path(name), &[&densities, &vectors], None, &metadata, Codec::default()).unwrap();
}

/// Before a camera at rest, collisions move by the velocities, from the options and from a scene file alike.
#[test]
fn volumes_move_by_their_velocities() {
    let work = Work::new();
    let velocity = [0.4_f32, -0.2, 0.6];
    moving_plume(&work, "moving.vdb", velocity);
    let command = "render moving.vdb --frames 1-2 --views 1 --size 20x16 --density-scale 4 --albedo 0.9 --samples 4";
    work.json(&format!("{command} --aov motion,position --velocity vel --fps 10 -o moved"));
    let film = exr::read_film_within(&work.path("moved/frame.0001.exr"), None, Limits::default()).unwrap();
    let camera = transforms::load(&work.path("moved")).unwrap().frames[0].camera;
    let step = DVec3::from_array(velocity.map(f64::from)) / 10.0;
    let mut seen = 0;
    for pixel in (0..film.width * film.height).filter(|pixel| film.rgba[*pixel][3] > 0.5) {
        let at = |layer: &str, c: &str| f64::from(film.plane(&format!("{layer}.{c}")).unwrap()[pixel]);
        let world = DVec3::new(at("Position", "X"), at("Position", "Y"), at("Position", "Z"));
        let [before, now, after] = [world - step, world, world + step].map(|p| camera.project(p).unwrap().0);
        let [back, on] = [before - now, now - after];
        let expected = [back.x, -back.y, on.x, -on.y];
        let off = expected.iter().zip(["X", "Y", "Z", "W"]).map(|(v, c)| (v - at("Vector", c)).abs());
        assert!(off.fold(0.0, f64::max) < 0.1 * back.length() + 0.02, "{pixel}: {expected:?}");
        seen += 1;
    }
    assert!(seen > 10, "{seen}");

    let scene = serde_json::json!({
        "volumes": [{"file": "moving.vdb", "medium": {"density_scale": 4, "albedo": [0.9, 0.9, 0.9]},
                     "velocity": {"grid": "vel", "fps": 10}}],
        "lights": [{"type": "DomeLight"}]});
    std::fs::write(work.path("scene.json"), scene.to_string()).unwrap();
    work.json("render scene.json --frames 1 --cameras moved --samples 4 --aov motion,position -o same");
    let same = exr::read_film_within(&work.path("same/frame.0001.exr"), None, Limits::default()).unwrap();
    assert_eq!(film.plane("Vector.X"), same.plane("Vector.X"));

    work.refused(&format!("{command} --velocity vel -o no"), Code::Invalid, &["--velocity", "--aov motion"]);
    for (grid, words) in [("density", ["'density'", "vec3s"]), ("speed", ["'speed'", "vel"])] {
        let out = work.command(&format!("{command} --aov motion --velocity {grid} -o no")).output().unwrap();
        assert_eq!(out.status.code(), Some(2));
        assert!(words.iter().all(|word| errors(&out).contains(word)), "{}", errors(&out));
    }
    let out =
        work.command("render scene.json --frames 1 --views 1 --aov motion --velocity vel -o no").output().unwrap();
    assert!(out.status.code() == Some(2) && errors(&out).contains("scene file"), "{}", errors(&out));
}

/// Simulations begin with empty frames: they show the background by the camera and the scale of all.
#[test]
fn an_empty_frame_shows_the_background() {
    let work = Work::new();
    std::fs::copy(fixture("plume.vdb"), work.path("s.0002.vdb")).unwrap();
    work.json("convert @plume.vdb s.0001.vdb --crop 900,900,900,901,901,901");
    for more in ["", " --albedo 0.9 --sky 0.5 --samples 2"] {
        let out = format!("out{}", more.len());
        let command = format!("render s.####.vdb --views 1 --size 20x16 --density-scale auto{more} -o {out}");
        let report = work.json(&command);
        assert_eq!((&report["rendered"], &report["failed"]), (&Value::from(2), &Value::from(Vec::<u32>::new())));
        let [empty, full] = [1, 2].map(|n| work.picture(&format!("{out}/frame.000{n}.exr")));
        assert!(empty.rgba.iter().all(|p| *p == empty.rgba[0] && p[3] == 0.0 && p[0] > 0.0), "{:?}", empty.rgba[0]);
        assert_eq!((empty.width, full.rgba[0]), (20, empty.rgba[0]));
        assert!(full.rgba.iter().any(|p| p[3] > 0.5));
    }
}

/// `--quiet` silences progress and remarks, and no failure.
#[test]
fn frames_that_fail_are_told_of_quietly() {
    let work = Work::new();
    std::fs::copy(fixture("plume.vdb"), work.path("s.0001.vdb")).unwrap();
    std::fs::write(work.path("s.0002.vdb"), "no").unwrap();
    let out = work.command("render s.####.vdb --views 1 --size 8x8 -q -o out").output().unwrap();
    assert_eq!(out.status.code(), Some(2));
    assert!(errors(&out).contains("cumulo: frame 2: ") && errors(&out).contains("s.0002.vdb"), "{}", errors(&out));
}

/// Frames of which none is there are one error, which says what is there.
#[test]
fn a_range_beside_the_sequence_is_refused_at_once() {
    let work = Work::new();
    for number in [1001, 1006] {
        std::fs::copy(fixture("plume.vdb"), work.path(&format!("smoke.{number}.vdb"))).unwrap();
    }
    let command = "render smoke.####.vdb --views 1 --size 8x8 -o out";
    work.refused(&format!("{command} --frames 1-10"), Code::Invalid, &["smoke.####.vdb", "from 1001 to 1006"]);
    assert!(!work.path("out").exists());
    assert_eq!(work.json(&format!("{command} --frames 1006"))["rendered"], 1);
}

/// Processes that render parts of a sequence into one folder, at once or one after the other, with `--resume` or without, leave one
/// capture of all frames.
#[test]
fn parts_keep_each_others_frames() {
    let work = Work::new();
    work.json("render @plume.vdb --views 12 --layout ring --size 8x8 -o path");
    for (round, more) in ["", " --resume", " --overwrite", ""].into_iter().enumerate() {
        let command = |first: u32| {
            let last = first + 3;
            format!("render @plume.vdb --cameras path --quiet -o out{round}{more} --frames {first}-{last}")
        };
        let at_once = round < 3;
        let mut running = Vec::new();
        for first in [0, 4, 8] {
            running.push(work.start(&command(first)));
            if !at_once {
                running.drain(..).for_each(|mut child| assert!(child.wait().unwrap().success()));
            }
        }
        for child in running {
            let out = child.wait_with_output().unwrap();
            assert!(out.status.success(), "{}", errors(&out));
        }
        let listed = frames(&work, &format!("out{round}"));
        let expected: Vec<String> = (0..12).map(|n| format!("frame.{n:04}.exr")).collect();
        assert_eq!(listed, expected, "{more}");
        let json = std::fs::read(work.path(&format!("out{round}/transforms.json"))).unwrap();
        let json: Value = serde_json::from_slice(&json).unwrap();
        assert!(json["provenance"]["inputs"]["path/transforms.json"].is_string(), "{}", json["provenance"]);
    }
    // A part again replaces its own frames alone, and another command none.
    work.json("render @plume.vdb --cameras path -o out0 --frames 2-3");
    assert_eq!(frames(&work, "out0").len(), 12);
    let before = work.files("out0");
    let other = "render @plume.vdb --cameras path --background 1,0,0 -o out0 --frames 2-3";
    work.refused(other, Code::OutputExists, &["--overwrite"]);
    work.refused(&format!("{other} --resume"), Code::OutputExists, &["--overwrite"]);
    assert_eq!(work.files("out0"), before);
    work.json(&format!("{other} --overwrite"));
    assert_eq!(frames(&work, "out0").len(), 2);
}

/// Processes that render some of the views into one folder, at once or one after the other, with `--resume` or without,
/// leave one capture of all of them, as one process does.
#[test]
fn views_of_several_runs_are_one_capture() {
    let work = Work::new();
    work.json("render @plume.vdb --views 6 --size 24x24 -o whole");
    for (round, more) in ["", " --resume", " --overwrite", ""].into_iter().enumerate() {
        let command =
            |part: &str| format!("render @plume.vdb --views 6 --size 24x24 --quiet --view {part} -o out{round}{more}");
        let mut running = Vec::new();
        for part in ["0-1", "2-3", "4-5"] {
            running.push(work.start(&command(part)));
            if round == 3 {
                running.drain(..).for_each(|mut child| assert!(child.wait().unwrap().success()));
            }
        }
        for child in running {
            let out = child.wait_with_output().unwrap();
            assert!(out.status.success(), "{}", errors(&out));
        }
        let out = format!("out{round}");
        assert_eq!(frames(&work, &out), frames(&work, "whole"), "{more}");
        let json = |folder: &str| -> Value {
            let text = std::fs::read(work.path(&format!("{folder}/transforms.json"))).unwrap();
            let mut json: Value = serde_json::from_slice(&text).unwrap();
            json.as_object_mut().unwrap().remove("provenance");
            json
        };
        assert_eq!(json(&out), json("whole"), "{more}");
        work.json(&format!("compare {out} whole --tolerance 0"));
    }
    // Those that are there stay, and the others are rendered.
    std::fs::remove_file(work.path("out0/view_003.exr")).unwrap();
    let report = work.json("render @plume.vdb --views 6 --size 24x24 --resume -o out0");
    assert_eq!((&report["views"], &report["skipped"]), (&1.into(), &5.into()));
    assert_eq!(frames(&work, "out0").len(), 6);
}

/// Runs of other settings lose nothing, and say so: those that end later, or begin later, are refused.
#[test]
fn views_of_other_settings_are_not_mixed() {
    let work = Work::new();
    let command = |part: &str, light: u32| {
        format!("render @plume.vdb --views 4 --size 24x24 --background {light},1,1 --view {part} -o out")
    };
    let running = [work.start(&command("0-1", 0)), work.start(&command("2-3", 1))];
    let codes = running.map(|child| child.wait_with_output().unwrap().status.code().unwrap());
    assert!(codes == [0, 2] || codes == [2, 0], "{codes:?}");
    assert_eq!(frames(&work, "out").len(), 2);
    assert_eq!(work.files("out").len(), 3, "the pictures of the refused run are not there");
    let before = work.files("out");
    let refused = if codes[0] == 0 { 1 } else { 0 };
    work.refused(&command("1-2", refused), Code::OutputExists, &["transforms.json"]);
    work.refused(&format!("{} --resume", command("1-2", refused)), Code::OutputExists, &["transforms.json"]);
    assert_eq!(work.files("out"), before);
}

/// Of two runs of other settings that render the same frames at once, one replaces nothing of the other.
#[test]
fn frames_of_other_settings_are_not_mixed() {
    let work = Work::new();
    let command = |light: u32| {
        format!("render @plume.vdb --views 1 --frames 0-7 --size 64x64 --background {light},1,1 --quiet -o out")
    };
    let running = [0, 1].map(|light| work.start(&command(light)));
    let codes = running.map(|child| child.wait_with_output().unwrap().status.code().unwrap());
    assert!(codes == [0, 2] || codes == [2, 0], "{codes:?}");
    assert_eq!(frames(&work, "out").len(), 8);
    let winner = u32::from(codes[1] == 0);
    assert_eq!(work.json(&format!("{} --resume", command(winner)))["skipped"], 8);
}

/// Views of another content are not listed beside those of this one.
#[test]
fn views_of_other_content_are_not_mixed() {
    let work = Work::new();
    std::fs::copy(fixture("plume.vdb"), work.path("a.vdb")).unwrap();
    work.json("render a.vdb --views 4 --size 8x8 -o out");
    std::fs::copy(fixture("cube.vdb"), work.path("a.vdb")).unwrap();
    let before = work.files("out");
    for more in ["", " --resume"] {
        let part = format!("render a.vdb --views 4 --size 8x8 --view 1-2 -o out{more}");
        work.refused(&part, Code::OutputExists, &["view_000.exr", "--overwrite"]);
    }
    assert_eq!(work.files("out"), before);
    assert_eq!(work.json("render a.vdb --views 4 --size 8x8 -o out --resume")["views"], 4);
    assert_eq!(frames(&work, "out").len(), 4);
}

/// A folder of numbered files, and Houdini's names, are the sequence that a pattern is.
#[test]
fn folders_and_houdinis_names_are_sequences() {
    let work = Work::new();
    std::fs::create_dir(work.path("shot")).unwrap();
    for (name, from) in [("smoke.0001.vdb", "plume.vdb"), ("smoke.0002.vdb", "cube.vdb")] {
        std::fs::copy(fixture(from), work.path("shot").join(name)).unwrap();
    }
    let render = |input: &str, to: &str| {
        work.json(&format!("render {input} --views 1 --size 12x12 --density-scale auto -o {to}"));
        [1, 2].map(|number| exr::read_picture(&work.path(&format!("{to}/frame.{number:04}.exr")), None).unwrap().rgba)
    };
    let pictures = render("shot/smoke.####.vdb", "a");
    assert!(pictures[0] != pictures[1]);
    assert!(render("shot", "b") == pictures && render("shot/smoke.$F4.vdb", "c") == pictures);
    assert_eq!(work.json("plan shot --views 1 --size 12x12")["input"], "shot/smoke.0001.vdb");
    std::fs::create_dir(work.path("empty")).unwrap();
    work.refused("render empty --views 1 -o d", Code::Invalid, &["empty", "no numbered VDBs", "smoke.0001.vdb"]);
    std::fs::copy(fixture("cube.vdb"), work.path("shot/fire.1.vdb")).unwrap();
    std::fs::copy(fixture("cube.vdb"), work.path("shot/fire.2.vdb")).unwrap();
    work.refused("render shot --views 1 -o d", Code::Invalid, &["shot", "fire.#.vdb", "smoke.####.vdb"]);
}
