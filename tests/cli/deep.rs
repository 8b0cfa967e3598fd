//! Deep OpenEXR pictures: what commands say of them, and how they become flat ones.

use crate::common::refusal;
use crate::common::work::{Work, fixture, number};
use cumulo::error::Code;
use cumulo::formats::exr::deep::{self, DeepLine, DeepSample, Encoding, Layout, TidyPixel};
use cumulo::formats::exr::{self, Attributes, Window};
use serde_json::{Value, json};
use std::path::Path;

const SIZE: [usize; 2] = [24, 10];

/// Pixels of two overlapping volumes, of a point behind them, and of nothing.
fn pixel(x: usize, y: usize) -> Vec<DeepSample> {
    let haze = DeepSample { z: 2.0, z_back: 6.0, rgba: [0.25, 0.125, 0.5, 0.5] };
    let cloud = DeepSample { z: 3.0 + y as f32 / 8.0, z_back: 5.0, rgba: [0.75, 0.5, 0.25, 0.75] };
    let wall = DeepSample { z: 8.0, z_back: 8.0, rgba: [0.0, 1.0, 0.0, 1.0] };
    match x % 4 {
        0 => vec![],
        1 => vec![haze, cloud],
        2 => vec![cloud, haze, wall],
        _ => vec![haze, wall],
    }
}

fn layout() -> Layout {
    let window = Window { min: [4, -2], size: SIZE };
    Layout { display_window: window, data_window: window, pixel_aspect: 1.5 }
}

fn write(path: &Path, samples: impl Fn(usize, usize) -> Vec<DeepSample>) {
    let attributes: Attributes = [("owner".to_owned(), "somebody".to_owned())].into();
    deep::write(path, &layout(), &attributes, Encoding::default(), |writer| {
        (0..SIZE[1]).try_for_each(|y| {
            let mut line = DeepLine::default();
            (0..SIZE[0]).for_each(|x| line.push(&samples(x, y)));
            writer.push(line)
        })
    })
    .unwrap();
}

#[test]
fn deep_pictures_are_described() {
    let work = Work::new();
    write(&work.path("deep.exr"), pixel);
    let info = &work.json("info deep.exr")["files"][0];
    assert_eq!((&info["format"], &info["sorted"], &info["tidy"]), (&json!("deepexr"), &json!(false), &json!(false)));
    assert_eq!(info["samples_per_pixel"], json!({ "min": 0, "mean": 1.75, "max": 3 }));
    assert_eq!((number(info, "samples"), number(info, "empty_pixels")), (420.0, 60.0));
    assert_eq!((&info["depth"], &info["attributes"]["owner"]), (&json!([2.0, 8.0]), &json!("somebody")));
    let green = info["channels"].as_array().unwrap().iter().find(|c| c["name"] == "G").unwrap();
    assert_eq!((number(green, "min"), number(green, "max")), (0.125, 1.0));
    let text = work.text("info deep.exr");
    assert!(text.contains("0 to 3 a pixel") && text.contains("not sorted") && text.contains("ZBack"), "{text}");

    let findings = work.json("validate deep.exr")["files"][0]["findings"].clone();
    let whats: Vec<&str> = findings.as_array().unwrap().iter().map(|f| f["what"].as_str().unwrap()).collect();
    let expected = ["pixels whose samples are not sorted by depth: 60", "pixels whose samples overlap: 60"];
    assert_eq!(whats, expected, "{findings}");
    let fault = |x: usize, _| match x {
        0 => vec![DeepSample { z: f32::INFINITY, z_back: f32::INFINITY, rgba: [0.0; 4] }],
        1 => vec![DeepSample { z: 1.0, z_back: 0.5, rgba: [0.0, 0.0, 0.0, 1.5] }],
        2 => vec![DeepSample { z: 1.0, z_back: 2.0, rgba: [f32::NAN, 0.0, 0.0, 0.5] }],
        _ => vec![],
    };
    write(&work.path("faults.exr"), fault);
    let out = work.command("validate faults.exr --json").output().unwrap();
    assert_eq!(out.status.code(), Some(1));
    let report: Value = serde_json::from_slice(&out.stdout).unwrap();
    let findings = report["files"][0]["findings"].as_array().unwrap();
    assert_eq!(findings.len(), 4, "{findings:?}");
    for (finding, word) in findings.iter().zip(["infinite: 10", "NaN", "within 0 to 1: 10", "ZBack below Z): 10"]) {
        assert!(finding["what"].as_str().unwrap().contains(word), "{finding}");
    }
}

