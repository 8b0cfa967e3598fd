//! `cumulo render` of single pictures: files by their names, PNGs, sizes, parts and chosen views.

use crate::common::work::{Work, fixture};
use cumulo::error::Code;
use cumulo::formats::{exr, picture, png, transforms};
use cumulo::scene::film::Film;
use serde_json::json;

/// Display values of a PNG, from 0 to 255.
fn levels(work: &Work, name: &str) -> Vec<u8> {
    use cumulo::scene::color_space::ColorSpace;
    let options = picture::Options { color_space: Some(ColorSpace::Linear), ..picture::Options::default() };
    let film = picture::read(&work.path(name), &options).unwrap().film;
    film.rgba.iter().flat_map(|[r, g, b, _]| [*r, *g, *b].map(|v| (255.0 * v).round() as u8)).collect()
}

#[test]
fn a_name_of_a_picture_is_the_picture() {
    let work = Work::new();
    let options = "--views 1 --size 20x14 --density-scale 3";
    work.json(&format!("render @plume.vdb {options} -o cap"));
    work.json(&format!("render @plume.vdb {options} -o one.exr"));
    assert_eq!(work.picture("one.exr"), work.picture("cap/view_000.exr"));
    let report = work.json(&format!("render @plume.vdb {options} --exposure -1 -o ONE.PNG"));
    assert_eq!(report["tone_mapping"], json!({"exposure": -1.0}));
    let tone = png::ToneMapping { exposure: -1.0 };
    assert_eq!(levels(&work, "ONE.PNG"), tone.rgb8(&work.picture("one.exr")));
    let texts = png::texts(&work.path("ONE.PNG")).unwrap();
    assert!(texts["Tone mapping"].contains("sRGB") && texts["cumulo:command"].contains("-o ONE.PNG"), "{texts:?}");
    assert_eq!(std::fs::read_dir(work.path("")).unwrap().count(), 3, "no capture beside them");
    // The same command writes it again; another one does not.
    work.json(&format!("render @plume.vdb {options} -o one.exr"));
    for name in ["one.exr", "ONE.PNG"] {
        work.refused(
            &format!("render @cube.vdb --views 1 --size 8x8 -o {name}"),
            Code::OutputExists,
            &[name, "--overwrite"],
        );
    }
    work.json("render @cube.vdb --views 1 --size 8x8 --overwrite -o one.exr");
    // One frame, and one of several views.
    std::fs::copy(fixture("plume.vdb"), work.path("s.0003.vdb")).unwrap();
    work.json(&format!("render s.####.vdb {options} -o frame.exr"));
    assert_eq!(work.picture("frame.exr"), work.picture("cap/view_000.exr"));
    work.json("render @plume.vdb --views 4 --size 12x9 -o four");
    work.json("render @plume.vdb --views 4 --size 12x9 --view 2 -o two.exr");
    assert_eq!(work.picture("two.exr"), work.picture("four/view_002.exr"));
    work.refused("render s.####.vdb --views 1 --frames 3-4 -o f.exr", Code::Invalid, &["2 frames", "--frames"]);
    work.refused("render @cube.vdb --views 1 --exposure 1 -o a.exr", Code::Invalid, &["--exposure", "--png"]);
    // A folder that has such a name stays a folder.
    std::fs::create_dir(work.path("odd.png")).unwrap();
    work.json("render @cube.vdb --views 1 --size 8x8 -o odd.png");
    assert!(work.path("odd.png/view_000.exr").exists());
}

