//! Pictures of a wanted error, or as good as they become in a given time.

use crate::common::work::{Work, errors};
use cumulo::error::Code;
use cumulo::formats::exr;
use cumulo::formats::limits::Limits;
use cumulo::scene::film::Film;
use serde_json::Value;
use std::time::Instant;

const LIT: &str = "--views 1 --size 40x32 --density-scale 4 --albedo 0.9 --sun 1,1,2 --sun-color 3 --sky 0.2,0.3,0.5";

/// Returns a picture with all of its planes.
fn planes(work: &Work, name: &str) -> Film {
    exr::read_film_within(&work.path(name), None, Limits::default()).unwrap()
}

fn error(report: &Value) -> &Value {
    &report["accuracy"]["pictures"][0]
}

/// A picture reaches the error that it is to have, by more paths where there is more noise, with the same bits for any
/// number of threads; what was reached is in the report, in attributes and in planes.
#[test]
fn pictures_reach_a_wanted_error() {
    let work = Work::new();
    let report = work.json(&format!("render @plume.vdb {LIT} --target-error 0.02 -o one.exr"));
    let found = error(&report);
    let number = |key: &str| found[key].as_f64().unwrap();
    assert!(number("error") > 0.004 && number("error") <= 0.02 && number("blocks") == 20.0, "{found}");
    assert!(number("certified") >= 18.0 && number("replicates") == 16.0, "{found}");
    let paths = &found["paths"];
    assert!(paths[0].as_f64() < paths[1].as_f64() && paths[1].as_f64() < paths[2].as_f64(), "{found}");
    let film = planes(&work, "one.exr");
    let plane = |name: &str| film.plane(name).unwrap().to_vec();
    let [certified, errors, samples] = ["error.certified", "error.V", "Debug Sample Count.X"].map(plane);
    assert!(certified.iter().zip(&errors).all(|(certified, error)| *certified == 0.0 || *error <= 0.02));
    assert_eq!(certified.iter().filter(|v| **v == 1.0).count() / 64, number("certified") as usize);
    let mean = samples.iter().map(|v| f64::from(*v)).sum::<f64>() / samples.len() as f64;
    assert!((mean - paths[1].as_f64().unwrap()).abs() < 1e-6 * mean, "{mean} {found}");
    let header = work.json("info one.exr").to_string();
    assert!(header.contains("cumulo:certified") && header.contains("cumulo:confidence"), "{header}");

    work.json(&format!("render @plume.vdb {LIT} --target-error 0.02 --threads 1 -o two.exr"));
    assert_eq!(film, planes(&work, "two.exr"));
    work.json(&format!("render @plume.vdb {LIT} --target-error 0.02 --seed 1 -o three.exr"));
    assert_ne!(film.rgba, planes(&work, "three.exr").rgba);
    // A part of the picture has the same random numbers, though not as many of them everywhere.
    let part = work.json(&format!("render @plume.vdb {LIT} --target-error 0.02 --crop 8,8,16x16 -o part.exr"));
    assert_eq!(error(&part)["blocks"], 4);
}

/// The truth of many paths is within the stated error.
#[test]
fn the_stated_error_is_that_of_the_picture() {
    let work = Work::new();
    work.json(&format!("render @plume.vdb {LIT} --samples 4096 --seed 7 -o true.exr"));
    let report =
        work.json(&format!("render @plume.vdb {LIT} --target-error 0.02 --aov variance,direct,halves -o made.exr"));
    let (truth, made) = (planes(&work, "true.exr"), planes(&work, "made.exr"));
    let (mut within, mut blocks) = (0, 0);
    let scale = error(&report)["scale"].as_f64().unwrap();
    for (x, y) in (0..4).flat_map(|y| (0..5).map(move |x| (8 * x, 8 * y))) {
        let at = || (0..64).map(|i| (y + i / 8) * 40 + x + i % 8);
        let mean = |film: &Film, c: usize| at().map(|i| f64::from(film.rgba[i][c])).sum::<f64>() / 64.0;
        let off = (0..3).map(|c| (mean(&truth, c) - mean(&made, c)).abs()).fold(0.0, f64::max);
        within += usize::from(off <= 0.02 * scale);
        blocks += 1;
    }
    assert!(within >= blocks - 1, "{within} of {blocks}");
    assert!(made.plane("variance.R").unwrap().iter().any(|v| *v > 0.0));
    // Halves are means of half of the replicates each, and their mean is the picture.
    let [a, b] = ["half_a.R", "half_b.R"].map(|name| made.plane(name).unwrap());
    let off = (0..a.len()).map(|i| (0.5 * (a[i] + b[i]) - made.rgba[i][0]).abs()).fold(0.0, f32::max);
    assert!(off < 0.05, "{off}");
}