#[test]
fn deep_pictures_become_flat_ones() {
    let work = Work::new();
    write(&work.path("deep.exr"), pixel);
    let report = work.json("convert deep.exr flat.exr --flatten");
    assert_eq!(report["layer"]["channels"], json!(["R", "G", "B", "A", "Z"]));
    let film = exr::read_film_within(&work.path("flat.exr"), None, Default::default()).unwrap();
    let header = exr::header(&work.path("flat.exr")).unwrap();
    assert_eq!((header.display_window, header.pixel_aspect), (layout().display_window, 1.5));
    assert_eq!(header.attributes()["owner"], "somebody");
    let depths = film.plane("Z").unwrap();
    for (i, (found, depth)) in film.rgba.iter().zip(depths).enumerate() {
        let tidy = TidyPixel::new(&pixel(i % SIZE[0], i / SIZE[0]));
        assert_eq!(*found, tidy.rgba().map(|v| v as f32), "{i}");
        assert_eq!(*depth, if (i % SIZE[0]).is_multiple_of(4) { 1e10 } else { 2.0 }, "{i}");
    }
    // Half of the light passes the haze, a quarter of that the cloud.
    assert!((film.rgba[1][3] - 0.875).abs() < 1e-6, "{:?}", film.rgba[1]);
    assert_eq!(film.rgba[2][3], 1.0);

    // The flat picture is what a comparison and a sheet show of the deep one.
    assert_eq!(work.json("compare deep.exr flat.exr")["differ"], json!(false));
    let shown = &work.json("view deep.exr -o deep.png")["sheets"][0]["layers"];
    assert_eq!(*shown, work.json("view flat.exr -o flat.png")["sheets"][0]["layers"]);
    work.json("convert deep.exr a.png --flatten --exposure 1");
    work.json("convert flat.exr b.png --exposure 1");
    assert_eq!(std::fs::read(work.path("a.png")).unwrap(), std::fs::read(work.path("b.png")).unwrap());
    // A sequence.
    for number in 1..3 {
        std::fs::copy(work.path("deep.exr"), work.path(&format!("in.{number}.exr"))).unwrap();
    }
    work.json("convert in.#.exr out.#.exr --flatten --half");
    assert_eq!(work.json("compare out.2.exr flat.exr --tolerance 1e-3")["differ"], json!(false));
    assert!(work.json("info in.#.exr")["files"].as_array().unwrap().iter().all(|file| file["samples"] == 420));
}

#[test]
fn what_takes_flat_pictures_says_how_to_make_one() {
    let work = Work::new();
    write(&work.path("deep.exr"), pixel);
    std::fs::copy(work.path("deep.exr"), work.path("frame.0001.exr")).unwrap();
    let flat = fixture("exr/zip.exr");
    std::fs::copy(flat, work.path("flat.exr")).unwrap();
    let capture = r#"{ "camera_angle_x": 0.8, "w": 20, "h": 21, "frames": [{ "file_path": "deep.exr",
        "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]] }] }"#;
    std::fs::write(work.path("transforms.json"), capture).unwrap();
    for words in [
        "denoise deep.exr -o out.exr",
        "compare --statistical deep.exr deep.exr",
        "reconstruct density transforms.json -o out.vdb",
    ] {
        refusal::refused(&mut work.command(words), Code::Unsupported, &["deep", "--flatten"]);
    }
    refusal::refused(&mut work.command("convert deep.exr out.exr"), Code::Unsupported, &["deep", "--flatten"]);
    refusal::refused(&mut work.command("convert flat.exr out.exr --flatten"), Code::Invalid, &["flat", "--flatten"]);
    refusal::refused(&mut work.command("convert deep.exr out.vdb --flatten"), Code::Unsupported, &["deep OpenEXR"]);
    refusal::refused(&mut work.command("compare deep.exr flat.exr --layer depth"), Code::NoSuchLayer, &["depth"]);
    refusal::refused(&mut work.command("render deep.exr --views 1 -o out.exr"), Code::Invalid, &["picture"]);
    assert!(!work.path("out.exr").exists());
}

