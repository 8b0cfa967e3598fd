//! What OpenUSD's schemas say of prims, where a stage reads otherwise at first sight: purposes, prototypes, bindings,
//! prims without transforms, splines, files of packages, and values of other kinds.

use crate::common::stages::{Stages, open, package};
use crate::common::work::fixture_text;
use cumulo::error::Result;
use cumulo::formats::limits::Limits;
use cumulo::formats::scene_file::LoadedScene;
use cumulo::formats::usd::{Fault, Overrides, Stage, scene};
use cumulo::scene::light::Light;
use glam::{DMat4, DVec3, Vec3};

/// A volume of the cube, named `name` and beneath no other prim, with `more` in it.
fn volume(name: &str, more: &str) -> String {
    format!(
        "def Volume \"{name}\" {{\n rel field:density = <density>\n {more}\n def OpenVDBAsset \"density\" {{\n  token fieldName \
         = \"density\"\n  asset filePath = @{}@\n }}\n}}\n",
        fixture_text("cube.vdb")
    )
}

fn says(fault: &Fault, words: &[&str]) -> bool {
    words.iter().all(|word| fault.to_string().contains(word))
}

fn load(stage: &Stage) -> Result<LoadedScene> {
    scene::load(stage, 0.0, Limits::default(), &Overrides::default())
}

/// The purpose that is stated nearest to a prim is the prim's, `default` as well.
#[test]
fn purposes_are_inherited_until_another_is_stated() {
    let stages = Stages::new();
    let stage = stages.open(
        "def Xform \"guide\" {\n uniform token purpose = \"guide\"\n def Volume \"hidden\" {}\n def Volume \"shown\" {\n uniform \
         token purpose = \"default\"\n }\n}\ndef Volume \"proxy\" {\n uniform token purpose = \"proxy\"\n}\ndef Volume \"final\" {\n \
         uniform token purpose = \"render\"\n}",
    );
    let shown = |path: &str| stage.is_rendered(stage.prim(path).unwrap(), 0.0);
    assert_eq!(
        ["/guide/hidden", "/guide/shown", "/proxy", "/final"].map(shown),
        [false, true, false, true],
        "OpenUSD's ComputePurpose"
    );
}

/// What lies beneath a point instancer is shown by its instances alone, which are not rendered.
#[test]
fn prototypes_are_not_rendered_in_their_own_place() {
    let stages = Stages::new();
    let beneath = volume("puff", "");
    let light = "def SphereLight \"lamp\" {}";
    let stage = stages.open(&format!("{}def PointInstancer \"many\" {{\n{beneath}{light}\n}}", volume("smoke", "")));
    let scene = load(&stage).unwrap();
    assert_eq!((scene.volumes.len(), scene.lights.len()), (1, 0));
    for path in ["/many/puff", "/many/lamp"] {
        assert!(
            scene.remarks.iter().any(|r| r.contains(path) && r.contains("PointInstancer")),
            "{path}: {:?}",
            scene.remarks
        );
    }
    let alone = stages.open(&format!("def PointInstancer \"many\" {{\n{beneath}\n}}"));
    assert!(load(&alone).unwrap_err().to_string().contains("none of the stage's 1 volumes is visible"));
}

/// Prims without a type and scopes have no transform in OpenUSD, whatever their attributes say.
#[test]
fn scopes_are_not_moved() {
    let stages = Stages::new();
    let moved = "double3 xformOp:translate = (5, 0, 0)\n uniform token[] xformOpOrder = [\"xformOp:translate\"]";
    for (kind, expected) in [("Scope", 0.0), ("", 0.0), ("Xform", 5.0)] {
        let stage = stages.open(&format!("def {kind} \"a\" {{\n {moved}\n def Volume \"b\" {{}}\n}}"));
        let map = stage.local_to_world(stage.prim("/a/b").unwrap(), 0.0).unwrap();
        assert_eq!(map, DMat4::from_translation(DVec3::new(expected, 0.0, 0.0)), "'{kind}'");
        assert_eq!(stage.faults.iter().any(|f| says(f, &["/a", "xformOpOrder"])), expected == 0.0);
    }
}

