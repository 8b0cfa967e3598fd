//! `cumulo denoise`, `cumulo motion`, and `cumulo compare` of sequences, as a user calls them.

use crate::common::work::{Work, errors, fixture, write_exr};
use cumulo::error::Code;
use cumulo::formats::exr::{self, Document};
use cumulo::formats::limits::Limits;
use cumulo::scene::film::Film;
use serde_json::Value;
use std::path::Path;

const SIZE: &str = "40x32";

/// Twelve noisy frames along a ring of cameras in `noisy`, and the same with many paths in `true`.
fn sequence() -> Work {
    let work = Work::new();
    std::fs::copy(fixture("plume.vdb"), work.path("smoke.vdb")).unwrap();
    work.json(&format!("render smoke.vdb --views 180 --layout ring --size {SIZE} --density-scale auto -o path"));
    let lit = "--frames 0-11 --cameras path --albedo 0.9 --sun 1,-1,2 --sky 0.1,0.15,0.3 --background 0,0,0";
    work.json(&format!("render smoke.vdb {lit} --samples 2 --aov motion,halves -o noisy"));
    work.json(&format!("render smoke.vdb {lit} --samples 256 --seed 9 -o true"));
    work
}

fn document(path: &Path) -> Document {
    Document::read(path, Limits::default()).unwrap()
}

/// Samples of a channel of the unnamed layer or of another.
fn plane(document: &Document, layer: &str, component: &str) -> Vec<f32> {
    let layer = document.layer(Some(layer)).unwrap();
    document.samples(layer.part, document.component(&layer, component).unwrap()).into_owned()
}

fn colors(work: &Work, name: &str) -> Vec<[f32; 4]> {
    exr::read_picture(&work.path(name), None).unwrap().rgba
}

fn psnr(work: &Work, folder: &str) -> [f64; 2] {
    let out = work.command(&format!("compare {folder}/frame.####.exr true/frame.####.exr --json")).output().unwrap();
    assert_eq!(out.status.code(), Some(1), "{}", errors(&out));
    let report: Value = serde_json::from_slice(&out.stdout).unwrap();
    ["psnr_db", "flicker_psnr_db"].map(|key| report[key].as_f64().unwrap())
}

/// Denoised frames are nearer to the converged ones and flicker less, by every method; all else in the files is as it was.
#[test]
fn noise_goes_and_all_else_passes_through() {
    let work = sequence();
    let before = psnr(&work, "noisy");
    for (method, least) in [
        ("wrls2", [5.0, 14.0]),
        ("wrls", [3.0, 9.0]),
        ("rls", [3.0, 7.0]),
        ("svgf", [-2.0, 12.0]),
        ("ema", [4.0, 10.0]),
    ] {
        let report = work.json(&format!(
            "denoise noisy/frame.####.exr -o {method}/frame.####.exr --method {method} --confidence --history 0.8"
        ));
        assert_eq!((&report["denoised"], &report["at_rest"]), (&Value::from(12), &Value::from(false)));
        let after = psnr(&work, method);
        println!("{method}: {before:.2?} -> {after:.2?}");
        assert!((0..2).all(|i| after[i] > before[i] + least[i]), "{method}: {before:?} {after:?}");
        let [noisy, denoised] =
            ["noisy", method].map(|folder| document(&work.path(&format!("{folder}/frame.0005.exr"))));
        for (layer, component) in [("Vector", "X"), ("half_a", "G"), ("half_b", "B"), ("", "A")] {
            assert_eq!(plane(&noisy, layer, component), plane(&denoised, layer, component), "{method} {layer}");
        }
        let (own, mut kept) = (noisy.header().attributes(), denoised.header().attributes());
        assert!(kept.remove("cumulo:denoise").unwrap().contains("cumulo denoise"));
        assert_eq!(kept.remove("cumulo:denoise-settings").unwrap().len(), 64);
        assert!(kept.remove("cumulo:denoise-input").unwrap().contains("noisy/frame.0005.exr sha256:"));
        assert_eq!(own, kept);
        assert!(plane(&denoised, "confidence", "N").iter().all(|n| *n > 0.0), "{method}");
    }
}

