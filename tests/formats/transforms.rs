//! Captures: what is written is read back to the bit, other tools' files are understood, and faults
//! are named by frame and key.

use crate::common::refusal;
use cumulo::error::Code;
use cumulo::formats::{captures, exr, transforms};
use cumulo::scene::blur::{Aperture, Blur, Shutter};
use cumulo::scene::camera::{Camera, Projection};
use cumulo::scene::capture::{Capture, EmissionModel, Frame, Model, Pictures, PixelFilter};
use cumulo::scene::color_space::ColorSpace;
use cumulo::scene::film::Film;
use cumulo::scene::transfer::Transfer;
use glam::{DMat4, DQuat, DVec2, DVec3};
use serde_json::{Map, Value, json};
use std::path::Path;

/// Of some views a disc, a polygon, or motion.
fn blur(view: i32) -> Blur {
    let disc = Aperture::disc(1.0 / 30.0, 2.9);
    let moved = |by: f64| DMat4::from_rotation_translation(DQuat::from_rotation_x(by), DVec3::splat(by / 3.0));
    match view {
        1 => Blur { aperture: Some(disc), shutter: None },
        2 => Blur {
            aperture: None,
            shutter: Some(Shutter { start: moved(-0.1), end: moved(0.2), open: Some([-0.1, 0.2]) }),
        },
        4 => Blur { aperture: Some(Aperture { blades: 5, rotation: 0.1, ratio: 1.3, ..disc }), ..blur(2) },
        _ => Blur::default(),
    }
}

fn capture(folder: &Path) -> Capture {
    let frames = (0..5)
        .map(|i| {
            let angle = 0.7 * f64::from(i) + 0.123_456_789;
            let eye = DVec3::new(3.0 * angle.cos(), 3.0 * angle.sin(), 1.0 / 3.0);
            Frame {
                camera: Camera {
                    camera_to_world: Camera::look_at(eye, DVec3::new(0.1, 0.2, 0.3), DVec3::Z),
                    projection: if i == 3 { Projection::Orthographic } else { Projection::Perspective },
                    focal: DVec2::new(100.0 / 3.0, 110.0 / 7.0 + f64::from(i)),
                    centre: DVec2::new(31.7, 24.1),
                    width: 64,
                    height: 48 + i as u32,
                    near: 0.1,
                    blur: blur(i),
                },
                picture: folder.join(format!("view.{i:04}.exr")),
            }
        })
        .collect();
    Capture {
        frames,
        model: Model::EmissionAbsorption,
        background: [0.1, 0.7, 1.0 / 3.0],
        pixel_filter: PixelFilter::Box,
        density_scale: 1.0 / 7.0,
        emission: [1.0, 0.2, 1e-3],
        emission_model: EmissionModel::Linear,
        transfer: Some(Transfer::Identity { domain: [0.0, 1.0 / 3.0], color: [0.1, 0.2, 0.3] }),
        lattice: Some(
            DMat4::from_translation(DVec3::new(1e6 + 0.1, -2.5, 1.0 / 3.0)) * DMat4::from_scale(DVec3::splat(0.1)),
        ),
        color_space: Some(ColorSpace::Srgb),
        pictures: Some(Pictures::Photographs),
        remarks: Vec::new(),
    }
}

#[test]
fn what_is_saved_is_loaded_to_the_bit() {
    let dir = tempfile::tempdir().unwrap();
    let json = dir.path().join("transforms.json");
    let written = capture(dir.path());
    let mut extra = Map::new();
    extra.insert("generator".into(), json!("test"));
    transforms::save(&json, &written, &extra).unwrap();
    assert_eq!(transforms::load(&json).unwrap(), written);
    assert_eq!(transforms::load(dir.path()).unwrap(), written, "by its folder");
    let mut text: Value = serde_json::from_slice(&std::fs::read(&json).unwrap()).unwrap();
    assert_eq!(text["generator"], "test");
    assert_eq!(text["w"], 64, "what all views share is written once");
    assert!(text["frames"][0].get("w").is_none());
    assert_eq!(text["frames"][4]["h"], 52, "what differs is written with its view");
    assert_eq!(text["frames"].as_array_mut().unwrap().remove(1)["file_path"], "view.0001.exr");
    extra.insert("frames".into(), json!([]));
    refusal::is(&transforms::save(&json, &written, &extra).unwrap_err(), Code::Invalid, &["'frames'"]);
}

