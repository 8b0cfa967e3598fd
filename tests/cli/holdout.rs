//! Holdouts: what is before the depth of a pixel and what is behind it make the whole.

use crate::common::work::{Work, write_exr};
use cumulo::error::Code;
use cumulo::scene::film::Film;
use serde_json::json;

const SIZE: [usize; 2] = [24, 20];
const DEPTH: f64 = 2.9;

/// A camera that looks down -Z at the plume, with its near plane at a depth.
fn write_camera(work: &Work, name: &str, focal: f64, near: f64) {
    let frames: Vec<_> = (0..2)
        .map(|i| {
            json!({
                "file_path": format!("view.{i:04}.exr"),
                "transform_matrix": [[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 4], [0, 0, 0, 1]],
            })
        })
        .collect();
    let json = json!({"w": SIZE[0], "h": SIZE[1], "fl_x": focal, "near": near, "frames": frames});
    std::fs::write(work.path(name), json.to_string()).unwrap();
}

fn write_depth(work: &Work, name: &str, size: [usize; 2], channel: &str, depth: impl Fn(usize, usize) -> f64) {
    let depths = (0..size[0] * size[1]).map(|i| depth(i % size[0], i / size[0]) as f32).collect();
    write_exr(&work.path(name), size, &[(channel, depths)], |_, _| ());
}

fn prepared() -> Work {
    let work = Work::new();
    write_camera(&work, "all.json", 30.0, 0.0);
    write_camera(&work, "behind.json", 30.0, DEPTH);
    // Pixels so small that all rays of one are alike.
    write_camera(&work, "close-all.json", 30_000.0, 0.0);
    write_camera(&work, "close-behind.json", 30_000.0, DEPTH);
    write_depth(&work, "depth.exr", SIZE, "ViewLayer.Depth.Z", |_, _| DEPTH);
    work
}

/// Largest and mean difference of `whole` from `before` over `behind`, in colors or in alpha alone.
fn off(whole: &Film, before: &Film, behind: &Film, channels: std::ops::Range<usize>) -> [f64; 2] {
    let (mut largest, mut sum, mut count) = (0.0_f64, 0.0, 0.0);
    for ((whole, before), behind) in whole.rgba.iter().zip(&before.rgba).zip(&behind.rgba) {
        for c in channels.clone() {
            let expected = f64::from(before[c]) + (1.0 - f64::from(before[3])) * f64::from(behind[c]);
            let difference = f64::from(whole[c]) - expected;
            (largest, sum, count) = (largest.max(difference.abs()), sum + difference, count + 1.0);
        }
    }
    [largest, (sum / count).abs()]
}

fn means(film: &Film, c: usize) -> f64 {
    film.rgba.iter().map(|rgba| f64::from(rgba[c])).sum::<f64>() / film.rgba.len() as f64
}

#[test]
fn before_and_behind_a_depth_make_the_whole_of_straight_rays() {
    let work = prepared();
    let tf = r#"{"format": "cumulo-transfer-function", "version": 1, "transfer": {"kind": "piecewise",
                 "points": [[0.0, 1, 1, 1, 0.0], [0.4, 1, 0.3, 0.1, 1.0], [1.0, 0.2, 0.5, 0.9, 0.5]]}}"#;
    std::fs::write(work.path("two.tf.json"), tf).unwrap();
    for (name, medium) in [
        ("absorbing", "--density-scale 4 --background 0,0,0"),
        ("emitting", "--density-scale 4 --model emission-absorption --emission 1,0.5,0.2"),
        ("function", "--density-scale 4 --tf two.tf.json"),
        ("steps", "--density-scale 4 --tf two.tf.json --quadrature midpoint:0.1"),
        ("shaded", "--density-scale 4 --tf two.tf.json --shade --quadrature midpoint:0.1"),
    ] {
        let render = |cameras: &str, more: &str| {
            let file = format!("{name}-{}.exr", more.len());
            work.json(&format!("render @plume.vdb {medium} --view 0 --cameras {cameras} {more} -o {cameras}-{file}"));
            work.picture(&format!("{cameras}-{file}"))
        };
        let (whole, before) = (render("all.json", ""), render("all.json", "--holdout depth.exr"));
        let behind = render("behind.json", "");
        // Uniform steps lie elsewhere.
        let allowed = if medium.contains("midpoint") { 2e-3 } else { 2e-5 };
        let found = off(&whole, &before, &behind, 0..4);
        assert!(found[0] < allowed, "{name} {found:?}");
        assert!(means(&before, 3) > 0.02 && means(&behind, 3) > 0.02, "{name}");
    }
    // What stands in the way hides a bright background, too.
    let white = "render @plume.vdb --density-scale 4 --cameras all.json --view 0 --background 1,1,1";
    work.json(&format!("{white} --holdout depth.exr -o white.exr"));
    assert!(work.picture("white.exr").rgba.iter().all(|rgba| rgba[..3] == [0.0; 3]));
    // Nothing in the way, and everything.
    for (name, depth) in [("far.exr", 1e10), ("endless.exr", f64::INFINITY), ("close.exr", 0.0)] {
        write_depth(&work, name, SIZE, "Z", |_, _| depth);
        let out = work.command(&format!("{white} --holdout {name} -o of-{name}")).output().unwrap();
        assert!(out.status.success());
        let said = String::from_utf8_lossy(&out.stderr).contains("100.0 % of the pixels of --holdout");
        assert_eq!(said, depth == 0.0);
    }
    work.json(&format!("{white} -o open.exr"));
    assert_eq!(work.picture("of-endless.exr").rgba, work.picture("of-far.exr").rgba);
    assert!(work.picture("of-close.exr").rgba.iter().all(|rgba| *rgba == [0.0; 4]));
    let alphas = |name: &str| work.picture(name).rgba.iter().map(|rgba| rgba[3]).collect::<Vec<_>>();
    assert_eq!(alphas("of-far.exr"), alphas("open.exr"));
}

