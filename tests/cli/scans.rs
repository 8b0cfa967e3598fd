//! Scans, arrays and NanoVDBs as inputs of the commands that read volumes.

use crate::common::images;
use crate::common::work::{Work, errors};
use cumulo::error::Code;
use serde_json::{Value, json};
use std::path::Path;

/// Options of a small picture.
const PICTURE: &str = "--views 1 --size 8x8 --density-scale 0.01";

/// A NIfTI of 5 x 4 x 3 floats, `value(i)` the i-th.
fn nifti(value: impl Fn(usize) -> f32) -> Vec<u8> {
    let values = (0..60).flat_map(|i| value(i).to_le_bytes()).collect();
    [images::nifti1(16, 1, (Some(images::straight()), false), false, false), values].concat()
}

/// A Zarr array of version 2, of 3 x 4 x 5 bytes in two chunks.
fn zarr(folder: &Path) {
    std::fs::create_dir_all(folder).unwrap();
    let header = json!({
        "zarr_format": 2, "shape": [3, 4, 5], "chunks": [2, 4, 5], "dtype": "|u1", "order": "C", "fill_value": 0,
        "compressor": null, "filters": null,
    });
    std::fs::write(folder.join(".zarray"), header.to_string()).unwrap();
    let mut values = images::values();
    values.resize(80, 0);
    for (number, chunk) in values.chunks(40).enumerate() {
        std::fs::write(folder.join(format!("{number}.0.0")), chunk).unwrap();
    }
}

/// An element of a DICOM data set, explicit and little-endian.
fn element(tag: (u16, u16), vr: &str, value: &[u8]) -> Vec<u8> {
    let mut value = value.to_vec();
    if value.len() % 2 == 1 {
        value.push(if vr == "UI" { 0 } else { b' ' });
    }
    let length = match vr {
        "OW" | "OB" => [&[0_u8, 0][..], &(value.len() as u32).to_le_bytes()].concat(),
        _ => (value.len() as u16).to_le_bytes().to_vec(),
    };
    [&tag.0.to_le_bytes()[..], &tag.1.to_le_bytes(), vr.as_bytes(), &length, &value].concat()
}

/// Slice `z` of a computed tomography of 5 x 4 pixels, whose values are stored numbers minus 1000.
fn slice(series: &str, z: usize) -> Vec<u8> {
    let short = |tag, v: u16| element(tag, "US", &v.to_le_bytes());
    let text = |tag, vr, text: &str| element(tag, vr, text.as_bytes());
    let pixels: Vec<u8> = (0..20).flat_map(|i| (1000 + (i + 20 * z) as u16).to_le_bytes()).collect();
    let meta = [
        text((2, 2), "UI", "1.2.840.10008.5.1.4.1.1.2"),
        text((2, 3), "UI", &format!("1.2.3.{z}")),
        text((2, 0x10), "UI", "1.2.840.10008.1.2.1"),
    ]
    .concat();
    let data = [
        text((8, 0x60), "CS", "CT"),
        text((0x20, 0xe), "UI", series),
        text((0x20, 0x13), "IS", &z.to_string()),
        text((0x20, 0x32), "DS", &format!("0\\0\\{}", 2 * z)),
        text((0x20, 0x37), "DS", "1\\0\\0\\0\\1\\0"),
        short((0x28, 2), 1),
        text((0x28, 4), "CS", "MONOCHROME2"),
        short((0x28, 0x10), 4),
        short((0x28, 0x11), 5),
        text((0x28, 0x30), "DS", "0.5\\0.5"),
        short((0x28, 0x100), 16),
        short((0x28, 0x101), 16),
        short((0x28, 0x102), 15),
        short((0x28, 0x103), 0),
        text((0x28, 0x1052), "DS", "-1000"),
        text((0x28, 0x1053), "DS", "1"),
        element((0x7fe0, 0x10), "OW", &pixels),
    ]
    .concat();
    let length = element((2, 0), "UL", &(meta.len() as u32).to_le_bytes());
    [&[0_u8; 128][..], b"DICM", &length, &meta, &data].concat()
}

