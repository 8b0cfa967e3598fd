//! `cumulo compare --statistical` from the outside: sources of the noise, exit codes, reports, wrong use.

use crate::common::refusal;
use crate::common::work::cumulo;
use cumulo::error::Code;
use cumulo::formats::exr;
use cumulo::scene::film::{Film, Plane};
use serde_json::Value;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

const SIZE: [usize; 2] = [40, 24];

/// Numbers from -√3 to √3, of mean 0 and variance 1, from a hash.
fn noise(seed: u64, index: u64) -> f64 {
    let mut x = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ index.wrapping_mul(0xbf58_476d_1ce4_e5b9);
    for _ in 0..3 {
        x = (x ^ (x >> 29)).wrapping_mul(0x94d0_49bb_1331_11eb);
    }
    ((x >> 11) as f64 / (1_u64 << 53) as f64 - 0.5) * 12_f64.sqrt()
}

/// Means of `count` samples a pixel with their variances and halves as planes.
fn film(seed: u64, count: u64, brighter: f64) -> Film {
    let mut film = Film::new(SIZE[0], SIZE[1]);
    let (mut variance, mut halves) = (vec![[0.0; 3]; film.rgba.len()], vec![[[0.0; 3]; 2]; film.rgba.len()]);
    for pixel in 0..film.rgba.len() {
        for c in 0..3 {
            let sample = |k: u64| 0.5 + brighter + 0.2 * noise(seed, (pixel as u64 * 3 + c as u64) * count + k);
            let samples: Vec<f64> = (0..count).map(sample).collect();
            let mean = samples.iter().sum::<f64>() / count as f64;
            let squares: f64 = samples.iter().map(|v| (v - mean).powi(2)).sum();
            film.rgba[pixel][c] = mean as f32;
            variance[pixel][c] = (squares / (count * (count - 1)) as f64) as f32;
            for half in 0..2 {
                let own = samples.iter().skip(half).step_by(2);
                halves[pixel][half][c] = (own.sum::<f64>() / (count / 2) as f64) as f32;
            }
        }
        film.rgba[pixel][3] = 1.0;
    }
    let plane =
        |name: String, of: &dyn Fn(usize) -> f32| Plane { name, samples: (0..variance.len()).map(of).collect() };
    let mut planes = vec![plane("Debug Sample Count.X".into(), &|_| count as f32)];
    for (c, channel) in ["R", "G", "B"].into_iter().enumerate() {
        planes.push(plane(format!("variance.{channel}"), &|p| variance[p][c]));
        planes.push(plane(format!("half_a.{channel}"), &|p| halves[p][0][c]));
        planes.push(plane(format!("half_b.{channel}"), &|p| halves[p][1][c]));
    }
    film.planes = planes;
    film
}

fn write(dir: &TempDir, name: &str, film: &Film) -> PathBuf {
    let path = dir.path().join(name);
    exr::write_picture(&path, film, &Default::default(), exr::Half::None).unwrap();
    path
}

/// The film with those planes only whose names begin so.
fn with(mut film: Film, layers: &[&str]) -> Film {
    film.planes.retain(|plane| layers.iter().any(|layer| plane.name.starts_with(layer)));
    film
}

fn report(code: i32, arguments: &[&Path]) -> Value {
    let run = cumulo().args(["compare", "--statistical", "--json", "--quiet"]).args(arguments).assert().code(code);
    serde_json::from_slice(&run.get_output().stdout).unwrap()
}

#[test]
fn the_noise_comes_from_variances_halves_or_repeated_renders() {
    let dir = tempfile::tempdir().unwrap();
    let (a, b, c) = (film(1, 16, 0.0), film(2, 16, 0.0), film(3, 16, 0.02));
    for (source, layers, freedom) in [
        ("variance", vec!["variance", "Debug"], 15.0),
        ("halves", vec!["half_"], 1.0),
        ("variance", vec!["variance"], f64::NAN),
    ] {
        let [a, b, c] = [("a", &a), ("b", &b), ("c", &c)].map(|(n, f)| write(&dir, n, &with(f.clone(), &layers)));
        let same = report(0, &[&a, &b]);
        assert_eq!(same["noise"]["a"]["source"], source);
        assert_eq!(same["noise"]["b"]["freedom"].as_f64(), Some(freedom).filter(|f| f.is_finite()));
        assert_eq!(same["noise"]["a"]["remark"].is_string(), freedom.is_nan());
        assert_eq!(same["channels"].as_array().unwrap().len(), 3, "the variance of alpha is unknown");
        // 0.02 is a tenth of a sample's deviation; 2880 numbers of 16 samples on either side tell it.
        let differs = report(1, &[&a, &c]);
        assert!(differs["differ"] == true && differs["p"].as_f64().unwrap() < 1e-6);
        let mean = &differs["channels"][1]["mean"];
        let [low, high] = [0, 1].map(|i| mean["interval"][i].as_f64().unwrap());
        assert!(low < -0.02 && -0.02 < high && high - low < 0.02, "{mean}");
    }
    let names = ["a1", "a2", "a3", "b1", "b2"].map(PathBuf::from);
    let seeds: Vec<PathBuf> =
        (0..5).map(|i| write(&dir, names[i].to_str().unwrap(), &with(film(20 + i as u64, 16, 0.0), &[]))).collect();
    let more = |side: &str, path: &Path| PathBuf::from(format!("--repeat-{side}={}", path.display()));
    let repeats = [more("a", &seeds[1]), more("a", &seeds[2]), more("b", &seeds[4])];
    let same = report(0, &[&seeds[0], &seeds[3], &repeats[0], &repeats[1], &repeats[2]]);
    let noise = &same["noise"];
    assert_eq!(
        (&noise["a"]["pictures"], &noise["a"]["freedom"], &noise["b"]["freedom"]),
        (&3.into(), &2.0.into(), &1.0.into())
    );
    assert_eq!(same["channels"].as_array().unwrap().len(), 4);
    let bright = write(&dir, "bright", &with(film(9, 16, 0.02), &[]));
    report(1, &[&bright, &seeds[3], &more("a", &write(&dir, "bright2", &with(film(10, 16, 0.02), &[]))), &repeats[2]]);
    // A side without noise, and renders by one seed.
    let truth = write(&dir, "truth", &Film::of(SIZE[0], SIZE[1], vec![[0.5, 0.5, 0.5, 1.0]; SIZE[0] * SIZE[1]]));
    let found = report(0, &[&seeds[0], &truth, &repeats[0], Path::new("--noiseless=b")]);
    assert_eq!(found["noise"]["b"]["source"], "none");
    let twice = report(1, &[&seeds[0], &truth, &more("a", &seeds[0]), Path::new("--noiseless=b")]);
    assert!(twice["noise"]["a"]["remark"].as_str().unwrap().contains("identical"));
}

