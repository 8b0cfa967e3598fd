//! `cumulo convert` from and to images: which part of a file is read, what becomes of values, and what is refused.

#![allow(clippy::unwrap_used, reason = "a panic is how a test fails")]

mod images;
mod work;

use serde_json::json;
use std::process::Command;
use work::{Work, errors};

/// The same volume with another number added at each point in time.
fn series(big: bool) -> Vec<u8> {
    let frames = (0..3_u8).flat_map(|t| images::values().into_iter().map(move |v| v + t));
    [images::nifti1(2, 3, (Some(images::straight()), false), big, false), frames.collect()].concat()
}

#[test]
fn every_sample_is_told_by_its_content() {
    let work = Work::new();
    for sample in images::samples() {
        sample.write(&work.path("."));
        let words = format!("convert {} out.vdb --as float {}", sample.files[0].0, images::options(&sample).join(" "));
        let report = work.json(&words);
        let grid = &report["grid"];
        assert_eq!(
            (&grid["active_voxels"], &grid["least"], &grid["greatest"]),
            (&json!(60), &json!(1.0), &json!(60.0)),
            "{}",
            sample.name
        );
        assert_eq!((&grid["class"], &grid["value_type"]), (&json!("fog volume"), &json!("float")), "{}", sample.name);
    }
    // Values without a header are found by the header beside them.
    assert_eq!(work.json("convert e.img out.vdb")["format"], "NIfTI");
}

#[test]
fn a_point_in_time_is_chosen() {
    let work = Work::new();
    for big in [false, true] {
        std::fs::write(work.path("t.nii"), series(big)).unwrap();
        let first = work.json("convert t.nii t.vdb");
        assert!(first["notes"][0].as_str().unwrap().contains("first of 3"), "{first}");
        assert_eq!(first["grid"]["least"], json!(1.0));
        let last = work.json("convert t.nii t.vdb --time 2");
        assert_eq!((&last["grid"]["least"], &last["grid"]["greatest"]), (&json!(3.0), &json!(62.0)));
        work.refused("convert t.nii u.vdb --time 3", &["t.nii", "no time 3", "--time 0 to 2"]);
    }
}

#[test]
fn labels_stay_integers_and_leave_as_such() {
    let work = Work::new();
    let samples = images::samples();
    samples.iter().find(|s| s.name == "NIfTI, pair").unwrap().write(&work.path("."));
    let report = work.json("convert e.hdr labels.vdb --grid labels");
    assert_eq!((&report["grid"]["value_type"], &report["grid"]["name"]), (&json!("int32"), &json!("labels")));
    assert!(report["notes"].to_string().contains("--as float"));
    assert_eq!(work.json("info labels.vdb")["files"][0]["grids"][0]["value_type"], "int32");
    for ending in ["nii", "nii.gz", "nrrd", "mha", "mhd", "vti"] {
        work.json(&format!("convert labels.vdb back.{ending}"));
        let back = work.json(&format!("convert back.{ending} back.vdb --grid labels"));
        assert_eq!(back["grid"]["value_type"], "int32", "{ending}");
        assert_eq!(back["grid"]["transform"], report["grid"]["transform"], "{ending}");
    }
    work.json("convert labels.vdb back.npy");
    let place: Vec<String> = report["grid"]["transform"].as_array().unwrap()[..3]
        .iter()
        .flat_map(|r| r.as_array().unwrap())
        .map(|v| v.to_string())
        .collect();
    let back = work.json(&format!("convert back.npy back.vdb --as int --grid labels --transform={}", place.join(",")));
    assert_eq!((&back["grid"]["value_type"], &back["grid"]["active_voxels"]), (&json!("int32"), &json!(60)));
    assert_eq!(work.json("convert e.hdr f.vdb --as double")["grid"]["value_type"], "double");
}

