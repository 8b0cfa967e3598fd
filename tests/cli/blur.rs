//! Depth of field and motion blur of cameras: pictures are the means of sharp ones, taken from all over the aperture and
//! the time in which the shutter is open.

use crate::common::work::Work;
use cumulo::error::Code;
use serde_json::{Value, json};

const SIZE: [usize; 2] = [24, 20];
const FOCAL: f64 = 30.0;
const EYE: [f64; 3] = [1.0, 1.0, 4.0];

/// A camera that looks down -Z, moved sideways; the picture of what lies at `focus` stays where it is.
fn camera(name: &str, [x, y]: [f64; 2], focus: f64) -> Value {
    let shift = FOCAL / focus;
    json!({
        "file_path": name,
        "transform_matrix": [[1, 0, 0, EYE[0] + x], [0, 1, 0, EYE[1] + y], [0, 0, 1, EYE[2]], [0, 0, 0, 1]],
        "cx": 12.0 + shift * x,
        "cy": 10.0 - shift * y,
    })
}

fn write_cameras(work: &Work, folder: &str, frames: &[Value]) {
    std::fs::create_dir_all(work.path(folder)).unwrap();
    let json = json!({"w": SIZE[0], "h": SIZE[1], "fl_x": FOCAL, "frames": frames});
    std::fs::write(work.path(&format!("{folder}/transforms.json")), json.to_string()).unwrap();
}

/// Root mean square difference of a picture's alpha from the mean of others'.
fn off(work: &Work, picture: &str, others: &[String]) -> f64 {
    let alphas = |name: &str| work.picture(name).rgba.iter().map(|rgba| f64::from(rgba[3])).collect::<Vec<_>>();
    let mut mean = vec![0.0; SIZE[0] * SIZE[1]];
    for name in others {
        mean.iter_mut().zip(alphas(name)).for_each(|(mean, a)| *mean += a / others.len() as f64);
    }
    let found = alphas(picture);
    (found.iter().zip(&mean).map(|(a, b)| (a - b) * (a - b)).sum::<f64>() / mean.len() as f64).sqrt()
}

/// Points of a disc by the radii and angles of equal areas.
fn disc(radius: f64) -> Vec<[f64; 2]> {
    let (rings, spokes) = (6, 16);
    let point = |ring: i32, spoke: i32| {
        let r = radius * ((f64::from(ring) + 0.5) / f64::from(rings)).sqrt();
        let angle = std::f64::consts::TAU * (f64::from(spoke) + 0.5 * f64::from(ring)) / f64::from(spokes);
        [r * angle.cos(), r * angle.sin()]
    };
    (0..rings).flat_map(|ring| (0..spokes).map(move |spoke| point(ring, spoke))).collect()
}

const DENSE: &str = "render @plume.vdb --density-scale 6";

#[test]
fn depth_of_field_is_the_mean_over_the_aperture() {
    let work = Work::new();
    for (folder, focus) in [("front", 2.5), ("back", 3.6)] {
        let points = disc(0.4);
        let views = points.iter().enumerate().map(|(i, at)| camera(&format!("view_{i:03}.exr"), *at, focus));
        write_cameras(&work, folder, &views.collect::<Vec<_>>());
        work.json(&format!("{DENSE} --cameras {folder} --supersample 4 -o {folder}-views"));
        let views: Vec<String> = (0..points.len()).map(|i| format!("{folder}-views/view_{i:03}.exr")).collect();
        write_cameras(&work, "one", &[camera("one.exr", [0.0; 2], focus)]);
        let lens = format!("--cameras one --aperture 0.4 --focus {focus}");
        work.json(&format!("{DENSE} {lens} --supersample 16 -o straight.exr --overwrite"));
        work.json(&format!("{DENSE} {lens} --albedo 0.5 --samples 1024 -o paths.exr --overwrite"));
        work.json(&format!("{DENSE} --cameras one --supersample 8 -o sharp.exr --overwrite"));
        // 0.0008 was seen of 256 rays, 0.0011 of 1024 paths, and 0.010 of sharp pictures.
        assert!(off(&work, "straight.exr", &views) < 0.002, "{folder} {}", off(&work, "straight.exr", &views));
        assert!(off(&work, "paths.exr", &views) < 0.003, "{folder} {}", off(&work, "paths.exr", &views));
        assert!(off(&work, "sharp.exr", &views) > 0.006, "{folder} {}", off(&work, "sharp.exr", &views));
    }
    // A capture states the aperture, which is that of pictures by its cameras; 0 makes them sharp.
    work.json(&format!("{DENSE} --cameras one --aperture 0.4 --focus 3 --supersample 4 -o stated"));
    work.json(&format!("{DENSE} --cameras stated --supersample 4 -o again"));
    work.json(&format!("{DENSE} --cameras stated --aperture 0 --supersample 8 -o point.exr"));
    assert_eq!(work.picture("again/view_000.exr"), work.picture("stated/view_000.exr"));
    assert_eq!(work.picture("point.exr").rgba, work.picture("sharp.exr").rgba);
}