/// Alpha is exact, and colors are estimates whose means agree within 5 standard errors.
#[test]
fn before_and_behind_a_depth_make_the_whole_of_paths() {
    let work = prepared();
    let volume =
        |medium: serde_json::Value| json!({"file": crate::common::work::fixture_text("plume.vdb"), "medium": medium});
    let plain = json!({"density_scale": 1, "albedo": [0.9, 0.8, 0.7]});
    let moved = json!({"file": crate::common::work::fixture_text("plume.vdb"), "medium": plain,
        "transform": [[1, 0, 0, 0.3], [0, 1, 0, 0], [0, 0, 1, -0.4], [0, 0, 0, 1]]});
    let near = json!({"type": "PointLight", "position": [1.02, 1, 1.05], "intensity": [1, 1, 1]});
    let sun = json!({"type": "DistantLight", "direction": [1, 1, 2], "irradiance": [3, 3, 3]});
    let scenes = [
        ("one", json!({"volumes": [volume(plain.clone())], "lights": [sun]}), true),
        ("near", json!({"volumes": [volume(plain.clone())], "lights": [near]}), true),
        ("several", json!({"volumes": [volume(plain), moved], "lights": [sun]}), false),
    ];
    let render = |name: &str, cameras: &str, more: &str, seed: u32| {
        let file = format!("{cameras}-{name}-{seed}-{}.exr", more.len());
        work.json(&format!(
            "render {name}.json --samples 256 --view 0 --cameras {cameras} {more} --seed {seed} --background 0,0,0 -o {file}"
        ));
        work.picture(&file)
    };
    let (held, seeds) = ("--holdout depth.exr", [1, 2, 3, 4]);
    for (name, scene, exact) in scenes {
        std::fs::write(work.path(&format!("{name}.json")), scene.to_string()).unwrap();
        let views = [("close-all.json", ""), ("close-all.json", held), ("close-behind.json", "")];
        let all = seeds.map(|seed| views.map(|(cameras, more)| render(name, cameras, more, seed)));
        for [whole, before, behind] in &all {
            let found = off(whole, before, behind, 3..4);
            assert!(if exact { found[0] < 2e-4 } else { found[1] < 5e-3 }, "{name} {found:?}");
            // With the same random numbers, less is seen in every pixel.
            let less = |(whole, before): (&[f32; 4], &[f32; 4])| (0..4).all(|c| before[c] <= whole[c] + 1e-6);
            assert!(whole.rgba.iter().zip(&before.rgba).all(less), "{name}");
        }
        for c in 0..3 {
            let differences = all.each_ref().map(|[whole, before, behind]| {
                let composited = Film {
                    rgba: before
                        .rgba
                        .iter()
                        .zip(&behind.rgba)
                        .map(|(a, b)| std::array::from_fn(|c| a[c] + (1.0 - a[3]) * b[c]))
                        .collect(),
                    ..before.clone()
                };
                means(whole, c) - means(&composited, c)
            });
            let mean = differences.iter().sum::<f64>() / 4.0;
            let error = (differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / 12.0).sqrt();
            let light = means(&all[0][0], c);
            assert!(mean.abs() < 5.0 * error + 1e-3 * light, "{name} {c} {mean} {error} {light}");
            let front = means(&all[0][1], c) / light;
            assert!(front > 0.1 && front < 0.97, "{name} {front}");
        }
    }
    // Each channel of a colored extinction is that of a grey one.
    let color = [1.0, 0.6, 0.3];
    let held_out = |name: &str, medium: serde_json::Value| {
        let scene = json!({"volumes": [volume(medium)], "lights": [sun]});
        std::fs::write(work.path(&format!("{name}.json")), scene.to_string()).unwrap();
        seeds.map(|seed| render(name, "all.json", held, seed))
    };
    let colored = held_out("colored", json!({"albedo": [0.9, 0.9, 0.9], "extinction_color": color}));
    for (c, scale) in color.into_iter().enumerate() {
        let grey = held_out(&format!("grey{c}"), json!({"albedo": [0.9, 0.9, 0.9], "density_scale": scale}));
        let moments = |films: &[Film; 4]| {
            let values = films.each_ref().map(|film| means(film, c));
            let mean = values.iter().sum::<f64>() / 4.0;
            (mean, values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 12.0)
        };
        let ((a, va), (b, vb)) = (moments(&colored), moments(&grey));
        assert!((a - b).abs() < 5.0 * (va + vb).sqrt() + 2e-3 * b && b > 0.0, "{c} {a} {b} {va} {vb}");
    }
}

