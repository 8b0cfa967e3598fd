//! `cumulo render`: what it writes, that it is what the library sees, and how it ends.

use crate::common::fields::{self, tinted, unit};
use crate::common::work::{Work, density, errors, fixture, interrupt, until};
use cumulo::cancel::Cancel;
use cumulo::error::Code;
use cumulo::formats::vdb::shaded;
use cumulo::formats::{exr, transforms};
use cumulo::render::dvr::Dvr;
use cumulo::render::film::{self, Sampling};
use cumulo::render::quadrature::Quadrature;
use cumulo::scene::bricks::Bricks;
use cumulo::scene::capture::{EmissionModel, Model, PixelFilter};
use cumulo::scene::film::Film;
use cumulo::scene::grid::Grid;
use glam::DVec3;
use serde_json::Value;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::os::unix::ffi::OsStringExt;
use std::path::Path;

fn field(path: &Path) -> Bricks<f32> {
    Bricks::from_grid(&density(path), 1 << 30).unwrap()
}

/// Every picture of a capture from the library, as `transforms.json` describes it.
fn assert_as_described(work: &Work, folder: &str, volume: &Path, quadrature: Quadrature) {
    let capture = transforms::load(&work.path(folder)).unwrap();
    let field = field(volume);
    let dvr = Dvr::new(&field, capture.medium().unwrap()).unwrap().quadrature(quadrature).over(capture.background);
    for frame in &capture.frames {
        let expected = film::render(&dvr, &frame.camera, Sampling::grid(1), &[], &Cancel::NEVER).unwrap().film;
        // A file does not say how many rays a pixel had.
        let expected = Film { samples: 0, ..expected };
        assert!(exr::read_picture(&frame.picture, None).unwrap() == expected, "{}", frame.picture.display());
    }
}

fn rms(a: &Film, b: &Film) -> f64 {
    let square: f64 = a.rgba.iter().zip(&b.rgba).map(|(a, b)| f64::from(a[0] - b[0]).powi(2)).sum();
    (square / a.rgba.len() as f64).sqrt()
}

fn empty() -> Grid {
    Grid { leaves: vec![], ..fields::grid(8, unit(), |_| 0.0) }
}

#[test]
fn every_fixture_is_rendered_as_the_library_sees_it() {
    let work = Work::new();
    for name in ["plume", "slab", "cube", "tiles", "blob_sheared", "blob_stretched"] {
        for layout in ["sphere", "ring"] {
            let folder = format!("{name}_{layout}");
            let report = work.json(&format!("render @{name}.vdb --views 3 --layout {layout} --size 20x14 -o {folder}"));
            assert_eq!((&report["views"], &report["density_scale"]), (&3.into(), &1.0.into()), "{report}");
            let volume = fixture(&format!("{name}.vdb"));
            assert_as_described(&work, &folder, &volume, Quadrature::Exact);
            let capture = transforms::load(&work.path(&folder)).unwrap();
            assert_eq!(capture.lattice, Some(density(&volume).transform.matrix()), "{name}");
            assert!(capture.frames.iter().all(|f| (f.camera.width, f.camera.height) == (20, 14)));
            for frame in &capture.frames {
                let film = exr::read_picture(&frame.picture, None).unwrap();
                assert!(film.rgba.iter().any(|p| p[3] > 0.0), "{name}: something is seen");
                let (first, last) = (film.rgba[0], film.rgba[film.rgba.len() - 1]);
                assert_eq!((first[3], last[3]), (0.0, 0.0), "{name}: all of it is in the picture");
            }
            let level = capture.frames.iter().all(|f| f.camera.forward().z.abs() < 1e-12);
            assert_eq!(level, layout == "ring", "{name}: only a ring looks along the horizon");
        }
    }
}

#[test]
fn cameras_of_an_earlier_capture_give_the_same_bits() {
    let work = Work::new();
    work.json("render @plume.vdb --views 4 --size 24x16 --density-scale auto --background 0.5,0.25,1 -o a");
    work.json("render @plume.vdb --cameras a -o b");
    work.json("render @plume.vdb --cameras a/transforms.json -o c");
    let [a, b] = ["a", "b"].map(|f| transforms::load(&work.path(f)).unwrap());
    assert_eq!((a.density_scale, a.background, a.lattice), (b.density_scale, b.background, b.lattice));
    for i in 0..4 {
        assert_eq!(a.frames[i].camera, b.frames[i].camera);
        let of = |folder| work.picture(&format!("{folder}/view_{i:03}.exr"));
        assert!(of("a") == of("b") && of("a") == of("c"), "view {i}");
    }
}

