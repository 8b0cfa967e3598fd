//! Meshes in scene files and USD stages: what they say is what is rendered, and what cannot be is refused by name.

use crate::common::shapes::{Triangles, ball, quad, write_ply};
use crate::common::stages::binary;
use crate::common::work::{Work, fixture_text};
use cumulo::error::Code;
use glam::DVec3;
use serde_json::{Value, json};
use std::fmt::Write;

const OPTIONS: &str = "--cameras camera.json --samples 4";

/// A camera that looks at the plume from above, and a scene file of the plume, a floor and a ball in the light of a sun.
fn prepared() -> (Work, Value) {
    let work = Work::new();
    let matrix = [[1.0, 0.0, 0.0, 1.0], [0.0, 0.8, 0.6, 3.4], [0.0, -0.6, 0.8, 4.2], [0.0, 0.0, 0.0, 1.0]];
    let matrix = [matrix[0], [0.0, 0.8, -0.6, -1.4], [0.0, 0.6, 0.8, 4.2], matrix[3]];
    let frame = json!({"file_path": "view.exr", "transform_matrix": matrix});
    let camera = json!({"w": 24, "h": 20, "fl_x": 24.0, "near": 0.0, "frames": [frame]});
    std::fs::write(work.path("camera.json"), camera.to_string()).unwrap();
    write_ply(&work.path("floor.ply"), &quad(DVec3::new(-2.0, -2.0, 0.1), DVec3::X * 6.0, DVec3::Y * 6.0));
    write_ply(&work.path("ball.ply"), &ball(DVec3::ZERO, 0.4, 10));
    let scene = json!({
        "volumes": [{"file": fixture_text("plume.vdb"), "medium": {"density_scale": 3, "albedo": [0.9, 0.8, 0.7]}}],
        "lights": [{"type": "DistantLight", "direction": [1, -1, 2], "irradiance": [3, 3, 3]},
                   {"type": "DomeLight", "radiance": [0.2, 0.3, 0.4]}],
        "meshes": [{"file": "floor.ply", "albedo": [0.5, 0.5, 0.25]},
                   {"file": "ball.ply", "albedo": [0.75, 0.25, 0.5], "emission": [0.5, 0.25, 0.125],
                    "transform": [[1, 0, 0, 1.5], [0, 1, 0, 0.5], [0, 0, 1, 0.75], [0, 0, 0, 1]]}],
    });
    write(&work, "scene.json", &scene);
    (work, scene)
}

fn write(work: &Work, name: &str, scene: &Value) {
    std::fs::write(work.path(name), scene.to_string()).unwrap();
}

/// Returns the scene with another value.
fn but(scene: &Value, at: &str, value: Value) -> Value {
    let mut scene = scene.clone();
    *scene.pointer_mut(at).unwrap() = value;
    scene
}

fn points(triangles: &Triangles) -> String {
    let mut text = String::new();
    for DVec3 { x, y, z } in triangles.iter().flatten() {
        let _ = write!(text, "({}, {}, {}), ", *x as f32, *y as f32, *z as f32);
    }
    text
}

/// A stage of the scene; `ball` are the attributes of the ball's mesh.
fn stage(ball: &str, more: &str) -> String {
    format!(
        "(\n upAxis = \"Z\"\n)\ndef Volume \"smoke\" {{\n rel field:density = </smoke/density>\n custom double \
         cumulo:densityScale = 3\n custom color3f cumulo:albedo = (0.9, 0.8, 0.7)\n def OpenVDBAsset \"density\" {{\n  token \
         fieldName = \"density\"\n  asset filePath = @{}@\n }}\n}}\ndef Mesh \"floor\" {{\n uniform token subdivisionScheme = \
         \"none\"\n point3f[] points = [(-2, -2, 0.1), (4, -2, 0.1), (4, 4, 0.1), (-2, 4, 0.1)]\n int[] faceVertexCounts = [4]\n \
         int[] faceVertexIndices = [0, 1, 2, 3]\n color3f[] primvars:displayColor = [(0.5, 0.5, 0.25)]\n}}\ndef Mesh \"ball\" \
         {{\n uniform token subdivisionScheme = \"none\"\n double3 xformOp:translate = (1.5, 0.5, 0.75)\n uniform token[] \
         xformOpOrder = [\"xformOp:translate\"]\n {ball}\n}}\ndef DistantLight \"sun\" {{\n float inputs:intensity = 3\n float \
         inputs:angle = 0\n matrix4d xformOp:transform = ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))\n uniform \
         token[] xformOpOrder = [\"xformOp:transform\"]\n}}\ndef DomeLight \"sky\" {{\n color3f inputs:color = (0.2, 0.3, \
         0.4)\n}}\n{more}",
        fixture_text("plume.vdb")
    )
}

