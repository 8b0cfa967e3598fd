//! OME-Zarr images and Zarr arrays: placement, levels, channels, and damage.

use crate::common::images;
use cumulo::error::Result;
use cumulo::formats::imaging::image::{Header, Values};
use cumulo::formats::imaging::options::Options;
use cumulo::formats::limits::Limits;
use glam::DVec3;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

const LIMITS: Limits = Limits { max_memory: 64 << 20 };
/// Lengths of t, c, z, y, x of the finest level.
const SHAPE: [usize; 5] = [1, 2, 5, 6, 7];

fn store(path: &Path, value: &Value) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, value.to_string()).unwrap();
}

/// Value of a voxel: its indices as digits.
fn value(c: usize, [z, y, x]: [usize; 3]) -> u16 {
    (c * 1000 + z * 100 + y * 10 + x) as u16
}

/// Writes an array of chunks of 1 x 1 x 2 x 4 x 4, in gzip, of which the last one of channel 1 is missing.
fn array(folder: &Path, version: u8, shape: [usize; 5]) {
    let chunk = [1, 1, 2, 4, 4];
    let shape_of = json!(shape);
    let metadata = if version == 2 {
        json!({"zarr_format": 2, "shape": shape_of, "chunks": chunk, "dtype": ">u2", "fill_value": 7, "order": "C",
               "filters": null, "compressor": {"id": "gzip", "level": 1}, "dimension_separator": "/"})
    } else {
        json!({"zarr_format": 3, "node_type": "array", "shape": shape_of, "data_type": "uint16", "fill_value": 7,
               "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": chunk}},
               "chunk_key_encoding": {"name": "default"},
               "codecs": [{"name": "bytes", "configuration": {"endian": "big"}}, {"name": "gzip"}]})
    };
    store(&folder.join(if version == 2 { ".zarray" } else { "zarr.json" }), &metadata);
    for c in 0..shape[1] {
        for (z, y, x) in (0..3).flat_map(|z| (0..2).flat_map(move |y| (0..2).map(move |x| (z, y, x)))) {
            if (c, z, y, x) == (1, 2, 1, 1) {
                continue;
            }
            let mut bytes = Vec::new();
            for i in 0..32 {
                let at = [z * 2 + i / 16, y * 4 + i / 4 % 4, x * 4 + i % 4];
                bytes.extend(value(c, at).to_be_bytes());
            }
            let mut packed = vec![0; 300];
            let level = libdeflater::CompressionLvl::default();
            let n = libdeflater::Compressor::new(level).gzip_compress(&bytes, &mut packed).unwrap();
            let prefix = if version == 2 { "0" } else { "c/0" };
            let path = folder.join(format!("{prefix}/{c}/{z}/{y}/{x}"));
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, &packed[..n]).unwrap();
        }
    }
}

/// Writes an image of two levels, whose axes have uneven scales and a translation.
fn image(folder: &Path, version: u8) {
    let axis = |name: &str, kind: &str| match kind {
        "space" => json!({"name": name, "type": kind, "unit": "micrometer"}),
        _ => json!({"name": name, "type": kind}),
    };
    let axes =
        json!([axis("t", "time"), axis("c", "channel"), axis("z", "space"), axis("y", "space"), axis("x", "space")]);
    let dataset = |n: usize, factor: f64| {
        json!({"path": n.to_string(), "coordinateTransformations": [
            {"type": "scale", "scale": [1, 1, 3.0 * factor, 0.5 * factor, 0.25 * factor]},
            {"type": "translation", "translation": [0, 0, 10.0, 20.0, 30.0 + factor]}]})
    };
    let multiscales = json!([{"name": "cells", "axes": axes, "datasets": [dataset(0, 1.0), dataset(1, 2.0)],
        "coordinateTransformations": [{"type": "scale", "scale": [1, 1, 2, 2, 2]}]}]);
    if version == 2 {
        store(&folder.join(".zgroup"), &json!({"zarr_format": 2}));
        store(&folder.join(".zattrs"), &json!({"multiscales": multiscales}));
    } else {
        let attributes = json!({"ome": {"version": "0.5", "multiscales": multiscales}});
        store(&folder.join("zarr.json"), &json!({"zarr_format": 3, "node_type": "group", "attributes": attributes}));
    }
    array(&folder.join("0"), version, SHAPE);
    array(&folder.join("1"), version, [1, 2, 3, 3, 4]);
}

fn read_within(path: &Path, options: &Options, limits: Limits) -> Result<(Header, Vec<f64>)> {
    let mut image = images::format_of("Zarr").open(path, options, limits)?.remove(0);
    let mut values = Vec::new();
    let mut slice = vec![0.0; image.header.slice_len().unwrap_or(0).min(1 << 20)];
    for _ in 0..image.header.size[2].min(1000) {
        image.slices.next_slice(&mut slice)?;
        values.extend_from_slice(&slice);
    }
    Ok((image.header, values))
}

