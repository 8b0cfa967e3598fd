//! Volumes of labels: every voxel has the color of its label, and no class between two others shows.

use crate::common::fields::{grid, unit};
use crate::common::work::{Work, errors};
use cumulo::error::Code;
use cumulo::scene::grid::{Grid, GridClass};
use glam::DVec3;

/// A ball of label 40 in one of label 2, beside a cube of label 7.
fn label(p: DVec3) -> f64 {
    let r = (p - DVec3::new(8.0, 11.0, 11.0)).length();
    match r {
        r if r < 3.5 => 40.0,
        r if r < 7.0 => 2.0,
        _ if (p - DVec3::new(18.0, 11.0, 11.0)).abs().max_element() < 3.0 => 7.0,
        _ => 0.0,
    }
}

/// Colors that tell all classes from what lies between any two of them, and from the other labels'.
const COLORS: &str = r#"{"format": "cumulo-transfer-function", "version": 1, "transfer": {"kind": "labels", "classes": [
    {"label": 2, "name": "shell", "rgbs": [1, 0, 0, 900]}, {"label": 7, "rgbs": [0, 1, 0, 900]},
    {"label": 20, "rgbs": [1, 1, 1, 900]}, {"label": 40, "rgbs": [0, 0, 1, 900]}]}}"#;

fn work() -> Work {
    let work = Work::new();
    work.write("labels.vdb", &[&Grid { class: GridClass::Unknown, ..grid(24, unit(), label) }]);
    std::fs::write(work.path("colors.tf.json"), COLORS).unwrap();
    work
}

const SIZE: &str = "--from right --size 48x40 --density-scale 1";

/// Opaque pixels have the colors of classes; the inner ball is hidden, and seen where its shell is left out.
#[test]
fn no_class_between_shows() {
    let work = work();
    work.json(&format!("render labels.vdb --tf colors.tf.json {SIZE} -o all.exr"));
    let classes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0; 3]];
    let counts = |name: &str| {
        let mut counts = [0; 4];
        for pixel in work.picture(name).rgba {
            let near = |class: &[f32; 3]| class.iter().zip(pixel).all(|(a, b)| (a - b).abs() < 1e-4);
            let found = classes.iter().position(near);
            counts[found.unwrap_or_else(|| panic!("{name}: {pixel:?} is no class's color"))] += 1;
        }
        counts
    };
    let [shell, cube, ball, clear] = counts("all.exr");
    assert!(shell + cube > 100 && ball == 0 && clear > 100, "{:?}", counts("all.exr"));
    std::fs::write(work.path("inner.tf.json"), COLORS.replace("[1, 0, 0, 900]", "[1, 0, 0, 0]")).unwrap();
    work.json("render labels.vdb --tf inner.tf.json --from left --size 48x40 --density-scale 1 -o inner.exr");
    assert!(counts("inner.exr")[2] > 20);
}

/// The named function, a table of labels as text and the light of paths work on the same volume; alpha is the same
/// whatever the light.
#[test]
fn labels_are_lit_and_named() {
    let work = work();
    let alpha = |name: &str| -> f32 { work.picture(name).rgba.iter().map(|p| p[3]).sum() };
    work.json(&format!("render labels.vdb --tf labels {SIZE} -o named.exr"));
    work.json(&format!("render labels.vdb --tf labels --shade {SIZE} -o shaded.exr"));
    assert_eq!(alpha("named.exr"), alpha("shaded.exr"));
    work.json(&format!("render labels.vdb --tf labels --albedo 1 --sky 1 --samples 16 {SIZE} -o lit.exr"));
    let [straight, paths] = ["named.exr", "lit.exr"].map(alpha);
    // A path goes through any place of its pixel.
    assert!((straight / paths - 1.0).abs() < 0.02, "{straight} {paths}");
    work.json(&format!("render labels.vdb --tf labels --albedo 1 --sky 1 --samples 16 {SIZE} -o again.exr"));
    assert_eq!(work.picture("lit.exr").rgba, work.picture("again.exr").rgba);
    let table = "# label name R G B A\n0 Background 0 0 0 0\n2 outer shell 255 0 0 255\n7 cube 0 255 0 255\n";
    std::fs::write(work.path("table.ctbl"), table).unwrap();
    let report = work.json("transfer table.ctbl -o table.tf.json");
    assert_eq!((report["source"].as_str(), report["kind"].as_str()), (Some("label-table"), Some("labels")));
    work.json(&format!("render labels.vdb --tf table.tf.json {SIZE} -o table.exr"));
    work.json(&format!("render labels.vdb --tf table.ctbl {SIZE} -o text.exr"));
    assert_eq!(work.picture("table.exr").rgba, work.picture("text.exr").rgba);
    assert!(work.command("view labels.vdb --tf labels -o view.png").output().unwrap().status.success());
}