/// Frames that are missing, damaged, of another size or partly missing are named, and the others go on.
#[test]
fn bad_frames_do_not_stop_the_others() {
    let work = sequence();
    std::fs::remove_file(work.path("noisy/frame.0003.exr")).unwrap();
    let bytes = std::fs::read(work.path("noisy/frame.0005.exr")).unwrap();
    std::fs::write(work.path("noisy/frame.0005.exr"), &bytes[..bytes.len() / 2]).unwrap();
    let small = Film::of(8, 8, vec![[0.5, 0.5, 0.5, 1.0]; 64]);
    exr::write_picture(&work.path("noisy/frame.0007.exr"), &small, &exr::Attributes::new(), exr::Half::None).unwrap();
    let mut holes = document(&work.path("noisy/frame.0009.exr"));
    let layer = holes.layer(None).unwrap();
    let [red, ..] = holes.colors(&layer).unwrap();
    let mut samples = holes.samples(layer.part, red).into_owned();
    samples[100..150].fill(f32::NAN);
    holes.replace(layer.part, red, samples.into_iter());
    holes.write(&work.path("noisy/frame.0009.exr")).unwrap();

    let command = "denoise noisy/frame.####.exr -o out/frame.####.exr --frames 0-11 --motion none";
    let out = work.command(command).arg("--json").output().unwrap();
    assert_eq!(out.status.code(), Some(2), "{}", errors(&out));
    let report: Value = serde_json::from_slice(&out.stdout).unwrap();
    let failed: Vec<u64> = report["failed"].as_array().unwrap().iter().map(|f| f["frame"].as_u64().unwrap()).collect();
    assert_eq!((failed, &report["denoised"], &report["filled"]), (vec![3, 5, 7], &Value::from(9), &Value::from(50)));
    for (number, what) in [(3, "frame.0003.exr"), (5, "frame.0005.exr"), (7, "8x8 pixels")] {
        assert!(errors(&out).contains(&format!("frame {number}")) && errors(&out).contains(what), "{}", errors(&out));
    }
    // Without a range a hole is named as well.
    let again =
        work.command(&command.replace("--frames 0-11 ", "").replace("out/", "again/")).arg("-q").output().unwrap();
    assert_eq!(again.status.code(), Some(2), "{}", errors(&again));
    assert!(errors(&again).contains("frame 3: ") && errors(&again).contains("frame.0003.exr"), "{}", errors(&again));
    for number in [0, 1, 2, 4, 6, 8, 9, 10, 11] {
        let rgba = colors(&work, &format!("out/frame.{number:04}.exr"));
        assert!(rgba.iter().flatten().all(|v| v.is_finite()), "{number}");
    }
    assert!(!work.path("out/frame.0003.exr").exists() && !work.path("out/frame.0007.exr").exists());
}

/// A range, chunks and what is resumed are near to the whole sequence; a whole one is the same for any number of threads.
#[test]
fn parts_agree_with_the_whole() {
    let work = sequence();
    let command = "denoise noisy/frame.####.exr";
    work.json(&format!("{command} -o whole/frame.####.exr --threads 1"));
    work.json(&format!("{command} -o again/frame.####.exr --threads 5"));
    work.json(&format!("{command} -o chunks/frame.####.exr --chunk 4 --overlap 3"));
    work.json(&format!("{command} -o range/frame.####.exr --frames 4-7 --overlap 3"));
    for number in 0..12 {
        let name = |folder: &str| format!("{folder}/frame.{number:04}.exr");
        let whole = colors(&work, &name("whole"));
        assert_eq!(whole, colors(&work, &name("again")), "{number}");
        let chunk = colors(&work, &name("chunks"));
        let square = |(p, q): (&[f32; 4], &[f32; 4])| (0..3).map(|c| f64::from(p[c] - q[c]).powi(2)).sum::<f64>();
        let rms = (whole.iter().zip(&chunk).map(square).sum::<f64>() / (3 * whole.len()) as f64).sqrt();
        println!("{number}: rms {rms:.5}");
        // Few frames are learned from: near to the whole, and not the same.
        assert!(rms > 0.0 && rms < 5e-3, "{number}: {rms}");
        match work.path(&name("range")).exists() {
            true => assert_eq!(chunk, colors(&work, &name("range")), "{number}"),
            false => assert!(!(4..8).contains(&number)),
        }
    }
    std::fs::remove_file(work.path("chunks/frame.0006.exr")).unwrap();
    let resumed = work.json(&format!("{command} -o chunks/frame.####.exr --chunk 4 --overlap 3 --resume"));
    assert_eq!((&resumed["denoised"], &resumed["skipped"]), (&Value::from(1), &Value::from(11)));
    // Another command's pictures are not replaced unless that is asked for.
    let other = format!("{command} -o whole/frame.####.exr --method ema");
    let out = work.command(&other).output().unwrap();
    assert_eq!(out.status.code(), Some(2));
    assert!(errors(&out).contains("another command") && errors(&out).contains("--overwrite"), "{}", errors(&out));
    work.json(&format!("{other} --overwrite"));
    // Neither are the noisy ones, by whatever name.
    let out = work.command(&format!("{command} -o noisy/frame.%04d.exr --overwrite")).output().unwrap();
    assert_eq!(out.status.code(), Some(2));
    assert!(errors(&out).contains("input"), "{}", errors(&out));
}