#[test]
fn absorption_is_the_background_behind_what_is_left() {
    let work = Work::new();
    work.json("render @plume.vdb --views 3 --size 32x32 --density-scale 4 --background 0.5,0.25,2 -o cap");
    for i in 0..3 {
        let film = work.picture(&format!("cap/view_{i:03}.exr"));
        assert_eq!(film.rgba[0], [0.5, 0.25, 2.0, 0.0]);
        for [r, g, b, a] in film.rgba {
            // T is rounded once (2^-25), 1 - T once more.
            let seen = 1.0 - a;
            for (value, behind) in [(r, 0.5), (g, 0.25), (b, 2.0)] {
                assert!((value - behind * seen).abs() <= behind * 2_f32.powi(-23), "{value} {behind} {seen}");
            }
        }
    }
}

#[test]
fn the_automatic_scale_brings_the_thickest_hundredth_to_three() {
    let work = Work::new();
    let report = work.json("render @plume.vdb --views 6 --size 64x64 --density-scale auto -o cap");
    let capture = transforms::load(&work.path("cap")).unwrap();
    assert_eq!(report["density_scale"].as_f64(), Some(capture.density_scale));
    let films = (0..6).map(|i| work.picture(&format!("cap/view_{i:03}.exr")));
    let mut depths: Vec<f64> =
        films.flat_map(|f| f.rgba).map(|p| -f64::from(1.0 - p[3]).ln()).filter(|d| *d > 0.0).collect();
    depths.sort_by(f64::total_cmp);
    let found = depths[((depths.len() - 1) as f64 * 0.99).round() as usize];
    // All pixels of pictures of this size are looked at; depths below 2^-25 are zero in the picture and
    // move the rank a little: one rank near the top is some 1e-3.
    assert!((found - 3.0).abs() < 0.02, "{found}");
}

#[test]
fn sources_are_rendered_and_described() {
    let work = Work::new();
    let options = "--views 3 --size 24x24 --density-scale 3 --model emission-absorption --emission 2,1,0.5";
    work.json(&format!("render @plume.vdb {options} -o grey"));
    work.json(&format!("render @plume.vdb {options} --emission-model linear --background 0.1 -o linear"));
    for (folder, model, background) in
        [("grey", EmissionModel::Grey, [0.0; 3]), ("linear", EmissionModel::Linear, [0.1; 3])]
    {
        let capture = transforms::load(&work.path(folder)).unwrap();
        assert_eq!((capture.model, capture.emission_model), (Model::EmissionAbsorption, model));
        assert_eq!((capture.emission, capture.background), ([2.0, 1.0, 0.5], background));
        assert_as_described(&work, folder, &fixture("plume.vdb"), Quadrature::Exact);
    }
    // Grey: c (1 - T); the colors are multiples of one another to a rounding of each.
    for [r, g, b, a] in work.picture("grey/view_001.exr").rgba {
        assert!((r - 2.0 * a).abs() < 3e-7 && (g - a).abs() < 3e-7 && (b - 0.5 * a).abs() < 3e-7, "{r} {g} {b} {a}");
    }
    assert!(rms(&work.picture("grey/view_001.exr"), &work.picture("linear/view_001.exr")) > 0.05);
}

#[test]
fn constant_steps_converge_to_the_exact_quadrature() {
    let work = Work::new();
    let render = |quadrature: &str| {
        let words = format!(
            "render @plume.vdb --views 2 --size 32x32 --density-scale 3 --quadrature {quadrature} --overwrite -o q"
        );
        assert_eq!(work.json(&words)["quadrature"], quadrature);
        let text = std::fs::read_to_string(work.path("q/transforms.json")).unwrap();
        assert!(text.contains(&format!("\"quadrature\": \"{quadrature}\"")), "{text}");
        assert_as_described(&work, "q", &fixture("plume.vdb"), quadrature.parse().unwrap());
        work.picture("q/view_001.exr")
    };
    let exact = render("exact");
    let error = |quadrature: &str| rms(&render(quadrature), &exact);
    let (m1, m4) = (error("midpoint:1"), error("midpoint:0.25"));
    let (r1, r4) = (error("riemann:1"), error("riemann:0.25"));
    // Order two and one: 16 and 4 for a smooth field; the plume has an edge, and so the factor is
    // smaller for the first and scatters for the second.
    assert!(m1 > 8.0 * m4 && m4 < 3e-5, "midpoint {m1:.1e} {m4:.1e}");
    assert!(r1 > 3.0 * r4 && r4 < 1e-3, "riemann {r1:.1e} {r4:.1e}");
}

