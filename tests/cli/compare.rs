//! `cumulo compare` from the outside: figures, exit codes, streams, wrong use.

use crate::common::refusal;
use crate::common::work::{Work, cumulo, errors, fixture, write_exr};
use ::exr::meta::attribute::{Chromaticities, IntegerBounds};
use ::exr::prelude::Vec2;
use cumulo::error::Code;
use cumulo::formats::exr;
use cumulo::scene::film::Film;
use predicates::prelude::*;
use serde_json::Value;
use std::path::PathBuf;
use tempfile::TempDir;

fn write(dir: &TempDir, name: &str, width: usize, height: usize, offset: f32) -> PathBuf {
    let path = dir.path().join(name);
    let rgba = (0..width * height).map(|i| [i as f32 / 512.0 + offset, 0.5, 0.25, 1.0]).collect();
    exr::write_picture(&path, &Film::of(width, height, rgba), &Default::default(), exr::Half::None).unwrap();
    path
}

#[test]
fn identical_pictures_agree() {
    let dir = tempfile::tempdir().unwrap();
    let a = write(&dir, "a.exr", 20, 15, 0.0);
    let out = cumulo().arg("compare").args([&a, &a]).arg("--json").assert().code(0).stderr("").get_output().clone();
    let json: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert!(json["psnr_db"].is_null(), "infinite");
    assert_eq!((&json["ssim"], &json["rel_mse"], &json["max_abs"]), (&1.0.into(), &0.0.into(), &0.0.into()));
    assert_eq!(json["size"], serde_json::json!([20, 15]));
    cumulo().arg("compare").args([&a, &a]).assert().code(0).stdout(predicate::str::contains("psnr_db   inf"));
}

#[test]
fn different_pictures_give_1_and_a_tolerance_forgives() {
    let dir = tempfile::tempdir().unwrap();
    let (a, b) = (write(&dir, "a.exr", 20, 15, 0.0625), write(&dir, "b.exr", 20, 15, 0.0));
    let out = cumulo().arg("compare").args([&a, &b]).arg("--json").assert().code(1).get_output().clone();
    let json: Value = serde_json::from_slice(&out.stdout).unwrap();
    // One channel of three differs by 1/16: mse = 1/768, and all of it is exact in f32 and f64.
    let psnr = 10.0 * 768_f64.log10();
    assert!((json["psnr_db"].as_f64().unwrap() - psnr).abs() < 1e-9);
    assert_eq!(json["max_abs"], 0.0625);
    assert!(json["ssim"].as_f64().unwrap() < 1.0 && json["rel_mse"].as_f64().unwrap() > 0.0);
    cumulo().arg("compare").args([&a, &b]).args(["--tolerance", "0.0625"]).assert().code(0);
    cumulo().arg("compare").args([&a, &b]).args(["--tolerance", "0.0624"]).assert().code(1);
}

#[test]
fn the_heat_map_is_a_png_of_the_same_size() {
    let dir = tempfile::tempdir().unwrap();
    let (a, b) = (write(&dir, "a.exr", 20, 15, 0.0625), write(&dir, "b.exr", 20, 15, 0.0));
    let png = dir.path().join("heat.png");
    cumulo()
        .arg("compare")
        .args([&a, &b])
        .arg("--heatmap")
        .arg(&png)
        .assert()
        .code(1)
        .stdout(predicate::str::contains("brightest at 6.25"));
    let reader = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(&png).unwrap())).read_info().unwrap();
    assert_eq!((reader.info().width, reader.info().height), (20, 15));
    cumulo().arg("compare").args([&a, &b]).arg("--heatmap").arg(dir.path().join("no/such.png")).assert().code(2);
}

#[test]
fn layers_are_chosen_by_name() {
    let blender = fixture("exr/blender.exr");
    cumulo().arg("compare").args([&blender, &blender]).args(["--layer", "Depth"]).assert().code(0);
    cumulo()
        .arg("compare")
        .args([&blender, &blender])
        .args(["--layer", "Mist"])
        .assert()
        .code(2)
        .stdout("")
        .stderr(predicate::str::contains("ViewLayer.Depth").and(predicate::str::contains("'Mist'")));
    // The same numbers in two layouts.
    cumulo().arg("compare").args([&fixture("exr/multipart.exr"), &blender]).assert().code(0);
}

#[test]
fn wrong_use_gives_2_and_says_why() {
    let dir = tempfile::tempdir().unwrap();
    let (a, b) = (write(&dir, "a.exr", 20, 15, 0.0), write(&dir, "b.exr", 15, 20, 0.0));
    let text = dir.path().join("text.exr");
    std::fs::write(&text, "no picture").unwrap();
    let missing = dir.path().join("missing.exr");
    let [a, b, text, missing] = [&a, &b, &text, &missing].map(|path| path.to_str().unwrap());
    let fails = |pictures: &[&str], code, facts| refusal::of(&[&["compare"], pictures].concat(), code, facts);
    fails(&[a, b], Code::Invalid, &["20x15", "15x20", "a.exr", "b.exr"]);
    fails(&[a, text], Code::Invalid, &["text.exr", "OpenEXR"]);
    fails(&[a, missing], Code::NotFound, &["missing.exr"]);
    fails(&[a], Code::Usage, &["<B>"]);
    fails(&[a, a, "--tolerance=-1"], Code::Invalid, &["--tolerance -1"]);
    fails(&[a, a, "--tolerance=nan"], Code::Invalid, &["--tolerance"]);
    fails(&[a, a, "--nonsense"], Code::Usage, &["--nonsense"]);
}

