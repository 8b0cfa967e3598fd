//! `cumulo convert` from volumes to meshes and back, held against what is known of spheres and boxes in closed form.

use crate::common::fields::{grid, noise, odd};
use crate::common::shapes::gltf;
use crate::common::work::{Work, density, number};
use base64::Engine;
use cumulo::error::Code;
use cumulo::formats::format::FileKind;
use cumulo::formats::limits::Limits;
use cumulo::formats::mesh::Mesh;
use cumulo::formats::registry;
use cumulo::formats::vdb::{Codec, File, NativeGrid, write_native};
use cumulo::math::Affine;
use cumulo::scene::grid::{Grid, GridClass};
use glam::{DMat4, DVec3};
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::fmt::Write;
use std::path::Path;

/// Centre and radius of the spheres in voxels.
const CENTRE: DVec3 = DVec3::new(20.3, 19.6, 20.1);
const RADIUS: f64 = 13.0;

fn mesh(path: &Path) -> Mesh {
    let FileKind::Mesh(reader) = registry::sniff(path).unwrap().kind else { panic!("{} is no mesh", path.display()) };
    reader.read(path, Limits::default()).unwrap()
}

/// A fog volume whose value is 1 at the centre of a ball and falls linearly to 0 at twice its radius.
fn ball(map: Affine) -> Grid {
    grid(40, map, |p| (1.0 - p.distance(CENTRE) / (2.0 * RADIUS)).max(0.0))
}

fn write(path: &Path, grid: &Grid) {
    let native = NativeGrid::from_grid(grid).unwrap();
    write_native(path, &[&native], None, &BTreeMap::new(), Codec::Blosc).unwrap();
}

/// A vertex is the mean of points on the edges of a cell of edge 1. Linear interpolation of the distance misses the
/// sphere by 1/8R there, and the mean of points on a sphere within the cell's diagonal lies 3/8R below it.
const OFF: f64 = 0.5 / RADIUS;

#[test]
fn the_surface_of_a_ball_is_a_sphere_in_any_lattice() {
    let work = Work::new();
    let scaled = Affine::new(DMat4::from_scale_rotation_translation(
        DVec3::splat(0.25),
        glam::DQuat::from_rotation_y(0.8),
        DVec3::new(3.0, -200.0, 7.0),
    ));
    // The second lattice is mirrored, sheared and not cubic.
    for (name, map) in [("scaled", scaled.unwrap()), ("odd", odd())] {
        write(&work.path("ball.vdb"), &ball(map));
        for ending in ["ply", "obj"] {
            let report = work.json(&format!("convert ball.vdb s.{ending} --iso 0.5"));
            let mesh = mesh(&work.path(&format!("s.{ending}")));
            let off = |v: &DVec3| (map.to_index(*v).distance(CENTRE) - RADIUS).abs();
            let most = mesh.vertices.iter().map(off).fold(0.0, f64::max);
            assert!(most < OFF, "{name}: {most}");
            let parts = DMat4::determinant(&map.matrix()).abs();
            let volume = 4.0 / 3.0 * PI * RADIUS.powi(3) * parts;
            let found = number(&report["mesh"], "volume");
            // Vertices and chords lie 1/2R inside at most, of which a volume has thrice the relative part.
            assert!((found / volume - 1.0).abs() < 3.0 / RADIUS.powi(2), "{name}: {found} {volume}");
            assert_eq!(report["mesh"]["open_edges"], 0);
            assert_eq!(report["mesh"]["turned_edges"], 0);
            assert_eq!(report["mesh"]["vertices"], mesh.vertices.len());
            if name == "scaled" {
                let area = 4.0 * PI * (0.25 * RADIUS).powi(2);
                let found = number(&report["mesh"], "area");
                assert!((found / area - 1.0).abs() < 2.0 / RADIUS.powi(2), "{found} {area}");
            }
        }
    }
}

