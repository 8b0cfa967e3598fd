//! `cumulo convert` from and to images: which part of a file is read, what becomes of values, and what is refused.

use crate::common::images;
use crate::common::work::{Work, errors};
use cumulo::error::Code;
use serde_json::json;
use std::process::Command;

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
        work.refused(
            "convert t.nii u.vdb --time-point 3",
            Code::Invalid,
            &["t.nii", "no time 3", "--time-point 0 to 2"],
        );
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
fn grids_of_mitsuba_are_scans_and_are_written() {
    let work = Work::new();
    std::fs::write(work.path("m.vol"), images::mitsuba(1, &images::values())).unwrap();
    let made = work.json("convert m.vol m.vdb");
    assert_eq!((&made["format"], &made["shape"]), (&json!(".vol"), &json!([5, 4, 3])));
    work.json("convert m.vdb back.vol");
    assert_eq!(std::fs::read(work.path("m.vol")).unwrap(), std::fs::read(work.path("back.vol")).unwrap());
    assert_eq!(work.json("diff m.vol m.vdb")["same"], json!(true));
    let report = work.json("convert m.vol far.vdb --spacing 2,3,4 --origin=1,1,1");
    assert_eq!(report["grid"]["transform"][1], json!([0.0, 3.0, 0.0, 1.0]));
    // Its box is no box.
    let mut flat = images::mitsuba(1, &images::values());
    flat[24..28].copy_from_slice(&f32::NAN.to_le_bytes());
    std::fs::write(work.path("flat.vol"), flat).unwrap();
    work.refused("convert flat.vol out.vdb", Code::Invalid, &["flat.vol", "NaN", "ascend", "--voxel-size"]);
    work.json("convert flat.vol out.vdb --voxel-size 1");
    work.json("info flat.vol");
    // Voxels that are turned.
    let turned = [images::nifti1(2, 1, (Some(images::oblique()), false), false, false), images::values()].concat();
    std::fs::write(work.path("t.nii"), turned).unwrap();
    work.json("convert t.nii t.vdb --as float");
    work.refused("convert t.vdb t.vol", Code::Unsupported, &["t.vol", "turned or sheared", "--axes zyx", ".nrrd"]);
    assert!(!work.path("t.vol").exists());
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
    work.refused("render ct.vdb --views 1 --size 8x8 -o shots", Code::Invalid, &["negative", "cumulo convert --map"]);
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
    work.refused("convert a.vti c.vdb --array heat", Code::Invalid, &["a.vti", "no array 'heat'", "smoke, velocity"]);
    work.refused("convert a.vti c.vdb --array velocity --map 0,1", Code::Invalid, &["vectors"]);
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
    work.refused("convert slices a.vdb", Code::Invalid, &["slices", "--voxel-size", "--spacing"]);
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
    work.refused("convert slices b.vdb --voxel-size 1", Code::Invalid, &["s11.tif", "3 x 2", "5 x 4"]);
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
        "<VTKFile type=\"ImageData\" compressor=\"vtkLZMADataCompressor\"></VTKFile>",
    )
    .unwrap();
    let cases: [(&str, Code, &[&str]); 18] = [
        (
            "a.bin out.vdb --dims 5,4,4 --type u16 --skip 7 --spacing 1,1,1",
            Code::Invalid,
            &["a.bin", "127 bytes", "make 167", "--dims"],
        ),
        ("a.bin out.vdb --dims 5,4,3 --type u16 --skip 7", Code::Invalid, &["a.bin", "--spacing"]),
        ("a.bin out.vdb --dims 5,4,3 --spacing 1,1,1", Code::Usage, &["--type"]),
        ("a.bin out.vdb --dims 5,4,3 --type u17 --spacing 1,1,1", Code::Usage, &["u17", "u16, i16"]),
        ("a.npy out.vdb", Code::Invalid, &["a.npy", "--voxel-size"]),
        ("a.nii out.vdb --spacing 1,1,1", Code::Invalid, &["--spacing has no effect from NIfTI to VDB"]),
        ("a.nii out.vdb --array x", Code::Invalid, &["--array has no effect from NIfTI to VDB"]),
        ("a.mha out.vdb --time-point 1", Code::Invalid, &["--time-point has no effect from MetaImage to VDB"]),
        ("a.nii out.vdb --threshold 100", Code::Invalid, &["--threshold", "no voxel is active"]),
        ("a.nii out.vdb --map 5,5", Code::Usage, &["ascend"]),
        ("a.nii out.nrrd", Code::Unsupported, &["no conversion from NIfTI to .nrrd"]),
        ("old.hdr out.vdb", Code::Unsupported, &["old.hdr", "Analyze 7.5", "NIfTI"]),
        ("complex.nii out.vdb", Code::Unsupported, &["complex.nii", "complex numbers", "magnitude"]),
        ("poly.vtk out.vdb", Code::Unsupported, &["poly.vtk", "POLYDATA", "Resample To Image"]),
        ("mesh.vti out.vdb", Code::Unsupported, &["mesh.vti", "UnstructuredGrid", "Resample To Image"]),
        ("packed.vti out.vdb", Code::Unsupported, &["packed.vti", "vtkLZMADataCompressor", "ZLib"]),
        ("@plume.vdb out.nii --axes zyx", Code::Invalid, &["--axes has no effect"]),
        ("@plume.vdb out.nii --grid nosuch", Code::NoSuchGrid, &["nosuch", "density"]),
    ];
    for (words, code, expected) in cases {
        work.refused(&format!("convert {words}"), code, expected);
    }
    assert!(["out.vdb", "out.nii", "out.nrrd"].iter().all(|n| !work.path(n).exists()));
    // Both files of a header and its values, or none: the header's name is taken by a folder.
    std::fs::create_dir(work.path("h.mhd")).unwrap();
    work.refused("convert @plume.vdb h.mhd", Code::Invalid, &["h.mhd", "folder"]);
    assert!(!work.path("h.raw").exists());
}

