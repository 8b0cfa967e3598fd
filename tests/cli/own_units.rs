//! Volumes in units of their own: Hounsfield units as a scan has them, and signed fields.

use crate::common::fields::{grid, unit};
use crate::common::work::{Work, errors};
use cumulo::error::Code;
use cumulo::scene::grid::{Grid, GridClass};
use glam::DVec3;
use serde_json::Value;

/// A head of shells in air: skin, a bone and a brain, in whole Hounsfield units.
fn head(p: DVec3) -> f64 {
    let r = (p - DVec3::splat(11.7)).length();
    match r {
        r if r > 10.5 => -1000.0,
        r if r > 9.0 => (40.0 + 20.0 * (0.8 * p.x).sin()).round(),
        r if r > 6.5 => (1300.0 - 250.0 * (r - 7.7).abs() + 60.0 * (p.y + p.z).cos()).round(),
        _ => 30.0,
    }
}

/// The head, in air that no voxel holds.
fn scan(background: f32, value: impl Fn(DVec3) -> f64) -> Grid {
    let mut made = Grid { class: GridClass::Unknown, background, ..grid(24, unit(), value) };
    for leaf in &mut made.leaves {
        for i in 0..512 {
            if leaf.values[i] == background {
                leaf.active[i >> 6] &= !(1 << (i & 63));
            }
        }
    }
    made.leaves.retain(|leaf| leaf.active != [0; 8]);
    made
}

const SIZE: &str = "--views 2 --size 24x20";

/// The largest difference of two captures' pictures, and the largest sample.
fn apart(work: &Work, [a, b]: [&str; 2]) -> [f64; 2] {
    let (mut off, mut largest) = (0.0_f64, 0.0_f64);
    for view in 0..2 {
        let [a, b] = [a, b].map(|folder| work.picture(&format!("{folder}/view_{view:03}.exr")).rgba);
        for (a, b) in a.iter().flatten().zip(b.iter().flatten()) {
            (off, largest) = (off.max(f64::from((a - b).abs())), largest.max(f64::from(a.abs())));
        }
    }
    [off, largest]
}

fn remarks(work: &Work, words: &str) -> String {
    let out = work.command(words).output().unwrap();
    assert!(out.status.success(), "{words}: {}", errors(&out));
    errors(&out)
}

/// A scan as it is, through a preset of its unit, has the pictures of the mapped densities through the moved preset; the
/// cameras of one are those of the other.
#[test]
fn scans_are_shown_in_their_own_units() {
    let work = Work::new();
    work.write("scan.vdb", &[&scan(-1000.0, head)]);
    work.write("dense.vdb", &[&Grid { class: GridClass::Unknown, ..grid(24, unit(), head) }]);
    // 4096 is a power of two: the map is exact.
    work.write("mapped.vdb", &[&scan(24.0 / 4096.0, |p| (head(p) + 1024.0) / 4096.0)]);
    let moved = format!("--tf-range 0,{}", 4095.0 / 4096.0);
    let extents = "--quadrature exact --density-scale 0.5";
    work.json(&format!("render scan.vdb {SIZE} --tf ct-bone {extents} -o own"));
    work.json(&format!("render mapped.vdb --cameras own --tf ct-bone {moved} {extents} -o mapped"));
    work.json(&format!("render dense.vdb --cameras own --tf ct-bone {extents} -o dense"));
    for other in ["mapped", "dense"] {
        let [off, largest] = apart(&work, ["own", other]);
        assert!(largest > 0.5 && off < 2e-4 * largest, "{other}: {off:.1e} of {largest}");
    }
    // The default quadrature is good for what it states.
    work.json("render scan.vdb --cameras own --tf ct-bone --density-scale 0.5 -o usual");
    let [off, largest] = apart(&work, ["own", "usual"]);
    assert!(off < 1e-2 * largest, "{off:.1e}");
    // Air that shines is there whether voxels hold it or not.
    let shines = r#"{"format": "cumulo-transfer-function", "version": 1, "transfer": {"kind": "piecewise", "points": [
        [-1000, 0.1, 0.4, 0.9, 0.02], [0, 0.9, 0.4, 0.1, 0.0], [1500, 1, 1, 0.8, 0.3]]}}"#;
    std::fs::write(work.path("air.tf.json"), shines).unwrap();
    let plain = work.json(&format!("render scan.vdb {SIZE} --tf air.tf.json {extents} -o air"));
    assert_eq!(plain["views"], 2);
    assert!(apart(&work, ["air", "own"])[0] > 0.01);
}