/// A furnace: labels that scatter all light, under an even sky, are invisible in it.
#[test]
fn labels_keep_all_light_in_a_furnace() {
    let work = work();
    let white = COLORS.replace("[1, 0, 0, 900]", "[1, 1, 1, 0.4]").replace("[0, 1, 0, 900]", "[1, 1, 1, 2]");
    let white = white.replace("[0, 0, 1, 900]", "[1, 1, 1, 0.1]");
    std::fs::write(work.path("white.tf.json"), white).unwrap();
    for more in ["", "--anisotropy 0.7", "--gradient-shading 0.2 --specular 0.3"] {
        work.json(&format!(
            "render labels.vdb --tf white.tf.json --albedo 1 --sky 1 --samples 256 {SIZE} {more} -o white.exr --overwrite"
        ));
        let colors: Vec<f32> = work.picture("white.exr").rgba.iter().flat_map(|p| [p[0], p[1], p[2]]).collect();
        let mean = colors.iter().sum::<f32>() / colors.len() as f32;
        assert!((mean - 1.0).abs() < 2e-3, "{more}: {mean}");
    }
}

/// One voxel in a background that is shown has cameras, and a study of labels varies what they have.
#[test]
fn small_and_studied_labels_work() {
    let work = work();
    let at = |p: DVec3| if p == DVec3::splat(3.0) { 2.0 } else { 0.0 };
    let mut one = Grid { class: GridClass::Unknown, ..grid(8, unit(), at) };
    for leaf in &mut one.leaves {
        for i in (0..512).filter(|i| leaf.values[*i] == 0.0) {
            leaf.active[i >> 6] &= !(1 << (i & 63));
        }
    }
    work.write("one.vdb", &[&one]);
    let background = COLORS
        .replace("{\"label\": 7, \"rgbs\": [0, 1, 0, 900]},", "")
        .replace("\"classes\": [", "\"classes\": [{\"label\": 0, \"rgbs\": [0.5, 0.5, 0.5, 0.1]},");
    std::fs::write(work.path("background.tf.json"), background).unwrap();
    work.json("render one.vdb --tf background.tf.json --views 1 --size 8x8 -o shots");
    assert!(!std::fs::read_to_string(work.path("shots/transforms.json")).unwrap().contains("null, null"));
    let alpha: f32 = work.picture("shots/view_000.exr").rgba.iter().map(|p| p[3]).sum();
    assert!(alpha > 0.5, "{alpha}");
    work.json("study render labels.vdb --tf labels --size 16x16 --repeats 1 -o page");
    let report = work.json("figure shots/view_000.exr --tf colors.tf.json -o figure.svg");
    let legend = &report["legend"];
    assert_eq!((legend["classes"].as_u64(), &legend["range"]), (Some(4), &serde_json::json!([2.0, 40.0])));
}

/// An extinction beyond all measure is opaque, and paths come to an end.
#[test]
fn huge_extinctions_are_opaque() {
    let work = work();
    std::fs::write(work.path("huge.tf.json"), COLORS.replace("900", "3e38")).unwrap();
    work.json(&format!("render labels.vdb --tf huge.tf.json --albedo 1 --sky 1 --samples 4 {SIZE} -o huge.exr"));
    work.json(&format!("render labels.vdb --tf huge.tf.json {SIZE} -o straight.exr"));
    assert!(work.picture("straight.exr").rgba.iter().any(|p| p[3] == 1.0));
}

#[test]
fn what_labels_do_not_do_is_refused() {
    let work = work();
    work.write("smooth.vdb", &[&grid(8, unit(), |p| 0.1 + 0.05 * p.x)]);
    let refused = |words: &str, code: Code, facts: &[&str]| work.refused(words, code, facts);
    refused(
        "render smooth.vdb --tf labels --views 1 -o x",
        Code::Invalid,
        &["smooth.vdb", "is no label", "whole numbers"],
    );
    std::fs::write(work.path("other.tf.json"), COLORS.replace("\"label\": 2,", "\"label\": 1,")).unwrap();
    let none = COLORS.replace("\"label\": 2,", "\"label\": 3,").replace("\"label\": 7,", "\"label\": 9,");
    std::fs::write(work.path("none.tf.json"), none.replace("\"label\": 40,", "\"label\": 41,")).unwrap();
    refused(
        "render labels.vdb --tf none.tf.json --views 1 -o x",
        Code::Invalid,
        &["3 to 41", "0 to 40", "--tf labels"],
    );
    refused(
        "gradient labels.vdb --tf labels --wrt density --loss mean --views 1 -o x.vdb",
        Code::Unsupported,
        &["labels", "derivatives"],
    );
    refused("viewpoint labels.vdb --tf labels -o x", Code::Unsupported, &["labels"]);
    refused(
        "render labels.vdb --tf labels --quadrature midpoint:1 --views 1 -o x",
        Code::Invalid,
        &["--quadrature", "closed form"],
    );
    refused("render labels.vdb --tf labels --tf-range 0,1 --views 1 -o x", Code::Invalid, &["labels", "range"]);
    work.json("render labels.vdb --tf labels --views 2 --size 8x8 -o shots");
    refused("reconstruct tf shots --volume labels.vdb -o x.tf.json", Code::Unsupported, &["labels", "derivatives"]);
    let negative = COLORS.replace("[0, 1, 0, 900]", "[0, -1, 0, 900]");
    std::fs::write(work.path("negative.tf.json"), negative).unwrap();
    refused("transfer negative.tf.json", Code::Invalid, &["label 7", "-1"]);
    let out = work.command("render labels.vdb --tf other.tf.json --views 1 --size 8x8 -o some").output().unwrap();
    assert!(out.status.success(), "{}", errors(&out));
}