#[test]
fn hounsfield_units_become_densities() {
    let work = Work::new();
    // 60 values from air to bone, none of which is 0.
    let values: Vec<i16> = (0..60).map(|i| -1000 + 48 * i).collect();
    let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    let file = [images::nifti1(4, 1, (Some(images::straight()), false), false, false), bytes].concat();
    std::fs::write(work.path("ct.nii"), file).unwrap();
    let plain = work.json("convert ct.nii ct.vdb --as float");
    assert!(plain["notes"].to_string().contains("--map LOW,HIGH"), "{plain}");
    assert_eq!(plain["grid"]["class"], "unknown");
    work.refused("render ct.vdb --views 1 --size 8x8 -o shots", &["negative", "cumulo convert --map"]);
    let mapped = work.json("convert ct.nii d.vdb --map -1000,1000 --threshold 0.1");
    let grid = &mapped["grid"];
    assert_eq!((&grid["class"], &grid["greatest"]), (&json!("fog volume"), &json!(1.0)));
    // 0.024 i for i up to 41, then 18 times 1: those at or below 0.1 are i = 0 to 4.
    assert_eq!((&grid["removed"], &grid["active_voxels"]), (&json!(4), &json!(55)));
    assert!((grid["removed_greatest"].as_f64().unwrap() - 0.096).abs() < 1e-15);
    // Sums of 60 terms err by 60 units in the last place.
    let share = 0.024 * 10.0 / (0.024 * 861.0 + 18.0);
    assert!((grid["removed_share"].as_f64().unwrap() - share).abs() < 60.0 * f64::EPSILON, "{grid}");
    // The same edit of the VDB gives the same grid.
    work.json("convert ct.vdb e.vdb --map -1000,1000 --threshold 0.1");
    assert_eq!(work.difference("d.vdb", "e.vdb")["max_abs"], json!(0.0));
    work.json("render d.vdb --views 1 --size 8x8 -o shots");
    // A linear map: twice the value and 2000 more.
    let linear = work.json("convert ct.nii l.vdb --scale 2 --offset 2000");
    assert_eq!(
        (&linear["grid"]["least"], &linear["grid"]["greatest"], &linear["grid"]["value_type"]),
        (&json!(0.0), &json!(5664.0), &json!("int32"))
    );
}