#[test]
fn without_a_function_values_are_refused_with_the_way_in() {
    let work = Work::new();
    work.write("scan.vdb", &[&scan(-1000.0, head)]);
    work.write("signed.vdb", &[&scan(0.0, |p| (0.5 * p.x).sin())]);
    for command in [
        "render FILE --views 1 --size 8x8 -o no",
        "plan FILE --views 1 --size 8x8",
        "gradient FILE --views 1 --size 8x8 --loss mean --wrt extinction",
    ] {
        let of = |file: &str| command.replace("FILE", file);
        work.refused(&of("scan.vdb"), Code::Unsupported, &["background is -1000", "--tf", "cumulo convert --map"]);
        work.refused(&of("signed.vdb"), Code::Invalid, &["negative", "--tf", "cumulo convert --map"]);
    }
    assert!(!work.path("no").exists());
}

/// Everything that knows a function knows it in the data's units.
#[test]
fn all_commands_take_values_as_they_are() {
    let work = Work::new();
    work.write("scan.vdb", &[&scan(-1000.0, head)]);
    let bone = "--tf ct-bone";
    work.json(&format!("view scan.vdb {bone} -o sheet.png"));
    work.json(&format!("plan scan.vdb {bone} {SIZE}"));
    work.json(&format!("viewpoint scan.vdb {bone} --starts 2 --iterations 2 --size 12x12 -o best.json"));
    let lit = "--albedo 0.8 --sun 0,0,1 --sun-color 2,2,2 --samples 4 --aov normal,depth,albedo";
    work.json(&format!("render scan.vdb {bone} {SIZE} {lit} -o lit"));
    work.json(&format!("render scan.vdb {bone} {SIZE} --density-scale 0.3 -o shots"));
    work.json(&format!("pose shots --volume scan.vdb {bone} --iterations 1 -o posed.json"));
    let found = work.json("reconstruct tf shots --volume scan.vdb --texels 16 --iterations 3 -o found.tf.json");
    assert_eq!(
        (found["domain"][0].as_f64(), found["domain"][1].as_f64() > Some(1000.0)),
        (Some(-1000.0), true),
        "{found}"
    );
    let steps = r#"{"format": "cumulo-transfer-function", "version": 1, "transfer": {"kind": "piecewise", "points": [
        [-700, 0.1, 0.4, 0.9, 0.0], [20.5, 0.9, 0.4, 0.1, 0.05], [600, 0.3, 1, 0.8, 0.3], [1500, 1, 1, 0.8, 0.1]]}}"#;
    std::fs::write(work.path("f.tf.json"), steps).unwrap();
    let report = work.json(
        "gradient scan.vdb --tf f.tf.json --views 2 --size 16x12 --loss mean --wrt tf,density,camera --check --largest 12 \
         -o by.vdb",
    );
    assert!(report["worst_relative_error"].as_f64().unwrap() < 1e-4, "{report:#}");
    // Voxels are stated in the data's units, signed ones among them.
    let value = |row: &Value| row["value"].as_f64().unwrap();
    let rows = report["rows"].as_array().unwrap();
    let voxels = || rows.iter().filter(|row| row["name"].as_str().unwrap().starts_with("density["));
    assert!(voxels().count() > 0 && voxels().all(|row| value(row).fract() == 0.0), "{rows:?}");
}