#[test]
fn early_stops_say_what_they_may_cost() {
    let work = Work::new();
    for (words, bound) in [("--background 2,1,1 --early-stop 0.125", 0.25), ("--early-stop 0", 0.0), ("", 1e-6)] {
        let report = work.json(&format!("render @plume.vdb --views 1 --size 8x8 {words} --overwrite -o o"));
        assert!((report["early_stop"]["error_bound"].as_f64().unwrap() - bound).abs() < 1e-12, "{words}: {report}");
    }
    let text = std::fs::read_to_string(work.path("o/transforms.json")).unwrap();
    assert!(text.contains("\"early_stop\"") && text.contains("\"transmittance\""), "{text}");
    work.refused("render @plume.vdb --views 1 --early-stop 1 -o o", Code::Usage, &["below 1"]);
}

/// The bound of the quadrature is that of the picture, not of the density, and rules without one say so.
#[test]
fn quadratures_say_what_they_may_cost() {
    let work = Work::new();
    let tf = r#"{"format":"cumulo-transfer-function","version":1,"transfer":{"kind":"piecewise",
        "points":[[0.1,3,0,0,0],[0.2,3,0,0,4]]}}"#;
    std::fs::write(work.path("f.tf.json"), tf).unwrap();
    let render = "render @plume.vdb --tf f.tf.json --views 1 --size 8x8 --overwrite -o o";
    let cases =
        [("", None), (" --quadrature preintegrated", Some(3e-2)), (" --quadrature preintegrated:0.1", Some(0.3))];
    for (words, bound) in cases {
        let report = work.json(&format!("{render}{words}"));
        let found = report["quadrature_error_bound"].as_f64();
        assert!(found.is_some() == bound.is_some(), "{words}: {report}");
        assert!((found.unwrap_or(0.0) - bound.unwrap_or(0.0)).abs() < 1e-9, "{words}: {report}");
    }
    let text = work.text(&format!("{render} --quadrature midpoint:0.5"));
    assert!(text.contains("quadrature midpoint:0.5 states no error"), "{text}");
}

#[test]
fn density_scales_beyond_single_precision_are_refused() {
    let work = Work::new();
    shaded::write(&work.path("s.vdb"), &tinted::<f32>(16, 0.5, unit()), &[], &BTreeMap::new()).unwrap();
    work.refused(
        "render s.vdb --model pre-shaded --views 1 --density-scale 1e39 -o o",
        Code::Invalid,
        &["s.vdb", "1e39", "single precision"],
    );
}

#[test]
fn supersampling_is_the_mean_over_the_pixels_square() {
    let work = Work::new();
    work.json("render @plume.vdb --views 2 --size 16x16 --density-scale 3 --supersample 2 -o box");
    let mut capture = transforms::load(&work.path("box")).unwrap();
    assert_eq!(capture.pixel_filter, PixelFilter::Box);
    // The same view in pixels of half the size.
    for frame in &mut capture.frames {
        let c = &mut frame.camera;
        (c.focal, c.centre, c.width, c.height) = (2.0 * c.focal, 2.0 * c.centre, 32, 32);
    }
    std::fs::create_dir(work.path("half")).unwrap();
    transforms::save(&work.path("half/transforms.json"), &capture, &serde_json::Map::new()).unwrap();
    work.json("render @plume.vdb --cameras half -o fine");
    assert_eq!(transforms::load(&work.path("fine")).unwrap().pixel_filter, PixelFilter::Point);
    let (mean, fine) = (work.picture("box/view_001.exr"), work.picture("fine/view_001.exr"));
    for (i, p) in mean.rgba.iter().enumerate() {
        let (x, y) = (2 * (i % 16), 2 * (i / 16));
        let of = |c: usize| (0..4).map(|k| fine.rgba[(y + k / 2) * 32 + x + k % 2][c]).sum::<f32>() / 4.0;
        for c in 0..4 {
            // Four roundings of sums below 1 and rays that agree to 2^-50.
            assert!((p[c] - of(c)).abs() < 3e-7, "{i} {c}");
        }
    }
}

#[test]
fn pictures_and_json_say_where_they_come_from() {
    let work = Work::new();
    work.json("render @cube.vdb --views 2 --size 8x8 -o cap");
    let attributes = exr::header(&work.path("cap/view_000.exr")).unwrap().attributes();
    let json: Value = serde_json::from_slice(&std::fs::read(work.path("cap/transforms.json")).unwrap()).unwrap();
    let provenance = &json["provenance"];
    assert_eq!(provenance["software"], concat!("cumulo ", env!("CARGO_PKG_VERSION")));
    assert_eq!(attributes["software"], provenance["software"].as_str().unwrap());
    assert_eq!(attributes["cumulo:command"], provenance["command"].as_str().unwrap());
    assert!(attributes["cumulo:command"].contains("cube.vdb --views 2 --size 8x8 -o cap"), "{attributes:?}");
    let (name, hash) = provenance["inputs"].as_object().unwrap().iter().next().unwrap();
    assert!(name.ends_with("cube.vdb"));
    assert_eq!(attributes["cumulo:input"], format!("{name} sha256:{}", hash.as_str().unwrap()));
    assert_eq!(hash.as_str().unwrap().len(), 64);
    assert!(provenance["seconds"].as_f64().unwrap() > 0.0);
}