#[test]
fn pngs_lie_beside_the_pictures() {
    let work = Work::new();
    let report = work.json("render @plume.vdb --views 2 --size 16x12 --density-scale 3 --png -o cap");
    assert_eq!(report["tone_mapping"]["exposure"], json!(0.0));
    for view in ["cap/view_000", "cap/view_001"] {
        let expected = png::ToneMapping { exposure: 0.0 }.rgb8(&work.picture(&format!("{view}.exr")));
        assert_eq!(levels(&work, &format!("{view}.png")), expected);
    }
    std::fs::copy(fixture("plume.vdb"), work.path("s.0001.vdb")).unwrap();
    let frames = "render s.####.vdb --views 1 --size 16x12 --density-scale 3 --png -o frames";
    work.json(frames);
    assert_eq!(levels(&work, "frames/frame.0001.png").len(), 3 * 16 * 12);
    // A frame whose PNG is gone is not done.
    std::fs::remove_file(work.path("frames/frame.0001.png")).unwrap();
    assert_eq!(work.json(&format!("{frames} --resume"))["rendered"], json!(1));
    assert_eq!(work.json(&format!("{frames} --resume"))["skipped"], json!(1));
    assert!(work.json("render @cube.vdb --views 1 --size 8x8 -o plain").get("tone_mapping").is_none());
}

/// In twice the size every other pixel's corner is a corner of the old pixels: means over 2 x 2 of the new ones are what
/// supersampling gives.
#[test]
fn sizes_scale_the_cameras_of_a_capture() {
    let work = Work::new();
    work.json("render @plume.vdb --views 3 --size 16x12 --density-scale 3 --supersample 2 -o cap");
    work.json("render @plume.vdb --cameras cap --size 32x24 -o twice");
    let (coarse, fine) = (work.picture("cap/view_001.exr"), work.picture("twice/view_001.exr"));
    for (i, expected) in coarse.rgba.iter().enumerate() {
        let (x, y) = (2 * (i % 16), 2 * (i / 16));
        let mean = (0..4).map(|k| fine.rgba[(y + k / 2) * 32 + x + k % 2][3]).sum::<f32>() / 4.0;
        // Four equal rays, summed in another order: a few roundings of numbers up to 1.
        assert!((mean - expected[3]).abs() < 1e-6, "{i}: {mean} {}", expected[3]);
    }
    // A wider picture shows the same in its middle, and more beside it.
    work.json("render @plume.vdb --cameras cap --size 26x12 --supersample 2 -o wide");
    let wide = work.picture("wide/view_001.exr");
    for (i, expected) in coarse.rgba.iter().enumerate() {
        let found = wide.rgba[i / 16 * 26 + 5 + i % 16];
        assert!((found[3] - expected[3]).abs() < 1e-6, "{i}: {found:?} {expected:?}");
    }
    let camera = transforms::load(&work.path("wide")).unwrap().frames[1].camera;
    assert_eq!((camera.width, camera.height), (26, 12));
}

#[test]
fn parts_have_their_place_in_files_and_cameras_in_folders() {
    let work = Work::new();
    let options = "--views 1 --size 24x20 --density-scale 4";
    work.json(&format!("render @plume.vdb {options} -o whole.exr"));
    let whole = work.picture("whole.exr");
    let inside = |i: usize| (9..21).contains(&(i % 24)) && (5..13).contains(&(i / 24));
    work.json(&format!("render @plume.vdb {options} --crop 9,5,21,13 -o part.exr"));
    let header = exr::header(&work.path("part.exr")).unwrap();
    assert_eq!(
        (header.display_window.size, header.data_window.min, header.data_window.size),
        ([24, 20], [9, 5], [12, 8])
    );
    let part = work.picture("part.exr");
    for (i, (part, whole)) in part.rgba.iter().zip(&whole.rgba).enumerate() {
        assert_eq!(*part, if inside(i) { *whole } else { [0.0; 4] }, "{i}");
    }
    // Both ways to name a part, and the capture of parts.
    work.json(&format!("render @plume.vdb {options} --crop 9,5,21,13 -o a"));
    work.json(&format!("render @plume.vdb {options} --crop 9,5,12x8 -o b"));
    let a = work.picture("a/view_000.exr");
    assert_eq!((a.width, a.height), (12, 8));
    assert_eq!(a, work.picture("b/view_000.exr"));
    work.json("render @plume.vdb --cameras a -o again.exr");
    assert_eq!(work.picture("again.exr"), a);
    // Of a PNG only the part is there.
    work.json(&format!("render @plume.vdb {options} --crop 9,5,21,13 -o part.png"));
    assert_eq!(levels(&work, "part.png").len(), 3 * 12 * 8);
    work.refused(&format!("render @plume.vdb {options} --crop 9,5,9,13 -o x"), Code::Usage, &["--crop", "no pixel"]);
}