/// A legacy file of VTK as the library writes it: values of the whole file before the grid's size, names of components, numbers
/// of points and bits among the arrays.
fn legacy(binary: bool) -> Vec<u8> {
    let mut file = format!(
        "# vtk DataFile Version 5.1\nx\n{}\nDATASET STRUCTURED_POINTS\nFIELD FieldData 1\nTIME 1 1 double\n",
        if binary { "BINARY" } else { "ASCII" }
    )
    .into_bytes();
    let values = |numbers: &[u8], big: &[u8]| {
        let text = || numbers.iter().map(|n| format!("{n} ")).collect::<String>().into_bytes();
        [if binary { big.to_vec() } else { text() }, b"\n".to_vec()].concat()
    };
    let mut add = |text: &str, values: Vec<u8>| {
        file.extend(text.as_bytes());
        file.extend(values);
    };
    add("", values(&[2], &2_f64.to_be_bytes()));
    add(
        "DIMENSIONS 2 2 2\nSPACING 1 1 1\nORIGIN 0 0 0\nPOINT_DATA 8\nFIELD FieldData 4\nbits 1 8 bit\n",
        values(&[1; 8], &[0xff]),
    );
    let ids: Vec<u8> = (1..9_i32).flat_map(i32::to_be_bytes).collect();
    add("ids 1 8 vtkIdType\n", values(&[1, 2, 3, 4, 5, 6, 7, 8], &ids));
    add("METADATA\nCOMPONENT_NAMES\nX\n\nmy%20field%25 1 8 unsigned_char\n", values(&[9; 8], &[9; 8]));
    add("b 1 8 unsigned_char\n", values(&[3; 8], &[3; 8]));
    file
}

#[test]
fn legacy_files_of_the_library_are_read() {
    let work = Work::new();
    for binary in [false, true] {
        std::fs::write(work.path("a.vtk"), legacy(binary)).unwrap();
        let report = work.json("convert a.vtk a.vdb");
        let grids: Vec<_> = report["grids"]
            .as_array()
            .unwrap()
            .iter()
            .map(|g| (g["name"].as_str().unwrap(), g["least"].as_f64().unwrap(), g["greatest"].as_f64().unwrap()))
            .collect();
        assert_eq!(grids, [("ids", 1.0, 8.0), ("my field%", 9.0, 9.0), ("b", 3.0, 3.0)], "{binary}");
        assert!(report["notes"].to_string().contains("'bits'"), "{report}");
    }
}

