//! `cumulo study`: pages of error against time, what they recommend, and how studies are stopped and go on.

use crate::common::work::{Work, errors, number};
use cumulo::error::Code;
use serde_json::Value;
use std::path::Path;

/// A study of few settings of small pictures.
const SMALL: &str = "study render @plume.vdb --tf ct-bone --tf-range 0,1 --size 24x24 --repeats 2 \
                     --knobs quadrature,early-stop";

fn measurements(report: &Value) -> &[Value] {
    report["measurements"].as_array().unwrap()
}

/// Time and error of the settings that no other one beats, the fastest first. An error below the uncertainty counts as
/// that.
fn front(report: &Value) -> Vec<(f64, f64)> {
    let of = |m: &Value| (number(m, "seconds"), m["error"].as_f64().or(m["error_below"].as_f64()).unwrap());
    let mut front: Vec<_> = measurements(report).iter().filter(|m| m["on_front"] == true).map(of).collect();
    front.sort_by(|a, b| a.0.total_cmp(&b.0));
    front
}

/// Runs the command that is recommended, whose fixtures have whole paths. A shell takes quotes away.
fn runs(work: &Work, command: &str) {
    let words = command.replace('\'', "");
    let out = work.command(words.strip_prefix("cumulo ").unwrap()).output().unwrap();
    assert!(out.status.success(), "{command}: {}", errors(&out));
}

