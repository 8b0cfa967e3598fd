//! `cumulo plan`, and `cumulo render` by plans.

use crate::common::work::{Work, fixture, number};
use cumulo::error::Code;
use serde_json::Value;

const LIT: &str = "--density-scale 4 --albedo 0.9 --sun 1,1,2 --sun-color 3 --sky 0.2,0.3,0.5";

fn effect<'v>(plan: &'v Value, name: &str) -> &'v Value {
    let effects = plan["effects"].as_array().unwrap();
    effects.iter().find(|e| e["name"] == name).unwrap_or_else(|| panic!("{name} in {plan}"))
}

#[test]
fn plans_tell_states_costs_and_bounds() {
    let work = Work::new();
    let plan = work.json(&format!("plan @plume.vdb --size 64x48 --samples 16 {LIT}"));
    assert_eq!(plan["integrator"], "path-tracing");
    assert_eq!((&plan["omitted"], &plan["views"]), (&Value::from(0.0), &Value::from(1)));
    for (name, state) in [
        ("scattering", "on"),
        ("multiple-scattering", "on"),
        ("light-0", "on"),
        ("environment", "on"),
        ("emission", "off"),
        ("anisotropy", "off"),
        ("transfer-function", "off"),
        ("overlap", "off"),
    ] {
        assert_eq!(effect(&plan, name)["state"], state, "{name}");
        assert!(!effect(&plan, name)["reason"].as_str().unwrap().is_empty(), "{name}");
    }
    assert!(effect(&plan, "scattering")["cost"].as_f64().unwrap() > 0.0);
    assert!(plan["cost"]["seconds"].as_f64().unwrap() > 0.0);
    assert_eq!(plan["cost"]["paths"], 64 * 48 * 16);
    let depth = &plan["measured"]["optical_depth"];
    assert!(depth["largest"].as_f64().unwrap() <= depth["bound"].as_f64().unwrap(), "{depth}");

    let text = work.text(&format!("plan @plume.vdb --size 64x48 --samples 16 {LIT} --max-omitted 0.2"));
    assert!(
        text.contains("measured")
            && text.contains(
                "of radiance is missing in any channel of a block of 8 x 8 pixels, with a confidence of 95 %"
            )
            && text.contains("mean, limit: radiance")
            && text.contains("bound: most radiance"),
        "{text}"
    );
    let forced = work.json(&format!("plan @plume.vdb {LIT} --max-omitted 1000 --force scattering,light-0"));
    assert_eq!(effect(&forced, "light-0")["state"], "on");
    assert_eq!(effect(&forced, "environment")["state"], "off");

    let glow = r#"{"format": "cumulo-transfer-function", "version": 1, "transfer": {"kind": "piecewise",
        "points": [[0, 0.2, 0.2, 0.2, 0], [1, 0.9, 0.5, 0.1, 3]]}}"#;
    std::fs::write(work.path("glow.tf.json"), glow).unwrap();
    let straight = work.json("plan @plume.vdb --tf glow.tf.json --size 32x32");
    assert_eq!(straight["integrator"], "direct-volume-rendering");
    assert_eq!(effect(&straight, "transfer-function")["state"], "on");
    work.refused(
        &format!("plan @plume.vdb {LIT} --force light-3"),
        Code::Invalid,
        &["light-3", "1 lights", "numbered"],
    );
    work.refused(&format!("plan @plume.vdb {LIT} --force glow"), Code::Usage, &["glow", "multiple-scattering"]);
    work.refused("plan @plume.vdb --samples 4", Code::Invalid, &["--samples", "--albedo"]);
}

/// A scene file without albedo is rendered along straight rays: as the VDB by direct volume rendering.
#[test]
fn what_scatters_nothing_is_rendered_along_straight_rays() {
    let work = Work::new();
    let scene = serde_json::json!({
        "volumes": [{"file": fixture("plume.vdb"), "medium": {"density_scale": 4}}],
        "lights": [
            {"type": "DistantLight", "direction": [1, 1, 2], "irradiance": [3, 3, 3]},
            {"type": "DomeLight", "radiance": [0.2, 0.3, 0.5]}],
    });
    std::fs::write(work.path("scene.json"), scene.to_string()).unwrap();
    let report = work.json("render scene.json --views 1 --size 24x20 --samples 16 -o one");
    assert_eq!(report["plan"]["integrator"], "direct-volume-rendering");
    assert!(report["quadrature"].as_str().is_some());
    work.json(
        "render @plume.vdb --views 1 --size 24x20 --supersample 4 --density-scale 4 --background 0.2,0.3,0.5 -o two",
    );
    assert_eq!(work.picture("one/view_000.exr"), work.picture("two/view_000.exr"));
    // Planes of paths need paths.
    let paths = work.json("render scene.json --views 1 --size 24x20 --samples 16 --aov depth -o three");
    assert_eq!(paths["plan"]["integrator"], "path-tracing");
    let record: Value = serde_json::from_slice(&std::fs::read(work.path("one/transforms.json")).unwrap()).unwrap();
    assert_eq!(record["plan"]["omitted"], 0.0);
}