fn read(path: &Path, options: &Options) -> Result<(Header, Vec<f64>)> {
    read_within(path, options, LIMITS)
}

#[test]
fn voxels_land_where_the_transformations_say() {
    for version in [2, 3] {
        let folder = tempfile::tempdir().unwrap();
        image(folder.path(), version);
        assert_eq!(images::found(folder.path()), Some("Zarr"));
        let choice = Options { channel: Some(1), ..Options::default() };
        let (header, values) = read(folder.path(), &choice).unwrap();
        assert_eq!((header.size, header.name.as_deref()), ([7, 6, 5], Some("cells")));
        for z in 0..5 {
            for y in 0..6 {
                for x in 0..7 {
                    let missing = z >= 4 && y >= 4 && x >= 4;
                    let expected = if missing { 7 } else { value(1, [z, y, x]) };
                    assert_eq!(values[(z * 6 + y) * 7 + x], f64::from(expected), "{z} {y} {x}");
                }
            }
        }
        // The image's scale of 2 acts on the level's scale and translation.
        let at = |x, y, z| header.index_to_world.to_world(DVec3::new(x, y, z));
        assert_eq!(at(0.0, 0.0, 0.0), DVec3::new(62.0, 40.0, 20.0));
        assert_eq!(at(6.0, 5.0, 4.0), DVec3::new(65.0, 45.0, 44.0));
        assert!(header.notes.iter().any(|n| n.contains("micrometer")), "{:?}", header.notes);
        // The metadata's own path names the same.
        let document = folder.path().join(if version == 2 { ".zattrs" } else { "zarr.json" });
        assert_eq!(read(&document, &choice).unwrap().1, values);
    }
}

#[test]
fn labels_of_64_bits_stay_integers_and_an_origin_moves_the_image() {
    let folder = tempfile::tempdir().unwrap();
    image(folder.path(), 2);
    let path = folder.path().join("0/.zarray");
    let text = std::fs::read_to_string(&path)
        .unwrap()
        .replace("\"compressor\":{\"id\":\"gzip\",\"level\":1}", "\"compressor\":null");
    std::fs::write(
        &path,
        text.replace(">u2", "<i8").replace("\"dimension_separator\":\"/\"", "\"dimension_separator\":\".\""),
    )
    .unwrap();
    let origin = DVec3::new(5.0, 6.0, 7.0);
    let options = Options { level: Some(0), origin: Some(origin), ..Options::default() };
    let (header, values) = read(folder.path(), &options).unwrap();
    // No chunk has a name of this kind, so that all have the fill value.
    assert_eq!((header.values, values[0]), (Values::Integer, 7.0));
    assert_eq!(header.index_to_world.to_world(DVec3::ZERO), origin);
    // The steps are still the image's.
    assert_eq!(header.index_to_world.to_world(DVec3::X) - origin, DVec3::X * 0.5);
}

#[test]
fn levels_go_by_memory_or_by_number() {
    let folder = tempfile::tempdir().unwrap();
    image(folder.path(), 3);
    let (header, _) = read(folder.path(), &Options::default()).unwrap();
    assert!(header.notes.iter().any(|n| n.contains("level 0") && n.contains("1: 4 x 3 x 3")), "{:?}", header.notes);
    assert!(header.notes.iter().any(|n| n.contains("⟨channel")), "{:?}", header.notes);
    let coarse = Options { level: Some(1), ..Options::default() };
    let (header, _) = read(folder.path(), &coarse).unwrap();
    assert_eq!((header.size, header.index_to_world.voxel_size()), ([4, 3, 3], DVec3::new(1.0, 2.0, 12.0)));
    // The metadata's estimate is the larger need here; a level whose voxels do not fit is passed over.
    assert!(
        read(folder.path(), &Options { level: Some(2), ..Options::default() })
            .unwrap_err()
            .to_string()
            .contains("`level=0` to 1")
    );
    assert!(
        read(folder.path(), &Options { channel: Some(2), ..Options::default() })
            .unwrap_err()
            .to_string()
            .contains("`channel=0` to 1")
    );
    assert!(
        read(folder.path(), &Options { time: Some(1), ..Options::default() })
            .unwrap_err()
            .to_string()
            .contains("`time_point=0` to 0")
    );
}

#[test]
fn bare_arrays_want_a_spacing() {
    let folder = tempfile::tempdir().unwrap();
    array(folder.path(), 2, SHAPE);
    assert!(read(folder.path(), &Options::default()).unwrap_err().to_string().contains("`spacing"));
    let spaced = Options { spacing: Some(DVec3::new(1.0, 2.0, 3.0)), ..Options::default() };
    let (header, values) = read(folder.path(), &spaced).unwrap();
    assert_eq!(header.index_to_world.voxel_size(), DVec3::new(1.0, 2.0, 3.0));
    assert_eq!(values[7 * 6 * 4 + 7 * 5 + 6], 456.0);
}