#[test]
fn a_run_that_fails_leaves_the_earlier_capture() {
    let work = Work::new();
    work.json("render @plume.vdb --views 3 --size 16x16 -o cap");
    work.write("empty.vdb", &[&empty()]);
    work.write("nan.vdb", &[&fields::grid(8, unit(), |p| if p == DVec3::ONE { f64::NAN } else { 1.0 })]);
    work.write("negative.vdb", &[&fields::grid(8, unit(), |_| -1.0)]);
    let before = work.files("cap");
    for (words, code, expected) in [
        ("@plume.vdb --views 3 --grid heat", Code::NoSuchGrid, &["plume.vdb", "no grid 'heat'", "'density'"][..]),
        ("@kinds.vdb --views 3 --grid velocity", Code::Unsupported, &["kinds.vdb", "velocity"]),
        ("empty.vdb --views 3", Code::EmptyGrid, &["empty.vdb", "the grid is empty", "--cameras"]),
        ("empty.vdb --cameras cap --density-scale auto", Code::Invalid, &["empty.vdb", "no pixel meets any density"]),
        ("nan.vdb --views 3", Code::Invalid, &["nan.vdb", "'density'", "1 values are NaN", "--repair"]),
        ("negative.vdb --views 3", Code::Invalid, &["negative.vdb", "512 values are negative;"]),
        ("none.vdb --views 3", Code::NotFound, &["none.vdb", "No such file"]),
        ("@plume.vdb --cameras elsewhere", Code::NotFound, &["elsewhere", "transforms.json"]),
        (
            "@plume.vdb --views 1 --size 65536x65536 --max-memory 1G",
            Code::MemoryLimit,
            &["65536x65536", "--size", "--max-memory"],
        ),
    ] {
        work.refused(&format!("render {words} -o cap"), code, expected);
        assert!(work.files("cap") == before, "{words}: the capture has changed");
    }
    // An empty grid from given cameras is a picture of nothing.
    work.json("render empty.vdb --cameras cap -o nothing");
    assert!(work.picture("nothing/view_000.exr").rgba.iter().all(|p| *p == [1.0, 1.0, 1.0, 0.0]));
}

/// Pictures are spared wherever the capture of `--cameras` has them.
#[test]
fn pictures_in_another_folder_are_not_replaced() {
    let work = Work::new();
    work.json("render @plume.vdb --views 2 --size 8x8 -o shots");
    std::fs::create_dir(work.path("scene")).unwrap();
    let text = std::fs::read_to_string(work.path("shots/transforms.json")).unwrap();
    std::fs::write(work.path("scene/transforms.json"), text.replace("view_", "../shots/view_")).unwrap();
    let before = work.files("shots");
    work.refused("render @plume.vdb --cameras scene -o shots", Code::OutputIsInput, &["view_000.exr"]);
    assert!(work.files("shots") == before);
}

#[test]
fn an_interrupted_run_leaves_the_earlier_capture() {
    let work = Work::new();
    work.json("render @plume.vdb --views 3 --size 16x16 -o cap");
    let before = work.files("cap");
    let child = work.start("render @plume.vdb --views 400 --size 256x256 --supersample 4 --overwrite -o cap");
    until("the first pictures", || work.files("cap").len() > before.len());
    let out = interrupt(child);
    assert_eq!(out.status.code(), Some(130), "{}", errors(&out));
    assert!(errors(&out).contains("stopped by the user"), "{}", errors(&out));
    assert!(work.files("cap") == before, "the capture has changed");
}