fn load(text: &Value) -> cumulo::Result<Capture> {
    let dir = tempfile::tempdir().unwrap();
    let json = dir.path().join("transforms.json");
    std::fs::write(&json, text.to_string()).unwrap();
    transforms::load(&json)
}

fn identity() -> Value {
    json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]])
}

/// As the NeRF data sets have it: an angle, no size, no suffix.
#[test]
fn a_nerf_file_takes_its_size_from_the_picture() {
    let dir = tempfile::tempdir().unwrap();
    let json = dir.path().join("transforms.json");
    std::fs::create_dir(dir.path().join("train")).unwrap();
    let film = Film::new(40, 30);
    exr::write_picture(&dir.path().join("train/r_0.exr"), &film, &Default::default(), exr::Half::None).unwrap();
    let text = json!({"camera_angle_x": 0.6911112070083618, "frames": [
        {"file_path": "./train/r_0", "rotation": 0.01, "transform_matrix": identity()}]});
    std::fs::write(&json, text.to_string()).unwrap();
    let capture = transforms::load(&json).unwrap();
    let camera = capture.frames[0].camera;
    assert_eq!((camera.width, camera.height), (40, 30));
    assert_eq!(camera.centre, DVec2::new(20.0, 15.0));
    // f = w/2 / tan(angle/2), pixels square; both computed in f64.
    let f = 20.0 / (0.5 * 0.6911112070083618_f64).tan();
    assert!((camera.focal - DVec2::splat(f)).length() < 1e-12 * f);
    assert_eq!(camera.position(), DVec3::new(0.0, 0.0, 4.0));
    assert!(capture.frames[0].picture.ends_with("train/r_0.exr"));
    assert_eq!((capture.model, capture.background), (Model::Absorption, [1.0; 3]));
}

#[test]
fn a_frame_overrides_the_file() {
    let c = load(&json!({"fl_x": 50, "w": 40.0, "h": 30, "cx": 19, "camera_model": "OPENCV", "k1": 0.0, "frames": [
        {"file_path": "a.exr", "transform_matrix": identity()},
        {"file_path": "b.0001", "transform_matrix": identity(), "fl_x": 60, "fl_y": 70, "cy": 3, "w": 20, "near": 0.5},
        {"file_path": "c.exr", "transform_matrix": identity(), "camera_model": "ORTHOGRAPHIC"}]}))
    .unwrap();
    let cameras: Vec<Camera> = c.frames.iter().map(|f| f.camera).collect();
    assert_eq!((cameras[0].focal, cameras[0].centre), (DVec2::splat(50.0), DVec2::new(19.0, 15.0)));
    assert_eq!((cameras[1].focal, cameras[1].centre), (DVec2::new(60.0, 70.0), DVec2::new(19.0, 3.0)));
    assert_eq!((cameras[1].width, cameras[1].near, cameras[0].near), (20, 0.5, 0.0));
    assert_eq!(cameras[2].projection, Projection::Orthographic);
    assert!(c.frames[1].picture.ends_with("b.0001.exr"));
}

