//! `cumulo render` by path tracing: options, scene files, planes, and what is refused.

use crate::common::work::{self, Work, errors, fixture};
use cumulo::error::Code;
use cumulo::formats::exr;
use cumulo::formats::limits::Limits;
use cumulo::formats::vdb::{Codec, write_grids};
use cumulo::math::Affine;
use glam::DMat4;
use serde_json::Value;
use std::collections::BTreeMap;

const LIT: &str = "--albedo 0.9 --anisotropy 0.3 --sun 1,1,2 --sun-color 3 --sky 0.2,0.3,0.5";

/// Options and a scene file that say the same give the same pixels, which depend neither on threads nor on other views.
#[test]
fn options_and_scene_files_agree() {
    let work = Work::new();
    let one =
        work.json(&format!("render @plume.vdb --views 2 --size 24x20 --density-scale 4 --samples 4 {LIT} -o one"));
    assert_eq!(one["model"], "scattering");
    assert_eq!(one["paths"]["paths"], 2 * 24 * 20 * 4);
    assert_eq!(
        (&one["paths"]["majorant_violations"], &one["paths"]["impossible_directions"]),
        (&Value::from(0), &Value::from(0))
    );
    let record: Value = serde_json::from_slice(&std::fs::read(work.path("one/transforms.json")).unwrap()).unwrap();
    assert_eq!(record["scattering"]["sun"]["angle_degrees"], 0.53);
    let scene = serde_json::json!({
        "volumes": [{"file": fixture("plume.vdb"), "medium": {
            "density_scale": 4, "albedo": [0.9, 0.9, 0.9], "anisotropy": 0.3}}],
        "lights": [
            {"type": "DistantLight", "direction": [1, 1, 2], "irradiance": [3, 3, 3], "angle": 0.53},
            {"type": "DomeLight", "radiance": [0.2, 0.3, 0.5]}],
    });
    std::fs::write(work.path("scene.json"), scene.to_string()).unwrap();
    work.json("render scene.json --views 2 --size 24x20 --samples 4 --threads 1 -o two");
    for view in ["view_000.exr", "view_001.exr"] {
        assert_eq!(work.picture(&format!("one/{view}")), work.picture(&format!("two/{view}")), "{view}");
    }
    work.json(&format!(
        "render @plume.vdb --views 2 --size 24x20 --density-scale 4 --samples 4 --seed 1 {LIT} -o three"
    ));
    assert_ne!(work.picture("one/view_000.exr"), work.picture("three/view_000.exr"));
    // Gradient shading from the options and from the scene file, and no other pictures without it.
    let shaded = scene.to_string().replace("\"anisotropy\":0.3", "\"anisotropy\":0.3,\"gradient_shading\":2.5");
    std::fs::write(work.path("shaded.json"), shaded).unwrap();
    work.json("render shaded.json --views 2 --size 24x20 --samples 4 -o shaded");
    let options = "--views 2 --size 24x20 --density-scale 4 --samples 4 --gradient-shading 2.5";
    work.json(&format!("render @plume.vdb {options} {LIT} -o lit"));
    assert_eq!(work.picture("shaded/view_001.exr"), work.picture("lit/view_001.exr"));
    assert_ne!(work.picture("shaded/view_001.exr"), work.picture("one/view_001.exr"));
    assert!(work.json("schema scene")["properties"]["volumes"].is_object());
}