/// Faces of triangles, each of three points of its own.
fn faces(count: usize) -> String {
    let list = |values: &mut dyn Iterator<Item = usize>| values.map(|v| v.to_string()).collect::<Vec<_>>().join(", ");
    let counts = list(&mut std::iter::repeat_n(3, count));
    format!("int[] faceVertexCounts = [{counts}]\n int[] faceVertexIndices = [{}]\n", list(&mut (0..3 * count)))
}

const MATERIALS: &str = "def Material \"red\" {\n token outputs:surface.connect = </red/shader.outputs:surface>\n def Shader \
                         \"shader\" {\n  uniform token info:id = \"UsdPreviewSurface\"\n  color3f inputs:diffuseColor = (0.75, \
                         0.25, 0.5)\n  color3f inputs:emissiveColor = (0.5, 0.25, 0.125)\n  token outputs:surface\n }\n}\ndef \
                         Material \"blue\" {\n token outputs:surface.connect = </blue/shader.outputs:surface>\n def Shader \
                         \"shader\" {\n  uniform token info:id = \"UsdPreviewSurface\"\n  color3f inputs:diffuseColor = (0.25, \
                         0.25, 0.75)\n  float inputs:metallic = 1\n  token outputs:surface\n }\n}\n";

/// A material whose shader has its color from an input of the material.
const INTERFACE: &str = "def Material \"dull\" {\n color3f inputs:glow = (0.5, 0.25, 0.125)\n token outputs:surface.connect = \
                         </dull/shader.outputs:surface>\n def Shader \"shader\" {\n  uniform token info:id = \
                         \"UsdPreviewSurface\"\n  color3f inputs:diffuseColor = (0.1, 0.1, 0.1)\n  color3f \
                         inputs:emissiveColor.connect = </dull.inputs:glow>\n  token outputs:surface\n }\n}\n";

/// A stage gives the pictures of the scene file that says the same: with few and many points, as text and binary, by
/// Cumulo's own attributes and by materials.
#[test]
fn stages_show_the_meshes_of_scene_files() {
    let (work, scene) = prepared();
    let sun = json!({"type": "DistantLight", "direction": [0, 0, 1], "irradiance": [3, 3, 3]});
    for rows in [10, 40] {
        let triangles = ball(DVec3::ZERO, 0.4, rows);
        write_ply(&work.path("ball.ply"), &triangles);
        write(&work, "scene.json", &but(&scene, "/lights/0", sun.clone()));
        work.json(&format!("render scene.json {OPTIONS} --frames 1 -o scene --overwrite"));
        let shape = format!("point3f[] points = [{}]\n {}", points(&triangles), faces(triangles.len()));
        let own =
            "custom color3f cumulo:albedo = (0.75, 0.25, 0.5)\n custom color3f cumulo:emission = (0.5, 0.25, 0.125)\n";
        let bound = "rel material:binding = </red>\n";
        // Each attribute goes before its part of the material alone.
        let mixed = "rel material:binding = </dull>\n custom color3f cumulo:albedo = (0.75, 0.25, 0.5)\n";
        for (material, more) in [(own, ""), (bound, MATERIALS), (mixed, INTERFACE)] {
            let text = stage(&format!("{shape}{material}"), more);
            std::fs::write(work.path("stage.usda"), format!("#usda 1.0\n{text}")).unwrap();
            std::fs::write(work.path("stage.usdc"), binary(&text)).unwrap();
            for name in ["stage.usda", "stage.usdc"] {
                work.json(&format!("render {name} {OPTIONS} --frames 1 -o stage --overwrite"));
                let (a, b) = (work.picture("scene/frame.0001.exr"), work.picture("stage/frame.0001.exr"));
                // Points of a stage have single precision.
                let pairs = a.rgba.iter().flatten().zip(b.rgba.iter().flatten());
                let off = pairs.filter(|(a, b)| (*a - *b).abs() > 1e-3).count();
                assert!(off < 20, "{rows} {name} {more}: {off} of {}", 4 * a.rgba.len());
                assert!(a.rgba.iter().filter(|rgba| rgba[3] == 1.0).count() > 300);
            }
        }
    }
}