#[test]
fn wrong_use_ends_with_2() {
    let work = Work::new();
    std::fs::write(work.path("file"), "").unwrap();
    for (words, code, expected) in [
        ("-o x", Code::Invalid, &["--views", "--cameras"][..]),
        ("--views 2 --cameras cap -o x", Code::Usage, &["cannot be used with"]),
        ("--views 2", Code::Usage, &["--output"]),
        ("--views 0 -o x", Code::Usage, &["1..=100000"]),
        ("--views two -o x", Code::Usage, &["two"]),
        ("--views 2 --view 2 -o x", Code::Invalid, &["--view 2", "2 views"]),
        ("--views 2 --view 3-1 -o x", Code::Usage, &["--view", "empty"]),
        ("--views 2 --exposure 100 -o x", Code::Usage, &["-60 to 60"]),
        ("--views 2 -o x.png", Code::Invalid, &["2 views", "one picture", "--view"]),
        ("--views 2 --layout spiral -o x", Code::Usage, &["sphere", "ring"]),
        ("--views 2 --size 0x8 -o x", Code::Usage, &["WIDTHxHEIGHT"]),
        ("--views 2 --size 8 -o x", Code::Usage, &["WIDTHxHEIGHT"]),
        ("--views 2 --size 8x70000 -o x", Code::Usage, &["65536"]),
        ("--views 2 --fov 180 -o x", Code::Usage, &["170"]),
        (
            "--views 2 --quadrature euler:1 -o x",
            Code::Usage,
            &["preintegrated:TOLERANCE", "midpoint:STEP or riemann:STEP"],
        ),
        ("--views 2 --quadrature midpoint:0 -o x", Code::Usage, &["0.001..1000"]),
        ("--views 2 --density-scale 0 -o x", Code::Usage, &["above zero"]),
        ("--views 2 --density-scale nan -o x", Code::Usage, &["finite"]),
        ("--views 2 --background 1,2 -o x", Code::Usage, &["three"]),
        ("--views 2 --emission=-1,0,0 -o x", Code::Usage, &["must not be negative"]),
        ("--views 2 --model clouds -o x", Code::Usage, &["absorption"]),
        ("--views 2 --supersample 0 -o x", Code::Usage, &["1..=64"]),
        ("--views 2 --threads 0 -o x", Code::Invalid, &["--threads 0", "from 1 to 1024"]),
        ("--views 2 --max-memory lots -o x", Code::Usage, &["4G"]),
        ("--views 2 -o file", Code::Invalid, &["file", "folder"]),
        ("--views 2 -o file/x", Code::NotFound, &["file/x", "folder"]),
        ("--views 2 -o /proc/cumulo", Code::NotFound, &["/proc/cumulo", "folder"]),
    ] {
        work.refused(&format!("render @cube.vdb {words}"), code, expected);
    }
    assert!(!work.path("x").exists(), "nothing is begun");
}

#[test]
fn the_pictures_of_the_given_cameras_are_not_replaced() {
    let work = Work::new();
    work.json("render @plume.vdb --views 2 --size 8x8 -o cap");
    let before = work.files("cap");
    for (cameras, out) in [("cap", "cap"), ("cap/transforms.json", "cap/../cap")] {
        work.refused(
            &format!("render @plume.vdb --cameras {cameras} -o {out}"),
            Code::OutputIsInput,
            &["view_000.exr"],
        );
    }
    assert!(work.files("cap") == before);
}

/// Planes beside RGBA, by name: optical depths are those of alpha, variances those of the rays' own pictures.
#[test]
fn planes_come_with_the_picture() {
    let work = Work::new();
    let words = "render @plume.vdb --views 1 --size 24x20 --density-scale 0.4 --model emission-absorption";
    work.json(&format!("{words} -o plain --supersample 2"));
    work.json(&format!("{words} -o planes --supersample 2 --aov variance,optical-depth"));
    let film =
        |name: &str| exr::read_film_within(&work.path(name).join("view_000.exr"), None, Default::default()).unwrap();
    let (plain, film) = (film("plain"), film("planes"));
    assert_eq!(plain.rgba, film.rgba, "planes change no pixel");
    assert!(plain.planes.is_empty());
    // The same rays as pixels of a picture of twice the size.
    let mut larger: Value =
        serde_json::from_str(&std::fs::read_to_string(work.path("planes/transforms.json")).unwrap()).unwrap();
    for key in ["w", "h"] {
        larger[key] = (2 * larger[key].as_u64().unwrap()).into();
    }
    for key in ["cx", "cy", "fl_x", "fl_y"] {
        larger[key] = (2.0 * larger[key].as_f64().unwrap()).into();
    }
    std::fs::create_dir(work.path("larger")).unwrap();
    std::fs::write(work.path("larger/transforms.json"), larger.to_string()).unwrap();
    work.json("render @plume.vdb --cameras larger --supersample 1 -o single --aov optical-depth");
    let single = exr::read_film_within(&work.path("single/view_000.exr"), None, Default::default()).unwrap();
    let mut varied = 0;
    for (i, pixel) in film.rgba.iter().enumerate() {
        let (x, y) = (2 * (i % 24), 2 * (i / 24));
        let rays = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(u, v)| (y + v) * 48 + x + u);
        for c in 0..4 {
            let samples = rays.map(|ray| f64::from(single.rgba[ray][c]));
            let mean = samples.iter().sum::<f64>() / 4.0;
            let expected = samples.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 12.0;
            let found = f64::from(film.plane(&format!("variance.{}", ["R", "G", "B", "A"][c])).unwrap()[i]);
            // Positions in the larger picture are rounded otherwise.
            assert!((found - expected).abs() < 1e-6 + 1e-3 * expected, "{i} {c}: {found} {expected}");
            assert!((f64::from(pixel[c]) - mean).abs() < 1e-5, "{i} {c}: {pixel:?} {mean}");
            varied += usize::from(found > 1e-6);
        }
        let depth = film.plane("optical_depth.V").unwrap()[i];
        let expected = rays.map(|ray| single.plane("optical_depth.V").unwrap()[ray]).iter().sum::<f32>() / 4.0;
        assert!((depth - expected).abs() < 1e-4, "{i}: {depth} {expected}");
    }
    assert!(varied > 200, "{varied}");
    work.refused(&format!("{words} -o no --aov variance"), Code::Invalid, &["--aov variance", "--supersample"]);
    work.refused(&format!("{words} -o no --aov nothing"), Code::Usage, &["nothing", "optical-depth"]);
}