/// A volume that its scene file moves gives the pixels of one whose file has that place, its fire included.
#[test]
fn scene_files_move_volumes() {
    let work = Work::new();
    // A quarter turn around z, doubled and shifted; numbers that are exact in binary.
    let rows = [[0.0, -2.0, 0.0, 3.0], [2.0, 0.0, 0.0, -1.5], [0.0, 0.0, 2.0, 0.25], [0.0, 0.0, 0.0, 1.0]];
    let mut placed = work::density(&fixture("plume.vdb"));
    let turn = Affine::new(DMat4::from_cols_array_2d(&rows).transpose()).unwrap();
    placed.transform = placed.transform.then(&turn).unwrap();
    write_grids(&work.path("placed.vdb"), &[&placed], &BTreeMap::new(), Codec::default(), false).unwrap();
    let render = |name: &str, volume: Value| {
        let scene = serde_json::json!({"volumes": [volume],
            "lights": [{"type": "DistantLight", "direction": [1, 1, 2], "irradiance": [3, 3, 3]}]});
        std::fs::write(work.path(&format!("{name}.json")), scene.to_string()).unwrap();
        work.json(&format!("render {name}.json --views 2 --size 24x20 --samples 4 -o {name}"));
        work.picture(&format!("{name}/view_001.exr")).rgba
    };
    let medium = serde_json::json!({"density_scale": 2, "albedo": [0.8, 0.8, 0.8],
        "emission_grid": {"grid": "density", "radiance": [0.5, 0.2, 0.1]}});
    let expected = render("placed", serde_json::json!({"file": "placed.vdb", "medium": medium}));
    let moved = render("moved", serde_json::json!({"file": fixture("plume.vdb"), "medium": medium, "transform": rows}));
    let still = render("still", serde_json::json!({"file": fixture("plume.vdb"), "medium": medium}));
    assert_eq!(moved, expected);
    assert_ne!(moved, still);
}

/// A grid that emits is seen as a source of the density is, by straight rays and by paths; without one extinction for all
/// channels each has its own.
#[test]
fn grids_emit_and_extinctions_have_colors() {
    let work = Work::new();
    let render = |name: &str, medium: Value, more: &str| {
        let scene = serde_json::json!({"volumes": [{"file": fixture("plume.vdb"), "medium": medium}]});
        std::fs::write(work.path(&format!("{name}.json")), scene.to_string()).unwrap();
        work.json(&format!("render {name}.json --size 24x20 --samples 64 {more} -o {name}"));
        work.picture(&format!("{name}/view_000.exr")).rgba
    };
    let grid = serde_json::json!({"grid": "density", "radiance": [6.0, 3.0, 0.6]});
    let by_source =
        render("source", serde_json::json!({"density_scale": 3.0, "emission": [2.0, 1.0, 0.2]}), "--views 1");
    // Cameras that are placed show what is visible, which is not the same to the last voxel.
    let medium = || serde_json::json!({"density_scale": 3.0, "emission_grid": grid});
    let by_grid = render("grid", medium(), "--cameras source");
    let by_paths = render("paths", medium(), "--cameras source --force scattering");
    assert!(by_source.iter().any(|p| p[0] > 0.3));
    for (i, expected) in by_source.iter().enumerate() {
        for channel in 0..4 {
            assert!((by_grid[i][channel] - expected[channel]).abs() < 2e-3, "{i}: {:?} {expected:?}", by_grid[i]);
            assert!((by_paths[i][channel] - expected[channel]).abs() < 0.08, "{i}: {:?} {expected:?}", by_paths[i]);
        }
    }
    work.json(
        "render @plume.vdb --views 1 --size 24x20 --density-scale 2 --samples 16 --albedo 0 --sky 1 \
         --extinction-color 1,0.5,0 -o red",
    );
    let red = work.picture("red/view_000.exr").rgba;
    for [r, g, b, _] in red {
        assert!((b - 1.0).abs() < 1e-5 && (r - g * g).abs() < 0.02, "{r} {g} {b}");
    }
}

/// A part of a picture has the pixels of the whole, by paths and by straight rays; a capture of parts has their cameras.
#[test]
fn parts_of_pictures_are_the_same() {
    let work = Work::new();
    for (name, options) in [("paths", format!("--samples 4 {LIT}")), ("rays", "--supersample 2".to_owned())] {
        let render = format!("render @plume.vdb --views 2 --size 24x20 --density-scale 4 {options}");
        work.json(&format!("{render} -o {name}"));
        work.json(&format!("{render} --crop 9,5,12x8 -o {name}-part"));
        let whole = work.picture(&format!("{name}/view_001.exr"));
        let part = work.picture(&format!("{name}-part/view_001.exr"));
        assert_eq!((part.width, part.height), (12, 8));
        for (i, found) in part.rgba.iter().enumerate() {
            assert_eq!(*found, whole.rgba[(5 + i / 12) * 24 + 9 + i % 12], "{name} {i}");
        }
        work.json(&format!("render @plume.vdb --cameras {name}-part --density-scale 4 {options} -o {name}-again"));
        assert_eq!(work.picture(&format!("{name}-again/view_001.exr")).rgba.len(), 12 * 8);
    }
    let render = "render @plume.vdb --views 1 --size 24x20 -o out";
    work.refused(&format!("{render} --crop 20,0,5x5"), Code::Invalid, &["20,0,5x5", "24x20"]);
    work.refused(&format!("{render} --crop 4294967295,0,5x5"), Code::Invalid, &["4294967295"]);
    work.refused(&format!("{render} --crop 1,2"), Code::Usage, &["--crop", "64,32,128x128"]);
}