#[test]
fn people_read_the_same_and_the_heat_map_is_written() {
    let dir = tempfile::tempdir().unwrap();
    let [a, b] = [write(&dir, "a.exr", &film(1, 16, 0.0)), write(&dir, "b.exr", &film(2, 16, 0.03))];
    let png = dir.path().join("heat.png");
    let run = cumulo().args(["compare", "--statistical", "--heatmap"]).args([&png, &a, &b]).assert().code(1);
    let text = String::from_utf8(run.get_output().stdout.clone()).unwrap();
    for words in [
        "40 x 24",
        "15 degrees of freedom",
        "95 % confidence",
        "worst at",
        "spread",
        "heatmap",
        "the expected values differ",
    ] {
        assert!(text.contains(words), "'{words}' is not in: {text}");
    }
    assert!(png.metadata().unwrap().len() > 100);
    let forgiving = cumulo().args(["compare", "--statistical", "--tolerance=0.04"]).args([&a, &b]).assert().code(0);
    assert!(String::from_utf8_lossy(&forgiving.get_output().stdout).contains("no difference of expected values"));
}

#[test]
fn wrong_use_gives_2_and_says_why() {
    let dir = tempfile::tempdir().unwrap();
    let full = write(&dir, "full.exr", &film(1, 4, 0.0));
    let bare = write(&dir, "bare.exr", &with(film(1, 4, 0.0), &[]));
    let small = write(&dir, "small.exr", &Film::new(3, 2));
    let mut one = film(1, 4, 0.0);
    one.planes.iter_mut().filter(|p| p.name.starts_with("variance")).for_each(|p| p.samples.fill(f32::INFINITY));
    let one = write(&dir, "one.exr", &one);
    let mut negative = film(1, 4, 0.0);
    negative.planes.iter_mut().filter(|p| p.name.starts_with("variance")).for_each(|p| p.samples[5] = -1.0);
    let negative = write(&dir, "negative.exr", &negative);
    let fails = |arguments: &[&str], code, facts| {
        refusal::of(&[&["compare", "--statistical", "--quiet"], arguments].concat(), code, facts);
    };
    let [full, bare, small, one, negative] = [&full, &bare, &small, &one, &negative].map(|p| p.to_str().unwrap());
    fails(&[full, bare], Code::Invalid, &["bare.exr", "noise", "--repeat-b", "--noiseless b", "--aov variance"]);
    fails(&[full, small, "--noiseless=b"], Code::Invalid, &["40x24", "3x2"]);
    fails(&[full, full, &format!("--repeat-a={small}")], Code::Invalid, &["small.exr", "40x24", "3x2", "seed"]);
    fails(&[full, one], Code::Invalid, &["one.exr", "variance", "--repeat-b"]);
    fails(&[full, negative], Code::Invalid, &["negative.exr", "variance of -1", "--variance-layer"]);
    fails(&[full, full, "--variance-layer=half_c"], Code::NoSuchLayer, &["half_c", "half_a"]);
    fails(&[full, full, "--noiseless=a", &format!("--repeat-a={bare}")], Code::Invalid, &["contradict"]);
    fails(&[full, full, "--false-alarm=0"], Code::Invalid, &["--false-alarm"]);
    fails(&[full, full, "--tile=0"], Code::Usage, &["--tile"]);
    fails(&[full, full, "--flip"], Code::Usage, &["--flip"]);
    fails(&["a.####.exr", "b.####.exr"], Code::Invalid, &["sequence"]);
    let hidden = dir.path().join("hidden.png");
    std::fs::hard_link(full, &hidden).unwrap();
    fails(&[full, full, "--heatmap", hidden.to_str().unwrap()], Code::OutputIsInput, &["hidden.png"]);
    fails(&[full, full, "--max-memory=112M", "--heatmap=a.txt"], Code::OutputName, &["PNG"]);
    let run = cumulo().args(["compare", full, full, "--tile=4"]).assert().code(2);
    assert!(String::from_utf8_lossy(&run.get_output().stderr).contains("--statistical"));
}