/// Pictures in which nothing is to be seen say why.
#[test]
fn pictures_of_nothing_say_why() {
    let work = Work::new();
    let size = "--views 1 --size 8x8";
    let remarks = |words: &str| work.json(words)["remarks"].to_string();
    assert!(remarks(&format!("render @plume.vdb {size} --tf ct-bone -o a")).contains("--tf-range"));
    assert!(remarks(&format!("render @plume.vdb {size} --background 0,0,0 -o b")).contains("--background 1,1,1"));
    assert_eq!(remarks(&format!("render @plume.vdb {size} -o c")), "null", "the key is left out");
    let out = work.command(&format!("render @plume.vdb {size} --frames 1-2 --tf ct-bone -o d")).output().unwrap();
    assert_eq!(errors(&out).matches("do not show the volume").count(), 1, "{}", errors(&out));
}

/// Cameras that are placed show the volume in the middle of their pictures: what is seen of it leaves margins of the same
/// width on opposite sides.
#[test]
fn placed_cameras_frame_what_is_to_be_seen_evenly() {
    let work = Work::new();
    for volume in ["cube.vdb", "plume.vdb", "blob_sheared.vdb"] {
        for layout in ["sphere"] {
            work.json(&format!(
                "render @{volume} --views 3 --layout {layout} --size 64x54 --density-scale auto -o out --overwrite"
            ));
            for view in 0..3 {
                let film = exr::read_picture(&work.path(&format!("out/view_{view:03}.exr")), None).unwrap();
                let seen = |x: usize, y: usize| film.rgba[64 * y + x][3] > 0.0;
                let columns: Vec<usize> = (0..64).filter(|x| (0..54).any(|y| seen(*x, y))).collect();
                let rows: Vec<usize> = (0..54).filter(|y| (0..64).any(|x| seen(x, *y))).collect();
                let margins = |all: &[usize], size: usize| [all[0], size - 1 - all[all.len() - 1]];
                for [before, after] in [margins(&columns, 64), margins(&rows, 54)] {
                    assert!(before.abs_diff(after) <= 2, "{volume} {layout} {view}: {columns:?} {rows:?}");
                }
            }
        }
    }
}

/// A limit that is far above the pictures' brightness blackens them, and the report says so.
#[test]
fn a_limit_above_the_brightness_is_remarked() {
    let work = Work::new();
    let lit = "--views 1 --size 12x12 --density-scale 0.05 --albedo 0.9 --sun 1,1,2 --samples 16";
    let remarks = |limit: &str| {
        work.json(&format!("render @plume.vdb {lit} --max-omitted {limit} -o out --overwrite"))["remarks"].to_string()
    };
    assert!(remarks("0.2").contains("--max-omitted is a radiance"), "{}", remarks("0.2"));
    assert!(!remarks("1e-9").contains("--max-omitted"), "{}", remarks("1e-9"));
}

/// Who made an output is told by its settings, however they are written, and whatever the names of the files.
#[test]
fn the_same_settings_are_written_in_many_ways() {
    let work = Work::new();
    work.json("render @plume.vdb --views 2 --size 8x8 --albedo 0.5 --samples 2 -o shots");
    let again = "render --samples 2 @plume.vdb --albedo 0.5 -o shots --size 8x8 --views 2";
    for more in ["--threads 1", "--seed 0 --fov 40", "--max-memory 1G -v", "--up auto"] {
        work.json(&format!("{again} {more}"));
    }
    let before = work.files("shots");
    for other in ["--seed 1", "--clamp 3", "--background 1", "--max-bounces 2", "--anisotropy 0.1", "--fov 41"] {
        work.refused(&format!("{again} {other}"), Code::OutputExists, &["--overwrite"]);
    }
    assert_eq!(work.files("shots"), before);
    let odd = OsString::from_vec(b"b\xffad.vdb".to_vec());
    std::fs::copy(fixture("plume.vdb"), work.path("").join(&odd)).unwrap();
    for (views, code) in [(1, 0), (1, 0), (2, 2)] {
        let mut command = work.command(&format!("render --views {views} --size 8x8 -o odd"));
        assert_eq!(command.arg(&odd).output().unwrap().status.code(), Some(code), "{views}");
    }
}

