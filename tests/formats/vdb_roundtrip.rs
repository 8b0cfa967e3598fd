//! What goes into a VDB comes out of it, for every kind of grid, seen by us and by OpenVDB's tools.

use crate::common::grids::fog;
use crate::common::work::python;
use cumulo::formats::limits::Limits;
use cumulo::formats::vdb::{Codec, File, NativeGrid, helper, write_grids, write_native};
use cumulo::math::Affine;
use cumulo::scene::grid::{Grid, GridClass, MetaValue};
use glam::{DMat4, DVec3, DVec4};
use std::collections::BTreeMap;

fn round_trip(grid: &Grid, codec: Codec, half: bool) -> Grid {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.vdb");
    write_grids(&path, &[grid], &BTreeMap::new(), codec, half).unwrap();
    File::open(&path, Limits::default()).unwrap().read_grid(&grid.name).unwrap()
}

fn assert_same(a: &Grid, b: &Grid) {
    assert_eq!((&a.name, a.class, a.background), (&b.name, b.class, b.background));
    assert_eq!(a.leaves, b.leaves);
    assert_eq!(a.tiles, b.tiles);
}

#[test]
fn float_grids_come_back_bit_for_bit_with_both_codecs() {
    // Leaves enough for several runs of them.
    let grid = fog("density", 7, 1);
    for codec in [Codec::Blosc, Codec::None] {
        let back = round_trip(&grid, codec, false);
        assert_same(&grid, &back);
        // Scale and translation are stored as such: no rounding.
        assert_eq!(back.transform.matrix(), grid.transform.matrix());
    }
}

#[test]
fn half_rounds_each_value_to_the_nearest_half_and_no_further() {
    let grid = fog("density", 2, 2);
    let back = round_trip(&grid, Codec::Blosc, true);
    for (a, b) in grid.leaves.iter().zip(&back.leaves) {
        assert_eq!(a.active, b.active);
        for (u, v) in a.values.iter().zip(b.values.iter()) {
            assert_eq!(half::f16::from_f32(*u).to_f32(), *v);
        }
    }
}

#[test]
fn transforms_of_every_kind_come_back() {
    let shear = DMat4::from_cols(
        DVec4::new(0.5, 0.0, 0.0, 0.0),
        DVec4::new(0.2, 0.7, 0.0, 0.0),
        DVec4::new(0.1, -0.3, 0.9, 0.0),
        DVec4::new(1.0, 2.0, 3.0, 1.0),
    );
    let mirror = DMat4::from_scale(DVec3::new(-0.5, 0.5, 0.5));
    let far = DMat4::from_translation(DVec3::new(1e7, -3e6, 12345.678)) * DMat4::from_rotation_z(0.3);
    for matrix in [shear, mirror, far, DMat4::IDENTITY, DMat4::from_scale(DVec3::new(1.0, 2.0, 3.0))] {
        let mut grid = fog("density", 1, 3);
        grid.transform = Affine::new(matrix).unwrap();
        let back = round_trip(&grid, Codec::Blosc, false).transform.matrix();
        // OpenVDB decomposes simple maps into scale and translation: exact; others are kept whole.
        assert_eq!(back, matrix);
    }
}

#[test]
fn metadata_of_every_type_comes_back_for_file_and_grid() {
    let values = BTreeMap::from([
        ("bool".to_owned(), MetaValue::Bool(true)),
        ("int".to_owned(), MetaValue::Int(-7)),
        ("long".to_owned(), MetaValue::Int(1 << 40)),
        ("float".to_owned(), MetaValue::Float(0.5)),
        ("double".to_owned(), MetaValue::Float(0.1)),
        ("text".to_owned(), MetaValue::Text("smoke é".into())),
        ("vec2i".to_owned(), MetaValue::Ints(vec![1, -2])),
        ("vec3i".to_owned(), MetaValue::Ints(vec![1, -2, 3])),
        ("vec4i".to_owned(), MetaValue::Ints(vec![1, -2, 3, 4])),
        ("vec2".to_owned(), MetaValue::Floats(vec![0.1, 0.2])),
        ("vec3".to_owned(), MetaValue::Floats(vec![0.1, 0.2, 0.3])),
        ("vec4".to_owned(), MetaValue::Floats(vec![0.1, 0.2, 0.3, 0.4])),
        ("matrix".to_owned(), MetaValue::Floats((0..16).map(f64::from).collect())),
    ]);
    let mut grid = fog("density", 1, 4);
    grid.metadata = values.clone();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.vdb");
    write_grids(&path, &[&grid], &values, Codec::Blosc, false).unwrap();
    let file = File::open(&path, Limits::default()).unwrap();
    assert_eq!(file.metadata().unwrap(), values);
    let back = file.read_grid("density").unwrap().metadata;
    values.iter().for_each(|(name, value)| assert_eq!(back.get(name), Some(value), "{name}"));
}

