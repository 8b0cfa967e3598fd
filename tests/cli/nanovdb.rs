//! `cumulo convert`, `info` and `validate` on NanoVDB files.

use crate::common::grids::fog;
use crate::common::work::fixture;
use assert_cmd::Command;
use cumulo::formats::limits::Limits;
use cumulo::formats::nanovdb::{Volume, write};
use cumulo::formats::vdb::{Codec, File, NativeGrid, write_grids, write_native};
use cumulo::scene::grid::{Grid, MetaValue};
use cumulo::scene::up::Up;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;

fn cumulo(code: i32, arguments: &[&str]) -> String {
    let run = Command::cargo_bin("cumulo").unwrap().arg("--quiet").args(arguments).assert().code(code);
    let output = run.get_output();
    String::from_utf8(if code == 2 { output.stderr.clone() } else { output.stdout.clone() }).unwrap()
}

fn json(code: i32, arguments: &[&str]) -> Value {
    serde_json::from_str(&cumulo(code, &[arguments, &["--json"]].concat())).unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn grid(path: &Path, name: &str) -> NativeGrid {
    File::open(path, Limits::default()).unwrap().read(name).unwrap()
}

#[test]
fn grids_come_back_as_they_were() {
    let folder = tempfile::tempdir().unwrap();
    let [nano, back] = ["a.nvdb", "b.vdb"].map(|n| folder.path().join(n));
    for (source, names) in [
        ("plume.vdb", &["density"][..]),
        ("tiles.vdb", &["density"]),
        ("sphere_level_set.vdb", &[]),
        ("blob_sheared.vdb", &["density"]),
        ("kinds.vdb", &["velocity", "label"]),
    ] {
        let source = fixture(source);
        let all: Vec<String> =
            File::open(&source, Limits::default()).unwrap().entries().iter().map(|e| e.name.clone()).collect();
        let names: Vec<&str> = if names.is_empty() { all.iter().map(String::as_str).collect() } else { names.to_vec() };
        let chosen: Vec<&str> = names.iter().flat_map(|n| ["--grid", n]).collect();
        let made = json(0, &[&["convert", text(&source), text(&nano)], &chosen[..]].concat());
        assert_eq!(made["grids"].as_array().unwrap().len(), names.len());
        json(0, &["convert", text(&nano), text(&back)]);
        for name in names {
            let (before, after) = (grid(&source, name), grid(&back, name));
            assert!(before.same_values(&after).unwrap(), "{} {name}", source.display());
            let (before, after) = (before.info().unwrap(), after.info().unwrap());
            assert_eq!((before.transform, before.class), (after.transform, after.class));
            assert_eq!((before.value_type, before.background), (after.value_type, after.background));
        }
    }
}

/// NanoVDB has no field for the creator, by which Houdini's smoke is known to be Y-up.
#[test]
fn the_up_axis_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    let [vdb, nano, back, bare, bare_back] =
        ["a.vdb", "a.nvdb", "b.vdb", "c.nvdb", "c.vdb"].map(|n| folder.path().join(n));
    let plume = grid(&fixture("plume.vdb"), "density");
    let creator = "Houdini 20.5.654/GEO_VDBTranslator";
    let metadata = BTreeMap::from([("creator".to_owned(), MetaValue::Text(creator.into()))]);
    write_native(&vdb, &[&plume], None, &metadata, Codec::Blosc).unwrap();
    cumulo(0, &["convert", text(&vdb), text(&nano)]);
    cumulo(0, &["convert", text(&nano), text(&back)]);
    let file = File::open(&back, Limits::default()).unwrap();
    assert_eq!(file.up().unwrap().up, Up::Y);
    assert_eq!(file.metadata().unwrap()["creator"], MetaValue::Text(creator.into()));
    let same = json(0, &["diff", text(&vdb), text(&back)]);
    assert_eq!((&same["up"], &same["creator"]), (&Value::Null, &Value::Null));
    // NanoVDB's own tools read what lies beside the grid, or past it.
    for tool in ["nanovdb_validate", "nanovdb_print"] {
        let out = std::process::Command::new(tool).arg(&nano).output().unwrap();
        let said = format!("{}{}", String::from_utf8_lossy(&out.stdout), String::from_utf8_lossy(&out.stderr));
        assert!(out.status.success() && !said.to_lowercase().contains("invalid"), "{tool}: {said}");
    }
    // A file of another program states nothing: the values are the same, the axes are not.
    let volume = Volume::of_native(&plume, Limits::default()).unwrap();
    write(&bare, &[volume], Limits::default()).unwrap();
    cumulo(0, &["convert", text(&bare), text(&bare_back)]);
    let differs = json(0, &["diff", text(&vdb), text(&bare_back)]);
    assert_eq!((&differs["up"]["a"]["axis"], &differs["up"]["b"]["axis"]), (&json!("Y"), &json!("Z")));
    assert_eq!(differs["grids"][0]["max_abs"], json!(0.0));
    let said = cumulo(0, &["diff", text(&vdb), text(&bare_back)]);
    assert!(said.contains("up axes differ") && said.contains("creators differ"), "{said}");
    // Two statements that contradict each other are a difference.
    let blender = BTreeMap::from([("creator".to_owned(), MetaValue::Text("Blender/OpenVDBWriter".into()))]);
    write_native(&back, &[&plume], None, &blender, Codec::Blosc).unwrap();
    assert!(cumulo(1, &["diff", text(&vdb), text(&back)]).contains("different: the up axes"));
}

