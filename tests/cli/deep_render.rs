//! Deep renders: what their samples show before a depth is what a holdout there leaves.

use crate::common::shapes::{ball, quad, write_ply};
use crate::common::work::{Work, fixture_text, write_exr};
use cumulo::error::Code;
use cumulo::formats::exr::deep::{self, TidyPixel};
use glam::DVec3;
use serde_json::json;

const SIZE: [usize; 2] = [24, 20];

/// A camera that looks down -Z at the plume.
fn write_camera(work: &Work) {
    let frame = json!({
        "file_path": "view.0000.exr",
        "transform_matrix": [[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 4], [0, 0, 0, 1]],
    });
    let json = json!({"w": SIZE[0], "h": SIZE[1], "fl_x": 30.0, "near": 0.0, "frames": [frame]});
    std::fs::write(work.path("camera.json"), json.to_string()).unwrap();
}

/// Writes a depth for each pixel, all over the plume, and returns them.
fn write_depths(work: &Work, name: &str, seed: usize) -> Vec<f32> {
    let depth = |i: usize| 1.5 + 3.0 * ((i * 7919 + seed * 104_729) % 9973) as f32 / 9973.0;
    let depths: Vec<f32> = (0..SIZE[0] * SIZE[1]).map(depth).collect();
    write_exr(&work.path(name), SIZE, &[("Z", depths.clone())], |_, _| ());
    depths
}

/// Largest difference of the deep picture's samples before depths from the pictures that holdouts there leave, in units
/// of 1 or of the brightest channel, and the number of samples a pixel that has any.
fn off(work: &Work, words: &str, error: f64) -> (f64, f64) {
    let report = work.json(&format!("render {words} --deep {error} -o deep.exr --overwrite"));
    assert_eq!(report["deep"]["error"], json!(error));
    let picture = deep::read(&work.path("deep.exr")).unwrap();
    let pixels: Vec<TidyPixel> = picture.lines.iter().flat_map(|line| line.pixels().map(TidyPixel::new)).collect();
    let mut largest = 0.0_f64;
    for seed in 0..3 {
        let depths = write_depths(work, "depth.exr", seed);
        work.json(&format!("render {words} --holdout depth.exr -o held.exr --overwrite"));
        let held = work.picture("held.exr");
        for ((pixel, z), held) in pixels.iter().zip(&depths).zip(&held.rgba) {
            let unit = pixel.rgba()[..3].iter().fold(1.0_f64, |most, c| most.max(*c));
            let found = pixel.rgba_before(f64::from(*z));
            for c in 0..4 {
                let by = if c < 3 { unit } else { 1.0 };
                largest = largest.max((found[c] - f64::from(held[c])).abs() / by);
            }
        }
    }
    (largest, report["deep"]["samples"].as_f64().unwrap() / report["deep"]["pixels"].as_f64().unwrap())
}