/// A deep picture that is held out shows what is before and within another deep one, or before depths.
#[test]
fn deep_pictures_are_held_out() {
    let work = Work::new();
    write(&work.path("deep.exr"), pixel);
    // A veil of half the opacity before all, and a wall within the haze in the lower half.
    let prop = |_: usize, y: usize| {
        let veil = DeepSample { z: 1.0, z_back: 1.0, rgba: [0.5, 0.0, 0.0, 0.5] };
        let wall = DeepSample { z: 4.0, z_back: 4.0, rgba: [1.0, 1.0, 1.0, 1.0] };
        if y < 5 { vec![veil] } else { vec![wall, veil] }
    };
    write(&work.path("prop.exr"), prop);
    work.json("convert deep.exr held.exr --flatten --holdout prop.exr");
    let film = exr::read_film_within(&work.path("held.exr"), None, Default::default()).unwrap();
    for (i, found) in film.rgba.iter().enumerate() {
        let [x, y] = [i % SIZE[0], i / SIZE[0]];
        let tidy = TidyPixel::new(&pixel(x, y));
        let seen = if y < 5 { tidy.rgba() } else { tidy.rgba_before(4.0) };
        let expected = seen.map(|v| 0.5 * v);
        assert!((0..4).all(|c| (f64::from(found[c]) - expected[c]).abs() < 1e-6), "{x} {y}: {found:?} {expected:?}");
    }
    // Depths of opaque objects, as other renderers write them.
    let mut depths = cumulo::scene::film::Film::of(SIZE[0], SIZE[1], vec![[0.0; 4]; SIZE[0] * SIZE[1]]);
    let samples = (0..SIZE[0] * SIZE[1]).map(|i| if i / SIZE[0] < 5 { 1e10 } else { 4.0 }).collect();
    depths.planes.push(cumulo::scene::film::Plane { name: "Depth.Z".into(), samples });
    exr::write_picture(&work.path("depth.exr"), &depths, &Attributes::new(), exr::Half::None).unwrap();
    work.json("convert deep.exr walled.exr --flatten --holdout depth.exr");
    let walled = work.picture("walled.exr");
    for (walled, held) in walled.rgba.iter().zip(&film.rgba) {
        assert!((0..4).all(|c| (0.5 * walled[c] - held[c]).abs() < 1e-6), "{walled:?} {held:?}");
    }
    work.json("convert deep.exr walled.png --flatten --holdout depth.exr");
    // Of a sequence each frame has its own.
    for (number, prop) in [(1, "prop.exr"), (2, "depth.exr")] {
        std::fs::copy(work.path("deep.exr"), work.path(&format!("in.{number}.exr"))).unwrap();
        std::fs::copy(work.path(prop), work.path(&format!("prop.{number}.exr"))).unwrap();
    }
    work.json("convert in.#.exr out.#.exr --flatten --holdout prop.#.exr");
    assert_eq!(work.picture("out.1.exr").rgba, film.rgba);
    assert_eq!(work.picture("out.2.exr").rgba, walled.rgba);
    work.refused("convert deep.exr no.exr --holdout prop.exr", Code::Usage, &["--flatten"]);
    work.refused("convert deep.exr no.exr --flatten --holdout none.exr", Code::NotFound, &["none.exr"]);
    work.refused("convert deep.exr no.exr --flatten --holdout @exr/zip.exr", Code::Invalid, &["zip.exr"]);
    work.json("render @plume.vdb --views 1 --size 8x8 --deep 0.1 -o small.exr");
    work.refused("convert deep.exr no.exr --flatten --holdout small.exr", Code::Invalid, &["8x8", "24x10"]);
}

/// Deep pictures are joined: parts to the whole, elements to what all their samples show.
#[test]
fn deep_pictures_are_joined() {
    let work = Work::new();
    let words = "render @plume.vdb --views 1 --size 24x20 --density-scale 8 --deep 0.02";
    work.json(&format!("{words} -o whole.exr"));
    for (name, part) in [("a.exr", "0,0,10,20"), ("b.exr", "10,0,24,12"), ("c.exr", "10,12,24,20")] {
        work.json(&format!("{words} --crop {part} -o {name}"));
    }
    let report = work.json("merge a.exr b.exr c.exr -o joined.exr");
    let [whole, joined] = ["whole.exr", "joined.exr"].map(|name| deep::read(&work.path(name)).unwrap());
    assert_eq!((whole.lines, whole.data_window), (joined.lines, joined.data_window));
    assert_eq!(joined.attributes["cumulo:camera"], whole.attributes["cumulo:camera"]);
    assert!(report["samples"].as_u64().unwrap() > 100 && report["replicates"].is_null(), "{report}");
    // Elements.
    write(&work.path("one.exr"), pixel);
    let ball = DeepSample { z: 4.0, z_back: 4.5, rgba: [0.5, 0.5, 0.5, 0.75] };
    write(&work.path("two.exr"), |x, _| if x < 12 { vec![ball] } else { vec![] });
    work.json("merge two.exr one.exr -o both.exr");
    let both = deep::read(&work.path("both.exr")).unwrap();
    for (x, y) in (0..SIZE[0]).flat_map(|x| (0..SIZE[1]).map(move |y| (x, y))) {
        let mut expected = pixel(x, y);
        expected.extend((x < 12).then_some(ball));
        assert_eq!(TidyPixel::new(both.samples(x, y)).rgba(), TidyPixel::new(&expected).rgba(), "{x} {y}");
        assert!(both.samples(x, y).is_sorted_by(|a, b| a.z <= b.z));
    }
    work.refused("merge whole.exr one.exr -o no.exr", Code::Invalid, &["one.exr", "display window", "whole.exr"]);
    std::fs::copy(fixture("exr/zip.exr"), work.path("flat.exr")).unwrap();
    work.refused("merge one.exr flat.exr -o no.exr", Code::Unsupported, &["flat.exr", "no deep picture"]);
    work.refused("merge one.exr two.exr --target-error 0.1 -o no.exr", Code::Invalid, &["--target-error"]);
}