/// A series of three slices in a folder.
fn dicom(folder: &Path, series: &str, name: &str) {
    std::fs::create_dir_all(folder).unwrap();
    (0..3).for_each(|z| std::fs::write(folder.join(format!("{name}{z}.dcm")), slice(series, z)).unwrap());
}

/// Asserts that pictures and grids of an input are those of the VDB that it becomes.
fn same(work: &Work, input: &str, options: &str) {
    work.json(&format!("convert {input} made.vdb {options}"));
    work.json(&format!("render {input} {PICTURE} {options} -o a.exr --overwrite"));
    work.json(&format!("render made.vdb {PICTURE} -o b.exr --overwrite"));
    let [a, b] = ["a.exr", "b.exr"].map(|name| work.picture(name));
    let bits = |film: &cumulo::scene::film::Film| film.rgba.iter().flatten().map(|v| v.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&a), bits(&b), "{input}");
    assert!(a.rgba.iter().any(|p| p[3] > 0.0), "{input}: nothing is seen");
    let report = work.json(&format!("diff {input} made.vdb {options}"));
    assert_eq!(report["same"], json!(true), "{input}: {report}");
}

#[test]
fn pictures_of_scans_are_those_of_the_vdbs_that_they_become() {
    let work = Work::new();
    for sample in images::samples().iter().filter(|sample| !sample.options.contains("--dims")) {
        sample.write(&work.path("."));
        same(&work, sample.files[0].0, &images::options(sample).join(" "));
    }
    zarr(&work.path("z.zarr"));
    same(&work, "z.zarr", "--voxel-size 0.5");
    dicom(&work.path("ct"), "1.2.3", "s");
    same(&work, "ct", "");
    same(&work, "ct/s1.dcm", "");
    for z in 0..3 {
        let page: Vec<u16> = images::values()[20 * z..20 * z + 20].iter().map(|v| u16::from(*v)).collect();
        std::fs::create_dir_all(work.path("stack")).unwrap();
        std::fs::write(work.path(&format!("stack/p{z}.tif")), images::tiff(&[page], 5, 4, "", [1, 1])).unwrap();
    }
    same(&work, "stack", "--spacing 1,1,2");
    same(&work, "stack/p#.tif", "--spacing 1,1,2");
}

#[test]
fn nanovdbs_are_read_as_vdbs_are_one_by_one_and_in_sequences() {
    let work = Work::new();
    work.json("convert @plume.vdb s.0001.nvdb");
    work.json("convert @tiles.vdb t.nvdb");
    for name in ["s.0001.nvdb", "t.nvdb"] {
        same(&work, name, "");
    }
    std::fs::copy(work.path("s.0001.nvdb"), work.path("s.0002.nvdb")).unwrap();
    let report = work.json(&format!("render s.####.nvdb {PICTURE} -o shot"));
    assert_eq!(report["rendered"], json!(2), "{report}");
    work.json("view s.####.nvdb -o sheet.png --size 32");
    work.json("view t.nvdb -o one.png --size 32");
    assert_eq!(work.json("diff s.####.nvdb s.####.nvdb")["same"], json!(true));
    work.json(&format!("plan s.####.nvdb {PICTURE}"));
    let found = &work.json("info t.nvdb")["files"][0];
    assert_eq!(found["format"], "nanovdb");
}