#[test]
fn empty_grids_and_repeated_names_come_back() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.vdb");
    let mut empty = fog("density", 1, 5);
    (empty.leaves, empty.tiles) = (vec![], vec![]);
    let (a, b) = (fog("density", 1, 6), fog("density", 2, 7));
    write_grids(&path, &[&empty, &a, &b], &BTreeMap::new(), Codec::Blosc, false).unwrap();
    let file = File::open(&path, Limits::default()).unwrap();
    let names: Vec<_> = file.entries().iter().map(|e| e.name.as_str()).collect();
    assert_eq!(names, ["density[0]", "density[1]", "density[2]"]);
    assert_eq!(file.read("density[0]").unwrap().info().unwrap().index_box, None);
    assert_eq!(file.read_grid("density[1]").unwrap().leaves, a.leaves);
    assert_eq!(file.read_grid("density[2]").unwrap().leaves, b.leaves);
    let text = file.read_grid("density").unwrap_err().to_string();
    assert!(text.contains("several") && text.contains("'density[2]'"), "{text}");
}

#[test]
fn a_level_set_is_read_as_the_fog_inside_of_its_surface() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.vdb");
    // A plane at x = 4, whose narrow band has 3 voxels to each side.
    let mut grid = fog("surface", 1, 8);
    (grid.class, grid.background) = (GridClass::LevelSet, 3.0);
    let leaf = &mut grid.leaves[0];
    (0..512).for_each(|i| leaf.values[i] = ((i >> 6) as f32 - 4.0).clamp(-3.0, 3.0));
    leaf.active = [u64::MAX; 8];
    write_grids(&path, &[&grid], &BTreeMap::new(), Codec::Blosc, false).unwrap();
    let file = File::open(&path, Limits::default()).unwrap();
    assert_eq!(file.read_grid("surface").unwrap().class, GridClass::LevelSet);
    let fog = file.read_fog(None).unwrap();
    assert_eq!((fog.class, fog.background), (GridClass::FogVolume, 0.0));
    for (i, value) in fog.leaves[0].values.iter().enumerate() {
        let expected = ((4.0 - (i >> 6) as f32) / 3.0).clamp(0.0, 1.0);
        assert!((value - expected).abs() < 1e-6, "{i}: {value} {expected}");
    }
}

#[test]
fn pyopenvdb_sees_what_we_wrote() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.vdb");
    let mut grid = fog("density", 2, 9);
    grid.metadata.insert("note".into(), MetaValue::Text("kept".into()));
    write_grids(&path, &[&grid], &BTreeMap::new(), Codec::Blosc, false).unwrap();
    let leaf = &grid.leaves[3];
    let [x, y, z] = leaf.origin;
    let on = (0..512).find(|i| leaf.active[i >> 6] >> (i & 63) & 1 == 1).unwrap();
    let voxel = [x + (on as i32 >> 6), y + (on as i32 >> 3 & 7), z + (on as i32 & 7)];
    let active: u64 = grid.leaves.iter().flat_map(|l| l.active).map(|w| u64::from(w.count_ones())).sum();
    python(&format!(
        "import pyopenvdb as v\n\
         g = v.read({path:?}, 'density')\n\
         assert g.activeVoxelCount() == {active} + 128**3, g.activeVoxelCount()\n\
         assert g.getConstAccessor().probeValue(tuple({voxel:?})) == ({value:?}, True)\n\
         assert g.getConstAccessor().probeValue((513, 514, 515)) == (0.25, False)\n\
         assert g['note'] == 'kept' and g.gridClass == 'fog volume'\n\
         assert g.transform.indexToWorld((0, 0, 0)) == (1.0, -2.0, 3.0)\n",
        path = path.to_str().unwrap(),
        value = f64::from(leaf.values[on]),
    ));
}

