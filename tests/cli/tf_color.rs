//! The meaning of a transfer function's colors where light is scattered: `--tf-color`, scene files, USD stages, and
//! functions that state an albedo of their own.

use crate::common::work::{Work, errors, fixture};
use cumulo::error::Code;
use cumulo::formats::exr;
use cumulo::formats::transfer::{self, Options};
use serde_json::{Value, json};

const VIEW: &str = "--views 1 --size 20x16 --density-scale 20 --samples 64";

/// Writes a function of one color; `albedo` is that of its own.
fn write(work: &Work, name: &str, [r, g, b]: [f64; 3], albedo: Option<[f64; 3]>) {
    let mut document = json!({"format": "cumulo-transfer-function", "version": 1, "transfer":
        {"kind": "piecewise", "points": [[0.0, r, g, b, 0.0], [1.0, r, g, b, 3.0]]}});
    if let Some([r, g, b]) = albedo {
        document["version"] = 2.into();
        document["albedo"] = json!({"points": [[0.0, r, g, b], [1.0, r, g, b]]});
    }
    std::fs::write(work.path(name), document.to_string()).unwrap();
}

/// Mean color of a picture.
fn mean(work: &Work, picture: &str) -> [f64; 3] {
    let film = exr::read_picture(&work.path(picture), None).unwrap();
    let sum = |c: usize| film.rgba.iter().map(|pixel| f64::from(pixel[c])).sum::<f64>() / film.rgba.len() as f64;
    [sum(0), sum(1), sum(2)]
}

/// Asserts that pictures are the same but for the rounding of a stage's lights.
fn assert_close(found: &[[f32; 4]], expected: &[[f32; 4]], what: &str) {
    assert_eq!(found.len(), expected.len());
    for (i, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!((0..4).all(|c| (a[c] - b[c]).abs() <= 1e-5 * b[c]), "{what} {i}: {a:?} {b:?}");
    }
}

fn record(work: &Work, folder: &str) -> Value {
    let text = std::fs::read(work.path(&format!("{folder}/transforms.json"))).unwrap();
    serde_json::from_slice::<Value>(&text).unwrap()["scattering"].clone()
}

/// At albedo 1 a red and a blue function are red and blue in white light, and as emission they are alike.
#[test]
fn functions_have_their_color_under_light() {
    let work = Work::new();
    write(&work, "red.tf.json", [0.9, 0.1, 0.1], None);
    write(&work, "blue.tf.json", [0.1, 0.1, 0.9], None);
    let lit = format!("{VIEW} --albedo 1 --sun 1,1,2 --sun-color 3");
    let render = |tf: &str, more: &str, out: &str| {
        let said = work.json(&format!("render @plume.vdb {lit} --tf {tf}.tf.json {more} -o {out}"));
        (mean(&work, &format!("{out}/view_000.exr")), said["remarks"].to_string())
    };
    let ([red, _, dark], remark) = render("red", "", "red");
    assert!(red > 4.0 * dark && dark > 0.0, "{red} {dark}");
    assert!(remark.contains("albedo") && remark.contains("--tf-color"), "{remark}");
    let ([dark, _, blue], _) = render("blue", "", "blue");
    assert!(blue > 4.0 * dark, "{blue} {dark}");
    assert_eq!(render("red", "--tf-color albedo", "stated"), (mean(&work, "red/view_000.exr"), "null".into()));
    let red = render("red", "--tf-color emission", "emission-red");
    assert_eq!(red, render("blue", "--tf-color emission", "emission-blue"));
    assert_eq!(record(&work, "red")["tf_color"], "albedo");
    assert_eq!(record(&work, "emission-red")["tf_color"], "emission");
    // The record tells the options that make the picture again.
    let again = work.command("render @plume.vdb --cameras red -o no").output().unwrap();
    assert!(
        errors(&again).contains("--tf-color=albedo") || errors(&again).contains("--tf-color albedo"),
        "{}",
        errors(&again)
    );
}

