//! Captures that contradict their pictures are refused or warned of, and what a run will cost is said first.

use crate::common::work::{Work, errors};
use cumulo::error::Code;
use cumulo::formats::exr;
use cumulo::scene::film::Film;
use serde_json::{Value, json};
use std::time::{Duration, Instant};

const WORDS: &str = "reconstruct density cap -o x.vdb --max-memory 2G";

fn with_pictures(words: &str) -> Work {
    let work = Work::new();
    work.json(&format!("render @plume.vdb --views 12 --size 32x32 --density-scale auto {words} -o cap"));
    work
}

/// Changes transforms.json.
fn edit(work: &Work, change: impl FnOnce(&mut Value)) {
    let path = work.path("cap/transforms.json");
    let mut capture: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    change(&mut capture);
    std::fs::write(path, serde_json::to_vec(&capture).unwrap()).unwrap();
}

/// Refused within seconds.
fn refused(work: &Work, words: &str, code: Code, facts: &[&str]) {
    let begun = Instant::now();
    work.refused(words, code, facts);
    assert!(begun.elapsed() < Duration::from_secs(20), "{words}: {:?}", begun.elapsed());
    assert!(!work.path("x.vdb").exists());
}

/// Warned of, in JSON and on standard error: what and do.
fn warned(work: &Work, words: &str, expected: &[&str]) -> Value {
    let out = work.command(words).arg("--json").output().unwrap();
    assert_eq!(out.status.code(), Some(0), "{}", errors(&out));
    let report: Value = serde_json::from_slice(&out.stdout).unwrap();
    let all = report["warnings"].to_string();
    for text in expected {
        assert!(all.contains(text), "'{text}' is not in {all}");
    }
    assert!(report["warnings"][0]["what"].is_string() && report["warnings"][0]["do"].is_string());
    assert!(errors(&out).contains("warning: "), "{}", errors(&out));
    report
}

#[test]
fn a_capture_that_is_right_is_not_warned_of() {
    let work = with_pictures("");
    let report = work.json(&format!("{WORDS} --report page"));
    assert_eq!(report["warnings"], json!([]), "{report}");
    let emission = with_pictures("--model emission-absorption --emission 2,1,0.5 --background 0.1,0.2,0.1");
    assert_eq!(emission.json(WORDS)["warnings"], json!([]));
}

/// The pixels of alpha 0 show what is behind.
#[test]
fn a_wrong_background_is_refused_with_the_right_one() {
    let work = with_pictures("");
    edit(&work, |c| c["background"] = json!([0.5, 0.5, 0.5]));
    refused(&work, WORDS, Code::Contradiction, &["alpha 0", "[0.5, 0.5, 0.5]", "\"background\": [1, 1, 1]"]);
    // Rendered on a transparent film, and nothing said: white is assumed.
    work.edit("cap", |_, film| film.rgba.iter_mut().for_each(|p| (p[0], p[1], p[2]) = (0.0, 0.0, 0.0)));
    edit(&work, |c| drop(c.as_object_mut().unwrap().remove("background")));
    refused(&work, WORDS, Code::Contradiction, &["\"background\": [0, 0, 0]", "transparent film"]);
    for words in ["reconstruct color cap -o x.vdb", "pose cap --volume @plume.vdb -o x.json"] {
        edit(&work, |c| c["model"] = json!("emission-absorption"));
        refused(&work, words, Code::Contradiction, &["\"background\": [0, 0, 0]"]);
    }
    refused(
        &work,
        "reconstruct tf cap --volume @plume.vdb -o x.tf.json",
        Code::Contradiction,
        &["\"background\": [0, 0, 0]"],
    );
    // With it stated, alpha alone tells the depths.
    edit(&work, |c| (c["background"], c["model"]) = (json!([0, 0, 0]), json!("absorption")));
    work.json(WORDS);
}

#[test]
fn without_alpha_the_borders_tell() {
    let work = with_pictures("");
    work.edit("cap", |_, film| film.rgba.iter_mut().for_each(|p| p[3] = 1.0));
    work.json(WORDS);
    std::fs::remove_file(work.path("x.vdb")).unwrap();
    edit(&work, |c| c["background"] = json!([0.5, 0.5, 0.5]));
    refused(&work, WORDS, Code::Contradiction, &["borders", "\"background\": [1, 1, 1]"]);
}