/// Subsets of faces have materials of their own; what of a material is left out is said; meshes move.
#[test]
fn subsets_and_moving_points_are_read() {
    let (work, scene) = prepared();
    let triangles = ball(DVec3::ZERO, 0.4, 6);
    let half = triangles.len() / 2;
    let list = (0..half).map(|i| i.to_string()).collect::<Vec<_>>().join(", ");
    let subset = format!(
        "rel material:binding = </red>\n def GeomSubset \"top\" {{\n  uniform token elementType = \"face\"\n  uniform token \
         familyName = \"materialBind\"\n  int[] indices = [{list}]\n  rel material:binding = </blue>\n }}\n"
    );
    let moved: Triangles = triangles.iter().map(|t| t.map(|at| at + DVec3::new(0.0, 0.5, 0.0))).collect();
    let samples = format!("1: [{}], 3: [{}]", points(&triangles), points(&moved));
    let shape = format!("point3f[] points.timeSamples = {{ {samples} }}\n {}", faces(triangles.len()));
    let text = stage(&format!("{shape}{subset}"), MATERIALS);
    std::fs::write(work.path("stage.usda"), format!("#usda 1.0\n{text}")).unwrap();
    let out = work.command(&format!("render stage.usda {OPTIONS} --frames 1-2 -o stage")).output().unwrap();
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(out.status.success() && said.contains("/blue/shader") && said.contains("reflections"), "{said}");
    for (frame, y) in [(1, 0.0), (2, 0.25)] {
        let part = |range: std::ops::Range<usize>| -> Triangles {
            triangles[range].iter().map(|t| t.map(|at| at + DVec3::new(1.5, 0.5 + y, 0.75))).collect()
        };
        write_ply(&work.path("top.ply"), &part(0..half));
        write_ply(&work.path("rest.ply"), &part(half..triangles.len()));
        let mut scene = but(&scene, "/lights/0/direction", json!([0, 0, 1]));
        scene["meshes"] = json!([scene["meshes"][0], {"file": "top.ply", "albedo": [0.25, 0.25, 0.75]},
            {"file": "rest.ply", "albedo": [0.75, 0.25, 0.5], "emission": [0.5, 0.25, 0.125]}]);
        write(&work, "scene.json", &scene);
        work.json(&format!("render scene.json {OPTIONS} --frames {frame} -o scene{frame}"));
        let name = format!("frame.{frame:04}.exr");
        let (a, b) = (work.picture(&format!("scene{frame}/{name}")), work.picture(&format!("stage/{name}")));
        let pairs = a.rgba.iter().flatten().zip(b.rgba.iter().flatten());
        let off = pairs.filter(|(a, b)| (*a - *b).abs() > 1e-3).count();
        assert!(off < 20, "{frame}: {off} of {}", 4 * a.rgba.len());
    }
}

/// A stage that is written of a scene file shows its meshes, sequences of them as well.
#[test]
fn stages_that_are_written_have_the_meshes() {
    let (work, scene) = prepared();
    for frame in [1, 2] {
        let rows = 9 + frame;
        write_ply(&work.path(&format!("prop.{frame:04}.ply")), &ball(DVec3::new(0.0, 0.0, 0.125), 0.4, rows));
    }
    let mut scene = but(&scene, "/meshes/1/file", json!("prop.####.ply"));
    scene["meshes"][0]["holdout"] = json!(true);
    // What a stage says of a sun's direction is rounded otherwise.
    scene["lights"] = json!([scene["lights"][1]]);
    let mut moving = scene.clone();
    let still = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
    (moving["meshes"][0]["transform_start"], moving["meshes"][0]["transform_end"]) = (still.clone(), still);
    write(&work, "moving.json", &moving);
    work.json("usd author moving.json -o moving.usda");
    let text = std::fs::read_to_string(work.path("moving.usda")).unwrap();
    assert!(text.contains("the motion of mesh 0 while the shutter is open"));
    write(&work, "scene.json", &scene);
    let report = work.json("usd author scene.json -o stage.usda");
    assert_eq!((&report["meshes"], &report["frames"]), (&json!(2), &json!([1, 2])));
    work.json(&format!("render scene.json {OPTIONS} --frames 1-2 -o scene"));
    work.json(&format!("render stage.usda {OPTIONS} --frames 1-2 -o stage"));
    for name in ["frame.0001.exr", "frame.0002.exr"] {
        let (a, b) = (work.picture(&format!("scene/{name}")), work.picture(&format!("stage/{name}")));
        let pairs = a.rgba.iter().flatten().zip(b.rgba.iter().flatten());
        let off = pairs.filter(|(a, b)| (*a - *b).abs() > 1e-3).count();
        assert!(off < 20, "{name}: {off} of {}", 4 * a.rgba.len());
    }
}

