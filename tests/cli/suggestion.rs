//! Transfer functions that are suggested for a volume: they load, and show something.

use crate::common::fields::{grid, unit};
use crate::common::work::{Work, number};
use cumulo::error::Code;
use cumulo::formats::transfer::{Options, load};
use cumulo::scene::grid::{Grid, GridClass};
use glam::DVec3;
use serde_json::json;

/// A step from 1 to 0 at a radius, over about three voxels.
fn step(p: DVec3, radius: f64) -> f64 {
    let distance = (p - DVec3::splat(15.6)).length();
    1.0 / (1.0 + (1.2 * (distance - radius)).exp())
}

/// A scan of a ball of tissue with a bone inside, in air, in Hounsfield units.
fn scan() -> Grid {
    let value = |p| -1000.0 + 1040.0 * step(p, 13.0) + 660.0 * step(p, 6.0);
    Grid { class: GridClass::Unknown, ..grid(32, unit(), value) }
}

#[test]
fn the_functions_of_a_scan_load_and_show_its_boundaries() {
    let work = Work::new();
    work.write("scan.vdb", &[&scan()]);
    let report = work.json("transfer --suggest scan.vdb --sheet sheet.png -o all.tf.json");
    let boundaries = report["boundaries"].as_array().unwrap();
    assert_eq!(boundaries.len(), 2, "{report}");
    for (boundary, expected) in boundaries.iter().zip([-480.0, 370.0]) {
        assert!((number(boundary, "value") - expected).abs() < 85.0, "{boundary}");
    }
    assert!((number(&report, "background") + 1000.0).abs() < 5.0, "{report}");
    let candidates = report["candidates"].as_array().unwrap();
    let names: Vec<_> = candidates.iter().map(|candidate| candidate["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["all boundaries", "boundary 1", "boundary 2", "ramp"]);
    assert!(candidates.iter().all(|candidate| candidate["effect"] == "shown"), "{candidates:?}");
    assert_eq!((&report["candidate"], &report["warnings"]), (&json!(1), &json!([])));
    let sheet = std::fs::read(work.path("sheet.png")).unwrap();
    assert!(sheet.starts_with(b"\x89PNG"));
    // What is written is a function like any other.
    let loaded = load(&work.path("all.tf.json"), &Options::default()).unwrap();
    assert_eq!(loaded.name.as_deref(), Some("all boundaries"));
    work.json("transfer all.tf.json");
    work.json("render scan.vdb --tf all.tf.json --views 1 --size 24x24 -o all.exr");
    let picture = work.picture("all.exr");
    let middle = picture.rgba[12 * 24 + 12];
    assert!(middle[3] > 0.5 && middle[..3].iter().any(|v| *v > 0.1), "{middle:?}");
    assert!(picture.rgba[0][3] < 0.01, "air is not opaque");
}

#[test]
fn another_candidate_is_chosen_by_its_number() {
    let work = Work::new();
    work.write("scan.vdb", &[&scan()]);
    let report = work.json("transfer --suggest scan.vdb --candidate 3 -o bone.tf.json");
    let loaded = load(&work.path("bone.tf.json"), &Options::default()).unwrap();
    assert_eq!((loaded.name.as_deref(), &report["candidate"]), (Some("boundary 2"), &json!(3)));
    let text = work.text("transfer --suggest scan.vdb --candidate 3 -o bone.tf.json");
    for part in ["2 boundaries", "candidate 3  boundary 2 (chosen)", "bone.tf.json: written", "cumulo render scan.vdb"]
    {
        assert!(text.contains(part), "{text}");
    }
    // The number of threads changes nothing.
    let points = |name: &str| load(&work.path(name), &Options::default()).unwrap().transfer;
    work.json("transfer --suggest scan.vdb --candidate 3 --threads 1 -o again.tf.json");
    assert_eq!(points("bone.tf.json"), points("again.tf.json"));
}

#[test]
fn smoke_gets_a_ramp_at_least_and_other_inputs_are_read() {
    let work = Work::new();
    for input in ["@plume.vdb", "@head.nii.gz"] {
        let report = work.json(&format!("transfer --suggest {input} -o suggested.tf.json"));
        let candidates = report["candidates"].as_array().unwrap();
        assert_eq!(candidates.last().unwrap()["name"], "ramp", "{report}");
        assert!(load(&work.path("suggested.tf.json"), &Options::default()).is_ok());
    }
    work.json("convert @plume.vdb plume.nvdb");
    work.json("transfer --suggest plume.nvdb");
}

#[test]
fn what_has_no_functions_is_refused() {
    let work = Work::new();
    work.write("constant.vdb", &[&grid(8, unit(), |_| 3.0)]);
    work.write("scan.vdb", &[&scan()]);
    work.refused("transfer --suggest constant.vdb", Code::Invalid, &["the value 3", "constant.vdb", "--grid"]);
    let number = "transfer --suggest scan.vdb --candidate 9 -o no.tf.json";
    work.refused(number, Code::Invalid, &["--candidate", "no candidate 9", "4 (ramp)"]);
    assert!(!work.path("no.tf.json").exists());
    work.refused("transfer --suggest none.vdb", Code::NotFound, &["none.vdb"]);
    work.refused("transfer --suggest scan.vdb --grid none", Code::NoSuchGrid, &["none"]);
    work.refused("transfer --suggest scan.vdb --voxel-size 2", Code::Invalid, &["--voxel-size"]);
    work.refused("transfer viridis --time-point 0", Code::Invalid, &["--time-point", "--suggest"]);
    work.refused("transfer --suggest scan.vdb -o f.png", Code::OutputName, &["f.png"]);
    for words in ["viridis --suggest scan.vdb", "--list --suggest scan.vdb"] {
        work.refused(&format!("transfer {words}"), Code::Usage, &[]);
    }
    for words in ["viridis --candidate 1", "viridis --sheet s.png"] {
        work.refused(&format!("transfer {words}"), Code::Invalid, &["--suggest"]);
    }
}
