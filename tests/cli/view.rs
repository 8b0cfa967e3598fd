//! `cumulo view`: what sheets show, what is said of them, and where they go.

use crate::common::work::{Work, errors, fixture};
use cumulo::error::Code;
use cumulo::formats::{exr, picture};
use cumulo::scene::color_space::ColorSpace;
use cumulo::scene::film::{Film, Plane};
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Levels of a PNG in 0..255, three for each pixel, and its size.
fn levels(work: &Work, name: &str) -> (Vec<[u8; 3]>, [usize; 2]) {
    let options = picture::Options { color_space: Some(ColorSpace::Linear), ..picture::Options::default() };
    let film = picture::read(&work.path(name), &options).unwrap().film;
    let level = |v: f32| (255.0 * v).round() as u8;
    (film.rgba.iter().map(|[r, g, b, _]| [*r, *g, *b].map(level)).collect(), [film.width, film.height])
}

/// Number of different colors: a sheet without a picture has few.
fn colors(pixels: &[[u8; 3]]) -> usize {
    pixels.iter().collect::<std::collections::BTreeSet<_>>().len()
}

#[test]
fn every_kind_of_grid_has_a_sheet() {
    let work = Work::new();
    for (file, grid, dimensions, meaning) in [
        ("plume", "density", json!([48, 48, 48]), "densities"),
        ("sphere_level_set", "surface", Value::Null, "the inside of the level set"),
        ("kinds", "velocity", Value::Null, "lengths of vectors"),
        ("kinds", "label", Value::Null, "magnitudes"),
        ("kinds", "mask", Value::Null, "magnitudes"),
        ("tiles", "density", Value::Null, "densities"),
        ("blob_sheared", "density", Value::Null, "densities"),
    ] {
        let option = if file == "kinds" { format!("--grid {grid}") } else { String::new() };
        let report = work.json(&format!("view @{file}.vdb {option} --size 96 -o {file}-{grid}.png"));
        let shown = &report["sheets"][0];
        assert_eq!((&shown["shows"], &shown["density"]), (&json!("volume"), &json!(meaning)), "{file} {grid}");
        assert!(shown["density_scale"].as_f64().unwrap() > 0.0, "{file} {grid}");
        if !dimensions.is_null() {
            assert!(shown["dimensions"].as_array().unwrap().iter().all(|n| n.as_u64().unwrap() <= 48), "{shown}");
        }
        // Sixteen bins and seventeen edges, from the least value to the largest.
        let (edges, statistics) = (shown["edges"].as_array().unwrap(), &shown["statistics"]);
        // The least value is printed in single precision: 2^-24 of it.
        let apart = edges[0].as_f64().unwrap() - statistics["min"].as_f64().unwrap();
        assert!(edges.len() == 17 && apart.abs() <= 1e-7 * edges[0].as_f64().unwrap().abs(), "{edges:?}");
        assert_eq!(shown["slices"].as_array().unwrap().len(), 3);
        let (pixels, size) = levels(&work, &format!("{file}-{grid}.png"));
        assert_eq!(json!(size), shown["size"]);
        assert!(colors(&pixels) > 10, "{file} {grid}: {}", colors(&pixels));
    }
}

/// The picture is neither white nor black: the densest hundredth of the rays has an optical depth of 3.
#[test]
fn the_density_scale_suits_the_volume_whatever_its_unit() {
    let work = Work::new();
    let scale = |words: &str| work.json(words)["sheets"][0]["density_scale"].as_f64().unwrap();
    let auto = scale("view @plume.vdb --size 64 -o auto.png");
    assert!(
        auto > 0.0
            && (scale(&format!("view @plume.vdb --size 64 --density-scale {auto} -o same.png")) - auto).abs()
                < 1e-9 * auto
    );
    assert_eq!(levels(&work, "auto.png"), levels(&work, "same.png"));
    scale("view @plume.vdb --size 64 --density-scale 1e-9 -o blank.png");
    assert_ne!(levels(&work, "auto.png"), levels(&work, "blank.png"));
    // A transfer function by name lights the picture.
    scale("view @plume.vdb --size 64 --tf inferno -o lit.png");
    let (pixels, _) = levels(&work, "lit.png");
    assert!(pixels.iter().any(|[r, g, b]| i32::from(*r) - i32::from(*b) > 60 && r > g), "something glows");
}