/// Without light, what is not scattered is emitted: all of a dark medium's absorbed light is lost.
#[test]
fn meanings_differ_as_they_say() {
    let work = Work::new();
    write(&work, "f.tf.json", [0.5, 0.25, 1.0], None);
    // Nothing is scattered more than once; the sky is black.
    let dark = format!("{VIEW} --sky 0 --max-bounces 0 --tf f.tf.json");
    let of = |albedo: f64, color: &str| {
        work.json(&format!("render @plume.vdb {dark} --albedo {albedo} --tf-color {color} -o {color} --overwrite"));
        mean(&work, &format!("{color}/view_000.exr"))
    };
    let near = |found: [f64; 3], expected: [f64; 3]| {
        assert!((0..3).all(|c| (found[c] - expected[c]).abs() < 0.02 * expected[c] + 1e-6), "{found:?} {expected:?}");
    };
    let [r, g, b] = of(0.0, "emission");
    assert!(r > 0.01 && (r - 0.5 * b).abs() < 1e-4 && (g - 0.25 * b).abs() < 1e-4, "{r} {g} {b}");
    near(of(0.5, "emission"), [0.5 * r, 0.5 * g, 0.5 * b]);
    assert_eq!(of(0.5, "albedo"), [0.0; 3]);
    near(of(0.5, "both"), [0.75 * r, 0.875 * g, 0.5 * b]);
    near(of(1.0, "both"), [0.5 * r, 0.75 * g, 0.0]);
}

/// Colors above 1 are emission unless it is stated, and no albedo.
#[test]
fn bright_colors_are_no_albedo() {
    let work = Work::new();
    write(&work, "bright.tf.json", [0.5, 1.5, 0.5], None);
    write(&work, "plain.tf.json", [0.5, 1.0, 0.5], None);
    let render = format!("render @plume.vdb {VIEW} --albedo 0.5 --sky 0");
    let said = work.json(&format!("{render} --tf bright.tf.json -o bright"));
    assert!(said["remarks"].to_string().contains("some lie above 1"), "{said}");
    assert_eq!(record(&work, "bright")["tf_color"], "emission");
    assert!(mean(&work, "bright/view_000.exr")[1] > 0.01);
    for color in ["albedo", "both"] {
        let facts = ["density 0", "1.5", "--tf-color", "emission"];
        work.refused(&format!("{render} --tf bright.tf.json --tf-color {color} -o no"), Code::Invalid, &facts);
    }
    work.refused(&format!("{render} --tf-color albedo -o no"), Code::Invalid, &["--tf-color", "--tf"]);
    let alone = "render @plume.vdb --views 1 --tf plain.tf.json --tf-color albedo -o no";
    work.refused(alone, Code::Usage, &["--albedo"]);
}

