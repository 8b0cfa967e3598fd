//! `cumulo usd author`: stages that read back as what was asked for.

use crate::common::work::{self, Work, fixture};
use cumulo::error::Code;
use cumulo::formats::exr;
use cumulo::formats::limits::Limits;
use cumulo::formats::transforms;
use cumulo::formats::usd::{Overrides, Stage, UpAxis, scene};
use cumulo::formats::vdb::{Codec, NativeGrid, RawLeaf, write_native};
use cumulo::scene::film::Film;
use cumulo::scene::grid::{Grid, Leaf};
use cumulo::scene::light::Light;
use glam::{DVec3, Vec3};
use std::collections::BTreeMap;
use std::fs;

fn stage(work: &Work, name: &str) -> Stage {
    let stage = Stage::open(&work.path(name), Limits::default()).unwrap();
    assert!(stage.faults.is_empty(), "{:?}", stage.faults);
    stage
}

/// Frames 1, 2 and 4, the last of which has other grids.
fn sequence(work: &Work) {
    for (name, from) in
        [("smoke.0001.vdb", "plume.vdb"), ("smoke.0002.vdb", "cube.vdb"), ("smoke.0004.vdb", "slab.vdb")]
    {
        fs::copy(fixture(from), work.path(name)).unwrap();
    }
}

#[test]
fn a_volume_has_its_grids_medium_and_box() {
    let work = Work::new();
    fs::copy(fixture("kinds.vdb"), work.path("kinds.vdb")).unwrap();
    fs::copy(fixture("plume.vdb"), work.path("plume.vdb")).unwrap();
    let medium = "--density-scale 2.5 --albedo 0.9,0.8,0.7 --anisotropy 0.3 --extinction-color 1,0.5,0.25";
    let report = work.json(&format!("usd author plume.vdb {medium} --emission 1,2,3 -o stage.usda"));
    assert_eq!(report["volumes"][0]["prim"], "/World/plume");
    let stage = stage(&work, "stage.usda");
    let metadata = &stage.metadata;
    assert_eq!(metadata.default_prim.as_deref(), Some("/World"));
    assert_eq!((metadata.up_axis, metadata.meters_per_unit, metadata.start), (Some(UpAxis::Z), Some(1.0), None));
    let hash = metadata.custom_data.as_ref().unwrap().entry("cumulo:inputs").unwrap().text().unwrap().to_owned();
    assert!(hash.starts_with("plume.vdb sha256:"), "{hash}");
    let volume = stage.prim("/World/plume").unwrap();
    assert_eq!(volume.targets("field:density"), ["/World/plume/density"]);
    let field = stage.prim("/World/plume/density").unwrap();
    assert_eq!(field.text("fieldName", 0.0).as_deref(), Some("density"));
    assert_eq!(field.text("fieldDataType", 0.0).as_deref(), Some("float"));
    assert_eq!(field.text("fieldClass", 0.0).as_deref(), Some("fogVolume"));
    assert_eq!(field.value("filePath", 0.0).unwrap().asset().unwrap().authored, "./plume.vdb");

    // Read as a scene it is the medium of the options.
    let read = scene::load(&stage, 0.0, Limits::default(), &Overrides::default()).unwrap();
    let medium = &read.volumes[0].medium;
    let scattering = medium.scattering.unwrap();
    assert_eq!((medium.extinction, medium.color), (2.5, [1.0, 0.5, 0.25]));
    assert_eq!(scattering.albedo, [0.9, 0.8, 0.7]);
    let world = read.volumes[0].grid.transform;
    assert_eq!(world.matrix(), work::density(&fixture("plume.vdb")).transform.matrix());

    // Grids of every kind that a field can hold.
    work.json("usd author kinds.vdb --up y --meters-per-unit 0.01 -o kinds.usda");
    let kinds = Stage::open(&work.path("kinds.usda"), Limits::default()).unwrap();
    assert_eq!((kinds.metadata.up_axis, kinds.metadata.meters_per_unit), (Some(UpAxis::Y), Some(0.01)));
    let types = [("velocity", "float3"), ("label", "int"), ("mask", "mask"), ("pressure", "double")];
    for (name, expected) in types {
        let prim = kinds.prim(&format!("/World/kinds/{name}")).unwrap_or_else(|| panic!("{name}"));
        let found = prim.text("fieldDataType", 0.0).unwrap();
        // A mask is written as a grid of booleans by some libraries.
        assert!(found == expected || (name == "mask" && found == "bool"), "{name}: {found}");
    }
    // The only scalar grid is the density.
    assert_eq!(kinds.prim("/World/kinds").unwrap().targets("field:density"), ["/World/kinds/pressure"]);
    work.json("usd author kinds.vdb --grid velocity -o one.usda");
    let one = Stage::open(&work.path("one.usda"), Limits::default()).unwrap();
    assert_eq!(one.of_type("OpenVDBAsset").count(), 1);
}