#[test]
fn several_arrays_are_several_grids() {
    let work = Work::new();
    let array = |name: &str, n: usize, value: &str| {
        format!(
            "<DataArray type=\"Float64\" Name=\"{name}\" NumberOfComponents=\"{n}\" format=\"ascii\">{}</DataArray>",
            value.repeat(8 * n)
        )
    };
    let text = format!(
        "<VTKFile type=\"ImageData\" byte_order=\"LittleEndian\"><ImageData WholeExtent=\"0 1 0 1 0 1\" Spacing=\"2 2 2\"><Piece Extent=\"0 1 0 1 0 1\">\
         <PointData>{}{}{}</PointData><CellData><DataArray type=\"UInt8\" Name=\"cell\" format=\"ascii\">7</DataArray></CellData></Piece></ImageData></VTKFile>",
        array("smoke", 1, "0.5 "),
        array("velocity", 3, "1 "),
        array("tensor", 9, "1 ")
    );
    std::fs::write(work.path("a.vti"), text).unwrap();
    let all = work.json("convert a.vti a.vdb");
    let names: Vec<&str> = all["grids"].as_array().unwrap().iter().map(|g| g["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["smoke", "velocity", "cell"]);
    assert!(all["notes"].to_string().contains("'tensor'"), "{all}");
    // A cell's centre lies half a spacing further in.
    assert_eq!(all["grids"][2]["transform"][0], json!([2.0, 0.0, 0.0, 1.0]));
    let one = work.json("convert a.vti b.vdb --array velocity --grid vel");
    assert_eq!(
        (&one["grid"]["name"], &one["grid"]["value_type"], &one["shape"]),
        (&json!("vel"), &json!("vec3s"), &json!([2, 2, 2, 3]))
    );
    work.refused("convert a.vti c.vdb --array heat", &["a.vti", "no array 'heat'", "smoke, velocity"]);
    work.refused("convert a.vti c.vdb --array velocity --map 0,1", &["vectors"]);
}

#[test]
fn stacks_are_folders_patterns_and_channels() {
    let work = Work::new();
    std::fs::create_dir(work.path("slices")).unwrap();
    // In natural order 9 comes before 10.
    for number in [8_u16, 9, 10] {
        let page = vec![number; 20];
        std::fs::write(work.path(&format!("slices/s{number}.tif")), images::tiff(&[page], 5, 4, "", [1, 1])).unwrap();
    }
    work.refused("convert slices a.vdb", &["slices", "--voxel-size", "--spacing"]);
    for input in ["slices", "slices/s*.tif", "slices/s#.tif"] {
        let report = work.json(&format!("convert {input} a.vdb --spacing 1,1,2"));
        assert_eq!(report["shape"], json!([5, 4, 3]), "{input}");
        work.json("convert a.vdb a.npy --axes zyx");
        let bytes = std::fs::read(work.path("a.npy")).unwrap();
        let found: Vec<i32> =
            bytes[bytes.len() - 240..].chunks(4).map(|b| i32::from_le_bytes(b.try_into().unwrap())).collect();
        assert_eq!((found[0], found[20], found[40]), (8, 9, 10), "{input}");
    }
    // Two channels at two slices, channel fastest.
    let pages: Vec<Vec<u16>> = [1, 2, 3, 4].map(|v| vec![v; 20]).into();
    let text = "ImageJ=1.53\nimages=4\nchannels=2\nslices=2\nunit=um\nspacing=2\n";
    std::fs::write(work.path("c.tif"), images::tiff(&pages, 5, 4, text, [3, 3])).unwrap();
    let report = work.json("convert c.tif c.vdb");
    let of = |i: usize| (report["grids"][i]["least"].clone(), report["grids"][i]["greatest"].clone());
    assert_eq!((of(0), of(1)), ((json!(1.0), json!(3.0)), (json!(2.0), json!(4.0))));
    assert_eq!(report["grids"][0]["transform"][2], json!([0.0, 0.0, 2.0, 0.0]));
    // A slice of another size.
    std::fs::write(work.path("slices/s11.tif"), images::tiff(&[vec![1; 6]], 3, 2, "", [1, 1])).unwrap();
    work.refused("convert slices b.vdb --voxel-size 1", &["s11.tif", "3 x 2", "5 x 4"]);
}

#[test]
fn wrong_use_says_what_to_do_and_leaves_nothing() {
    let work = Work::new();
    let samples = images::samples();
    for name in ["NIfTI-1", "raw", "NumPy", "NRRD, raw", "MetaImage"] {
        samples.iter().find(|s| s.name == name).unwrap().write(&work.path("."));
    }
    let mut analyze = images::nifti1(2, 1, (None, false), false, true);
    analyze[344..348].fill(0);
    std::fs::write(work.path("old.hdr"), analyze).unwrap();
    std::fs::write(work.path("complex.nii"), images::nifti1(32, 1, (None, false), false, false)).unwrap();
    std::fs::write(work.path("poly.vtk"), "# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\n").unwrap();
    std::fs::write(work.path("mesh.vti"), "<VTKFile type=\"UnstructuredGrid\"></VTKFile>").unwrap();
    std::fs::write(
        work.path("packed.vti"),
        "<VTKFile type=\"ImageData\" compressor=\"vtkLZ4DataCompressor\"></VTKFile>",
    )
    .unwrap();
    let cases: [(&str, &[&str]); 18] = [
        (
            "a.bin out.vdb --dims 5,4,4 --type u16 --skip 7 --spacing 1,1,1",
            &["a.bin", "127 bytes", "make 167", "--dims"],
        ),
        ("a.bin out.vdb --dims 5,4,3 --type u16 --skip 7", &["a.bin", "--spacing"]),
        ("a.bin out.vdb --dims 5,4,3 --spacing 1,1,1", &["--type"]),
        ("a.bin out.vdb --dims 5,4,3 --type u17 --spacing 1,1,1", &["u17", "u16, i16"]),
        ("a.npy out.vdb", &["a.npy", "--voxel-size"]),
        ("a.nii out.vdb --spacing 1,1,1", &["--spacing has no effect from NIfTI to VDB"]),
        ("a.nii out.vdb --array x", &["--array has no effect from NIfTI to VDB"]),
        ("a.mha out.vdb --time 1", &["--time has no effect from MetaImage to VDB"]),
        ("a.nii out.vdb --threshold 100", &["--threshold", "no voxel is active"]),
        ("a.nii out.vdb --map 5,5", &["ascend"]),
        ("a.nii out.nrrd", &["no conversion from NIfTI to .nrrd"]),
        ("old.hdr out.vdb", &["old.hdr", "Analyze 7.5", "NIfTI"]),
        ("complex.nii out.vdb", &["complex.nii", "complex numbers", "magnitude"]),
        ("poly.vtk out.vdb", &["poly.vtk", "POLYDATA", "Resample To Image"]),
        ("mesh.vti out.vdb", &["mesh.vti", "UnstructuredGrid", "Resample To Image"]),
        ("packed.vti out.vdb", &["packed.vti", "vtkLZ4DataCompressor", "ZLib"]),
        ("@plume.vdb out.nii --axes zyx", &["--axes has no effect"]),
        ("@plume.vdb out.nii --grid nosuch", &["nosuch", "density"]),
    ];
    for (words, expected) in cases {
        work.refused(&format!("convert {words}"), expected);
    }
    assert!(["out.vdb", "out.nii", "out.nrrd"].iter().all(|n| !work.path(n).exists()));
    // Both files of a header and its values, or none: the header's name is taken by a folder.
    std::fs::create_dir(work.path("h.mhd")).unwrap();
    work.refused("convert @plume.vdb h.mhd", &["h.mhd", "folder"]);
    assert!(!work.path("h.raw").exists());
}

/// A volume that is larger than memory passes as long as little of it is active.
#[test]
#[cfg(target_os = "linux")]
fn memory_is_that_of_what_is_active() {
    let work = Work::new();
    // 512 x 512 x 1024 voxels: 1 GiB as floats, of which a corner is not 0. The file has a hole.
    let mut header = images::nifti1(2, 1, (Some(images::straight()), false), false, false);
    [512_i16, 512, 1024]
        .iter()
        .enumerate()
        .for_each(|(i, n)| header[42 + 2 * i..44 + 2 * i].copy_from_slice(&n.to_le_bytes()));
    std::fs::write(work.path("large.nii"), &header).unwrap();
    let file = std::fs::OpenOptions::new().write(true).open(work.path("large.nii")).unwrap();
    file.set_len(352 + (512 * 512 * 1024)).unwrap();
    std::os::unix::fs::FileExt::write_all_at(&file, &[1, 2, 3], 352 + 512 * 512 * 1024 - 3).unwrap();
    std::os::unix::fs::FileExt::write_all_at(&file, &[4], 352).unwrap();
    // A slice as f64 is 2 MiB; libraries, the heap and a thread's stack take about 36 MiB (tests/readers_memory.rs).
    let limited = |words: &str| {
        let line = format!("ulimit -d {} && exec {} {words} --threads 1", 56 << 10, env!("CARGO_BIN_EXE_cumulo"));
        let out = Command::new("sh").args(["-c", &line]).current_dir(work.path(".")).output().unwrap();
        assert_eq!(out.status.code(), Some(0), "{words}: {}", errors(&out));
    };
    limited("convert large.nii large.vdb");
    limited("convert large.vdb large.mha");
    let mha = std::fs::metadata(work.path("large.mha")).unwrap().len();
    assert!(mha > 4 * 512 * 512 * 1024, "{mha}");
    std::fs::remove_file(work.path("large.mha")).unwrap();
    // What is active is bounded: a dense volume of 256 MiB as integers of 32 bits does not fit into 128 MiB.
    let mut header = images::nifti1(2, 1, (None, false), false, false);
    [512_i16, 512, 256]
        .iter()
        .enumerate()
        .for_each(|(i, n)| header[42 + 2 * i..44 + 2 * i].copy_from_slice(&n.to_le_bytes()));
    std::fs::write(work.path("dense.nii"), [header, vec![1; 512 * 512 * 256]].concat()).unwrap();
    work.refused("convert dense.nii dense.vdb --max-memory 128M", &["dense.nii", "--max-memory", "--threshold"]);
    assert!(!work.path("dense.vdb").exists());
}