/// A function's own albedo is read, shown, carried by a VDB, moved with its range, and used.
#[test]
fn functions_state_their_albedo() {
    let work = Work::new();
    write(&work, "own.tf.json", [2.0, 2.0, 2.0], Some([0.25, 0.5, 1.0]));
    write(&work, "plain.tf.json", [2.0, 2.0, 2.0], None);
    let said = work.json("transfer own.tf.json -o copy.tf.json");
    assert_eq!(said["albedo"], json!({"points": 2, "least": [0.25, 0.5, 1.0], "most": [0.25, 0.5, 1.0]}));
    assert!(work.text("transfer own.tf.json").contains("albedo of 2 points"));
    assert!(work.json("transfer plain.tf.json -o plain-copy.tf.json")["albedo"].is_null());
    let document = |name: &str| serde_json::from_slice::<Value>(&std::fs::read(work.path(name)).unwrap()).unwrap();
    assert_eq!(
        (&document("copy.tf.json")["version"], &document("plain-copy.tf.json")["version"]),
        (&json!(2), &json!(1))
    );
    assert!(document("plain-copy.tf.json").get("albedo").is_none());
    let options = Options { range: Some([-1.0, 3.0]), ..Options::default() };
    let points =
        |name: &str, options: &Options| transfer::load(&work.path(name), options).unwrap().albedo.unwrap().points();
    assert_eq!(points("copy.tf.json", &Options::default()), [[0.0, 0.25, 0.5, 1.0], [1.0, 0.25, 0.5, 1.0]]);
    assert_eq!(points("copy.tf.json", &options), [[-1.0, 0.25, 0.5, 1.0], [3.0, 0.25, 0.5, 1.0]]);

    let render = |input: &str, more: &str, out: &str| {
        work.json(&format!("render {input} {VIEW} --sun 1,1,2 {more} -o {out}"));
        work.picture(&format!("{out}/view_000.exr")).rgba
    };
    let own = render("@plume.vdb", "--albedo 1 --tf own.tf.json", "own");
    assert_eq!(record(&work, "own")["tf_color"], "both");
    assert_eq!(record(&work, "own")["tf_albedo"]["points"][0], json!([0.0, 0.25, 0.5, 1.0]));
    let by_volume = render("@plume.vdb", "--albedo 0.25,0.5,1 --tf plain.tf.json --tf-color emission", "by-volume");
    assert_eq!(own, by_volume);
    work.text(&format!("convert {} carried.vdb --tf own.tf.json", fixture("plume.vdb").display()));
    assert_eq!(render("carried.vdb", "--albedo 1", "carried"), own);
    let without = render("@plume.vdb", "--albedo 0.25,0.5,1 --tf own.tf.json --tf-color emission", "without");
    assert_eq!(without, own);
    // Straight rays have no use for it, and say so.
    let straight = work.json("render @plume.vdb --views 1 --size 8x8 --tf own.tf.json -o straight");
    assert!(straight["remarks"].to_string().contains("no effect"), "{straight}");

    write(&work, "more.tf.json", [2.0; 3], Some([0.5, 1.25, 0.5]));
    work.refused("transfer more.tf.json", Code::Invalid, &["more.tf.json", "'albedo'", "density 0", "1.25"]);
    let mut bad = document("copy.tf.json");
    bad["albedo"] = json!([1, 2, 3]);
    std::fs::write(work.path("bad.tf.json"), bad.to_string()).unwrap();
    work.refused("transfer bad.tf.json", Code::Invalid, &["'albedo' is [1,2,3]", "points"]);
    // Version 1 has no such key: what is there is ignored, as other keys are.
    bad["version"] = 1.into();
    std::fs::write(work.path("bad.tf.json"), bad.to_string()).unwrap();
    assert!(work.json("transfer bad.tf.json")["albedo"].is_null());
}

/// Scene files and stages mean emission unless they state it, and give the pixels of the options that say the same.
#[test]
fn scene_files_and_stages_state_the_meaning() {
    let work = Work::new();
    write(&work, "f.tf.json", [0.75, 0.5, 0.25], None);
    let light = json!([{"type": "DistantLight", "direction": [1, 1, 2], "irradiance": [1, 1, 1], "angle": 0.53}]);
    let scene = |name: &str, color: Option<&str>| {
        let mut medium = json!({"density_scale": 20, "albedo": [0.9, 0.9, 0.9], "transfer": "f.tf.json"});
        color.into_iter().for_each(|color| medium["tf_color"] = color.into());
        let scene = json!({"volumes": [{"file": fixture("plume.vdb"), "medium": medium}], "lights": light});
        std::fs::write(work.path(name), scene.to_string()).unwrap();
    };
    let pixels = |input: &str, more: &str, out: &str| {
        work.json(&format!("render {input} --cameras options-albedo --samples 4 {more} --overwrite -o {out}"));
        work.picture(&format!("{out}/view_000.exr")).rgba
    };
    let options = "--views 1 --size 20x16 --density-scale 20 --samples 4 --albedo 0.9 --sun 1,1,2 --tf f.tf.json";
    let by_options = |color: &str| {
        work.json(&format!("render @plume.vdb {options} --tf-color {color} -o options-{color}"));
        work.picture(&format!("options-{color}/view_000.exr")).rgba
    };
    let [albedo, emission, both] = ["albedo", "emission", "both"].map(by_options);
    assert!(albedo != emission && albedo != both && emission != both);
    scene("plain.json", None);
    assert_eq!(pixels("plain.json", "", "plain"), emission);
    for (color, expected) in [("albedo", &albedo), ("emission", &emission), ("both", &both)] {
        scene("stated.json", Some(color));
        assert_eq!(&pixels("stated.json", "", &format!("scene-{color}")), expected, "{color}");
        work.text("usd author stated.json -o stage.usda --overwrite");
        assert!(std::fs::read_to_string(work.path("stage.usda")).unwrap().contains("cumulo:transferColor"));
        assert_close(&pixels("stage.usda", "", &format!("stage-{color}")), expected, color);
    }
    work.text("usd author plain.json -o plain.usda");
    for (more, expected) in [
        ("", &emission),
        ("--albedo 0.9 --tf-color albedo", &albedo),
        ("--albedo 0.9 --tf f.tf.json", &albedo),
        ("--albedo 0.9 --tf f.tf.json --tf-color both", &both),
    ] {
        assert_close(&pixels("plain.usda", more, "stage"), expected, more);
    }
    std::fs::write(
        work.path("none.json"),
        json!({"volumes": [{"file": fixture("plume.vdb"), "medium": {"tf_color": "albedo"}}]}).to_string(),
    )
    .unwrap();
    work.refused("render none.json --views 1 -o no", Code::Invalid, &["volume 0", "tf_color", "transfer"]);
}