#[test]
fn stacks_are_read_as_stored_and_say_what_they_state() {
    let work = Work::new();
    let pages: Vec<Vec<u16>> = [vec![7; 20], vec![9; 20]].into();
    let spaced = |text: &str| images::tiff(&pages, 5, 4, text, [3, 3]);
    // The photometric interpretation, a short of value 1: low values are dark. 0: they are bright.
    let mut white = spaced("");
    for at in 0..white.len() - 10 {
        if white[at..at + 10] == [6, 1, 3, 0, 1, 0, 0, 0, 1, 0] {
            white[at + 8] = 0;
        }
    }
    std::fs::write(work.path("w.tif"), white).unwrap();
    let report = work.json("convert w.tif w.vdb --voxel-size 1");
    assert_eq!((&report["grid"]["least"], &report["grid"]["greatest"]), (&json!(7.0), &json!(9.0)));
    assert!(report["notes"].to_string().contains("MinIsWhite"), "{report}");
    // OME with another unit for z, and without any size along z.
    let ome = |rest: &str| {
        let text = format!(
            "<OME><Image><Pixels DimensionOrder=\"XYZCT\" SizeC=\"1\" SizeT=\"1\" SizeZ=\"2\" PhysicalSizeX=\"1\" PhysicalSizeY=\"1\" {rest}/></Image></OME>"
        );
        std::fs::write(work.path("o.tif"), spaced(&text)).unwrap();
        work.json("convert o.tif o.vdb")
    };
    let mixed = ome("PhysicalSizeZ=\"500\" PhysicalSizeZUnit=\"nm\"");
    // A quotient and a product round once each.
    assert!((mixed["grid"]["transform"][2][2].as_f64().unwrap() - 0.5).abs() < 2.0 * f64::EPSILON, "{mixed}");
    let flat = ome("");
    assert!(flat["notes"].to_string().contains("does not say how far slices are apart"), "{flat}");
    // ImageJ's large stacks have one directory for all images.
    std::fs::write(work.path("i.tif"), spaced("ImageJ=1.53\nimages=12\nunit=um\nspacing=2\n")).unwrap();
    work.refused("convert i.tif i.vdb", Code::Unsupported, &["i.tif", "2 page(s)", "ordinary TIFF"]);
}

/// An array of NumPy of 2 x 2 x 1 numbers, whose first axis is the fastest.
fn npy(kind: &str, bytes: &[u8]) -> Vec<u8> {
    let mut text = format!("{{'descr': '{kind}', 'fortran_order': True, 'shape': (2, 2, 1), }}");
    while !(text.len() + 11).is_multiple_of(64) {
        text.push(' ');
    }
    text.push('\n');
    [b"\x93NUMPY\x01\x00", &(text.len() as u16).to_le_bytes()[..], text.as_bytes(), bytes].concat()
}