/// Meshes may be a sequence; pictures have the same bits for any number of threads; plans name surfaces, and leave
/// nothing out among them.
#[test]
fn sequences_and_plans_know_meshes() {
    let (work, scene) = prepared();
    for frame in [1, 2] {
        write_ply(
            &work.path(&format!("prop.{frame:04}.ply")),
            &ball(DVec3::new(0.0, 0.0, 0.3 * f64::from(frame)), 0.4, 10),
        );
    }
    write(&work, "moving.json", &but(&scene, "/meshes/1/file", json!("prop.####.ply")));
    work.json(&format!("render moving.json {OPTIONS} --frames 1-2 -o moving"));
    assert_ne!(work.picture("moving/frame.0001.exr"), work.picture("moving/frame.0002.exr"));
    work.json(&format!("render scene.json {OPTIONS} --threads 1 -o one.exr"));
    work.json(&format!("render scene.json {OPTIONS} --threads 3 -o three.exr"));
    assert_eq!(work.picture("one.exr"), work.picture("three.exr"));
    let plan = work.json(&format!("plan scene.json {OPTIONS}"));
    let of = |name: &str| plan["effects"].as_array().unwrap().iter().find(|effect| effect["name"] == name).unwrap();
    assert_eq!(of("surfaces")["state"], "on");
    assert_eq!((&of("scattering")["state"], &plan["integrator"]), (&json!("on"), &json!("path-tracing")));
    // A medium that scatters nothing leaves the floor to be lit.
    write(&work, "dark.json", &but(&scene, "/volumes/0/medium/albedo", json!([0, 0, 0])));
    work.json(&format!("render dark.json {OPTIONS} --max-omitted 0.5 -o dark.exr"));
    let lit = work.picture("dark.exr").rgba.iter().filter(|rgba| rgba[0] > 0.2).count();
    assert!(lit > 100, "{lit}");
    // Error targets, denoising and planes.
    let report = work.json("render scene.json --cameras camera.json --target-error 0.05 -o target.exr");
    let error = report["accuracy"]["pictures"][0]["error"].as_f64().unwrap();
    assert!(error > 0.0 && error <= 0.05, "{report}");
    work.json("render scene.json --cameras camera.json --samples 16 --denoise -o denoised.exr");
}