/// Clamping takes from the scattered light what the report says, and nothing from what is seen straight.
#[test]
fn clamped_pictures_tell_what_they_lost() {
    let work = Work::new();
    let render = "render @plume.vdb --views 1 --size 24x20 --density-scale 4 --samples 16 --albedo 0.9 --sun 1,1,2";
    assert_eq!(work.json(&format!("{render} -o whole"))["paths"]["clamp"], Value::Null);
    let report = work.json(&format!("{render} --clamp 0.05 -o clamped"));
    let [whole, clamped] = ["whole", "clamped"].map(|folder| work.picture(&format!("{folder}/view_000.exr")));
    let mut lost = 0.0;
    for (a, b) in whole.rgba.iter().zip(&clamped.rgba) {
        assert!(a[3] == b[3] && b[..3].iter().zip(a).all(|(b, a)| b <= a && *b <= 0.050_001), "{a:?} {b:?}");
        lost += f64::from(a[0] - b[0]) / whole.rgba.len() as f64;
    }
    let told = report["paths"]["clamp"]["lost_radiance"].as_f64().unwrap();
    assert!(lost > 1e-4 && (told / lost - 1.0).abs() < 1e-3, "{told} {lost}");
    assert!(report["paths"]["clamp"]["share_of_paths"].as_f64().unwrap() > 0.01);
    let unlimited = work.json(&format!("{render} --clamp 1e9 -o same"));
    assert_eq!(unlimited["paths"]["clamp"]["lost_radiance"], 0.0);
    assert_eq!(whole, work.picture("same/view_000.exr"));
    work.refused("render @plume.vdb --views 1 --clamp 1 -o no", Code::Invalid, &["--clamp", "--albedo"]);
}

/// Planes are there by name, and add up: direct and indirect light and what is seen through the volume are the picture.
#[test]
fn planes_add_up() {
    let work = Work::new();
    let aovs = "--aov direct,indirect,albedo,normal,position,depth,variance,halves,optical-depth";
    work.json(&format!(
        "render @plume.vdb --views 1 --size 24x20 --density-scale 4 --samples 16 {LIT} --background 0 {aovs} -o planes"
    ));
    let film = exr::read_film_within(&work.path("planes/view_000.exr"), None, Limits::default()).unwrap();
    let plane =
        |name: &str| film.plane(name).unwrap_or_else(|| panic!("{name} of {:?}", film.planes.iter().map(|p| &p.name)));
    let (direct, indirect) = (plane("Volume Direct.G"), plane("Volume Indirect.G"));
    let (a, b, variance) = (plane("half_a.G"), plane("half_b.G"), plane("variance.G"));
    let mut seen = 0;
    for (i, rgba) in film.rgba.iter().enumerate() {
        assert!((direct[i] + indirect[i] - rgba[1]).abs() < 1e-5 * (1.0 + rgba[1]), "{i}");
        assert!((0.5 * (a[i] + b[i]) - rgba[1]).abs() < 1e-5 * (1.0 + rgba[1]) && variance[i] >= 0.0, "{i}");
        assert!((plane("Denoising Albedo.R")[i] - 0.9 * rgba[3]).abs() < 0.02, "{i}");
        assert!(((-plane("optical_depth.V")[i]).exp() - (1.0 - rgba[3])).abs() < 0.1, "{i}");
        if rgba[3] > 0.0 {
            seen += 1;
            let depth = plane("Depth.Z")[i];
            assert!((1.0..10.0).contains(&depth), "{depth}");
            let normal = ["X", "Y", "Z"].map(|axis| f64::from(plane(&format!("Denoising Normal.{axis}"))[i]));
            assert!(normal.iter().map(|v| v * v).sum::<f64>() <= 1.0 + 1e-6);
            assert!((-0.5..2.5).contains(&plane("Position.X")[i]));
        } else {
            assert_eq!((plane("Depth.Z")[i], plane("Position.X")[i]), (1e10, 0.0));
        }
    }
    assert!(seen > 50, "{seen}");
}