fn record(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

#[test]
fn a_study_of_pictures_makes_a_page_and_recommends_a_command() {
    let work = Work::new();
    let report = work.json(&format!("{SMALL} -o page"));
    for name in ["index.html", "study.csv", "study.json", "reference_000.exr"] {
        assert!(work.path("page").join(name).exists(), "{name}");
    }
    // Exact, three tolerances of pre-integration, midpoint and riemann, each with three transmittances.
    assert_eq!((measurements(&report).len(), &report["complete"]), (18, &Value::from(true)));
    let front = front(&report);
    assert!(!front.is_empty() && front.windows(2).all(|pair| pair[0].1 > pair[1].1), "{front:?}");
    for m in measurements(&report) {
        assert_eq!(m["runs"].as_array().unwrap().len(), 2, "{m}");
        assert!(m["error"].is_null() != m["error_below"].is_null(), "{m}");
        let beaten = front.iter().any(|(t, e)| *t <= number(m, "seconds") && *e <= m["error"].as_f64().unwrap_or(*e));
        assert!(beaten, "{m} is on no side of the front");
    }
    let uncertainty = number(&report["reference"], "uncertainty");
    assert!(uncertainty > 0.0 && uncertainty < 1e-4, "{uncertainty}");
    let error = |words: &str| {
        let of = measurements(&report).iter().find(|m| m["options"].as_str().unwrap().contains(words)).unwrap();
        of["error"].as_f64()
    };
    assert_eq!(error("exact"), None, "it is the reference's");
    assert!(error("preintegrated:0.1") > error("preintegrated:0.001") && error("preintegrated:0.001") > Some(0.0));
    let table = std::fs::read_to_string(work.path("page/study.csv")).unwrap();
    assert_eq!(table.lines().count(), 19);
    let html = std::fs::read_to_string(work.path("page/index.html")).unwrap();
    assert!(!html.contains("http://") && !html.contains("https://"), "the page is self-contained");
    assert!(html.contains("<svg") && html.contains("Recommended"));
    let command = report["recommended"]["command"].as_str().unwrap();
    assert!(command.contains("--quadrature") && command.contains("--size 24x24"), "{command}");
    runs(&work, command);
    assert!(work.path("picture.exr").exists());
}

#[test]
fn resuming_measures_only_what_is_missing() {
    let work = Work::new();
    work.json(&format!("{SMALL} -o page"));
    let path = work.path("page/study.json");
    let first = record(&path);
    let again = work.json(&format!("{SMALL} -o page --resume --wanted-error 0.5"));
    assert_eq!(measurements(&again), measurements(&first));
    assert_eq!(again["recommended"]["error_at_most"], 0.5);
    // A run that was stopped lacks some.
    let mut torn = first.clone();
    torn["complete"] = false.into();
    torn["measurements"][4]["runs"].as_array_mut().unwrap().pop();
    std::fs::write(&path, torn.to_string()).unwrap();
    let whole = work.json(&format!("{SMALL} -o page --resume"));
    for (at, (a, b)) in measurements(&first).iter().zip(measurements(&whole)).enumerate() {
        assert_eq!(b["runs"].as_array().unwrap().len(), 2);
        assert_eq!(a["runs"] == b["runs"], at != 4, "{at}: {a} {b}");
    }
    assert_eq!(whole["complete"], true);
}

#[test]
fn what_was_measured_is_written_when_a_study_is_stopped() {
    let work = Work::new();
    let words = "study render @plume.vdb --density-scale auto --size 100x100 --repeats 50 -o page";
    let mut child = work.reached(words, |event| event["event"] == "began" && event["name"] == "measuring");
    std::thread::sleep(std::time::Duration::from_millis(300));
    std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let report = record(&work.path("page/study.json"));
    assert_eq!(report["complete"], false);
    let html = std::fs::read_to_string(work.path("page/index.html")).unwrap();
    assert!(html.contains("incomplete"), "the page says so");
}

#[test]
fn errors_of_paths_are_means_over_seeds() {
    let work = Work::new();
    let report = work.json(
        "study render @plume.vdb --density-scale auto --albedo 0.9 --sun 1,1,2 --size 12x12 --repeats 3 \
         --knobs samples -o page",
    );
    let errors: Vec<f64> = measurements(&report).iter().map(|m| number(m, "error")).collect();
    assert_eq!(errors.len(), 5);
    assert!(errors.windows(2).all(|pair| pair[1] < 0.8 * pair[0]), "{errors:?}");
    for m in measurements(&report) {
        let runs = m["runs"].as_array().unwrap();
        assert!(runs[0]["rms"] != runs[1]["rms"], "each run has a seed of its own: {m}");
        let [low, high] = [0, 1].map(|at| m["error_interval"][at].as_f64().unwrap());
        assert!(low < number(m, "error") && number(m, "error") < high, "{m}");
    }
    assert_eq!(report["reference"]["random"], true);
    let text = work.text(
        "study render @plume.vdb --density-scale auto --albedo 0.9 --sun 1,1,2 --size 12x12 --repeats 3 \
         --knobs samples -o page --resume --wanted-seconds 100",
    );
    runs(&work, text.lines().last().unwrap().trim());
}

#[test]
fn what_no_study_can_do_is_refused() {
    let work = Work::new();
    work.refused(
        "study render @plume.vdb --knobs nonsense -o page",
        Code::Usage,
        &["quadrature", "early-stop", "clamp"],
    );
    work.refused("study render @plume.vdb --knobs samples -o page", Code::Invalid, &["--knobs samples", "early-stop"]);
    work.refused("study render @plume.vdb --albedo 0.9 --knobs step -o page", Code::Invalid, &["samples", "clamp"]);
    work.refused("study render @plume.vdb --budget 0 -o page", Code::Usage, &["--budget"]);
    work.json(&format!("{SMALL} -o page"));
    work.refused(&format!("{SMALL} --fov 30 -o page"), Code::OutputExists, &["--overwrite"]);
    work.json("gradient @plume.vdb --views 1 --size 8x8 --loss mean --wrt camera --report other");
    work.refused(&format!("{SMALL} -o other"), Code::OutputExists, &["--overwrite"]);
}

#[test]
fn derivatives_are_compared_with_those_in_double_precision() {
    let work = Work::new();
    let words = "study gradient @plume.vdb --density-scale 4 --size 16x16 --repeats 1 -o page";
    let report = work.json(words);
    let of = |words: &str| measurements(&report).iter().find(|m| m["options"] == words).unwrap();
    let single = number(of("--quadrature exact --adjoint tape"), "error");
    assert!(single > 1e-9 && single < 1e-5, "{single}");
    assert!(of("--quadrature exact --adjoint tape --check")["error"].is_null());
    assert!(number(of("--quadrature midpoint:0.25 --adjoint tape"), "error") > 10.0 * single);
    runs(&work, report["recommended"]["command"].as_str().unwrap());
    assert_eq!(measurements(&work.json(&format!("{words} --resume"))), measurements(&report));
    work.refused("study gradient @plume.vdb --knobs samples -o other", Code::Usage, &["adjoint", "precision"]);
}

#[test]
fn filters_are_compared_with_frames_of_less_noise() {
    let work = Work::new();
    let scene = "@plume.vdb --frames 1-3 --views 1 --size 24x24 --density-scale auto --albedo 0.9";
    work.json(&format!("render {scene} --samples 4 -o few"));
    work.json(&format!("render {scene} --samples 256 --seed 1 --aov variance -o many"));
    let words = "study denoise few/frame.####.exr --reference many/frame.####.exr --repeats 1 -o page";
    let report = work.json(words);
    let options: Vec<&str> = measurements(&report).iter().map(|m| m["options"].as_str().unwrap()).collect();
    assert_eq!(options.len(), 8, "{options:?}");
    assert!(number(&report["reference"], "uncertainty") > 0.0, "told by the layer variance");
    let fastest = report["recommendations"].as_array().unwrap().iter().find_map(|r| r["command"].as_str()).unwrap();
    runs(&work, fastest);
    assert!(work.path("denoised.0002.exr").exists(), "{fastest}");
    assert_eq!(measurements(&work.json(&format!("{words} --resume"))), measurements(&report));
    let missing = "study denoise few/frame.####.exr --reference none/frame.####.exr -o other";
    work.refused(missing, Code::Invalid, &["none"]);
}

#[test]
fn reconstructions_are_compared_by_views_that_they_are_not_fitted_to() {
    let work = Work::new();
    work.json("render @plume.vdb --views 8 --size 24x24 --density-scale auto -o shots");
    let words = "study reconstruct shots --knobs noise,iterations --resolution 12 --repeats 1 -o page";
    let report = work.json(words);
    let error = |words: &str| number(measurements(&report).iter().find(|m| m["options"] == words).unwrap(), "error");
    assert_eq!(measurements(&report).len(), 9);
    assert!(error("views_6 --resolution 12") < error("views_6_noise_0.05 --resolution 12"));
    runs(&work, measurements(&report)[0]["command"].as_str().unwrap());
    assert!(work.path("found.vdb").exists());
    assert_eq!(measurements(&work.json(&format!("{words} --resume"))), measurements(&report));
    work.refused("study reconstruct shots --knobs steps -o other", Code::Usage, &["resolution", "noise"]);
}