/// Motion from the volume and the cameras is the renderer's, and denoises as well as its layer.
#[test]
fn motion_comes_from_volume_and_cameras() {
    let work = sequence();
    let scale =
        work.json("render smoke.vdb --cameras path --frames 0 --aov optical-depth -o scale")["density_scale"].clone();
    let report = work.json("motion smoke.vdb --cameras path --frames 0-11 --samples 64 -o motion/m.####.exr");
    assert_eq!((&report["frames"], &report["density_scale"]), (&Value::from(12), &scale));
    assert!(report["largest"].as_f64().unwrap() > 0.2);
    let [own, layer] = ["motion/m.0004.exr", "noisy/frame.0004.exr"].map(|name| document(&work.path(name)));
    let [mut apart, mut all] = [0.0, 0.0];
    for component in ["X", "Y", "Z", "W"] {
        for (a, b) in plane(&own, "Vector", component).iter().zip(&plane(&layer, "Vector", component)) {
            if *b != 0.0 && *a != 0.0 {
                apart += f64::from((a - b).abs());
                all += f64::from(b.abs());
            }
        }
    }
    // The layer has two paths a pixel, each of a sequence of its own.
    assert!(apart < 0.45 * all, "{apart} of {all}");
    work.json("denoise noisy/frame.####.exr -o a/frame.####.exr");
    work.json("denoise noisy/frame.####.exr -o b/frame.####.exr --motion files:motion/m.####.exr");
    let [a, b] = ["a", "b"].map(|folder| psnr(&work, folder));
    assert!(b[0] > a[0] - 0.5 && b[1] > a[1] - 0.5, "{a:?} {b:?}");
    // The denoiser traces it as well.
    work.json("motion smoke.vdb --cameras path --frames 0-11 -o traced/m.####.exr");
    work.json("denoise noisy/frame.####.exr -o c/frame.####.exr --motion files:traced/m.####.exr");
    work.json("denoise noisy/frame.####.exr -o d/frame.####.exr --motion vdb:smoke.vdb,path");
    for number in 0..12 {
        let [c, d] = ["c", "d"].map(|folder| colors(&work, &format!("{folder}/frame.{number:04}.exr")));
        assert_eq!(c, d, "{number}");
    }
    // Resumed, a frame whose motion has changed is denoised again.
    let command = "denoise noisy/frame.####.exr -o c/frame.####.exr --motion files:traced/m.####.exr --resume";
    let whole = work.json(command);
    assert_eq!((&whole["skipped"], &whole["renewed"]), (&Value::from(12), &Value::Null));
    std::fs::copy(work.path("traced/m.0003.exr"), work.path("traced/m.0007.exr")).unwrap();
    let changed = work.json(command);
    assert_eq!((&changed["denoised"], &changed["skipped"]), (&Value::from(1), &Value::from(11)));
    assert_eq!(changed["renewed"], serde_json::json!([{"input": "traced/m.0007.exr", "frames": [7]}]));
    let traced = "denoise noisy/frame.####.exr -o d/frame.####.exr --motion vdb:smoke.vdb,path --resume";
    assert_eq!(work.json(traced)["skipped"], 12);
    std::fs::write(
        work.path("path/transforms.json"),
        std::fs::read_to_string(work.path("path/transforms.json")).unwrap() + "\n",
    )
    .unwrap();
    let text = work.text(traced);
    assert!(text.contains("made again, since path/transforms.json has changed: 0-11"), "{text}");
    // Where there is none, the picture counts as at rest, and that is said.
    std::fs::create_dir(work.path("plain")).unwrap();
    for number in 0..3 {
        let film = exr::read_picture(&work.path(&format!("noisy/frame.{number:04}.exr")), None).unwrap();
        let to = work.path(&format!("plain/f.{number:04}.exr"));
        exr::write_picture(&to, &film, &exr::Attributes::new(), exr::Half::All).unwrap();
    }
    let out = work.command("denoise plain/f.####.exr -o quiet/f.####.exr").output().unwrap();
    assert_eq!(out.status.code(), Some(0), "{}", errors(&out));
    assert!(errors(&out).contains("at rest") && errors(&out).contains("cumulo motion"), "{}", errors(&out));
    // Half floats stay half floats.
    let header = exr::header(&work.path("quiet/f.0001.exr")).unwrap();
    assert!(header.parts[0].channels.iter().all(|channel| channel.sample_type == exr::SampleType::Half));
}

/// A cut resets what was learned, in both directions of time.
#[test]
fn cuts_are_found() {
    let work = Work::new();
    std::fs::create_dir(work.path("in")).unwrap();
    for number in 0..12_usize {
        let pixel = |i: usize| {
            let (x, y) = (i % 32, i / 32);
            let lit = if number < 6 { x < 12 } else { x > 20 };
            let noise = ((i * 7919 + number * 104_729) % 97) as f32 / 48.0;
            let v = if lit { noise * (1.0 + y as f32 / 24.0) } else { 0.0 };
            [v, v, 0.5 * v, 1.0]
        };
        let film = Film::of(32, 24, (0..32 * 24).map(pixel).collect());
        let path = work.path(&format!("in/f.{:04}.exr", number + 100));
        exr::write_picture(&path, &film, &exr::Attributes::new(), exr::Half::None).unwrap();
    }
    let report = work.json("denoise in/f.####.exr -o out/f.####.exr");
    assert_eq!(report["cuts"], serde_json::json!([106]));
    for (number, dark) in [(105, 26), (106, 6)] {
        let rgba = colors(&work, &format!("out/f.{number:04}.exr"));
        assert!(rgba[12 * 32 + dark][0] < 0.02, "{number}: {:?}", rgba[12 * 32 + dark]);
    }
}