/// Prims without a type have no visibility, scopes do.
#[test]
fn prims_without_a_type_hide_nothing() {
    let stages = Stages::new();
    for (kind, expected) in [("", true), ("Scope", false), ("Xform", false)] {
        let stage =
            stages.open(&format!("def {kind} \"a\" {{\n token visibility = \"invisible\"\n def Volume \"b\" {{}}\n}}"));
        assert_eq!(stage.is_rendered(stage.prim("/a/b").unwrap(), 0.0), expected, "'{kind}'");
        assert_eq!(stage.faults.iter().any(|f| says(f, &["/a", "visibility"])), expected, "'{kind}'");
    }
}

/// A curve over time has no value here, which is told: a fallback would be another number.
#[test]
fn splines_are_told() {
    let stages = Stages::new();
    let stage = stages.open(
        "def SphereLight \"l\" {\n float inputs:intensity = 3\n float inputs:intensity.spline = {\n bezier,\n 1: 5; post held,\n }\n}",
    );
    assert!(stage.faults.iter().any(|f| says(f, &["/l.inputs:intensity", "spline"])), "{:?}", stage.faults);
}

/// Two files of one name in different folders of a package, and paths longer than a file's name may be.
#[test]
fn files_of_packages_stay_apart() {
    let stages = Stages::new();
    let long = "f".repeat(120);
    let names = [format!("a/b_c_{long}.vdb"), format!("a_b/c_{long}.vdb"), format!("{long}/{long}/x.vdb")];
    let text = format!(
        "#usda 1.0\ndef \"p\" {{\n asset a = @{}@\n asset b = @{}@\n asset c = @{}@\n}}",
        names[0], names[1], names[2]
    );
    let mut files: Vec<(&str, &[u8])> = vec![("root.usda", text.as_bytes())];
    files.extend(names.iter().map(|name| (name.as_str(), name.as_bytes())));
    std::fs::write(stages.path("p.usdz"), package(&files)).unwrap();
    let stage = open(&stages.path("p.usdz")).unwrap();
    for (name, content) in ["a", "b", "c"].into_iter().zip(&names) {
        let asset = stage.prim("/p").unwrap().value(name, 0.0).unwrap().asset().unwrap().clone();
        assert_eq!(std::fs::read_to_string(stage.file(&asset).unwrap()).unwrap(), *content);
    }
}

/// A medium whose numbers cannot be read is refused: the fallbacks would be another medium.
#[test]
fn attributes_of_another_kind_are_refused() {
    let stages = Stages::new();
    for (attribute, expected) in [
        ("double cumulo:albedo = 0.9", "three numbers"),
        ("color4f cumulo:extinctionColor = (1, 1, 1, 1)", "three numbers"),
        ("string cumulo:densityScale = \"4\"", "a number"),
        ("string cumulo:transfer = \"fire.json\"", "file"),
    ] {
        let stage = stages.open(&volume("smoke", attribute));
        let error = load(&stage).unwrap_err();
        let name = attribute.split(' ').nth(1).unwrap();
        let text = error.to_string();
        assert!(text.contains(name) && text.contains(expected) && text.contains("/smoke"), "{text}");
        assert!(error.remedy().is_some());
    }
}

/// What is bound for full renders goes before all that is bound for any purpose, wherever it stands above.
#[test]
fn materials_for_full_renders_go_first() {
    let stages = Stages::new();
    let material = |name: &str, density: f32| {
        format!(
            "def Material \"{name}\" {{\n token outputs:volume.connect = </{name}/s.outputs:out>\n def Shader \"s\" {{\n uniform token \
             info:id = \"cycles_principled_volume\"\n float inputs:density = {density}\n token outputs:out\n }}\n}}\n"
        )
    };
    let materials = format!("{}{}{}", material("a", 2.0), material("b", 3.0), material("c", 5.0));
    let scale = |above: &str, own: &str| {
        let text = format!("{materials}def Xform \"w\" {{\n {above}\n {}\n}}", volume("smoke", own));
        load(&stages.open(&text)).unwrap().volumes[0].medium.extinction
    };
    let (all, full, preview) =
        ("rel material:binding = </a>", "rel material:binding:full = </b>", "rel material:binding:preview = </c>");
    assert_eq!(scale(all, ""), 2.0);
    assert_eq!(scale("", &format!("{all}\n {full}")), 3.0);
    assert_eq!(scale(full, all), 3.0);
    assert_eq!(scale(all, preview), 2.0);
}

