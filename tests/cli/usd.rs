//! USD stages on the command line: `info`, `validate`, `plan`, `render` by a stage's cameras, and stages as captures.

use crate::common::stages::{binary, package};
use crate::common::work::{Work, errors, fixture};
use cumulo::error::Code;
use cumulo::formats::limits::Limits;
use cumulo::formats::usd::Stage;
use serde_json::{Value, json};

const CAMERA: &str = "def Xform \"rig\" {\n double3 xformOp:translate.timeSamples = { 1: (1, 1, 5), 3: (1, 1, 9) }\n uniform token[] \
                      xformOpOrder = [\"xformOp:translate\"]\n def Camera \"camera\" {\n float horizontalAperture = 36\n float \
                      verticalAperture = 27\n float2 clippingRange = (0.1, 100)\n }\n}\n";

/// A volume of the plume at frame 1 and 3, and of the cube at frame 2, in light.
fn stage(more: &str) -> String {
    format!(
        "#usda 1.0\n(\n upAxis = \"Z\"\n metersPerUnit = 1\n startTimeCode = 1\n endTimeCode = 3\n)\ndef Volume \"smoke\" {{\n rel \
         field:density = </smoke/density>\n custom double cumulo:densityScale = 4\n custom color3f cumulo:albedo = (0.9, 0.9, \
         0.9)\n custom double cumulo:anisotropy = 0.25\n double3 xformOp:translate = (0, 0, 1)\n uniform token[] xformOpOrder = \
         [\"xformOp:translate\"]\n def OpenVDBAsset \"density\" {{\n  token fieldName = \"density\"\n  asset filePath.timeSamples = {{ 1: \
         @./plume.vdb@, 2: @./cube.vdb@, 3: @./plume.vdb@ }}\n }}\n}}\ndef DistantLight \"sun\" {{\n float inputs:intensity = 3\n float \
         inputs:angle = 0.5\n bool inputs:normalize = 1\n double xformOp:rotateX = 90\n uniform token[] xformOpOrder = \
         [\"xformOp:rotateX\"]\n}}\ndef DomeLight \"sky\" {{\n color3f inputs:color = (0.25, 0.5, 0.75)\n}}\n{CAMERA}{more}"
    )
}

fn work(text: &str) -> Work {
    let work = Work::new();
    for name in ["plume.vdb", "cube.vdb"] {
        std::fs::copy(fixture(name), work.path(name)).unwrap();
    }
    std::fs::write(work.path("stage.usda"), text).unwrap();
    work
}