/// Surfaces that reflect are brighter where they face between camera and light, by options, scene files and stages
/// alike.
#[test]
fn surfaces_reflect_light() {
    let work = Work::new();
    let light = json!([{"type": "DistantLight", "direction": [1, 1, 2], "irradiance": [1, 1, 1], "angle": 0.53}]);
    let options = "--views 1 --size 20x16 --density-scale 20 --samples 16 --albedo 0.5,0.1,0 --sun 1,1,2 \
                   --gradient-shading 0.2";
    let by_options = |more: &str, out: &str| {
        work.json(&format!("render @plume.vdb {options} {more} -o {out}"));
        work.picture(&format!("{out}/view_000.exr")).rgba
    };
    let matt = by_options("", "matt");
    assert_eq!(by_options("--specular 0", "none"), matt);
    let shiny = by_options("--specular 0.5 --roughness 0.4", "shiny");
    // The reflection is white: blue that no albedo scatters.
    let blue = |picture: &[[f32; 4]]| picture.iter().map(|pixel| pixel[2]).sum::<f32>();
    assert!(blue(&matt) == 0.0 && blue(&shiny) > 0.1, "{}", blue(&shiny));
    let record = record(&work, "shiny");
    assert_eq!((&record["specular"], &record["roughness"]), (&json!(0.5), &json!(0.4)));
    let medium = json!({"density_scale": 20, "albedo": [0.5, 0.1, 0.0], "gradient_shading": 0.2,
        "specular": 0.5, "roughness": 0.4});
    let scene = json!({"volumes": [{"file": fixture("plume.vdb"), "medium": medium}], "lights": light});
    std::fs::write(work.path("scene.json"), scene.to_string()).unwrap();
    work.text("usd author scene.json -o stage.usda");
    for input in ["scene.json", "stage.usda"] {
        work.json(&format!("render {input} --cameras shiny --samples 16 -o again --overwrite"));
        assert_close(&work.picture("again/view_000.exr").rgba, &shiny, input);
    }
    let render = "render @plume.vdb --views 1 --albedo 0.5";
    work.refused(&format!("{render} --specular 0.5 -o no"), Code::Invalid, &["specular", "--gradient-shading"]);
    let bad = format!("{render} --gradient-shading 1");
    work.refused(&format!("{bad} --specular 1.5 -o no"), Code::Usage, &["specular", "0 to 1"]);
    work.refused(&format!("{bad} --specular 1 --roughness 0.01 -o no"), Code::Usage, &["roughness", "0.05"]);
}