#[test]
fn flat_parts_are_merged_and_stay_closed() {
    let work = Work::new();
    let map = Affine::uniform(0.5, DVec3::ZERO).unwrap();
    let inside = |p: DVec3| f64::from(u8::from((p - 19.5).abs().max_element() < 10.0));
    write(&work.path("cube.vdb"), &grid(40, map, inside));
    let plain = work.json("convert cube.vdb plain.ply --iso 0.5");
    let merged = work.json("convert cube.vdb merged.ply --iso 0.5 --adaptivity 0.1");
    // Voxels 10 to 29 hold 1: the surface lies between them and their neighbours. Edges are cut at a quarter of a voxel,
    // or where OpenVDB merges them with what is flat within a leaf.
    for (report, off) in [(&plain, 10.0), (&merged, 60.0)] {
        assert!((number(&report["mesh"], "volume") - 1000.0).abs() < off, "{report}");
        assert_eq!(report["mesh"]["open_edges"], 0);
    }
    assert!(number(&merged["mesh"], "polygons") < 0.5 * number(&plain["mesh"], "polygons"), "{merged}");
}

#[test]
fn a_sphere_keeps_its_place_from_mesh_to_level_set_and_back() {
    let work = Work::new();
    let map = Affine::uniform(0.25, DVec3::new(3.0, -2.0, 7.0)).unwrap();
    write(&work.path("ball.vdb"), &ball(map));
    work.json("convert ball.vdb first.ply --iso 0.5");
    let report = work.json("convert first.ply sphere.vdb --voxel-size 0.2 --half-width 4");
    assert_eq!(report["notes"].as_array().unwrap().len(), 0, "{report}");
    assert_eq!((&report["grid"]["class"], &report["grid"]["name"]), (&"level set".into(), &"surface".into()));
    let centre = map.to_world(CENTRE);
    let off = |p: DVec3| p.distance(centre) - 0.25 * RADIUS;
    let file = File::open(work.path("sphere.vdb"), Limits::default()).unwrap();
    let set = file.read_grid("surface").unwrap();
    assert_eq!((set.class, set.background), (GridClass::LevelSet, 0.8));
    let mut seen = 0;
    for leaf in &set.leaves {
        for i in (0..512_usize).filter(|i| leaf.active[i >> 6] >> (i & 63) & 1 == 1) {
            let local = DVec3::new((i >> 6) as f64, (i >> 3 & 7) as f64, (i & 7) as f64);
            let at = set.transform.to_world(DVec3::from_array(leaf.origin.map(f64::from)) + local);
            // The mesh lies within 0.25 OFF of the sphere, its chords within as much again, and OpenVDB's distances
            // grow by up to half of a voxel beyond the second.
            assert!((f64::from(leaf.values[i]) - off(at)).abs() < 0.1, "{at}: {} {}", leaf.values[i], off(at));
            seen += 1;
        }
    }
    assert!(seen > 10_000, "{seen}");
    let back = work.json("convert sphere.vdb back.obj");
    assert_eq!(back["iso"], 0.0);
    assert_eq!(back["mesh"]["open_edges"], 0);
    let most = mesh(&work.path("back.obj")).vertices.iter().map(|v| off(*v).abs()).fold(0.0, f64::max);
    assert!(most < 3.0 * 0.25 * OFF, "{most}");
    assert!(number(&back["mesh"], "volume") > 0.0, "polygons face outwards");
}

/// A box from 0 to `size` as OBJ with one polygon a side.
fn cuboid(size: [f64; 3]) -> String {
    let mut text = String::from("# a box\nmtllib none.mtl\no box\nvt 0 0\nvn 0 0 1\n");
    for i in 0..8 {
        let [x, y, z] = [i >> 2, i >> 1 & 1, i & 1].map(f64::from);
        writeln!(text, "v {} {} {} 1 0.5 0.5", x * size[0], y * size[1], z * size[2]).unwrap();
    }
    text + "g side\nusemtl none\ns off\nf 1 2 4 3\nf 5/1 7/1 8/1 6/1\nf 1//1 5//1 6//1 2//1\n\
            f 3/1/1 4/1/1 8/1/1 7/1/1\n            f -8 -6 \\\n-2 -4 # goes on\nl 1 2\nf 2 6 8 4\n"
}