#[test]
fn layers_of_pictures_stand_side_by_side() {
    let work = Work::new();
    let pixels = (0..40 * 20).map(|i| [4.0 * (i % 40) as f32 / 39.0, 0.5, 0.25, 1.0]).collect();
    let mut film = Film::of(40, 20, pixels);
    for (name, value) in [("depth.Z", 7.0_f32), ("normal.X", -1.0), ("normal.Y", 0.5), ("normal.Z", 0.0)] {
        let samples = (0..40 * 20).map(|i| value * (i / 40) as f32).collect();
        film.planes.push(Plane { name: name.into(), samples });
    }
    exr::write_picture(&work.path("a.exr"), &film, &BTreeMap::new(), exr::Half::None).unwrap();
    let report = work.json("view a.exr --size 64 -o a.png");
    let shown = &report["sheets"][0];
    assert_eq!((&shown["shows"], &shown["resolution"]), (&json!("picture"), &json!([40, 20])));
    // The 99th percentile of the brightest channel is 4: two stops down.
    assert_eq!(shown["exposure"], json!(-2.0));
    let kinds: Vec<_> =
        shown["layers"].as_array().unwrap().iter().map(|l| (l["name"].clone(), l["kind"].clone())).collect();
    let expected = [("", "colors"), ("normal", "vectors"), ("depth.Z", "numbers")];
    assert_eq!(kinds, expected.map(|(name, kind)| (json!(name), json!(kind))));
    // Red goes from 0 to full in the first tile.
    let (pixels, _) = levels(&work, "a.png");
    assert!(pixels.iter().any(|p| p[0] == 255 && p[1] < 128) && pixels.iter().any(|p| p[0] == 0 && p[1] > 90));
    assert_eq!(work.json("view a.exr --size 64 --exposure 0.5 -o b.png")["sheets"][0]["exposure"], json!(0.5));
    for name in ["blender", "multipart", "grey", "nan", "uint", "overscan", "nuke_parts"] {
        let report = work.json(&format!("view @exr/{name}.exr --size 32 -o {name}.png"));
        assert!(!report["sheets"][0]["layers"].as_array().unwrap().is_empty(), "{name}");
    }
    // A layer that the common exposure would burn out has its own.
    let report = work.json("view @exr/blender.exr --size 32 -o blender.png");
    let exposures: Vec<_> =
        report["sheets"][0]["layers"].as_array().unwrap().iter().map(|l| l["exposure"].as_f64()).collect();
    assert!(exposures[0] == report["sheets"][0]["exposure"].as_f64() && exposures[1] < exposures[0], "{report}");
    // A PNG is shown as it is.
    assert_eq!(work.json("view a.png -o again.png")["sheets"][0]["exposure"], json!(0.0));
}

#[test]
fn captures_show_all_views_and_their_cameras() {
    let work = Work::new();
    work.json("render @plume.vdb --views 7 --size 24x16 --density-scale auto -o cap");
    let report = work.json("view cap --size 48 -o cap.png");
    let shown = &report["sheets"][0];
    assert_eq!((&shown["views"], &shown["missing"], &shown["exposure"]), (&json!(7), &json!([]), &json!(0.0)));
    assert!(colors(&levels(&work, "cap.png").0) > 20);
    // A picture that is gone leaves a gap, and is told.
    std::fs::remove_file(work.path("cap/view_003.exr")).unwrap();
    let report = work.json("view cap/transforms.json --size 48 -o gap.png");
    assert_eq!(report["sheets"][0]["missing"], json!([3]));
}