#[test]
fn motion_blur_is_the_mean_over_the_open_time() {
    let work = Work::new();
    // Frames 0 to 2 at unequal steps; the shutter is open from 0.4 before frame 1 to 0.4 after it.
    let steps = [-0.9, 0.0, 0.5];
    let frames = steps.iter().enumerate().map(|(i, x)| camera(&format!("frame.{i:04}.exr"), [*x, 0.0], 1e9));
    write_cameras(&work, "path", &frames.collect::<Vec<_>>());
    let n = 40;
    let at = |i: i32| {
        let time = -0.4 + 0.8 * (f64::from(i) + 0.5) / f64::from(n);
        if time < 0.0 { 0.9 * time } else { 0.5 * time }
    };
    let views = (0..n).map(|i| camera(&format!("view_{i:03}.exr"), [at(i), 0.0], 1e9));
    write_cameras(&work, "moments", &views.collect::<Vec<_>>());
    work.json(&format!("{DENSE} --cameras moments --supersample 4 -o views"));
    let views: Vec<String> = (0..n).map(|i| format!("views/view_{i:03}.exr")).collect();
    let frames = format!("{DENSE} --cameras path --frames 0-2");
    work.json(&format!("{frames} --shutter 0.8 --supersample 16 -o moved"));
    work.json(&format!("{frames} --shutter 0.8 --albedo 0.5 --samples 1024 -o paths"));
    work.json(&format!("{frames} --supersample 8 -o still"));
    let found = ["moved", "paths", "still"].map(|folder| off(&work, &format!("{folder}/frame.0001.exr"), &views));
    assert!(found[0] < 0.006 && found[1] < 0.008 && found[2] > 0.02, "{found:?}");
    // The capture that was written has the motion; a camera at rest has none.
    let json: Value = serde_json::from_slice(&std::fs::read(work.path("moved/transforms.json")).unwrap()).unwrap();
    let start = &json["frames"][1]["transform_matrix_start"];
    assert!((start[0][3].as_f64().unwrap() - (EYE[0] - 0.36)).abs() < 1e-12, "{start}");
    work.json(&format!("{DENSE} --cameras moved --view 1 --supersample 16 -o again.exr"));
    assert_eq!(work.picture("again.exr").rgba, work.picture("moved/frame.0001.exr").rgba);
    // On a turntable the camera stays on its circle.
    work.json(&format!("{DENSE} --size 8x8 --frames 3 --orbit 24 --shutter 1 --supersample 4 -o turn"));
    let json: Value = serde_json::from_slice(&std::fs::read(work.path("turn/transforms.json")).unwrap()).unwrap();
    let at = |key: &str| [0, 1, 2].map(|row| json["frames"][0][key][row][3].as_f64().unwrap());
    let [start, now, end] = ["transform_matrix_start", "transform_matrix", "transform_matrix_end"].map(at);
    let apart = |a: [f64; 3], b: [f64; 3]| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt();
    // Chords of 7.5 and 15 degrees.
    let ratio = apart(start, end) / apart(start, now);
    let expected = 7.5_f64.to_radians().sin() / 3.75_f64.to_radians().sin();
    assert!((ratio - expected).abs() < 1e-9 && (apart(now, end) / apart(start, now) - 1.0).abs() < 1e-9, "{ratio}");
    work.json(&format!("{DENSE} --views 1 --size 24x20 --frames 1-2 --shutter 0.5 -o rest"));
    let text = std::fs::read_to_string(work.path("rest/transforms.json")).unwrap();
    assert!(!text.contains("transform_matrix_start"), "{text}");
}