/// Layouts for other programs hold the same motion: Nuke's both ways from now, and Cycles' backward motion with the depth,
/// which changes by what a camera goes along its axis.
#[test]
fn motion_is_written_for_other_programs() {
    let work = Work::new();
    let frame = |number: u32| {
        let at = 5.0 + 0.25 * f64::from(number);
        serde_json::json!({"file_path": format!("frame.{number:04}.exr"),
            "transform_matrix": [[1, 0, 0, 1.0], [0, 1, 0, 1.0], [0, 0, 1, at], [0, 0, 0, 1]]})
    };
    let frames: Vec<Value> = (1..4).map(frame).collect();
    let capture = serde_json::json!({"w": 16, "h": 12, "fl_x": 20.0, "near": 0.0, "frames": frames});
    std::fs::write(work.path("path.json"), capture.to_string()).unwrap();
    let words = "motion @plume.vdb --cameras path.json --density-scale 20";
    for format in ["blender", "nuke", "oidn"] {
        work.json(&format!("{words} --format {format} -o {format}/m.####.exr"));
    }
    for number in 1..4 {
        let [blender, nuke, oidn] =
            ["blender", "nuke", "oidn"].map(|name| document(&work.path(&format!("{name}/m.{number:04}.exr"))));
        let vector = ["X", "Y", "Z", "W"].map(|name| plane(&blender, "Vector", name));
        let turned = |v: &[f32]| v.iter().map(|v| 0.0 - v).collect::<Vec<_>>();
        assert_eq!([&vector[0], &vector[1]], [&plane(&nuke, "backward", "u"), &plane(&nuke, "backward", "v")]);
        assert_eq!(
            [turned(&vector[2]), turned(&vector[3])],
            [plane(&nuke, "forward", "u"), plane(&nuke, "forward", "v")]
        );
        let [x, y, z] = ["X", "Y", "Z"].map(|name| plane(&oidn, "Denoising Backward Motion", name));
        assert_eq!([&vector[0], &vector[1]], [&x, &y]);
        // The camera goes away from what it sees, so that it was nearer before.
        let expected = if number == 1 { 0.0 } else { -0.25 };
        assert!(z.iter().all(|z| (z - expected).abs() < 1e-5 || *z == 0.0), "{number}: {z:?}");
        assert!(number == 1 || z.iter().filter(|z| **z != 0.0).count() > 20);
    }
    let lit = "--albedo 0.9 --sun 0,0,1 --sky 0.2 --samples 4 --frames 1-3 --density-scale 20";
    work.json(&format!("render @plume.vdb --cameras path.json {lit} --aov motion,backward-motion -o both"));
    let both = document(&work.path("both/frame.0002.exr"));
    assert_eq!(plane(&both, "Vector", "X"), plane(&both, "Denoising Backward Motion", "X"));
}

/// The alpha of a motion is that of the pictures, by the transfer function of the capture or of `--tf`, by a scene file and by a
/// stage; one that contradicts the pictures is found, and does not guide.
#[test]
fn motion_knows_the_medium() {
    let work = Work::new();
    std::fs::copy(fixture("plume.vdb"), work.path("smoke.vdb")).unwrap();
    let points = serde_json::json!([
        [0.1, 1, 0, 0, 0],
        [0.3, 1, 0, 0, 9],
        [0.5, 1, 1, 0, 0],
        [0.7, 0, 0, 1, 0],
        [1, 1, 1, 1, 6]
    ]);
    let function = serde_json::json!({"format": "cumulo-transfer-function", "version": 1,
        "transfer": {"kind": "piecewise", "points": points}});
    std::fs::write(work.path("peaks.tf.json"), function.to_string()).unwrap();
    work.json("render smoke.vdb --views 180 --layout ring --size 64x48 --density-scale 1 -o path");
    work.json("render smoke.vdb --cameras path --frames 0-3 --tf peaks.tf.json -o shown");
    let scene = serde_json::json!({"volumes": [{"file": "smoke.vdb",
        "medium": {"density_scale": 1, "transfer": "peaks.tf.json"}}]});
    std::fs::write(work.path("scene.json"), scene.to_string()).unwrap();
    work.json("usd author scene.json -o stage.usda");
    let alpha = |name: &str| -> Vec<f32> { colors(&work, name).iter().map(|pixel| pixel[3]).collect() };
    let shown = alpha("shown/frame.0002.exr");
    for (input, folder) in [
        ("smoke.vdb --cameras shown", "own"),
        ("smoke.vdb --cameras path --tf peaks.tf.json", "given"),
        ("scene.json --cameras path", "scene"),
        ("stage.usda --cameras path", "stage"),
        ("smoke.vdb --cameras path", "without"),
    ] {
        let report = work.json(&format!("motion {input} --frames 0-3 --samples 64 -o {folder}/m.####.exr"));
        let states = !["scene", "stage"].contains(&folder);
        assert_eq!(report["density_scale"], if states { Value::from(1.0) } else { Value::Null });
        assert!(report["largest"].as_f64().unwrap() > 0.2, "{folder}: {report}");
        let film = alpha(&format!("{folder}/m.0002.exr"));
        let squares = film.iter().zip(&shown).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
        let apart = (squares / shown.len() as f64).sqrt();
        println!("{folder}: {apart:.4}");
        assert_eq!(apart < 0.03, folder != "without", "{folder}: {apart}");
        assert!(colors(&work, &format!("{folder}/m.0002.exr")).iter().all(|p| p[..3] == [0.0; 3]), "{folder} shines");
        let command = format!(
            "denoise shown/frame.####.exr --motion files:{folder}/m.####.exr -o quiet-{folder}/f.####.exr --json"
        );
        let out = work.command(&command).output().unwrap();
        let report: Value = serde_json::from_slice(&out.stdout).unwrap();
        assert_eq!(report["alpha_contradicts"], Value::from(folder == "without"), "{folder}");
        assert_eq!(errors(&out).contains("--tf"), folder == "without", "{}", errors(&out));
    }
    work.refused(
        "motion scene.json --cameras path --frames 0-3 --tf peaks.tf.json -o no/m.####.exr",
        Code::Invalid,
        &["--tf", "scene.json"],
    );
    work.refused(
        "motion stage.usda --cameras path --frames 0-3 --grid heat -o no/m.####.exr",
        Code::Invalid,
        &["--grid", "stage.usda"],
    );
    work.refused(
        "motion shown/frame.0002.exr --cameras path --frames 0-3 -o no/m.####.exr",
        Code::Invalid,
        &["frame.0002.exr", "picture"],
    );
}