#[test]
fn faults_are_named_by_frame_and_key() {
    let good = json!({"fl_x": 50, "w": 40, "h": 30, "frames": [
        {"file_path": "a.exr", "transform_matrix": identity()},
        {"file_path": "b.exr", "transform_matrix": identity()}]});
    load(&good).unwrap();
    let cases: [(&str, Value, &[&str]); 18] = [
        ("/frames/1/transform_matrix_start", identity(), &["frame 1", "transform_matrix_end"]),
        ("/frames/0/transform_matrix_end", json!([1]), &["frame 0", "transform_matrix_end", "four rows"]),
        ("/frames/0/aperture_radius", json!(0.1), &["frame 0", "no key 'focus_distance'"]),
        ("/frames/1/transform_matrix", json!([[1, 2], [3]]), &["frame 1", "transform_matrix", "four rows"]),
        ("/frames/1/transform_matrix/0/1", json!(0.5), &["frame 1", "not orthogonal"]),
        ("/frames/1/transform_matrix/0/1", json!("x"), &["frame 1", "transform_matrix"]),
        ("/frames/1/transform_matrix", Value::Null, &["frame 1", "transform_matrix"]),
        ("/frames/0/file_path", json!(7), &["frame 0", "file_path"]),
        ("/frames/0", json!([]), &["frame 0", "object"]),
        ("/frames", json!([]), &["frames", "empty"]),
        ("/fl_x", json!("wide"), &["fl_x", "number"]),
        ("/fl_x", json!(-3), &["focal"]),
        ("/fl_x", Value::Null, &["fl_x", "camera_angle_x"]),
        ("/w", json!(0), &["'w'", "65536"]),
        ("/w", json!(40.5), &["'w'", "whole"]),
        ("/h", Value::Null, &["frame 0", "'h'", "a.exr"]),
        ("/frames/1/k1", json!(0.1), &["frame 1", "k1", "undistort"]),
        ("/frames/1/camera_model", json!("FISHEYE"), &["frame 1", "FISHEYE"]),
    ];
    for (pointer, value, words) in cases {
        let mut bad = good.clone();
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        match bad.pointer_mut(parent).unwrap() {
            Value::Object(map) => drop(map.insert(key.into(), value)),
            Value::Array(list) => list[key.parse::<usize>().unwrap()] = value,
            _ => panic!("{pointer}"),
        }
        let unsupported = ["/frames/1/k1", "/frames/1/camera_model"].contains(&pointer);
        let code = if unsupported { Code::Unsupported } else { Code::Invalid };
        refusal::is(&load(&bad).unwrap_err(), code, &[&["transforms.json"], words].concat());
    }
    for (key, value) in [
        ("background", json!([1, 2])),
        ("model", json!("fog")),
        ("density_scale", json!(0)),
        ("emission", json!([1, 1, -1])),
        ("pixel_filter", json!(1)),
        ("emission_model", json!("quadratic")),
        ("transfer", json!({"kind": "identity", "domain": [1, 0], "color": [1, 1, 1]})),
        ("transfer", json!("ramp")),
        ("lattice", json!(1)),
    ] {
        let mut bad = good.clone();
        bad[key] = value;
        refusal::is(&load(&bad).unwrap_err(), Code::Invalid, &[key]);
    }
}

#[test]
fn missing_and_malformed_files_are_errors() {
    let dir = tempfile::tempdir().unwrap();
    refusal::is(&transforms::load(dir.path()).unwrap_err(), Code::NotFound, &["transforms.json"]);
    assert_eq!(captures::problems(dir.path()).unwrap().len(), 1, "no capture lies in the folder");
    for text in ["", "[]", "{\"frames\": [", "{\"frames\": 3}", "{}", "\u{0}"] {
        std::fs::write(dir.path().join("transforms.json"), text).unwrap();
        transforms::load(dir.path()).unwrap_err();
    }
}

fn picture(path: &Path, width: usize, height: usize, first: f32) {
    let mut film = Film::new(width, height);
    film.rgba[0][0] = first;
    exr::write_picture(path, &film, &Default::default(), exr::Half::None).unwrap();
}

#[test]
fn problems_are_listed_all_at_once() {
    let dir = tempfile::tempdir().unwrap();
    let json = dir.path().join("transforms.json");
    for i in 0..5 {
        picture(&dir.path().join(format!("{i}.exr")), 40, 30, 0.0);
    }
    let frame = |name: &str| json!({"file_path": name, "transform_matrix": identity()});
    let mut text =
        json!({"fl_x": 50, "w": 40, "h": 30, "frames": [frame("0"), frame("1"), frame("2"), frame("3"), frame("4")]});
    let problems = |text: &Value| {
        std::fs::write(&json, text.to_string()).unwrap();
        captures::problems(dir.path()).unwrap()
    };
    assert_eq!(problems(&text), []);

    picture(&dir.path().join("1.exr"), 30, 40, 0.0);
    std::fs::remove_file(dir.path().join("2.exr")).unwrap();
    picture(&dir.path().join("3.exr"), 40, 30, f32::NAN);
    text["frames"][4]["file_path"] = json!("0.exr");
    let found = problems(&text);
    let whats: Vec<String> = found.iter().map(ToString::to_string).collect();
    assert_eq!(whats.len(), 4, "{whats:?}");
    let expected =
        [["frame 1", "30x40"], ["frame 2", "2.exr"], ["frame 3", "NaN"], ["frame 4", "same picture as frame 0"]];
    for (what, words) in whats.iter().zip(expected) {
        assert!(words.iter().all(|w| what.contains(w)), "{what}");
    }

    text["frames"][1]["transform_matrix"][0][1] = json!(0.5);
    text["frames"][3]["k1"] = json!(0.5);
    let found = problems(&text);
    assert_eq!(found.len(), 2, "{found:?}");
    assert!(found[0].part.as_deref() == Some("frame 1") && found[0].what.contains("orthogonal"));
    assert!(found[1].part.as_deref() == Some("frame 3") && found[1].remedy.contains("undistort"));
    assert_eq!(problems(&json!({"frames": []})).len(), 1);
}