/// Surfaces are shaded by a light at the camera. Without it the shaded picture is that of emission and absorption; its
/// capture says that colors are no emission, and densities come from alpha.
#[test]
fn surfaces_are_shaded_by_a_light_at_the_camera() {
    let work = Work::new();
    let points = "[[0.1,0.9,0.6,0.3,0],[0.3,0.9,0.6,0.3,0],[0.4,0.9,0.6,0.3,20],[1,0.9,0.6,0.3,20]]";
    let function = format!(
        r#"{{"format":"cumulo-transfer-function","version":1,"transfer":{{"kind":"piecewise","points":{points}}}}}"#
    );
    std::fs::write(work.path("f.tf.json"), function).unwrap();
    let view = "render @plume.vdb --tf f.tf.json --views 1 --size 48x48";
    let picture = |options: &str, name: &str| {
        let report = work.json(&format!("{view} {options} -o {name}"));
        (report, exr::read_picture(&work.path(name), None).unwrap().rgba)
    };
    let (_, plain) = picture("--quadrature exact", "plain.exr");
    let apart = |a: &[[f32; 4]], b: &[[f32; 4]], c: usize| {
        let off = a.iter().zip(b).map(|(a, b)| (a[c] - b[c]).abs());
        off.fold(0.0, f32::max)
    };
    let (report, flat) = picture("--shade=1,0,0,1 --quadrature midpoint:0.05", "flat.exr");
    assert!((0..4).all(|c| apart(&plain, &flat, c) < 0.01), "{report}");
    assert_eq!((&report["quadrature"], &report["quadrature_error_bound"]), (&"midpoint:0.05".into(), &Value::Null));
    let (_, lit) = picture("--shade", "lit.exr");
    assert!(apart(&plain, &lit, 3) < 0.1 && apart(&plain, &lit, 0) > 0.2);
    // Surfaces that turn away are darker, and none is brighter than color and highlight together.
    let most = lit.iter().map(|v| v[0]).fold(0.0, f32::max);
    assert!(most > 0.8 && most <= 0.9 + 0.16, "{most}");
    let (_, smooth) = picture("--shade --gradient-scale 2", "smooth.exr");
    assert!(apart(&lit, &smooth, 0) > 0.01 && apart(&lit, &smooth, 3) == 0.0);

    work.json(&format!("{} --shade -o cap", view.replace("--views 1", "--views 6")));
    let capture: Value = serde_json::from_slice(&std::fs::read(work.path("cap/transforms.json")).unwrap()).unwrap();
    assert_eq!((&capture["model"], &capture["shading"]["terms"]["diffuse"]), (&"scattering".into(), &0.8.into()));
    work.refused("reconstruct tf cap --volume @plume.vdb -o no.tf.json", Code::Unsupported, &["scatter"]);
    for (options, code) in [
        ("--shade --albedo 0.5", Code::Usage),
        ("--shade=1,2,3,4,5", Code::Usage),
        ("--gradient-scale 1", Code::Invalid),
        ("--shade --gradient-scale 17", Code::Usage),
        ("--shade --quadrature exact", Code::Invalid),
        ("--shade --target-error 0.01", Code::Invalid),
    ] {
        work.refused(&format!("{view} {options} -o no.exr"), code, &[]);
    }
    work.refused("render @plume.vdb --views 1 --size 8x8 --shade -o no.exr", Code::Unsupported, &["--tf"]);
}

/// A level set shows what its fog volume shows.
#[test]
fn a_level_set_is_rendered_as_the_fog_inside_of_its_surface() {
    let work = Work::new();
    work.text("convert @sphere_level_set.vdb fog.vdb --to fog");
    for options in ["", "--tf viridis", "--albedo 0.8 --sky 1 --samples 4"] {
        let [direct, converted] = [("@sphere_level_set.vdb", "a"), ("fog.vdb", "b")].map(|(input, name)| {
            let output = format!("{name}{}.exr", options.len());
            work.text(&format!("render {input} --views 1 --size 24x24 {options} -o {output}"));
            exr::read_picture(&work.path(&output), None).unwrap().rgba
        });
        assert!(direct == converted && direct.iter().any(|rgba| rgba[3] > 0.1), "{options}");
    }
}