#[test]
fn what_is_no_light_is_refused() {
    let work = with_pictures("");
    let all = |change: fn(&mut [f32; 4])| {
        work.json("render @plume.vdb --views 12 --size 32x32 --density-scale auto -o cap");
        work.edit("cap", |_, film| film.rgba.iter_mut().for_each(change));
    };
    all(|p| *p = p.map(|v| -v));
    refused(&work, WORDS, Code::Contradiction, &["view_000.exr", "negative", "--layer"]);
    all(|p| *p = p.map(|v| 1e30 * v));
    refused(&work, WORDS, Code::Contradiction, &["view_000.exr", "1e30", "--layer"]);
    all(|p| *p = [f32::NAN; 4]);
    refused(&work, WORDS, Code::Contradiction, &["view_000.exr", "NaN"]);
    refused(&work, "pose cap --volume @plume.vdb -o x.json", Code::Contradiction, &["view_000.exr", "NaN"]);
    all(|p| p[3] += 40.0);
    refused(&work, WORDS, Code::Contradiction, &["view_000.exr", "alpha", "0 to 1"]);
}

/// Writes a picture of one channel in the place of a view.
fn channel(work: &Work, name: &str) {
    for i in 0..12 {
        let path = work.path(&format!("cap/view_{i:03}.exr"));
        let film = exr::read_picture(&path, None).unwrap();
        write_channels(&path, &film, name);
    }
}

fn write_channels(path: &std::path::Path, film: &Film, names: &str) {
    use ::exr::prelude::{
        AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, WritableImage,
    };
    let list: Vec<AnyChannel<FlatSamples>> = names
        .split(',')
        .enumerate()
        .map(|(c, name)| AnyChannel::new(name, FlatSamples::F32(film.rgba.iter().map(|p| p[c]).collect())))
        .collect();
    let layer = Layer::new(
        (film.width, film.height),
        LayerAttributes::default(),
        Encoding::default(),
        AnyChannels::sort(list.into()),
    );
    Image::from_layer(layer).write().to_file(path).unwrap();
}

#[test]
fn depths_alphas_and_pairs_are_no_colors() {
    for (names, expected) in [("Z", "depth"), ("A", "alpha alone"), ("R,G", "two channels")] {
        let work = with_pictures("");
        channel(&work, names);
        refused(&work, WORDS, Code::Invalid, &[expected, "colors are expected", "view_0"]);
        refused(&work, "pose cap --volume @plume.vdb -o x.json", Code::Invalid, &[expected]);
    }
}

#[test]
fn display_referred_pictures_are_warned_of() {
    let work = with_pictures("");
    work.edit("cap", |_, film| {
        film.rgba.iter_mut().for_each(|p| *p = p.map(|v| (255.0 * v.powf(1.0 / 2.2)).round() / 255.0));
    });
    warned(&work, WORDS, &["1/255", "scene-linear"]);
}

/// What every reconstruction says before its work, `validate` says of the capture alone.
#[test]
fn validate_compares_pictures_with_what_the_capture_states() {
    let work = with_pictures("");
    let checked = |code: i32| -> Value {
        let out = work.command("validate cap --json").output().unwrap();
        assert_eq!(out.status.code(), Some(code), "{}{}", errors(&out), String::from_utf8_lossy(&out.stdout));
        serde_json::from_slice::<Value>(&out.stdout).unwrap()["files"][0]["findings"].clone()
    };
    assert_eq!(checked(0), json!([]));
    edit(&work, |c| c["background"] = json!([0.5, 0.5, 0.5]));
    let found = checked(0);
    assert!(found[0]["severity"] == "warning" && found.to_string().contains("[1, 1, 1]"), "{found}");
    edit(&work, |c| c["background"] = json!([1, 1, 1]));
    work.edit("cap", |_, film| {
        film.rgba.iter_mut().for_each(|p| *p = p.map(|v| (255.0 * v.powf(1.0 / 2.2)).round() / 255.0));
    });
    let found = checked(0);
    assert!(found.as_array().unwrap().iter().all(|f| f["severity"] == "warning"), "{found}");
    assert!(found.to_string().contains("display-referred"), "{found}");
}

