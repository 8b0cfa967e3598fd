//! `cumulo gradient`: derivatives that differences confirm, whichever way they are found, and what it refuses.

use crate::common::fields::{tinted, unit};
use crate::common::work::{self, Work, density, errors};
use cumulo::error::Code;
use cumulo::formats::vdb::shaded;
use serde_json::Value;
use std::collections::BTreeMap;

/// Peaks and a clear gap; extinction at density 0, which fills the empty space.
const TF: &str = r#"{"format": "cumulo-transfer-function", "version": 1, "transfer": {"kind": "piecewise", "points": [
    [0.02, 0.9, 0.3, 0.1, 0.05], [0.15, 1.0, 0.5, 0.1, 0.4], [0.3, 0.4, 0.6, 0.2, 0.1], [0.7, 0.1, 0.2, 0.9, 0.6]]}}"#;
/// No extinction below its first point.
const LOBES: &str = r#"{"format": "cumulo-transfer-function", "version": 1, "transfer": {"kind": "gaussians",
    "domain": [0, 1], "lobes": [
    {"mean": 0.2, "ln_width": -2.3, "rgbs": [1.0, 0.5, 0.1, 0.4]},
    {"mean": 0.6, "ln_width": -1.5, "rgbs": [0.1, 0.3, 1.0, 0.7]}]}}"#;

/// Two steps: up from nothing, and to another color.
const STEPS: &str = r#"{"format": "cumulo-transfer-function", "version": 1, "transfer": {"kind": "piecewise", "points": [
    [0.12, 0.1, 0.2, 0.8, 0.0], [0.12, 0.1, 0.2, 0.8, 3.0], [0.34, 0.3, 0.2, 0.6, 4.0], [0.34, 0.9, 0.5, 0.1, 1.0],
    [1.2, 0.2, 0.5, 0.9, 2.0]]}}"#;

fn rows(report: &Value) -> Vec<(String, f64)> {
    let row = |r: &Value| (r["name"].as_str().unwrap().to_owned(), r["gradient"].as_f64().unwrap());
    report["rows"].as_array().unwrap().iter().map(row).collect()
}

fn worst(report: &Value) -> f64 {
    report["worst_relative_error"].as_f64().unwrap()
}

/// A capture of the plume, denser and on another background than it is looked at.
fn work() -> Work {
    let work = Work::new();
    std::fs::write(work.path("points.tf.json"), TF).unwrap();
    std::fs::write(work.path("lobes.tf.json"), LOBES).unwrap();
    std::fs::write(work.path("steps.tf.json"), STEPS).unwrap();
    work.json("render @plume.vdb --views 2 --size 20x16 --density-scale 0.4 -o grey");
    work.json("render @plume.vdb --views 2 --size 20x16 --density-scale 0.4 --tf points.tf.json -o bright");
    work
}

#[test]
fn every_parameter_and_loss_is_confirmed_by_differences() {
    let work = work();
    let grey = "--target grey --density-scale 0.3 --background 0.9,0.7,0.4";
    let bright = "--target bright --density-scale 0.3 --background 0.1,0.2,0.3";
    for (words, wrt) in [
        (format!("{grey} --loss l2"), "camera,background,extinction,density"),
        (format!("{grey} --loss l2 --quadrature midpoint:0.7"), "step,extinction,density"),
        (format!("{grey} --loss l2 --quadrature riemann:0.7"), "step,camera,background"),
        (format!("{grey} --loss l1"), "background,extinction"),
        (format!("{grey} --loss huber --huber-delta 0.05"), "camera,extinction"),
        (format!("{grey} --loss log-transmittance"), "camera,extinction,density"),
        // Not by densities: where alpha is 0 the derivative of the entropy has no bound.
        (format!("{grey} --loss opacity-entropy"), "camera,extinction"),
        (format!("{grey} --loss ssim"), "camera,extinction,density"),
        (format!("{grey} --loss mean --emission 0.2,0.9,0.5 --emission-model linear"), "camera,extinction,density"),
        (format!("{bright} --loss l2"), "tf,camera,extinction,background"),
        (format!("{bright} --loss ssim"), "tf"),
        (format!("{bright} --loss l2 --tf steps.tf.json"), "tf,camera,extinction,density"),
        (format!("{bright} --loss mean --tf lobes.tf.json"), "tf,density"),
        (format!("{bright} --loss l2 --prior tv=0.1 --prior tf=0.3"), "tf,density"),
        (format!("{bright} --loss huber --prior smooth=2 --prior tf-rgb=1"), "tf,density"),
        ("--views 3 --size 17x12 --loss opacity-entropy --density-scale 0.5".to_owned(), "camera"),
        ("--views 2 --size 17x12 --loss mean --tf points.tf.json --quadrature midpoint:0.5".to_owned(), "step,tf"),
    ] {
        let report = work.json(&format!("gradient @plume.vdb {words} --wrt {wrt} --check --largest 10"));
        assert!(worst(&report) < 1e-4, "{words} {wrt}: {report:#}");
        assert!(rows(&report).iter().any(|(_, g)| g.abs() > 1e-6), "{words}: something changes");
        assert_eq!(report["precision"], "f64");
    }
}