#[test]
fn summaries_count_views_and_sizes() {
    let dir = tempfile::tempdir().unwrap();
    let json = dir.path().join("transforms.json");
    transforms::save(&json, &capture(dir.path()), &Map::new()).unwrap();
    let summary = captures::summary(&json).unwrap();
    assert_eq!((summary.frames, summary.orthographic, summary.sizes["64x52"]), (5, 1, 1));
    assert!(summary.cameras_max.iter().zip(summary.cameras_min).all(|(high, low)| *high >= low && *high <= 3.0));
    assert_eq!((summary.emission, summary.emission_model, summary.transfer), (None, None, true));
    assert!(summary.to_string().contains("by a transfer function"));
    transforms::save(&json, &Capture { transfer: None, ..capture(dir.path()) }, &Map::new()).unwrap();
    let summary = captures::summary(&json).unwrap();
    assert_eq!((summary.emission, summary.emission_model), (Some([1.0, 0.2, 1e-3]), Some(EmissionModel::Linear)));
    // The lattice is a translation of a scale: each column has a single entry, whose root of a square rounds twice.
    let size = summary.lattice_voxel_size.unwrap();
    assert!(size.iter().all(|s| (s - 0.1).abs() < 4.0 * f64::EPSILON * 0.1), "{size:?}");
    let text = summary.to_string();
    for words in
        ["5 view", "1 of 64x52", "4 perspective, 1 orthographic", "[1.0, 0.2, 0.001] times the density", "lattice"]
    {
        assert!(text.contains(words), "'{words}' is not in: {text}");
    }
    let dark = Capture { model: Model::Absorption, lattice: None, ..capture(dir.path()) };
    transforms::save(&json, &dark, &Map::new()).unwrap();
    let summary = captures::summary(dir.path()).unwrap();
    assert_eq!((summary.emission, summary.emission_model, summary.lattice_voxel_size), (None, None, None));
}

/// Bytes that mean something in JSON, and two that never do.
const DAMAGE: &[u8] = b"0123456789-.eE[]{},:\"nlt\0\xff";

/// 300 damaged captures: none panics; what loads has usable numbers.
#[test]
fn damaged_captures_are_loaded_or_refused() {
    let dir = tempfile::tempdir().unwrap();
    let json = dir.path().join("transforms.json");
    transforms::save(&json, &capture(dir.path()), &Map::new()).unwrap();
    let whole = std::fs::read(&json).unwrap();
    let mut state = 1_u64;
    let mut random = move |n: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % n
    };
    let mut refused = 0;
    for round in 0..300 {
        let mut bytes = whole.clone();
        if round % 5 == 0 {
            bytes.truncate(random(bytes.len()));
        }
        for _ in 0..=random(4) {
            let at = random(bytes.len().max(1));
            if let Some(byte) = bytes.get_mut(at) {
                *byte = DAMAGE[random(DAMAGE.len())];
            }
        }
        std::fs::write(&json, &bytes).unwrap();
        match transforms::load(&json) {
            Err(error) => {
                refused += 1;
                assert!(error.to_string().contains("transforms.json"), "{error}");
            }
            Ok(capture) => assert!(capture.frames.iter().all(|f| f.camera.checked().is_ok())),
        }
        captures::problems(&json).unwrap();
    }
    assert!((100..300).contains(&refused), "{refused} of 300 refused");
}

/// What a frame says of its focal length goes before what is said for all, in whichever unit.
#[test]
fn a_frame_has_a_focal_length_of_its_own() {
    let dir = tempfile::tempdir().unwrap();
    let pose = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1]]);
    let frame = |own: Value| {
        let mut frame = json!({"file_path": "a.exr", "transform_matrix": pose.clone()});
        frame.as_object_mut().unwrap().extend(own.as_object().unwrap().clone());
        frame
    };
    let text = json!({"w": 20, "h": 20, "fl_x": 100.0, "frames": [
        frame(json!({})),
        frame(json!({"fl_x": 50.0})),
        frame(json!({"camera_angle_x": std::f64::consts::FRAC_PI_2})),
    ]});
    std::fs::write(dir.path().join("transforms.json"), text.to_string()).unwrap();
    let capture = transforms::load(dir.path()).unwrap();
    let focal: Vec<f64> = capture.frames.iter().map(|f| f.camera.focal.x).collect();
    assert_eq!(&focal[..2], [100.0, 50.0]);
    assert!((focal[2] - 10.0).abs() < 1e-12, "{focal:?}");
}