/// A picture takes the time that it has, and says what it reached; frames share it.
#[test]
fn pictures_keep_to_a_time() {
    let work = Work::new();
    let begun = Instant::now();
    let report = work.json(&format!("render @plume.vdb {LIT} --time 2s -o one.exr"));
    let seconds = begun.elapsed().as_secs_f64();
    assert!((1.0..4.0).contains(&seconds), "{seconds}");
    let found = error(&report);
    assert!(found["error"].as_f64().unwrap() < 0.02 && found["replicates"].as_u64().unwrap() >= 8, "{found}");
    let begun = Instant::now();
    let report = work.json(&format!("render @plume.vdb {LIT} --frames 1-3 --time 3 -o shot"));
    let seconds = begun.elapsed().as_secs_f64();
    assert!((1.5..6.0).contains(&seconds), "{seconds}");
    assert_eq!(report["accuracy"]["pictures"].as_array().unwrap().len(), 3);
    // A time that is over leaves a picture of a path a pixel, of which no error is stated.
    let report = work.json(&format!("render @plume.vdb {LIT} --time 0.001 -o short.exr"));
    let found = error(&report);
    assert_eq!(
        (&found["certified"], &found["doubtful"][0]["reason"]),
        (&0.into(), &"few-replicates".into()),
        "{found}"
    );
    assert_eq!((&found["error"], &found["paths"][0]), (&Value::Null, &1.0.into()), "{found}");
    let film = planes(&work, "short.exr");
    assert!(film.plane("error.V").unwrap().iter().all(|v| *v == f32::INFINITY));
    assert!(film.rgba.iter().all(|[r, ..]| *r > 0.0));
}

/// Along straight rays the stated error bounds that of every pixel, and is not larger than the wanted one.
#[test]
fn straight_rays_keep_to_a_wanted_error() {
    let work = Work::new();
    for (number, (scene, loose)) in [
        ("--density-scale 30", "exact"),
        ("--density-scale 30 --model emission-absorption --emission 3,1,0.2", "exact"),
        ("--tf ct-bone --tf-range 0,1 --density-scale 20", "preintegrated"),
    ]
    .into_iter()
    .enumerate()
    {
        let words = format!("render @plume.vdb --views 2 --size 40x32 {scene}");
        work.json(&format!("{words} --quadrature exact --early-stop 0 -o true-{number}"));
        for wanted in [0.1, 0.003] {
            let report = work.json(&format!("{words} --target-error {wanted} -o {wanted}-{number}"));
            let stated = report["relative_error_bound"].as_f64().unwrap();
            assert!(stated > 0.3 * wanted && stated <= wanted, "{scene}: {stated} of {wanted}");
            assert!(report["quadrature"].as_str().unwrap().starts_with(loose), "{report}");
            for view in ["view_000.exr", "view_001.exr"] {
                let [truth, made] =
                    ["true".to_owned(), wanted.to_string()].map(|at| planes(&work, &format!("{at}-{number}/{view}")));
                let attributes = exr::header(&work.path(&format!("{wanted}-{number}/{view}"))).unwrap().attributes();
                let number = |key: &str| attributes[key].parse::<f64>().unwrap();
                let pairs = truth.rgba.iter().flatten().zip(made.rgba.iter().flatten());
                let off = f64::from(pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max));
                assert!(off <= number("cumulo:error_bound") + 1e-6, "{scene}: {off}");
                assert!(number("cumulo:error") <= stated && stated <= wanted, "{attributes:?}");
            }
        }
    }
    let black = work.json("render @plume.vdb --views 1 --size 8x8 --background 0 --target-error 0.1 -o black.exr");
    assert_eq!(black["relative_error_bound"], 0.0);
    for words in ["--quadrature exact", "--early-stop 0.1", "--time 3", "--replicates 0-7"] {
        let words = format!("render @plume.vdb --views 1 --size 8x8 {words}");
        let target = if words.contains("--time") || words.contains("--rep") { "" } else { "--target-error 0.1" };
        work.refused(&format!("{words} {target} -o x.exr"), Code::Invalid, &[]);
    }
}