#[test]
fn a_box_becomes_the_fog_of_its_definition() {
    let work = Work::new();
    let size = [6.0, 4.0, 5.0];
    std::fs::write(work.path("box.obj"), cuboid(size)).unwrap();
    let report = work.json("convert box.obj fog.vdb --voxel-size 0.25 --half-width 2 --to fog --half");
    assert_eq!((&report["grid"]["class"], &report["mesh"]["volume"]), (&"fog volume".into(), &120.0.into()));
    assert_eq!(report["mesh"]["bounds"], serde_json::json!([[0.0, 0.0, 0.0], size]));
    work.json("convert box.obj fog.vdb --voxel-size 0.25 --half-width 2 --to fog --grid smoke");
    let fog = File::open(work.path("fog.vdb"), Limits::default()).unwrap().read_grid("smoke").unwrap();
    let mut seen = 0;
    for leaf in &fog.leaves {
        for (i, value) in leaf.values.iter().enumerate() {
            let local = DVec3::new((i >> 6) as f64, (i >> 3 & 7) as f64, (i & 7) as f64);
            let at = fog.transform.to_world(DVec3::from_array(leaf.origin.map(f64::from)) + local);
            let inside = at.min(DVec3::from_array(size) - at).min_element();
            // 0 on the surface, and 1 two voxels of 0.25 inside. OpenVDB's renormalization takes off 1e-7.
            let expected = (inside / 0.5).clamp(0.0, 1.0);
            assert!((f64::from(*value) - expected).abs() < 1e-5, "{at}: {value} {expected}");
            seen += usize::from(*value > 0.0);
        }
    }
    assert!(seen > 1000);
}