/// Findings of `validate` about the capture.
fn validated(work: &Work) -> Value {
    work.json("validate cap")["files"][0]["findings"].clone()
}

/// Sunlit smoke, and the same that is said to shine: its light depends on the view.
#[test]
fn scattered_light_is_called_by_its_name() {
    let work = with_pictures("--albedo 0.95 --sun 1,1,2 --sun-color 3 --samples 64");
    let found = validated(&work);
    assert!(found[0]["severity"] == "note" && found.as_array().unwrap().len() == 1, "{found}");
    assert!(found.to_string().contains("reconstruct density") && found.to_string().contains("reconstruct color"));
    edit(&work, |c| {
        c["model"] = json!("emission-absorption");
        c["emission"] = json!([1, 1, 1]);
    });
    let found = validated(&work).to_string();
    assert!(found.contains("another one in each view") && found.contains(r#"\"model\": \"scattering\""#), "{found}");
}

/// Smoke under a sky that looks alike from all sides. Alpha tells its densities. No emission is advised that its colors
/// contradict, and one that is stated all the same is not believed.
#[test]
fn scattered_light_leaves_the_densities_to_alpha() {
    let work = with_pictures("--albedo 0.8 --sky 0.5,0.7,1 --background 0,0,0 --samples 64");
    let out = work.command(WORDS).arg("--report").arg("page").output().unwrap();
    assert!(out.status.success() && errors(&out).contains("alpha tells"), "{}", errors(&out));
    assert!(!errors(&out).contains("warning"), "{}", errors(&out));
    let truth = work.volume_psnr("x.vdb");
    let colors = work.command("reconstruct color cap -o y.vdb --resolution 12 --iterations 2").output().unwrap();
    assert!(colors.status.success() && errors(&colors).contains("scattered light"), "{}", errors(&colors));
    work.refused(
        "reconstruct tf cap --volume @plume.vdb -o x.tf.json",
        Code::Unsupported,
        &["scattered light", "reconstruct density"],
    );
    edit(&work, |c| (c["model"], c["emission"]) = (json!("emission-absorption"), json!([1, 1, 1])));
    for _ in 0..2 {
        let found = validated(&work);
        let what = found[0]["what"].as_str().unwrap();
        assert!(what.contains("no one emission") && !found.to_string().contains("state \\\"emission"), "{found}");
        // The mean of what they imply is no remedy.
        let start = what.find("pixel, ").unwrap() + 7;
        let mean: Value = serde_json::from_str(&what[start..what.find(" on average").unwrap()]).unwrap();
        edit(&work, |c| c["emission"] = mean);
    }
    warned(&work, WORDS, &["no one emission"]);
    assert!(truth > 30.0 && truth > work.volume_psnr("x.vdb") + 5.0, "{truth} {}", work.volume_psnr("x.vdb"));
    work.edit("cap", |_, film| film.rgba.iter_mut().for_each(|pixel| pixel[3] = 1.0));
    edit(&work, |c| c["model"] = json!("scattering"));
    work.refused("reconstruct density cap -o z.vdb", Code::Invalid, &["alpha is 1 in all pixels"]);
}

/// The emission that a reconstruction looks for is no other than a capture's, which states none.
#[test]
fn an_emission_that_is_sought_contradicts_nothing() {
    let work = Work::new();
    work.json("render @plume.vdb --views 6 --size 24x24 --tf viridis --tf-range 0,0.3 --tf-extinction 20 -o cap");
    edit(&work, |c| drop(c.as_object_mut().unwrap().remove("transfer")));
    for words in [
        "reconstruct tf cap --volume @plume.vdb -o x.tf.json --texels 16 --rays 4000",
        "reconstruct color cap -o x.vdb --resolution 12 --iterations 4",
    ] {
        let report = work.json(words);
        assert!(!report["warnings"].to_string().contains("contradict"), "{words}: {}", report["warnings"]);
    }
    assert!(validated(&work).to_string().contains("no one emission"), "the densities do not follow from a grey medium");
}

/// A mask of half the opacity implies a negative emission, the same one in each view: no light depends on the view.
#[test]
fn an_alpha_that_is_too_small_is_not_taken_for_scattered_light() {
    let work = with_pictures("");
    work.edit("cap", |_, film| film.rgba.iter_mut().for_each(|pixel| pixel[3] *= 0.5));
    let found = work.json("validate cap")["files"][0]["findings"].to_string();
    assert!(found.contains("alpha and colors contradict") && found.contains("alpha is a mask"), "{found}");
    assert!(!found.contains("scattered") && !found.contains("in each view"), "{found}");
}

/// What follows from a wrong background is not told beside it.
#[test]
fn a_wrong_background_is_one_contradiction() {
    let work = with_pictures("");
    edit(&work, |c| c["background"] = json!([0, 0, 0]));
    let report = work.json("validate cap");
    let findings = report["files"][0]["findings"].as_array().unwrap();
    assert!(findings.len() == 1 && findings[0]["what"].to_string().contains("background"), "{findings:?}");
}

/// Absorbers that are stated to shine: the emission that they imply is zero in each view, but for rounding.
#[test]
fn absorbers_are_told_from_emitters() {
    let work = with_pictures("");
    edit(&work, |c| c["model"] = json!("emission-absorption"));
    let found = work.json("validate cap")["files"][0]["findings"].to_string();
    assert!(
        found.contains("emission [0, 0, 0], the capture says") && found.contains(r#"\"model\": \"absorption\""#),
        "{found}"
    );
    assert!(!found.contains("scattered"), "{found}");
}

/// Bright emission, stated a hundred times brighter: densities follow that are a hundred times too small.
#[test]
fn a_wrong_emission_is_warned_of_with_the_right_one() {
    let work = with_pictures("--model emission-absorption --emission 1");
    edit(&work, |c| c["emission"] = json!([100, 100, 100]));
    let report = warned(&work, &format!("{WORDS} --report page"), &["emission", "[1, 1, 1]", "alpha"]);
    assert!(report["warnings"].as_array().unwrap().len() > 1, "before the work and after it: {report}");
    let page = std::fs::read_to_string(work.path("page/index.html")).unwrap();
    assert!(page.contains("Warnings") && page.contains("[1, 1, 1]"));
}

#[test]
fn damaged_cameras_are_refused_at_once() {
    let damaged = |change: fn(&mut Value)| {
        let work = with_pictures("");
        edit(&work, change);
        work
    };
    let moved = damaged(|c| c["frames"][4]["transform_matrix"][2][3] = json!(1834.0));
    refused(&moved, WORDS, Code::Contradiction, &["view_004.exr", "nothing in common", "transform_matrix"]);
    let near = damaged(|c| {
        let z = &mut c["frames"][0]["transform_matrix"][0][3];
        *z = json!(10.0 * z.as_f64().unwrap() + 20.0);
    });
    refused(&near, WORDS, Code::Contradiction, &["view_000.exr", "nothing in common"]);
    let squeezed = damaged(|c| c["fl_y"] = json!(0.15 * c["fl_x"].as_f64().unwrap()));
    refused(&squeezed, WORDS, Code::Contradiction, &["fl_x", "fl_y", "as long as wide"]);
    let shifted = damaged(|c| c["cx"] = json!(1600));
    refused(&shifted, WORDS, Code::Contradiction, &["cameras"]);
    let far = damaged(|c| {
        for frame in c["frames"].as_array_mut().unwrap() {
            for row in 0..3 {
                let at = &mut frame["transform_matrix"][row][3];
                *at = json!(at.as_f64().unwrap() + 1e12);
            }
        }
    });
    refused(&far, WORDS, Code::Contradiction, &["origin"]);
}

/// The coarsest levels have voxels larger than the pictures' halves are wide.
#[test]
fn fine_voxels_are_met_by_rays() {
    let work = Work::new();
    work.json("render @plume.vdb --views 6 --size 16x16 --density-scale auto -o cap");
    let out = work.command("reconstruct density cap -o x.vdb --resolution 160 --iterations 1").output().unwrap();
    assert_eq!(out.status.code(), Some(0), "{}", errors(&out));
}

#[test]
fn small_scenes_work_or_are_refused_before_the_work() {
    let scaled = |by: f64| {
        let work = with_pictures("");
        edit(&work, |c| {
            for frame in c["frames"].as_array_mut().unwrap() {
                for row in 0..3 {
                    let at = &mut frame["transform_matrix"][row][3];
                    *at = json!(by * at.as_f64().unwrap());
                }
            }
            c["density_scale"] = json!(c["density_scale"].as_f64().unwrap() / by);
        });
        work
    };
    // The lattice was forgotten.
    refused(&scaled(1e-12), WORDS, Code::Invalid, &["lattice", "--voxel-size"]);
    let small = scaled(1e-6);
    let out = small.command(&format!("{WORDS} --resolution 16")).output().unwrap();
    match out.status.code() {
        Some(0) => assert!(small.path("x.vdb").exists()),
        Some(2) => assert!(errors(&out).contains("voxels") && !errors(&out).contains("expected:"), "{}", errors(&out)),
        other => panic!("{other:?}: {}", errors(&out)),
    }
}

#[test]
fn the_cost_is_said_first_and_holds() {
    let work = with_pictures("");
    for (words, solver) in [
        (WORDS, "cg"),
        ("reconstruct color cap -o y.vdb", "color"),
        ("reconstruct density cap -o z.vdb --solver weiss2021 --iterations 2", "paper"),
    ] {
        if solver == "color" {
            edit(&work, |c| c["model"] = json!("emission-absorption"));
        }
        let out = work.command(words).arg("--json").output().unwrap();
        assert_eq!(out.status.code(), Some(0), "{}", errors(&out));
        assert!(errors(&out).contains("expected: about"), "{}", errors(&out));
        let report: Value = serde_json::from_slice(&out.stdout).unwrap();
        let expected = &report["expected"];
        let (memory, peak) = (expected["memory_mb"].as_f64().unwrap(), report["peak_memory_mb"].as_f64().unwrap());
        assert!(memory >= peak, "{solver}: {memory} MB expected, {peak} MB used");
        assert!(expected["unknowns"].as_u64().unwrap() > 0 && expected["seconds"].as_f64().unwrap() > 0.0);
    }
    std::fs::remove_file(work.path("x.vdb")).unwrap();
    edit(&work, |c| c["model"] = json!("absorption"));
    refused(
        &work,
        "reconstruct density cap -o x.vdb --max-memory 112M --resolution 400",
        Code::MemoryLimit,
        &["112 MB are allowed", "--voxel-size"],
    );
}

#[test]
fn options_beyond_reason_are_refused() {
    let work = Work::new();
    work.refused("render @plume.vdb --views 1 -o cap --background 1e308", Code::Usage, &["1e308", "brighter"]);
    work.refused("render @plume.vdb --views 1 -o cap --fov 1e-300", Code::Usage, &["1e-300", "too small"]);
}

/// What is differentiated is said, and how much of it was checked.
#[test]
fn checks_say_how_many_they_are_of() {
    let work = Work::new();
    let words = "gradient @plume.vdb --views 1 --size 8x8 --loss mean --wrt density --largest 40 --check";
    let out = work.command(words).output().unwrap();
    let text = String::from_utf8_lossy(&out.stdout).into_owned();
    assert!(errors(&out).contains("check: 24 of") && errors(&out).contains("--all"), "{}", errors(&out));
    assert!(text.contains("24 of") && text.contains("parameters checked"), "{text}");
    let report = work.json(words);
    let differences = report["rows"].as_array().unwrap().iter().filter(|r| r["difference"].is_number()).count();
    assert_eq!((report["checked"].as_u64(), differences), (Some(24), 24));
    assert_eq!(work.json(&format!("{words} --all"))["checked"], 40);
}