#[test]
fn paths_stay_in_the_folder() {
    for name in ["../0", "/etc", "", "a/../../0"] {
        let folder = tempfile::tempdir().unwrap();
        image(folder.path(), 2);
        let mut attributes: Value =
            serde_json::from_slice(&std::fs::read(folder.path().join(".zattrs")).unwrap()).unwrap();
        attributes["multiscales"][0]["datasets"][0]["path"] = json!(name);
        store(&folder.path().join(".zattrs"), &attributes);
        assert!(
            read(folder.path(), &Options::default()).unwrap_err().to_string().contains("does not lie in"),
            "{name}"
        );
    }
}

/// Every path to a value of a document.
fn pointers(value: &Value, at: String, all: &mut Vec<String>) {
    match value {
        Value::Object(map) => map.iter().for_each(|(k, v)| pointers(v, format!("{at}/{k}"), all)),
        Value::Array(list) => list.iter().enumerate().for_each(|(i, v)| pointers(v, format!("{at}/{i}"), all)),
        _ => {}
    }
    all.push(at);
}

#[test]
fn damaged_images_are_refused() {
    let spaced = Options { spacing: Some(DVec3::ONE), ..Options::default() };
    let mut refused = 0;
    for version in [2, 3] {
        let folder = tempfile::tempdir().unwrap();
        image(folder.path(), version);
        let files: Vec<PathBuf> = match version {
            2 => [".zattrs", "0/.zarray"].map(|n| folder.path().join(n)).to_vec(),
            _ => ["zarr.json", "0/zarr.json"].map(|n| folder.path().join(n)).to_vec(),
        };
        for file in &files {
            let whole = std::fs::read(file).unwrap();
            let sound: Value = serde_json::from_slice(&whole).unwrap();
            let mut all = Vec::new();
            pointers(&sound, String::new(), &mut all);
            let odd = [
                json!(null),
                json!(-1),
                json!(0),
                json!(u64::MAX),
                json!(1e300),
                json!("x"),
                json!([]),
                json!({}),
                json!([1, 2]),
            ];
            for (i, pointer) in all.iter().enumerate() {
                // Three values each, in turn.
                for value in odd.iter().skip(i % 3).step_by(3) {
                    let mut damaged = sound.clone();
                    *damaged.pointer_mut(pointer).unwrap() = value.clone();
                    std::fs::write(file, damaged.to_string()).unwrap();
                    match read_within(folder.path(), &spaced, Limits { max_memory: 8 << 20 }) {
                        Ok((header, values)) => assert!(values.len() <= 1 << 20 && !header.size.contains(&0)),
                        Err(error) => {
                            refused += 1;
                            assert!(error.remedy().is_some() && error.path().is_some(), "{pointer} {value}: {error}");
                        }
                    }
                }
            }
            for n in (0..whole.len()).step_by(11) {
                std::fs::write(file, &whole[..n]).unwrap();
                assert!(read(folder.path(), &spaced).unwrap_err().remedy().is_some());
            }
            std::fs::write(file, &whole).unwrap();
        }
        let chunk = folder.path().join(if version == 2 { "0/0/0/1/0/0" } else { "0/c/0/0/1/0/0" });
        let whole = std::fs::read(&chunk).unwrap();
        for n in 0..whole.len() {
            std::fs::write(&chunk, &whole[..n]).unwrap();
            let error = read(folder.path(), &spaced).unwrap_err();
            assert!(error.to_string().contains("/1/0/0") && error.remedy().is_some(), "{error}");
        }
    }
    assert!(refused > 150, "{refused}");
}

/// gzip of a chunk has a checksum, which damage of the values and of itself contradicts.
#[test]
fn chunks_that_disagree_with_their_checksum_are_refused() {
    for version in [2, 3] {
        let folder = tempfile::tempdir().unwrap();
        image(folder.path(), version);
        read(folder.path(), &Options::default()).unwrap();
        let chunk = folder.path().join(if version == 2 { "0/0/0/1/1/1" } else { "0/c/0/0/1/1/1" });
        let whole = std::fs::read(&chunk).unwrap();
        for place in [1, 5, 8] {
            let mut bytes = whole.clone();
            bytes[whole.len() - place] ^= 1;
            std::fs::write(&chunk, bytes).unwrap();
            let error = read(folder.path(), &Options::default()).unwrap_err();
            assert!(error.to_string().contains("damaged") && error.remedy().is_some(), "{error}");
        }
    }
}
