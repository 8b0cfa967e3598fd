//! `cumulo convert` between VDBs, EXRs and NumPy's arrays.

use crate::common::refusal;
use crate::common::work::fixture_text;
use assert_cmd::Command;
use cumulo::error::Code;
use cumulo::formats::exr;
use cumulo::formats::limits::Limits;
use cumulo::formats::npy;
use cumulo::formats::vdb::File;
use cumulo::scene::film::{Film, Plane};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

fn convert(code: i32, arguments: &[&str]) -> String {
    let run = Command::cargo_bin("cumulo").unwrap().args(["convert", "--quiet"]).args(arguments).assert().code(code);
    let output = run.get_output();
    String::from_utf8(if code == 0 { output.stdout.clone() } else { output.stderr.clone() }).unwrap()
}

fn report(arguments: &[&str]) -> Value {
    serde_json::from_str(&convert(0, &[arguments, &["--json"]].concat())).unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn a_grid_goes_to_an_array_and_back() {
    let dir = tempfile::tempdir().unwrap();
    let [array, back] = ["smoke.npy", "back.vdb"].map(|n| dir.path().join(n));
    for name in ["plume.vdb", "blob_sheared.vdb", "blob_stretched.vdb"] {
        let made = report(&[&fixture_text(name), text(&array)]);
        assert_eq!(made["axes"], json!(["x", "y", "z"]));
        let original = File::open(fixture_text(name), Limits::default()).unwrap().read_fog(None).unwrap();
        let found = npy::read(&array, Limits::default()).unwrap();
        // The values are those of the grid where it has voxels, at their places.
        let origin: Vec<i64> =
            made["grid"]["index_origin"].as_array().unwrap().iter().map(|v| v.as_i64().unwrap()).collect();
        let at = |index: [i32; 3]| {
            let [x, y, z] = [0, 1, 2].map(|a| (i64::from(index[a]) - origin[a]) as usize);
            found.values[(x * found.shape[1] + y) * found.shape[2] + z]
        };
        let mut active = 0;
        for leaf in &original.leaves {
            for voxel in (0..512).filter(|v| leaf.active[v >> 6] >> (v & 63) & 1 == 1) {
                let local = [voxel >> 6, voxel >> 3 & 7, voxel & 7];
                let index = std::array::from_fn(|a| leaf.origin[a] + local[a] as i32);
                assert_eq!(at(index), leaf.values[voxel]);
                active += 1;
            }
        }
        assert!(active > 0 && found.values.iter().filter(|v| **v != 0.0).count() <= active);
        let rows: Vec<String> = made["grid"]["transform"].as_array().unwrap()[..3]
            .iter()
            .flat_map(|row| row.as_array().unwrap().iter().map(|v| v.to_string()))
            .collect();
        report(&[text(&array), text(&back), "--transform", &rows.join(",")]);
        // The same values at the same places of the world; the voxels of the new grid begin at index 0.
        let again = File::open(&back, Limits::default()).unwrap().read_fog(None).unwrap();
        let moved = original.transform.to_world(glam::DVec3::new(origin[0] as f64, origin[1] as f64, origin[2] as f64));
        assert!((again.transform.to_world(glam::DVec3::ZERO) - moved).length() < 1e-12);
        report(&[text(&back), text(&array)]);
        let second = npy::read(&array, Limits::default()).unwrap();
        assert_eq!(
            second.values.iter().filter(|v| **v != 0.0).count(),
            found.values.iter().filter(|v| **v != 0.0).count()
        );
    }
    let made =
        report(&[text(&array), text(&back), "--voxel-size", "0.5", "--origin=-1,2,3.5", "--grid", "smoke", "--half"]);
    assert_eq!(
        made["grid"]["transform"],
        json!([[0.5, 0.0, 0.0, -1.0], [0.0, 0.5, 0.0, 2.0], [0.0, 0.0, 0.5, 3.5], [0.0, 0.0, 0.0, 1.0]])
    );
    assert_eq!(made["grid"]["name"], "smoke");
}

#[test]
fn vectors_go_there_and_back() {
    let dir = tempfile::tempdir().unwrap();
    let [array, vdb, again] = ["v.npy", "v.vdb", "w.npy"].map(|n| dir.path().join(n));
    let values: Vec<f32> = (0..9 * 2 * 3 * 3).map(|i| i as f32 + 1.0).collect();
    npy::write(&array, &[9, 2, 3, 3], &values).unwrap();
    report(&[text(&array), text(&vdb), "--voxel-size=1", "--grid=vel"]);
    let made = report(&[text(&vdb), text(&again), "--grid=vel"]);
    assert_eq!((&made["shape"], &made["axes"][3]), (&json!([9, 2, 3, 3]), &json!("component")));
    assert_eq!(npy::read(&again, Limits::default()).unwrap().values, values);
}

#[test]
fn layers_go_to_arrays_and_pictures_come_back() {
    let dir = tempfile::tempdir().unwrap();
    let [picture, array, back] = ["a.exr", "a.npy", "b.exr"].map(|n| dir.path().join(n));
    let rgba: Vec<[f32; 4]> = (0..15).map(|i| [i as f32, 0.5, -1.0, 1.0 / (1.0 + i as f32)]).collect();
    let mut film = Film::of(5, 3, rgba);
    for (k, channel) in ["X", "Y", "Z", "W"].into_iter().enumerate() {
        film.planes
            .push(Plane { name: format!("Vector.{channel}"), samples: (0..15).map(|i| (10 * k + i) as f32).collect() });
    }
    exr::write_picture(&picture, &film, &Default::default(), exr::Half::None).unwrap();
    let made = report(&[text(&picture), text(&array)]);
    assert_eq!((&made["shape"], &made["layer"]["channels"]), (&json!([3, 5, 4]), &json!(["R", "G", "B", "A"])));
    assert_eq!(npy::read(&array, Limits::default()).unwrap().values, film.rgba.concat());
    report(&[text(&array), text(&back)]);
    assert_eq!(exr::read_picture(&back, None).unwrap().rgba, film.rgba);
    let made = report(&[text(&picture), text(&array), "--layer=Vector"]);
    assert_eq!(made["layer"]["channels"], json!(["W", "X", "Y", "Z"]));
    let vectors = npy::read(&array, Limits::default()).unwrap();
    assert_eq!(vectors.values[..8], [30.0, 0.0, 10.0, 20.0, 31.0, 1.0, 11.0, 21.0]);
    // Grey and RGB make opaque pictures.
    for (shape, values, pixel) in [
        (vec![1, 2], vec![0.25, 4.0], [4.0, 4.0, 4.0, 1.0]),
        (vec![1, 2, 3], vec![0.0, 0.0, 0.0, 1.0, 2.0, 3.0], [1.0, 2.0, 3.0, 1.0]),
    ] {
        npy::write(&array, &shape, &values).unwrap();
        report(&[text(&array), text(&back)]);
        assert_eq!(exr::read_picture(&back, None).unwrap().rgba[1], pixel);
    }
}

#[test]
fn wrong_use_gives_2_and_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    npy::write(&PathBuf::from(at("flat.npy")), &[4, 4], &[1.0; 16]).unwrap();
    npy::write(&PathBuf::from(at("cube.npy")), &[2, 2, 2], &[1.0; 8]).unwrap();
    std::fs::write(at("short.npy"), &std::fs::read(at("cube.npy")).unwrap()[..140]).unwrap();
    let plume = fixture_text("plume.vdb");
    let cases: [(Vec<&str>, Code, &[&str]); 12] = [
        (vec![&plume, "out.exr"], Code::Unsupported, &["from VDB to OpenEXR", ".npy"]),
        (vec![&plume, "out.npy", "--prune=1"], Code::Invalid, &["--prune has no effect from VDB to .npy"]),
        (vec![&plume, "out.npy", "--grid=nosuch"], Code::NoSuchGrid, &["nosuch", "density"]),
        (vec![&plume, "out.vdb", "--layer=a"], Code::Invalid, &["--layer"]),
        (vec!["flat.npy", "out.vdb", "--voxel-size=1"], Code::Invalid, &["flat.npy", "[4, 4]", "[x, y, z]"]),
        (vec!["cube.npy", "out.vdb"], Code::Invalid, &["cube.npy", "--voxel-size"]),
        (vec!["cube.npy", "out.vdb", "--voxel-size=0"], Code::Usage, &["above zero"]),
        (vec!["cube.npy", "out.vdb", "--transform=1,0,0,0,1,0"], Code::Usage, &["twelve"]),
        (vec!["cube.npy", "out.vdb", "--transform=0,0,0,0,0,0,0,0,0,0,0,0"], Code::Invalid, &["singular"]),
        (vec!["cube.npy", "out.exr"], Code::Invalid, &["cube.npy", "[2, 2, 2]"]),
        (vec!["short.npy", "out.vdb", "--voxel-size=1"], Code::Invalid, &["short.npy", "140 bytes"]),
        (vec!["cube.npy", "cube.npy"], Code::Unsupported, &["from .npy to .npy"]),
    ];
    for (arguments, code, facts) in cases {
        let named: Vec<String> = arguments
            .iter()
            .map(|a| if a.starts_with('-') || a.starts_with('/') { (*a).to_owned() } else { at(a) })
            .collect();
        let named: Vec<&str> = ["convert"].into_iter().chain(named.iter().map(String::as_str)).collect();
        refusal::of(&named, code, facts);
    }
    assert!(
        !Path::new(&at("out.vdb")).exists()
            && !Path::new(&at("out.npy")).exists()
            && !Path::new(&at("out.exr")).exists()
    );
}