#[test]
fn what_single_precision_does_not_hold_is_told() {
    let work = Work::new();
    let labels: Vec<u8> = [1_i32, 16_777_217, 33_554_435, 0].iter().flat_map(|v| v.to_le_bytes()).collect();
    std::fs::write(work.path("labels.npy"), npy("<i4", &labels)).unwrap();
    let report = work.json("convert labels.npy l.vdb --voxel-size 1");
    assert_eq!((&report["grid"]["value_type"], &report["grid"]["rounded"]), (&json!("float"), &json!(2)));
    assert!(report["notes"].to_string().contains("2 whole numbers beyond 16777216 are rounded"), "{report}");
    for to in ["int", "double"] {
        let report = work.json(&format!("convert labels.npy {to}.vdb --voxel-size 1 --as {to}"));
        assert_eq!(report["grid"]["rounded"], json!(0), "{to}");
    }
    // So is what an edit of a grid loses.
    let edited = work.json("convert int.vdb float.vdb --as float");
    assert!(edited["warnings"].to_string().contains("2 whole numbers"), "{edited}");
    let reals: Vec<u8> = [1e300_f64, 1e-50, 0.1, 0.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    std::fs::write(work.path("reals.npy"), npy("<f8", &reals)).unwrap();
    let report = work.json("convert reals.npy r.vdb --voxel-size 1");
    let grid = &report["grid"];
    assert_eq!((&grid["overflowed"], &grid["vanished"], &grid["active_voxels"]), (&json!(1), &json!(1), &json!(2)));
    for words in ["1 values are too large", "1 values are too small", "--as double keeps them"] {
        assert!(report["notes"].to_string().contains(words), "{report}");
    }
    // 16-bit floats end at 65504.
    let large: Vec<u8> = [70_000_f64, 1e-9, 0.1, 0.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    std::fs::write(work.path("large.npy"), npy("<f8", &large)).unwrap();
    let report = work.json("convert large.npy h.vdb --voxel-size 1 --half");
    for words in ["1 values are too large for 16-bit floats", "1 values are too small for 16-bit floats"] {
        assert!(report["notes"].to_string().contains(words), "{report}");
    }
    let report = work.json("convert labels.npy h.vdb --voxel-size 1 --half --as int");
    assert!(report["notes"].to_string().contains("--half has no effect on integers"), "{report}");
    let tiny: Vec<u8> = [1e-50_f64; 4].iter().flat_map(|v| v.to_le_bytes()).collect();
    std::fs::write(work.path("tiny.npy"), npy("<f8", &tiny)).unwrap();
    let report = work.json("convert tiny.npy t.vdb --voxel-size 1");
    assert!(!report["notes"].to_string().contains("every value is 0"), "{report}");
}

#[test]
fn types_that_vectors_do_not_have_are_refused() {
    let work = Work::new();
    let header = images::nifti1(16, 1, (Some(images::straight()), false), false, false);
    let mut header = header;
    header[40..42].copy_from_slice(&5_i16.to_le_bytes());
    header[50..52].copy_from_slice(&3_i16.to_le_bytes());
    let values: Vec<u8> = (0..180).flat_map(|i| (i as f32).to_le_bytes()).collect();
    std::fs::write(work.path("v.nii"), [header, values].concat()).unwrap();
    assert_eq!(work.json("convert v.nii v.vdb")["grid"]["value_type"], "vec3s");
    assert_eq!(work.json("convert v.nii v.vdb --as float")["grid"]["value_type"], "vec3s");
    // Where positions are brought to right, anterior, superior, vectors are not.
    for (space, turned) in [("RAS", false), ("left-posterior-superior", true)] {
        let header = format!(
            "NRRD0005\ntype: float\ndimension: 4\nsizes: 3 1 1 1\nkinds: vector domain domain domain\nspace: {space}\n\
             space directions: none (1,0,0) (0,1,0) (0,0,1)\nencoding: ascii\n\n1 2 3\n"
        );
        std::fs::write(work.path("v.nrrd"), header).unwrap();
        let report = work.json("convert v.nrrd v.vdb");
        assert_eq!(report["notes"].to_string().contains("vectors stay as they are"), turned, "{report}");
    }
    for to in ["int", "double"] {
        work.refused(&format!("convert v.nii w.vdb --as {to}"), Code::Unsupported, &["v.nii", "vectors", "--as"]);
    }
}

#[test]
fn fields_that_are_easily_overlooked_count() {
    let work = Work::new();
    let bytes: Vec<u8> = images::values().iter().flat_map(|v| [0, *v]).collect();
    let header = "ObjectType = Image\nNDims = 3\nDimSize = 5 4 3\nElementType = MET_SHORT\nBinaryData = T\n\
                  BinaryDataByteOrderMSB = T\nElementDataFile = LOCAL\n";
    std::fs::write(work.path("m.mha"), [header.as_bytes(), &bytes].concat()).unwrap();
    assert_eq!(work.json("convert m.mha m.vdb")["grid"]["greatest"], json!(60.0));
    let nrrd = |fields: &str| {
        let header =
            format!("NRRD0005\ntype: short\nsizes: 5 4 3\ndimension: 3\nendian: big\nencoding: raw\n{fields}\n\n");
        std::fs::write(work.path("n.nrrd"), [header.as_bytes(), &bytes].concat()).unwrap();
        work.json("convert n.nrrd n.vdb")
    };
    let report = nrrd("space: LPS\nspacings: 2 3 4\nspace origin: (1,2,3)");
    assert_eq!(
        report["grid"]["transform"],
        json!([[-2.0, 0.0, 0.0, -1.0], [0.0, -3.0, 0.0, -2.0], [0.0, 0.0, 4.0, 3.0], [0.0, 0.0, 0.0, 1.0]])
    );
    let report = nrrd("space: RAS\nspace directions: (2,0,0) (0,3,0) (0,0,4)\nspace units: \"um\" \"um\" \"um\"");
    assert!(report["notes"].to_string().contains("a unit of length is one um"), "{report}");
    let report = nrrd("units: \"mm\" \"mm\" \"mm\"\nspacings: 1 1 1");
    assert!(!report["notes"].to_string().contains("unit"), "{report}");
    // A file for each point in time, in which the components of vectors follow each other; and one for each component.
    for (name, first) in [("t0.raw", 0), ("t1.raw", 6)] {
        std::fs::write(work.path(name), [1, 2, 3, 4, 5, 6].map(|v: u8| v + first)).unwrap();
    }
    let files = |kinds: &str, sizes: &str, list: &str| {
        let header = format!(
            "NRRD0005\ntype: uchar\ndimension: 5\nsizes: {sizes}\nkinds: {kinds}\nencoding: raw\ndata file: LIST\n{list}\n"
        );
        std::fs::write(work.path("s.nhdr"), header).unwrap();
    };
    files("domain domain domain vector list", "2 1 1 3 2", "t0.raw\nt1.raw");
    work.json("convert s.nhdr s.vdb --time 1");
    work.json("convert s.vdb s.npy");
    let bytes = std::fs::read(work.path("s.npy")).unwrap();
    let found = bytes[bytes.len() - 24..].as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect::<Vec<_>>();
    assert_eq!(found, [7.0, 9.0, 11.0, 8.0, 10.0, 12.0]);
    files("domain domain domain list vector", "2 1 1 5 3", "t0.raw\nt1.raw\nt0.raw");
    work.refused("convert s.nhdr s.vdb --time 4", Code::Unsupported, &["s.nhdr", "3 files for"]);
    // An axis that is not in space has no direction; some writers say so by `nan`.
    let text = "NRRD0005\ntype: uchar\ndimension: 4\nsizes: 1 5 4 3\nencoding: raw\nspace dimension: 3\n\
                space directions: (nan,nan,nan) (2,0,0) (0,3,0) (0,0,4)\n\n";
    std::fs::write(work.path("f.nrrd"), [text.as_bytes(), &images::values()].concat()).unwrap();
    assert_eq!(work.json("convert f.nrrd f.vdb")["shape"], json!([5, 4, 3]));
    // NIfTI: micrometres, and a description that holds the word of MRC where MRC has it.
    let mut nii = images::nifti1(2, 1, (Some(images::straight()), false), false, false);
    nii[123] = 3;
    nii[208..212].copy_from_slice(b"MAP ");
    std::fs::write(work.path("u.nii"), [nii, images::values()].concat()).unwrap();
    let report = work.json("convert u.nii u.vdb");
    assert_eq!(report["format"], "NIfTI");
    assert!(report["notes"].to_string().contains("a unit of length is one micrometre"), "{report}");
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
    // A slice as f64 is 2 MiB; libraries, the heap and a thread's stack take about 36 MiB (tests/cli/readers_memory.rs).
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
    // So is an array that is held whole together with its grid: 64 MiB of bytes, beside 9 MB of leaves.
    let cells = 512 * 512 * 256_usize;
    let mut array = npy("|u1", &[]);
    let (from, to) =
        (b"'fortran_order': True, 'shape': (2, 2, 1), }", b"'fortran_order': False,'shape':(512,512,256)}");
    let at = array.windows(from.len()).position(|w| w == from).unwrap();
    array[at..at + from.len()].fill(b' ');
    array[at..at + to.len()].copy_from_slice(to);
    let start = array.len();
    array.resize(start + cells, 0);
    array[start..start + (2 << 20)].fill(1);
    std::fs::write(work.path("held.npy"), array).unwrap();
    work.refused(
        "convert held.npy held.vdb --voxel-size 1 --max-memory 130M",
        Code::MemoryLimit,
        &["held.npy", "--max-memory"],
    );
    work.json("convert held.npy held.vdb --voxel-size 1 --max-memory 200M");
    work.refused(
        "convert dense.nii dense.vdb --max-memory 128M",
        Code::MemoryLimit,
        &["dense.nii", "--max-memory", "--threshold"],
    );
    assert!(!work.path("dense.vdb").exists());
}

/// What a scan holds is shown.
#[test]
fn scans_are_described() {
    let work = Work::new();
    let found = &work.json("info @head.nii.gz")["files"][0];
    assert_eq!((&found["format"], &found["kind"]), (&json!("image"), &json!("NIfTI")));
    let image = &found["images"][0];
    assert_eq!((&image["size"], &image["values"]), (&json!([48, 56, 40]), &json!("integer")));
    assert_eq!((&image["voxel_size"], &image["origin"]), (&json!([4.0, 4.0, 6.0]), &json!([-94.0, -110.0, -117.0])));
    assert!(work.text("info @head.nii.gz").contains("48 x 56 x 40 voxels"));
    // Pictures and volumes are not mixed up, either.
    work.json("render @plume.vdb --views 1 --size 4x4 -o picture.exr");
    work.refused("diff picture.exr picture.exr", Code::Invalid, &["this is a picture", "cumulo compare"]);
    work.refused("compare @plume.vdb @plume.vdb", Code::Invalid, &["an OpenVDB file", "cumulo diff"]);
}