#[test]
fn long_names_and_damaged_texts_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let [nano, vdb] = ["a.nvdb", "a.vdb"].map(|n| folder.path().join(n));
    let mut volume = Volume::of_native(&grid(&fixture("cube.vdb"), "density"), Limits::default()).unwrap();
    volume.name = "n".repeat(300);
    volume.texts = BTreeMap::from([("creator".to_owned(), "Houdini".to_owned())]);
    write(&nano, &[volume], Limits::default()).unwrap();
    cumulo(0, &["convert", text(&nano), text(&vdb)]);
    let file = File::open(&vdb, Limits::default()).unwrap();
    assert_eq!((file.entries()[0].name.len(), file.up().unwrap().up), (300, Up::Y));
    // The number of texts, in a header that lies behind the directory and the long name.
    let mut bytes = std::fs::read(&nano).unwrap();
    let header = bytes.windows(8).rposition(|w| w == b"NanoVDB0").unwrap();
    bytes[header + 648..header + 652].copy_from_slice(&u32::MAX.to_le_bytes());
    std::fs::write(&nano, bytes).unwrap();
    let notes = json(0, &["convert", text(&nano), text(&vdb)])["notes"].to_string();
    assert!(notes.contains("beside the grid cannot be read"), "{notes}");
}

#[test]
fn memory_is_that_of_all_grids_together() {
    let folder = tempfile::tempdir().unwrap();
    let [nano, vdb, out] = ["a.nvdb", "a.vdb", "b.nvdb"].map(|n| folder.path().join(n));
    // Large enough that limits around it are above the least one.
    let source = folder.path().join("source.vdb");
    write_grids(&source, &[&Grid { tiles: vec![], ..fog("density", 28, 1) }], &BTreeMap::new(), Codec::Blosc, false)
        .unwrap();
    let native = grid(&source, "density");
    let info = native.info().unwrap();
    let volumes = vec![Volume::of_native(&native, Limits::default()).unwrap(); 2];
    write(&nano, &volumes, Limits::default()).unwrap();
    let each = std::fs::metadata(&nano).unwrap().len() / 2;
    let convert = |code: i32, from: &Path, to: &Path, most: u64| {
        cumulo(code, &["convert", text(from), text(to), "--max-memory", &most.to_string()])
    };
    // One grid takes its memory and its leaves, of 2048 bytes of values and less than 512 beside them; so does the other,
    // beside the one that was read.
    let one = each + info.leaf_count * 2560;
    let error = convert(2, &nano, &vdb, one + info.memory / 2);
    assert!(error.contains("grid 'density'") && error.contains("--max-memory"), "{error}");
    convert(0, &nano, &vdb, one + 2 * info.memory);
    // The file to be written is held beside all grids.
    let error = convert(2, &vdb, &out, 2 * each + info.memory);
    assert!(error.contains("--max-memory"), "{error}");
    // So are the bytes of the parts that are read, while they are decoded.
    convert(0, &vdb, &out, 2 * each + 5 * info.memory);
}

#[test]
fn other_types_and_missing_grids_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let nano = folder.path().join("a.nvdb");
    let made = json(0, &["convert", text(&fixture("kinds.vdb")), text(&nano)]);
    let notes = made["notes"].to_string();
    assert!(notes.contains("double values are written as floats") && notes.contains("'mask'"), "{notes}");
    let error = cumulo(2, &["convert", text(&nano), text(&folder.path().join("b.vdb")), "--grid", "smoke"]);
    assert!(error.contains("no grid 'smoke'") && error.contains("'velocity'"), "{error}");
    let error = cumulo(2, &["convert", text(&nano), text(&folder.path().join("b.vdb")), "--level", "1"]);
    assert!(error.contains("--level has no effect from NanoVDB"), "{error}");
    let error = cumulo(2, &["convert", text(&nano), text(&folder.path().join("b.nii"))]);
    assert!(error.contains("no conversion from NanoVDB"), "{error}");
}

#[test]
fn info_and_validate_say_what_is_there() {
    let folder = tempfile::tempdir().unwrap();
    let nano = folder.path().join("a.nvdb");
    cumulo(0, &["convert", text(&fixture("plume.vdb")), text(&nano)]);
    let of = &json(0, &["info", text(&nano)])["files"][0];
    assert_eq!((&of["format"], &of["version"]), (&json!("nanovdb"), &json!("32.4.2")));
    let voxels = grid(&fixture("plume.vdb"), "density").info().unwrap().active_voxels;
    assert_eq!(of["grids"][0]["active_voxels"], json!(voxels));
    assert_eq!((&of["grids"][0]["value_type"], &of["grids"][0]["codec"]), (&json!("float"), &json!("none")));
    assert!(cumulo(0, &["info", text(&nano)]).contains("grid 'density': float, fog volume"));
    assert_eq!(json(0, &["validate", text(&nano)])["valid"], json!(true));
    let whole = std::fs::read(&nano).unwrap();
    std::fs::write(&nano, &whole[..whole.len() / 2]).unwrap();
    assert_eq!(json(1, &["validate", text(&nano)])["valid"], json!(false));
    let error = cumulo(2, &["info", text(&nano)]);
    assert!(error.contains("grid 'density'") && error.contains("damaged or incomplete"), "{error}");
}