/// Sequences are compared frame by frame; what does not fit says so.
#[test]
fn sequences_are_compared() {
    let work = sequence();
    let report = work.command("compare noisy/frame.####.exr noisy/frame.%04d.exr --flip --json").output().unwrap();
    assert_eq!(report.status.code(), Some(0), "{}", errors(&report));
    let report: Value = serde_json::from_slice(&report.stdout).unwrap();
    assert_eq!(
        (&report["psnr_db"], &report["flip"], &report["differ"]),
        (&Value::Null, &Value::from(0.0), &Value::from(false))
    );
    std::fs::remove_file(work.path("true/frame.0004.exr")).unwrap();
    let out = work.command("compare noisy/frame.####.exr true/frame.####.exr --flip --json").output().unwrap();
    let report: Value = serde_json::from_slice(&out.stdout).unwrap();
    let frames = report["frames"].as_array().unwrap();
    let failed: Vec<&Value> = report["failed"].as_array().unwrap().iter().map(|failed| &failed["frame"]).collect();
    assert_eq!((out.status.code(), frames.len(), failed), (Some(2), 11, vec![&Value::from(4)]));
    // The first frame, and the one behind the gap, follow none.
    let flickers: Vec<bool> = frames.iter().map(|f| f["flicker_psnr_db"].is_number()).collect();
    assert_eq!(flickers.iter().filter(|number| **number).count(), 9);
    assert!(frames.iter().all(|f| (0.0..1.0).contains(&f["flip"].as_f64().unwrap())));
    // The page shows them, with what stands beside.
    work.json("denoise noisy/frame.####.exr -o quiet/frame.####.exr");
    let words = "compare quiet/frame.####.exr true/frame.####.exr --beside noisy/frame.####.exr --report page --json";
    let out = work.command(words).output().unwrap();
    let pair: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!((&pair["beside"]["psnr_db"], &pair["report"]), (&report["psnr_db"], &Value::from("page/index.html")));
    assert!(pair["psnr_db"].as_f64() > pair["beside"]["psnr_db"].as_f64());
    let page = std::fs::read_to_string(work.path("page/index.html")).unwrap();
    for what in ["the furthest apart", "PSNR of the change", "relMSE", "noisy/frame.####.exr", "Provenance"] {
        assert!(page.contains(what), "{what}");
    }
    for (words, what) in [
        ("compare noisy/frame.0001.exr noisy/frame.0002.exr --report page", "for sequences"),
        ("compare noisy/frame.####.exr true/frame.####.exr --beside noisy/frame.0001.exr", "names no sequence"),
        ("compare noisy/frame.####.exr nothing/frame.####.exr", "nothing"),
        ("compare noisy/frame.####.exr true/frame.####.exr --heatmap a.png", "--heatmap"),
        ("denoise noisy/frame.0001.exr -o out.####.exr", "frame.0001.exr is one picture"),
        ("denoise noisy/frame.####.exr -o out.exr", "the noisy frames are a sequence"),
        ("denoise noisy/frame.0001.exr -o out/f.exr --frames 1", "--frames"),
        ("denoise noisy -o out/f.exr", "this is a folder"),
        ("denoise noisy/frame.####.exr -o out.####.png", ".png"),
        ("denoise noisy/frame.####.exr -o out/f.####.exr --layers nonsense", "nonsense"),
        ("denoise noisy/frame.####.exr -o out/f.####.exr --motion layer:half_a", "X and Y"),
        ("denoise noisy/frame.####.exr -o out/f.####.exr --motion vdb:smoke.vdb", "transforms.json"),
        ("denoise noisy/frame.####.exr -o out/f.####.exr --motion vdb:nothing.vdb,path", "nothing.vdb"),
        ("denoise noisy/frame.####.exr -o out/f.####.exr --forgetting 1", "forgetting"),
        ("motion smoke.vdb --cameras path -o motion.exr", "place for the frame's number"),
        ("motion smoke.vdb --cameras path --frames 0-1 -o m.####.exr --grid nonsense", "nonsense"),
    ] {
        let out = work.command(words).output().unwrap();
        assert_eq!(out.status.code(), Some(2), "{words}\n{}", errors(&out));
        assert!(errors(&out).contains(what), "{words}\n{}", errors(&out));
        assert!(!work.path("out").exists(), "{words}");
    }
}

/// Grey samples of a picture of 24x16 pixels that differ at random from frame to frame.
fn grain(seed: u32, mean: f32) -> Vec<f32> {
    let random = |i: u32| {
        let h = (i ^ seed.wrapping_mul(0x9E37_79B9)).wrapping_mul(0x85EB_CA6B);
        let h = (h ^ (h >> 13)).wrapping_mul(0xC2B2_AE35);
        ((h ^ (h >> 16)) >> 8) as f32 / (1 << 24) as f32
    };
    (0..24 * 16).map(|i| mean * (0.5 + random(i))).collect()
}

fn rms(samples: &[f32], mean: f32) -> f32 {
    (samples.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / samples.len() as f32).sqrt()
}