/// The same numbers in other headers were called equal.
#[test]
fn headers_count_and_primaries_are_converted() {
    let work = Work::new();
    let ramp = |scale: f32| (0..96).map(|i| scale * i as f32 / 96.0).collect::<Vec<f32>>();
    let numbers = [ramp(1.0), ramp(0.5), vec![0.25; 96]];
    // Academy primaries, and the same colors in them: ACES of Rec.709 by the matrix of the Academy, in seven digits.
    let aces = Chromaticities {
        red: Vec2(0.7347, 0.2653),
        green: Vec2(0.0, 1.0),
        blue: Vec2(0.0001, -0.077),
        white: Vec2(0.32168, 0.33767),
    };
    let rows = [[0.439633, 0.382989, 0.177378], [0.0897764, 0.813439, 0.0967847], [0.0175412, 0.111547, 0.870912]];
    let in_aces =
        rows.map(|row: [f32; 3]| (0..96).map(|i| (0..3).map(|c| row[c] * numbers[c][i]).sum()).collect::<Vec<f32>>());
    let named = |planes: &[Vec<f32>; 3]| [("R", planes[0].clone()), ("G", planes[1].clone()), ("B", planes[2].clone())];
    let write = |name: &str, planes: &[Vec<f32>; 3], edit: &dyn Fn(&mut ::exr::prelude::ImageAttributes)| {
        write_exr(&work.path(name), [12, 8], &named(planes), |shared, _| edit(shared));
    };
    write("plain.exr", &numbers, &|_| {});
    write("wide.exr", &numbers, &|shared| shared.pixel_aspect = 2.0);
    write("moved.exr", &numbers, &|shared| shared.display_window = IntegerBounds::new((-3, -2), (12, 8)));
    write("relabelled.exr", &numbers, &|shared| shared.chromaticities = Some(aces));
    write("aces.exr", &in_aces, &|shared| shared.chromaticities = Some(aces));
    write("flat.exr", &numbers, &|shared| shared.chromaticities = Some(Chromaticities { green: aces.red, ..aces }));
    let compare = |words: &str| {
        let out = work.command(&format!("compare {words} --json")).output().unwrap();
        assert!(!out.stdout.is_empty(), "{words}: {}", errors(&out));
        (out.status.code(), serde_json::from_slice::<Value>(&out.stdout).unwrap())
    };
    for (name, difference) in [
        ("wide.exr", "pixel aspect 2 and 1"),
        ("moved.exr", "display window 12x8 at (-3, -2) and 12x8 at (0, 0)"),
        ("flat.exr", "primaries that cannot be converted"),
    ] {
        let (code, report) = compare(&format!("{name} plain.exr"));
        let told = report["differences"].as_array().unwrap().last().unwrap().as_str().unwrap().to_owned();
        assert!(code == Some(1) && told.contains(difference), "{report}");
        let text = work.command(&format!("compare {name} plain.exr")).output().unwrap();
        let text = String::from_utf8(text.stdout).unwrap();
        assert!(
            text.lines().last().unwrap().starts_with("the pictures differ: ") && text.contains(difference),
            "{text}"
        );
    }
    let (code, report) = compare("relabelled.exr plain.exr");
    assert!(code == Some(1) && report["converted"].as_str().unwrap().ends_with("--tolerance"), "{report}");
    assert!(report["max_abs"].as_f64().unwrap() > 0.1, "{report}");
    // The matrix has six digits, of numbers up to 1.
    let (code, report) = compare("aces.exr plain.exr --tolerance 1e-5");
    assert!(code == Some(0) && report["converted"].as_str().unwrap().contains("to Rec.709"), "{report}");
    let (code, report) = compare("plain.exr aces.exr --tolerance 1e-5");
    assert!(code == Some(0) && report["converted"].as_str().unwrap().contains("from primaries Rec.709"), "{report}");
    // Sequences tell it, too; a test of noise refuses it.
    for frame in 1..=2 {
        std::fs::copy(work.path("wide.exr"), work.path(&format!("a.{frame}.exr"))).unwrap();
        std::fs::copy(work.path("plain.exr"), work.path(&format!("b.{frame}.exr"))).unwrap();
    }
    let (code, report) = compare("a.#.exr b.#.exr");
    assert_eq!((code, &report["differences"][0]), (Some(1), &"frames 1-2: pixel aspect 2 and 1".into()));
    work.refused(
        "compare wide.exr plain.exr --statistical --noiseless a --noiseless b",
        Code::Invalid,
        &["headers", "pixel aspect 2 and 1"],
    );
}