#[test]
fn meshes_that_cannot_be_are_refused() {
    let (work, scene) = prepared();
    let refused = |name: &str, scene: &Value, code: Code, words: &[&str]| {
        write(&work, name, scene);
        work.refused(&format!("render {name} {OPTIONS} -o x.exr"), code, words);
        assert!(!work.path("x.exr").exists());
    };
    let of = |at: &str, value: Value| but(&scene, at, value);
    refused("a.json", &of("/meshes/0/file", json!("none.ply")), Code::NotFound, &["none.ply"]);
    refused("b.json", &of("/meshes/1/file", json!("camera.json")), Code::Unsupported, &["b.json", "mesh 1", "PLY"]);
    refused("c.json", &of("/meshes/1/albedo", json!([0.5, 1.5, 0.5])), Code::Invalid, &["mesh 1", "1.5", "0 to 1"]);
    refused("d.json", &of("/meshes/1/emission", json!([0.5, -1, 0.5])), Code::Invalid, &["mesh 1", "-1"]);
    let flat = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1]]);
    refused("e.json", &of("/meshes/1/transform", flat), Code::Invalid, &["mesh 1"]);
    refused("f.json", &of("/meshes/1/file", json!("prop.####.ply")), Code::Invalid, &["mesh 1", "--frames"]);
    std::fs::write(work.path("broken.ply"), "ply\nformat ascii 1.0\nelement vertex 3\n").unwrap();
    refused("g.json", &of("/meshes/1/file", json!("broken.ply")), Code::Invalid, &["broken.ply"]);
    write_ply(&work.path("far.ply"), &vec![[DVec3::ZERO, DVec3::X, DVec3::splat(1e200)]]);
    refused("h.json", &of("/meshes/1/file", json!("far.ply")), Code::Invalid, &["far.ply", "origin"]);
    write_ply(&work.path("many.ply"), &ball(DVec3::ZERO, 0.4, 300));
    write(&work, "i.json", &of("/meshes/1/file", json!("many.ply")));
    work.refused(
        &format!("render i.json {OPTIONS} --max-memory 150M --threads 1 -o x.exr"),
        Code::MemoryLimit,
        &["--max-memory"],
    );
    // Faces and points of a stage contradict each other.
    for (shape, words) in [
        (
            "point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]\n int[] faceVertexCounts = [3]\n int[] faceVertexIndices = [0, 1, 9]",
            ["names a point", "/ball"],
        ),
        (
            "point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]\n int[] faceVertexCounts = [4]\n int[] faceVertexIndices = [0, 1, 2]",
            ["4 corners", "/ball"],
        ),
        (
            "point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]\n int[] faceVertexCounts = [2]\n int[] faceVertexIndices = [0, 1]",
            ["2 corners", "/ball"],
        ),
        (
            "point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, nan)]\n int[] faceVertexCounts = [3]\n int[] faceVertexIndices = [0, 1, 2]",
            ["not finite", "/ball"],
        ),
        (
            "point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]\n int[] faceVertexCounts = [3]\n int[] faceVertexIndices = [0, 1, 2]\n custom color3f cumulo:albedo = (2, 0, 0)",
            ["albedo", "/ball"],
        ),
        (
            "point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]\n int[] faceVertexCounts = [3]\n int[] faceVertexIndices = [0, 1, 2]\n custom string cumulo:albedo = \"red\"",
            ["cumulo:albedo", "/ball"],
        ),
    ] {
        std::fs::write(work.path("stage.usda"), format!("#usda 1.0\n{}", stage(shape, ""))).unwrap();
        work.refused(&format!("render stage.usda {OPTIONS} -o x.exr"), Code::Invalid, &words);
    }
}