/// Each command that reads volumes, with a scan and with the VDB that it becomes.
#[test]
fn every_command_takes_a_scan() {
    let work = Work::new();
    std::fs::write(work.path("a.nii"), nifti(|i| i as f32 / 60.0)).unwrap();
    work.json("convert a.nii a.vdb");
    let without = |mut report: Value| {
        for key in
            ["provenance", "seconds", "input", "output", "cost", "report", "equivalent_renders", "render_seconds"]
        {
            report.as_object_mut().unwrap().remove(key);
        }
        report
    };
    for words in [
        "gradient IN --wrt extinction --loss mean --views 1 --size 8x8",
        "plan IN --views 1 --size 8x8 --density-scale 1",
        "viewpoint IN -o OUT.json --starts 2 --iterations 1 --size 16x16 --overwrite",
    ] {
        let [scan, vdb] =
            ["a.nii", "a.vdb"].map(|name| without(work.json(&words.replace("IN", name).replace("OUT", name))));
        if words.starts_with("plan") {
            // Costs are measured.
            assert_eq!(scan["measured"], vdb["measured"]);
        } else {
            assert_eq!(scan, vdb, "{words}");
        }
    }
    work.json("view a.nii -o a.png --size 32");
    work.json("study render a.nii --views 1 --size 8x8 --knobs step --repeats 1 --budget 2 -o study");
    work.json("study gradient a.nii --wrt extinction --views 1 --size 8x8 --repeats 1 --budget 2 -o derivatives");
    work.json(&format!("render a.vdb {PICTURE} -o views"));
    work.json("motion a.nii --cameras views --frames 1-2 --samples 1 -o motion.####.exr");
    std::fs::copy(work.path("a.nii"), work.path("s.01.nii")).unwrap();
    std::fs::write(work.path("s.02.nii"), nifti(|i| i as f32 / 50.0)).unwrap();
    let report = work.json(&format!("render s.##.nii {PICTURE} -o shot"));
    assert_eq!(report["rendered"], json!(2), "{report}");
    std::fs::create_dir(work.path("frames")).unwrap();
    for name in ["s.01.nii", "s.02.nii"] {
        std::fs::rename(work.path(name), work.path("frames").join(name)).unwrap();
    }
    assert_eq!(work.json(&format!("render frames {PICTURE} -o again"))["rendered"], json!(2));
    work.json("view frames -o frames.png --size 32");
    work.json("convert frames/s.##.nii s.##.vdb");
    assert!(work.path("s.01.vdb").exists() && work.path("s.02.vdb").exists());
}

#[test]
fn what_a_file_leaves_open_is_asked_for_and_options_without_effect_are_refused() {
    let work = Work::new();
    let samples = images::samples();
    let write = |name: &str| samples.iter().find(|s| s.name == name).unwrap().write(&work.path("."));
    write("NumPy");
    let frames = (0..3_u8).flat_map(|t| images::values().into_iter().map(move |v| v + t)).collect();
    let times = [images::nifti1(2, 3, (Some(images::straight()), false), false, false), frames].concat();
    std::fs::write(work.path("t.nii"), times).unwrap();
    let render = |words: &str| format!("render {words} {PICTURE} -o no.exr");
    work.refused(&render("a.npy"), Code::Invalid, &["a.npy", "--voxel-size"]);
    work.refused(&render("t.nii"), Code::Invalid, &["t.nii", "3 points in time", "--time-point"]);
    work.refused(&render("t.nii --time-point 3"), Code::Invalid, &["t.nii", "--time-point 0"]);
    work.refused("diff t.nii t.nii", Code::Invalid, &["--time-point"]);
    work.json(&format!("render t.nii {PICTURE} --time-point 2 -o last.exr"));
    for (words, option) in [
        (render("@plume.vdb --voxel-size 2"), "--voxel-size"),
        (render("t.nii --spacing 1,1,1"), "--spacing"),
        (render("a.npy --voxel-size 1 --channel 0"), "--channel"),
        ("view @plume.vdb --series 1.2 -o no.png".into(), "--series"),
        ("info @plume.vdb --level 1".into(), "--level"),
        ("validate t.nii --axes zyx".into(), "--axes"),
        ("diff @plume.vdb @plume.vdb --array a".into(), "--array"),
        ("gradient @plume.vdb --wrt extinction --loss mean --views 1 --as float".into(), "--as"),
    ] {
        work.refused(&words, Code::Invalid, &[option]);
    }
    dicom(&work.path("two"), "1.2.3", "a");
    dicom(&work.path("two"), "1.2.4", "b");
    work.refused(&render("two"), Code::Invalid, &["--series", "1.2.3", "1.2.4"]);
    work.json(&format!("render two --series 1.2.4 {PICTURE} -o series.exr"));
    // Of two files one may need what the other states itself.
    work.json("convert a.npy a.vdb --voxel-size 2");
    assert_eq!(work.json("diff a.npy a.vdb --voxel-size 2")["same"], json!(true));
    let vector = [images::nifti1(128, 1, (None, false), false, false), vec![9; 180]].concat();
    std::fs::write(work.path("rgb.nii"), vector).unwrap();
    work.refused(&render("rgb.nii"), Code::Unsupported, &["rgb.nii"]);
    assert!(!work.path("no.exr").exists() && !work.path("no.png").exists());
}