/// Contributions are told in any case, and what they leave out with which confidence.
#[test]
fn measured_contributions_are_left_out_with_a_confidence() {
    let work = Work::new();
    let plan = |more: &str| work.json(&format!("plan @plume.vdb --size 64x48 --samples 16 {LIT} {more}"));
    let told = plan("");
    assert_eq!((&told["omitted"], &told["confidence"]), (&Value::from(0.0), &Value::from(1.0)));
    for name in ["scattering", "light-0", "environment", "multiple-scattering"] {
        let found = &effect(&told, name)["contribution"];
        let [mean, worst] = ["mean", "worst"].map(|key| found[key].as_f64().unwrap());
        assert!(0.0 < mean && mean < worst, "{name}: {found}");
        // Limits may be unknown, and are above what was found.
        assert!(found["limit"].as_f64().is_none_or(|limit| limit > worst), "{name}: {found}");
    }
    assert!(effect(&told, "emission")["contribution"].is_null());

    let less = plan("--max-omitted 0.1");
    let omitted = less["omitted"].as_f64().unwrap();
    assert!(omitted > 0.0 && omitted <= 0.1, "{less}");
    assert_eq!(less["confidence"], 0.95);
    let effects = less["effects"].as_array().unwrap();
    let measured: Vec<_> = effects.iter().filter(|effect| effect["state"] == "measured").collect();
    assert!(!measured.is_empty(), "{less}");
    assert!(measured.iter().all(|effect| effect["contribution"]["limit"].as_f64().unwrap() <= omitted), "{less}");
    assert_eq!(plan("--max-omitted 0.1")["effects"].as_array().unwrap().len(), effects.len());

    let work_of = |folder: &str| format!("render @plume.vdb --views 1 --size 24x20 --samples 16 {LIT} -o {folder}");
    work.json(&format!("{} --max-omitted 0.1", work_of("less")));
    let record: Value = serde_json::from_slice(&std::fs::read(work.path("less/transforms.json")).unwrap()).unwrap();
    assert_eq!(record["plan"]["confidence"], 0.95);
}

/// A limit shortens paths, and the report says so; force brings them back.
#[test]
fn a_limit_shortens_paths() {
    let work = Work::new();
    let render = |more: &str| {
        work.json(&format!("render @plume.vdb --views 1 --size 24x20 --samples 64 {LIT} {more} --overwrite -o out"))
    };
    let each = |report: &Value| report["paths"]["collisions_per_path"].as_f64().unwrap();
    let (full, short) = (render(""), render("--max-omitted 0.05 --force scattering"));
    assert!(each(&short) < each(&full), "{short} {full}");
    let omitted = short["plan"]["omitted"].as_f64().unwrap();
    assert!(omitted > 0.0 && omitted <= 0.05);
    assert_eq!(
        each(&render("--max-omitted 1 --force scattering,multiple-scattering,light-0,environment")),
        each(&full)
    );
    let straight = render("--max-omitted 100");
    assert_eq!(straight["plan"]["integrator"], "direct-volume-rendering");
    assert!(
        work.text(&format!("render @plume.vdb --views 1 --size 9x9 {LIT} --max-omitted 100 -o text"))
            .contains("of radiance is missing")
    );
}

