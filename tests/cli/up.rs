//! Up axes: orbits and viewpoints stand upright in Y-up and Z-up worlds, conversions turn one into the other exactly, and
//! `diff` tells one from the other.

use crate::common::work::{Work, density, errors, fixture};
use cumulo::error::Code;
use cumulo::formats::limits::Limits;
use cumulo::formats::transforms;
use cumulo::formats::vdb::{Codec, File, NativeGrid, RawLeaf, write_grids, write_native};
use cumulo::math::Affine;
use cumulo::scene::grid::{GridClass, MetaValue};
use glam::DVec3;
use serde_json::json;
use std::collections::BTreeMap;
use std::path::Path;

fn text(value: &str) -> MetaValue {
    MetaValue::Text(value.into())
}

/// The plume with a creator in the file's metadata.
fn plume_of(path: &Path, creator: &str) {
    let plume = density(&fixture("plume.vdb"));
    write_grids(path, &[&plume], &BTreeMap::from([("creator".into(), text(creator))]), Codec::Blosc, false).unwrap();
}

/// World axis, 0 to 2, along which no camera of a capture differs, and which is level in all pictures.
fn level_axis(folder: &Path) -> Vec<usize> {
    let cameras = transforms::load(folder).unwrap().frames;
    let level = |a: &usize| {
        let first = cameras[0].camera.position()[*a];
        cameras.iter().all(|f| {
            let right = f.camera.camera_to_world.x_axis[*a];
            (f.camera.position()[*a] - first).abs() < 1e-9 && right.abs() < 1e-9
        })
    };
    (0..3).filter(level).collect()
}