#[test]
fn what_contradicts_is_refused() {
    let work = Work::new();
    for words in [
        "--albedo 0.9 --target-error 0",
        "--albedo 0.9 --target-error -1",
        "--albedo 0.9 --target-error 0.1 --samples 4",
        "--albedo 0.9 --time 3 --samples 4",
        "--albedo 0.9 --time 3 --target-error 0.1",
        "--albedo 0.9 --time soon",
        "--albedo 0.9 --time 0s",
        "--albedo 0.9 --target-error 0.1 --confidence 1",
        "--albedo 0.9 --target-error 0.1 --confidence 95",
    ] {
        work.refused(&format!("render @plume.vdb --views 1 --size 8x8 {words} -o x.exr"), Code::Usage, &[]);
    }
    work.refused(
        "render @plume.vdb --views 1 --size 8x8 --time 3 -o x.exr",
        Code::Invalid,
        &["--time", "nothing is scattered"],
    );
    work.refused(
        "render @plume.vdb --views 1 --size 8x8 --albedo 0.9 --samples 4 --confidence 0.9 -o x.exr",
        Code::Invalid,
        &["--confidence", "no error is stated"],
    );
    assert!(!work.path("x.exr").exists());
}

/// Frames of other settings that lie in the folder change nothing of those that are rendered and denoised in it.
#[test]
fn nothing_is_learned_from_frames_of_other_settings() {
    let work = Work::new();
    let render = "render @plume.vdb --size 32x24 --density-scale 4 --albedo 0.9 --sun 1,1,2 --samples 2 --denoise";
    let series = |color: u32, frames: &str, to: &str| {
        let words = format!("{render} --views 1 --sun-color {color} --frames {frames} --overwrite -o {to}");
        let out = work.command(&words).output().unwrap();
        assert!(out.status.success(), "{words}: {}", errors(&out));
        errors(&out)
    };
    series(3, "1-4", "both");
    let told = series(9, "1-2", "both");
    assert!(told.contains("frames 3-4 were made by other settings"), "{told}");
    let told = series(9, "1-2", "alone");
    assert!(!told.contains("other settings"), "{told}");
    let frame = |folder: &str, frame: u32| planes(&work, &format!("{folder}/frame.{frame:04}.exr")).rgba;
    for number in [1, 2] {
        assert!(frame("both", number) == frame("alone", number), "{number}");
    }
    // Those of the same settings, which another run has rendered, are learned from.
    assert!(!series(9, "3-4", "alone").contains("other settings"));
}