/// While the shutter is open objects go from their place at its beginning to that at its end: a picture is the mean of
/// sharp ones on the way, and alike for any number of threads.
#[test]
fn objects_move_while_the_shutter_is_open() {
    let (work, scene) = prepared();
    let at = |x: f64| json!([[1, 0, 0, x], [0, 1, 0, 0.5], [0, 0, 1, 0.75], [0, 0, 0, 1]]);
    let mut moving = scene.clone();
    let mesh = &mut moving["meshes"][1];
    (mesh["transform_start"], mesh["transform_end"]) = (at(1.0), at(2.0));
    let volume = &mut moving["volumes"][0];
    let up = |z: f64| json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, z], [0, 0, 0, 1]]);
    (volume["transform_start"], volume["transform_end"]) = (up(-0.4), up(0.4));
    write(&work, "moving.json", &moving);
    let blurred = "--cameras camera.json --samples 256 --frames 1 --shutter 0.5";
    work.json(&format!("render moving.json {blurred} --threads 1 -o blurred"));
    work.json(&format!("render moving.json {blurred} --threads 2 -o again"));
    let picture = |folder: &str| work.picture(&format!("{folder}/frame.0001.exr"));
    assert_eq!(picture("blurred"), picture("again"));
    // Deep pictures have what moves out of the place of the frame as well.
    work.json(&format!("render moving.json {blurred} --deep 0.01 -o deep"));
    work.json("convert deep/frame.0001.exr flat.exr --flatten");
    for (flat, deep) in picture("blurred").rgba.iter().zip(&work.picture("flat.exr").rgba) {
        assert!((flat[3] - deep[3]).abs() < 1e-4, "{flat:?} {deep:?}");
    }
    let mut mean = vec![[0.0_f64; 4]; 24 * 20];
    let steps = 32;
    for step in 0..steps {
        let share = (f64::from(step) + 0.5) / f64::from(steps);
        let still = but(&scene, "/meshes/1/transform", at(1.0 + share));
        let mut still = still.clone();
        still["volumes"][0]["transform"] = up(-0.4 + 0.8 * share);
        write(&work, "still.json", &still);
        work.json(&format!(
            "render still.json --cameras camera.json --samples 16 --seed {step} -o still.exr --overwrite"
        ));
        for (sum, rgba) in mean.iter_mut().zip(&work.picture("still.exr").rgba) {
            sum.iter_mut().zip(rgba).for_each(|(sum, v)| *sum += f64::from(*v) / f64::from(steps));
        }
    }
    work.json(&format!("render scene.json {blurred} -o sharp"));
    let off = |film: &cumulo::scene::film::Film| {
        let pairs = film.rgba.iter().flatten().zip(mean.iter().flatten());
        (pairs.map(|(a, b)| (f64::from(*a) - b).powi(2)).sum::<f64>() / (4.0 * mean.len() as f64)).sqrt()
    };
    let (found, sharp) = (off(&picture("blurred")), off(&picture("sharp")));
    println!("off by {found:.4}, and without motion by {sharp:.4}");
    assert!(found < 0.03 && sharp > 3.0 * found, "{found} {sharp}");
    for (key, words) in [("transform_end", "transform_start"), ("transform_start", "transform_end")] {
        let mut half = moving.clone();
        half["meshes"][1].as_object_mut().unwrap().remove(key);
        write(&work, "half.json", &half);
        work.refused(&format!("render half.json {blurred} -o x"), Code::Invalid, &["mesh 1", words]);
    }
}

/// Volumes go with their velocities while the shutter is open: an even wind is a camera that goes the other way.
#[test]
fn volumes_go_with_their_velocities() {
    let work = Work::new();
    let matrix = |x: f64| json!([[1, 0, 0, 1.0 + x], [0, 1, 0, 1.0], [0, 0, 1, 5.0], [0, 0, 0, 1]]);
    let camera = |name: &str, way: f64| {
        let frame = json!({"file_path": "view.exr", "transform_matrix": matrix(0.0), "shutter_open": -0.5,
            "transform_matrix_start": matrix(-way), "transform_matrix_end": matrix(way), "shutter_close": 0.5});
        let camera = json!({"w": 24, "h": 20, "fl_x": 30.0, "near": 0.0, "frames": [frame]});
        std::fs::write(work.path(name), camera.to_string()).unwrap();
    };
    camera("still.json", 0.0);
    camera("moving.json", -0.3);
    crate::common::grids::write_wind(&work.path("wind.vdb"), [14.4, 0.0, 0.0]);
    let medium = json!({"density_scale": 3, "albedo": [0.9, 0.9, 0.9]});
    let scene = |velocity: bool| {
        let mut volume = json!({"file": "wind.vdb", "grid": "density", "medium": medium});
        if velocity {
            volume["velocity"] = json!({"grid": "velocity", "fps": 24});
        }
        json!({"volumes": [volume], "lights": [{"type": "DistantLight", "direction": [0, 0, 1], "irradiance": [3, 3, 3]}]})
    };
    write(&work, "blown.json", &scene(true));
    write(&work, "calm.json", &scene(false));
    let render = |scene: &str, camera: &str| {
        work.json(&format!("render {scene} --cameras {camera} --samples 256 -o x.exr --overwrite"));
        work.picture("x.exr")
    };
    let (blown, other, calm) =
        (render("blown.json", "still.json"), render("calm.json", "moving.json"), render("calm.json", "still.json"));
    let off = |a: &cumulo::scene::film::Film, b: &cumulo::scene::film::Film| {
        let pairs = a.rgba.iter().flatten().zip(b.rgba.iter().flatten());
        (pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / (4.0 * a.rgba.len() as f64)).sqrt()
    };
    let (found, sharp) = (off(&blown, &other), off(&calm, &other));
    println!("off by {found:.4}, and without velocities by {sharp:.4}");
    assert!(found < 0.02 && sharp > 4.0 * found, "{found} {sharp}");
}