#[test]
fn damaged_scans_end_in_errors() {
    let work = Work::new();
    for sample in images::samples().iter().filter(|sample| !sample.options.contains("--dims")) {
        sample.write(&work.path("."));
        let (file, options) = (sample.files[0].0, images::options(sample).join(" "));
        let (last, bytes) = sample.files.last().unwrap();
        std::fs::write(work.path(last), &bytes[..bytes.len() * 2 / 3]).unwrap();
        for (words, codes) in [
            (format!("render {file} {PICTURE} {options} -o no.exr"), [2, 2]),
            (format!("info {file} {options}"), [2, 2]),
            (format!("validate {file} {options}"), [1, 2]),
        ] {
            let out = work.command(&words).output().unwrap();
            assert!(out.status.code().is_some_and(|code| codes.contains(&code)), "{words}: {}", errors(&out));
        }
    }
    assert!(!work.path("no.exr").exists());
}

#[test]
fn a_scan_that_needs_more_memory_than_allowed_is_refused() {
    let work = Work::new();
    let shape = "{'descr': '|u1', 'fortran_order': True, 'shape': (300, 300, 300), }";
    let header = format!("{shape:<117}\n");
    let start = [&b"\x93NUMPY\x01\x00"[..], &(header.len() as u16).to_le_bytes(), header.as_bytes()].concat();
    std::fs::write(work.path("a.npy"), [start, vec![7; 27_000_000]].concat()).unwrap();
    for words in ["render a.npy --views 1 --size 8x8 -o no.exr", "view a.npy -o no.png", "diff a.npy a.npy"] {
        work.refused(
            &format!("{words} --voxel-size 1 --max-memory 128M"),
            Code::MemoryLimit,
            &["a.npy", "--max-memory"],
        );
    }
    // Statistics need a slice alone.
    assert_eq!(
        work.json("info a.npy --max-memory 128M")["files"][0]["images"][0]["statistics"]["count"],
        json!(27_000_000)
    );
}

