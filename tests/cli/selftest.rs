//! `cumulo selftest`.

use crate::common::work::Work;
use cumulo::error::Code;
use std::collections::BTreeMap;
use std::time::Instant;

/// Inputs on which formulas of rendering, gradients, reconstruction and denoising are known to fail, and the cases of
/// each.
const HAZARDS: [(&str, &[&str]); 20] = [
    (
        "opacities near 0 and 1",
        &["thin-samples", "dense-samples", "opaque-samples", "faint-emission", "opaque-pre-shaded"],
    ),
    ("optical depths to 1e4 in many steps", &["deep-rays", "long-rays", "transmittance-product", "early-stop"]),
    ("detail thinner than a step", &["thin-shell", "function-spike", "function-step"]),
    ("coincident points of a function", &["coincident-points"]),
    ("densities outside a function", &["outside-the-function"]),
    ("equal densities in pre-integration", &["equal-densities", "nearly-equal-densities"]),
    ("lobes without width", &["narrow-lobes"]),
    ("entropy of a blank picture", &["blank-picture"]),
    ("camera at a pole", &["camera-at-a-pole"]),
    ("negative extinction", &["softplus", "negative-extinction"]),
    ("empty, constant and one-voxel volumes", &["empty-and-single-voxels", "equal-densities", "certain-collisions"]),
    ("rays along axes, faces and edges", &["slab-test", "grazing-rays", "creeping-rays"]),
    ("far and sheared volumes, singular maps", &["far-from-the-origin", "sheared-voxels", "singular-maps"]),
    ("values that are no densities", &["poisoned-values"]),
    ("majorants below the extinction", &["majorants-between-voxels"]),
    ("probabilities of 0", &["certain-collisions"]),
    ("transmittance estimates at great depth", &["deep-transmittance", "white-furnace"]),
    ("peaked and flat phase functions", &["flat-phase-function", "peaked-phase-function"]),
    ("least squares with forgetting", &["input-without-variety", "still-picture"]),
    ("bright, black, wrong and missing pixels", &["light-of-any-brightness", "one-pixel-spikes", "missing-pixels"]),
];

#[test]
fn every_hazard_has_a_case_that_passes() {
    let (work, begun) = (Work::new(), Instant::now());
    let report = work.json("selftest --threads 2");
    let seconds = begun.elapsed().as_secs_f64();
    assert!(seconds < 30.0, "{seconds} s");
    let cases = report["cases"].as_array().unwrap();
    assert!(cases.len() >= 20 && report["passed"] == cases.len() && report["failed"] == 0, "{report}");
    let by_name: BTreeMap<&str, _> = cases.iter().map(|case| (case["name"].as_str().unwrap(), case)).collect();
    for (hazard, names) in HAZARDS {
        for name in names {
            let case = by_name.get(name).unwrap_or_else(|| panic!("{hazard}: no case {name}"));
            let [error, bound] = ["error", "bound"].map(|key| case[key].as_f64().unwrap());
            assert!(case["passed"] == true && error <= bound, "{case}");
            // The naive formula fails, or the report says why it does not.
            let naive = case["naive_error"].as_f64().is_none_or(|naive| naive > bound);
            assert!(naive != case["naive_reason"].is_string(), "{case}");
        }
    }
    // The guide lists all cases, and no others.
    let page = include_str!("../../src/guide/self-test.md");
    let listed: Vec<&str> = page.lines().filter_map(|line| line.strip_prefix("| `")?.split('`').next()).collect();
    assert_eq!(listed, cases.iter().map(|case| case["name"].as_str().unwrap()).collect::<Vec<_>>());
    for area in ["dvr", "transfer-function", "path-tracing", "denoising", "reconstruction", "geometry"] {
        assert!(cases.iter().any(|case| case["area"] == area), "{area}");
    }
    assert!(report["software"].as_str().unwrap().starts_with("cumulo "), "{report}");
    assert!(!report["instruction_set"].as_str().unwrap().is_empty(), "{report}");
}

#[test]
fn names_select_cases_and_areas() {
    let work = Work::new();
    let text = work.text("selftest softplus geometry");
    assert!(text.contains("softplus") && text.contains("slab-test") && !text.contains("thin-samples"), "{text}");
    assert!(text.contains("  pass  ") && !text.contains("FAIL") && text.contains("cases pass, in "), "{text}");
    work.refused("selftest dvr nonsense", Code::Invalid, &["'nonsense'", "path-tracing"]);
}