#[test]
fn frames_share_exposure_and_density_scale() {
    let work = Work::new();
    for (number, name) in [(1, "plume"), (2, "cube"), (3, "plume")] {
        std::fs::copy(fixture(&format!("{name}.vdb")), work.path(&format!("s.{number:04}.vdb"))).unwrap();
    }
    let report = work.json("view s.####.vdb --size 48 -o s.png");
    let shown = &report["sheets"][0];
    assert_eq!((&shown["shows"], &shown["frames"]), (&json!("sequence"), &json!([1, 2, 3])));
    // The smallest of the scales: no frame goes black.
    let alone = |name: &str| {
        let report = work.json(&format!("view {name} --size 48 -o alone.png"));
        report["sheets"][0]["density_scale"].as_f64().unwrap()
    };
    let least = alone("s.0001.vdb").min(alone("s.0002.vdb"));
    assert!((shown["density_scale"].as_f64().unwrap() - least).abs() < 1e-6 * least, "{shown}");
    assert_eq!(work.json("view s.%04d.vdb --frames 2 --size 48 -o two.png")["sheets"][0]["frames"], json!([2]));
    for (number, light) in [(1, 0.5), (2, 2.0)] {
        let film = Film::of(8, 8, vec![[light, 0.1, 0.1, 1.0]; 64]);
        exr::write_picture(&work.path(&format!("v.{number:04}.exr")), &film, &BTreeMap::new(), exr::Half::None)
            .unwrap();
    }
    let shown = &work.json("view v.%04d.exr -o v.png")["sheets"][0];
    assert_eq!((&shown["exposure"], &shown["count"]), (&json!(-1.0), &json!(2)));
    work.refused("view none.####.vdb -o n.png", Code::Invalid, &["none.0001.vdb", "no file"]);
    work.refused("view s.####.vdb --frames 9 -o n.png", Code::Invalid, &["s.####.vdb", "none of the frames is there"]);
}

#[test]
fn terminals_get_what_they_understand() {
    let work = Work::new();
    let shown = |words: &str| {
        let out = work.command(words).output().unwrap();
        assert!(out.status.success(), "{words}: {}", errors(&out));
        String::from_utf8(out.stdout).unwrap()
    };
    let blocks = shown("view @cube.vdb --terminal blocks");
    // As wide as a terminal that does not tell: 80 columns.
    assert!(blocks.lines().any(|line| line.matches('▀').count() == 80) && blocks.contains("grid 'density'"));
    assert!(shown("view @cube.vdb --terminal kitty").starts_with("\x1b_Ga=T,f=100,q=2,m=1;"));
    assert!(shown("view @cube.vdb --terminal sixel").starts_with("\x1bPq\"1;1;"));
    let out = work.command("view @cube.vdb").output().unwrap();
    assert_eq!(out.status.code(), Some(2));
    assert!(errors(&out).contains("terminal") && errors(&out).contains("-o OUT.png"), "{}", errors(&out));
    work.refused("view @cube.vdb --terminal blocks --json", Code::Invalid, &["--json", "-o OUT.png"]);
    work.refused("view @cube.vdb --terminal blocks -o a.png", Code::Usage, &["--terminal", "--output"]);
}

#[test]
fn sheets_go_where_they_are_told_to() {
    let work = Work::new();
    let report = work.json("view @cube.vdb @plume.vdb --size 32 -o sheets");
    assert_eq!(report["sheets"][1]["output"], json!("sheets/plume.vdb.png"));
    assert!(work.path("sheets/cube.vdb.png").exists());
    work.refused("view @cube.vdb @plume.vdb -o both.png", Code::OutputName, &["both.png", "folder"]);
    work.refused("view @cube.vdb @cube.vdb -o sheets", Code::Invalid, &["one name"]);
    work.refused("view @cube.vdb -o a.exr", Code::OutputName, &[".png"]);
    work.refused("view @cube.vdb -o -", Code::Unsupported, &["standard output"]);
    work.refused("view @cube.vdb --frames 1-2 -o a.png", Code::Invalid, &["--frames", "smoke.####.vdb"]);
    std::fs::write(work.path("stage.usda"), "#usda 1.0\n").unwrap();
    work.refused(
        "view stage.usda -o a.png",
        Code::Unsupported,
        &["USD stage has no sheet", "cumulo render stage.usda"],
    );
    work.refused("view none.vdb -o a.png", Code::NotFound, &["none.vdb"]);
    work.refused("view @kinds.vdb --grid none -o a.png", Code::NoSuchGrid, &["'none'", "'velocity'"]);
    std::fs::write(work.path("a.png"), std::fs::read(work.path("sheets/cube.vdb.png")).unwrap()).unwrap();
    work.refused("view a.png -o a.png", Code::OutputIsInput, &["a.png"]);
    assert!(!work.path("both.png").exists() && !work.path("a.exr").exists());
}