fn numbers(plan: &Value, pointer: &str) -> Vec<f64> {
    plan.pointer(pointer).unwrap().as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

/// What a plan says fits together, holds for the run, and does not take the run's time.
#[test]
fn plans_of_captures_tell_what_a_reconstruction_takes() {
    let work = Work::new();
    work.json("render @plume.vdb --views 12 --size 48x48 --density-scale auto -o shots");
    let words = "--resolution 32 --iterations 6";
    let plan = work.json(&format!("plan shots {words} --machines 1,4,64"));
    let run = work.json(&format!("reconstruct density shots {words} -o found.vdb"));
    assert_eq!((&plan["views"], &plan["read"], &plan["solver"]), (&12.into(), &8.into(), &"cg".into()));
    assert_eq!(plan["held_out"], run["held_out"]);
    assert_eq!(plan["expected"]["measurements"], 12 * 48 * 48);
    let ratio = number(&plan["expected"], "unknowns") / number(&run, "unknowns");
    assert!((0.9..1.5).contains(&ratio), "{ratio}");
    let memory = number(&plan["expected"], "memory_mb");
    let peak = number(&run, "peak_memory_mb");
    assert!(memory >= peak && memory == number(&plan["memory"], "needed_mb"), "{memory} {peak}");

    // The stages are those of the run, and their sum is the whole.
    let names = |report: &Value| -> Vec<String> {
        report["stages"].as_array().unwrap().iter().map(|s| s["name"].as_str().unwrap().to_owned()).collect()
    };
    assert_eq!(names(&plan), names(&run));
    let stages = plan["stages"].as_array().unwrap();
    let sum: f64 = stages.iter().map(|stage| number(stage, "seconds")).sum();
    let (seconds, range) = (number(&plan["expected"], "seconds"), numbers(&plan, "/seconds_range"));
    assert!((sum - seconds).abs() < 1e-9 && range[0] <= seconds && seconds <= range[1], "{plan}");
    let iterations = numbers(&plan, "/iterations");
    assert!((iterations[0]..=iterations[2]).contains(&number(&run, "iterations")), "{iterations:?} {run}");

    let scaling = plan["scaling"]["machines"].as_array().unwrap();
    assert_eq!(scaling.iter().map(|s| s["machines"].as_u64().unwrap()).collect::<Vec<_>>(), [1, 4, 64]);
    assert!((number(&scaling[0], "seconds") / seconds - 1.0).abs() < 0.1, "{scaling:?} {seconds}");
    assert_eq!(scaling[0]["efficiency"], 1.0);
    assert!(number(&scaling[2], "efficiency") < number(&scaling[1], "efficiency"), "{scaling:?}");
    assert!(plan["scaling"]["useful_machines"].as_u64().unwrap() <= plan["scaling"]["partitions"].as_u64().unwrap());

    let text = work.text("plan shots/transforms.json --resolution 400 --max-memory 200M --iterations 2");
    assert!(text.contains("it does not fit; voxels of") && text.contains("1024"), "{text}");
    let descent = work.json("plan shots --solver weiss2021 --resolution 24");
    assert_eq!((&descent["scaling"], &descent["timed_level"]), (&Value::Null, &Value::Null));
}

/// Pictures whose pixels are not read have headers that are; options of the other kind of input are refused.
#[test]
fn plans_refuse_captures_that_no_reconstruction_takes() {
    let work = Work::new();
    work.json("render @plume.vdb --views 12 --size 24x24 --density-scale auto -o shots");
    work.refused("plan shots --samples 4", Code::Invalid, &["shots", "reconstruct density", "--cameras"]);
    work.refused("plan @plume.vdb --resolution 32", Code::Invalid, &["plume.vdb", "--resolution", "transforms.json"]);
    work.refused("plan shots --held-out 12", Code::Invalid, &["--held-out 12", "12 views"]);
    work.refused("plan shots --bounds 9,9,9,8,8,8", Code::Usage, &["--bounds"]);
    // The first picture is none of the eight.
    let first = work.path("shots/view_000.exr");
    work.json("render @plume.vdb --views 1 --size 8x8 --density-scale auto -o small.exr");
    let own = std::fs::read(&first).unwrap();
    std::fs::copy(work.path("small.exr"), &first).unwrap();
    work.refused("plan shots", Code::Invalid, &["view_000.exr", "8x8", "24x24"]);
    std::fs::write(&first, &own[..100]).unwrap();
    work.refused("plan shots", Code::Invalid, &["view_000.exr"]);
    std::fs::write(&first, "no picture").unwrap();
    work.refused("plan shots", Code::Unsupported, &["view_000.exr", "EXR"]);
    std::fs::remove_file(&first).unwrap();
    work.refused("plan shots", Code::NotFound, &["view_000.exr"]);
    std::fs::write(work.path("empty.json"), r#"{"frames": []}"#).unwrap();
    work.refused("plan empty.json", Code::Invalid, &["empty.json"]);
}