/// Forward, backward by tape, by replay and by inversion.
#[test]
fn all_ways_lead_to_the_same() {
    let work = work();
    for (loss, quadrature, tf) in [
        ("l2", "exact", "points"),
        ("opacity-entropy", "exact", "points"),
        ("log-transmittance", "midpoint:0.6", "points"),
        ("l2", "exact", "steps"),
    ] {
        let step = if quadrature == "exact" { "" } else { ",step" };
        let words = format!(
            "gradient @plume.vdb --target bright --density-scale 0.3 --loss {loss} --tf {tf}.tf.json --quadrature {quadrature} \
             --wrt tf,camera,extinction,background{step}"
        );
        let ways = ["--mode tangent", "--adjoint tape", "--adjoint replay", "--adjoint inversion --mode adjoint"];
        let reports: Vec<Value> = ways.iter().map(|way| work.json(&format!("{words} {way} --check"))).collect();
        assert_eq!(reports[0]["mode"], "forward");
        assert_eq!(reports[2]["adjoint"], "replay");
        let first = rows(&reports[0]);
        let scale = first.iter().fold(0.0_f64, |m, r| m.max(r.1.abs()));
        for (report, way) in reports.iter().zip(ways).skip(1) {
            // The inversion loses digits with the optical depth, 2 at most here.
            let allowed = if way.contains("inversion") { 1e-9 } else { 1e-12 };
            for ((name, a), (_, b)) in first.iter().zip(rows(report)) {
                assert!((a - b).abs() <= allowed * scale, "{loss} {way} {name}: {a} {b}");
            }
        }
        assert_eq!(rows(&reports[1]), rows(&reports[2]), "tape and replay");
        // In single precision the same to its rounding.
        let single = work.json(&words);
        assert_eq!(single["precision"], "f32");
        for ((name, a), (_, b)) in first.iter().zip(rows(&single)) {
            assert!((a - b).abs() <= 1e-4 * scale, "{loss} {name}: {a} {b}");
        }
    }
}

/// A pre-shaded volume, and pictures of it, denser and on another background.
fn shaded_work() -> Work {
    let work = Work::new();
    shaded::write(&work.path("shaded.vdb"), &tinted::<f32>(16, 0.4, unit()), &[], &BTreeMap::new()).unwrap();
    work.json(
        "render shaded.vdb --model pre-shaded --views 2 --size 16x12 --density-scale 1.5 --supersample 2 -o shots",
    );
    work
}

