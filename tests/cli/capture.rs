//! `cumulo capture convert`, and captures of other programs in the commands that take captures.

use crate::common::work::Work;
use cumulo::error::Code;
use cumulo::formats::{captures, exr, transforms};
use cumulo::scene::camera::Camera;
use cumulo::scene::capture::{Model, Pictures};
use cumulo::scene::color_space::ColorSpace;
use cumulo::scene::display;
use cumulo::scene::film::Film;
use cumulo::scene::lens::Lens;
use glam::{DMat2, DVec2};
use serde_json::{Value, json};
use std::path::Path;

fn rewrite(work: &Work, name: &str, change: impl FnOnce(&mut Value)) {
    let path = work.path(name);
    let mut text: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    change(&mut text);
    std::fs::write(path, text.to_string()).unwrap();
}

/// Writes a film as an sRGB PNG of 8 bits without alpha, and without stating the curve.
fn png8(path: &Path, film: &Film) {
    let bytes: Vec<u8> = film
        .rgba
        .iter()
        .flat_map(|p| [p[0], p[1], p[2]].map(|v| (255.0 * display::value(v.clamp(0.0, 1.0)) + 0.5) as u8))
        .collect();
    let mut encoder = png::Encoder::new(std::fs::File::create(path).unwrap(), film.width as u32, film.height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header().unwrap().write_image_data(&bytes).unwrap();
}

#[test]
fn pictures_of_8_bits_are_reconstructed_from() {
    let work = Work::new();
    work.json("render @plume.vdb --views 8 --size 24x24 --density-scale auto -o shots");
    for (i, frame) in transforms::load(&work.path("shots")).unwrap().frames.iter().enumerate() {
        png8(&work.path(&format!("shots/view_{i:03}.png")), &exr::read_picture(&frame.picture, None).unwrap());
    }
    std::fs::copy(work.path("shots/transforms.json"), work.path("shots/eight.json")).unwrap();
    rewrite(&work, "shots/eight.json", |text| {
        for (i, frame) in text["frames"].as_array_mut().unwrap().iter_mut().enumerate() {
            frame["file_path"] = json!(format!("view_{i:03}.PNG"));
        }
    });
    let reconstruct = |capture: &str| {
        let words = format!("reconstruct density {capture} -o {}.vdb --resolution 16 --iterations 4", capture.len());
        work.json(&words)
    };
    work.refused(
        "reconstruct density shots/eight.json -o no.vdb",
        Code::Invalid,
        &["view_000.png", "8 bits", "color_space"],
    );
    work.refused("capture convert shots/eight.json -o no", Code::Invalid, &["transfer curve", "--color-space"]);
    assert!(!work.path("no").exists());
    let converted = work.json("capture convert shots/eight.json -o converted --color-space srgb");
    assert_eq!((&converted["written"], &converted["integer"]), (&json!(8), &json!(8)));
    rewrite(&work, "shots/eight.json", |text| text["color_space"] = json!("sRGB"));
    let [exact, direct, by_exr] = ["shots", "shots/eight.json", "converted"].map(reconstruct);
    let words = |report: &Value| report["warnings"].to_string();
    assert!(words(&direct).contains("integer samples of 8 bits") && !words(&exact).contains("integer"));
    let psnr = |report: &Value| report["train_psnr_db"].as_f64().unwrap();
    // Half a level of 8 bits next to white is 0.0045 of radiance, uniformly spread 52 dB from the truth.
    assert!(psnr(&direct) > psnr(&exact).min(45.0) - 3.0, "{} {}", psnr(&direct), psnr(&exact));
    assert_eq!(psnr(&direct), psnr(&by_exr), "the same pictures");
    assert!(work.text("info shots/eight.json").contains("8 PNG, integer samples in sRGB"));
    assert!(work.text("validate shots/eight.json").contains("valid"));
}

/// Position on the plane of a pinhole camera of what a lens shows at `q`, by Newton's method with differences.
fn undistorted(lens: &Lens, q: DVec2) -> DVec2 {
    let mut p = q;
    for _ in 0..30 {
        let (h, f) = (1e-6, lens.distort(p) - q);
        let dx = (lens.distort(p + DVec2::X * h) - lens.distort(p - DVec2::X * h)) / (2.0 * h);
        let dy = (lens.distort(p + DVec2::Y * h) - lens.distort(p - DVec2::Y * h)) / (2.0 * h);
        p -= DMat2::from_cols(dx, dy).inverse() * f;
    }
    p
}

/// Views through a lens are made from larger pinhole views; what comes back is what the pinhole cameras see.
#[test]
fn distorted_views_become_those_of_pinhole_cameras() {
    let work = Work::new();
    work.json("render @plume.vdb --views 2 --size 144x144 --density-scale auto -o fine");
    let lens = Lens::brown([-0.25, 0.06, 0.0, 0.0, 0.0, 0.0], [2e-3, -1e-3]);
    let capture = transforms::load(&work.path("fine")).unwrap();
    std::fs::create_dir(work.path("lens")).unwrap();
    for (i, frame) in capture.frames.iter().enumerate() {
        let fine = exr::read_picture(&frame.picture, None).unwrap();
        let Camera { focal, centre, .. } = frame.camera;
        let mut film = Film::new(48, 48);
        for (y, x) in (0..48).flat_map(|y| (0..48).map(move |x| (y, x))) {
            let plane = (3.0 * (DVec2::new(x as f64, y as f64) + 0.5) - centre) / focal;
            // The fine view is nine times as dense: the nearest of its pixels is a sixth of a pixel away at most.
            let at = (centre + focal * undistorted(&lens, plane)).floor().clamp(DVec2::ZERO, DVec2::splat(143.0));
            film.rgba[y * 48 + x] = fine.rgba[at.y as usize * 144 + at.x as usize];
        }
        exr::write_picture(&work.path(&format!("lens/view_{i:03}.exr")), &film, &Default::default(), exr::Half::None)
            .unwrap();
    }
    std::fs::copy(work.path("fine/transforms.json"), work.path("lens/transforms.json")).unwrap();
    rewrite(&work, "lens/transforms.json", |text| {
        for key in ["fl_x", "fl_y", "cx", "cy"] {
            text[key] = json!(text[key].as_f64().unwrap() / 3.0);
        }
        (text["w"], text["h"], text["camera_model"]) = (json!(48), json!(48), json!("OPENCV"));
        (text["k1"], text["k2"], text["p1"], text["p2"]) = (json!(-0.25), json!(0.06), json!(2e-3), json!(-1e-3));
    });
    work.refused(
        "reconstruct density lens -o no.vdb",
        Code::Unsupported,
        &["frame 0", "'k1' is -0.25", "cumulo capture convert"],
    );
    assert!(work.text("info lens").contains("lens distortion: 2 view(s)"));
    let report = work.json("capture convert lens -o flat");
    assert_eq!((&report["undistorted"], &report["written"]), (&json!(2), &json!(2)));
    let scale = capture.density_scale;
    work.json(&format!("render @plume.vdb --cameras flat --density-scale {scale} -o direct"));
    for i in 0..2 {
        let [a, b] = ["flat", "direct"].map(|folder| work.picture(&format!("{folder}/view_{i:03}.exr")));
        assert!(a.width >= 44, "{}x{}", a.width, a.height);
        let square: f64 = a.rgba.iter().zip(&b.rgba).map(|(a, b)| f64::from(a[0] - b[0]).powi(2)).sum();
        let psnr = -10.0 * (square / a.rgba.len() as f64).log10();
        // Without the lens taken out, edges are several pixels off and the pictures below 30 dB apart.
        assert!(psnr > 38.0, "view {i}: {psnr} dB");
    }
}

#[test]
fn colmaps_models_are_cameras() {
    let work = Work::new();
    work.json("render @plume.vdb --views 4 --size 16x12 --density-scale auto -o shots");
    let report = work.json("capture convert shots -o model --to colmap");
    assert_eq!(report["written"], 4);
    assert!(report["warnings"].to_string().contains("no light model"));
    let [ours, theirs] = ["shots", "model"].map(|name| captures::load(&work.path(name)).unwrap());
    for (a, b) in ours.frames.iter().zip(&theirs.frames) {
        assert!(
            a.camera.camera_to_world.abs_diff_eq(b.camera.camera_to_world, 1e-12) && a.camera.focal == b.camera.focal
        );
        let [a, b] = [a, b].map(|f| exr::read_picture(&f.picture, None).unwrap());
        assert_eq!(a.rgba, b.rgba);
    }
    assert!(work.text("info model").contains("4 view(s)") && work.text("validate model/sparse/0").contains("valid"));
    let scale = ours.density_scale;
    work.json(&format!("render @plume.vdb --cameras model/sparse/0/images.txt --density-scale {scale} -o again"));
    let worst = |a: &Film, b: &Film| a.rgba.iter().zip(&b.rgba).map(|(a, b)| (a[0] - b[0]).abs()).fold(0.0, f32::max);
    // Rays move by 1e-15 of their length; pictures are 32-bit floats of order 1.
    assert!(worst(&work.picture("shots/view_002.exr"), &work.picture("again/view_002.exr")) < 1e-5);
    work.json("reconstruct density model -o found.vdb --resolution 12 --iterations 2");
    // Inputs are spared, whatever their format.
    work.refused("capture convert model -o model --to colmap --overwrite", Code::OutputIsInput, &["view_000.exr"]);
}

#[test]
fn exrs_in_which_nothing_changes_stay_where_they_are() {
    let work = Work::new();
    work.json("render @plume.vdb --views 3 --size 12x12 --density-scale auto -o shots");
    let report = work.json("capture convert shots -o moved --scale 2 --offset 1,0,-1");
    assert_eq!((&report["written"], &report["views"]), (&json!(0), &json!(3)));
    let [before, after] = ["shots", "moved"].map(|name| captures::load(&work.path(name)).unwrap());
    assert_eq!(before.density_scale, 2.0 * after.density_scale);
    for (a, b) in before.frames.iter().zip(&after.frames) {
        assert_eq!(2.0 * a.camera.position() + glam::DVec3::new(1.0, 0.0, -1.0), b.camera.position());
        assert_eq!(a.picture.canonicalize().unwrap(), b.picture.canonicalize().unwrap());
    }
    let text = std::fs::read_to_string(work.path("moved/transforms.json")).unwrap();
    assert!(text.contains("../shots/view_000.exr"), "{text}");
    // The same command writes again; another one needs a word.
    work.json("capture convert shots -o moved --scale 2 --offset 1,0,-1");
    work.refused("capture convert shots -o moved", Code::OutputExists, &["--overwrite"]);

    // Pictures from elsewhere: by name, and by number.
    std::fs::create_dir(work.path("png")).unwrap();
    for i in 0..3 {
        let film = work.picture(&format!("shots/view_{i:03}.exr"));
        png8(&work.path(&format!("png/view_{i:03}.png")), &film);
    }
    for from in ["png", "png/view_###.png"] {
        let report =
            work.json(&format!("capture convert shots -o by --pictures {from} --color-space sRGB --overwrite"));
        assert_eq!(report["integer"], 3);
        let linear = ColorSpace::Srgb.table(8);
        assert!(work.picture("by/view_001.exr").rgba.iter().all(|p| linear.contains(&p[0])));
    }
    work.refused("capture convert shots -o no --pictures png/view_##1.png", Code::Invalid, &["3 views"]);
    work.refused("capture convert shots -o no --pictures .", Code::Invalid, &["view_000"]);
}

/// Photographs of a light medium in a dark room, as a camera hands them out: black is a level or two, nothing is stated.
#[test]
fn photographs_tell_their_setting() {
    let work = Work::new();
    let medium = "--model emission-absorption --emission 0.8,0.8,0.8 --background 0,0,0 --density-scale auto";
    work.json(&format!("render @plume.vdb --views 9 --size 48x48 {medium} -o shots"));
    for i in 0..9 {
        let mut film = work.picture(&format!("shots/view_{i:03}.exr"));
        for (k, pixel) in film.rgba.iter_mut().enumerate() {
            // Code 1 where black is 0, and 0 or 2 now and then.
            let level = match (k * 7919 + i) % 40 {
                0 => 0.0,
                1 => 2.0,
                _ => 1.0,
            };
            pixel[..3].iter_mut().for_each(|v| *v += (level / 12.92 / 255.0) as f32);
        }
        png8(&work.path(&format!("photo_{i}.png")), &film);
    }
    rewrite(&work, "shots/transforms.json", |text| {
        let (frames, size) = (text["frames"].clone(), [text["w"].clone(), text["h"].clone(), text["fl_x"].clone()]);
        *text = json!({ "frames": frames, "w": size[0], "h": size[1], "fl_x": size[2] });
    });
    let photos = (0..8).map(|i| format!("photo_{i}.png")).collect::<Vec<_>>().join(" ");
    work.refused(
        &format!("capture convert shots -o no --photographs --pictures {photos}"),
        Code::Invalid,
        &["8 pictures for 9 views"],
    );
    let report = work.json(&format!("capture convert shots -o shot --photographs --pictures {photos} photo_8.png"));
    assert!(
        report["setting"].as_str().unwrap().contains("light medium") && report["warnings"] == json!([]),
        "{report}"
    );
    let stated = transforms::load(&work.path("shot")).unwrap();
    assert_eq!((stated.model, stated.background), (Model::EmissionAbsorption, [0.0; 3]));
    assert_eq!(stated.pictures, Some(Pictures::Photographs));

    // The last view is seen by no solver: what is found must show it, and nothing beside it.
    rewrite(&work, "shot/transforms.json", |text| {
        text["frames"].as_array_mut().unwrap().truncate(8);
    });
    let report = work.json("reconstruct density shot -o found.vdb --held-out 0 --iterations 24");
    let pixels = 8.0 * 48.0 * 48.0;
    assert!(report["unknowns"].as_f64().unwrap() <= 1.1 * pixels, "{}", report["unknowns"]);
    work.json("render found.vdb --cameras shots --view 8 --model emission-absorption --background 0,0,0 -o seen");
    let [seen, real] = ["seen/view_008.exr", "shots/view_008.exr"].map(|name| work.picture(name));
    let mean = |film: &Film, of: fn(f64) -> f64| {
        film.rgba.iter().zip(&real.rgba).map(|(a, b)| of(f64::from(a[0] - b[0]))).sum::<f64>() / (48.0 * 48.0)
    };
    let psnr = -10.0 * mean(&seen, |d| d * d).log10();
    assert!(psnr > 35.0, "{psnr}");
    let ghosts = seen.rgba.iter().zip(&real.rgba).filter(|(_, real)| real[0] == 0.0).map(|(seen, _)| seen[0]);
    assert!(ghosts.fold(0.0, f32::max) < 0.02);
}

/// A video is told by its first bytes; without the program that decodes it, or without such a frame, nothing is written.
#[test]
fn videos_need_their_decoder() {
    let work = Work::new();
    work.json("render @plume.vdb --views 1 --size 8x8 --density-scale auto -o shots");
    std::fs::write(work.path("take.mov"), b"\0\0\0\x14ftypqt  \0\0\0\0").unwrap();
    let mut command = work.command("capture convert shots -o no --pictures take.mov --photographs");
    let without = command.env("PATH", work.path("nothing")).output().unwrap();
    assert_eq!(without.status.code(), Some(2));
    let words = String::from_utf8_lossy(&without.stderr);
    assert!(words.contains("take.mov") && words.contains("ffmpeg") && words.contains("not installed"), "{words}");
    assert!(std::fs::read_dir(work.path("")).unwrap().count() == 2, "nothing is left behind");
}

#[test]
fn masks_are_asked_about() {
    let work = Work::new();
    work.json("render @plume.vdb --views 1 --size 8x8 --density-scale auto -o shots");
    let mut mask = Film::of(8, 8, vec![[1.0; 4]; 64]);
    mask.rgba[..32].fill([0.0, 0.0, 0.0, 1.0]);
    png8(&work.path("shots/mask.png"), &mask);
    rewrite(&work, "shots/transforms.json", |text| text["frames"][0]["mask_path"] = json!("mask.png"));
    work.refused(
        "reconstruct density shots -o no.vdb",
        Code::Unsupported,
        &["frame 0", "mask_path", "--masked background"],
    );
    work.refused("capture convert shots -o no", Code::Invalid, &["frame 0", "--masked used"]);
    assert_eq!(work.json("capture convert shots -o used --masked used")["written"], 0);
    assert_eq!(work.json("capture convert shots -o covered --masked background")["written"], 1);
    let [before, after] = ["shots", "covered"].map(|folder| work.picture(&format!("{folder}/view_000.exr")));
    assert!(after.rgba[..32].iter().all(|p| *p == [1.0, 1.0, 1.0, 0.0]) && after.rgba[32..] == before.rgba[32..]);
    captures::load(&work.path("covered")).unwrap();
}
