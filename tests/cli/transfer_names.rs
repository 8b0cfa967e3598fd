//! Transfer functions by name: the list, what they are, and that all commands take them.

use crate::common::work::Work;
use cumulo::error::Code;
use serde_json::{Value, json};

#[test]
fn the_list_says_what_there_is() {
    let work = Work::new();
    let list = work.json("transfer --list");
    let functions = list["functions"].as_array().unwrap();
    let of = |name: &str| functions.iter().find(|f| f["name"] == name).unwrap_or(&Value::Null).clone();
    for name in ["viridis", "magma", "inferno", "plasma", "cividis", "turbo", "grey", "cool-warm", "black-body"] {
        assert_eq!((&of(name)["range"], &of(name)["unit"]), (&json!([0.0, 1.0]), &json!("")), "{name}");
    }
    for name in ["ct-bone", "ct-lung", "ct-soft-tissue", "ct-vessels"] {
        assert_eq!((&of(name)["range"], &of(name)["unit"]), (&json!([-1024.0, 3071.0]), &json!("HU")), "{name}");
        assert!(of(name)["opacity"].as_str().unwrap().contains(" at "), "{name}");
    }
    assert_eq!(of("mr-default")["range"], json!([0.0, 1.0]));
    for name in ["diverging", "diverging-purple-orange"] {
        assert_eq!(of(name)["range"], json!([-1.0, 1.0]), "{name}");
        assert!(of(name)["opacity"].as_str().unwrap().contains("in the middle"), "{name}");
    }
    let text = work.text("transfer --list");
    assert!(functions.iter().all(|f| text.contains(f["name"].as_str().unwrap())));
    work.refused("transfer --list viridis", Code::Usage, &["cannot be used with"]);
    work.refused("transfer", Code::Usage, &["required"]);
}

#[test]
fn names_are_taken_where_files_are() {
    let work = Work::new();
    // The file of a function is the function.
    let report = work.json("transfer viridis -o viridis.tf.json");
    assert_eq!((&report["source"], &report["name"]), (&json!("builtin"), &json!("viridis")));
    let size = "--views 1 --size 12x12";
    work.json(&format!("render @plume.vdb --tf viridis {size} -o a"));
    work.json(&format!("render @plume.vdb --tf viridis.tf.json {size} -o b"));
    assert_eq!(work.picture("a/view_000.exr"), work.picture("b/view_000.exr"));
    // Moved to another range, and with another extinction.
    work.json(&format!("render @plume.vdb --tf viridis --tf-range 0,0.25 --tf-extinction 30 {size} -o c"));
    assert_ne!(work.picture("a/view_000.exr"), work.picture("c/view_000.exr"));
    let report = work.json("transfer ct-bone --range 0,4095");
    assert_eq!(report["range"], json!([0.0, 4095.0]));
    work.json("convert @plume.vdb tinted.vdb --tf magma");
    work.json(&format!("gradient @plume.vdb --tf plasma {size} --loss mean --wrt extinction"));
    work.json("viewpoint @plume.vdb --tf turbo --starts 1 --iterations 1 --size 8x8 -o best.json");
    work.json("reconstruct density a --tf viridis --bounds 0,0,0,2,2,2 --resolution 6 --iterations 1 -o found.vdb");
    work.json("pose a --volume @plume.vdb --tf viridis --iterations 1 -o posed.json");
    // A file of that name goes first.
    std::fs::copy(work.path("viridis.tf.json"), work.path("inferno")).unwrap();
    work.json(&format!("render @plume.vdb --tf inferno {size} -o d"));
    assert_eq!(work.picture("a/view_000.exr"), work.picture("d/view_000.exr"));
    work.refused(
        "usd author @plume.vdb --tf viridis -o s.usda",
        Code::Unsupported,
        &["viridis", "cumulo transfer viridis -o"],
    );
}

#[test]
fn typing_errors_get_the_nearest_names() {
    let work = Work::new();
    let render = "render @plume.vdb --views 1 --size 8x8 -o x --tf";
    work.refused(
        &format!("{render} virdis"),
        Code::NotFound,
        &["neither a file nor", "did you mean 'viridis'?", "--list"],
    );
    work.refused(&format!("{render} coolwarm"), Code::NotFound, &["'cool-warm'"]);
    work.refused(&format!("{render} ct"), Code::NotFound, &["'ct-bone' or 'ct-lung'"]);
    work.refused(&format!("{render} qqqqqqqqqq"), Code::NotFound, &["neither a file nor", "cumulo transfer --list"]);
    work.refused(&format!("{render} none.tf.json"), Code::NotFound, &["none.tf.json", "spelling"]);
    work.refused(&format!("{render} viridis --tf-preset x"), Code::Invalid, &["'viridis' is one function"]);
    work.refused(&format!("{render} viridis --tf-unit-distance 2"), Code::Invalid, &["no opacities", "extinction"]);
    work.refused(&format!("{render} ct-bone --tf-extinction 2"), Code::Invalid, &["opacities"]);
    assert!(!work.path("x").exists());
}

/// A scan and a function of its units go together as they are, and after a map to densities; without a function the refusal
/// names the ways in.
#[test]
fn scans_go_with_the_presets_of_their_units() {
    let work = Work::new();
    work.json("convert @head.nii.gz scan.vdb");
    let size = "--views 1 --size 12x12";
    work.refused(
        &format!("render scan.vdb {size} -o no"),
        Code::Invalid,
        &["negative", "--tf", "cumulo convert --map"],
    );
    assert_eq!(work.json(&format!("render scan.vdb --tf ct-bone {size} -o own"))["views"], 1);
    work.json("convert scan.vdb ct.vdb --map=-1024,3071");
    let report = work.json(&format!("render ct.vdb --tf ct-bone {size} --tf-range 0,1 -o bone"));
    assert_eq!(report["views"], 1);
}