#[test]
fn other_types_written_by_pyopenvdb_are_read_and_passed_through() {
    let dir = tempfile::tempdir().unwrap();
    let (path, copy) = (dir.path().join("a.vdb"), dir.path().join("b.vdb"));
    python(&format!(
        "import pyopenvdb as v\n\
         grids = []\n\
         for name, value in (('Float', -1.5), ('Bool', True), ('Vec3S', (1.0, 2.0, -3.0))):\n\
         \x20   g = getattr(v, name + 'Grid')()\n\
         \x20   g.name = name\n\
         \x20   g.fill((-3, 0, 2), (20, 9, 11), value)\n\
         \x20   grids.append(g)\n\
         v.write({:?}, grids, {{'title': 'all'}})\n",
        path.to_str().unwrap()
    ));
    let file = File::open(&path, Limits::default()).unwrap();
    let expected: [(&str, &[f32]); 3] = [("Float", &[-1.5]), ("Bool", &[1.0]), ("Vec3S", &[1.0, 2.0, -3.0])];
    let mut natives: Vec<NativeGrid> = Vec::new();
    for (name, value) in expected {
        let native = file.read(name).unwrap();
        let info = native.info().unwrap();
        assert_eq!((info.components, info.active_voxels), (value.len(), 24 * 10 * 10), "{name}");
        assert_eq!(info.index_box, Some(([-3, 0, 2], [20, 9, 11])));
        let raw = native.to_raw().unwrap();
        for leaf in &raw.leaves {
            for i in (0..512).filter(|i| leaf.active[i >> 6] >> (i & 63) & 1 == 1) {
                assert_eq!(&leaf.values[i * value.len()..(i + 1) * value.len()], value);
            }
        }
        assert_eq!(native.to_grid().is_ok(), value.len() == 1);
        natives.push(native);
    }
    let all: Vec<_> = natives.iter().collect();
    write_native(&copy, &all, Some(&file), &BTreeMap::new(), Codec::None).unwrap();
    python(&format!(
        "import pyopenvdb as v\n\
         grids, meta = v.readAll({:?})\n\
         assert meta['title'] == 'all'\n\
         assert sorted((g.name, g.valueTypeName, g.activeVoxelCount()) for g in grids) == \
         [('Bool', 'bool', 2400), ('Float', 'float', 2400), ('Vec3S', 'vec3s', 2400)]\n",
        copy.to_str().unwrap()
    ));
}

#[test]
fn vdb_print_lists_our_grids() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.vdb");
    write_grids(&path, &[&fog("density", 1, 10)], &BTreeMap::new(), Codec::Blosc, true).unwrap();
    let out = std::process::Command::new("vdb_print").arg("-l").arg(&path).output().unwrap();
    let text = String::from_utf8(out.stdout).unwrap();
    assert!(text.contains("Name: density") && text.contains("is_saved_as_half_float: true"), "{text}");
}

/// Types that we only pass through keep their type and their values in full.
#[test]
fn doubles_and_integers_are_passed_through_in_full() {
    helper::set_program(env!("CARGO_BIN_EXE_cumulo").into());
    let dir = tempfile::tempdir().unwrap();
    let copy = dir.path().join("copy.vdb");
    let fixture = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/kinds.vdb");
    let file = File::open(&fixture, Limits::default()).unwrap();
    let grids: Vec<NativeGrid> = file.entries().iter().map(|e| file.read(&e.name).unwrap()).collect();
    write_native(&copy, &grids.iter().collect::<Vec<_>>(), Some(&file), &BTreeMap::new(), Codec::Blosc).unwrap();
    let back = File::open(&copy, Limits::default()).unwrap();
    let mut types = Vec::new();
    for grid in &grids {
        let other = back.read(grid.name()).unwrap();
        let (a, b) = (grid.info().unwrap(), other.info().unwrap());
        assert_eq!(a, b);
        assert_eq!(grid.metadata().unwrap(), other.metadata().unwrap());
        assert!(a.components == 0 || grid.same_values(&other).unwrap(), "{}", grid.name());
        types.push(a.value_type);
    }
    let native = |seed| NativeGrid::from_grid(&fog("density", 2, seed)).unwrap();
    assert!(native(1).same_values(&native(1)).unwrap() && !native(1).same_values(&native(2)).unwrap());
    assert!(["double", "int32"].iter().all(|t| types.iter().any(|u| u == t)), "{types:?}");
}