#[test]
fn frames_are_time_codes() {
    let work = Work::new();
    sequence(&work);
    let out = work.command("usd author smoke.####.vdb --fps 25 -o out.usda").output().unwrap();
    assert!(out.status.success(), "{}", work::errors(&out));
    assert!(work::errors(&out).contains("frames 3-3 have no file"), "{}", work::errors(&out));
    let stage = stage(&work, "out.usda");
    assert_eq!((stage.metadata.start, stage.metadata.end), (Some(1.0), Some(4.0)));
    assert_eq!((stage.time_codes_per_second(), stage.metadata.frames_per_second), (25.0, Some(25.0)));
    let path = |time: f64| {
        let file = stage.prim("/World/smoke/density").unwrap().attribute("filePath").unwrap().held_at(time).unwrap();
        file.asset().unwrap().authored.clone()
    };
    assert_eq!([1.0, 2.0, 3.0, 4.0].map(path), [1, 2, 2, 4].map(|n| format!("./smoke.{n:04}.vdb")));
    // Half a voxel around the centers of 16³ voxels of 1/8, and of 40 x 40 x 8 voxels of 1/10.
    let extent = |time: f64| {
        let list = stage.prim("/World/smoke").unwrap().value("extent", time).unwrap();
        let corners = list.list().unwrap().iter().map(|v| v.tuple::<3>().unwrap()).collect::<Vec<_>>();
        corners[1][0] - corners[0][0]
    };
    assert!((extent(2.0) - 2.0).abs() < 1e-6 && extent(4.0) > 3.9, "{} {}", extent(2.0), extent(4.0));

    work.json("usd author smoke.####.vdb --frames 1-2 -o two.usda");
    let two = Stage::open(&work.path("two.usda"), Limits::default()).unwrap();
    assert_eq!(two.metadata.end, Some(2.0));
    work.refused("usd author smoke.####.vdb --frames 1-3 -o no.usda", Code::NotFound, &["smoke.0003.vdb"]);
    assert!(!work.path("no.usda").exists());
}

/// A grid that some frames lack has no file at their time codes.
#[test]
fn grids_that_come_and_go_are_blocked() {
    let work = Work::new();
    fs::copy(fixture("plume.vdb"), work.path("s.0001.vdb")).unwrap();
    fs::copy(fixture("kinds.vdb"), work.path("s.0002.vdb")).unwrap();
    fs::copy(fixture("plume.vdb"), work.path("s.0003.vdb")).unwrap();
    work.json("usd author s.####.vdb -o s.usda");
    let text = fs::read_to_string(work.path("s.usda")).unwrap();
    let times = |field: &str| {
        let start = text.find(&format!("def OpenVDBAsset \"{field}\"")).unwrap();
        let samples = &text[start..][text[start..].find("timeSamples").unwrap()..];
        samples[..samples.find('}').unwrap()].to_owned()
    };
    assert!(
        times("density").contains("1: @./s.0001.vdb@") && times("density").contains("2: None"),
        "{}",
        times("density")
    );
    let label = times("label");
    assert!(label.contains("1: None") && label.contains("2: @./s.0002.vdb@") && label.contains("3: None"), "{label}");
}