/// A tetrahedron as PLY of an encoding, with properties and elements that mean nothing here.
fn tetrahedron(encoding: &str) -> Vec<u8> {
    let header = format!(
        "ply\nformat {encoding} 1.0\ncomment made here\nelement material 1\nproperty uchar red\nelement vertex 4\n\
         property double x\nproperty float y\nproperty short z\nproperty uchar alpha\nelement face 4\nproperty uchar flags\n\
         property list uchar ushort vertex_index\nelement edge 9999999\nproperty int a\nend_header\n"
    );
    let points = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 3.0]];
    let faces = [[0_u16, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    let mut bytes = header.into_bytes();
    let big = encoding == "binary_big_endian";
    let mut put = |little: Vec<u8>| bytes.extend(if big { little.into_iter().rev().collect() } else { little });
    if encoding == "ascii" {
        let mut text = String::from("200\n");
        points.iter().for_each(|[x, y, z]| writeln!(text, "{x} {y} {z} 255").unwrap());
        faces.iter().for_each(|[a, b, c]| writeln!(text, "7 3 {a} {b} {c}").unwrap());
        bytes.extend(text.bytes());
        return bytes;
    }
    put(vec![200]);
    for [x, y, z] in points {
        put(f64::to_le_bytes(x).to_vec());
        put((y as f32).to_le_bytes().to_vec());
        put((z as i16).to_le_bytes().to_vec());
        put(vec![255]);
    }
    for face in faces {
        put(vec![7]);
        put(vec![3]);
        face.iter().for_each(|corner| put(corner.to_le_bytes().to_vec()));
    }
    bytes
}

#[test]
fn every_encoding_of_ply_holds_the_same_mesh() {
    let work = Work::new();
    for encoding in ["ascii", "binary_little_endian", "binary_big_endian"] {
        std::fs::write(work.path("t.ply"), tetrahedron(encoding)).unwrap();
        let report = work.json("convert t.ply t.vdb --voxel-size 0.1");
        assert_eq!((number(&report["mesh"], "volume"), number(&report["mesh"], "polygons")), (4.5, 4.0), "{encoding}");
    }
    // Windows' ends of lines, a comment of another encoding, and what ends without a line's end.
    let text = String::from_utf8(tetrahedron("ascii")).unwrap().trim_end().replace('\n', "\r\n");
    let text = [&b"ply\r\ncomment caf\xe9\r\n"[..], text.as_bytes().strip_prefix(b"ply\r\n").unwrap()].concat();
    std::fs::write(work.path("t.ply"), text).unwrap();
    assert_eq!(number(&work.json("convert t.ply t.vdb --voxel-size 0.1")["mesh"], "volume"), 4.5);
    // A level set of a mesh is rendered and shown as others are.
    work.json("render t.vdb --views 1 --size 8x8 -o t.exr");
}

#[test]
fn grids_without_a_surface_are_refused_with_their_range() {
    let work = Work::new();
    let facts = ["cube.vdb", "density", "--iso", "0", "1"];
    work.refused("convert @cube.vdb s.ply", Code::Invalid, &facts);
    work.refused("convert @cube.vdb s.ply --iso 0", Code::Invalid, &facts);
    work.refused("convert @cube.vdb s.obj --iso 7", Code::Invalid, &facts);
    work.refused("convert @cube.vdb s.vdb --iso 1", Code::Invalid, &["--iso", "--to level-set"]);
    work.refused("convert @cube.vdb s.ply --iso 1 --half", Code::Invalid, &["--half", "PLY"]);
    work.refused("convert @cube.vdb s.ply --iso 1 --half-width 2", Code::Invalid, &["--half-width"]);
    write(&work.path("noise.vdb"), &grid(96, odd(), |p| noise(p.dot(DVec3::new(1.0, 96.0, 9216.0)) as u64)));
    let facts = ["noise.vdb", "density", "surface", "--max-memory"];
    work.refused("convert noise.vdb s.ply --iso 0.5 --max-memory 150M --threads 1", Code::MemoryLimit, &facts);
    assert!(!work.path("s.ply").exists());
}

#[test]
fn meshes_without_an_inside_are_refused() {
    let work = Work::new();
    let put = |name: &str, text: &str| std::fs::write(work.path(name), text).unwrap();
    let whole = cuboid([6.0, 4.0, 5.0]);
    put("open.obj", &whole.replace("f 2 6 8 4\n", ""));
    work.refused(
        "convert open.obj o.vdb --voxel-size 0.2",
        Code::Unsupported,
        &["open.obj", "open at 4 edges", "Fill"],
    );
    put("box.obj", &whole);
    work.refused("convert box.obj o.vdb", Code::Invalid, &["box.obj", "6 x 4 x 5", "--voxel-size 0.06"]);
    work.refused("convert box.obj o.vdb --voxel-size 1e-4", Code::MemoryLimit, &["box.obj", "--voxel-size"]);
    work.refused("convert box.obj o.vdb --voxel-size 1e-12", Code::Unsupported, &["box.obj", "too small"]);
    work.refused("convert box.obj o.vdb --voxel-size 50 --to fog", Code::EmptyGrid, &["--voxel-size"]);
    work.refused("convert box.obj o.vdb --voxel-size 1 --iso 1", Code::Invalid, &["--iso", "OBJ"]);
    work.refused("convert box.obj o.vdb --voxel-size 1 --spacing 1,1,1", Code::Usage, &["--spacing"]);
    work.refused("convert box.obj o.ply", Code::Unsupported, &["OBJ", "PLY"]);
    work.refused("info box.obj", Code::UnknownFormat, &["Wavefront OBJ", "cumulo convert"]);
    // A box within the box whose sides face inwards is a cavity, which is filled with a note.
    let inner: String = whole.lines().filter(|line| line.starts_with("v ")).fold(String::new(), |text, line| {
        let numbers: Vec<f64> = line.split(' ').skip(1).take(3).map(|n| n.parse().unwrap()).collect();
        text + &format!("v {} {} {}\n", 2.0 + 0.3 * numbers[0], 1.5 + 0.3 * numbers[1], 1.5 + 0.3 * numbers[2])
    });
    put(
        "hollow.obj",
        &(whole + &inner + "f 11 12 10 9\nf 14 16 15 13\nf 10 14 13 9\nf 15 16 12 11\nf 13 15 11 9\nf 12 16 14 10\n"),
    );
    let report = work.json("convert hollow.obj o.vdb --voxel-size 0.2");
    assert!((number(&report["mesh"], "volume") - 120.0 * (1.0 - 0.027)).abs() < 1e-9, "{report}");
    assert_eq!((&report["mesh"]["shells"], &report["mesh"]["inward_shells"]), (&2.into(), &1.into()));
    told(&report, &["1 of 2 shells", "cavities are filled"]);
    // The voxels of a box of 6 x 4 x 5 by 0.2 have their centres on its sides.
    let filled = number(&work.json("convert o.vdb o.ply")["mesh"], "volume");
    assert!((filled - 120.0).abs() < 0.5, "{filled}");
}

/// The one note of a report has all of some words.
fn told(report: &serde_json::Value, words: &[&str]) {
    let notes = report["notes"].as_array().unwrap();
    assert_eq!(notes.len(), 1, "{report}");
    let note = notes[0].as_str().unwrap();
    words.iter().for_each(|word| assert!(note.contains(word), "{word}: {note}"));
}

#[test]
fn what_may_be_another_inside_is_told() {
    let work = Work::new();
    let put = |name: &str, text: &str| std::fs::write(work.path(name), text).unwrap();
    let whole = cuboid([6.0, 4.0, 5.0]);
    // The same box again: its volume counts once.
    let faces: String =
        whole.lines().filter(|line| line.starts_with("v ")).fold(String::new(), |text, line| text + line + "\n");
    let shifted = faces.replace("v 0 ", "v 0.5 ").replace("v 6 ", "v 6.5 ");
    put(
        "twice.obj",
        &(whole.clone()
            + &shifted
            + "f 9 10 12 11\nf 13 15 16 14\nf 9 13 14 10\nf 11 12 16 15\nf 9 11 15 13\nf 10 14 16 12\n"),
    );
    let report = work.json("convert twice.obj o.vdb --voxel-size 0.2");
    assert!((number(&report["mesh"], "volume") - 240.0).abs() < 1e-9, "{report}");
    assert_eq!(report["mesh"]["inward_shells"], 0);
    told(&report, &["240", "overlaps"]);
    // The sides of a mesh do not matter, as long as they agree.
    let turned: String = whole.lines().fold(String::new(), |text, line| match line.strip_prefix("f ") {
        Some(corners) if !corners.contains('\\') => {
            text + "f " + &corners.split(' ').rev().collect::<Vec<_>>().join(" ") + "\n"
        }
        _ => text + line + "\n",
    });
    let turned = turned.replace("f -8 -6 \\\n-2 -4", "f -4 -2 -6 -8");
    put("turned.obj", &turned);
    let report = work.json("convert turned.obj o.vdb --voxel-size 0.2");
    assert!((number(&report["mesh"], "volume") + 120.0).abs() < 1e-9, "{report}");
    assert_eq!(report["notes"].as_array().unwrap().len(), 0, "{report}");
    assert!((number(&work.json("convert o.vdb o.ply")["mesh"], "volume") - 120.0).abs() < 0.5);
    // One side turned.
    put("odd.obj", &whole.replace("f 2 6 8 4", "f 4 8 6 2"));
    told(&work.json("convert odd.obj o.vdb --voxel-size 0.2"), &["4 edges", "different sides"]);
    // A plate of a third of a voxel about the centres of voxels.
    put(
        "plate.obj",
        &cuboid([6.0, 4.0, 0.07]).replace(" 0.07 1 0.5", " 0.035 1 0.5").replace(" 0 1 0.5", " -0.035 1 0.5"),
    );
    told(&work.json("convert plate.obj o.vdb --voxel-size 0.2"), &["mean length", "--voxel-size"]);
    put("flat.obj", &cuboid([6.0, 4.0, 0.0]));
    work.refused("convert flat.obj o.vdb --voxel-size 0.2", Code::EmptyGrid, &["flat.obj", "thickness"]);
    put("point.obj", "v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n");
    work.refused("convert point.obj o.vdb", Code::Invalid, &["0 x 0 x 0", "--voxel-size"]);
    put("large.obj", &cuboid([6e38, 4e38, 5e38]));
    work.refused("convert large.obj o.vdb --voxel-size 2e38", Code::Unsupported, &["large.obj", "2e38"]);
}

#[test]
fn far_from_the_origin_surfaces_are_as_exact() {
    let work = Work::new();
    let map = Affine::uniform(0.25, DVec3::new(3.0, -2.0, 7.0)).unwrap();
    write(&work.path("ball.vdb"), &ball(map));
    work.json("convert ball.vdb near.ply --iso 0.5");
    let mut far = mesh(&work.path("near.ply"));
    // Voxels of 0.2 with indices of 5 million: in single precision, points would move by a quarter of a voxel.
    let shift = DVec3::new(1e6, -5e5, 2e5);
    far.vertices.iter_mut().for_each(|v| *v += shift);
    let text = far.vertices.iter().fold(String::new(), |text, v| text + &format!("v {} {} {}\n", v.x, v.y, v.z));
    let faces = far.polygons().map(|p| p.iter().fold("f".to_owned(), |text, c| text + &format!(" {}", c + 1)));
    std::fs::write(work.path("far.obj"), text + &faces.collect::<Vec<_>>().join("\n")).unwrap();
    for ending in ["ply", "obj"] {
        work.json("convert far.obj far.vdb --voxel-size 0.2");
        work.json(&format!("convert far.vdb back.{ending}"));
        let centre = map.to_world(CENTRE) + shift;
        let off = |v: &DVec3| (v.distance(centre) - 0.25 * RADIUS).abs();
        let most = mesh(&work.path(&format!("back.{ending}"))).vertices.iter().map(off).fold(0.0, f64::max);
        // As near the origin: see `a_sphere_keeps_its_place_from_mesh_to_level_set_and_back`.
        assert!(most < 3.0 * 0.25 * OFF, "{most}");
    }
}

#[test]
fn values_that_are_no_numbers_leave_no_surface() {
    let work = Work::new();
    let map = Affine::uniform(0.5, DVec3::ZERO).unwrap();
    for (value, name) in [(f64::NAN, "nan"), (f64::INFINITY, "inf")] {
        write(
            &work.path("bad.vdb"),
            &grid(16, map, |p| if p.x == 8.0 { value } else { f64::from(u8::from(p.x < 8.0)) }),
        );
        work.refused(
            &format!("convert bad.vdb {name}.ply --iso 0.5"),
            Code::Invalid,
            &["bad.vdb", "grid 'density'", "NaN", "--repair"],
        );
        assert!(!work.path(&format!("{name}.ply")).exists());
    }
}

#[test]
fn damaged_meshes_are_refused_with_their_place() {
    let work = Work::new();
    let tetrahedron = String::from_utf8(tetrahedron("ascii")).unwrap();
    let ply = |from: &str, to: &str| tetrahedron.replacen(from, to, 1);
    let cases = [
        (
            "a.obj",
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n".to_owned(),
            Code::Invalid,
            vec!["polygon 0", "vertex 3", "3 vertices"],
        ),
        ("b.obj", "v 0 0 0\nf 1 0 1\n".into(), Code::Invalid, vec!["line 2", "'0'"]),
        ("c.obj", "v 0 0 0\nf -1 -2 -1\n".into(), Code::Invalid, vec!["line 2", "'-2'", "-1"]),
        ("d.obj", "v 0 0 0\nf 1 1\n".into(), Code::Invalid, vec!["line 2", "2 corners"]),
        ("e.obj", "v 0 nan 0\n".into(), Code::Invalid, vec!["line 1", "NaN"]),
        ("f.obj", "v 0 0\n".into(), Code::Invalid, vec!["line 1", "v 0 0"]),
        ("g.obj", "# nothing\n".into(), Code::Invalid, vec!["0 vertices", "no polygons"]),
        ("h.obj", "f -9223372036854775808 1 9223372036854775807\n".into(), Code::Invalid, vec!["line 1"]),
        ("j.obj", "\u{feff}v 0 0 0\nf 1 2 1".into(), Code::Invalid, vec!["vertex 1", "1 vertices"]),
        ("i.obj", "f 1 ".repeat(300_000), Code::Invalid, vec!["line 1", "1048576 bytes"]),
        (
            "a.ply",
            ply("element vertex 4", "element vertex 400000000000"),
            Code::Invalid,
            vec!["vertex 8 of 400000000000", "ends"],
        ),
        ("b.ply", ply("3 0 0 255", "3 inf 0 255"), Code::Invalid, vec!["vertex 1 of 4", "3 inf"]),
        ("c.ply", ply("7 3 0 1 3", "7 3 0 1 4"), Code::Invalid, vec!["polygon 1", "vertex 4", "4 vertices"]),
        ("d.ply", ply("7 3 0 1 3", "7 3 0 -1 3"), Code::Invalid, vec!["face 1 of 4"]),
        ("e.ply", ply("7 3 0 1 3", "7 2 0 1"), Code::Invalid, vec!["2 corners"]),
        ("f.ply", ply("short z", "short w"), Code::Invalid, vec!["`z`"]),
        ("g.ply", ply("vertex_index", "strips"), Code::Invalid, vec!["vertex_indices"]),
        ("h.ply", ply("ascii", "asciii"), Code::Invalid, vec!["header"]),
        (
            "i.ply",
            ply("list uchar ushort vertex_index", "list uchar float vertex_index"),
            Code::Invalid,
            vec!["whole numbers"],
        ),
        ("j.ply", ply("element face 4", "element face 0"), Code::Invalid, vec!["4 vertices", "no polygons"]),
        ("l.ply", ply("0 0 0 255", &"0 ".repeat(600_000)), Code::Invalid, vec!["vertex 0 of 4", "1048576 bytes"]),
        ("k.ply", format!("ply\n{}", "comment x\n".repeat(200_000)), Code::Invalid, vec!["header"]),
    ];
    for (name, content, code, facts) in cases {
        std::fs::write(work.path(name), content).unwrap();
        let facts: Vec<&str> = std::iter::once(name).chain(facts).collect();
        work.refused(&format!("convert {name} o.vdb --voxel-size 0.1"), code, &facts);
    }
    let whole = self::tetrahedron("binary_little_endian");
    for length in (0..whole.len() - 1).step_by(7) {
        std::fs::write(work.path("cut.ply"), &whole[..length]).unwrap();
        let out = work.command("convert cut.ply o.vdb --voxel-size 0.1").output().unwrap();
        assert_eq!(out.status.code(), Some(2), "{length}");
    }
    assert!(!work.path("o.vdb").exists());
}

#[test]
fn meshes_of_many_vertices_stay_within_the_memory() {
    let work = Work::new();
    let mut text = "v 0 0 0\n".repeat(3_000_000);
    text += "f 1 2 3\n";
    std::fs::write(work.path("many.obj"), text).unwrap();
    work.refused(
        "convert many.obj o.vdb --voxel-size 0.1 --max-memory 150M --threads 1",
        Code::MemoryLimit,
        &["many.obj", "--max-memory"],
    );
}

#[test]
fn results_are_the_same_for_any_number_of_threads() {
    let work = Work::new();
    write(&work.path("ball.vdb"), &ball(odd()));
    let bytes = |name: &str| std::fs::read(work.path(name)).unwrap();
    for threads in [1, 2, 5] {
        work.json(&format!("convert ball.vdb s{threads}.ply --iso 0.4 --adaptivity 0.3 --threads {threads}"));
        work.json(&format!("convert s1.ply l{threads}.vdb --voxel-size 0.1 --half-width 5 --threads {threads}"));
        assert!(bytes(&format!("s{threads}.ply")) == bytes("s1.ply"), "{threads}");
        let same = work.difference("l1.vdb", &format!("l{threads}.vdb"));
        assert_eq!(same["max_difference"].as_f64().unwrap_or(0.0), 0.0, "{threads}: {same}");
    }
}

#[test]
fn sequences_of_volumes_become_sequences_of_meshes_and_back() {
    let work = Work::new();
    for frame in [3, 4] {
        std::fs::copy(crate::common::work::fixture("plume.vdb"), work.path(&format!("p.{frame:04}.vdb"))).unwrap();
    }
    let report = work.json("convert p.####.vdb m.####.ply --iso 0.1");
    assert_eq!(report["converted"], 2);
    let report = work.json("convert m.####.ply q.####.vdb --voxel-size 0.1 --to fog");
    assert_eq!(report["converted"], 2);
    assert_eq!(density(&work.path("q.0004.vdb")).class, GridClass::FogVolume);
}

/// Scenes in glTF are read with the placement of their nodes, in each of the ways in which they hold their numbers.
#[test]
fn scenes_in_gltf_are_read() {
    let work = Work::new();
    let [binary, inline, beside] = ["scene.glb", "inline.gltf", "beside.gltf"].map(|name| work.path(name));
    let (bytes, buffer) = gltf(None);
    std::fs::write(&binary, bytes).unwrap();
    let data = base64::engine::general_purpose::STANDARD.encode(&buffer);
    let uri = format!("data:application/octet-stream;base64,{data}");
    std::fs::write(&inline, gltf(Some(&uri)).0).unwrap();
    std::fs::write(&beside, gltf(Some("of%20the%20scene.bin")).0).unwrap();
    std::fs::write(work.path("of the scene.bin"), &buffer).unwrap();
    let found = mesh(&binary);
    assert_eq!([&found, &found], [&mesh(&inline), &mesh(&beside)]);
    // 12 triangles of the box, 2 of the strip and 4 of the fan, of which those with a corner twice are flat.
    assert_eq!((found.vertices.len(), found.ends.len()), (36 + 4 + 4, 12 + 2 + 4));
    let bounds =
        found.vertices[..36].iter().fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[a, b], v| [a.min(*v), b.max(*v)]);
    assert_eq!(bounds, [DVec3::new(10.0, 0.0, 0.0), DVec3::new(11.0, 2.0, 3.0)]);
    let turned = [[10.0, 20.0, 0.0], [10.0, 22.0, 0.0], [8.0, 20.0, 0.0], [10.0, 20.0, 2.0]].map(DVec3::from_array);
    assert_eq!((&found.vertices[36..40], &found.vertices[40..]), (&turned[..], &turned[..]));
    let report = work.json("convert scene.glb scene.vdb --voxel-size 0.1");
    assert!((number(&report["mesh"], "volume") - (6.0 + 8.0 / 6.0)).abs() < 1e-5, "{report}");
    assert_eq!(report["mesh"]["open_edges"], 0, "{report}");
    work.json("render @plume.vdb --views 1 --size 8x8 --holdout scene.glb -o held.exr");
    let scene = serde_json::json!({"volumes": [{"file": "plume.vdb"}], "meshes": [{"file": "beside.gltf"}],
        "lights": [{"type": "DistantLight", "direction": [0, 0, 1], "irradiance": [3, 3, 3]}]});
    std::fs::write(work.path("scene.json"), scene.to_string()).unwrap();
    std::fs::copy(crate::common::work::fixture("plume.vdb"), work.path("plume.vdb")).unwrap();
    work.json("render scene.json --views 1 --size 8x8 --samples 1 -o scene.exr");
}