/// Colors of 16 bits are those of 32, rounded; depths, and what does not fit, stay in 32.
/// DWA loses digits of colors by its level, and none of alpha and depth.
#[test]
fn pictures_are_packed_with_loss_where_that_is_asked_for() {
    let work = Work::new();
    let words = "render @plume.vdb --views 1 --size 64x64 --albedo 0.9 --sun 0,0,1 --sky 0.2 --samples 4";
    work.json(&format!("{words} --aov depth,albedo -o zip.exr"));
    let zip = work.picture("zip.exr");
    let size = |name: &str| std::fs::metadata(work.path(name)).unwrap().len();
    for (packing, most) in [("dwaa", 0.05), ("dwab:45", 0.05), ("dwaa:1", 0.005)] {
        work.json(&format!("{words} --aov depth,albedo --compression {packing} -o dwa.exr --overwrite"));
        let dwa = work.picture("dwa.exr");
        let colors = zip.rgba.iter().zip(&dwa.rgba).map(|(a, b)| [0, 1, 2].map(|c| (a[c] - b[c]).abs()));
        let largest = colors.flatten().fold(0.0_f32, f32::max);
        assert!(largest > 0.0 && largest < most, "{packing}: {largest}");
        assert!(zip.rgba.iter().zip(&dwa.rgba).all(|(a, b)| a[3] == b[3]), "{packing}");
        let document = exr::read(&work.path("dwa.exr")).unwrap();
        let exact = exr::read(&work.path("zip.exr")).unwrap();
        let depth = |image: &exr::Image| {
            image.layers.iter().find(|layer| layer.name == "Depth").map(|layer| layer.channels[0].samples.clone())
        };
        assert!(depth(&exact).is_some() && depth(&document) == depth(&exact), "{packing}");
        assert!(size("dwa.exr") < size("zip.exr"), "{packing}");
    }
    let info = work.json("info dwa.exr");
    assert!(info.to_string().to_lowercase().contains("dwaa"), "{info}");
    // What no half float holds is not made infinite.
    let bright = "render @plume.vdb --views 1 --size 16x16 --model emission-absorption --emission 1e6,1,1";
    work.json(&format!("{bright} --density-scale 5 --compression dwaa -o bright.exr"));
    let bright = work.picture("bright.exr");
    assert!(bright.rgba.iter().flatten().all(|v| v.is_finite()) && bright.rgba.iter().any(|rgba| rgba[0] > 65504.0));
    work.refused(&format!("{words} --compression zip:3 -o x.exr"), Code::Usage, &["zip:3", "dwaa:20"]);
    work.refused(&format!("{words} --compression dwaa:-1 -o x.exr"), Code::Usage, &["dwaa:-1"]);
    work.refused(&format!("{words} --compression dwaa --aov normal -o x.exr"), Code::Invalid, &["normal", "Y"]);
    work.refused(&format!("{words} --compression dwaa --denoise -o x.exr"), Code::Invalid, &["--compression"]);
    work.refused(&format!("{words} --compression dwaa --deep 0.1 -o x.exr"), Code::Usage, &["--compression"]);
    work.refused(
        &format!("{words} --compression dwaa --replicates 2-3 -o x.exr"),
        Code::Invalid,
        &["--compression", "replicates"],
    );
}

#[test]
fn pictures_of_half_floats_are_half_as_large() {
    let work = Work::new();
    let words = "render @plume.vdb --views 1 --size 48x32 --density-scale 4 --albedo 0.9 --samples 4";
    work.json(&format!("{words} -o full.exr"));
    work.json(&format!("{words} --half -o half.exr"));
    let types = |name: &str| {
        let channels = exr::header(&work.path(name)).unwrap().parts[0].channels.clone();
        channels.into_iter().map(|channel| channel.sample_type).collect::<Vec<_>>()
    };
    let type_of = |name: &str| types(name)[0];
    assert_eq!([type_of("full.exr"), type_of("half.exr")], [exr::SampleType::Float, exr::SampleType::Half]);
    let [full, half] = ["full.exr", "half.exr"].map(|name| work.picture(name));
    for (full, half) in full.rgba.iter().flatten().zip(half.rgba.iter().flatten()) {
        assert!((full - half).abs() <= full.abs() / 2048.0 + 6e-8, "{full} {half}");
    }
    let bytes = |name: &str| std::fs::metadata(work.path(name)).unwrap().len();
    assert!(bytes("half.exr") * 3 < bytes("full.exr") * 2, "{} {}", bytes("half.exr"), bytes("full.exr"));
    work.json(&format!("{words} --half --aov depth -o planes.exr"));
    // Depth.Z stands between the colors.
    let (half, float) = (exr::SampleType::Half, exr::SampleType::Float);
    assert_eq!(types("planes.exr"), [half, half, float, half, half]);
    // A part of a picture, and one that is too bright.
    work.json(&format!("{words} --half --crop 8,8,16x8 -o part.exr"));
    work.json(&format!("{words} --half --sky 1e6 -o bright.exr"));
    assert_eq!([type_of("part.exr"), type_of("bright.exr")], [exr::SampleType::Half, exr::SampleType::Float]);
    work.refused(&format!("{words} --half --replicates 0-1 -o sums.exr"), Code::Invalid, &["--half", "replicates"]);
}