#[test]
fn cameras_and_lights_read_back() {
    let work = Work::new();
    fs::create_dir(work.path("sub")).unwrap();
    fs::copy(fixture("plume.vdb"), work.path("plume.vdb")).unwrap();
    work.json("render plume.vdb --views 3 --size 24x16 --density-scale auto -o shots");
    let capture = transforms::load(&work.path("shots")).unwrap();
    let light = "--sun=-1,0.6,0.7 --sun-color 9,7.4,5.6 --sun-angle 2 --sky 0.1,0.2,0.3 --albedo 0.9";
    work.json(&format!("usd author plume.vdb --camera shots {light} -o sub/stage.usda"));
    let stage = stage(&work, "sub/stage.usda");
    assert!(fs::read_to_string(work.path("sub/stage.usda")).unwrap().contains("@../plume.vdb@"));
    let cameras: Vec<_> = stage.of_type("Camera").collect();
    assert_eq!(cameras.len(), 3);
    for (prim, frame) in cameras.iter().zip(&capture.frames) {
        let map = stage.local_to_world(prim, 0.0).unwrap();
        assert!(map.abs_diff_eq(frame.camera.camera_to_world, 1e-9), "{map}");
        let ratio = prim.number("focalLength", 0.0).unwrap() / prim.number("horizontalAperture", 0.0).unwrap();
        assert!((ratio * 24.0 / frame.camera.focal.x - 1.0).abs() < 1e-6);
        assert_eq!(prim.tuple::<2>("cumulo:resolution", 0.0), Some([24.0, 16.0]));
    }
    let read = scene::load(&stage, 0.0, Limits::default(), &Overrides::default()).unwrap();
    let [Light::Sun { direction, irradiance, angle }] = read.lights[..] else { panic!("{:?}", read.lights) };
    assert!(direction.abs_diff_eq(DVec3::new(-1.0, 0.6, 0.7).normalize(), 1e-9), "{direction}");
    assert!(irradiance.abs_diff_eq(Vec3::new(9.0, 7.4, 5.6), 1e-5), "{irradiance}");
    assert!((angle.to_degrees() - 2.0).abs() < 1e-6);
    assert!(Vec3::from_array(read.environment.radiance).abs_diff_eq(Vec3::new(0.1, 0.2, 0.3), 1e-6));

    // One camera that moves, at the time codes of the views.
    work.json("usd author plume.vdb --camera shots --camera-path -o path.usda");
    let path = Stage::open(&work.path("path.usda"), Limits::default()).unwrap();
    assert_eq!((path.metadata.start, path.metadata.end), (Some(0.0), Some(2.0)));
    let camera = path.of_type("Camera").next().unwrap();
    for (time, frame) in [0.0, 1.0, 2.0].into_iter().zip(&capture.frames) {
        assert!(path.local_to_world(camera, time).unwrap().abs_diff_eq(frame.camera.camera_to_world, 1e-9));
    }
}