/// Frames tell the noise that came in and the error that is left, without a reference.
#[test]
fn what_is_left_is_told() {
    let work = Work::new();
    let (size, frames) = ([64, 48], 10);
    let random = |seed: u32, i: u32| {
        let h = (i ^ seed.wrapping_mul(0x9E37_79B9)).wrapping_mul(0x85EB_CA6B);
        let h = (h ^ (h >> 13)).wrapping_mul(0xC2B2_AE35);
        ((h ^ (h >> 16)) >> 8) as f32 / (1 << 24) as f32
    };
    let truth: Vec<f32> = (0..size[0] * size[1]).map(|i| 0.2 + 0.6 * random(999, i as u32)).collect();
    for frame in 0..frames {
        let noisy = truth.iter().zip(0..).map(|(v, i)| v + 0.1 * (random(frame, i) - 0.5)).collect::<Vec<_>>();
        let channels = ["R", "G", "B"].map(|c| (c, noisy.clone()));
        write_exr(&work.path(&format!("in.{frame:04}.exr")), size, &channels, |_, _| {});
    }
    let report = work.json("denoise in.####.exr -o out.####.exr --error");
    let estimate = &report["estimate"];
    let [noise, error, high] = ["noise", "error", "error_high"].map(|key| estimate[key].as_f64().unwrap());
    let mean_square = |frame: u32| {
        let found = plane(&document(&work.path(&format!("out.{frame:04}.exr"))), "", "G");
        let squares = found.iter().zip(&truth).map(|(a, b)| f64::from(a - b).powi(2));
        squares.sum::<f64>() / truth.len() as f64
    };
    let wanted = ((1..frames - 1).map(mean_square).sum::<f64>() / f64::from(frames - 2)).sqrt();
    println!("{wanted}: {estimate}");
    assert_eq!(estimate["frames"], frames - 2);
    assert!((noise / (0.1 / 12_f64.sqrt()) - 1.0).abs() < 0.03, "{noise}");
    assert!((error / wanted - 1.0).abs() < 0.1 && wanted < high && high < 1.2 * error, "{wanted}: {estimate}");
    let map = |frame: u32, layer: &str| plane(&document(&work.path(&format!("out.{frame:04}.exr"))), layer, "V");
    assert!(map(5, "noise").iter().all(|v| (0.02..0.04).contains(v)));
    assert!(map(5, "error").iter().all(|v| (0.003..0.03).contains(v)));
    assert!(map(0, "error").iter().all(|v| *v == -1.0));
    work.refused("denoise in.####.exr -o no.####.exr --error --method ema", Code::Invalid, &["--error", "wrls2"]);
    work.refused("denoise in.####.exr -o no.####.exr --error --direction forward", Code::Invalid, &["--error", "both"]);
}

/// Halves that are denoised apart tell the error of their mean, which is what is written, though the picture moves and
/// its motion is unknown.
#[test]
fn halves_tell_the_error_that_is_left() {
    let work = Work::new();
    let ([width, height], frames) = ([96, 64], 8_u32);
    let random = |seed: u32, i: u32| {
        let h = (i ^ seed.wrapping_mul(0x9E37_79B9)).wrapping_mul(0x85EB_CA6B);
        let h = (h ^ (h >> 13)).wrapping_mul(0xC2B2_AE35);
        ((h ^ (h >> 16)) >> 8) as f32 / (1 << 24) as f32
    };
    let truth = |frame: u32| -> Vec<f32> {
        let wave = |i: usize| 0.5 + 0.3 * (0.4 * (i % width) as f32 + 0.7 * frame as f32).sin();
        (0..width * height).map(wave).collect()
    };
    for frame in 0..frames {
        let half = |seed: u32| -> Vec<f32> {
            truth(frame).iter().zip(0..).map(|(v, i)| v + 0.2 * (random(seed + 2 * frame, i) - 0.5)).collect()
        };
        let [a, b] = [half(100), half(101)];
        let mean: Vec<f32> = a.iter().zip(&b).map(|(a, b)| 0.5 * (a + b)).collect();
        let layers = [("", mean), ("half_a.", a), ("half_b.", b)];
        let names: Vec<(String, &Vec<f32>)> =
            layers.iter().flat_map(|(layer, all)| ["R", "G", "B"].map(|c| (format!("{layer}{c}"), all))).collect();
        let channels: Vec<(&str, Vec<f32>)> = names.iter().map(|(name, all)| (&name[..], (*all).clone())).collect();
        write_exr(&work.path(&format!("in.{frame:04}.exr")), [width, height], &channels, |_, _| {});
    }
    let report = work.json("denoise in.####.exr -o out.####.exr --halves");
    let (mut sum, mut count) = (0.0, 0.0);
    for frame in 0..frames {
        let document = document(&work.path(&format!("out.{frame:04}.exr")));
        let [whole, a, b] = ["", "half_a", "half_b"].map(|layer| plane(&document, layer, "G"));
        assert!(whole.iter().zip(a.iter().zip(&b)).all(|(whole, (a, b))| *whole == 0.5 * (a + b)));
        sum += whole.iter().zip(truth(frame)).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
        count += whole.len() as f64;
    }
    let wanted = (sum / count).sqrt();
    let estimate = &report["estimate"];
    let [noise, error, high] = ["noise", "error", "error_high"].map(|key| estimate[key].as_f64().unwrap());
    println!("{wanted}: {estimate}");
    assert_eq!((&estimate["told_by"], &estimate["frames"]), (&Value::from("halves"), &Value::from(frames)));
    assert!((noise / (0.2 / 24_f64.sqrt()) - 1.0).abs() < 0.03, "{noise}");
    assert!((error / wanted - 1.0).abs() < 0.06 && wanted < high && high < 1.2 * error, "{wanted}: {estimate}");
    let still = work.json("denoise in.0003.exr -o still.exr --halves");
    assert_eq!((&still["estimate"]["told_by"], &still["estimate"]["frames"]), (&"halves".into(), &1.into()));

    write_exr(&work.path("bare.exr"), [width, height], &["R", "G", "B"].map(|c| (c, truth(0))), |_, _| {});
    work.refused("denoise bare.exr -o no.exr --halves", Code::NoSuchLayer, &["half_a", "--aov"]);
    let graded: Vec<(&str, Vec<f32>)> =
        ["R", "G", "B", "half_a.R", "half_a.G", "half_a.B", "half_b.R", "half_b.G", "half_b.B"]
            .map(|c| (c, truth(if c.len() > 1 { 1 } else { 0 })))
            .into();
    write_exr(&work.path("graded.exr"), [width, height], &graded, |_, _| {});
    work.refused("denoise graded.exr -o no.exr --halves", Code::Invalid, &["half_a", "render it again"]);
}

