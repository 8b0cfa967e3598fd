//! `cumulo usd lint`: planted faults are found, and nothing else on stages that are fine.

use crate::common::work::{Work, errors, fixture};
use cumulo::error::Code;
use serde_json::Value;
use std::fs;

/// Lints a stage: exit code, and the ids of problems and notes.
fn lint(work: &Work, words: &str) -> (i32, Vec<String>, Vec<String>) {
    let out = work.command(&format!("usd lint {words} --json")).output().unwrap();
    assert!(!out.stdout.is_empty(), "{words}: {}", errors(&out));
    let report: Value = serde_json::from_slice(&out.stdout).unwrap();
    let ids = |severity: &str| {
        let findings = report["stages"][0]["findings"].as_array().unwrap().iter();
        let of = findings.filter(|f| f["severity"] == severity && f["fixed"] == false);
        of.map(|f| f["id"].as_str().unwrap().to_owned()).collect()
    };
    (out.status.code().unwrap(), ids("problem"), ids("note"))
}

fn sequence(work: &Work) {
    for (number, from) in [(1, "plume.vdb"), (2, "cube.vdb"), (3, "slab.vdb")] {
        fs::copy(fixture(from), work.path(&format!("smoke.{number:04}.vdb"))).unwrap();
    }
    fs::copy(fixture("kinds.vdb"), work.path("kinds.vdb")).unwrap();
    work.json("usd author smoke.####.vdb -o moving.usda");
    work.json("usd author kinds.vdb -o still.usda");
}

#[test]
fn authored_stages_are_clean() {
    let work = Work::new();
    sequence(&work);
    for stage in ["moving.usda", "still.usda"] {
        assert_eq!(lint(&work, stage), (0, vec![], vec![]), "{stage}");
    }
    for renderer in ["arnold", "cycles", "materialx"] {
        let light = "--albedo 0.9 --emission 1 --sun 1,1,1 --sky 0.2";
        work.json(&format!("usd author smoke.0001.vdb {light} --renderer {renderer} -o {renderer}.usda"));
        assert_eq!(lint(&work, &format!("{renderer}.usda")), (0, vec![], vec![]), "{renderer}");
    }
    let text = work.text("usd lint moving.usda still.usda");
    assert_eq!(text.matches("clean").count(), 2, "{text}");
}

/// A stage laid out as Blender's exporter does: no fieldIndex, no fieldDataType, no framesPerSecond.
#[test]
fn stages_as_blender_writes_them_are_clean() {
    let work = Work::new();
    sequence(&work);
    let stage = r#"#usda 1.0
(
    defaultPrim = "root"
    doc = "Blender v5.0.1"
    endTimeCode = 3
    metersPerUnit = 1
    startTimeCode = 1
    timeCodesPerSecond = 24
    upAxis = "Z"
)

def Xform "root"
{
    def Xform "smoke_0001"
    {
        custom string userProperties:blender:object_name = "smoke.0001"

        def Volume "smoke_0001"
        {
            float3[] extent = [(0.3125, 0.3125, -0.020833334), (1.9791666, 1.9791666, 1.9791666)]
            float3[] extent.timeSamples = {
                1: [(0.3125, 0.3125, -0.020833334), (1.9791666, 1.9791666, 1.9791666)],
                2: [(-0.0625, -0.0625, -0.0625), (1.9375, 1.9375, 1.9375)],
                3: [(-2.45, -2.45, -0.85), (2.35, 2.35, 0.75)],
            }
            custom rel field:density = </root/smoke_0001/smoke_0001/density>

            def OpenVDBAsset "density"
            {
                token fieldName = "density"
                asset filePath = @./smoke.0001.vdb@
                asset filePath.timeSamples = {
                    1: @./smoke.0001.vdb@,
                    2: @./smoke.0002.vdb@,
                    3: @./smoke.0003.vdb@,
                }
            }
        }
    }
}
"#;
    fs::write(work.path("blender.usda"), stage).unwrap();
    assert_eq!(lint(&work, "blender.usda"), (0, vec![], vec![]));
}