#[test]
fn depths_of_frames_parts_and_other_sizes_are_taken() {
    let work = prepared();
    let left = |x: usize, width: usize| if 2 * x < width { 2.0 } else { 1e10 };
    write_depth(&work, "half.exr", SIZE, "Depth.V", |x, _| left(x, SIZE[0]));
    write_depth(&work, "fine.exr", [96, 80], "depth.Z", |x, _| left(x, 96));
    // An edge in the middle of a pixel.
    write_depth(&work, "rim.exr", [96, 80], "Z", |x, _| if x < 50 { 2.0 } else { 1e10 });
    let dense = "render @plume.vdb --density-scale 4 --background 0,0,0 --cameras all.json --view 0 --supersample 4";
    for name in ["half", "fine", "rim"] {
        work.json(&format!("{dense} --holdout {name}.exr -o of-{name}.exr"));
    }
    work.json(&format!("{dense} -o open.exr"));
    let (half, rim, open) = (work.picture("of-half.exr"), work.picture("of-rim.exr"), work.picture("open.exr"));
    assert_eq!(half.rgba, work.picture("of-fine.exr").rgba);
    let row = 10 * SIZE[0];
    assert_eq!(half.rgba[row + 12..row + 24], open.rgba[row + 12..row + 24]);
    assert!(half.rgba[row + 11][3] < 0.5 * open.rgba[row + 11][3] && open.rgba[row + 11][3] > 0.05);
    // Half of the pixel's rays pass beside the edge.
    let share = rim.rgba[row + 12][3] / open.rgba[row + 12][3];
    assert!((share - 0.5).abs() < 0.15, "{share}");
    // A part of the picture takes the depths of its place.
    work.json(&format!("{dense} --holdout half.exr --crop 8,6,8x4 -o part"));
    let part = work.picture("part/view_000.exr");
    for y in 0..4 {
        assert_eq!(part.rgba[8 * y..8 * y + 8], half.rgba[(6 + y) * SIZE[0] + 8..][..8], "{y}");
    }
    // Frames have depths of their own, which are inputs: what has changed is rendered again.
    for number in 0..2 {
        write_depth(&work, &format!("z.{number:04}.exr"), SIZE, "Z", |x, _| left(x, (1 - number) * 48));
    }
    let frames = "render @plume.vdb --density-scale 4 --background 0,0,0 --cameras all.json --frames 0-1 --supersample 4 \
                  --holdout z.####.exr -o frames";
    work.json(frames);
    assert_eq!(work.picture("frames/frame.0001.exr").rgba, open.rgba);
    assert!(means(&work.picture("frames/frame.0000.exr"), 3) < 0.5 * means(&open, 3));
    write_depth(&work, "z.0000.exr", SIZE, "Z", |_, _| 1e10);
    let again = work.json(&format!("{frames} --resume"));
    assert_eq!((again["rendered"].as_u64(), again["skipped"].as_u64()), (Some(1), Some(1)), "{again}");
    assert_eq!(work.picture("frames/frame.0000.exr").rgba, open.rgba);
    // Depths along the ray are longer beside the axis.
    write_depth(&work, "flat.exr", SIZE, "Z", |_, _| DEPTH);
    for measure in ["axis", "ray"] {
        work.json(&format!("{dense} --holdout flat.exr --holdout-depth {measure} -o by-{measure}.exr"));
    }
    let [axis, ray] = ["axis", "ray"].map(|m| work.picture(&format!("by-{m}.exr")));
    assert!(means(&ray, 3) < means(&axis, 3) && means(&ray, 3) > 0.8 * means(&axis, 3));
}