#[test]
fn pre_shaded_volumes_have_all_their_derivatives() {
    let work = shaded_work();
    let target = "--target shots --density-scale 0.9 --background 0.1,0.3,0.2";
    for words in [
        &format!("{target} --loss l2"),
        &format!("{target} --loss l2 --adjoint replay"),
        &format!("{target} --loss huber --prior smooth=0.3 --prior tv=0.1"),
        &format!("{target} --loss ssim"),
        // Not a ray through the middle, where edges of cells meet: the quadrature has a kink there.
        "--views 2 --size 14x12 --model pre-shaded --loss mean",
        "--views 2 --size 14x12 --model pre-shaded --loss opacity-entropy",
    ] {
        let report = work.json(&format!(
            "gradient shaded.vdb {words} --wrt camera,background,density,emission --check --largest 12"
        ));
        assert!(worst(&report) < 1e-4, "{words}: {report:#}");
        assert_eq!(report["quadrature"], "gauss");
        assert!(rows(&report).iter().filter(|(_, g)| g.abs() > 1e-7).count() > 20, "{words}: {report:#}");
    }
    // The page has the pictures, slices of what voxels do, and every row.
    let report = work.json(&format!(
        "gradient shaded.vdb {target} --loss l2 --wrt background,density --largest 3 --check --report page"
    ));
    let page = std::fs::read_to_string(work.path(report["report"].as_str().unwrap())).unwrap();
    for part in ["view 1", "Derivative by density", "background.green", "Relative error", "Provenance"] {
        assert!(page.contains(part), "{part}");
    }
    for (name, _) in rows(&report) {
        assert!(page.contains(&name), "{name}");
    }
    // The capture says that it is pre-shaded; forward and backward are the same, and every voxel's is written.
    let words = format!("gradient shaded.vdb {target} --loss l2 --wrt camera,background --check");
    let [back, forward] = ["", "--mode tangent"].map(|way| rows(&work.json(&format!("{words} {way}"))));
    let scale = back.iter().fold(0.0_f64, |m, r| m.max(r.1.abs()));
    assert!(back.iter().zip(&forward).all(|(a, b)| (a.1 - b.1).abs() <= 1e-12 * scale), "{back:?} {forward:?}");
    let report = work.json(&format!("gradient shaded.vdb {target} --loss l2 --wrt emission --largest 1 -o g.vdb"));
    let (name, most) = rows(&report).swap_remove(0);
    assert!(name.starts_with("emission."), "{name}");
    let file = cumulo::formats::vdb::File::open(work.path("g.vdb"), Default::default()).unwrap();
    let largest = ["red", "green", "blue"].map(|c| {
        let grid = file.read_fog(Some(&format!("gradient_emission_{c}"))).unwrap();
        grid.leaves.iter().flat_map(|l| l.values.iter()).fold(0.0_f32, |m, v| m.max(v.abs()))
    });
    assert_eq!(largest.into_iter().fold(0.0, f32::max), most.abs() as f32);
}

#[test]
fn what_a_pre_shaded_volume_does_not_have_is_refused() {
    let work = shaded_work();
    let words = "gradient shaded.vdb --views 1 --loss mean --model pre-shaded --wrt";
    for (asked, code, expected) in [
        ("tf", Code::Invalid, &["shaded.vdb", "no transfer function", "--wrt density"][..]),
        ("extinction", Code::Invalid, &["extinctions of a pre-shaded volume"]),
        ("step --quadrature midpoint:0.5", Code::Invalid, &["--quadrature", "of their own"]),
        ("density --emission 1,1,1", Code::Invalid, &["--emission", "voxels"]),
        ("density --tf points.tf.json", Code::Usage, &["--tf", "--model"]),
        ("density --prior tf=1", Code::Invalid, &["no transfer function"]),
    ] {
        work.refused(&format!("{words} {asked}"), code, expected);
    }
    work.refused("gradient shaded.vdb --views 1 --loss mean --wrt emission", Code::Invalid, &["--model pre-shaded"]);
    work.refused(
        "gradient @plume.vdb --views 1 --loss mean --wrt camera --quadrature preintegrated --check",
        Code::Invalid,
        &["--check", "exact"],
    );
    work.refused(
        "gradient @plume.vdb --views 1 --loss mean --wrt emission --model pre-shaded",
        Code::Invalid,
        &["'emission'", "vec3s"],
    );
    work.refused(
        "gradient @plume.vdb --views 1 --loss mean --wrt density --model absorption --emission 1,0,0",
        Code::Invalid,
        &["nothing is emitted"],
    );
}

#[test]
fn the_plan_says_which_way_and_why() {
    let work = work();
    let plan = |words: &str| {
        let report = work.json(&format!("gradient @plume.vdb {words}"));
        let text = |key: &str| report[key].as_str().unwrap_or("none").to_owned();
        (text("mode"), text("adjoint"), text("reason"), report["parameters"].as_u64().unwrap())
    };
    let (mode, adjoint, reason, count) =
        plan("--views 1 --size 8x8 --loss opacity-entropy --tf points.tf.json --wrt extinction,background");
    assert_eq!((mode.as_str(), adjoint.as_str(), count), ("forward", "none", 4));
    assert!(reason.contains("one walk"), "{reason}");
    let (mode, adjoint, reason, _) = plan("--target grey --loss l2 --wrt extinction");
    assert_eq!((mode.as_str(), adjoint.as_str()), ("reverse", "tape"));
    assert!(reason.contains("optical depth alone"), "{reason}");
    let (mode, adjoint, reason, count) = plan("--target bright --loss l2 --wrt camera");
    assert_eq!((mode.as_str(), adjoint.as_str(), count), ("reverse", "tape", 20));
    assert!(reason.contains("20 parameters") && reason.contains("mean over pixels"), "{reason}");
    let (mode, adjoint, reason, count) = plan("--views 1 --size 8x8 --loss opacity-entropy --wrt density");
    assert_eq!((mode.as_str(), adjoint.as_str()), ("reverse", "replay"));
    assert!(count > 1000 && reason.contains("whole pictures"), "{count} {reason}");
}