#[test]
fn a_stage_states_lens_and_shutter() {
    let work = Work::new();
    let stage = |camera: &str| {
        format!(
            "#usda 1.0\n(\n    metersPerUnit = 1\n    upAxis = \"Z\"\n    timeCodesPerSecond = 24\n)\n\
             def Camera \"cam\"\n{{\n    float focalLength = 12.5\n    float horizontalAperture = 10\n    \
             float verticalAperture = 8.3333333\n    float2 clippingRange = (0.001, 100)\n{camera}}}\n"
        )
    };
    let moving = "    double3 xformOp:translate.timeSamples = { 0: (0.1, 1, 4), 1: (1, 1, 4), 2: (1.5, 1, 4) }\n    \
                  uniform token[] xformOpOrder = [\"xformOp:translate\"]\n";
    let still =
        "    double3 xformOp:translate = (1, 1, 4)\n    uniform token[] xformOpOrder = [\"xformOp:translate\"]\n";
    // 1.25 units over an f-stop of 1.5625 are 0.8 across.
    let open = "    float fStop = 1.5625\n    float focusDistance = 2.5\n";
    let shutter = "    double shutter:open = -0.4\n    double shutter:close = 0.4\n";
    std::fs::write(work.path("lens.usda"), stage(&format!("{still}{open}"))).unwrap();
    std::fs::write(work.path("moving.usda"), stage(&format!("{moving}{shutter}"))).unwrap();
    std::fs::write(work.path("still.usda"), stage(&format!("{still}{shutter}"))).unwrap();
    let size = "--size 24x20 --supersample 8";
    write_cameras(&work, "one", &[camera("one.exr", [0.0; 2], 1.0)]);
    work.json(&format!("{DENSE} --cameras one {size} --aperture 0.4 --focus 2.5 -o lens.exr"));
    work.json(&format!("{DENSE} --cameras lens.usda {size} -o lens-of-stage.exr"));
    assert!(off(&work, "lens-of-stage.exr", &["lens.exr".into()]) < 1e-5);
    let frames = [-0.9, 0.0, 0.5].iter().enumerate();
    let frames = frames.map(|(i, x)| camera(&format!("frame.{i:04}.exr"), [*x, 0.0], 1e9));
    write_cameras(&work, "path", &frames.collect::<Vec<_>>());
    work.json(&format!("{DENSE} --cameras path --frames 1 --shutter 0.8 {size} -o path-moved"));
    work.json(&format!("{DENSE} --cameras moving.usda --frames 1 {size} -o moved"));
    assert!(off(&work, "moved/frame.0001.exr", &["path-moved/frame.0001.exr".into()]) < 1e-5);
    // Matrices between keys have axes askew, and products of matrices a last number that is nearly 1.
    let turned = |angle: f64| {
        let (s, c) = angle.to_radians().sin_cos();
        format!("( ({c}, {s}, 0, 0), ({}, {c}, 0, 0), (0, 0, 1, 0), (1, 1, 4, 0.9999999999999999) )", -s)
    };
    let rolling = format!(
        "    matrix4d xformOp:transform.timeSamples = {{ 0: {}, 1: {}, 2: {} }}\n    uniform token[] xformOpOrder = \
         [\"xformOp:transform\"]\n",
        turned(0.0),
        turned(30.0),
        turned(60.0)
    );
    std::fs::write(work.path("rolling.usda"), stage(&format!("{rolling}{shutter}"))).unwrap();
    work.json(&format!("{DENSE} --cameras rolling.usda --frames 1 {size} -o rolled"));
    // A camera at rest is sharp whatever its shutter, and blur can be switched off.
    work.json(&format!("{DENSE} --cameras still.usda {size} -o still.exr"));
    work.json(&format!("{DENSE} --cameras lens.usda --aperture 0 {size} -o sharp.exr"));
    assert_eq!(work.picture("still.exr").rgba, work.picture("sharp.exr").rgba);
    // A stage that is written has the lens, and says that it lacks the motion.
    work.json(&format!("{DENSE} --cameras one {size} --aperture 0.4 --focus 2.5 -o written"));
    work.json("usd author @plume.vdb --camera written -o written.usda");
    work.json(&format!("{DENSE} --cameras written.usda {size} -o of-written.exr"));
    assert!(off(&work, "of-written.exr", &["lens.exr".into()]) < 1e-5);
    let out = work.command("usd author @plume.vdb --camera path-moved -o motion.usda").output().unwrap();
    assert!(out.status.success() && String::from_utf8_lossy(&out.stderr).contains("left out: the motion of cameras"));
}