#[test]
fn depths_that_cannot_be_used_are_refused() {
    let work = prepared();
    let render = "render @plume.vdb --cameras all.json --view 0 -o a.exr";
    write_depth(&work, "small.exr", [10, 10], "Z", |_, _| 1.0);
    write_depth(&work, "negative.exr", SIZE, "Z", |x, y| if (x, y) == (3, 7) { -1.0 } else { 1.0 });
    write_depth(&work, "nan.exr", SIZE, "Z", |_, _| f64::NAN);
    let two: Vec<f32> = vec![1.0; SIZE[0] * SIZE[1]];
    write_exr(&work.path("two.exr"), SIZE, &[("a.Depth.Z", two.clone()), ("b.Depth.Z", two.clone())], |_, _| ());
    write_exr(&work.path("colors.exr"), SIZE, &["B", "G", "R"].map(|name| (name, two.clone())), |_, _| ());
    let refused = |more: &str, code, parts: &[&str]| work.refused(&format!("{render} {more}"), code, parts);
    write_exr(&work.path("normal.exr"), SIZE, &["N.X", "N.Y", "N.Z"].map(|name| (name, two.clone())), |_, _| ());
    refused("--holdout normal.exr --holdout-layer N", Code::Invalid, &["normal.exr", "X, Y, Z", "none is a depth"]);
    let both = "render @plume.vdb --cameras all.json --holdout depth.exr -o both";
    work.refused(both, Code::Invalid, &["--holdout", "2 views", "--view"]);
    // Beside its data window a picture has no depths, and nothing stands.
    write_exr(&work.path("window.exr"), [4, 20], &[("Z", vec![0.0; 80])], |image, layer| {
        image.display_window = ::exr::meta::attribute::IntegerBounds::new((0, 0), (24, 20));
        layer.layer_position = ::exr::math::Vec2(10, 0);
    });
    for (name, more) in [("held", "--holdout window.exr"), ("whole", "")] {
        work.json(&format!("render @plume.vdb --cameras all.json --view 0 --background 0,0,0 {more} -o {name}.exr"));
    }
    let [held, whole] = ["held.exr", "whole.exr"].map(|name| work.picture(name));
    for (i, (held, whole)) in held.rgba.iter().zip(&whole.rgba).enumerate() {
        assert_eq!(held[3], if (10..14).contains(&(i % 24)) { 0.0 } else { whole[3] }, "{i}");
    }
    // Straight rays must be as many as the depths.
    write_depth(&work, "finer.exr", [48, 40], "Z", |_, _| 3.0);
    let out = work.command(&format!("{render} --holdout finer.exr --overwrite")).output().unwrap();
    assert!(out.status.success() && String::from_utf8_lossy(&out.stderr).contains("--supersample 2"));
    refused("--holdout none.exr", Code::NotFound, &["none.exr"]);
    refused("--holdout small.exr", Code::Invalid, &["small.exr", "10x10", "24x20"]);
    refused("--holdout negative.exr", Code::Invalid, &["negative.exr", "column 3, row 7", "-1"]);
    refused("--holdout nan.exr", Code::Invalid, &["nan.exr", "NaN"]);
    refused("--holdout two.exr", Code::Invalid, &["two.exr", "a.Depth", "b.Depth", "--holdout-layer"]);
    refused("--holdout colors.exr", Code::Invalid, &["colors.exr", "no layer", "--holdout-layer"]);
    refused("--holdout-layer Z", Code::Usage, &["--holdout"]);
    refused("--holdout depth.exr --holdout-layer other", Code::NoSuchLayer, &["depth.exr", "other", "ViewLayer.Depth"]);
    work.json(&format!("{render} --holdout two.exr --holdout-layer b.Depth --overwrite"));
    work.refused(
        "render @plume.vdb --cameras all.json --view 0 --holdout depth.exr -o depth.exr",
        Code::OutputIsInput,
        &["depth.exr"],
    );
}