#[test]
fn densities_are_written_and_the_largest_listed() {
    let work = work();
    let words = "gradient @plume.vdb --target grey --density-scale 0.3 --loss l2 --wrt density,extinction";
    let report = work.json(&format!("{words} --largest 7 -o g.vdb"));
    let rows = rows(&report);
    assert_eq!(rows.len(), 8);
    assert_eq!(rows[0].0, "extinction");
    assert!(report["provenance"].to_string().contains("plume.vdb"), "{report:#}");
    assert!(rows[1..].windows(2).all(|w| w[0].1.abs() >= w[1].1.abs()));
    let grid = cumulo::formats::vdb::File::open(work.path("g.vdb"), Default::default()).unwrap();
    let grid = grid.read_fog(Some("gradient")).unwrap();
    assert_eq!(grid.transform.matrix(), density(&work::fixture("plume.vdb")).transform.matrix());
    let written = grid.leaves.iter().flat_map(|l| l.values.iter()).fold(0.0_f32, |m, v| m.max(v.abs()));
    assert_eq!(written, rows[1].1.abs() as f32);
    // The derivative by a factor of all densities is that by the extinction, times it.
    let volume = density(&work::fixture("plume.vdb"));
    let mut sum = 0.0;
    for leaf in &grid.leaves {
        if let Some(own) = volume.leaves.iter().find(|l| l.origin == leaf.origin) {
            sum += leaf.values.iter().zip(own.values.iter()).map(|(g, v)| f64::from(g * v)).sum::<f64>();
        }
    }
    assert!((sum - 0.3 * rows[0].1).abs() < 1e-4 * sum.abs(), "{sum} {}", rows[0].1);
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let work = work();
    for (words, name) in [
        ("--target bright --density-scale 0.3 --loss l2 --wrt tf,camera,density", "reverse"),
        ("--views 2 --loss opacity-entropy --density-scale 0.3 --wrt camera --mode forward", "forward"),
    ] {
        let of = |threads: usize| {
            let report = work.json(&format!("gradient @plume.vdb {words} --threads {threads}"));
            (report["value"].clone(), report["rows"].clone())
        };
        let one = of(1);
        assert_eq!(one, of(2), "{name}");
        assert_eq!(one, of(5), "{name}");
    }
}

/// A tolerance that no difference meets: the exit code says so, and the report is there all the same.
#[test]
fn what_does_not_agree_is_exit_code_one() {
    let work = work();
    let words = "gradient @plume.vdb --views 1 --size 8x8 --loss mean --wrt extinction --check --tolerance 0 --json";
    let out = work.command(words).output().unwrap();
    assert_eq!(out.status.code(), Some(1), "{}", errors(&out));
    let report: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert!(worst(&report) > 0.0 && worst(&report) < 1e-6);
    let out = work.command(&words.replace(" --json", "")).output().unwrap();
    let text = String::from_utf8_lossy(&out.stdout).into_owned();
    assert!(text.contains("do not agree") && text.contains("extinction"), "{text}");
}