/// A depth or a fourth component in the layer of colors or vectors is a layer of its own to those who look.
#[test]
fn channels_beside_colors_and_vectors_are_shown() {
    let work = Work::new();
    let mut film = Film::of(8, 4, vec![[0.5, 0.25, 0.1, 0.5]; 32]);
    for name in ["Z", "Vector.X", "Vector.Y", "Vector.Z", "Vector.W"] {
        film.planes.push(Plane { name: name.into(), samples: (0..32).map(|i| i as f32).collect() });
    }
    exr::write_picture(&work.path("a.exr"), &film, &BTreeMap::new(), exr::Half::None).unwrap();
    let report = work.json("view a.exr --size 32 -o a.png");
    let layers = report["sheets"][0]["layers"].as_array().unwrap();
    let mut found: Vec<_> = layers.iter().map(|l| format!("{} {}", l["name"], l["kind"]).replace('"', "")).collect();
    found.sort();
    assert_eq!(found, [" colors", "Vector vectors", "Vector.W numbers", "Z numbers"]);
}

#[test]
fn the_folder_of_a_sequence_is_shown_and_no_picture_of_a_capture_is_replaced() {
    let work = Work::new();
    for number in [1, 2] {
        std::fs::create_dir_all(work.path("seq")).unwrap();
        std::fs::copy(fixture("plume.vdb"), work.path(&format!("seq/s.{number:04}.vdb"))).unwrap();
    }
    let shown = &work.json("view seq --size 32 --exposure -1 -o s.png")["sheets"][0];
    assert_eq!((&shown["frames"], &shown["exposure"]), (&json!([1, 2]), &json!(-1.0)));
    std::fs::copy(fixture("plume.vdb"), work.path("seq/t.1.vdb")).unwrap();
    std::fs::copy(fixture("plume.vdb"), work.path("seq/t.2.vdb")).unwrap();
    work.refused("view seq -o s.png", Code::Invalid, &["several sequences", "t.#.vdb"]);
    std::fs::create_dir(work.path("empty")).unwrap();
    work.refused("view empty -o s.png", Code::Invalid, &["neither a capture nor a sequence"]);
    work.json("render @plume.vdb --views 2 --size 8x8 --png -o cap");
    let transforms = std::fs::read_to_string(work.path("cap/transforms.json")).unwrap();
    std::fs::write(work.path("cap/transforms.json"), transforms.replace(".exr", ".png")).unwrap();
    work.refused("view cap -o cap/view_001.png", Code::OutputIsInput, &["view_001.png"]);
}

/// A scale that is small, or large, is not rounded away.
#[test]
fn scales_are_told_with_three_digits() {
    let work = Work::new();
    let text = work.text("view @plume.vdb --density-scale 0.0000123 --size 32 -o a.png");
    assert!(text.contains("density scale 1.23e-5"), "{text}");
}

/// The first bad file kept all that followed from being shown.
#[test]
fn a_bad_file_does_not_keep_the_others_from_being_shown() {
    let work = Work::new();
    for name in ["a.vdb", "c.vdb"] {
        std::fs::copy(fixture("cube.vdb"), work.path(name)).unwrap();
    }
    std::fs::write(work.path("b.vdb"), "no volume").unwrap();
    let out = work.command("view a.vdb b.vdb missing.vdb c.vdb --size 32 -o sheets --json").output().unwrap();
    assert_eq!(out.status.code(), Some(2), "{}", errors(&out));
    let report: Value = serde_json::from_slice(&out.stdout).unwrap();
    let inputs = |key: &str| report[key].as_array().unwrap().iter().map(|v| v["input"].clone()).collect::<Vec<_>>();
    assert_eq!(
        (inputs("sheets"), inputs("failed")),
        (vec!["a.vdb".into(), "c.vdb".into()], vec!["b.vdb".into(), "missing.vdb".into()])
    );
    assert!(
        errors(&out).contains("cumulo: b.vdb: ") && errors(&out).contains("cumulo: missing.vdb: "),
        "{}",
        errors(&out)
    );
    assert!(work.path("sheets/a.vdb.png").exists() && work.path("sheets/c.vdb.png").exists());
    assert!(!work.path("sheets/b.vdb.png").exists());
    work.refused("view b.vdb -o b.png", Code::UnknownFormat, &["b.vdb"]);
}