/// A stage gives the pictures of the scene file that says the same, at every frame.
#[test]
fn stages_are_rendered_as_scene_files_are() {
    let work = work(&stage(""));
    let options = "--size 16x12 --samples 4";
    let report = work.json(&format!("render stage.usda {options} --frames 1-3 -o one"));
    assert_eq!((&report["rendered"], &report["failed"]), (&json!(3), &json!([])));
    let cameras: Value = serde_json::from_slice(&std::fs::read(work.path("one/transforms.json")).unwrap()).unwrap();
    let z = |frame: usize| cameras["frames"][frame]["transform_matrix"][2][3].as_f64().unwrap();
    assert_eq!([z(0), z(1), z(2)], [5.0, 7.0, 9.0]);
    // Without the move, the same as a scene file with the cameras of the stage.
    let text = stage("").replace("double3 xformOp:translate = (0, 0, 1)", "double3 xformOp:translate = (0, 0, 0)");
    std::fs::write(work.path("still.usda"), text).unwrap();
    work.json(&format!("render still.usda {options} --frames 1-2 -o still"));
    let medium = json!({"density_scale": 4, "albedo": [0.9, 0.9, 0.9], "anisotropy": 0.25});
    let scene = |vdb: &str| {
        json!({"volumes": [{"file": vdb, "medium": medium}], "lights": [
            {"type": "DistantLight", "direction": [0, -1, 0], "irradiance": [3, 3, 3], "angle": 0.5},
            {"type": "DomeLight", "radiance": [0.25, 0.5, 0.75]}]})
    };
    for (number, vdb) in [(1, "plume.vdb"), (2, "cube.vdb")] {
        std::fs::write(work.path("scene.json"), scene(vdb).to_string()).unwrap();
        work.json(&format!("render scene.json --cameras still --frames {number} --samples 4 -o scene{number}"));
        let name = format!("frame.{number:04}.exr");
        let (a, b) = (work.picture(&format!("still/{name}")), work.picture(&format!("scene{number}/{name}")));
        // The direction of the sun is off by the rounding of a turn by 90 degrees.
        let apart =
            a.rgba.iter().flatten().zip(b.rgba.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(apart < 1e-4, "{name}: {apart}");
        assert_ne!(a, work.picture(&format!("one/{name}")), "the volume has moved");
    }
    // The first time code without --frames; a size by the aperture; binaries and packages alike.
    work.json("render stage.usda --samples 4 --size 16x12 -o first");
    // Frames have noise of their own.
    let covered = |name: &str| work.picture(name).rgba.iter().map(|pixel| pixel[3]).sum::<f32>();
    let (first, one) = (covered("first/view_000.exr"), covered("one/frame.0001.exr"));
    assert!(one > 20.0 && (first - one).abs() < 0.03 * one, "{first} {one}");
    let body = stage("").replace("#usda 1.0\n", "").replace(
        "asset filePath.timeSamples = { 1: @./plume.vdb@, 2: @./cube.vdb@, 3: @./plume.vdb@ }",
        "asset filePath = @./plume.vdb@",
    );
    std::fs::write(work.path("stage.usdc"), binary(&body)).unwrap();
    let vdb = std::fs::read(fixture("plume.vdb")).unwrap();
    std::fs::write(work.path("stage.usdz"), package(&[("root.usdc", &binary(&body)), ("plume.vdb", &vdb)])).unwrap();
    for name in ["stage.usdc", "stage.usdz"] {
        work.json(&format!("render {name} --samples 4 --size 16x12 --overwrite -o again"));
        assert_eq!(work.picture("again/view_000.exr"), work.picture("first/view_000.exr"), "{name}");
    }
    let report = work.json("plan stage.usda --size 16x12 --samples 4 --frame 2");
    assert_eq!((&report["views"], &report["size"]), (&json!(1), &json!([16, 12])));
    let sized = work.json("plan stage.usda --samples 1");
    assert_eq!(sized["size"], json!([256, 192]));
}

#[test]
fn info_lists_what_a_stage_holds() {
    let work = work(&stage("def DiskLight \"disk\" {}\ndef Cube \"table\" {}\n"));
    std::fs::remove_file(work.path("cube.vdb")).unwrap();
    let found = &work.json("info stage.usda")["files"][0];
    assert_eq!(
        (&found["format"], &found["up_axis"], &found["meters_per_unit"]),
        (&json!("usd"), &json!("Z"), &json!(1.0))
    );
    let volume = &found["volumes"][0];
    assert_eq!(volume["local_to_world"][2], json!([0.0, 0.0, 1.0, 1.0]));
    let field = &volume["fields"][0];
    assert_eq!((&field["role"], &field["samples"], &field["missing"]), (&json!("density"), &json!(3), &json!(1)));
    assert_eq!(field["missing_files"], json!(["./cube.vdb"]));
    assert_eq!(found["cameras"][0]["path"], "/rig/camera");
    assert_eq!(found["lights"].as_array().unwrap().len(), 3);
    let remarks = found["remarks"].as_array().unwrap();
    assert!(remarks.len() == 2 && remarks[0].as_str().unwrap().contains("/disk"), "{remarks:?}");
    let text = work.text("info stage.usda");
    for line in [
        "up: Z, meters per unit: 1",
        "time codes: 1 to 3",
        "volume /smoke",
        "missing: 1 file(s): ./cube.vdb",
        "camera /rig/camera",
    ] {
        assert!(text.contains(line), "{line}: {text}");
    }
    let out = work.command("validate stage.usda --json").output().unwrap();
    let report: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(out.status.code(), Some(1));
    let findings = report["files"][0]["findings"].as_array().unwrap();
    assert!(findings.len() == 1 && findings[0]["part"] == "prim /smoke/density", "{findings:?}");
    // A frame whose file is missing fails; the others are there.
    let out = work.command("render stage.usda --size 8x6 --samples 1 --frames 1-3 -o some").output().unwrap();
    assert!(out.status.code() == Some(2) && errors(&out).contains("cube.vdb"), "{}", errors(&out));
    assert!(errors(&out).contains("remark: light /disk is left out") && work.path("some/frame.0003.exr").exists());
}

/// The cameras of a stage for another volume, and with pictures as a capture for every command.
#[test]
fn stages_are_captures() {
    let work = work(&stage(""));
    let report = work.json("render plume.vdb --cameras stage.usda --size 16x12 --density-scale 4 -o shots");
    assert_eq!(report["views"], 3);
    for view in 0..3 {
        std::fs::copy(work.path(&format!("shots/view_00{view}.exr")), work.path(&format!("stage.000{}.exr", view + 1)))
            .unwrap();
    }
    // Pictures beside the stage, by their names.
    work.json("reconstruct density stage.usda --resolution 8 --iterations 2 -o found.vdb");
    work.json("capture convert stage.usda --pictures shots/view_###.exr -o capture");
    let of = |name: &str| -> Value { serde_json::from_slice(&std::fs::read(work.path(name)).unwrap()).unwrap() };
    let (converted, shots) = (of("capture/transforms.json"), of("shots/transforms.json"));
    for frame in 0..3 {
        assert_eq!(converted["frames"][frame]["transform_matrix"], shots["frames"][frame]["transform_matrix"]);
    }
    assert_eq!((&converted["w"], &converted["fl_x"]), (&shots["w"], &shots["fl_x"]));
}

#[test]
fn what_contradicts_is_refused() {
    let work = work(&stage("def Camera \"second\" {}\n"));
    work.refused("render stage.usda -o x", Code::Invalid, &["/rig/camera, /second", "--camera"]);
    work.refused("render stage.usda --camera /none -o x", Code::Invalid, &["/none", "/second"]);
    work.refused(
        "render stage.usda --camera second --sun 1,1,1 --albedo 0.5 -o x",
        Code::Invalid,
        &["--sun", "stage.usda"],
    );
    work.refused("render stage.usda --camera second --density-scale auto -o x", Code::Invalid, &["auto", "stage.usda"]);
    work.refused("render plume.vdb --views 1 --camera second -o x", Code::Usage, &["--views", "--camera"]);
    work.refused("render plume.vdb -o x", Code::Invalid, &["--views", "required"]);
    work.refused("render plume.vdb --cameras stage.usda -o x", Code::Invalid, &["/second"]);
    work.refused("capture convert plume.vdb --camera a -o x", Code::Invalid, &["--camera"]);
    std::fs::write(work.path("none.usda"), "#usda 1.0\ndef Camera \"c\" {}\n").unwrap();
    work.refused("render none.usda -o x", Code::Invalid, &["none.usda", "no prim of type Volume"]);
    std::fs::write(work.path("bad.usda"), "#usda 1.0\ndef Volume \"v\" {\n float x = (1\n}\n").unwrap();
    for command in ["info bad.usda", "render bad.usda -o x", "plan bad.usda"] {
        work.refused(command, Code::Invalid, &["bad.usda", "line 3"]);
    }
    let out = work.command("validate bad.usda").output().unwrap();
    assert_eq!(out.status.code(), Some(1), "{}", errors(&out));
}

/// Files that an arc may lead to and that are no layer, with what is said of each.
fn no_layers(work: &Work) -> Vec<(String, &'static str)> {
    std::fs::create_dir_all(work.path("folder.usda")).unwrap();
    let write = |name: &str, bytes: &[u8]| std::fs::write(work.path(name), bytes).unwrap();
    write("text.geom", b"#usda 1.0\ndef Xform \"World\" {}\n");
    write("text.txt", b"smoke");
    write("binary.usdc", b"no layer");
    write("broken.usda", b"#usda 1.0\ndef Xform \"World\" {");
    write("broken.usdz", b"PK");
    write("inner.usdz", &package(&[("picture.png", b"x")]));
    assert!(std::process::Command::new("mkfifo").arg(work.path("pipe.usda")).status().unwrap().success());
    assert!(std::process::Command::new("mkfifo").arg(work.path("pipe.usdz")).status().unwrap().success());
    let all = [
        ("./text.geom", "has no layer's name"),
        ("./text.txt", "is a file of no known kind, not a USD layer"),
        ("./plume.vdb", "is an OpenVDB file, not a USD layer"),
        ("./binary.usdc", "cannot be read"),
        ("./broken.usda", "no valid USD"),
        ("./broken.usdz", "no valid package"),
        ("./inner.usdz", "'picture.png', is no layer"),
        ("./folder.usda", "this is a folder"),
        (".", "this is a folder"),
        ("./pipe.usda", "a pipe (FIFO)"),
        ("./pipe.usdz", "a pipe (FIFO)"),
        ("./pipe.usdz[a.usda]", "a pipe (FIFO)"),
        ("/dev/null", "a device"),
        ("/dev/zero", "a device"),
        ("./gone.usda", "does not exist"),
        ("./gone.usdz[a.usda]", "does not exist"),
    ];
    all.map(|(path, what)| (path.to_owned(), what)).into()
}

/// What a layer that cannot be read holds is missing from a picture: no command takes such a stage for a whole one.
#[test]
fn layers_that_are_none_are_named() {
    let work = work(&stage(""));
    let inner = "def Xform \"m\" (references = @PATH@</World>) {}";
    let arcs = [
        ("prim /m: its reference", inner.to_owned()),
        ("prim /m: its payload", inner.replace("references", "payload")),
        ("its sublayer", String::new()),
        // By a layer of another folder, and in the variant that is chosen.
        ("layer sub/middle.usda: prim /m: its reference", "def \"m\" (references = @./sub/middle.usda@</m>) {}".into()),
        (
            "prim /m: its reference",
            "def Xform \"m\" (\n variants = { string v = \"a\" }\n prepend variantSets = \"v\"\n) {\n variantSet \"v\" = {\n \"a\" \
             (references = @PATH@</World>) {}\n \"b\" {}\n }\n}"
                .into(),
        ),
    ];
    std::fs::create_dir(work.path("sub")).unwrap();
    for (path, what) in no_layers(&work) {
        let above = path.strip_prefix("./").map_or_else(|| path.clone(), |path| format!("../{path}"));
        let above = if path == "." { "..".to_owned() } else { above };
        std::fs::write(work.path("sub/middle.usda"), format!("#usda 1.0\n{}", inner.replace("PATH", &above))).unwrap();
        for (place, arc) in &arcs {
            let mut text = stage(&arc.replace("PATH", &path));
            if arc.is_empty() {
                text = text.replacen("(\n", &format!("(\n subLayers = [@{path}@]\n"), 1);
            }
            std::fs::write(work.path("stage.usda"), text).unwrap();
            let opened = Stage::open(&work.path("stage.usda"), Limits::default()).unwrap();
            let error = opened.whole().unwrap_err().to_string();
            for word in ["stage.usda: ", place, what] {
                assert!(error.contains(word), "{path} as {place}: '{word}' is not in: {error}");
            }
            assert_eq!(error.lines().count(), 2, "{error}");
        }
    }
}

/// Every command tells of a layer that is none, and so do packages; layers that are not needed are not looked for.
#[test]
fn every_command_tells_of_layers_that_are_none() {
    let work = work(&stage("def Xform \"m\" (payload = @./plume.vdb@</World>) {}"));
    let words = ["stage.usda", "/m", "its payload @plume.vdb@ is an OpenVDB file"];
    for command in [
        "plan stage.usda --size 8x6",
        "render stage.usda --size 8x6 --samples 1 -o x",
        "render stage.usda --size 8x6 --samples 1 --frames 1-2 -o x",
        "render plume.vdb --cameras stage.usda --size 8x6 -o x",
        "render stage.usda --views 1 --size 8x6 --samples 1 -o x",
    ] {
        work.refused(command, Code::Invalid, &words);
        assert!(!work.path("x").exists(), "{command}");
    }
    for (command, code) in [("validate", 1), ("usd lint", 1), ("info", 2)] {
        let out = work.command(&format!("{command} stage.usda --json")).output().unwrap();
        let report = String::from_utf8(out.stdout.clone()).unwrap();
        assert_eq!(out.status.code(), Some(code), "{command}: {report}");
        assert!(report.contains(words[2]), "{command}: {report}");
    }
    let found: Value =
        serde_json::from_slice(&work.command("info stage.usda --json").output().unwrap().stdout).unwrap();
    assert_eq!(found["files"][0]["volumes"].as_array().unwrap().len(), 1, "what is there is shown");

    let root = "#usda 1.0\ndef Xform \"m\" (references = @./a.vdb@</World>) {}\ndef \"n\" (references = @./gone.usda@</World>) {}";
    std::fs::write(work.path("p.usdz"), package(&[("root.usda", root.as_bytes()), ("a.vdb", b"x")])).unwrap();
    let out = work.command("validate p.usdz").output().unwrap();
    let text = String::from_utf8(out.stdout).unwrap();
    for word in ["@p.usdz[a.vdb]@ is no USD layer", "@p.usdz[gone.usda]@ does not exist"] {
        assert!(out.status.code() == Some(1) && text.contains(word), "{text}");
    }
    // Layers of prims that are not active, and of variants that are not chosen, are not needed.
    let spare = "def \"off\" (\n active = false\n references = @./plume.vdb@</World>\n) {}\ndef Xform \"v\" (\n variants = { string v = \"b\" \
                 }\n prepend variantSets = \"v\"\n) {\n variantSet \"v\" = {\n \"a\" (references = @./plume.vdb@</World>) {}\n \"b\" {}\n }\n}";
    std::fs::write(work.path("spare.usda"), stage(spare)).unwrap();
    work.json("plan spare.usda --size 8x6 --samples 1");
    assert_eq!(work.command("validate spare.usda").output().unwrap().status.code(), Some(0));
}

/// Packages are referenced, and layers within them.
#[test]
fn packages_are_referenced() {
    let work = work(&stage(""));
    let vdb = std::fs::read(fixture("cube.vdb")).unwrap();
    let body = "#usda 1.0\n(\n defaultPrim = \"puff\"\n)\ndef Volume \"puff\" {\n rel field:density = </puff/density>\n def OpenVDBAsset \
                \"density\" {\n  token fieldName = \"density\"\n  asset filePath = @./cube.vdb@\n }\n}\n";
    std::fs::write(work.path("p.usdz"), package(&[("root.usda", body.as_bytes()), ("cube.vdb", &vdb)])).unwrap();
    for path in ["./p.usdz", "./p.usdz[root.usda]"] {
        let text = stage(&format!("def \"packed\" (references = @{path}@) {{}}\n"));
        std::fs::write(work.path("stage.usda"), text).unwrap();
        let found = &work.json("info stage.usda")["files"][0];
        assert_eq!(found["volumes"].as_array().unwrap().len(), 2, "{path}: {found}");
        work.json("render stage.usda --size 8x6 --samples 1 --overwrite -o x");
    }
}

/// A file in a package is named by the package and its path there, whatever is wrong with it.
#[test]
fn files_in_packages_are_named() {
    let work = Work::new();
    let text = |more: &str| {
        format!(
            "#usda 1.0\ndef Volume \"v\" {{\n rel field:density = </v/density>\n {more}\n def OpenVDBAsset \"density\" {{\n token fieldName = \
             \"density\"\n asset filePath = @./bad.vdb@\n }}\n}}\ndef DomeLight \"sky\" {{\n asset inputs:texture:file = \
             @./sky.exr@\n}}\ndef Camera \"c\" {{}}\n"
        )
    };
    let cube = std::fs::read(fixture("cube.vdb")).unwrap();
    let other = std::fs::read(fixture("sphere_level_set.vdb")).unwrap();
    let transfer = "asset cumulo:transfer = @./f.tf.json@";
    for (more, vdb, named) in [
        ("", &b"x"[..], "p.usdz[bad.vdb]"),
        // A file of another grid, and one that is cut short.
        ("", &other, "p.usdz[bad.vdb]"),
        ("", &cube[..cube.len() / 2], "p.usdz[bad.vdb]"),
        ("", &cube, "p.usdz[sky.exr]"),
        (transfer, &cube, "p.usdz[f.tf.json]"),
    ] {
        let root = text(more);
        let files: [(&str, &[u8]); 4] =
            [("root.usda", root.as_bytes()), ("bad.vdb", vdb), ("sky.exr", b"x"), ("f.tf.json", b"x")];
        std::fs::write(work.path("p.usdz"), package(&files)).unwrap();
        let commands = ["render p.usdz --size 8x6 --samples 1 -o x", "plan p.usdz --size 8x6", "usd lint p.usdz"];
        for command in commands {
            let out = work.command(command).output().unwrap();
            let said = format!("{}{}", errors(&out), String::from_utf8_lossy(&out.stdout));
            assert!(!said.contains("/.cumulo-") && !said.contains("/tmp/.") && out.status.code() != Some(0), "{said}");
            // Lint looks at volumes alone.
            if !command.contains("lint") || named.contains("vdb") {
                assert!(said.contains(named), "{command}: '{named}' is not in: {said}");
            }
        }
    }
}

/// The scale that is reported is the one that the stage or the scene file states.
#[test]
fn density_scales_are_those_of_the_media() {
    let work = work(&stage("").replace("cumulo:densityScale = 4", "cumulo:densityScale = 0.08"));
    let options = "--size 8x6 --samples 1";
    assert_eq!(work.json(&format!("render stage.usda {options} -o a"))["density_scale"], json!(0.08));
    let text = work.text(&format!("render stage.usda {options} --overwrite -o a"));
    assert!(text.contains("density scale 0.08"), "{text}");
    let text = work.text(&format!("render stage.usda {options} --frames 1-2 -o frames"));
    assert!(text.contains("density scale 0.08"), "{text}");
    let stated: Value = serde_json::from_slice(&std::fs::read(work.path("frames/transforms.json")).unwrap()).unwrap();
    assert_eq!(stated["density_scale"], json!(0.08));
    let text = work.text(&format!("render stage.usda {options} --density-scale 3 -o b"));
    assert!(text.contains("density scale 3"), "{text}");
    let medium = |scale: f64| json!({"file": "plume.vdb", "medium": {"density_scale": scale}});
    let scene = json!({"volumes": [medium(0.08), medium(2.5)]});
    std::fs::write(work.path("scene.json"), scene.to_string()).unwrap();
    let report = work.json(&format!("render scene.json --views 1 {options} -o c"));
    assert_eq!((&report["density_scale"], &report["density_scales"]), (&Value::Null, &json!([0.08, 2.5])));
    let text = work.text(&format!("render scene.json --cameras frames {options} --frames 1-2 -o d"));
    assert!(text.contains("density scales 0.08, 2.5"), "{text}");
}

/// What prims inherit is followed where the composition can, through instances as well, and refused where it would not end.
#[test]
fn what_prims_inherit_ends() {
    let work = work("");
    let asset = "#usda 1.0\ndef Xform \"World\" {\n def Scope \"s\" {}\n def \"t\" (inherits = </World/_c>) {}\n class \"_c\" {\n def \"u\" {}\n }\n}\n";
    std::fs::write(work.path("asset.usda"), asset).unwrap();
    let paths = |text: &str| {
        std::fs::write(work.path("stage.usda"), format!("#usda 1.0\n{text}")).unwrap();
        Stage::open(&work.path("stage.usda"), Limits::default())
            .map(|stage| stage.prims().map(|prim| prim.path.clone()).collect::<Vec<String>>().join(" "))
    };
    for (text, expected) in [
        ("class \"_c\" (references = @asset.usda@</World>) {}\ndef \"m\" (inherits = </_c>) {}", "/m /m/s /m/t /m/t/u"),
        (
            "class \"_c\" {\n def \"v\" {}\n}\ndef \"m\" (instanceable = true\n inherits = </_c>\n references = @asset.usda@</World>) {}",
            "/m /m/v /m/s /m/t /m/t/u",
        ),
        (
            "def \"World\" {\n class \"_c\" {}\n def \"m\" (instanceable = true\n inherits = </World/_c>\n references = @asset.usda@</World>) {}\n}",
            "/World /World/m /World/m/s /World/m/t /World/m/t/u",
        ),
        (
            "class \"_a\" {\n def \"v\" {}\n}\nclass \"_b\" (inherits = </_a>) {}\ndef \"m\" (inherits = [</_b>, </_a>]) {}\ndef \"n\" (specializes = </m>) {}",
            "/m /m/v /n /n/v",
        ),
    ] {
        let mut found: Vec<String> = paths(text).unwrap().split(' ').map(str::to_owned).collect();
        let mut expected: Vec<&str> = expected.split(' ').collect();
        found.sort();
        expected.sort_unstable();
        assert_eq!(found, expected, "{text}");
    }
    let chain: String = (0..5000).map(|i| format!("class \"_{i}\" (inherits = </_{}>) {{}}\n", i + 1)).collect();
    let lattice: String = (0..60)
        .flat_map(|i| ["a", "b"].map(|k| format!("class \"_{k}{i}\" (inherits = [</_a{0}>, </_b{0}>]) {{}}\n", i + 1)))
        .collect();
    for text in [
        "def \"World\" {\n class \"_c\" {}\n def \"m\" (inherits = </World/_c>\n references = @asset.usda@</World>) {}\n}".to_owned(),
        "def \"World\" {\n class \"_c\" (references = @asset.usda@</World>) {}\n def \"m\" (inherits = </World/_c>) {}\n}".to_owned(),
        "def \"A\" (inherits = </B>) {}\ndef \"B\" (inherits = </A>) {}\ndef \"C\" (inherits = </A>) {}".to_owned(),
        "def \"A\" (inherits = </A/c>) {\n class \"c\" {}\n def \"d\" {}\n}".to_owned(),
        format!("{chain}def \"m\" (inherits = </_0>) {{}}"),
        format!("{lattice}def \"m\" (inherits = </_a0>) {{}}"),
    ] {
        let error = paths(&text).unwrap_err().to_string();
        assert!(error.contains("stage.usda: prim /") && error.contains("inherits"), "{error}");
    }
}

/// References and payloads to prims that their layers lack are errors; those to prims that arcs of other layers make are none.
#[test]
fn prims_that_are_named_must_be_there() {
    let work = work("");
    std::fs::write(work.path("asset.usda"), "#usda 1.0\ndef \"World\" {\n def Scope \"s\" {}\n}\n").unwrap();
    std::fs::write(work.path("over.usda"), "#usda 1.0\n(\n subLayers = [@asset.usda@]\n)\n").unwrap();
    let outer = "#usda 1.0\ndef \"Outer\" (references = @asset.usda@</World>) {}\n";
    std::fs::write(work.path("outer.usda"), outer).unwrap();
    for (arc, fault) in [
        ("references = @asset.usda@</World>", None),
        ("references = @over.usda@</World>", None),
        ("references = @outer.usda@</Outer/s>", None),
        ("references = @asset.usda@</Nope>", Some("its reference leads to </Nope> of @asset.usda@")),
        ("references = @asset.usda@</World/x>", Some("its reference leads to </World/x> of @asset.usda@")),
        ("payload = @asset.usda@</World/x>", Some("its payload leads to </World/x> of @asset.usda@")),
        ("payload = @over.usda@</Nope>", Some("its payload leads to </Nope> of @over.usda@")),
    ] {
        std::fs::write(work.path("stage.usda"), format!("#usda 1.0\ndef \"m\" ({arc}) {{}}\n")).unwrap();
        let stage = Stage::open(&work.path("stage.usda"), Limits::default()).unwrap();
        match (stage.whole(), fault) {
            (Ok(()), None) => {}
            (Err(error), Some(fault)) => {
                let error = error.to_string();
                assert!(error.contains(fault) && error.contains("prim /m"), "{arc}: {error}");
            }
            (found, _) => panic!("{arc}: {found:?}"),
        }
    }
}