/// Frames that are rendered and denoised in one go are within the error that was wanted after denoising, of which the
/// report's figure is true; the noisy frames stay, and frames that are there are not made again.
#[test]
fn frames_are_rendered_to_a_wanted_error_after_denoising() {
    let work = Work::new();
    let lit = "--size 64x48 --density-scale 4 --albedo 0.9 --sun 1,1,2 --sun-color 3 --sky 0.2,0.3,0.5";
    work.json("render @plume.vdb --views 120 --layout ring --size 64x48 --density-scale 4 -o path");
    let made = format!("render @plume.vdb {lit} --cameras path --frames 3-14 --denoise --target-error 0.02 -o made");
    let report = work.json(&made);
    let goal = &report["goal"];
    let number = |value: &Value| value.as_f64().unwrap();
    let [samples, error] = ["samples", "error"].map(|key| number(&goal[key]));
    assert!(goal["reached"] == true && error <= 0.02 && (2.0..=64.0).contains(&samples), "{goal}");
    assert_eq!(goal["pilots"].as_array().unwrap().len(), 2);
    work.json(&format!("render @plume.vdb {lit} --cameras path --frames 3-14 --samples 1024 --seed 7 -o true"));
    let (mut sum, mut count) = (0.0, 0.0);
    for frame in 3..15 {
        let name = format!("frame.{frame:04}.exr");
        let [found, truth] = ["made", "true"].map(|folder| planes(&work, &format!("{folder}/{name}")));
        assert!(work.path(&format!("made/noisy/{name}")).exists());
        for (a, b) in found.rgba.iter().zip(&truth.rgba) {
            sum += (0..3).map(|c| f64::from(a[c] - b[c]).powi(2)).sum::<f64>();
            count += 3.0;
        }
    }
    let wanted = f64::sqrt(sum / count);
    let [found, high] = ["error", "error_high"].map(|key| number(&report["denoised"]["estimate"][key]));
    println!("{samples} paths, error {error}, {found} where {wanted} is true");
    // Chance is as large in so few pixels; the noise of the reference is a thirtieth of the square.
    assert!((20.0 * (found / wanted).log10()).abs() < 2.5 && wanted < 1.03 * high, "{found} {wanted}");
    assert!(work.path("made/transforms.json").exists());
    let again = work.json(&format!("{made} --resume"));
    assert_eq!((&again["noisy_frames"]["skipped"], &again["denoised"]["skipped"]), (&12.into(), &12.into()));

    // Neither a capture nor a PNG of others is replaced, and both are by those who ask for it.
    let foreign = std::fs::read(work.path("path/transforms.json")).unwrap();
    let into = format!("render @plume.vdb {lit} --views 1 --frames 1-2 --samples 2 --denoise");
    work.refused(&format!("{into} -o path"), Code::OutputExists, &["path/transforms.json", "--overwrite"]);
    assert!(std::fs::read(work.path("path/transforms.json")).unwrap() == foreign && !work.path("path/noisy").exists());
    std::fs::create_dir(work.path("shown")).unwrap();
    std::fs::write(work.path("shown/frame.0002.png"), "mine").unwrap();
    work.refused(&format!("{into} --png -o shown"), Code::OutputExists, &["frame.0002.png", "--overwrite"]);
    assert_eq!(std::fs::read(work.path("shown/frame.0002.png")).unwrap(), b"mine");
    for _ in 0..2 {
        work.json(&format!("{into} --png --overwrite -o shown"));
        work.json(&format!("{into} --png -o shown"));
    }
    assert!(std::fs::read(work.path("shown/frame.0002.png")).unwrap().starts_with(b"\x89PNG"));

    let still = work.json(&format!("render @plume.vdb {lit} --views 1 --samples 16 --denoise --png -o still.exr"));
    assert_eq!(still["denoised"]["estimate"]["told_by"], "halves");
    assert!(["still.exr", "still.png", "still.noisy.exr"].iter().all(|name| work.path(name).exists()));
    for (words, code) in [
        ("--views 4 --denoise -o no", Code::Invalid),
        ("--views 1 --denoise -o no", Code::Invalid),
        ("--views 1 --denoise -o no.png", Code::Invalid),
        ("--views 1 --samples 1 --denoise -o no.exr", Code::Invalid),
    ] {
        work.refused(&format!("render @plume.vdb {lit} {words}"), code, &["denoise"]);
    }
}