/// Each fault is planted alone: stage, what is replaced by what, the finding, and whether a layer removes it.
const FAULTS: [(&str, &str, &str, &str, bool); 19] = [
    ("moving", "2: @./smoke.0002.vdb@", "2: @./smoke.0022.vdb@", "missing-frame", false),
    ("still", "asset filePath = @./kinds.vdb@", "asset filePath = @./gone.vdb@", "missing-file", false),
    ("still", "asset filePath = @./kinds.vdb@", "asset filePath = @FOLDER/kinds.vdb@", "absolute-path", true),
    ("still", "field:label = </World/kinds/label>", "field:label = </World/kinds/pressure>", "duplicate-field", false),
    ("still", "fieldName = \"label\"", "fieldName = \"lable\"", "unknown-grid", false),
    ("still", "int fieldIndex = 0", "int fieldIndex = 2", "grid-index", true),
    ("still", "fieldDataType = \"double\"", "fieldDataType = \"float\"", "data-type", true),
    ("moving", "fieldClass = \"fogVolume\"", "fieldClass = \"levelSet\"", "grid-class", true),
    ("moving", "2: [(-0.0625", "2: [(-5", "extent", true),
    ("moving", "    upAxis = \"Z\"\n", "", "up-axis", false),
    ("moving", "    metersPerUnit = 1\n", "", "meters-per-unit", false),
    ("moving", "metersPerUnit = 1\n", "metersPerUnit = 0.00000001\n", "implausible-size", false),
    ("moving", "    defaultPrim = \"World\"\n", "", "default-prim", true),
    ("moving", "defaultPrim = \"World\"", "defaultPrim = \"Wolrd\"", "default-prim", true),
    ("moving", "endTimeCode = 3", "endTimeCode = 2", "time-range", true),
    ("moving", "framesPerSecond = 24\n", "framesPerSecond = 30\n", "frame-rate", true),
    ("moving", "                2: @./smoke.0002.vdb@,\n", "", "frame-gap", false),
    ("moving", "3: @./smoke.0003.vdb@", "3: @./smoke.0001.vdb@", "frame-number", false),
    ("still", "</World/kinds/label>", "</World/kinds/lable>", "unresolved-target", false),
];

#[test]
fn planted_faults_are_found_and_no_others() {
    let work = Work::new();
    sequence(&work);
    let folder = work.path("").canonicalize().unwrap();
    for (number, (stage, from, to, id, fixable)) in FAULTS.iter().enumerate() {
        let text = fs::read_to_string(work.path(&format!("{stage}.usda"))).unwrap();
        // Gaps and other frames leave their boxes behind, which belong to the stage's extent as well.
        let mut planted = text.replacen(from, &to.replace("FOLDER", folder.to_str().unwrap()), 1);
        assert_ne!(text, planted, "{id}: '{from}' is not in the stage");
        if *id == "frame-number" {
            let first = planted.lines().find(|line| line.trim().starts_with("1: [(")).unwrap().to_owned();
            let third = planted.lines().find(|line| line.trim().starts_with("3: [(")).unwrap().to_owned();
            planted = planted.replace(&third, &first.replacen("1:", "3:", 1));
        }
        let name = format!("planted{number}.usda");
        fs::write(work.path(&name), &planted).unwrap();
        let (code, problems, _) = lint(&work, &name);
        assert_eq!((code, problems), (1, vec![(*id).to_owned()]), "{number}: {id}");
        let out = work.command(&format!("usd lint {name}")).output().unwrap();
        assert!(String::from_utf8_lossy(&out.stdout).contains(&format!("[{id}]")));

        let layer = format!("fixed{number}.usda");
        let (code, left, _) = lint(&work, &format!("{name} --fix {layer}"));
        assert_eq!(fs::read_to_string(work.path(&name)).unwrap(), planted, "{id}: the stage has changed");
        assert_eq!(work.path(&layer).exists(), *fixable, "{id}");
        if *fixable {
            assert_eq!((code, left.is_empty()), (0, true), "{id}: {left:?}");
            assert_eq!(lint(&work, &layer), (0, vec![], vec![]), "{id}");
        } else {
            assert_eq!(code, 1, "{id}");
        }
    }
}

#[test]
fn faults_without_a_place_are_found() {
    let work = Work::new();
    sequence(&work);
    let write = |name: &str, body: &str| {
        let header = "#usda 1.0\n(\n    defaultPrim = \"World\"\n    metersPerUnit = 1\n    upAxis = \"Z\"\n)\n";
        fs::write(work.path(name), format!("{header}{body}")).unwrap();
    };
    write("empty.usda", "def Xform \"World\"\n{\n    def Volume \"v\"\n    {\n    }\n}\n");
    assert_eq!(lint(&work, "empty.usda"), (1, vec!["no-field".into()], vec![]));
    write("none.usda", "def Xform \"World\"\n{\n}\n");
    assert_eq!(lint(&work, "none.usda"), (0, vec![], vec!["no-volume".into()]));
    let volume = |file: &str| {
        format!(
            "def Volume \"World\"\n{{\n    custom rel field:density = </World/d>\n    def OpenVDBAsset \"d\"\n    {{\n        \
             {file}\n        token fieldName = \"density\"\n    }}\n}}\n"
        )
    };
    write("pathless.usda", &volume(""));
    assert_eq!(lint(&work, "pathless.usda"), (1, vec!["no-file-path".into()], vec![]));
    // A path that is looked up elsewhere, and no extent, are worth a word.
    write("loose.usda", &volume("asset filePath = @smoke.0001.vdb@"));
    assert_eq!(lint(&work, "loose.usda"), (0, vec![], vec!["unanchored-path".into(), "no-extent".into()]));
    fs::write(work.path("bad.vdb"), b"no volume").unwrap();
    write("damaged.usda", &volume("asset filePath = @./bad.vdb@"));
    assert_eq!(lint(&work, "damaged.usda"), (1, vec!["unreadable-file".into()], vec![]));
    write("layers.usda", "def Xform \"World\" (\n    references = @./gone.usda@\n)\n{\n}\n");
    let (code, problems, _) = lint(&work, "layers.usda");
    assert_eq!((code, problems.first().map(String::as_str)), (1, Some("composition")));
}