#[test]
fn scenes_in_gltf_that_cannot_be_read_are_refused() {
    let work = Work::new();
    let (binary, _) = gltf(None);
    let refused = |name: &str, bytes: &[u8], code: Code, facts: &[&str]| {
        std::fs::write(work.path(name), bytes).unwrap();
        work.refused(&format!("convert {name} no.vdb --voxel-size 0.1"), code, &[&[name], facts].concat());
        assert!(!work.path("no.vdb").exists());
    };
    refused("cut.glb", &binary[..binary.len() - 40], Code::Invalid, &["no valid glTF"]);
    let changed = |from: &str, to: &str| {
        assert_eq!(from.len(), to.len());
        let mut bytes = binary.clone();
        let at = bytes.windows(from.len()).position(|part| part == from.as_bytes()).unwrap();
        bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
        bytes
    };
    refused("far.glb", &changed("\"count\":36", "\"count\":99"), Code::Invalid, &["99 values", "buffer"]);
    refused("many.glb", &changed("\"count\":36", "\"count\":06"), Code::Invalid, &["glTF"]);
    refused("kind.glb", &changed("\"componentType\":5121", "\"componentType\":5126"), Code::Unsupported, &["integers"]);
    refused("circle.glb", &changed("\"children\":[1]", "\"children\":[0]"), Code::Invalid, &["node"]);
    let text = |uri: &str| gltf(Some(uri)).0;
    refused("a.gltf", &text("none.bin"), Code::NotFound, &["none.bin"]);
    refused("d.gltf", &text("../a.gltf"), Code::NotFound, &["../a.gltf"]);
    refused("b.gltf", &text("https://example.org/a.bin"), Code::Unsupported, &["https", ".glb"]);
    refused("c.gltf", &text("data:text/plain;base64,###"), Code::Invalid, &["base64"]);
    work.refused("convert @cube.vdb no.glb", Code::OutputName, &["no.glb"]);
}