#[test]
fn blur_without_a_meaning_is_refused() {
    let work = Work::new();
    write_cameras(&work, "one", &[camera("one.exr", [0.0; 2], 1.0)]);
    let one = format!("{DENSE} --cameras one");
    let refused = |words: &str, code, parts: &[&str]| work.refused(words, code, parts);
    refused(&format!("{one} --focus 2 -o a.exr"), Code::Invalid, &["--focus", "no aperture", "--aperture"]);
    refused(&format!("{one} --aperture=-1 -o a.exr"), Code::Usage, &["--aperture"]);
    refused(&format!("{one} --aperture 0.1 --focus 0 -o a.exr"), Code::Usage, &["--focus"]);
    refused(&format!("{one} --shutter 0.5 -o a.exr"), Code::Invalid, &["--shutter", "no frames", "--frames"]);
    refused(&format!("{one} --frames 0-1 --shutter 3 -o a"), Code::Usage, &["--shutter", "0 to 2"]);
    let turning = "render @plume.vdb --frames 0-1 --size 8x8 -o a";
    refused(&format!("{turning} --orbit 8 --shutter 1"), Code::Invalid, &["--shutter", "45 degrees", "--orbit 12"]);
    // Cameras that mirror each other, and ones that are missing beside a frame.
    let frame = |number: u32, x: i32| {
        json!({
            "file_path": format!("frame.{number:04}.exr"),
            "transform_matrix": [[x, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 4], [0, 0, 0, 1]],
        })
    };
    write_cameras(&work, "mirrored", &[frame(0, 1), frame(1, -1)]);
    let mirrored = format!("{DENSE} --cameras mirrored --frames 0-1 -o a");
    refused(&format!("{mirrored} --shutter 0.5"), Code::Invalid, &["--shutter", "mirror each other"]);
    write_cameras(&work, "gap", &[frame(1, 1), frame(3, 1), frame(4, 1)]);
    let out = work.command(&format!("{DENSE} --cameras gap --frames 3-4 --shutter 0.5 -o gaps")).output().unwrap();
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(out.status.success() && said.contains("beside 2 of the frames, frame 3 the first"), "{said}");
    refused(&format!("{one} --frames 0-1 --aperture 0.1 -o a"), Code::Invalid, &["--aperture", "--focus"]);
    refused(
        &format!("{one} --aperture 0.1 --target-error 0.01 -o a.exr"),
        Code::Invalid,
        &["--target-error", "--aperture 0", "--supersample"],
    );
    // One ray a pixel shows blur as grain, and says so; reconstructions say that they take pictures as sharp.
    let out = work.command(&format!("{one} --aperture 0.1 -o grainy")).output().unwrap();
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(out.status.success() && said.contains("grainy") && said.contains("--supersample"), "{said}");
    let out = work.command("reconstruct density grainy --resolution 8 -o found.vdb").output().unwrap();
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(said.contains("have an aperture or move"), "{said}");
}