/// Cycles passes the root of the absorption color: σt = c + (1 - c)(1 - √a), of which c is scattered.
#[test]
fn absorption_colors_thin_the_medium() {
    let stages = Stages::new();
    let material = "def Material \"m\" {\n token outputs:volume.connect = </m/s.outputs:out>\n def Shader \"s\" {\n uniform token \
                    info:id = \"cycles_principled_volume\"\n float inputs:density = 2\n color3f inputs:color = (0.5, 0.5, 0.5)\n \
                    color3f inputs:absorption_color = (0.25, 0, 1)\n token outputs:out\n }\n}\n";
    let scene = load(&stages.open(&format!("{}{material}", volume("smoke", "rel material:binding = </m>")))).unwrap();
    let medium = &scene.volumes[0].medium;
    let albedo = medium.scattering.unwrap().albedo;
    // 0.5 + 0.5 · 0.5, 0.5 + 0.5 and 0.5 of 2; all of it scatters 1. Exact in single precision but for thirds.
    for (channel, sigma) in [1.5_f64, 2.0, 1.0].into_iter().enumerate() {
        let found = medium.extinction * f64::from(medium.color[channel]);
        assert!((found - sigma).abs() < 1e-6 && (found * f64::from(albedo[channel]) - 1.0).abs() < 1e-6, "{channel}");
    }
}

/// Lights whose numbers are not read say so, and so do those that are dark.
#[test]
fn inputs_without_effect_are_told() {
    let stages = Stages::new();
    let light = |body: &str| {
        let scene = load(&stages.open(&format!("{}{body}", volume("smoke", "")))).unwrap();
        let remarks: Vec<String> = scene.remarks.into_iter().filter(|r| r.contains("/l")).collect();
        (scene.lights, remarks)
    };
    let (lights, remarks) = light("def SphereLight \"l\" {\n float intensity = 7\n}");
    assert!(remarks.len() == 1 && remarks[0].contains("'inputs:intensity'"), "{remarks:?}");
    assert!(
        matches!(lights[0], Light::Sphere { radiance, .. } if radiance == Vec3::ONE),
        "as OpenUSD has it: {lights:?}"
    );
    let (lights, remarks) = light("def SphereLight \"l\" {\n float intensity = 7\n float inputs:intensity = 7\n}");
    assert!(lights.len() == 1 && remarks.is_empty(), "{remarks:?}");
    let (lights, remarks) = light("def SphereLight \"l\" {\n float inputs:radius = 0\n}");
    assert!(lights.is_empty() && remarks.len() == 1 && remarks[0].contains("radius is 0"), "{lights:?} {remarks:?}");
    let field = "over \"density\" {\n double3 xformOp:translate = (1, 0, 0)\n uniform token[] xformOpOrder = [\"xformOp:translate\"]\n }";
    stages.write("field.usda", &volume("smoke", ""));
    let text = format!("(\n subLayers = [@./field.usda@]\n)\nover \"smoke\" {{\n {field}\n}}");
    let scene = load(&stages.open(&text)).unwrap();
    assert!(
        scene.remarks.iter().any(|r| r.contains("/smoke/density") && r.contains("transform")),
        "{:?}",
        scene.remarks
    );
}