#[test]
fn rings_circle_the_axis_that_the_file_states() {
    let work = Work::new();
    plume_of(&work.path("houdini.vdb"), "Houdini 20.5.654/GEO_VDBTranslator");
    plume_of(&work.path("blender.vdb"), "Blender/OpenVDBWriter");
    let ring = |input: &str, options: &str| {
        let words = format!("render {input} --views 5 --layout ring --size 8x8 -o out --overwrite {options}");
        let report = work.json(&words);
        (report["up"]["axis"].as_str().unwrap().to_owned(), level_axis(&work.path("out")))
    };
    assert_eq!(ring("houdini.vdb", ""), ("Y".into(), vec![1]));
    assert_eq!(ring("blender.vdb", ""), ("Z".into(), vec![2]));
    assert_eq!(ring("@plume.vdb", ""), ("Z".into(), vec![2]));
    assert_eq!(ring("houdini.vdb", "--up z"), ("Z".into(), vec![2]));
    assert_eq!(ring("@plume.vdb", "--up y"), ("Y".into(), vec![1]));
    let out = work.command("render houdini.vdb --views 1 --size 4x4 -o one").output().unwrap();
    assert!(errors(&out).contains("up axis Y: its creator is 'Houdini 20.5.654"), "{}", errors(&out));
    // Commands that place cameras by themselves.
    let view = work.json("viewpoint houdini.vdb --starts 1 --iterations 1 --size 24x24 -o view.json");
    assert_eq!(view["up"]["axis"], "Y");
    let gradient = work.json("gradient houdini.vdb --views 1 --size 4x4 --loss mean --wrt extinction");
    assert_eq!(gradient["up"]["axis"], "Y");
    let plan = work.json("plan houdini.vdb --views 1 --size 4x4");
    assert_eq!(plan["up"]["axis"], "Y");
    // Scenes stand as their volumes do, unless a transform places these or they disagree.
    for (volumes, axis) in [
        (json!([{"file": "houdini.vdb"}]), "Y"),
        (json!([{"file": "houdini.vdb"}, {"file": "blender.vdb"}]), "Z"),
        (json!([{"file": "houdini.vdb", "transform": [[1, 0, 0, 1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}]), "Z"),
    ] {
        let scene = json!({"volumes": volumes, "lights": [{"type": "DomeLight"}]});
        std::fs::write(work.path("scene.json"), scene.to_string()).unwrap();
        assert_eq!(work.json("plan scene.json --views 1 --size 4x4")["up"]["axis"], axis, "{scene}");
    }
    for (input, axis) in [("houdini.vdb", "Y"), ("@plume.vdb", "Z")] {
        work.json(&format!("usd author {input} --overwrite -o stage.usda"));
        let stage = std::fs::read_to_string(work.path("stage.usda")).unwrap();
        assert!(stage.contains(&format!("upAxis = \"{axis}\"")), "{stage}");
    }
    let template = work.json("render @plume.vdb --cameras out -o other");
    assert!(template["up"].is_null(), "cameras that are given stand as they stand");
}

#[test]
fn stages_state_their_axis() {
    let work = Work::new();
    std::fs::copy(fixture("plume.vdb"), work.path("plume.vdb")).unwrap();
    for (axis, level) in [("Y", 1), ("Z", 2)] {
        let name = format!("{axis}.usda");
        work.text(&format!("usd author plume.vdb -o {name} --up {} --albedo 0.5", axis.to_lowercase()));
        let report = work.json(&format!("render {name} --views 4 --layout ring --size 4x4 --samples 1 -o of{axis}"));
        assert_eq!(report["up"]["axis"], axis);
        assert_eq!(level_axis(&work.path(&format!("of{axis}"))), [level]);
    }
}

#[test]
fn a_turn_is_exact_and_undone_by_the_other() {
    let work = Work::new();
    for name in ["plume.vdb", "blob_sheared.vdb"] {
        let before = density(&fixture(name)).transform;
        let report = work.json(&format!("convert @{name} z.vdb --up z --up-from y"));
        assert_eq!((&report["up"]["from"], &report["up"]["to"]), (&"Y".into(), &"Z".into()));
        let after = density(&work.path("z.vdb")).transform;
        for p in [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z, DVec3::new(3.0, -5.0, 7.5)] {
            let (a, b) = (before.to_world(p), after.to_world(p));
            assert_eq!(b, DVec3::new(a.x, -a.z, a.y), "{name}");
        }
        // The file states its axis now, so that the way back needs no other word, and the way there is gone already.
        let again = work.json("convert z.vdb same.vdb --up z");
        assert_eq!((&again["up"]["from"], &again["up"]["to"]), (&"Z".into(), &"Z".into()));
        work.json("convert z.vdb back.vdb --up y");
        assert_eq!(density(&work.path("back.vdb")).transform.matrix(), before.matrix(), "{name}");
        let same = work.command(&format!("diff @{name} back.vdb")).output().unwrap();
        assert_eq!(same.status.code(), Some(0));
    }
    // What nothing states is the other axis; what a program states is believed.
    let out = work.command("convert @plume.vdb y.vdb --up y").output().unwrap();
    assert!(errors(&out).contains("nothing in the input states it"), "{}", errors(&out));
    plume_of(&work.path("houdini.vdb"), "Houdini/SOP_OpenVDB_Write");
    assert_eq!(work.json("convert houdini.vdb h.vdb --up y")["up"]["from"], "Y");
    // Programs that turn what Houdini has created let a file be that is turned already.
    work.json("convert houdini.vdb turned.vdb --up z");
    work.json("convert turned.vdb undone.vdb --up y");
    let creator = |name: &str| match &File::open(work.path(name), Limits::default()).unwrap().metadata().unwrap()["creator"]
    {
        MetaValue::Text(creator) => creator.clone(),
        other => format!("{other:?}"),
    };
    assert!(
        creator("turned.vdb").starts_with("cumulo ") && creator("turned.vdb").ends_with("Houdini/SOP_OpenVDB_Write")
    );
    assert_eq!(creator("undone.vdb"), "Houdini/SOP_OpenVDB_Write");
    work.refused("convert @plume.vdb no.vdb --up-from y", Code::Usage, &["--up"]);
}

#[test]
fn vectors_of_the_world_turn_and_colors_do_not() {
    let work = Work::new();
    let map = Affine::uniform(0.5, DVec3::new(1.0, 2.0, 3.0)).unwrap();
    let grid = |name: &str, class, entries: &[(&str, MetaValue)]| {
        let leaf = RawLeaf { origin: [0; 3], values: [1.0, 2.0, 3.0].repeat(512), active: [u64::MAX; 8] };
        let mut grid = NativeGrid::from_vectors(name, class, &map, &[leaf]).unwrap();
        entries.iter().for_each(|(name, value)| grid.set_metadata(name, value).unwrap());
        grid
    };
    let relative = || ("vector_type", text("contravariant relative"));
    let grids = [
        grid("vel", GridClass::Unknown, &[]),
        grid("Cd", GridClass::Unknown, &[]),
        grid("flow", GridClass::Unknown, &[relative()]),
        grid("v", GridClass::Unknown, &[("vector_type", text("invariant"))]),
        grid("own", GridClass::Unknown, &[relative(), ("is_local_space", MetaValue::Bool(true))]),
        grid("odd", GridClass::Unknown, &[]),
    ];
    let path = work.path("in.vdb");
    write_native(&path, &grids.each_ref(), None, &BTreeMap::new(), Codec::Blosc).unwrap();
    let out = work.command("convert in.vdb out.vdb --up z --json").output().unwrap();
    assert!(out.status.success(), "{}", errors(&out));
    let file = File::open(work.path("out.vdb"), Limits::default()).unwrap();
    let first = |name: &str| -> Vec<f32> { file.read(name).unwrap().to_raw().unwrap().leaves[0].values[..3].to_vec() };
    for (name, turned) in [("vel", true), ("Cd", false), ("flow", true), ("v", false), ("own", false), ("odd", false)] {
        let expected = if turned { [1.0, -3.0, 2.0] } else { [1.0, 2.0, 3.0] };
        assert_eq!(first(name), expected, "{name}");
    }
    // Doubts are told.
    for name in ["'v'", "'odd'"] {
        assert!(errors(&out).contains(&format!("grid {name}: its values were not turned")), "{}", errors(&out));
    }
    let staggered = grid("vel", GridClass::Staggered, &[]);
    write_native(&path, &[&staggered], None, &BTreeMap::new(), Codec::Blosc).unwrap();
    work.refused("convert in.vdb no.vdb --up z", Code::Unsupported, &["staggered", "--grid"]);
}

#[test]
fn diff_tells_of_the_turn() {
    let work = Work::new();
    work.json("convert @plume.vdb y.vdb --up y");
    let found = work.difference("@plume.vdb", "y.vdb");
    assert_eq!(found["agrees_after_turn"]["degrees"], 90, "{found}");
    assert_eq!(found["agrees_after_turn"]["second_up"], "Y");
    assert_eq!(work.difference("y.vdb", "@plume.vdb")["agrees_after_turn"]["degrees"], -90);
    let out = work.command("diff @plume.vdb y.vdb").output().unwrap();
    let told = String::from_utf8_lossy(&out.stdout).into_owned();
    assert_eq!(out.status.code(), Some(1));
    assert!(told.contains("Z-up against Y-up") && told.contains("--up z"), "{told}");
    // Other differences are not taken for a turn.
    work.json("convert @plume.vdb coarse.vdb --resample 0.1");
    assert!(work.difference("@plume.vdb", "coarse.vdb")["agrees_after_turn"].is_null());
    assert!(work.difference("@plume.vdb", "@plume.vdb")["agrees_after_turn"].is_null());
}