#[test]
fn scans_are_described_with_their_values() {
    let work = Work::new();
    let image = |words: &str| work.json(&format!("info {words}"))["files"][0]["images"][0].clone();
    std::fs::write(work.path("a.nii"), nifti(|i| i as f32 - 10.0)).unwrap();
    let found = image("a.nii");
    let s = &found["statistics"];
    assert_eq!(
        (&s["min"], &s["max"], &s["negative"], &s["zero"]),
        (&json!(-10.0), &json!(49.0), &json!(10), &json!(1))
    );
    assert_eq!(s["histogram"].as_array().unwrap().len(), 16);
    assert_eq!(s["percentiles"][2], json!({"percent": 50.0, "value": 19.0}));
    assert_eq!((&found["value_type"], &found["orientation"]["letters"]), (&json!("f32"), &json!("RAS")));
    dicom(&work.path("ct"), "1.2.3", "s");
    let found = image("ct");
    assert_eq!((&found["unit"], &found["rescale"]), (&json!("HU"), &json!([1.0, -1000.0])));
    assert_eq!((&found["value_type"], &found["orientation"]["letters"]), (&json!("u16"), &json!("LPS")));
    assert_eq!(found["voxel_size"], json!([0.5, 0.5, 2.0]));
    zarr(&work.path("z.zarr"));
    let tiff = images::tiff(&[vec![7; 20], vec![9; 20]], 5, 4, "", [1, 1]);
    std::fs::write(work.path("s.tif"), tiff).unwrap();
    let samples = images::samples();
    samples.iter().filter(|s| s.name.starts_with("NumPy")).for_each(|s| drop(s.write(&work.path("."))));
    for name in ["a.npy", "a.npz", "z.zarr", "s.tif"] {
        assert_eq!(image(name)["voxel_size"], Value::Null, "{name}");
        assert_eq!(image(&format!("{name} --voxel-size 2"))["voxel_size"], json!([2.0, 2.0, 2.0]), "{name}");
        assert!(work.text(&format!("info {name}")).contains("spacing unknown"), "{name}");
    }
    assert!(work.text("info ct").contains("HU"));
}

#[test]
fn faults_of_scans_are_told() {
    let work = Work::new();
    std::fs::write(work.path("fine.nii"), nifti(|i| i as f32)).unwrap();
    std::fs::write(work.path("negative.nii"), nifti(|i| i as f32 - 30.0)).unwrap();
    let wrong = |i| if i == 7 { f32::NAN } else { f32::INFINITY };
    std::fs::write(work.path("wrong.nii"), nifti(|i| if i < 9 { wrong(i) } else { 1.0 })).unwrap();
    let report = work.json("validate fine.nii negative.nii");
    assert_eq!(report["valid"], json!(true));
    assert!(report["files"][1]["findings"].to_string().contains("negative"), "{report}");
    let out = work.command("validate wrong.nii --json").output().unwrap();
    assert_eq!(out.status.code(), Some(1), "{}", errors(&out));
    let text = String::from_utf8(out.stdout).unwrap();
    assert!(text.contains("1 values are NaN") && text.contains("8 values are infinite"), "{text}");
    dicom(&work.path("ct"), "1.2.3", "s");
    std::fs::write(work.path("ct/s9.dcm"), slice("1.2.3", 9)).unwrap();
    assert_eq!(work.command("validate ct").output().unwrap().status.code(), Some(1));
}

#[test]
fn all_files_of_a_scan_are_inputs_of_its_pictures() {
    let work = Work::new();
    zarr(&work.path("z.zarr"));
    let samples = images::samples();
    samples.iter().find(|s| s.name == "MetaImage, apart").unwrap().write(&work.path("."));
    let inputs = |folder: &str| {
        let text = std::fs::read_to_string(work.path(folder).join("transforms.json")).unwrap();
        serde_json::from_str::<Value>(&text).unwrap()["provenance"]["inputs"].clone()
    };
    let render = |folder: &str| {
        work.json(&format!("render z.zarr --voxel-size 1 {PICTURE} -o {folder}"));
        inputs(folder)["z.zarr"].as_str().unwrap().to_owned()
    };
    let before = render("first");
    std::fs::write(work.path("z.zarr/1.0.0"), [3; 40]).unwrap();
    assert_ne!(before, render("second"));
    work.json(&format!("render b.mhd {PICTURE} -o third"));
    let names: Vec<String> = inputs("third").as_object().unwrap().keys().cloned().collect();
    assert_eq!(names, ["b.mhd", "b.zraw"]);
    // The values beside a header are protected as the header is.
    let bytes = std::fs::read(work.path("b.zraw")).unwrap();
    std::fs::hard_link(work.path("b.zraw"), work.path("link.exr")).unwrap();
    work.refused(&format!("render b.mhd {PICTURE} -o link.exr --overwrite"), Code::OutputIsInput, &["link.exr"]);
    assert_eq!(std::fs::read(work.path("b.zraw")).unwrap(), bytes);
}
