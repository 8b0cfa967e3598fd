//! `cumulo compare` from the outside: figures, exit codes, streams, wrong use.

#![allow(clippy::unwrap_used, reason = "a panic is how a test fails")]

use assert_cmd::Command;
use cumulo::formats::exr;
use cumulo::scene::film::Film;
use predicates::prelude::*;
use serde_json::Value;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

fn cumulo() -> Command {
    Command::cargo_bin("cumulo").unwrap()
}

fn write(dir: &TempDir, name: &str, width: usize, height: usize, offset: f32) -> PathBuf {
    let path = dir.path().join(name);
    let rgba = (0..width * height).map(|i| [i as f32 / 512.0 + offset, 0.5, 0.25, 1.0]).collect();
    exr::write_picture(&path, &Film::of(width, height, rgba), &Default::default(), false).unwrap();
    path
}

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/exr").join(name)
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
    let blender = fixture("blender.exr");
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
    cumulo().arg("compare").args([&fixture("multipart.exr"), &blender]).assert().code(0);
}

#[test]
fn wrong_use_gives_2_and_says_why() {
    let dir = tempfile::tempdir().unwrap();
    let (a, b) = (write(&dir, "a.exr", 20, 15, 0.0), write(&dir, "b.exr", 15, 20, 0.0));
    let text = dir.path().join("text.exr");
    std::fs::write(&text, "no picture").unwrap();
    let missing = dir.path().join("missing.exr");
    let fails = |args: &[&Path], words: &[&str]| {
        let output = cumulo().arg("compare").args(args).assert().code(2).stdout("").get_output().clone();
        let stderr = String::from_utf8(output.stderr).unwrap();
        for word in words {
            assert!(stderr.contains(word), "'{word}' is not in: {stderr}");
        }
    };
    fails(&[&a, &b], &["20x15", "15x20", "a.exr", "b.exr"]);
    fails(&[&a, &text], &["text.exr", "OpenEXR"]);
    fails(&[&a, &missing], &["missing.exr"]);
    fails(&[&a], &["Usage"]);
    fails(&[&a, &a, Path::new("--tolerance=-1")], &["--tolerance -1"]);
    fails(&[&a, &a, Path::new("--tolerance=nan")], &["--tolerance"]);
    fails(&[&a, &a, Path::new("--nonsense")], &["--nonsense"]);
}