#[test]
fn what_cannot_be_is_refused() {
    let work = work();
    for (words, code, expected) in [
        ("gradient @plume.vdb --views 1 --loss mean --wrt step", Code::Invalid, &["no step", "midpoint:0.5"][..]),
        (
            "gradient @plume.vdb --views 1 --loss mean --wrt tf",
            Code::Invalid,
            &["no transfer function", "--tf", "plume.vdb"],
        ),
        (
            "gradient @plume.vdb --views 1 --loss l2 --wrt extinction",
            Code::Invalid,
            &["compares with pictures", "--target"],
        ),
        ("gradient @plume.vdb --views 1 --loss mean --wrt camera -o x.vdb", Code::Invalid, &["--output", "density"]),
        (
            "gradient @plume.vdb --views 1 --loss mean --wrt camera --mode tangent --adjoint tape",
            Code::Invalid,
            &["leave one"],
        ),
        (
            "gradient @plume.vdb --views 1 --loss mean --wrt density --mode forward",
            Code::Unsupported,
            &["512", "--mode reverse"],
        ),
        ("gradient @plume.vdb --loss mean --wrt camera", Code::Usage, &["--target", "--views"]),
        (
            "gradient @plume.vdb --views 1 --loss mean --wrt density --prior tf=1",
            Code::Invalid,
            &["no transfer function", "plume"],
        ),
        (
            "gradient @plume.vdb --views 1 --loss mean --wrt tf --tf lobes.tf.json --prior tf=1",
            Code::Unsupported,
            &["texels or points"],
        ),
        (
            "gradient @plume.vdb --views 1 --loss mean --wrt camera --prior rough=1",
            Code::Usage,
            &["rough=1", "tv=WEIGHT"],
        ),
        ("gradient @plume.vdb --views 1 --loss mean", Code::Usage, &["--wrt"]),
        ("gradient @plume.vdb --views 1 --loss mean --wrt color", Code::Usage, &["color"]),
        ("gradient @plume.vdb --views 1 --loss mean --wrt camera --tolerance 1", Code::Usage, &["--check"]),
        ("gradient none.vdb --views 1 --loss mean --wrt camera", Code::NotFound, &["none.vdb"]),
        ("gradient @plume.vdb --target none --loss l2 --wrt camera", Code::NotFound, &["none"]),
        (
            "gradient @plume.vdb --views 1 --size 60000x60000 --loss mean --wrt camera --max-memory 1G",
            Code::Unsupported,
            &["MiB"],
        ),
    ] {
        work.refused(words, code, expected);
    }
    assert!(!work.path("x.vdb").exists());
}

/// Pixels of a capture that are not finite ask for nothing, and a blank picture has no entropy.
#[test]
fn degenerate_pictures_have_finite_derivatives() {
    let work = work();
    work.edit("grey", |_, film| film.rgba[37] = [f32::NAN; 4]);
    let report =
        work.json("gradient @plume.vdb --target grey --density-scale 0.3 --loss l2 --wrt camera,density --check");
    assert!(worst(&report) < 1e-4, "{report:#}");
    let blank =
        "gradient @plume.vdb --views 1 --size 8x8 --density-scale 1e-14 --loss opacity-entropy --wrt camera,extinction";
    let report = work.json(blank);
    assert_eq!(report["value"], 0.0);
    assert!(rows(&report).iter().all(|(_, g)| *g == 0.0));
}