/// References that lead to prims which reference the next ones twice double the prims with each: they are refused long
/// before memory is short.
#[test]
fn references_that_multiply_are_refused() {
    let work = Work::new();
    let level = |i: usize| {
        let (x, y) = (
            format!("def \"x\" (references = </a{}>) {{}}", i + 1),
            format!("def \"y\" (payload = </a{}>) {{}}", i + 1),
        );
        format!("def Xform \"a{i}\" {{\n {x}\n {y}\n}}\n")
    };
    let levels: String = (0..40).map(level).collect();
    fs::write(work.path("fan.usda"), format!("#usda 1.0\n{levels}def Xform \"a40\" {{}}\n")).unwrap();
    for command in ["usd lint fan.usda", "info fan.usda", "render fan.usda -o x"] {
        work.refused(
            &format!("{command} --max-memory 1G"),
            Code::Unsupported,
            &["fan.usda", "prim /a0/x", "further references"],
        );
    }
    // Few levels are read.
    fs::write(
        work.path("few.usda"),
        format!("#usda 1.0\n{}def Xform \"a3\" {{}}\n", levels.split_at(levels.find("def Xform \"a3\"").unwrap()).0),
    )
    .unwrap();
    assert_eq!(work.json("info few.usda")["files"][0]["prims"], 1 + 3 + 7 + 15);
}

#[test]
fn errors_are_not_findings() {
    let work = Work::new();
    sequence(&work);
    fs::write(work.path("broken.usda"), "#usda 1.0\ndef Xform \"a\" {").unwrap();
    work.refused("usd lint broken.usda", Code::Invalid, &["broken.usda"]);
    work.refused("usd lint gone.usda", Code::NotFound, &["gone.usda"]);
    work.refused("usd lint moving.usda still.usda --fix both.usda", Code::Invalid, &["--fix"]);
    work.refused("usd lint moving.usda --fix still.usda", Code::Invalid, &["still.usda", "--overwrite"]);
    work.refused("usd lint moving.usda --fix fixed.vdb", Code::OutputName, &[".usda"]);
    // One that cannot be read does not keep the other from being reported.
    let out = work.command("usd lint broken.usda moving.usda").output().unwrap();
    assert_eq!(out.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&out.stdout).contains("moving.usda: clean"));
}

/// What a layer over a stage cannot change is not fixed, and what it changes keeps the times without a file.
#[test]
fn fixes_have_their_effect() {
    let work = Work::new();
    sequence(&work);
    let folder = work.path("").canonicalize().unwrap();
    let text = fs::read_to_string(work.path("moving.usda")).unwrap();
    // Frame 2 has no file, and that of frame 1 has an absolute path.
    let blocked = text
        .replace("2: @./smoke.0002.vdb@", "2: None")
        .replace("1: @./smoke.0001.vdb@", &format!("1: @{}/smoke.0001.vdb@", folder.display()));
    assert_ne!(blocked, text);
    fs::write(work.path("blocked.usda"), blocked).unwrap();
    let (_, problems, _) = lint(&work, "blocked.usda --fix unblocked.usda");
    assert!(!problems.contains(&"absolute-path".to_owned()), "{problems:?}");
    let layer = fs::read_to_string(work.path("unblocked.usda")).unwrap();
    assert!(layer.contains("1: @./smoke.0001.vdb@") && layer.contains("2: None"), "{layer}");
    // The prototype's prims cannot be changed through an instance of it.
    let header = "#usda 1.0\n(\n    defaultPrim = \"a\"\n    metersPerUnit = 1\n    upAxis = \"Z\"\n)\n";
    let still = fs::read_to_string(work.path("still.usda")).unwrap();
    fs::write(work.path("wrong.usda"), still.replace("fieldDataType = \"double\"", "fieldDataType = \"float\""))
        .unwrap();
    for (instanceable, code) in [("true", 1), ("false", 0)] {
        let prim = format!(
            "def Xform \"a\" (\n    instanceable = {instanceable}\n    references = @./wrong.usda@\n)\n{{\n}}\n"
        );
        fs::write(work.path("instance.usda"), format!("{header}{prim}")).unwrap();
        let (found, left, _) = lint(&work, "instance.usda --fix over.usda --overwrite");
        assert_eq!((found, left.contains(&"data-type".to_owned())), (code, code == 1), "{instanceable}: {left:?}");
    }
}