/// A picture for people, without a detour through a contact sheet.
#[test]
fn a_layer_becomes_a_png() {
    use cumulo::formats::png::{self, ToneMapping};
    let dir = tempfile::tempdir().unwrap();
    let [picture, shown, array] = ["a.exr", "a.PNG", "a.npy"].map(|n| dir.path().join(n));
    let rgba = (0..12 * 8).map(|i| [i as f32 / 24.0, 0.25, if i == 5 { f32::NAN } else { 0.5 }, 1.0]).collect();
    let planes = vec![Plane { name: "Depth.Z".into(), samples: vec![0.25; 96] }];
    let film = Film { planes, ..Film::of(12, 8, rgba) };
    exr::write_picture(&picture, &film, &Default::default(), exr::Half::None).unwrap();
    let tone = ToneMapping { exposure: -1.0 };
    let made = report(&[text(&picture), text(&shown), "--exposure", "-1"]);
    assert_eq!((&made["shape"], &made["tone_mapping"]["exposure"]), (&json!([8, 12]), &json!(-1.0)));
    assert!(made["notes"][0].as_str().unwrap().contains("NaN or infinite: 1;"), "{made}");
    assert!(png::texts(&shown).unwrap()[png::TONE_MAPPING].contains("2^-1,"));
    let levels = |path: &Path| {
        let mut reader =
            ::png::Decoder::new(std::io::BufReader::new(std::fs::File::open(path).unwrap())).read_info().unwrap();
        let mut levels = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut levels).unwrap();
        levels
    };
    assert_eq!(levels(&shown), tone.rgb8(&film));
    report(&[text(&picture), text(&shown), "--layer", "Depth"]);
    assert_eq!(levels(&shown), tone.rgb8(&Film::of(12, 8, vec![[0.5, 0.5, 0.5, 1.0]; 96])));
    assert!(convert(2, &[text(&picture), text(&array), "--exposure", "1"]).contains("--exposure has no effect"));
    let jpeg = convert(2, &[text(&picture), text(&dir.path().join("a.jpg"))]);
    assert!(jpeg.contains("no conversion from OpenEXR to .jpg") && jpeg.contains(".png"), "{jpeg}");
}