/// Derivatives by the albedo of pictures of scattered light: none at the truth beyond chance, towards it elsewhere, the
/// difference quotient of the loss, and the same bits for any number of threads.
#[test]
fn albedos_have_derivatives_with_standard_errors() {
    let work = Work::new();
    let function = |green: f64| {
        let points = format!("[0.02, 0.9, {green}, 0.1, 0.0], [0.3, 0.4, 0.6, 0.2, 3.0], [0.7, 0.1, 0.2, 0.9, 6.0]");
        let head = r#"{"format": "cumulo-transfer-function", "version": 1, "transfer": {"kind": "piecewise", "points""#;
        format!("{head}: [{points}]}}}}")
    };
    for (name, green) in [("true", 0.5), ("less", 0.3), ("more", 0.34), ("low", 0.26)] {
        std::fs::write(work.path(&format!("{name}.tf.json")), function(green)).unwrap();
    }
    let light = "--albedo 0.9,0.8,1 --anisotropy 0.3 --sun=-1,0.6,0.7 --sun-color 4 --sun-angle 5 --sky 0.3";
    work.json(&format!(
        "render @plume.vdb --views 2 --size 12x10 --density-scale 4 --tf true.tf.json {light} --samples 2048 -o lit"
    ));
    let at = |name: &str, more: &str| {
        work.json(&format!("gradient @plume.vdb --target lit --tf {name}.tf.json --wrt albedo --loss l2 {more}"))
    };
    let row = |report: &Value, name: &str| -> [f64; 2] {
        let row = report["rows"].as_array().unwrap().iter().find(|row| row["name"] == name).unwrap();
        ["gradient", "standard_error"].map(|key| row[key].as_f64().unwrap())
    };
    let truth = at("true", "--samples 512 --seed 3");
    let rows = truth["rows"].as_array().unwrap();
    assert_eq!((rows.len(), truth["parameters"].as_u64()), (12, Some(12)));
    let less = at("less", "--samples 512 --seed 3");
    let [slope, error] = row(&less, "albedo.point[0].green");
    assert!(slope < -5.0 * error && slope < 0.0, "{slope} {error}");
    for r in rows {
        let name = r["name"].as_str().unwrap();
        let [at_truth, error] = row(&truth, name);
        // The pictures have noise that is common to all of a pixel's derivatives.
        assert!(
            at_truth.abs() < 6.0 * error + 0.1 * row(&less, name)[0].abs() + 0.05 * slope.abs(),
            "{name}: {at_truth}"
        );
    }
    // Estimates of other random numbers differ as the standard errors say.
    let green = |seed: u32| row(&at("less", &format!("--samples 64 --seed {seed}")), "albedo.point[0].green");
    let all: Vec<[f64; 2]> = (0..12).map(green).collect();
    let mean = all.iter().map(|v| v[0]).sum::<f64>() / 12.0;
    let spread = (all.iter().map(|v| (v[0] - mean).powi(2)).sum::<f64>() / 11.0).sqrt();
    let stated = (all.iter().map(|v| v[1].powi(2)).sum::<f64>() / 12.0).sqrt();
    assert!((0.5..2.0).contains(&(spread / stated)), "{spread} {stated}");
    // The loss is free of the pictures' noise, but for that of the target.
    let value = |name: &str| work::number(&at(name, "--samples 2048 --seed 5"), "value");
    let quotient = (value("more") - value("low")) / 0.08;
    assert!((quotient / slope - 1.0).abs() < 0.25, "{quotient} {slope}");
    let of = |threads: &str| {
        let mut command = work
            .command("gradient @plume.vdb --target lit --tf less.tf.json --wrt albedo --loss l2 --samples 64 --json");
        let out = command.env("RAYON_NUM_THREADS", threads).output().unwrap();
        serde_json::from_slice::<Value>(&out.stdout).unwrap()["rows"].clone()
    };
    assert_eq!(of("1"), of("3"));
    let refused = |words: &str, facts: &[&str]| work.refused(words, Code::Invalid, facts);
    refused("gradient @plume.vdb --views 1 --tf true.tf.json --wrt albedo --loss mean", &["--wrt albedo", "--target"]);
    refused("gradient @plume.vdb --target lit --wrt albedo,camera --loss l2", &["--wrt albedo", "straight rays"]);
    refused("gradient @plume.vdb --target lit --wrt albedo --loss l1", &["without bias", "--loss l2"]);
    refused("gradient @plume.vdb --target lit --wrt albedo --loss l2 --check", &["--check", "standard errors"]);
    refused("gradient @plume.vdb --target lit --wrt albedo --loss l2 --mode reverse", &["--mode", "paths"]);
    work.json(&format!("render @plume.vdb --views 1 --size 8x8 --density-scale 4 {light} --samples 16 -o harmed"));
    let json = std::fs::read_to_string(work.path("harmed/transforms.json")).unwrap();
    let harmed = |from: &str, to: &str| {
        assert!(json.contains(from), "{from} in {json}");
        std::fs::write(work.path("harmed/transforms.json"), json.replacen(from, to, 1)).unwrap();
    };
    harmed("\"anisotropy\": 0.3", "\"anisotropy\": 2.5");
    refused("gradient @plume.vdb --target harmed --wrt albedo --loss mean", &["anisotropy", "2.5"]);
    harmed("\"anisotropy\": 0.3", "\"anisotropy\": \"much\"");
    refused("gradient @plume.vdb --target harmed --wrt albedo --loss mean", &["'scattering' cannot be used", "much"]);
    refused("gradient @plume.vdb --views 1 --wrt camera --loss mean --samples 8", &["--samples", "--wrt albedo"]);
    work.json("render @plume.vdb --views 1 --size 8x8 -o dark");
    refused("gradient @plume.vdb --target dark --wrt albedo --loss l2", &["transforms.json", "records no albedo"]);
}