#[test]
fn what_cannot_be_scattered_is_refused_with_words() {
    let work = Work::new();
    let render = "render @plume.vdb --views 1 --size 8x8 -o out";
    for (options, code, expected) in [
        ("--sun 1,0,0", Code::Usage, &["--albedo"][..]),
        ("--albedo 1.2", Code::Usage, &["--albedo", "0 to 1"]),
        ("--albedo 0.5 --sun 0,0,0", Code::Usage, &["no direction"]),
        ("--albedo 0.5 --sun 0,0,1 --sun-angle 200", Code::Invalid, &["200", "0 to 180"]),
        ("--albedo 0.5 --anisotropy 1", Code::Usage, &["anisotropy", "0.999"]),
        ("--albedo 0.5 --samples 0", Code::Usage, &["--samples"]),
        ("--albedo 0.5 --quadrature exact", Code::Usage, &["--quadrature"]),
        ("--albedo 0.5 --samples 1 --aov halves", Code::Invalid, &["halves", "--samples 16"]),
        ("--aov depth", Code::Invalid, &["depth", "--albedo"]),
        ("--samples 4", Code::Invalid, &["--samples", "--albedo"]),
        ("--model scattering", Code::Invalid, &["--albedo"]),
    ] {
        work.refused(&format!("{render} {options}"), code, expected);
    }
    assert!(!work.path("out").exists());
    let volume = format!(r#"{{"file": {:?}}}"#, fixture("plume.vdb"));
    for (scene, code, expected) in [
        ("{}", Code::Invalid, &["scene.json", "volumes", "cumulo schema scene"][..]),
        (r#"{"volumes": []}"#, Code::Invalid, &["at least one"]),
        (r#"{"volumes": [{"file": "none.vdb"}]}"#, Code::NotFound, &["none.vdb"]),
        (r#"{"volumes": [{"file": "a.vdb", "colour": 1}]}"#, Code::Invalid, &["colour"]),
        (
            &format!(r#"{{"volumes": [{volume}], "lights": [{{"type": "Lamp"}}]}}"#),
            Code::Invalid,
            &["Lamp", "DistantLight"],
        ),
        (
            &format!(
                r#"{{"volumes": [{volume}], "lights": [{{"type": "SphereLight", "centre": [0, 0, 0], "radius": 0, "radiance": [1, 1, 1]}}]}}"#
            ),
            Code::Invalid,
            &["light 0", "radius"],
        ),
        (
            &format!(r#"{{"volumes": [{volume}], "lights": [{{"type": "DomeLight", "radiance": [-1, 0, 0]}}]}}"#),
            Code::Invalid,
            &["DomeLight"],
        ),
        (
            &format!(r#"{{"volumes": [{}, "medium": {{"albedo": [2, 0, 0]}}}}]}}"#, volume.trim_end_matches('}')),
            Code::Invalid,
            &["volume 0", "albedo"],
        ),
        (
            &format!(
                r#"{{"volumes": [{}, "transform": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1]]}}]}}"#,
                volume.trim_end_matches('}')
            ),
            Code::Invalid,
            &["scene.json", "volume 0", "transform is singular"],
        ),
        (
            &format!(
                r#"{{"volumes": [{}, "transform": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 1, 1]]}}]}}"#,
                volume.trim_end_matches('}')
            ),
            Code::Unsupported,
            &["volume 0", "perspective"],
        ),
    ] {
        std::fs::write(work.path("scene.json"), scene).unwrap();
        work.refused("render scene.json --views 1 --size 8x8 -o out", code, expected);
    }
    for (medium, code, expected) in [
        (r#"{"emission_grid": {"grid": "flame"}}"#, Code::NoSuchGrid, &["flame", "density"][..]),
        (r#"{"blackbody": {}}"#, Code::NoSuchGrid, &["temperature"]),
        (r#"{"blackbody": {"grid": "density", "kelvin": -1}}"#, Code::Invalid, &["volume 0", "-1 K"]),
        (
            r#"{"emission": [1, 0, 0], "emission_grid": {"grid": "density"}}"#,
            Code::Unsupported,
            &["plume.vdb", "leave 'emission'"],
        ),
        (r#"{"extinction_color": [0, 0, 0]}"#, Code::Invalid, &["volume 0", "extinction color"]),
    ] {
        let volume = volume.trim_end_matches('}');
        let scene = format!(r#"{{"volumes": [{volume}, "medium": {medium}}}]}}"#);
        std::fs::write(work.path("scene.json"), scene).unwrap();
        work.refused("render scene.json --views 1 --size 8x8 -o out", code, expected);
    }
    std::fs::write(work.path("scene.json"), format!(r#"{{"volumes": [{volume}]}}"#)).unwrap();
    for (option, name) in
        [("--albedo 0.5", "--albedo"), ("--density-scale 2", "--density-scale"), ("--grid density", "--grid")]
    {
        work.refused(
            &format!("render scene.json --views 1 --size 8x8 -o out {option}"),
            Code::Invalid,
            &[name, "states its own media"],
        );
    }
    work.refused("info scene.json", Code::Invalid, &["scene file", "cumulo render"]);
    // No function tells scattered light.
    work.json(&format!("render @plume.vdb --views 4 --size 8x8 --samples 2 {LIT} -o lit"));
    work.refused("reconstruct tf lit --volume @plume.vdb -o found.tf.json", Code::Unsupported, &["scattered light"]);
}

/// Alpha over a colored extinction is a mean of transmittances, and was taken for one; a function was fitted to
/// scattered light.
#[test]
fn what_alpha_and_functions_do_not_tell_is_refused() {
    let work = Work::new();
    let render = |what: &str, words: &str| {
        work.json(&format!("render {what} --views 4 --size 8x8 --samples 2 {words}"));
    };
    render("@plume.vdb", &format!("{LIT} --extinction-color 1,0.5,0.25 -o colored"));
    let scene = serde_json::json!({
        "volumes": [{"file": fixture("plume.vdb"), "medium": {
            "albedo": [0.9, 0.9, 0.9], "extinction_color": [1, 0.5, 0.25]}}],
        "lights": [{"type": "DomeLight", "radiance": [1, 1, 1]}],
    });
    std::fs::write(work.path("scene.json"), scene.to_string()).unwrap();
    render("scene.json", "-o staged");
    for capture in ["colored", "staged"] {
        for what in ["density", "color"] {
            work.refused(
                &format!("reconstruct {what} {capture} -o found.vdb"),
                Code::Unsupported,
                &[
                    format!("{capture}/transforms.json").as_str(),
                    "differs by channel",
                    "one extinction",
                    "--extinction-color",
                ],
            );
        }
    }
    render("@plume.vdb", &format!("{LIT} --extinction-color 0.5,0.5,0.5 -o grey"));
    work.refused(
        "reconstruct density grey --tf turbo -o found.vdb",
        Code::Unsupported,
        &["grey/transforms.json", "scattered light", "a transfer function tells", "without --tf"],
    );
    assert!(!work.path("found.vdb").exists());
}

/// Cameras of a lit capture come without its lights, and the options that state them are told.
#[test]
fn lights_of_other_captures_are_told_and_not_taken() {
    let work = Work::new();
    work.json(&format!("render @plume.vdb --views 1 --size 8x8 --samples 1 {LIT} -o lit"));
    let options = "--albedo 0.9 --anisotropy 0.3 --sun 1,1,2 --sun-color 3 --sun-angle 0.53 --sky 0.2,0.3,0.5";
    work.refused("render @plume.vdb --cameras lit -o plain", Code::Invalid, &[options]);
    let remarks = |words: &str| work.json(words)["remarks"].clone();
    let white = remarks("render @plume.vdb --cameras lit --albedo 0.9 --samples 1 -o white");
    assert!(white.to_string().contains(options) && white.to_string().contains("white sky"), "{white}");
    let out = work.command("plan @plume.vdb --cameras lit --albedo 0.9").output().unwrap();
    assert!(errors(&out).contains(options), "{}", errors(&out));
    let same = format!("render @plume.vdb --cameras lit --samples 1 {options} -o same");
    assert!(remarks(&same).is_null());
    let picture = |folder: &str| exr::read_picture(&work.path(&format!("{folder}/view_000.exr")), None).unwrap().rgba;
    assert!(picture("same") == picture("lit") && picture("white") != picture("lit"));
}