/// Chosen views are those of the whole capture, noise included, and keep their numbers.
#[test]
fn views_are_chosen_by_number() {
    let work = Work::new();
    let lit = "--albedo 0.9 --sun 1,1,1 --samples 2 --density-scale auto";
    work.json(&format!("render @plume.vdb --views 5 --size 10x8 {lit} -o all"));
    let report = work.json(&format!("render @plume.vdb --views 5 --size 10x8 {lit} --view 3,0-1 -o some"));
    assert_eq!(report["views"], json!(3));
    let names: Vec<_> = transforms::load(&work.path("some")).unwrap().frames.into_iter().map(|f| f.picture).collect();
    assert_eq!(names, ["view_000.exr", "view_001.exr", "view_003.exr"].map(|name| work.path("some").join(name)));
    for name in ["view_000.exr", "view_003.exr"] {
        assert_eq!(work.picture(&format!("some/{name}")), work.picture(&format!("all/{name}")), "{name}");
    }
    work.json(&format!("render @plume.vdb --cameras all {lit} --view 4 -o last"));
    let same = |a: &Film, b: &Film| a.rgba.iter().zip(&b.rgba).all(|(a, b)| (a[3] - b[3]).abs() < 1.0);
    assert!(same(&work.picture("last/view_004.exr"), &work.picture("all/view_004.exr")));
    work.refused("render @plume.vdb --cameras all --view 5 -o x", Code::Invalid, &["--view 5", "5 views", "from 0"]);
}

#[test]
fn names_that_cannot_be_meant_are_refused_everywhere() {
    let work = Work::new();
    work.json("render @cube.vdb --views 4 --size 8x8 -o cap");
    let before = work.files("");
    for (words, code, expected) in [
        ("render @cube.vdb --views 1 -o a.nvdb", Code::OutputName, "folder"),
        ("render @cube.vdb --views 1 -o a.usd", Code::OutputName, "folder"),
        ("convert @cube.vdb a.png", Code::Unsupported, ".png"),
        ("convert @cube.vdb -", Code::Unsupported, "standard output"),
        ("reconstruct density cap -o a.png", Code::OutputName, ".vdb"),
        ("reconstruct density cap -o -", Code::Unsupported, "standard output"),
        ("viewpoint @cube.vdb -o a.exr", Code::OutputName, ".json"),
        ("viewpoint @cube.vdb -o a.json --pictures p.png", Code::OutputName, "folder"),
        ("capture convert cap -o a.png", Code::OutputName, "folder"),
        ("denoise cap/view_%03d.exr -o a_%03d.png", Code::OutputName, ".exr"),
        ("denoise cap/view_%03d.exr -o -", Code::Invalid, "sequence"),
        ("motion @cube.vdb --cameras cap -o m_%03d.vdb", Code::OutputName, ".exr"),
        ("transfer viridis -o a.png", Code::OutputName, ".json"),
        ("usd author @cube.vdb -o a.usdc", Code::OutputName, ".usda"),
        ("gradient @cube.vdb --views 1 --loss mean --wrt density -o a.exr", Code::OutputName, ".vdb"),
        ("compare cap/view_%03d.exr cap/view_%03d.exr --report a.png", Code::OutputName, "folder"),
        ("view @cube.vdb -o a.jpg", Code::OutputName, ".png"),
    ] {
        work.refused(words, code, &[expected]);
    }
    assert_eq!(work.files(""), before);
}