/// Data far from zero: what single precision cannot tell apart is stored as differences, and reports state the data's
/// values.
#[test]
fn values_far_from_zero_are_told_apart() {
    let work = Work::new();
    let wave = |p: DVec3| (8.0 + 7.0 * (0.4 * p.x).sin() * (0.3 * p.y + 0.2 * p.z).cos()).round();
    work.write("near.vdb", &[&Grid { class: GridClass::Unknown, ..grid(16, unit(), wave) }]);
    work.write("far.vdb", &[&Grid { class: GridClass::Unknown, ..grid(16, unit(), |p| 1e6 + wave(p)) }]);
    let range = |by: f64| format!("--tf-range {},{}", by, by + 16.0);
    let extents = "--tf diverging --tf-extinction 0.3 --quadrature exact";
    work.json(&format!("render near.vdb {SIZE} {extents} {} -o near", range(0.0)));
    work.json(&format!("render far.vdb --cameras near {extents} {} -o far", range(1e6)));
    let [off, largest] = apart(&work, ["near", "far"]);
    assert!(largest > 0.1 && off < 1e-4 * largest, "{off:.1e} of {largest}");
    let report = work.json("gradient far.vdb --tf viridis --tf-range 1000000,1000016 --views 1 --size 8x8 --loss mean --wrt density --largest 4");
    for row in report["rows"].as_array().unwrap() {
        assert!((1e6..=1e6 + 15.0).contains(&row["value"].as_f64().unwrap()), "{row}");
    }
}

/// Values and functions that do not meet are told in both directions, with ranges, unit and the way out.
#[test]
fn ranges_that_do_not_meet_are_told() {
    let work = Work::new();
    work.write("scan.vdb", &[&scan(-1000.0, head)]);
    work.write("mri.vdb", &[&scan(0.0, |p| ((head(p) + 1000.0) / 10.0).round().min(254.0))]);
    let render = |words: &str, to: &str| remarks(&work, &format!("render {words} {SIZE} -o {to}"));
    let told = render("mri.vdb --tf ct-bone", "a");
    for word in ["0 to 2", "-1024 to 3071 HU", "--tf-range 0,2", "span"] {
        assert!(told.contains(word), "{word}: {told}");
    }
    let told = render("scan.vdb --tf viridis --density-scale 30", "b");
    for word in ["-1000 to 1", "0 to 1", "--tf-range=-1000,", "covers less than 0.1 %", "opaque in "] {
        assert!(told.contains(word), "{word}: {told}");
    }
    let told = render("scan.vdb --tf ct-bone", "c");
    assert!(!told.contains("--tf-range"), "{told}");
    for words in ["view mri.vdb --tf ct-bone -o s.png", "plan mri.vdb --tf ct-bone --views 1 --size 8x8"] {
        assert!(remarks(&work, words).contains("-1024 to 3071 HU"), "{words}");
    }
    let report = work.json("gradient mri.vdb --tf ct-bone --views 1 --size 8x8 --loss mean --wrt extinction");
    assert!(report["warnings"][0]["what"].as_str().unwrap().contains("HU"), "{report}");
}

/// Diverging functions show both signs, and nothing at zero.
#[test]
fn diverging_functions_show_both_signs() {
    let work = Work::new();
    let wave = |p: DVec3| if p.x < 12.0 { -(0.3 * p.y).sin().abs() } else { (0.3 * p.z).sin().abs() };
    work.write("signed.vdb", &[&scan(0.0, wave)]);
    work.json(&format!("render signed.vdb {SIZE} --tf diverging -o both"));
    work.write("far.vdb", &[&scan(0.0, |p| if p.x < 12.0 { -120.0 } else { 300.0 })]);
    // A range of another unit is proposed as symmetric as the function is.
    let far = remarks(&work, "render far.vdb --views 1 --size 8x8 --tf diverging -o far");
    assert!(far.contains("--tf-range=-300,300"), "{far}");
    let rgba = work.picture("both/view_000.exr").rgba;
    assert!(rgba.iter().any(|p| p[2] > 1.5 * p[0]) && rgba.iter().any(|p| p[0] > 1.5 * p[2]));
    let list = work.text("transfer --list");
    assert!(list.contains("diverging") && list.contains("-1 to 1"), "{list}");
}