/// Each eye of stereo has its own history, and becomes what it would be alone.
#[test]
fn every_view_is_denoised() {
    let work = Work::new();
    let (left, right) = (0.4, 0.8);
    for frame in 0..6 {
        let [l, r] = [grain(frame, left), grain(100 + frame, right)];
        let colors =
            |prefix: &'static str, samples: &[f32]| ["R", "G", "B"].map(|c| (format!("{prefix}{c}"), samples.to_vec()));
        let write = |name: &str, channels: Vec<(String, Vec<f32>)>, views: &[&str]| {
            let channels: Vec<(&str, Vec<f32>)> = channels.iter().map(|(n, s)| (n.as_str(), s.clone())).collect();
            write_exr(&work.path(&format!("{name}.{frame:04}.exr")), [24, 16], &channels, |_, own| {
                let names = views.iter().map(|view| (*view).into()).collect::<Vec<_>>();
                own.multi_view_names = Some(names).filter(|names| !names.is_empty());
            });
        };
        let vector = ["X", "Y"].map(|c| (format!("Vector.{c}"), vec![0.0; l.len()]));
        let both = [colors("", &l), colors("right.", &r), colors("matte.", &l)].concat();
        write("stereo", both.clone(), &["left", "right"]);
        write("moving", [both, vector.to_vec()].concat(), &["left", "right"]);
        write("right", colors("", &r).to_vec(), &[]);
    }
    let report = work.json("denoise stereo.####.exr -o both.####.exr --confidence --error");
    assert_eq!((&report["denoised"], &report["cuts"]), (&Value::from(6), &serde_json::json!([])));
    work.json("denoise right.####.exr -o alone.####.exr");
    let [both, alone] = ["both.0003.exr", "alone.0003.exr"].map(|name| document(&work.path(name)));
    for (layer, mean) in [("", left), ("right", right)] {
        let left_over = rms(&plane(&both, layer, "G"), mean);
        // Uniform noise from half to one and a half of the mean has a deviation of 0.29 of it.
        assert!(left_over < 0.08 * mean, "'{layer}': {left_over}");
    }
    assert_eq!(plane(&both, "right", "R"), plane(&alone, "", "R"));
    assert_eq!(plane(&both, "matte", "R"), grain(3, left));
    assert_eq!(plane(&both, "confidence", "N").len(), plane(&both, "confidence.right", "N").len());
    for layer in ["noise", "noise.right", "error", "error.right"] {
        assert_eq!(plane(&both, layer, "V").len(), 24 * 16, "{layer}");
    }
    // What only one view has is refused by name, and so is motion of one view alone.
    work.refused(
        "denoise stereo.####.exr -o no.####.exr --layers matte",
        Code::Invalid,
        &["view 'right'", "'matte'", "--layers"],
    );
    work.refused(
        "denoise moving.####.exr -o no.####.exr",
        Code::Invalid,
        &["view 'right'", "layer 'Vector'", "--motion none"],
    );
    work.json("denoise moving.####.exr -o rest.####.exr --motion none");
    assert_eq!(plane(&document(&work.path("rest.0003.exr")), "right", "R"), plane(&both, "right", "R"));
}

/// A frame without a finite pixel was black, and a cut, with exit code 0.
#[test]
fn a_frame_of_nothing_but_nan_fails_by_name() {
    let work = Work::new();
    for frame in 0..6 {
        let mut samples = vec![0.5_f32; 24 * 16];
        match frame {
            2 => samples[30] = f32::INFINITY,
            3 => samples.fill(f32::NAN),
            _ => {}
        }
        let channels = ["R", "G", "B"].map(|c| (c, samples.clone()));
        write_exr(&work.path(&format!("in.{frame:04}.exr")), [24, 16], &channels, |_, _| {});
    }
    let out = work.command("denoise in.####.exr -o out.####.exr --json").output().unwrap();
    assert_eq!(out.status.code(), Some(2), "{}", errors(&out));
    let report: Value = serde_json::from_slice(&out.stdout).unwrap();
    let failed = report["failed"].as_array().unwrap();
    assert_eq!((failed.len(), &failed[0]["frame"], &report["denoised"]), (1, &Value::from(3), &Value::from(5)));
    assert!(failed[0]["error"].as_str().unwrap().contains("in.0003.exr: layer '': none of the 384 pixels is finite"));
    assert_eq!((&report["cuts"], &report["filled"]), (&serde_json::json!([]), &Value::from(1)));
    assert!(!work.path("out.0003.exr").exists());
    for frame in [0, 1, 2, 4, 5] {
        let samples = plane(&document(&work.path(&format!("out.{frame:04}.exr"))), "", "R");
        assert!(samples.iter().all(|v| (v - 0.5).abs() < 1e-3), "{frame}");
    }
    work.refused(
        "denoise in.0003.exr -o still.exr",
        Code::Invalid,
        &["in.0003.exr", "none of the 384 pixels is finite"],
    );
    assert!(!work.path("still.exr").exists());
}