#[test]
fn samples_show_what_holdouts_leave() {
    let work = Work::new();
    write_camera(&work);
    let tf = r#"{"format": "cumulo-transfer-function", "version": 1, "transfer": {"kind": "piecewise",
                 "points": [[0.0, 1, 1, 1, 0.0], [0.4, 1, 0.3, 0.1, 1.0], [0.4, 1, 0.3, 0.1, 30.0],
                            [1.0, 0.2, 0.5, 0.9, 0.5]]}}"#;
    std::fs::write(work.path("two.tf.json"), tf).unwrap();
    let volume = |medium: serde_json::Value| json!({"file": fixture_text("plume.vdb"), "medium": medium});
    let plain = json!({"density_scale": 2, "albedo": [0.9, 0.8, 0.7]});
    let colored = json!({"albedo": [0.9, 0.9, 0.9], "extinction_color": [1.0, 0.6, 0.3]});
    let moved = json!({"file": fixture_text("plume.vdb"), "medium": plain,
        "transform": [[1, 0, 0, 0.3], [0, 1, 0, 0], [0, 0, 1, -0.4], [0, 0, 0, 1]]});
    let fire = json!({"albedo": [0.5, 0.5, 0.5],
        "emission_grid": {"grid": "density", "radiance": [3, 1.5, 2]}});
    let near = json!({"type": "PointLight", "position": [1.02, 1, 1.05], "intensity": [9, 9, 9]});
    let sun = json!({"type": "DistantLight", "direction": [1, 1, 2], "irradiance": [3, 3, 3]});
    for (name, scene) in [
        ("sun", json!({"volumes": [volume(plain.clone())], "lights": [sun]})),
        ("near", json!({"volumes": [volume(plain.clone())], "lights": [near]})),
        ("colored", json!({"volumes": [volume(colored.clone())], "lights": [sun]})),
        ("several", json!({"volumes": [volume(plain.clone()), moved], "lights": [sun, near]})),
        ("fire", json!({"volumes": [volume(fire.clone())], "lights": [sun]})),
        ("fires", json!({"volumes": [volume(fire), moved], "lights": [sun]})),
        ("mixed", json!({"volumes": [volume(colored), moved], "lights": [sun]})),
    ] {
        std::fs::write(work.path(&format!("{name}.json")), scene.to_string()).unwrap();
    }
    write_ply(&work.path("ball.ply"), &ball(DVec3::new(1.1, 0.9, 1.0), 0.4, 12));
    write_ply(&work.path("wall.ply"), &quad(DVec3::new(-5.0, -5.0, 0.1), DVec3::X * 12.0, DVec3::new(0.0, 12.0, -3.0)));
    write_ply(&work.path("hole.ply"), &quad(DVec3::new(0.4, 1.1, 1.3), DVec3::X * 0.6, DVec3::Y * 0.8));
    let meshes = json!([{"file": "ball.ply", "albedo": [0.9, 0.3, 0.2], "emission": [0.1, 0, 0]}, {"file": "wall.ply"},
        {"file": "hole.ply", "holdout": true}]);
    for name in ["sun", "colored", "several", "fire"] {
        let read = std::fs::read_to_string(work.path(&format!("{name}.json"))).unwrap();
        let mut scene: serde_json::Value = serde_json::from_str(&read).unwrap();
        scene["meshes"] = meshes.clone();
        std::fs::write(work.path(&format!("{name}-meshes.json")), scene.to_string()).unwrap();
    }
    let plume = "@plume.vdb --density-scale 4 --cameras camera.json --view 0 --background 0.2,0.3,0.4";
    let scene = "--cameras camera.json --view 0 --samples 16 --seed 3";
    for (words, error, most) in [
        (format!("{plume} --supersample 2"), 0.01, 12.0),
        (format!("{plume} --model emission-absorption --emission 20,0.5,0.2"), 0.01, 12.0),
        (format!("{plume} --tf two.tf.json --supersample 2"), 0.01, 20.0),
        (format!("{plume} --tf two.tf.json --aperture 0.1 --supersample 3"), 0.05, 8.0),
        (format!("{plume} --tf two.tf.json --shade"), 0.05, 8.0),
        (format!("sun.json {scene}"), 0.01, 60.0),
        (format!("sun.json {scene} --clamp 0.1"), 0.01, 60.0),
        (format!("near.json {scene}"), 0.01, 60.0),
        (format!("colored.json {scene}"), 0.01, 60.0),
        (format!("several.json {scene}"), 0.01, 60.0),
        (format!("fire.json {scene}"), 0.01, 60.0),
        (format!("fires.json {scene}"), 0.01, 60.0),
        (format!("mixed.json {scene}"), 0.01, 60.0),
        (format!("sun.json {scene}"), 0.1, 10.0),
        (format!("sun-meshes.json {scene}"), 0.01, 60.0),
        (format!("colored-meshes.json {scene} --aperture 0.1"), 0.01, 60.0),
        (format!("several-meshes.json {scene}"), 0.01, 60.0),
        (format!("fire-meshes.json {scene}"), 0.01, 60.0),
    ] {
        let (largest, samples) = off(&work, &words, error);
        println!("{words} {error}: {largest:.4}, {samples:.1} samples");
        assert!(largest <= error + 1e-5, "{words}: {largest} for {error}");
        assert!(samples > 1.0 && samples < most, "{words}: {samples} samples");
    }
}

/// A camera that moves through the volume sees, with the shutter open, what is behind the place of its frame as well.
#[test]
fn samples_together_are_the_picture_of_a_camera_inside() {
    let work = Work::new();
    let frame = |(i, z): (usize, f64)| {
        let matrix = [[1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 1.0], [0.0, 0.0, 1.0, z], [0.0, 0.0, 0.0, 1.0]];
        json!({"file_path": format!("view.{i:04}.exr"), "transform_matrix": matrix})
    };
    let frames: Vec<_> = [1.9, 1.2, 0.5].into_iter().enumerate().map(frame).collect();
    let json = json!({"w": SIZE[0], "h": SIZE[1], "fl_x": 30.0, "near": 0.0, "frames": frames});
    std::fs::write(work.path("moving.json"), json.to_string()).unwrap();
    let words = "render @plume.vdb --cameras moving.json --frames 1 --shutter 1 --supersample 3 --density-scale 4 \
                 --model emission-absorption --background 0,0,0";
    work.json(&format!("{words} -o flat.exr"));
    work.json(&format!("{words} --deep 0.01 -o deep.exr"));
    let (flat, picture) = (work.picture("flat.exr"), deep::read(&work.path("deep.exr")).unwrap());
    let pixels = picture.lines.iter().flat_map(|line| line.pixels().map(|samples| TidyPixel::new(samples).rgba()));
    for (found, flat) in pixels.zip(&flat.rgba) {
        assert!((0..4).all(|c| (found[c] - f64::from(flat[c])).abs() < 1e-5), "{found:?} {flat:?}");
    }
    assert!(flat.rgba.iter().any(|rgba| rgba[3] > 0.3));
}

#[test]
fn what_deep_pictures_cannot_have_is_refused() {
    let work = Work::new();
    let plume = "render @plume.vdb --views 1 --size 8x8 --deep 0.01";
    for more in ["-o a.exr --half", "-o a.exr --aov depth", "-o out --png", "-o a.exr --holdout b.exr"] {
        work.refused(&format!("{plume} {more}"), Code::Usage, &["flat pictures alone"]);
    }
    work.refused(&format!("{plume} -o a.exr --quadrature midpoint:0.5"), Code::Usage, &["midpoint:0.5", "exact"]);
    work.refused(&format!("{plume} -o a.png"), Code::OutputName, &["a.png", ".exr"]);
    work.refused("render @plume.vdb --views 1 -o a.exr --deep 0.9", Code::Usage, &["0.9", "0.0001", "--deep 0.01"]);
}