/// A mesh hides what its depths do: of a plane, of one that is cut into polygons, and of a box seen from all sides.
#[test]
fn meshes_hide_what_is_behind_them() {
    let work = prepared();
    let z = 4.0 - DEPTH;
    let square = format!("v -9 -9 {z}\nv 11 -9 {z}\nv 11 11 {z}\nv -9 11 {z}\nf 1 2 3 4\n");
    std::fs::write(work.path("plane.obj"), square).unwrap();
    let plume = "render @plume.vdb --density-scale 4 --cameras all.json --view 0";
    let pictured = |more: &str, name: &str| {
        work.json(&format!("{plume} {more} -o {name}"));
        work.picture(name)
    };
    let (by_mesh, by_depth) = (
        pictured("--supersample 2 --holdout plane.obj", "mesh.exr"),
        pictured("--supersample 2 --holdout depth.exr", "flat.exr"),
    );
    let most = by_mesh.rgba.iter().flatten().zip(by_depth.rgba.iter().flatten());
    assert!(most.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max) < 1e-6);
    // The same along paths, with the same random numbers.
    let paths = "--albedo 0.9 --sun 1,1,2 --samples 16 --seed 3";
    let (by_mesh, by_depth) = (
        pictured(&format!("{paths} --holdout plane.obj"), "mesh-paths.exr"),
        pictured(&format!("{paths} --holdout depth.exr"), "flat-paths.exr"),
    );
    let most = by_mesh.rgba.iter().flatten().zip(by_depth.rgba.iter().flatten());
    assert!(most.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max) < 1e-5);
    // One mesh serves all views: a box around the upper half of the plume hides it from everywhere.
    let at = |i: i32| [-4 + 8 * (i >> 2), -4 + 8 * (i >> 1 & 1), 1 + 4 * (i & 1)].map(|v| v.to_string()).join(" ");
    let corners: String = (0..8).map(|i| format!("v {}\n", at(i))).collect();
    let faces = "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n";
    std::fs::write(work.path("box.obj"), corners + faces).unwrap();
    let views = "render @plume.vdb --density-scale 4 --views 4 --layout ring --size 24x24 --background 0,0,0";
    work.json(&format!("{views} -o open"));
    work.json(&format!("{views} --holdout box.obj -o held"));
    for view in 0..4 {
        let [open, held] = ["open", "held"].map(|folder| work.picture(&format!("{folder}/view_00{view}.exr")));
        let lower = held.rgba[18 * 24..].iter().zip(&open.rgba[18 * 24..]);
        assert!(
            lower.clone().any(|(held, _)| held[3] > 0.05) && lower.into_iter().all(|(a, b)| (a[3] - b[3]).abs() < 1e-6)
        );
        let upper = held.rgba[..8 * 24].iter().zip(&open.rgba[..8 * 24]);
        assert!(upper.clone().all(|(held, _)| held[3] == 0.0) && upper.into_iter().any(|(_, open)| open[3] > 0.05));
    }
    // What is no mesh to stand in the way.
    std::fs::write(work.path("points.obj"), "v 0 0 0\nv 1 0 0\n").unwrap();
    std::fs::write(work.path("broken.ply"), "ply\nformat ascii 1.0\nelement vertex 3\n").unwrap();
    work.refused(&format!("{plume} --holdout points.obj -o x.exr"), Code::Invalid, &["points.obj", "no polygons"]);
    work.refused(&format!("{plume} --holdout broken.ply -o x.exr"), Code::Invalid, &["broken.ply"]);
    // Polygons that are not convex are filled, and those whose edges cross each other are refused.
    let arrow = "v 0 0 0\nv 2 1 0\nv 0 2 0\nv 0.5 1 0\nf 2 3 4 1\n";
    std::fs::write(work.path("concave.obj"), arrow).unwrap();
    work.json(&format!("{plume} --holdout concave.obj -o concave.exr"));
    std::fs::write(work.path("arrow.obj"), "v 0 0 0\nv 3 1 0\nv 3 0 0\nv 0 0.5 0\nf 1 2 3 4\n").unwrap();
    work.refused(
        &format!("{plume} --holdout arrow.obj -o x.exr"),
        Code::Unsupported,
        &["arrow.obj", "cross each other", "triangulate"],
    );
    work.refused(&format!("{plume} --holdout none.ply -o x.exr"), Code::NotFound, &["none.ply"]);
    work.refused(
        &format!("{plume} --holdout plane.obj --holdout-depth ray -o x.exr"),
        Code::Usage,
        &["plane.obj", "this is a mesh"],
    );
}