/// Alpha that is not finite stayed in what was written, and nothing said in which frames.
#[test]
fn gaps_in_alpha_are_filled_in_and_told() {
    let work = Work::new();
    for frame in 1..=6 {
        let (mut samples, mut alpha) = (vec![0.5_f32; 24 * 16], vec![0.75_f32; 24 * 16]);
        match frame {
            // Color and alpha of one pixel, and alpha alone of another.
            3 => (samples[30], alpha[30], alpha[31]) = (f32::NAN, f32::NAN, f32::INFINITY),
            5 => alpha[100] = f32::NAN,
            _ => {}
        }
        let channels = [("A", alpha), ("B", samples.clone()), ("G", samples.clone()), ("R", samples)];
        write_exr(&work.path(&format!("in.{frame:04}.exr")), [24, 16], &channels, |_, _| {});
    }
    for (folder, words) in [("out", ""), ("both", "--alpha")] {
        let report = work.json(&format!("denoise in.####.exr -o {folder}.####.exr {words}"));
        let told = (&report["filled"], &report["filled_frames"]);
        assert_eq!(told, (&Value::from(3), &serde_json::json!([3, 5])), "{words}");
        for frame in 1..=6 {
            let written = document(&work.path(&format!("{folder}.{frame:04}.exr")));
            for (component, expected) in [("A", 0.75), ("G", 0.5)] {
                let samples = plane(&written, "", component);
                assert!(samples.iter().all(|v| (v - expected).abs() < 1e-3), "{words} {frame} {component}");
            }
        }
    }
    let command = "denoise in.####.exr -o out.####.exr";
    let text = work.text(command);
    assert!(text.contains("3 pixels of frames 3, 5 were NaN or infinite, and were filled in"), "{text}");
    // What is left of a frame that was cut short is made again; a file that is no picture is not touched.
    std::fs::write(work.path("out.0004.exr"), "").unwrap();
    work.refused(command, Code::OutputExists, &["out.0004.exr", "damaged", "--overwrite replaces it"]);
    let resumed = work.json(&format!("{command} --resume"));
    assert_eq!((&resumed["denoised"], &resumed["skipped"]), (&Value::from(1), &Value::from(5)));
    assert_eq!((&resumed["filled"], &resumed["filled_frames"]), (&Value::from(0), &serde_json::json!([])));
    std::fs::write(work.path("out.0004.exr"), "notes").unwrap();
    work.refused(&format!("{command} --resume"), Code::OutputExists, &["out.0004.exr"]);
    assert_eq!(std::fs::read(work.path("out.0004.exr")).unwrap(), b"notes");
    let help = work.text("denoise --help").split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(help.contains("changes of the frames around, of which a frame learns, do not count"), "{help}");
}

/// One picture is denoised by its own pixels, and stays as it is where there is no noise.
#[test]
fn a_single_picture_is_denoised() {
    let work = sequence();
    let report = work.json("denoise noisy/frame.0005.exr -o still.exr --alpha");
    assert_eq!(
        (&report["denoised"], &report["cuts"], &report["failed"]),
        (&Value::from(1), &serde_json::json!([]), &serde_json::json!([]))
    );
    let psnr = |a: &str, b: &str| {
        let out = work.command(&format!("compare {a} {b} --json")).output().unwrap();
        // There is none of pictures that are the same.
        serde_json::from_slice::<Value>(&out.stdout).unwrap()["psnr_db"].as_f64().unwrap_or(f64::INFINITY)
    };
    let [before, after] = ["noisy/frame.0005.exr", "still.exr"].map(|name| psnr(name, "true/frame.0005.exr"));
    println!("{before:.2} {after:.2}");
    assert!(after > before + 3.0, "{before} {after}");
    let [noisy, still] = ["noisy/frame.0005.exr", "still.exr"].map(|name| document(&work.path(name)));
    assert_eq!(plane(&noisy, "half_a", "G"), plane(&still, "half_a", "G"));
    assert!(still.header().attributes()["cumulo:denoise"].contains("-o still.exr"));
    // It is there, and another command does not replace it.
    assert_eq!(work.json("denoise noisy/frame.0005.exr -o still.exr --alpha --resume")["skipped"], 1);
    work.refused("denoise noisy/frame.0006.exr -o still.exr", Code::OutputExists, &["still.exr", "--overwrite"]);
    work.refused("denoise noisy/frame.0005.exr -o noisy/frame.0005.exr", Code::OutputIsInput, &["input"]);
    work.refused("denoise missing.exr -o x.exr", Code::NotFound, &["missing.exr"]);
    // Without noise it comes out as it is; the filter alone would leave 40 dB or less.
    work.json(&format!(
        "render smoke.vdb --views 1 --size {SIZE} --density-scale auto --tf inferno --supersample 4 -o clean.exr"
    ));
    work.json("denoise clean.exr -o same.exr");
    let kept = psnr("same.exr", "clean.exr");
    println!("{kept:.2}");
    assert!(kept > 120.0, "{kept}");
}