#[test]
fn scene_files_become_stages() {
    let work = Work::new();
    fs::copy(fixture("plume.vdb"), work.path("plume.vdb")).unwrap();
    work.json("convert @kinds.vdb fire.vdb --rename pressure=mass");
    let scene = serde_json::json!({
        "volumes": [
            {"file": "plume.vdb", "medium": {"density_scale": 3, "albedo": [0.5, 0.5, 0.5], "gradient_shading": 7}},
            {"file": "fire.vdb", "grid": "mass", "medium": {"emission": [1, 0.5, 0.25]}}
        ],
        "lights": [
            {"type": "PointLight", "position": [1, 2, 3], "intensity": [4, 2, 1]},
            {"type": "SphereLight", "centre": [0, 0, 5], "radius": 0.5, "radiance": [1, 2, 3]},
            {"type": "RectLight", "corner": [1, 1, 5], "edges": [[2, 0, 0], [0, 3, 0]], "radiance": [2, 2, 2]},
            {"type": "SphereLight", "centre": [0, 0, 7], "radius": 0.25, "radiance": [1, 1, 1], "soft_falloff": true},
            {"type": "SpotLight", "position": [1, 2, 3], "direction": [1, 0, -2], "intensity": [4, 2, 1], "angle": 50,
             "blend": 0.3, "radius": 0.2, "soft_falloff": true},
            {"type": "SpotLight", "position": [3, 2, 1], "direction": [0, 0, 1], "intensity": [1, 1, 1], "angle": 200},
            {"type": "DomeLight", "radiance": [0.2, 0.3, 0.5]}
        ],
        "left_out": ["object 'Cube': a mesh", "light \"Lamp\": a disk"]
    });
    fs::write(work.path("scene.json"), scene.to_string()).unwrap();
    let report = work.json("usd author scene.json -o scene.usda");
    assert_eq!((report["volumes"].as_array().unwrap().len(), &report["lights"]), (2, &7.into()));
    let text = fs::read_to_string(work.path("scene.usda")).unwrap();
    assert!(text.contains(r#"left_out" = "object 'Cube': a mesh\nlight \"Lamp\": a disk""#), "{text}");
    let stage = stage(&work, "scene.usda");
    assert_eq!(stage.prim("/World/fire").unwrap().targets("field:density"), ["/World/fire/mass"]);
    assert_eq!(stage.prim("/World/plume").unwrap().number("cumulo:gradientShading", 0.0), Some(7.0));
    let lights = cumulo_lights(&stage);
    let near = |a: Vec3, b: [f32; 3]| assert!(a.abs_diff_eq(Vec3::from_array(b), 1e-5), "{a} {b:?}");
    for light in lights {
        match light {
            Light::Point { position, intensity } => {
                assert_eq!(position, DVec3::new(1.0, 2.0, 3.0));
                near(intensity, [4.0, 2.0, 1.0]);
            }
            Light::Sphere { centre, radius, radiance } => {
                assert_eq!((centre, radius), (DVec3::new(0.0, 0.0, 5.0), 0.5));
                near(radiance, [1.0, 2.0, 3.0]);
            }
            Light::Rectangle { corner, edges: [u, v], radiance } => {
                let middle = corner + 0.5 * (u + v);
                assert!(middle.abs_diff_eq(DVec3::new(2.0, 2.5, 5.0), 1e-9), "{middle}");
                assert!(u.cross(v).abs_diff_eq(DVec3::new(0.0, 0.0, 6.0), 1e-9), "{u} {v}");
                near(radiance, [2.0; 3]);
            }
            Light::Disc { centre, radius, radiance } => {
                assert_eq!((centre, radius), (DVec3::new(0.0, 0.0, 7.0), 0.25));
                near(radiance, [1.0; 3]);
            }
            Light::Spot { position, radius, soft, intensity, cone } if radius > 0.0 => {
                assert_eq!((position, soft), (DVec3::new(1.0, 2.0, 3.0), true));
                near(intensity, [4.0, 2.0, 1.0]);
                // Single precision of the radius, the angle and the softness.
                assert!((radius - 0.2).abs() < 1e-7 && (cone.blend() - 0.3).abs() < 1e-6, "{cone:?}");
                assert!((cone.angle().to_degrees() - 25.0).abs() < 1e-5, "{cone:?}");
                assert!(cone.axis().abs_diff_eq(DVec3::new(1.0, 0.0, -2.0).normalize(), 1e-9), "{cone:?}");
            }
            Light::Spot { position, cone, .. } => {
                assert_eq!((position, cone.blend()), (DVec3::new(3.0, 2.0, 1.0), 0.0));
                assert!(cone.axis().abs_diff_eq(DVec3::Z, 1e-15), "{cone:?}");
                assert!((cone.angle().to_degrees() - 100.0).abs() < 1e-5, "{cone:?}");
            }
            Light::Sun { .. } => panic!("no sun"),
        }
    }
    work.refused("usd author scene.json --albedo 0.5 -o no.usda", Code::Invalid, &["scene.json", "--albedo", "leave"]);
    let moving =
        scene.to_string().replace(r#""grid":"mass","#, r#""grid":"mass","velocity":{"grid":"velocity","fps":30},"#);
    assert_ne!(moving, scene.to_string());
    fs::write(work.path("moving.json"), moving).unwrap();
    work.refused("usd author moving.json -o no.usda", Code::Unsupported, &["volume 1", "30", "--fps 30"]);
    work.json("usd author moving.json --fps 30 -o velocity.usda");
    // A stage at rest has its rate as well, since velocities are per second.
    let rated = Stage::open(&work.path("velocity.usda"), Limits::default()).unwrap();
    assert_eq!((rated.metadata.start, rated.time_codes_per_second()), (None, 30.0));
    let slanted = scene.to_string().replace("[0,3,0]", "[1,3,0]");
    fs::write(work.path("slanted.json"), slanted).unwrap();
    work.refused("usd author slanted.json -o no.usda", Code::Unsupported, &["RectLight", "right angles"]);
}

/// Pixels that are not square are so again when the stage is read, at the size of the pictures and at another.
#[test]
fn pixels_keep_their_proportions() {
    let work = Work::new();
    fs::copy(fixture("plume.vdb"), work.path("plume.vdb")).unwrap();
    work.json("render plume.vdb --views 2 --size 24x16 --density-scale 1 -o shots");
    let mut capture = transforms::load(&work.path("shots")).unwrap();
    for frame in &mut capture.frames {
        frame.camera.focal.y *= 1.25;
    }
    transforms::save(&work.path("shots/transforms.json"), &capture, &serde_json::Map::new()).unwrap();
    work.json("usd author plume.vdb --camera shots --camera-path -o stage.usda");
    let stage = stage(&work, "stage.usda");
    for (size, by) in [([24, 16], 1.0), ([48, 32], 2.0)] {
        let view = stage.view(stage.camera(None).unwrap(), 0.0, size).unwrap();
        // Apertures are in single precision.
        assert!((view.focal / capture.frames[0].camera.focal / by - 1.0).abs().max_element() < 1e-6, "{}", view.focal);
    }
}

/// A VDB of all that can be seen, with grids whose names come before those of the parts in the alphabet.
fn fire(path: &std::path::Path) {
    let plume = work::density(&fixture("plume.vdb"));
    let scaled = |name: &str, by: f32| {
        let mut grid = Grid { name: name.into(), metadata: BTreeMap::new(), ..plume.clone() };
        grid.leaves.iter_mut().flat_map(|leaf| leaf.values.iter_mut()).for_each(|value| *value *= by);
        NativeGrid::from_grid(&grid).unwrap()
    };
    let names = [("mass", 1.0), ("fire", 0.1), ("heat", 2.0), ("temp", 0.3), ("kelvin", 1.5)];
    let mut grids: Vec<NativeGrid> = names.map(|(name, by)| scaled(name, by)).into();
    for (name, speed) in [("vel", 9.0), ("wind", 1.0)] {
        let leaf = |leaf: &Leaf| RawLeaf {
            origin: leaf.origin,
            values: leaf.values.iter().flat_map(|_| [speed, 0.5 * speed, 0.0]).collect(),
            active: leaf.active,
        };
        let leaves: Vec<RawLeaf> = plume.leaves.iter().map(leaf).collect();
        let class = cumulo::scene::grid::GridClass::Unknown;
        grids.push(NativeGrid::from_vectors(name, class, &plume.transform, &leaves).unwrap());
    }
    let grids: Vec<&NativeGrid> = grids.iter().collect();
    write_native(path, &grids, None, &BTreeMap::new(), Codec::Blosc).unwrap();
}

/// A stage of a scene file with every key shows what the scene file shows.
#[test]
fn every_key_of_a_scene_file_is_authored() {
    let work = Work::new();
    fire(&work.path("fire.vdb"));
    for name in ["plume.vdb", "cube.vdb"] {
        fs::copy(fixture(name), work.path(name)).unwrap();
    }
    work.json("transfer inferno -o inferno.tf.json");
    let scene = serde_json::json!({
        "volumes": [
            {"file": "fire.vdb", "grid": "mass",
                "transform": [[0.4, -0.1, 0.0, 0.7], [0.2, 0.5, 0.1, 0.3], [0.0, 0.0, 0.3, 0.2], [0, 0, 0, 1]],
                "medium": {"density_scale": 9, "albedo": [0.7, 0.6, 0.5], "anisotropy": 0.4, "gradient_shading": 7,
                    "specular": 0.1, "roughness": 0.4,
                    "extinction_color": [1, 0.8, 0.6], "emission_grid": {"grid": "heat", "radiance": [2, 1, 0.5]},
                    "blackbody": {"grid": "kelvin", "kelvin": 1500, "intensity": 2, "tint": [1, 0.5, 0.75]}},
                "velocity": {"grid": "wind", "fps": 30}},
            {"file": "plume.vdb", "transform": [[1, 0, 0, 0.5], [0, 1, 0, -0.3], [0, 0, 1, 0.4], [0, 0, 0, 1]],
                "medium": {"density_scale": 0.5, "albedo": [0.2, 0.4, 0.3], "emission": [0.5, 0.25, 1]}},
            {"file": "cube.vdb", "medium": {"density_scale": 0.25, "transfer": "inferno.tf.json",
                "tf_color": "both"}}
        ],
        "lights": [
            {"type": "DistantLight", "direction": [1, 0.5, 0.7], "irradiance": [3, 2, 1], "angle": 2},
            {"type": "PointLight", "position": [1, 2, 3], "intensity": [4, 2, 1]},
            {"type": "SphereLight", "centre": [0, 0, 5], "radius": 0.5, "radiance": [1, 2, 3]},
            {"type": "RectLight", "corner": [-3, 1, 5], "edges": [[2, 0, 0], [0, 3, 0]], "radiance": [2, 2, 2]},
            {"type": "DomeLight", "radiance": [0.2, 0.3, 0.5]},
            {"type": "DomeLight", "radiance": [0.5, 0.25, 1], "texture": "shots/view_001.exr"}
        ]
    });
    // The cameras see all of its volumes.
    fs::write(work.path("volumes.json"), serde_json::json!({"volumes": scene["volumes"]}).to_string()).unwrap();
    work.json("render volumes.json --views 2 --size 12x8 --samples 1 -o shots");
    // A key that this scene lacks would go untested.
    let schema = work.json("schema scene").to_string();
    let keys = ["VolumeEntry", "MediumEntry", "VelocityEntry", "EmissionGridEntry", "BlackbodyEntry"];
    let schema: serde_json::Value = serde_json::from_str(&schema).unwrap();
    for kind in keys {
        // Motion while a shutter is open is left out, with a remark.
        let moves = |key: &&String| key.starts_with("transform_");
        for key in schema["$defs"][kind]["properties"].as_object().unwrap().keys().filter(|key| !moves(key)) {
            assert!(scene.to_string().contains(&format!("\"{key}\"")), "{kind}: '{key}' is in no volume of the scene");
        }
    }
    fs::write(work.path("scene.json"), scene.to_string()).unwrap();
    let report = work.json("usd author scene.json --fps 30 -o stage.usda");
    let corner = |side: usize, axis: usize| report["volumes"][1]["bounds"][side][axis].as_f64().unwrap();
    let plain = work.json("usd author plume.vdb -o plain.usda");
    let own = |side: usize, axis: usize| plain["volumes"][0]["bounds"][side][axis].as_f64().unwrap();
    assert!((corner(0, 0) - own(0, 0) - 0.5).abs() < 1e-9 && (corner(1, 1) - own(1, 1) + 0.3).abs() < 1e-9, "{report}");
    let lint = work.command("usd lint stage.usda").output().unwrap();
    assert_eq!(lint.status.code(), Some(0), "{}", String::from_utf8_lossy(&lint.stdout));

    let apart = |a: &str, b: &str| {
        let (mut most, mut least) = (0.0_f32, f32::INFINITY);
        for view in ["frame.0000.exr", "frame.0001.exr"] {
            let film = |folder: &str| {
                exr::read_film_within(&work.path(&format!("{folder}/{view}")), None, Limits::default()).unwrap()
            };
            let (a, b) = (film(a), film(b));
            let planes = |film: &Film| film.planes.iter().flat_map(|p| p.samples.clone()).collect::<Vec<f32>>();
            assert!(!a.planes.is_empty() && planes(&a).iter().any(|v| *v != 0.0), "no motion");
            let all = |film: &Film| film.rgba.iter().flatten().copied().chain(planes(film)).collect::<Vec<f32>>();
            let differences = all(&a).into_iter().zip(all(&b)).map(|(a, b)| (a - b).abs() / (0.1 + a.abs()));
            let largest = differences.fold(0.0, f32::max);
            (most, least) = (most.max(largest), least.min(largest));
        }
        (most, least)
    };
    let options = "--cameras shots --frames 0-1 --samples 4 --aov motion";
    work.json(&format!("render scene.json {options} -o scene"));
    work.json(&format!("render stage.usda {options} -o stage"));
    // Lights are split into an intensity and a color, and turned, in single precision.
    let (most, _) = apart("scene", "stage");
    assert!(most < 1e-3, "{most}");
    // Every key counts: without it the pictures are others.
    for (pointer, value) in [
        ("/volumes/0/grid", "fire".into()),
        ("/volumes/0/transform", serde_json::Value::Null),
        ("/volumes/1/transform/0/3", 0.0.into()),
        ("/volumes/0/medium/density_scale", 1.into()),
        ("/volumes/0/medium/extinction_color", serde_json::json!([1, 1, 1])),
        ("/volumes/0/medium/emission_grid/grid", "fire".into()),
        ("/volumes/0/medium/blackbody/grid", "temp".into()),
        ("/volumes/0/velocity/grid", "vel".into()),
        ("/volumes/2/medium/transfer", serde_json::Value::Null),
    ] {
        let mut other = scene.clone();
        *other.pointer_mut(pointer).unwrap() = value;
        if pointer.ends_with("/transfer") {
            // It tells what the colors of the function are.
            other["volumes"][2]["medium"].as_object_mut().unwrap().remove("tf_color");
        }
        fs::write(work.path("other.json"), other.to_string()).unwrap();
        work.json(&format!("render other.json {options} --overwrite -o other"));
        let (_, least) = apart("scene", "other");
        assert!(least > 1e-2, "{pointer}: {least}");
    }
    let both = scene.to_string().replace("\"heat\"", "\"mass\"");
    fs::write(work.path("both.json"), &both).unwrap();
    work.refused(
        "usd author both.json --fps 30 -o no.usda",
        Code::Unsupported,
        &["fire.vdb", "'mass' is both density and flame"],
    );
    fs::write(work.path("flat.json"), scene.to_string().replace("[0.0,0.0,0.3,0.2]", "[0.0,0.0,0.0,0.2]")).unwrap();
    work.refused("usd author flat.json --fps 30 -o no.usda", Code::Invalid, &["flat.json", "volume 0"]);
}

fn cumulo_lights(stage: &Stage) -> Vec<Light> {
    let limits = Limits::default();
    let lights = scene::load(stage, 0.0, limits, &Overrides::default()).unwrap().lights;
    assert_eq!(lights.len(), 6);
    lights
}

#[test]
fn only_its_own_stages_are_replaced() {
    let work = Work::new();
    fs::copy(fixture("plume.vdb"), work.path("plume.vdb")).unwrap();
    let command = "usd author plume.vdb -o stage.usda";
    work.json(command);
    work.json(command);
    work.refused("usd author plume.vdb --albedo 0.5 -o stage.usda", Code::OutputExists, &["stage.usda", "--overwrite"]);
    work.json("usd author plume.vdb --albedo 0.5 -o stage.usda --overwrite");
    fs::write(work.path("other.usda"), "#usda 1.0\n").unwrap();
    work.refused("usd author plume.vdb -o other.usda", Code::OutputExists, &["other.usda", "--overwrite"]);
    assert_eq!(fs::read_to_string(work.path("other.usda")).unwrap(), "#usda 1.0\n");
    work.refused("usd author plume.vdb -o stage.vdb", Code::OutputName, &["stage.vdb", ".usda"]);
    work.refused("usd author none.vdb -o a.usda", Code::NotFound, &["none.vdb"]);
    work.refused("usd author none.####.vdb -o a.usda", Code::Invalid, &["none.0001.vdb"]);
    work.refused("usd author plume.vdb --grid heat -o a.usda", Code::Invalid, &["'heat'", "'density'"]);
    work.refused("usd author plume.vdb --tf plume.vdb -o a.usda", Code::Invalid, &["plume.vdb", "transfer function"]);
    assert!(!work.path("a.usda").exists());
}