/// Whatever changes above a volume or a light, or in its material, makes another scene at another time.
#[test]
fn scenes_move_with_what_stands_above() {
    let stages = Stages::new();
    let over = |name: &str, kind: &str, body: &str| format!("def {kind} \"{name}\" {{\n {body}\n}}");
    let moving = "double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 2: (1, 0, 0) }\n uniform token[] xformOpOrder = \
                  [\"xformOp:translate\"]";
    let blinking = "token visibility.timeSamples = { 1: \"inherited\", 2: \"invisible\" }";
    let shader = "float inputs:density.timeSamples = { 1: 1, 2: 2 }";
    let smoke = volume("smoke", "");
    for (text, expected) in [
        (smoke.clone(), false),
        (over("rig", "Camera", &format!("{moving}\n {smoke}")), true),
        (over("rig", "SkelRoot", &format!("{moving}\n {smoke}")), true),
        (over("rig", "Scope", &format!("{blinking}\n {smoke}")), true),
        (over("rig", "Camera", &format!("{moving}\n def SphereLight \"l\" {{}}")) + &smoke, true),
        (over("m", "Material", &over("s", "Shader", shader)) + &smoke, true),
        (over("mesh", "Mesh", moving) + &smoke, true),
        // The camera, and surfaces that are not rendered, are no part of the scene.
        (over("c", "Camera", moving) + &over("cube", "Cube", moving) + &smoke, false),
    ] {
        assert_eq!(load(&stages.open(&text)).unwrap().moving, expected, "{text}");
    }
}

/// Whole numbers are held, vectors of them as well.
#[test]
fn whole_numbers_are_held() {
    let stages = Stages::new();
    let stage = stages
        .open("def \"a\" {\n int2 v.timeSamples = { 0: (0, 0), 2: (2, 4) }\n int i.timeSamples = { 0: 0, 2: 2 }\n}");
    let prim = stage.prim("/a").unwrap();
    assert_eq!((prim.tuple::<2>("v", 1.5), prim.number("i", 1.5)), (Some([0.0, 0.0]), Some(0.0)));
}

/// Layers count together: many small ones are not read for ever.
#[test]
fn layers_share_the_memory() {
    let stages = Stages::new();
    let padding = format!("# {}\n", "x".repeat(6000));
    let names: Vec<String> = (0..8).map(|i| format!("l{i}.usda")).collect();
    for name in &names {
        stages.write(name, &format!("{padding}def \"{}\" {{}}", &name[..2]));
    }
    let listed = names.iter().map(|name| format!("@./{name}@")).collect::<Vec<_>>().join(", ");
    let path = stages.write("stage.usda", &format!("(\n subLayers = [{listed}]\n)\ndef \"root\" {{}}"));
    let whole = Stage::open(&path, Limits { max_memory: 1 << 20 }).unwrap();
    assert_eq!((whole.prims().count(), whole.faults.len()), (9, 0), "{:?}", whole.faults);
    // A quarter of 64 KiB holds two of them.
    let cut = Stage::open(&path, Limits { max_memory: 1 << 16 }).unwrap();
    assert!(cut.faults.iter().any(|fault| fault.remedy.contains("`max_memory`")), "{:?}", cut.faults);
    assert!(cut.prims().count() < 9);
}

/// A relationship with two targets names no field in UsdVol.
#[test]
fn fields_have_one_target() {
    let stages = Stages::new();
    let text = volume("smoke", "def OpenVDBAsset \"other\" {}").replace("= <density>", "= [<other>, <density>]");
    let error = load(&stages.open(&text)).unwrap_err().to_string();
    assert!(error.contains("field:density has 2 targets"), "{error}");
}

/// The ending of a package's name counts in capitals as well.
#[test]
fn packages_in_capitals_are_opened() {
    let stages = Stages::new();
    let text = "#usda 1.0\ndef \"p\" {\n asset a = @./x.vdb@\n}";
    std::fs::write(stages.path("P.USDZ"), package(&[("root.usda", text.as_bytes()), ("x.vdb", b"x")])).unwrap();
    let stage = open(&stages.path("P.USDZ")).unwrap();
    let asset = stage.prim("/p").unwrap().value("a", 0.0).unwrap().asset().unwrap().clone();
    assert!(stage.exists(&asset), "{asset:?}");
    assert_eq!(std::fs::read(stage.file(&asset).unwrap()).unwrap(), b"x");
}
